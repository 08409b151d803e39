//! What was fitted and is not the answer.
//!
//! RT: no.

use super::criterion::{Context, detection_threshold};
use crate::diagnose::library::candidate_fit::{CandidateFit, SelectedEffect};
use crate::diagnose::library::candidates::Candidate;
use crate::report::findings::{Missing, Rejected};

/// Each effect of which that is so, with the number that says so.
#[must_use]
pub fn rejected(
    missing: &[Missing],
    added: &[SelectedEffect],
    last: &[CandidateFit],
    context: &Context,
) -> Vec<Rejected> {
    let mut out: Vec<Rejected> = Vec::new();
    let mut push = |trial: &CandidateFit, why: String| {
        let named = missing.iter().flat_map(|m| &m.one_of);
        let taken = named.into_iter().any(|m| m.effect == trial.candidate.effect && m.at == trial.candidate.at);
        let listed = out.iter().any(|r| r.effect == trial.candidate.effect && r.at == trial.candidate.at);
        if !taken && !listed {
            out.push(Rejected { effect: trial.candidate.effect.into(), at: trial.candidate.at.clone(), why });
        }
    };
    for a in added {
        for trial in a.others.iter().take(8) {
            push(trial, in_its_place(a.candidate.effect, trial.gain - a.gain));
        }
    }
    for trial in last.iter().take(8) {
        let least = detection_threshold(context, trial.candidate.keys.len());
        let Candidate { effect, at, .. } = &trial.candidate;
        push(trial, of_last_round(trial.gain, least, context.ledger.failed(effect, at)));
    }
    out
}

/// Why what gains `gain` on top of the answer is no part of it. `least`: what counts; `failed`: the test that it did not stand.
fn of_last_round(gain: f64, least: f64, failed: Option<&str>) -> String {
    let gains = format!("gains {:.0} in twice the log-likelihood", gain.max(0.0));
    if gain > least {
        format!("{gains}, but {}", failed.unwrap_or(NOT_ASKED))
    } else {
        format!("{gains}; {least:.0} is the least that counts")
    }
}

/// Of what gained enough and was never tested.
const NOT_ASKED: &str = "it was not tested further: it bends to anything, is far behind the best, or the work ended";

/// Why what was fitted in the place of `named`, and is `ahead` of it in twice the log-likelihood, is not the answer.
fn in_its_place(named: &str, ahead: f64) -> String {
    let (far, which, so) =
        if ahead > 0.0 { (ahead, "ahead", ": too little to take its place") } else { (-ahead, "behind", "") };
    format!("fitted in place of {named} it is {far:.0} {which} in twice the log-likelihood{so}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_gains_enough_names_the_test_that_it_did_not_stand() {
        assert_eq!(
            of_last_round(500.0, 76.0, Some("it is late")),
            "gains 500 in twice the log-likelihood, but it is late"
        );
        assert!(of_last_round(18.0, 76.0, None).ends_with("; 76 is the least that counts"));
    }

    #[test]
    fn a_rival_that_is_ahead_by_too_little_is_not_told_as_behind() {
        assert!(
            in_its_place("torque_offset", 1311.0).contains("1311 ahead")
                && in_its_place("drag", -20.0).contains(" 20 behind")
        );
    }
}
