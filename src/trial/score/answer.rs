//! What a diagnosis said: the part of `diagnosis.json` that a score needs, read from the file like any outsider would.
//!
//! Own types on purpose: a score that shared the writer's types could not notice that the file is not what the contract
//! says. RT: no.

use std::fs;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use std::collections::BTreeMap;

/// Why an answer or a truth could not be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The file is missing or unreadable.
    #[error("{path}: {source}")]
    Io {
        /// Which file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Not the form of the contract.
    #[error("{path}: {reason}")]
    Form {
        /// Which file.
        path: PathBuf,
        /// Line, column and complaint of the parser.
        reason: String,
    },
}

/// Text of a file, or an error that names it.
pub(super) fn text_of(path: &Path) -> Result<String, ReadError> {
    fs::read_to_string(path).map_err(|source| ReadError::Io { path: path.to_path_buf(), source })
}

/// A JSON file as `T`, or an error that names it.
pub(super) fn json_of<T: for<'a> Deserialize<'a>>(path: &Path) -> Result<T, ReadError> {
    serde_json::from_str(&text_of(path)?)
        .map_err(|error| ReadError::Form { path: path.to_path_buf(), reason: error.to_string() })
}

/// `diagnosis.json` of contract section 4.
#[derive(Debug, Clone, Deserialize)]
pub struct Answer {
    /// Schema number, 1.
    pub schema: u32,
    /// One of the five verdicts.
    pub verdict: String,
    /// Where the mismatch lives, largest share first.
    #[serde(rename = "where")]
    pub places: Vec<Place>,
    /// The missing physics; one entry per effect.
    pub missing: Vec<Entry>,
    /// Error of the free runs.
    pub fit: Vec<FitRow>,
    /// Duration of the diagnosis, s.
    pub seconds: f64,
}

/// One place where simulation and recording differ.
#[derive(Debug, Clone, Deserialize)]
pub struct Place {
    /// File of the recording.
    pub recording: String,
    /// Sensor column.
    pub channel: String,
    /// Start, s.
    pub from_s: f64,
    /// End, s.
    pub to_s: f64,
    /// Part of the mismatch energy.
    pub share: f64,
}

/// One missing effect: the explanations that the data allows.
#[derive(Debug, Clone, Deserialize)]
pub struct Entry {
    /// The set, any order.
    pub one_of: Vec<Member>,
}

/// One explanation.
#[derive(Debug, Clone, Deserialize)]
pub struct Member {
    /// Id of contract section 3.
    pub effect: String,
    /// Coordinate, column or `ground`.
    pub at: String,
    /// Posterior weight within the set.
    #[serde(default)]
    pub weight: f64,
    /// Values found.
    #[serde(default)]
    pub parameters: BTreeMap<String, Found>,
}

/// A parameter found.
#[derive(Debug, Clone, Copy, Deserialize)]
pub struct Found {
    /// SI value.
    pub value: f64,
    /// Its standard deviation.
    #[serde(default)]
    pub std: Option<f64>,
    /// Lower end of its 95 % interval, where the answer tells one.
    #[serde(default)]
    pub low: Option<f64>,
    /// Upper end.
    #[serde(default)]
    pub high: Option<f64>,
}

/// Half the width of a 95 % interval in standard deviations, of a normal density.
const HALF_95: f64 = 1.959_963_984_540_054;

impl Found {
    /// The 95 % interval: as told, else two standard deviations to either side. `None`: nothing is told of it.
    pub fn interval(&self) -> Option<[f64; 2]> {
        let told = self.low.zip(self.high);
        let normal = || self.std.map(|std| (self.value - HALF_95 * std, self.value + HALF_95 * std));
        told.or_else(normal).map(|(low, high)| [low, high])
    }
}

/// Errors of one channel of one recording.
#[derive(Debug, Clone, Deserialize)]
pub struct FitRow {
    /// File of the recording.
    pub recording: String,
    /// `fit` or `heldout`.
    #[serde(rename = "use")]
    pub role: String,
    /// Sensor column.
    pub channel: String,
    /// With the parameters of the rig; absent where the channel has no figure.
    pub nrmse_given: Option<f64>,
    /// With the base re-fitted.
    pub nrmse_refitted: Option<f64>,
    /// With what was found.
    pub nrmse_explained: Option<f64>,
}

impl Answer {
    /// What is marked where there is no answer: no verdict, nothing named.
    pub fn none() -> Self {
        Self {
            schema: 1,
            verdict: String::new(),
            places: Vec::new(),
            missing: Vec::new(),
            fit: Vec::new(),
            seconds: 0.0,
        }
    }

    /// Reads `diagnosis.json`.
    ///
    /// # Errors
    /// Missing file, or a form that contract section 4 does not allow.
    pub fn read(path: &Path) -> Result<Self, ReadError> {
        json_of(path)
    }
}

impl Entry {
    /// The member of largest weight; the first of equals.
    pub fn best(&self) -> Option<&Member> {
        self.one_of.iter().reduce(|best, next| if next.weight > best.weight { next } else { best })
    }
}
