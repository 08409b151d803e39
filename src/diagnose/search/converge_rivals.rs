//! The rivals of what was found, given the same last fit: only then does a difference tell them apart.
//!
//! RT: no.

use crate::diagnose::judge::accept::is_admissible;
use crate::diagnose::judge::continuity::has_continuous_states;
use crate::diagnose::judge::criterion::Context;
use crate::diagnose::judge::exchange::takes_its_place;
use crate::diagnose::judge::flexibility::is_overly_flexible;
use crate::diagnose::library::candidate_fit::{CandidateFit, SelectedEffect, refit_without};
use crate::diagnose::search::budget::{allowance, is_spent, within};
use crate::diagnose::search::exchange::in_its_place;
use crate::identify::fit::Limits;
use crate::identify::fitted_model::FittedModel;
use crate::identify::initial_states::refit_states;
use crate::identify::likelihood::is_misfit;
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
        let near = |t: &&mut CandidateFit| t.gain > NEARBY * a.gain && !t.candidate.is_same_as(&a.candidate);
        let mut rivals: Vec<&mut CandidateFit> =
            a.others.iter_mut().filter(comparable).filter(near).take(SETTLED).collect();
        rivals.par_iter_mut().for_each(|trial| {
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
        let takes_it = |t: &CandidateFit| {
            let same_company = t.hypothesis.rig.effects.len() == found.rig.effects.len();
            same_company
                && takes_its_place(&found, t, a, a.gain, context)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::criterion::compare;
    use crate::diagnose::judge::worked::{Shown, shown};

    const LAG: &str = "[[effect]]\neffect = \"actuator_lag\"\nat = \"u\"\ntime_constant = ";
    const DELAY: &str = "[[effect]]\neffect = \"transport_delay\"\nat = \"u\"\ndelay = ";

    /// A lag of 20 ms, for which a delay was taken while the lag's own fit had been stopped at once.
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
