//! A rig as it holds for one recording: overrides in place, effects of other set-ups left out, places resolved.
//!
//! Every number keeps the [`Slot`] it came from, so that a run can be differentiated by it.
//! RT: before arming only.

use super::effect::EffectKind;
use super::rig::{Effect, MechanismKind, Numerics, RecordingEntry, Rig, Scope, Sensor, Setup, Side, Site, Slot};

/// A number and where it stands in the rig.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Number {
    /// SI.
    pub value: f64,
    /// Its address; none for what no rig says.
    pub slot: Option<Slot>,
}

/// A motor.
#[derive(Clone, Debug, PartialEq)]
pub struct ActuatorSetting {
    /// Index of its coordinate.
    pub joint: usize,
    /// Nm per unit of the command.
    pub gain: Number,
    /// Nm s/rad, 0 if it has none.
    pub back_emf: Number,
}

/// An effect that acts.
#[derive(Clone, Debug, PartialEq)]
pub struct EffectSetting {
    /// Which.
    pub kind: EffectKind,
    /// Where.
    pub site: Site,
    /// On which side of an elastic or loose joint.
    pub side: Side,
    /// In the order of [`EffectKind::keys`].
    pub numbers: Vec<Number>,
}

/// All that a machine is built from.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// Which machine.
    pub mechanism: MechanismKind,
    /// As in the rig.
    pub numerics: Numerics,
    /// How the compass gait is set up.
    pub setup: Option<Setup>,
    /// In the order of [`MechanismKind::parameters`].
    pub parameters: Vec<Number>,
    /// As in the rig.
    pub actuators: Vec<ActuatorSetting>,
    /// As in the rig.
    pub sensors: Vec<Sensor>,
    /// Those that act here.
    pub effects: Vec<EffectSetting>,
}

impl Setting {
    /// `rig` as it holds in its recording `recording` (index), or without any recording in `setup`.
    #[must_use]
    pub fn of(rig: &Rig, recording: Option<usize>, setup: Option<Setup>) -> Self {
        let entry = recording.and_then(|r| rig.recordings.get(r).map(|e| (r, e)));
        let number = |slot: Slot| Number { value: rig.value(slot).map_or(0.0, |v| v.value), slot: Some(slot) };
        Self {
            mechanism: rig.mechanism,
            numerics: rig.numerics,
            setup: entry.map_or(setup, |(_, e)| e.setup),
            parameters: (0..rig.parameters.len()).map(|i| number(parameter_slot(entry, i))).collect(),
            actuators: rig
                .actuators
                .iter()
                .enumerate()
                .map(|(i, a)| ActuatorSetting {
                    joint: a.joint,
                    gain: number(Slot::Gain(i)),
                    back_emf: a.back_emf.map_or(Number { value: 0.0, slot: None }, |_| number(Slot::BackEmf(i))),
                })
                .collect(),
            sensors: rig.sensors.clone(),
            effects: effects(rig, entry, setup),
        }
    }

    /// Numbers of the effects of kind `kind` at `site`.
    pub fn of_kind(&self, kind: EffectKind, site: Site) -> impl Iterator<Item = &[Number]> {
        self.effects.iter().filter(move |e| e.kind == kind && e.site == site).map(|e| e.numbers.as_slice())
    }

    /// Numbers of the first effect of kind `kind` at `site`.
    #[must_use]
    pub fn first(&self, kind: EffectKind, site: Site) -> Option<&[Number]> {
        self.effects.iter().find(|e| e.kind == kind && e.site == site).map(|e| e.numbers.as_slice())
    }

    /// All slots that a run in this setting depends on.
    pub fn slots(&self) -> impl Iterator<Item = Slot> {
        let actuators = self.actuators.iter().flat_map(|a| [a.gain, a.back_emf]);
        let effects = self.effects.iter().flat_map(|e| e.numbers.iter().copied());
        self.parameters.iter().copied().chain(actuators).chain(effects).filter_map(|n| n.slot)
    }
}

fn parameter_slot(entry: Option<(usize, &RecordingEntry)>, i: usize) -> Slot {
    let own = entry.and_then(|(r, e)| e.parameters.iter().position(|(p, _)| *p == i).map(|k| (r, k)));
    own.map_or(Slot::Parameter(Scope::Rig, i), |(r, k)| Slot::Parameter(Scope::Recording(r), k))
}

fn effects(rig: &Rig, entry: Option<(usize, &RecordingEntry)>, setup: Option<Setup>) -> Vec<EffectSetting> {
    let own = entry.map_or(&[][..], |(_, e)| &e.effects);
    let acts = |e: &Effect| match entry {
        Some((_, recording)) => e.acts_in(recording),
        None => e.recordings.is_empty() && (e.setup.is_none() || e.setup == setup),
    };
    let shared = rig.effects.iter().enumerate().filter(|(_, e)| acts(e) && !own.iter().any(|o| o.is_twin_of(e)));
    let mut out: Vec<EffectSetting> = shared.filter_map(|(i, e)| resolved(rig, e, Scope::Rig, i)).collect();
    if let Some((r, _)) = entry {
        out.extend(own.iter().enumerate().filter_map(|(i, e)| resolved(rig, e, Scope::Recording(r), i)));
    }
    out
}

fn resolved(rig: &Rig, effect: &Effect, scope: Scope, index: usize) -> Option<EffectSetting> {
    let numbers = effect.values.iter().enumerate();
    let numbers = numbers.map(|(k, v)| Number { value: v.value, slot: Some(Slot::Effect(scope, index, k)) }).collect();
    Some(EffectSetting { kind: effect.kind, site: rig.site(effect.kind, &effect.at)?, side: effect.side, numbers })
}
