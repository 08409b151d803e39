//! A model file (a rig, as `compass diagnose` writes it) as the model that observer and controller work with: `--model F`.
//!
//! Taken over: c1..c6, leg length, mass and gravity; viscous and Coulomb friction and joint elasticity at `hip`. The rest
//! of the file (sensors, delays, the ground) is not the controller's business, or it cannot use it yet: told as a warning.
//!
//! The simulated robot stays what it was: before the model is taken over, the old one becomes `sim.body`, unless that is
//! given already. Only then does a run with the new model say anything about the new model.
//! RT: before arming only.

use super::problem::Problem;
use super::raw::{Node, Origin, Raw};
use crate::model::effect::EffectKind;
use crate::model::rig::{Effect, MechanismKind, Rig, Value};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// What a model file says about the controller's model.
pub(super) struct RigModel {
    /// Keys below `robot.model` with their values.
    pub(super) values: Vec<(Vec<&'static str>, Node)>,
    /// What was not taken over.
    pub(super) notes: Vec<Problem>,
}

/// Names of the rig's parameters, in their order, as `robot.model` has them.
const PARAMETERS: [&str; 9] = ["leg_length", "total_mass", "gravity", "c1", "c2", "c3", "c4", "c5", "c6"];

impl RigModel {
    /// Reads `path`.
    ///
    /// # Errors
    /// It cannot be read, is no rig, or of another mechanism.
    pub(super) fn read(path: &Path) -> Result<Self, Vec<Problem>> {
        let file = path.display().to_string();
        let wrong = |what: String| vec![problem(&file, what)];
        let text = fs::read_to_string(path).map_err(|e| wrong(format!("cannot be read: {e}")))?;
        let rig = Rig::parse(&text, &file).map_err(|e| wrong(format!("is no model file: {e}")))?;
        if rig.mechanism != MechanismKind::CompassGait {
            return Err(wrong(format!("is a model of a {}, the robot is a compass_gait", rig.mechanism.id())));
        }
        Ok(Self::of(&rig, &file))
    }

    fn of(rig: &Rig, file: &str) -> Self {
        let place = Place { file };
        let mut values: Vec<_> = PARAMETERS
            .into_iter()
            .zip(&rig.parameters)
            .flat_map(|(name, value)| [(vec![name, "value"], place.number(value.value)), place.source(name)])
            .collect();
        let mut notes = Vec::new();
        for effect in &rig.effects {
            match place.effect(effect) {
                Some(taken) => values.push(taken),
                None => {
                    let (id, at) = (effect.kind.id(), &effect.at);
                    let what = format!("{id} at {at} is not used: observer and controller have no such physics");
                    notes.push(problem(file, what));
                }
            }
        }
        Self { values, notes }
    }
}

fn problem(file: &str, what: String) -> Problem {
    Problem { file: file.to_owned(), line: 0, key: String::new(), value: None, what }
}

/// Makes nodes that say where they come from.
struct Place<'a> {
    file: &'a str,
}

impl Place<'_> {
    fn node(&self, value: Raw) -> Node {
        Node { at: Origin { file: self.file.into(), line: 0 }, value }
    }

    fn number(&self, value: f64) -> Node {
        self.node(Raw::Number { value, whole: None })
    }

    fn table(&self, entries: impl IntoIterator<Item = (&'static str, Node)>) -> Node {
        let entries: BTreeMap<String, Node> = entries.into_iter().map(|(key, node)| (key.to_owned(), node)).collect();
        self.node(Raw::Table(entries))
    }

    fn source(&self, name: &'static str) -> (Vec<&'static str>, Node) {
        (vec![name, "source"], self.node(Raw::Text("--model".to_owned())))
    }

    /// What the controller's model makes of an effect at the hip.
    fn effect(&self, effect: &Effect) -> Option<(Vec<&'static str>, Node)> {
        let everywhere = effect.at == "hip" && effect.setup.is_none() && effect.recordings.is_empty();
        let number = |name: &str| effect.get(name).map(|v| self.number(v.value));
        match effect.kind {
            EffectKind::ViscousFriction if everywhere => {
                Some((vec!["viscous"], self.friction(effect.get("viscous")?, "Nm s/rad")))
            }
            EffectKind::CoulombFriction if everywhere => {
                Some((vec!["coulomb"], self.friction(effect.get("coulomb")?, "Nm")))
            }
            EffectKind::JointElasticity if everywhere => {
                let keys = [
                    ("stiffness_nm_rad", number("stiffness")?),
                    ("damping_nm_s_rad", number("damping")?),
                    ("rotor_inertia_kg_m2", number("rotor_inertia")?),
                ];
                Some((vec!["hip_elasticity"], self.table(keys)))
            }
            _ => None,
        }
    }

    /// A friction parameter in SI, with the bounds that the rig has.
    fn friction(&self, v: Value, unit: &str) -> Node {
        let (min, max) = v.bounds.map_or((v.value, v.value), |b| (b.min, b.max));
        self.table([
            ("value", self.number(v.value)),
            ("min", self.number(min)),
            ("max", self.number(max)),
            ("unit", self.node(Raw::Text(unit.to_owned()))),
            ("source", self.node(Raw::Text("--model".to_owned()))),
            ("free", self.node(Raw::Flag(v.is_free()))),
        ])
    }
}
