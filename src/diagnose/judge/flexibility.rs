//! Effects that fit a piece of anything: what they gain beside smooth misfit says nothing.
//!
//! RT: no.

use super::criterion::Context;
use super::numbers::GREATER_PART;
use crate::diagnose::library::candidate_fit::CandidateFit;
use crate::diagnose::library::candidates::Candidate;
use crate::diagnose::robustness::held_out::Confirmation;
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::is_misfit;
use crate::model::effect::EffectKind;
use crate::model::rig::{MechanismKind, Rig, Sensor};

/// True for effects that fit a piece of anything: single events, and a ripple of any wavelength on a rail.
#[must_use]
pub fn is_local_term(rig: &Rig, kind: EffectKind) -> bool {
    match kind {
        EffectKind::ExternalPush | EffectKind::LostCounts => true,
        EffectKind::TorqueRipple => rig.mechanism == MechanismKind::Slider,
        _ => false,
    }
}

/// True for less than half a wave of a ripple, and for what is local where more than noise stays: they fit a piece of any smooth
/// misfit. What lasts is believed even so if recordings kept back bear it out.
#[must_use]
pub fn is_overly_flexible(base: &FittedModel, trial: &CandidateFit, context: &Context) -> bool {
    let in_misfit = || is_misfit(&trial.hypothesis.residuals, &context.floors);
    periods(base, trial) < GREATER_PART
        || is_local_here(base, &trial.candidate) && in_misfit() && !is_borne_out(base, trial, context)
}

/// True if recordings kept back speak for what `trial` adds to `base`; of an event they say nothing.
fn is_borne_out(base: &FittedModel, trial: &CandidateFit, context: &Context) -> bool {
    let told = || Confirmation::on_kept_back(&trial.hypothesis, base, context.held_out.as_deref(), &context.floors);
    trial.candidate.only.is_none() && told().is_some_and(|told| told.bears_out(context))
}

/// Periods of a trial's ripple within the travel; infinite for other effects.
fn periods(base: &FittedModel, trial: &CandidateFit) -> f64 {
    waves(base, trial).unwrap_or(f64::INFINITY)
}

/// Periods of a trial's ripple within the travel; none for other effects, or where no sensor tells the travel.
fn waves(base: &FittedModel, trial: &CandidateFit) -> Option<f64> {
    let ripple = trial.hypothesis.rig.effects.last().filter(|e| e.kind == EffectKind::TorqueRipple)?;
    let joint = base.rig.mechanism.coordinate_index(&trial.candidate.at);
    let travel = |(c, sensor): (usize, &Sensor)| {
        let all = base.problem.recordings.iter().flat_map(|r| &r.measured[c]).filter(|x| x.is_finite());
        let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
        if Some(sensor.joint) == joint && !sensor.is_rate { high - low } else { 0.0 }
    };
    let range = base.rig.sensors.iter().enumerate().map(travel).fold(0.0, f64::max);
    (range > 0.0).then_some(ripple.get("order")?.value * range / (2.0 * std::f64::consts::PI))
}

/// True if `candidate` fits a piece of anything on this machine.
#[must_use]
pub fn is_local_here(now: &FittedModel, candidate: &Candidate) -> bool {
    EffectKind::from_id(candidate.effect).is_some_and(|kind| is_local_term(&now.rig, kind))
}

/// True for a ripple in smooth misfit whose order the data do not tell: another order at the same joint explains nearly as
/// much, more than two waves over the travel resemble each other.
#[must_use]
pub fn has_unresolved_order(
    base: &FittedModel,
    trial: &CandidateFit,
    others: &[CandidateFit],
    context: &Context,
) -> bool {
    let Some(mine) = waves(base, trial).filter(|_| is_misfit(&trial.hypothesis.residuals, &context.floors)) else {
        return false;
    };
    let rival = |other: &CandidateFit| {
        let of_other = if other.candidate.at == trial.candidate.at { waves(base, other) } else { None };
        of_other.is_some_and(|w| {
            (w - mine).abs() > 0.0 && other.gain > GREATER_PART * (1.0 + resemblance(w - mine)) * trial.gain
        })
    };
    others.iter().any(rival)
}

/// Part of a wave's energy that another can take over which differs by so many periods within the travel.
fn resemblance(periods: f64) -> f64 {
    let x = std::f64::consts::PI * periods;
    if x == 0.0 { 1.0 } else { (libm::sin(x) / x).powi(2) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waves_that_differ_by_a_period_have_nothing_in_common() {
        assert!(resemblance(1.0) < 1e-12 && (resemblance(0.0) - 1.0).abs() < 1e-12);
        assert!((0.3..0.5).contains(&resemblance(0.5)), "{}", resemblance(0.5));
    }
}
