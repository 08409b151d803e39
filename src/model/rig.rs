//! A rig: mechanism, parameters, actuators, sensors, effects and recordings. **A model file is a rig file.**
//!
//! [`Rig::parse`] reads the TOML of the diagnosis contract strictly (all errors at once, each with its line),
//! [`Rig::to_toml`] writes it back so that it parses to the same rig.
//! RT: no.

mod mechanism_kind;
mod parse;
mod slot;
#[cfg(test)]
mod tests;
mod unit;
mod write;

use super::effect::{EffectKind, SiteKind};

pub use mechanism_kind::{MechanismKind, Setup};
pub use parse::{RigError, RigErrors};
pub use slot::{Scope, Slot};

/// A number of a rig: known, or uncertain within bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Value {
    /// Best knowledge, SI.
    pub value: f64,
    /// Present = uncertain, to be re-fitted within; absent = known, never touched.
    pub bounds: Option<Bounds>,
}

/// Closed interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest allowed value.
    pub min: f64,
    /// Largest allowed value.
    pub max: f64,
}

impl Value {
    /// A known number.
    #[must_use]
    pub const fn known(value: f64) -> Self {
        Self { value, bounds: None }
    }
    /// A number that a fit may change within `min..=max`.
    #[must_use]
    pub const fn free(value: f64, min: f64, max: f64) -> Self {
        Self { value, bounds: Some(Bounds { min, max }) }
    }
    /// True if a fit may change it.
    #[must_use]
    pub const fn is_free(&self) -> bool {
        self.bounds.is_some()
    }
}

/// Which side of an elastic or loose joint something sits on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Side {
    /// Beyond the spring or the play; the coordinate itself.
    #[default]
    Link,
    /// Before it: the rotor.
    Motor,
}

/// Torque on a coordinate = gain · column, held constant between rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Actuator {
    /// Index into the mechanism's coordinates.
    pub joint: usize,
    /// Column of the command.
    pub column: String,
    /// Nm (or N) per unit of the column.
    pub gain: Value,
    /// 0 = drive off, torque zero.
    pub enable_column: Option<String>,
    /// Torque -back_emf · rate, only while enabled.
    pub back_emf: Option<Value>,
}

/// A reading of a coordinate or of its rate.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensor {
    /// Index into the mechanism's coordinates.
    pub joint: usize,
    /// True if it reads the rate of that coordinate.
    pub is_rate: bool,
    /// Which side of an elastic or loose joint it sits on.
    pub side: Side,
    /// Column of the reading.
    pub column: String,
    /// Standard deviation of its noise, estimated from the data when absent.
    pub noise_std: Option<f64>,
    /// Resolution; 0 = none.
    pub quantum: f64,
}

/// Physics that the simulation has.
#[derive(Clone, Debug, PartialEq)]
pub struct Effect {
    /// Which one.
    pub kind: EffectKind,
    /// Coordinate, column of an actuator or sensor, or `ground`.
    pub at: String,
    /// Its numbers, in the order of [`EffectKind::keys`].
    pub values: Vec<Value>,
    /// Which side of an elastic or loose joint it acts on.
    pub side: Side,
    /// Only in recordings of this set-up.
    pub setup: Option<Setup>,
    /// Only in these recordings; empty = in all.
    pub recordings: Vec<String>,
}

impl Effect {
    /// An effect that holds in all recordings. `values` in the order of [`EffectKind::keys`].
    #[must_use]
    pub fn new(kind: EffectKind, at: &str, values: Vec<Value>) -> Self {
        Self { kind, at: at.to_owned(), values, side: Side::Link, setup: None, recordings: Vec::new() }
    }

    /// The number of key `name`.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<Value> {
        self.kind.key_index(name).and_then(|i| self.values.get(i)).copied()
    }

    /// True if it acts in the recording `entry`.
    #[must_use]
    pub fn acts_in(&self, entry: &RecordingEntry) -> bool {
        let setup = self.setup.is_none_or(|s| entry.setup == Some(s));
        setup && (self.recordings.is_empty() || self.recordings.contains(&entry.file))
    }

    /// True if `other` is the same effect at the same place, so that the one of a recording stands for the rig's.
    #[must_use]
    pub fn is_twin_of(&self, other: &Self) -> bool {
        let order = |e: &Self| e.get("order").map(|v| v.value.to_bits());
        self.kind == other.kind && self.at == other.at && self.side == other.side && order(self) == order(other)
    }
}

/// What a recording is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Use {
    /// Parameters are fitted on it.
    Fit,
    /// Never touched before the proof.
    Heldout,
}

/// A `[[recording]]` table.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordingEntry {
    /// File name inside the case folder.
    pub file: String,
    /// What it is for.
    pub usage: Use,
    /// Free runs restart this often, s.
    pub window_s: Option<f64>,
    /// Set-up of the compass gait; none for other mechanisms.
    pub setup: Option<Setup>,
    /// Column that says which leg stands: 0 inner, 1 outer.
    pub stance_column: Option<String>,
    /// Columns of what the inner and the outer leg are shorter than the leg length, m: toes that move.
    pub toe_columns: Option<[String; 2]>,
    /// Column with a number for each window: free runs begin where it changes, from nothing that was before.
    pub window_column: Option<String>,
    /// Mechanism parameters that differ here: index into [`Rig::parameters`].
    pub parameters: Vec<(usize, Value)>,
    /// Effects that differ here; each stands for its twin of the rig, if there is one.
    pub effects: Vec<Effect>,
}

/// A whole rig file.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    /// What a person calls it.
    pub name: String,
    /// Which machine.
    pub mechanism: MechanismKind,
    /// How the simulation computes.
    pub numerics: Numerics,
    /// In the order of [`MechanismKind::parameters`].
    pub parameters: Vec<Value>,
    /// Motors.
    pub actuators: Vec<Actuator>,
    /// Sensors.
    pub sensors: Vec<Sensor>,
    /// Effects that the simulation already has.
    pub effects: Vec<Effect>,
    /// Recordings of the case; empty in a pure model file.
    pub recordings: Vec<RecordingEntry>,
}

/// Where an effect stands, resolved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Site {
    /// Index of a coordinate.
    Joint(usize),
    /// Index of an actuator.
    Actuator(usize),
    /// Index of a sensor.
    Sensor(usize),
    /// The ground.
    Ground,
}

/// What simulators do to the equations of a machine; nothing of it is physics.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Numerics {
    /// Steps by semi-implicit Euler, s; none: integrated exactly.
    pub euler_step_s: Option<f64>,
    /// Dry friction is its level times tanh(rate / this), rad/s or m/s: a joint creeps where it would stick; none: it sticks.
    pub smooth_rate: Option<f64>,
    /// Dry friction is a soft constraint as in MuJoCo, with this time constant (`solreffriction`), s; none: it is not.
    pub soft_friction_s: Option<f64>,
}

impl Numerics {
    /// Steps that a simulation may take, s.
    pub const EULER_STEP_S: std::ops::RangeInclusive<f64> = 1e-5..=0.1;

    /// Time constant of friction as a soft constraint, at least two steps as in MuJoCo (`refsafe`), s.
    #[must_use]
    pub fn soft_constraint_s(&self) -> Option<f64> {
        self.soft_friction_s.map(|time_s| time_s.max(2.0 * self.euler_step_s.unwrap_or(0.0)))
    }
}

impl Rig {
    /// Index of the recording `file`.
    #[must_use]
    pub fn recording_index(&self, file: &str) -> Option<usize> {
        self.recordings.iter().position(|r| r.file == file)
    }

    /// The place `at` for an effect of kind `kind`; none if this rig has no such place.
    #[must_use]
    pub fn site(&self, kind: EffectKind, at: &str) -> Option<Site> {
        match kind.site() {
            SiteKind::Joint => self.mechanism.coordinate_index(at).map(Site::Joint),
            SiteKind::Actuator => self.actuators.iter().position(|a| a.column == at).map(Site::Actuator),
            SiteKind::Sensor => self.sensors.iter().position(|s| s.column == at).map(Site::Sensor),
            SiteKind::Ground => (at == "ground" && self.mechanism.has_ground()).then_some(Site::Ground),
        }
    }

    /// Names of all places where an effect of kind `kind` may stand in this rig.
    #[must_use]
    pub fn places(&self, kind: EffectKind) -> Vec<&str> {
        match kind.site() {
            SiteKind::Joint => self.mechanism.coordinates().to_vec(),
            SiteKind::Actuator => self.actuators.iter().map(|a| a.column.as_str()).collect(),
            SiteKind::Sensor => self.sensors.iter().map(|s| s.column.as_str()).collect(),
            SiteKind::Ground if self.mechanism.has_ground() => vec!["ground"],
            SiteKind::Ground => Vec::new(),
        }
    }
}
