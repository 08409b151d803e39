//! What is known of a case: the sealed truth of a trial (JSON), or the facts collected about real hardware (TOML).
//! RT: no.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::answer::{ReadError, json_of, text_of};

/// Truth of one case, by the kind of source.
#[derive(Debug, Clone)]
pub enum Truth {
    /// Everything is known: the case was made by a simulator.
    Simulated(Simulated),
    /// Something is known: the case was recorded on hardware.
    Hardware(Hardware),
}

impl Truth {
    /// Looks for `case.json`, then `case.toml` in `folder`.
    ///
    /// # Errors
    /// Neither exists, or the one that does is not in its form.
    pub fn find(folder: &Path, case: &str) -> Result<Self, ReadError> {
        let simulated = folder.join(format!("{case}.json"));
        if simulated.exists() {
            return json_of(&simulated).map(Self::Simulated);
        }
        let path = folder.join(format!("{case}.toml"));
        toml::from_str(&text_of(&path)?)
            .map(Self::Hardware)
            .map_err(|error| ReadError::Form { path, reason: error.to_string() })
    }
}

/// Truth of a simulated case. Keys that only describe how the case was made are read by people, not here.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Simulated {
    /// Verdicts that are right.
    pub verdict: Vec<String>,
    /// Concealment level `C0`..`C4`.
    #[serde(default)]
    pub level: String,
    /// Detectability class: `null`, `easy`, `medium`, `hard`.
    #[serde(default)]
    pub bin: String,
    /// How the case was made, for people.
    #[serde(default)]
    pub note: String,
    /// What was hidden; empty in a healthy case.
    pub effects: Vec<Hidden>,
    /// What could be gained on recordings never fitted.
    #[serde(default)]
    pub heldout: Vec<Recoverable>,
}

/// One hidden effect.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Hidden {
    /// Id of contract section 3.
    pub effect: String,
    /// Where.
    pub at: String,
    /// The answers that are right: itself, and its twins where this data cannot decide. `at` null: any place.
    pub one_of: Vec<Accepted>,
    /// True values.
    #[serde(default)]
    pub parameters: BTreeMap<String, f64>,
    /// Does it act in intervals only?
    #[serde(default)]
    pub localised: bool,
    /// Those intervals.
    #[serde(default)]
    pub active: Vec<Interval>,
}

/// An accepted explanation.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Accepted {
    /// Id of contract section 3.
    pub effect: String,
    /// Place, or any.
    pub at: Option<String>,
}

/// An interval of a recording.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Interval {
    /// File of the recording.
    pub recording: String,
    /// Start, s.
    pub from_s: f64,
    /// End, s.
    pub to_s: f64,
}

/// Errors that a perfect diagnosis would report for one held-out channel.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Recoverable {
    /// File of the recording.
    pub recording: String,
    /// Sensor column.
    pub channel: String,
    /// Base re-fitted, nothing added.
    pub nrmse_refitted: f64,
    /// With the true physics: noise and quantisation only.
    pub nrmse_floor: f64,
    /// 1 - floor / refitted.
    pub recoverable: f64,
}

/// What is known of a hardware case.
#[derive(Debug, Clone, Deserialize)]
pub struct Hardware {
    /// Verdicts that are right.
    pub verdict: Vec<String>,
    /// What must (or, `stretch`, should) be named.
    #[serde(default)]
    pub expected: Vec<Expected>,
    /// What may be named as well: `effect`, `effect@at` or `effect@at#order`.
    #[serde(default)]
    pub optional: Vec<String>,
    /// What must not be named.
    #[serde(default)]
    pub forbidden: Vec<String>,
    /// The first place found is on one of these channels.
    #[serde(default)]
    pub where_channels: Vec<String>,
    /// Largest held-out errors.
    #[serde(default)]
    pub acceptance: Vec<Acceptance>,
}

/// One expected effect.
#[derive(Debug, Clone, Deserialize)]
pub struct Expected {
    /// Any of these is right.
    pub any_of: Vec<String>,
    /// `required` or `stretch`.
    pub tier: String,
    /// Plausible ranges.
    #[serde(default)]
    pub parameters: BTreeMap<String, [f64; 2]>,
}

/// Largest acceptable held-out error of a channel, pooled over the matching recordings.
#[derive(Debug, Clone, Deserialize)]
pub struct Acceptance {
    /// Sensor column.
    pub channel: String,
    /// Which recordings: a name, or a pattern with one `*`.
    pub files: String,
    /// Limit of the pooled `nrmse_explained`.
    pub nrmse: f64,
}
