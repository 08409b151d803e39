//! Whether another effect takes the place of one, and whether one stays.
//!
//! RT: no.

use super::accept::is_significant;
use super::criterion::{Context, compare, detection_threshold};
use super::evidence::{Comparison, Evidence};
use super::numbers::{CLEAR_LEAD, GREATER_PART, NEARLY_ALL};
use super::simplicity::{LIMITS_OF, penalty};
use crate::diagnose::library::candidate_fit::{CandidateFit, SelectedEffect};
use crate::diagnose::library::candidates::Candidate;
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::Difference;

/// How far ahead a rival must be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lead {
    /// Clearly: neither is fitted to the end.
    Clear,
    /// At all: both are, and which of the two the search met first says nothing.
    Any,
}

/// True if `rival` should stand in the place of `added`, whose gain is `kept`: ahead by `lead`, and by more than what it has more numbers
/// gain by chance.
#[must_use]
pub fn takes_its_place(
    found: &FittedModel,
    rival: &CandidateFit,
    added: &SelectedEffect,
    (kept, lead): (f64, Lead),
    context: &Context,
) -> bool {
    let lead = match lead {
        Lead::Clear => CLEAR_LEAD,
        Lead::Any => 0.0,
    };
    let richer = LIMITS_OF.contains(&(added.candidate.effect, rival.candidate.effect));
    let least = if richer { (1.0 - NEARLY_ALL) * kept } else { 0.0 };
    let gain = -compare(found, &rival.hypothesis, context).total;
    let own = penalty(&added.candidate, found, context);
    let price = (penalty(&rival.candidate, &rival.hypothesis, context) - own).max(0.0);
    let by_rule = gain > least.max(lead + price);
    let evidence = Evidence::over(found, &rival.hypothesis, gain, 0);
    context.ledger.note(Comparison {
        question: "exchange",
        effect: rival.candidate.effect.to_owned(),
        at: rival.candidate.at.clone(),
        against: Some(format!("{}@{}", added.candidate.effect, added.candidate.at)),
        gain,
        by_rule,
        failed: None,
        by_evidence: evidence.total() > 0.0,
        evidence,
    });
    by_rule
}

/// True if an effect earns its place in the company of the others. `gain`: over the model without it, fitted again.
#[must_use]
pub fn earns_its_place(candidate: &Candidate, gain: Difference, context: &Context) -> bool {
    let is_enough = gain.total >= detection_threshold(context, candidate.keys.len());
    is_enough && is_significant(candidate, gain)
}

/// True if a lead in twice the log-likelihood is clear.
#[must_use]
pub fn is_clear(ahead: f64) -> bool {
    ahead > CLEAR_LEAD
}

/// True if what an effect brought stays when it is taken out again: a fit that ended in a false minimum is improved by anything
/// that shakes it. Likelihoods before it, with it, and without it again.
#[must_use]
pub fn only_freed_the_fit(before: f64, with: f64, without: f64) -> bool {
    without - before > GREATER_PART * (with - before)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::evidence::Ledger;
    use crate::diagnose::judge::worked::{Shown, shown, trial};
    use crate::diagnose::library::candidates::Key;

    #[test]
    fn a_rival_with_more_numbers_pays_for_them() {
        let lag = |value: &str| format!("[[effect]]\neffect = \"actuator_lag\"\nat = \"u\"\ntime_constant = {value}\n");
        let Shown { context, problem } = shown(&lag("0.02"));
        let found = problem.fitted("[[effect]]\neffect = \"transport_delay\"\nat = \"u\"\ndelay = 0.02\n", 20);
        let mut rival = problem.trial("actuator_lag", "u", &lag("{ value = 0.015, min = 0.0, max = 0.2 }"), 20, 0.0);
        let added = problem.added("transport_delay", "u", 1000.0, Vec::new());
        let ahead = -compare(&found, &rival.hypothesis, &context).total;
        assert!(
            ahead > CLEAR_LEAD && takes_its_place(&found, &rival, &added, (1000.0, Lead::Clear), &context),
            "{ahead}"
        );
        let numbers = (ahead / libm::log(context.samples as f64)) as usize + 1;
        rival.candidate.keys = vec![Key { name: "x", min: 0.0, max: 1.0, log: false }; numbers];
        assert!(
            !takes_its_place(&found, &rival, &added, (1000.0, Lead::Clear), &context),
            "{numbers} numbers gain that by chance"
        );
    }

    #[test]
    fn of_two_that_are_not_told_apart_the_likelier_stands_in_the_end() {
        let lag = |value: &str| format!("[[effect]]\neffect = \"actuator_lag\"\nat = \"u\"\ntime_constant = {value}\n");
        let Shown { context, problem } = shown(&lag("0.02"));
        let best = problem.fitted(&lag("{ value = 0.015, min = 0.0, max = 0.2 }"), 20).rig.effects[1].values[0].value;
        let of = |value: f64| problem.trial("actuator_lag", "u", &lag(&value.to_string()), 5, 1000.0);
        let (worse, better) = (of(best - 7e-5), of(best));
        let added = problem.added("actuator_lag", "u", 1000.0, Vec::new());
        let ahead = -compare(&worse.hypothesis, &better.hypothesis, &context).total;
        assert!(ahead > 0.0 && ahead < CLEAR_LEAD, "{ahead}");
        assert!(!takes_its_place(&worse.hypothesis, &better, &added, (1000.0, Lead::Clear), &context));
        assert!(takes_its_place(&worse.hypothesis, &better, &added, (1000.0, Lead::Any), &context));
        assert!(!takes_its_place(&better.hypothesis, &worse, &added, (1000.0, Lead::Any), &context));
    }

    #[test]
    fn an_effect_whose_gain_stays_without_it_brought_none_of_its_own() {
        assert!(only_freed_the_fit(0.0, 100.0, 60.0) && !only_freed_the_fit(0.0, 100.0, 40.0));
    }

    #[test]
    fn an_effect_stays_that_gains_enough_in_every_part_of_the_recordings() {
        let context = Context {
            floors: vec![1e-3],
            samples: 1000,
            given: 0,
            is_trapped: false,
            seed: 1,
            ledger: Ledger::default(),
            held_out: None,
        };
        let lag = trial("actuator_lag", 1, 0.0).candidate;
        let gain = |total: f64, low: f64| Difference { total, low, high: 2.0 * total, std: 1.0 };
        assert!(earns_its_place(&lag, gain(100.0, 10.0), &context));
        assert!(!earns_its_place(&lag, gain(60.0, 10.0), &context), "too little");
        assert!(!earns_its_place(&lag, gain(100.0, -1.0), &context), "in one place alone");
        let push = Candidate { only: Some("a.csv".into()), ..lag };
        assert!(earns_its_place(&push, gain(100.0, -1.0), &context), "an event is in one place");
    }
}
