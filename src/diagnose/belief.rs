//! Which candidate is believed: worth enough, no piece of a smooth misfit, and true where it was not fitted.
//!
//! RT: no.

use crate::diagnose::candidates::Candidate;
use crate::diagnose::folds::LeftOut;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::likelihood::is_misfit;
use crate::diagnose::tried::{Context, Trial, at_zero, compare, worth};
use crate::diagnose::unlisted::is_patch;
use crate::model::effect::EffectKind;
use crate::model::rig::{Sensor, Value};
use std::cell::OnceCell;

/// Least gain of a further effect, in parts of what those before it gained.
const SHARE: f64 = 0.04;

/// The same where smooth misfit stays: no form fits hardware to the noise. Tuned on a pendulum with gears, where a ripple
/// (.14) and a play (.06) came after the Coulomb friction that explains it.
const SHARE_OF_MISFIT: f64 = 0.15;

/// True if `trial` explains enough to be believed.
#[must_use]
pub fn is_worth(base: &Hypothesis, trial: &Trial, explained_before: f64, context: &Context) -> bool {
    let sure = compare(&trial.hypothesis, base, context);
    // A second effect must not live off the first one's imperfect form.
    let misfit = is_misfit(&trial.hypothesis.residuals, &context.floors);
    let share = trial.gain >= if misfit { SHARE_OF_MISFIT } else { SHARE } * explained_before;
    // Against smooth misfit chance has no measure: a tenth of the squares is the least that a user would notice.
    let noticed = !misfit || trial.gain > 0.1 * context.samples as f64;
    let admitted = noticed && !is_piece(base, trial, context);
    trial.gain > worth(context, trial.candidate.keys.len())
        && sure.low > 0.0
        && share
        && admitted
        && !at_zero(trial)
        && !is_cut_off(trial)
}

/// A resonance at the edge of the range in which it was sought was not found: it stands for a slower or faster motion
/// that is no resonance, and one without damping for a vibration from elsewhere (the design's "no bound hit").
fn is_cut_off(trial: &Trial) -> bool {
    let Some(effect) = trial.hypothesis.rig.effects.last() else { return false };
    let hits = |value: &Value| {
        let at = |bound: f64| (value.value / bound - 1.0).abs() < AT_EDGE;
        value.bounds.is_some_and(|b| at(b.min) || at(b.max))
    };
    effect.get("frequency").is_some_and(|f| hits(&f) || effect.get("damping").is_some_and(|d| hits(&d)))
}

/// Nearer to its bound than this part a number hits it.
const AT_EDGE: f64 = 0.01;

/// True for a push, a jump or a few waves of a ripple where more than noise stays: they fit a piece of any smooth misfit.
#[must_use]
pub fn is_piece(base: &Hypothesis, trial: &Trial, context: &Context) -> bool {
    let misfit = is_misfit(&trial.hypothesis.residuals, &context.floors);
    periods(base, trial) < if misfit { PERIODS } else { 0.5 * PERIODS } || misfit && is_patched(base, &trial.candidate)
}

/// Fewer periods than this within the travel are no ripple that anyone could tell from another law of position.
const PERIODS: f64 = 3.0;

/// Periods of a trial's ripple within the travel; infinite for other effects.
fn periods(base: &Hypothesis, trial: &Trial) -> f64 {
    let ripple = trial.hypothesis.rig.effects.last().filter(|e| e.kind == EffectKind::TorqueRipple);
    let Some(order) = ripple.and_then(|e| e.get("order")) else { return f64::INFINITY };
    let joint = base.rig.mechanism.coordinate_index(&trial.candidate.at);
    let travel = |(c, sensor): (usize, &Sensor)| {
        let all = base.problem.recordings.iter().flat_map(|r| &r.measured[c]).filter(|x| x.is_finite());
        let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
        if Some(sensor.joint) == joint && !sensor.is_rate { high - low } else { 0.0 }
    };
    let range = base.rig.sensors.iter().enumerate().map(travel).fold(0.0, f64::max);
    // No sensor on this coordinate alone: nothing is known of its travel.
    if range > 0.0 { order.value * range / (2.0 * std::f64::consts::PI) } else { f64::INFINITY }
}

/// True if `candidate` fits a piece of anything on this machine.
#[must_use]
pub fn is_patched(now: &Hypothesis, candidate: &Candidate) -> bool {
    EffectKind::from_id(candidate.effect).is_some_and(|kind| is_patch(&now.rig, kind))
}

/// True if `trial` is worth it and holds on recordings that it was not fitted to. `left_out`: of `now`, made when needed.
pub fn believed(
    now: &Hypothesis,
    left_out: &OnceCell<Option<LeftOut>>,
    trial: &Trial,
    explained: f64,
    context: &Context,
    said: &mut impl FnMut(&str),
) -> bool {
    if !is_worth(now, trial, explained, context) {
        return false;
    }
    let left_out = left_out.get_or_init(|| LeftOut::of(now, &context.floors)).as_ref();
    let Some(kept) = left_out.and_then(|l| l.kept_by(&trial.hypothesis, &context.floors)) else { return true };
    said(&format!("   {} keeps {:.2} of its gain on recordings left out", trial.candidate.effect, kept));
    kept >= LEAST_KEPT || trial.candidate.only.is_some()
}

/// Smallest part of its gain that an effect must keep on recordings that it was not fitted to.
const LEAST_KEPT: f64 = 0.25;

/// An effect that is the limit of another: the other, with one number more, must gain clearly more to be believed.
pub const LIMITS_OF: &[(&str, &str)] =
    &[("torque_offset", "parallel_spring"), ("coulomb_friction", "stribeck_friction")];

/// Part of the richer effect's gain that is enough for the simpler one.
pub const ENOUGH: f64 = 0.95;

/// Where a simpler limit of the leader gains nearly as much, the leader goes: what is left may still be added.
pub fn simplest_first(trials: &mut Vec<Trial>) {
    let Some(leader) = trials.first() else { return };
    let simple = LIMITS_OF.iter().filter(|(_, rich)| *rich == leader.candidate.effect).find_map(|(simple, _)| {
        let close = |t: &Trial| {
            t.candidate.effect == *simple && t.candidate.at == leader.candidate.at && t.gain >= ENOUGH * leader.gain
        };
        trials.iter().position(close)
    });
    if let Some(i) = simple {
        let simple = trials.remove(i);
        trials[0] = simple;
    }
}
