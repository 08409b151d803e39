//! From the candidates that were fitted to the sets that are answered: what this data cannot tell apart stands together.
//!
//! RT: no.

use crate::diagnose::explain::tables::step_s;
use crate::diagnose::judge::credible_set::weight_in_set;
use crate::diagnose::judge::criterion::Context;
use crate::diagnose::judge::estimates::estimates;
use crate::diagnose::judge::verdict::{Estimate, Member, Missing};
use crate::diagnose::library::candidate_fit::{CandidateFit, SelectedEffect};
use crate::diagnose::sentence;
use crate::identify::fitted_model::FittedModel;
use crate::model::resonance::resonance_hz;
use crate::model::rig::{Rig, Scope, Slot};
use std::collections::BTreeMap;

/// Most members of a set: more are no answer.
const MOST_MEMBERS: usize = 4;

/// The entries of `missing` for what was added to `base`.
#[must_use]
pub fn answer_sets(explained: &FittedModel, added: &[SelectedEffect], context: &Context) -> Vec<Missing> {
    let first = explained.rig.effects.len() - added.len();
    let entry = |(i, a): (usize, &SelectedEffect)| {
        let mut members = vec![member(explained, first + i)];
        let rivals: Vec<(Member, f64)> =
            a.others.iter().filter_map(|t| rival(explained, t, (first + i, a.gain), context)).collect();
        members.extend(twins(&members[0]));
        for (m, weight) in rivals.into_iter().take(MOST_MEMBERS - 1) {
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
pub(in crate::diagnose) fn member(of: &FittedModel, e: usize) -> Member {
    let effect = &of.rig.effects[e];
    let known = estimates(of);
    let mut parameters = BTreeMap::new();
    for (k, key) in effect.kind.keys().iter().enumerate() {
        let slot = Slot::Effect(Scope::Rig, e, k);
        let fitted = of.problem.theta.index_of_slot(slot).map(|i| known[i].1);
        let value = effect.values[k].value;
        // What was not fitted was found between two rows.
        let between = if key.unit == "s" { 0.5 * step_s(of) } else { 0.0 };
        let (low, high, unit) = (value - between, value + between, of.rig.effect_unit(effect.kind, &effect.at, k));
        let found = Estimate { value, std: between / libm::sqrt(3.0), low, high, unit };
        let mut estimate = fitted.unwrap_or(found);
        if key.name == "phase" {
            let turned = wrapped(estimate.value) - estimate.value;
            estimate.value += turned;
            (estimate.low, estimate.high) = (estimate.low + turned, estimate.high + turned);
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
fn rival(
    winner: &FittedModel,
    trial: &CandidateFit,
    (place, gain): (usize, f64),
    context: &Context,
) -> Option<(Member, f64)> {
    let weight = weight_in_set(winner, trial, (place, gain), context)?;
    Some((member(&trial.hypothesis.clone().with_intervals(), place), weight))
}

/// Exact twins of a member by its equations, which no motion tells apart.
fn twins(of: &Member) -> Vec<Member> {
    let turned = |effect: &str, key: &str, from: &str| {
        let estimate = of.parameters.get(from).map(|e| e.negated());
        let parameters = estimate.into_iter().map(|e| (key.to_owned(), e)).collect();
        Member { effect: effect.into(), at: of.at.clone(), weight: 1.0, parameters }
    };
    match of.effect.as_str() {
        "torque_offset" => vec![turned("friction_asymmetry", "difference", "torque")],
        "friction_asymmetry" => vec![turned("torque_offset", "torque", "difference")],
        _ => Vec::new(),
    }
}
