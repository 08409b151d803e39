//! Candidates that were fitted, effects that were added, and how a rig has one more or one less.
//!
//! RT: no.

use crate::diagnose::library::candidates::Candidate;
use crate::identify::fit::Limits;
use crate::identify::fitted_model::FittedModel;
use crate::model::effect::EffectKind;
use crate::model::rig::{Effect, Rig, Side, Value};

/// A candidate, fitted.
#[derive(Clone, Debug)]
pub struct CandidateFit {
    /// What was added.
    pub candidate: Candidate,
    /// Where that led.
    pub hypothesis: FittedModel,
    /// Gain of twice the log-likelihood over what it was added to, under the noise that the best of its round leaves.
    pub gain: f64,
}

/// An effect that was added, with the other candidates of its round.
#[derive(Clone, Debug)]
pub struct SelectedEffect {
    /// What was added.
    pub candidate: Candidate,
    /// The others that were fitted in its round, best first.
    pub others: Vec<CandidateFit>,
    /// Gain over the model before it.
    pub gain: f64,
    /// Part of the base's misfit energy that it removed, beyond those before it.
    pub removed: f64,
}

/// `rig` with `candidate` added at `values`.
#[must_use]
pub fn with_effect(rig: &Rig, candidate: &Candidate, values: &[f64]) -> Rig {
    let mut out = rig.clone();
    let Some(kind) = EffectKind::from_id(candidate.effect) else { return out };
    let value =
        |name: &str| {
            let found = candidate.keys.iter().zip(values).find(|(k, _)| k.name == name);
            found.map_or(Value::known(0.0), |(k, v)| {
                if k.max > k.min { Value::free(*v, k.min, k.max) } else { Value::known(*v) }
            })
        };
    let values = kind.keys().iter().map(|k| value(k.name)).collect();
    let mut effect = Effect::new(kind, &candidate.at, values);
    effect.recordings = candidate.only.iter().cloned().collect();
    effect.side = candidate.side;
    out.effects.push(effect);
    for sensor in out.sensors.iter_mut().filter(|s| candidate.motor_sensor.as_ref() == Some(&s.column)) {
        sensor.side = Side::Motor;
    }
    out
}

/// Of a fit that goes on from another with an effect less, or with another one in its place.
pub const REFIT: Limits = Limits { iterations: 10, tolerance: 1e-5 };

/// To the end of a fit whose first steps were made among many.
pub const TO_THE_END: Limits = Limits { iterations: 25, tolerance: 1e-5 };
