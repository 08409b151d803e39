//! The contest of effects that were added: each is exchanged for its close rivals in the company of the others; after the
//! selection it is left out as well.
//!
//! RT: no.

use crate::diagnose::judge::accept::is_admissible;
use crate::diagnose::judge::continuity::has_continuous_states;
use crate::diagnose::judge::criterion::{Context, compare};
use crate::diagnose::judge::exchange::{Lead, earns_its_place, takes_its_place};
use crate::diagnose::judge::flexibility::is_overly_flexible;
use crate::diagnose::library::candidate_fit::{CandidateFit, REFIT, SelectedEffect};
use crate::diagnose::library::limited_fit::refit_without;
use crate::diagnose::search::budget::{allowance, is_spent, within};
use crate::identify::fitted_model::FittedModel;
use crate::model::rig::{Effect, Rig};
use rayon::prelude::*;

/// Swap and backward: every effect of `found` is exchanged for its close rivals in the company of the others, and
/// left out; what is better stays.
#[must_use]
pub fn exchange_and_eliminate(
    found: FittedModel,
    mut added: Vec<SelectedEffect>,
    context: &Context,
) -> (FittedModel, Vec<SelectedEffect>) {
    let first = context.given;
    let mut found = found;
    if added.len() < 2 {
        return (found, added);
    }
    let mut i = 0;
    while i < added.len() && !is_spent(&found) {
        let Some(without) = refit_without(&found, first + i, &context.floors) else { break };
        let kept = compare(&found, &without, context);
        if !earns_its_place(&added[i].candidate, kept, context) {
            found = without;
            added.remove(i);
            continue;
        }
        added[i].gain = kept.total;
        let rivals = fit_rivals(&found, &added[i], first + i, context, CLOSE_RIVAL * leading(&added[i]));
        if let Some(better) =
            rivals.first().filter(|r| takes_its_place(&found, r, &added[i], (kept.total, Lead::Clear), context))
        {
            let old = CandidateFit { candidate: added[i].candidate.clone(), hypothesis: found, gain: kept.total };
            (found, added[i].candidate) = (better.hypothesis.clone(), better.candidate.clone());
            added[i].others = [vec![old], rivals[1..].to_vec()].concat();
        } else {
            added[i].others = rivals;
        }
        i += 1;
    }
    (found, added)
}

/// `rig` with the effect of `trial` in the place of effect `e`.
pub(in crate::diagnose) fn in_its_place(rig: &Rig, trial: &CandidateFit, e: usize) -> Option<Rig> {
    let mut rig = rig.clone();
    let is_its = |effect: &&Effect| effect.kind.id() == trial.candidate.effect && effect.at == trial.candidate.at;
    *rig.effects.get_mut(e)? = trial.hypothesis.rig.effects.iter().rev().find(is_its)?.clone();
    if trial.candidate.motor_sensor.is_some() {
        rig.sensors.clone_from(&trial.hypothesis.rig.sensors);
    }
    Some(rig)
}

/// Part of the best rival's gain from which a rival is close.
const CLOSE_RIVAL: f64 = 0.4;

/// Part of an effect's own gain from which a rival is so near that company may turn the order round.
pub(super) const NEAR: f64 = 0.75;

/// Gain of the best rival.
fn leading(added: &SelectedEffect) -> f64 {
    added.others.first().map_or(0.0, |other| other.gain)
}

/// Swap alone, with the near rivals of each effect before the last: one that was chosen while another was missing may
/// have been the wrong one of two, and a third effect would be called to make up for it.
#[must_use]
pub fn exchange_near_rivals(
    mut found: FittedModel,
    added: &mut [SelectedEffect],
    context: &Context,
    said: &mut dyn FnMut(&str),
) -> FittedModel {
    let first = context.given;
    for i in 0..added.len().saturating_sub(1) {
        let own = added[i].gain;
        let rivals = fit_rivals(&found, &added[i], first + i, context, NEAR * own);
        let Some(better) =
            rivals.into_iter().next().filter(|r| takes_its_place(&found, r, &added[i], (own, Lead::Clear), context))
        else {
            continue;
        };
        let (before, after) = (&added[i].candidate, &better.candidate);
        said(&format!("   {}@{} in the place of {}@{}", after.effect, after.at, before.effect, before.at));
        let old = CandidateFit { candidate: before.clone(), hypothesis: found, gain: own };
        added[i].others.retain(|t| t.candidate != better.candidate);
        added[i].others.insert(0, old);
        (found, added[i].candidate) = (better.hypothesis, better.candidate);
    }
    found
}

/// The rivals of effect `e` that gained more than `least`, fitted in its place, as far as they are believable; best first,
/// gains relative to leaving it out.
fn fit_rivals(
    found: &FittedModel,
    added: &SelectedEffect,
    e: usize,
    context: &Context,
    least: f64,
) -> Vec<CandidateFit> {
    let admitted = added.others.iter().filter(|t| !is_overly_flexible(found, t, context));
    let close: Vec<&CandidateFit> = admitted.filter(|t| t.gain > least).take(4).collect();
    let most = allowance(found);
    let one = |trial: &&CandidateFit| {
        let (problem, point) = found.extended(in_its_place(&found.rig, trial, e)?);
        let hypothesis = within(most, found, problem, point, (&found.noise, REFIT), context)?;
        let behind = compare(found, &hypothesis, context).total;
        Some(CandidateFit { candidate: trial.candidate.clone(), hypothesis, gain: added.gain - behind })
    };
    let mut out: Vec<CandidateFit> = close.par_iter().filter_map(one).collect();
    out.retain(|trial| is_admissible(&trial.hypothesis, e, context));
    if out.iter().any(|trial| trial.candidate.has_inner_states()) {
        let without = refit_without(found, e, &context.floors);
        let goes_on = |t: &CandidateFit| {
            without.as_ref().is_none_or(|w| has_continuous_states(w, &t.hypothesis, &context.floors))
        };
        out.retain(goes_on);
    }
    out.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    out
}
