//! Of two models that explain as much, the simpler one.
//!
//! RT: no.

use super::criterion::{Context, detection_threshold};
use super::numbers::NEARLY_ALL;
use crate::diagnose::library::candidate_fit::CandidateFit;
use crate::diagnose::library::candidates::Candidate;
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::is_misfit;

/// An effect that is the limit of another: the other, with one number more, must gain clearly more to be is_accepted.
pub const LIMITS_OF: &[(&str, &str)] = &[
    ("torque_offset", "parallel_spring"),
    ("coulomb_friction", "stribeck_friction"),
    // Over less than a turn.
    ("sensor_bias", "encoder_eccentricity"),
];

/// Where a simpler limit of the leader gains nearly as much, the leader goes after it: what is left may still be added. Then the first
/// is who gains most for the numbers that it adds (Schwarz 1978; an initial state of a window brings 1 by chance).
pub fn order_by_penalised_gain(trials: &mut Vec<CandidateFit>, context: &Context) {
    let Some(leader) = trials.first() else { return };
    let simple = LIMITS_OF.iter().filter(|(_, rich)| *rich == leader.candidate.effect).find_map(|(simple, _)| {
        let close = |t: &CandidateFit| {
            let is_limit = t.candidate.effect == *simple && t.candidate.at == leader.candidate.at;
            is_limit && t.gain >= nearly_all(leader.gain, &leader.hypothesis, context)
        };
        trials.iter().position(close)
    });
    let rich = simple.map(|i| {
        let simple = trials.remove(i);
        std::mem::replace(&mut trials[0], simple)
    });
    let net = |t: &CandidateFit| t.gain - penalty(&t.candidate, &t.hypothesis, context);
    let best = trials.iter().enumerate().max_by(|a, b| net(a.1).total_cmp(&net(b.1))).map_or(0, |(i, _)| i);
    trials[..=best].rotate_right(1);
    // Next to it, for the contest among the best few.
    if let Some(rich) = rich {
        trials.insert(1, rich);
    }
}

/// Gain from which a simpler model stands for one that gains `gain` and leaves `richer`. Where that leaves nothing but noise, what it is
/// ahead counts as anything else does.
fn nearly_all(gain: f64, richer: &FittedModel, context: &Context) -> f64 {
    let most =
        if is_misfit(&richer.residuals, &context.floors) { f64::INFINITY } else { detection_threshold(context, 1) };
    (NEARLY_ALL * gain).max(gain - most)
}

/// True if `one` effect stands for several of `found`, which gain `gain` together.
#[must_use]
pub fn stands_for_several(found: &FittedModel, one: &CandidateFit, gain: f64, context: &Context) -> bool {
    one.gain >= nearly_all(gain, found, context)
}

/// What the numbers of `candidate` and the initial states of `fit` gain by chance, in twice the log-likelihood (Schwarz 1978).
#[must_use]
pub fn penalty(candidate: &Candidate, fit: &FittedModel, context: &Context) -> f64 {
    let numbers = candidate.keys.iter().filter(|k| k.max > k.min).count() as f64;
    let states = fit.point.states.iter().map(Vec::len).sum::<usize>() as f64;
    numbers * libm::log(context.samples.max(2) as f64) + states
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::evidence::Ledger;
    use crate::diagnose::judge::worked::trial;

    fn order(mut trials: Vec<CandidateFit>) -> Vec<&'static str> {
        let context = Context {
            floors: vec![1e-3],
            samples: 1000,
            given: 0,
            is_trapped: false,
            seed: 1,
            ledger: Ledger::default(),
            held_out: None,
        };
        order_by_penalised_gain(&mut trials, &context);
        trials.iter().map(|t| t.candidate.effect).collect()
    }

    #[test]
    fn who_needs_fewer_numbers_stands_first_where_more_bring_no_more() {
        // ln 1000 = 6.9 for a number.
        let close = vec![trial("joint_elasticity", 3, 512.0), trial("actuator_lag", 1, 500.0)];
        assert_eq!(order(close), ["actuator_lag", "joint_elasticity"]);
        let far = vec![trial("joint_elasticity", 3, 515.0), trial("actuator_lag", 1, 500.0)];
        assert_eq!(order(far), ["joint_elasticity", "actuator_lag"]);
    }

    #[test]
    fn a_limit_of_the_leader_goes_first_with_most_of_its_gain() {
        let most = vec![trial("parallel_spring", 2, 1000.0), trial("torque_offset", 1, 960.0)];
        assert_eq!(order(most)[0], "torque_offset");
        let less = vec![trial("parallel_spring", 2, 1000.0), trial("torque_offset", 1, 940.0)];
        assert_eq!(order(less)[0], "parallel_spring");
    }
}
