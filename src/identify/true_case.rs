//! Cases of other simulators with what was hidden in them, for tests: they skip aloud where the shared folder is missing.

use crate::identify::experiment::Experiment;
use crate::identify::rollout::Pooled;
use crate::model::effect::EffectKind;
use crate::model::rig::{Effect, Rig, Use, Value};
use std::fs;
use std::path::{Path, PathBuf};

/// The folder that other hands filled, if it is here.
pub(crate) fn shared() -> Option<PathBuf> {
    let path = std::env::var_os("COMPASS_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    if path.is_dir() {
        return Some(path);
    }
    println!("SKIPPED: no shared folder at {}; set COMPASS_SHARED", path.display());
    None
}

/// A case, the rig under which it was made, and what else is known.
pub(crate) struct TrueCase {
    pub(crate) id: String,
    pub(crate) truth: serde_json::Value,
    pub(crate) experiment: Experiment,
    /// True parameters, hidden effects added at the end.
    pub(crate) rig: Rig,
}

impl TrueCase {
    /// Reads case `id`.
    pub(crate) fn load(shared: &Path, id: &str) -> Self {
        let text = fs::read_to_string(shared.join(format!("cases/blind-dev-truth/{id}.json"))).unwrap();
        let truth: serde_json::Value = serde_json::from_str(&text).unwrap();
        let experiment = Experiment::load(&shared.join("cases/blind-dev").join(id)).unwrap();
        let rig = with_truth(&experiment.rig, &truth);
        Self { id: id.to_owned(), truth, experiment, rig }
    }

    /// All of them, in order.
    pub(crate) fn ids(shared: &Path) -> Vec<String> {
        let folder = fs::read_dir(shared.join("cases/blind-dev")).unwrap();
        let mut ids: Vec<String> = folder.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        ids.sort();
        ids
    }

    /// How the case calls what was hidden.
    pub(crate) fn family(&self) -> &str {
        self.truth["family"].as_str().unwrap_or("")
    }

    /// Effects that the rig as given does not have.
    pub(crate) fn hidden(&self) -> std::ops::Range<usize> {
        self.rig.effects.len() - self.listed()..self.rig.effects.len()
    }

    /// Number of hidden effects that the library has.
    fn listed(&self) -> usize {
        let ids = self.truth["effects"].as_array().unwrap().iter().filter_map(|e| e["effect"].as_str());
        ids.filter(|id| EffectKind::from_id(id).is_some()).count()
    }

    /// True if something was hidden that no effect of the library explains.
    pub(crate) fn is_unlisted(&self) -> bool {
        self.truth["effects"].as_array().unwrap().iter().any(|e| e["effect"] == "unlisted")
    }

    /// Noise and quantisation of a channel on the held-out recordings, in units of their pooled deviation.
    pub(crate) fn floor(&self, recording: &str, column: &str) -> Option<f64> {
        let of = |h: &&serde_json::Value| h["channel"] == column && h["recording"] == recording;
        self.truth["heldout"].as_array().unwrap().iter().find(of)?["nrmse_floor"].as_f64()
    }

    /// Standard deviation of each channel's noise with quantisation, in its unit; infinite where none is told.
    pub(crate) fn noise(&self) -> Vec<f64> {
        let heldout: Vec<_> = self.experiment.of_use(Use::Heldout).collect();
        let pooled = Pooled::of(&self.rig, heldout.iter().copied());
        let channel = |(sensor, std): (&crate::model::rig::Sensor, &f64)| {
            let floors: Vec<f64> = heldout.iter().filter_map(|r| self.floor(&r.name, &sensor.column)).collect();
            let squares: f64 = floors.iter().map(|x| x * x).sum();
            if floors.is_empty() { f64::INFINITY } else { (squares / floors.len() as f64).sqrt() * std }
        };
        self.rig.sensors.iter().zip(&pooled.std).map(channel).collect()
    }
}

/// Sets one number; the effect is added if the rig does not have it.
fn set(rig: &mut Rig, kind: EffectKind, at: &str, key: &str, value: f64) {
    let Some(k) = kind.key_index(key) else { return };
    let position = rig.effects.iter().position(|e| e.kind == kind && e.at == at).unwrap_or_else(|| {
        rig.effects.push(Effect::new(kind, at, vec![Value::known(0.0); kind.keys().len()]));
        rig.effects.len() - 1
    });
    rig.effects[position].values[k].value = value;
}

/// `rig` with the parameters under which a case was made.
fn with_truth(rig: &Rig, truth: &serde_json::Value) -> Rig {
    let mut rig = rig.clone();
    for (name, value) in truth["base_truth"].as_object().unwrap() {
        let value = value.as_f64().unwrap();
        let (what, at) = name.split_once(':').unwrap_or((name, ""));
        let joint = rig.mechanism.coordinate_index(at);
        match what {
            "gain" => rig.actuators.iter_mut().filter(|a| Some(a.joint) == joint).for_each(|a| a.gain.value = value),
            "viscous" => set(&mut rig, EffectKind::ViscousFriction, at, "viscous", value),
            "coulomb" if value > 0.0 => set(&mut rig, EffectKind::CoulombFriction, at, "coulomb", value),
            "stiffness" if value > 0.0 => set(&mut rig, EffectKind::ParallelSpring, at, "stiffness", value),
            "rest" if value.abs() > 0.0 => set(&mut rig, EffectKind::ParallelSpring, at, "rest", value),
            _ => {
                if let Some(i) = rig.mechanism.parameter_index(what) {
                    rig.parameters[i].value = value;
                }
            }
        }
    }
    for effect in truth["effects"].as_array().unwrap() {
        let Some(kind) = EffectKind::from_id(effect["effect"].as_str().unwrap()) else { continue };
        rig.effects.push(hidden(kind, effect));
    }
    rig
}

fn hidden(kind: EffectKind, effect: &serde_json::Value) -> Effect {
    let values = kind.keys().iter().map(|key| {
        let given = effect["parameters"].get(key.name).or(effect.get("further").and_then(|f| f.get(key.name)));
        Value::known(given.and_then(serde_json::Value::as_f64).unwrap_or(0.0))
    });
    let mut new = Effect::new(kind, effect["at"].as_str().unwrap(), values.collect());
    if matches!(kind, EffectKind::LostCounts | EffectKind::ExternalPush) {
        let active = effect["active"].as_array().unwrap().iter();
        new.recordings = active.map(|a| a["recording"].as_str().unwrap().to_owned()).collect();
    }
    new
}
