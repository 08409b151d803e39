//! Effects exchanged for those that look alike, by what recordings kept back say.
//!
//! Laws of friction explain a few seconds of steps equally well, and predict a free swing very differently. Asked where recordings kept
//! back contradict the answer. A rival is fitted from the numbers of the answer: its own fit may have ended in a false minimum.
//! RT: no.

use crate::diagnose::judge::confirmation::is_contradicted;
use crate::diagnose::judge::credible_set::weight_in_set;
use crate::diagnose::judge::criterion::Context;
use crate::diagnose::library::candidate_fit::{CandidateFit, SelectedEffect};
use crate::diagnose::library::candidates::Candidate;
use crate::diagnose::robustness::held_out::Confirmation;
use crate::diagnose::search::budget::is_spent;
use crate::diagnose::search::converge_rivals::fitted_in_its_place;
use crate::identify::fitted_model::FittedModel;
use rayon::prelude::*;

/// Exchanges each effect for the lookalike that explains what was fitted as well, as far as these data tell, and that recordings
/// kept back bear out against it, if there is one. True if any was exchanged.
pub fn exchange_by_kept_back(
    found: &mut FittedModel,
    added: &mut [SelectedEffect],
    library: &dyn Fn(&FittedModel) -> Vec<Candidate>,
    context: &Context,
    said: &mut dyn FnMut(&str),
) -> bool {
    if added.is_empty() || !is_contradicted(found, context) {
        return false;
    }
    let (library, mut any) = (library(found), false);
    for (i, a) in added.iter_mut().enumerate() {
        if is_spent(found) {
            break;
        }
        let e = context.given + i;
        let told = |rival: &CandidateFit| {
            weight_in_set(found, rival, (e, a.gain), context)?;
            let told =
                Confirmation::on_kept_back(&rival.hypothesis, found, context.held_out.as_deref(), &context.floors)?;
            told.bears_out(context).then_some(told)
        };
        let rivals = lookalikes(found, &library, (a, e), context);
        let borne_out = rivals.into_iter().filter_map(|rival| Some((told(&rival)?, rival)));
        let Some((told, rival)) = borne_out.max_by(|a, b| a.0.gained.total_cmp(&b.0.gained)) else { continue };
        let (was, is) = (a.candidate.effect, rival.candidate.effect);
        said(&format!("   {is} in the place of {was}, on recordings kept back: {told}"));
        let candidate = std::mem::replace(&mut a.candidate, rival.candidate);
        a.others.retain(|t| !t.candidate.is_same_as(&a.candidate));
        a.others.insert(
            0,
            CandidateFit { candidate, hypothesis: std::mem::replace(found, rival.hypothesis), gain: a.gain },
        );
        a.gain = rival.gain;
        any = true;
    }
    any
}

/// The candidates of `library` that look like `added`, effect `e`, fitted in its place.
fn lookalikes(
    found: &FittedModel,
    library: &[Candidate],
    (added, e): (&SelectedEffect, usize),
    context: &Context,
) -> Vec<CandidateFit> {
    let rivals: Vec<&Candidate> = library.iter().filter(|other| other.looks_like(&added.candidate)).collect();
    rivals
        .into_par_iter()
        .filter_map(|candidate| fitted_in_its_place(found, candidate, (added.gain, e), context))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::worked::{Shown, shown};
    use crate::diagnose::library::candidates::Key;

    const LAG: &str = "[[effect]]\neffect = \"actuator_lag\"\nat = \"u\"\ntime_constant = 0.02\n";
    const DELAY: &str = "[[effect]]\neffect = \"transport_delay\"\nat = \"u\"\ndelay = 0.02\n";

    #[test]
    fn what_looks_like_an_effect_is_fitted_in_its_place_and_nothing_else_is() {
        let Shown { context, problem } = shown(LAG);
        let found = problem.fitted(DELAY, 20);
        let added = problem.added("transport_delay", "u", 1000.0, Vec::new());
        let candidate = |effect: &'static str, at: &str, name: &'static str| Candidate {
            keys: vec![Key { name, min: 0.0, max: 0.2, log: false }],
            starts: vec![vec![0.1], vec![0.004]],
            ..problem.candidate(effect, at)
        };
        let library = [
            candidate("transport_delay", "u", "delay"),
            candidate("actuator_lag", "u", "time_constant"),
            candidate("actuator_lag", "other", "time_constant"),
            candidate("quadratic_drag", "u", "quadratic"),
        ];
        let rivals = lookalikes(&found, &library, (&added, context.given), &context);
        let [rival] = &rivals[..] else { panic!("{}", rivals.len()) };
        let effects = &rival.hypothesis.rig.effects;
        assert!(effects.len() == found.rig.effects.len() && rival.candidate.effect == "actuator_lag");
        let lag = effects[context.given].values[0].value;
        assert!((lag / 0.02 - 1.0).abs() < 0.05 && rival.gain > added.gain, "{lag}");
    }

    #[test]
    fn nothing_is_exchanged_where_nothing_was_kept_back() {
        let Shown { context, problem } = shown(LAG);
        let (mut found, mut added) =
            (problem.fitted(DELAY, 20), [problem.added("transport_delay", "u", 1000.0, Vec::new())]);
        let library = |_: &FittedModel| -> Vec<Candidate> { panic!("not asked") };
        assert!(!exchange_by_kept_back(&mut found, &mut added, &library, &context, &mut |_| {}));
    }
}
