//! The rivals of what was found, given the same last fit: only then does a difference tell them apart.
//!
//! RT: no.

use crate::diagnose::judge::accept::is_admissible;
use crate::diagnose::judge::continuity::has_continuous_states;
use crate::diagnose::judge::criterion::{Context, compare};
use crate::diagnose::judge::exchange::{Lead, takes_its_place};
use crate::diagnose::judge::flexibility::is_overly_flexible;
use crate::diagnose::library::candidate_fit::{CandidateFit, SelectedEffect, with_effect};
use crate::diagnose::library::candidates::Candidate;
use crate::diagnose::library::limited_fit::refit_without;
use crate::diagnose::search::basin_hopping::led_out;
use crate::diagnose::search::budget::{allowance, is_spent, within};
use crate::diagnose::search::exchange::in_its_place;
use crate::identify::fit::Limits;
use crate::identify::fitted_model::FittedModel;
use crate::identify::initial_states::refit_states;
use crate::identify::likelihood::is_misfit;
use crate::model::effect::EffectKind;
use rayon::prelude::*;

/// Part of an effect's gain from which a rival is brought to rest, how many are, and how.
const NEARBY: f64 = 0.6;
const SETTLED: usize = 4;
const RIVAL_FIT: Limits = Limits { iterations: 25, tolerance: 1e-7 };

/// The near rivals of every effect brought to rest as `found` was: a fit that was stopped early is behind for that alone, and
/// what this data cannot tell apart would pass for told. Who then stands better takes the place. Not where misfit stays: there
/// no form is the true one, and who bends to it best (a ripple of some order) is not who is missing.
#[must_use]
pub fn converge_rivals(
    mut found: FittedModel,
    mut added: Vec<SelectedEffect>,
    context: &Context,
) -> (FittedModel, Vec<SelectedEffect>) {
    if is_misfit(&found.residuals, &context.floors) {
        return (found, added);
    }
    let most = allowance(&found);
    for (i, a) in added.iter_mut().enumerate() {
        if is_spent(&found) {
            break;
        }
        let total = |h: &FittedModel| -> f64 { h.blocks(&found.noise).iter().sum() };
        let comparable = |t: &&mut CandidateFit| t.hypothesis.rig.effects.len() == found.rig.effects.len();
        let others = a.others.iter_mut().filter(comparable).filter(|t| !t.candidate.is_same_as(&a.candidate));
        let near = others.filter(|t| t.gain > NEARBY * a.gain).take(SETTLED);
        near.collect::<Vec<_>>().into_par_iter().for_each(|trial| {
            // From where it stands, and from where the answer does: a rival may have stopped in a false minimum.
            let there = in_its_place(&found.rig, trial, context.given + i).map(|rig| found.extended(rig));
            let here = (trial.hypothesis.problem.clone(), trial.hypothesis.point.clone());
            for (problem, start) in there.into_iter().chain([here]) {
                let finer = within(most, &found, problem, start, (&found.noise, RIVAL_FIT), context);
                let finer = finer.map(|f| refit_states(&f, &context.floors).unwrap_or(f));
                if let Some(finer) = finer.filter(|f| total(f) > total(&trial.hypothesis)) {
                    trial.gain += total(&finer) - total(&trial.hypothesis);
                    trial.hypothesis = finer;
                }
            }
        });
        // What looks alike may be behind for a false minimum alone: it is fitted anew from where the answer stands.
        let own = &a.candidate;
        let alike = a.others.iter_mut().filter(comparable).filter(|t| t.candidate.looks_like(own));
        alike.collect::<Vec<_>>().into_par_iter().for_each(|trial| {
            let anew = fitted_in_its_place(&found, &trial.candidate, (a.gain, context.given + i), context);
            if let Some(anew) = anew.filter(|anew| anew.gain > trial.gain) {
                *trial = anew;
            }
        });
        let takes_it = |t: &CandidateFit| {
            let same_company = t.hypothesis.rig.effects.len() == found.rig.effects.len();
            same_company
                && takes_its_place(&found, t, a, (a.gain, Lead::Any), context)
                && is_admitted(&found, t, context.given + i, context)
        };
        let better = (0..a.others.len()).filter(|k| takes_it(&a.others[*k]));
        let best = better.max_by(|j, k| total(&a.others[*j].hypothesis).total_cmp(&total(&a.others[*k].hypothesis)));
        let Some(best) = best else { continue };
        let winner = a.others.remove(best);
        let candidate = std::mem::replace(&mut a.candidate, winner.candidate);
        let loser = std::mem::replace(&mut found, winner.hypothesis);
        a.others.insert(0, CandidateFit { candidate, hypothesis: loser, gain: a.gain });
        a.gain = winner.gain;
    }
    (found, added)
}

/// True if `trial` may stand in the place of effect `e`: no piece of a misfit, no number at the edge of its range, and what is
/// inside goes on from window to window.
pub(super) fn is_admitted(found: &FittedModel, trial: &CandidateFit, e: usize, context: &Context) -> bool {
    let goes_on = || {
        !trial.candidate.has_inner_states()
            || refit_without(found, e, &context.floors)
                .is_none_or(|without| has_continuous_states(&without, &trial.hypothesis, &context.floors))
    };
    !is_overly_flexible(found, trial, context) && is_admissible(&trial.hypothesis, e, context) && goes_on()
}

/// `candidate` in the place of effect `e`, which gains `gain`, from the best of its starts; `None` if it may not stand there.
pub(super) fn fitted_in_its_place(
    found: &FittedModel,
    candidate: &Candidate,
    (gain, e): (f64, usize),
    context: &Context,
) -> Option<CandidateFit> {
    let total = |h: &FittedModel| -> f64 { h.blocks(&found.noise).iter().sum() };
    let from = |start: &Vec<f64>| {
        let mut rig = with_effect(&found.rig, candidate, start);
        rig.effects.swap_remove(e);
        let (problem, point) = found.extended(rig);
        within(allowance(found), found, problem, point, (&found.noise, RIVAL_FIT), context)
    };
    let same = same_numbers(found, candidate, e);
    let best = candidate.starts.iter().chain(&same).filter_map(from).max_by(|a, b| total(a).total_cmp(&total(b)))?;
    let hypothesis = led_out(best, &found.noise, &context.floors);
    let gain = gain - compare(found, &hypothesis, context).total;
    let rival = CandidateFit { candidate: candidate.clone(), hypothesis, gain };
    is_admitted(found, &rival, e, context).then_some(rival)
}

/// The numbers of effect `e`, where those of `candidate` have the same units: a lag and a delay of one time look most alike.
fn same_numbers(found: &FittedModel, candidate: &Candidate, e: usize) -> Option<Vec<f64>> {
    let units = |kind: EffectKind| kind.keys().iter().map(|key| key.unit).collect::<Vec<_>>();
    let (stands, other) = (found.rig.effects.get(e)?, EffectKind::from_id(candidate.effect)?);
    let values = stands.values.iter().zip(&candidate.keys).map(|(v, key)| v.value.clamp(key.min, key.max)).collect();
    (units(stands.kind) == units(other)).then_some(values)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::criterion::compare;
    use crate::diagnose::judge::worked::{Shown, shown};
    use crate::diagnose::library::candidates::Key;

    const LAG: &str = "[[effect]]\neffect = \"actuator_lag\"\nat = \"u\"\ntime_constant = ";
    const DELAY: &str = "[[effect]]\neffect = \"transport_delay\"\nat = \"u\"\ndelay = ";

    /// A lag of 20 ms, for which a delay was taken while the lag's own fit had been stopped at once.
    /// A delay of 20 ms, for which a lag was taken while the delay's own fit stands in a false minimum, far behind.
    #[test]
    fn what_looks_alike_is_fitted_anew_from_where_the_answer_stands() {
        let Shown { context, problem } = shown(&format!("{DELAY}0.02\n"));
        let found = problem.fitted(&format!("{LAG}{{ value = 0.01, min = 0.0, max = 0.2 }}\n"), 25);
        let lag = found.rig.effects[context.given].values[0].value;
        let mut rival = problem.trial("transport_delay", "u", &format!("{DELAY}0.001\n"), 1, 10.0);
        rival.candidate.keys = vec![Key { name: "delay", min: 0.0, max: 0.2, log: false }];
        assert_eq!(same_numbers(&found, &rival.candidate, context.given), Some(vec![lag]));
        let drag = problem.candidate("quadratic_drag", "q1");
        assert_eq!(same_numbers(&found, &drag, context.given), None, "of another unit");
        let (found, added) =
            converge_rivals(found, vec![problem.added("actuator_lag", "u", 1000.0, vec![rival])], &context);
        assert_eq!(added[0].candidate.effect, "transport_delay");
        let delay = found.rig.effects[context.given].values[0].value;
        assert!((delay / 0.02 - 1.0).abs() < 0.03, "{delay}");
    }

    #[test]
    fn a_rival_that_was_stopped_early_takes_its_place() {
        let truth = format!("{LAG}0.02\n");
        let delay = format!("{DELAY}{{ value = 0.01, min = 0.0, max = 0.2 }}\n");
        let lag = format!("{LAG}{{ value = 0.002, min = 0.0, max = 0.2 }}\n");
        let Shown { context, problem } = shown(&truth);
        let found = problem.fitted(&delay, 25);
        let rival = problem.trial("actuator_lag", "u", &lag, 1, 900.0);
        assert!(compare(&found, &rival.hypothesis, &context).total > 30.0, "as it stands it is far behind");
        let added = problem.added("transport_delay", "u", 1000.0, vec![rival]);
        let (found, added) = converge_rivals(found, vec![added], &context);
        assert_eq!(
            (added[0].candidate.effect, added[0].others[0].candidate.effect),
            ("actuator_lag", "transport_delay")
        );
        let lag = found.rig.effects[context.given].values[0].value;
        assert!((lag / 0.02 - 1.0).abs() < 0.03, "{lag}");
    }
}
