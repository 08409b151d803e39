//! From the candidates that were fitted to the sets that are answered: what this data cannot tell apart stands together.
//!
//! RT: no.

use crate::diagnose::belief::{LIMITS_OF, is_cut_off};
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::likelihood::{Difference, is_misfit};
use crate::diagnose::sentence;
use crate::diagnose::tables::estimates;
use crate::diagnose::tried::{Added, Context, Trial, compare, worth};
use crate::diagnose::verdict::{Estimate, Member, Missing, Rejected};
use crate::model::resonance::resonance_hz;
use crate::model::rig::{Effect, Rig, Scope, Slot};
use std::collections::BTreeMap;

/// Candidates that are behind by less than this many standard deviations of the difference (Vuong's test on blocks)
/// cannot be told apart.
const APART: f64 = 2.0;

/// A model form is never exact: an alternative within this part of the winner's gain is no worse than the forms are.
const FORM: f64 = 0.012;

/// Most of that, in twice the log-likelihood: where the winner leaves nothing but noise its form is exact, and one that is
/// five standard deviations behind (25, and some rounding) is not.
const SEEN: f64 = 30.0;

/// The same where the winner leaves more than noise: then its own form is seen to be inexact.
const FORM_OF_MISFIT: f64 = 0.1;

/// A number more brings less than this by chance, in twice the log-likelihood: past it, what the answer is the limit of (an
/// offset of a spring) stands beside the answer, though it does not gain what would be worth naming it alone.
const BY_CHANCE: f64 = 12.0;

/// Most members of a set.
const MEMBERS: usize = 4;

/// The entries of `missing` for what was added to `base`.
#[must_use]
pub fn answered(explained: &Hypothesis, added: &[Added], context: &Context) -> Vec<Missing> {
    let first = explained.rig.effects.len() - added.len();
    let entry = |(i, a): (usize, &Added)| {
        let mut members = vec![member(explained, first + i)];
        let rivals: Vec<(Member, f64)> =
            a.others.iter().filter_map(|t| rival(explained, t, (first + i, a.gain), context)).collect();
        members.extend(twins(&members[0]));
        for (m, weight) in rivals.into_iter().take(MEMBERS - 1) {
            if !members.iter().any(|x| x.effect == m.effect && x.at == m.at) {
                members.push(Member { weight, ..m });
            }
        }
        let total: f64 = members.iter().map(|m| m.weight).sum();
        for m in &mut members {
            m.weight /= total;
        }
        members.sort_by(|a, b| b.weight.total_cmp(&a.weight));
        let sentence = sentence::entry(&members, a.removed) + &ringing(&explained.rig, first + i);
        Missing { one_of: members, sentence }
    };
    added.iter().enumerate().map(entry).collect()
}

/// At which frequency the machine rings, if effect number `e` makes it ring.
fn ringing(rig: &Rig, e: usize) -> String {
    resonance_hz(rig, &rig.effects[e]).map_or_else(String::new, sentence::resonance)
}

/// Number `e` of the rig's effects as a member of full weight.
fn member(of: &Hypothesis, e: usize) -> Member {
    let effect = &of.rig.effects[e];
    let known = estimates(of);
    let mut parameters = BTreeMap::new();
    for (k, key) in effect.kind.keys().iter().enumerate() {
        let slot = Slot::Effect(Scope::Rig, e, k);
        let fitted = of.problem.theta.index_of_slot(slot).map(|i| known[i].1);
        let value = effect.values[k].value;
        let mut estimate = fitted.unwrap_or(Estimate { value, std: 0.0 });
        if key.name == "phase" {
            estimate.value = wrapped(estimate.value);
        }
        parameters.insert(key.name.to_owned(), estimate);
    }
    Member { effect: effect.kind.id().to_owned(), at: effect.at.clone(), weight: 1.0, parameters }
}

fn wrapped(phase: f64) -> f64 {
    let turn = 2.0 * std::f64::consts::PI;
    phase - turn * libm::round(phase / turn)
}

/// A trial that the data cannot tell from the winner, with its weight against it.
fn rival(winner: &Hypothesis, trial: &Trial, (place, gain): (usize, f64), context: &Context) -> Option<(Member, f64)> {
    let d = compare(winner, &trial.hypothesis, context);
    let form =
        if is_misfit(&winner.residuals, &context.floors) { FORM_OF_MISFIT * gain } else { (FORM * gain).min(SEEN) };
    // Single events are in one block, all of them or none: samples of blocks say nothing of what is between them.
    let events = [winner, &trial.hypothesis].iter().all(|h| h.rig.effects.get(place).is_some_and(is_event));
    let chance = if events && !is_misfit(&winner.residuals, &context.floors) { SEEN } else { APART * d.std };
    let inseparable = d.total < chance || d.total < form;
    // A trial of an earlier round has fewer effects than the winner: it says nothing in this company.
    // One number more and no better: the simpler one says the same.
    let mine = winner.rig.effects[place].kind;
    let exact = !is_misfit(&winner.residuals, &context.floors);
    let more_of_it = exact && LIMITS_OF.contains(&(mine.id(), trial.candidate.effect)) && d.total < -BY_CHANCE;
    let simple = trial.candidate.keys.len() <= mine.keys().len() || more_of_it;
    let comparable = simple && trial.hypothesis.rig.effects.len() == winner.rig.effects.len();
    // A memory as long as its range allows stands for the start of each window, in the winner's place as in its own.
    let cut_off = trial.candidate.has_inner_states() && trial.hypothesis.rig.effects.get(place).is_some_and(is_cut_off);
    (inseparable && comparable && !cut_off && trial.gain > 0.5 * gain)
        .then(|| (member(&trial.hypothesis.clone().with_intervals(), place), weight(d, gain)))
}

/// True for an effect that acts in one recording alone: a push, a jump.
fn is_event(effect: &Effect) -> bool {
    !effect.recordings.is_empty()
}

/// Weight of a rival against 1 of the winner: how often it would win if the blocks were drawn again.
fn weight(d: Difference, gain: f64) -> f64 {
    let scale = d.std.max(FORM * gain).max(1.0);
    libm::exp(-d.total.max(0.0) / scale).clamp(0.02, 1.0)
}

/// Exact twins of a member by its equations, which no motion tells apart.
fn twins(of: &Member) -> Vec<Member> {
    let turned = |effect: &str, key: &str, from: &str| {
        let estimate = of.parameters.get(from).map(|e| Estimate { value: -e.value, std: e.std });
        let parameters = estimate.into_iter().map(|e| (key.to_owned(), e)).collect();
        Member { effect: effect.into(), at: of.at.clone(), weight: 0.8, parameters }
    };
    match of.effect.as_str() {
        "torque_offset" => vec![turned("friction_asymmetry", "difference", "torque")],
        "friction_asymmetry" => vec![turned("torque_offset", "torque", "difference")],
        _ => Vec::new(),
    }
}

/// What was fitted and is not the answer, with the number that says so.
#[must_use]
pub fn rejected(missing: &[Missing], added: &[Added], last: &[Trial], context: &Context) -> Vec<Rejected> {
    let mut out: Vec<Rejected> = Vec::new();
    let mut push = |trial: &Trial, why: String| {
        let named = missing.iter().flat_map(|m| &m.one_of);
        let taken = named.into_iter().any(|m| m.effect == trial.candidate.effect && m.at == trial.candidate.at);
        let listed = out.iter().any(|r| r.effect == trial.candidate.effect && r.at == trial.candidate.at);
        if !taken && !listed {
            out.push(Rejected { effect: trial.candidate.effect.into(), at: trial.candidate.at.clone(), why });
        }
    };
    for a in added {
        for trial in a.others.iter().take(8) {
            let behind = a.gain - trial.gain;
            push(
                trial,
                format!(
                    "fitted in place of {} it is {behind:.0} behind in twice the log-likelihood",
                    a.candidate.effect
                ),
            );
        }
    }
    for trial in last.iter().take(8) {
        let least = worth(context, trial.candidate.keys.len());
        push(
            trial,
            format!(
                "gains {:.0} in twice the log-likelihood; {least:.0} is the least that counts",
                trial.gain.max(0.0)
            ),
        );
    }
    out
}
