//! What a diagnosis found, as plain data: `diagnosis.json` (contract §4) and the curves of `report.html`.
//!
//! It lives below `diagnose` so that the pages can be drawn from it; `diagnose::judge::verdict` re-exports it.
//! RT: no.

use serde::Serialize;
use std::collections::BTreeMap;

/// The answer of a diagnosis in one word (contract §4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// The simulation as given explains the data to within noise.
    Consistent,
    /// It does after its parameters were fitted again.
    Parameters,
    /// Each missing effect is one of the library.
    Explained,
    /// Some entry has several members that this data cannot separate.
    Ambiguous,
    /// The mismatch is real and located, but no effect of the library explains it.
    Unlisted,
}

impl Verdict {
    /// True if something was found that the simulation lacks: exit status 1.
    #[must_use]
    pub const fn is_mismatch(self) -> bool {
        matches!(self, Self::Explained | Self::Ambiguous | Self::Unlisted)
    }
}

/// A number with its standard deviation, SI.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Best value.
    pub value: f64,
    /// One standard deviation, from the curvature of the fit and the residual it leaves.
    pub std: f64,
    /// Lower end of the 95 % interval: within the bounds, and as wide as the sampling leaves what is a time.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// For people; the names in files tell it to programs. Empty for a pure number.
    #[serde(skip)]
    pub unit: &'static str,
}

/// Half the width of a 95 % interval in standard deviations, of a normal density.
pub const HALF_95: f64 = 1.959_963_984_540_054;

impl Estimate {
    /// With the interval of a normal density.
    #[must_use]
    pub fn normal(value: f64, std: f64) -> Self {
        Self { value, std, low: value - HALF_95 * std, high: value + HALF_95 * std, unit: "" }
    }

    /// The same with its unit.
    #[must_use]
    pub fn in_unit(self, unit: &'static str) -> Self {
        Self { unit, ..self }
    }

    /// `factor` times the number, above zero: in another unit.
    #[must_use]
    pub fn times(self, factor: f64) -> Self {
        let Self { value, std, low, high, unit } = self;
        Self { value: factor * value, std: factor * std, low: factor * low, high: factor * high, unit }
    }

    /// True if its interval holds `value`.
    #[must_use]
    pub fn reaches(&self, value: f64) -> bool {
        (self.low..=self.high).contains(&value)
    }

    /// With the interval of a density that is normal in the logarithm: of a positive number that is known by its order.
    #[must_use]
    pub fn log_normal(value: f64, relative_std: f64) -> Self {
        let factor = libm::exp(HALF_95 * relative_std);
        Self { value, std: relative_std * value, low: value / factor, high: value * factor, unit: "" }
    }

    /// The same, its interval ended at bounds.
    #[must_use]
    pub fn within(self, min: f64, max: f64) -> Self {
        Self { low: self.low.max(min), high: self.high.min(max), ..self }
    }

    /// The number of opposite sign.
    #[must_use]
    pub fn negated(self) -> Self {
        Self { value: -self.value, low: -self.high, high: -self.low, ..self }
    }
}

/// Where simulation and recording differ.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Place {
    /// File name of the recording.
    pub recording: String,
    /// Sensor column.
    pub channel: String,
    /// Start of the interval, time of the recording.
    pub from_s: f64,
    /// Its end.
    pub to_s: f64,
    /// Part of the mismatch energy it holds, 0 to 1.
    pub share: f64,
    /// Stance or swing leg, drive on or off; only where it narrows the place.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub phase: Option<String>,
    /// Region of the state, for example `abs(q1_rate) < 0.05`; only where it narrows the place.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub region: Option<String>,
    /// Frequency band; only where it narrows the place.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub band_hz: Option<[f64; 2]>,
}

/// One effect that may be what is missing.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Member {
    /// Id of contract §3.
    pub effect: String,
    /// Coordinate, actuator column, sensor column or `ground`.
    pub at: String,
    /// Probability among the members that were weighed against each other.
    pub weight: f64,
    /// Its parameters.
    pub parameters: BTreeMap<String, Estimate>,
}

/// One piece of physics that the simulation lacks: a set of effects that this data cannot tell apart.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Missing {
    /// Members, heaviest first.
    pub one_of: Vec<Member>,
    /// What a person would say, one or two sentences.
    pub sentence: String,
}

/// An effect that was considered and ruled out.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rejected {
    /// Id of contract §3.
    pub effect: String,
    /// Its place.
    pub at: String,
    /// Why it is not the answer, with the number that says so.
    pub why: String,
}

/// An effect that was found and is no explanation: too small to matter, or its strength not told from nothing.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Seen {
    /// Id of contract §3.
    pub effect: String,
    /// Its place.
    pub at: String,
    /// Part of the misfit without it that it removes, 0 to 1.
    pub share: f64,
    /// Its parameters.
    pub parameters: BTreeMap<String, Estimate>,
    /// What a person would say.
    pub sentence: String,
}

/// Error of the free runs of one channel of one recording: RMSE over the pooled standard deviation of the channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figure {
    /// File name of the recording.
    pub recording: String,
    /// `fit` or `heldout`.
    #[serde(rename = "use")]
    pub use_: String,
    /// Sensor column.
    pub channel: String,
    /// Parameters as given.
    pub nrmse_given: f64,
    /// Parameters fitted again, nothing added.
    pub nrmse_refitted: f64,
    /// With the effects that were found.
    pub nrmse_explained: f64,
}

/// `diagnosis.json`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Diagnosis {
    /// Version of the contract, 1.
    pub schema: u32,
    /// The answer in one word.
    pub verdict: Verdict,
    /// Places of the mismatch, largest share first.
    #[serde(rename = "where")]
    pub places: Vec<Place>,
    /// What is missing.
    pub missing: Vec<Missing>,
    /// What was found and is too small to matter, or not told from nothing; no part of the verdict.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub seen: Vec<Seen>,
    /// What was considered and ruled out.
    pub rejected: Vec<Rejected>,
    /// What would separate the members of an ambiguous entry.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub next_experiment: Option<String>,
    /// Free-run errors of every channel that carries a signal.
    pub fit: Vec<Figure>,
    /// Wall-clock time of the diagnosis.
    pub seconds: f64,
    /// Seed of every random draw.
    pub seed: u64,
}

/// One channel of one recording: measured and the three free runs, row by row.
#[derive(Clone, Debug, Default)]
pub struct Trace {
    /// File name of the recording.
    pub recording: String,
    /// `fit` or `heldout`.
    pub use_: String,
    /// Sensor column.
    pub channel: String,
    /// Unit of its readings.
    pub unit: &'static str,
    /// Time, s.
    pub t_s: Vec<f64>,
    /// What was read; NaN where a sample is missing.
    pub measured: Vec<f64>,
    /// Free run of the rig as given.
    pub given: Vec<f64>,
    /// Free run with the base parameters fitted again.
    pub refitted: Vec<f64>,
    /// Free run with the effects that were found; equal to `refitted` if none.
    pub explained: Vec<f64>,
}

/// A law that was found, or the force that nothing explains, as a curve with a band.
#[derive(Clone, Debug, Default)]
pub struct Law {
    /// What it shows, for example "friction at q1 over rate".
    pub title: String,
    /// Name and unit of the abscissa.
    pub x_label: String,
    /// Name and unit of the ordinate.
    pub y_label: String,
    /// Abscissae.
    pub x: Vec<f64>,
    /// Best estimate.
    pub y: Vec<f64>,
    /// Lower edge of the 95 % band.
    pub low: Vec<f64>,
    /// Upper edge.
    pub high: Vec<f64>,
}

impl Law {
    /// Points of a curve: even, so that no point lies on the jump of dry friction at rest.
    pub const POINTS: usize = 120;
}

/// One line of the ranking of candidates.
#[derive(Clone, Debug, PartialEq)]
pub struct Ranked {
    /// Id of contract §3.
    pub effect: String,
    /// Its place.
    pub at: String,
    /// Part of the explainable mismatch that it explains alone, 0 to 1.
    pub explained: f64,
    /// Gain of twice the log-likelihood over the base, joint re-fit of everything.
    pub gain: f64,
    /// True if it stands in the answer.
    pub chosen: bool,
}

/// One parameter of the model before and after.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterLine {
    /// Name, for example `inertia_kg_m2` or `viscous_friction@q1.viscous`.
    pub name: String,
    /// As given in the rig; NaN for a parameter of an effect that was added.
    pub given: f64,
    /// Fitted again, nothing added; NaN likewise.
    pub refitted: f64,
    /// In the model that was written, with its standard deviation.
    pub explained: Estimate,
    /// True if it stands at one of its bounds.
    pub at_bound: bool,
}

/// Everything that a page about a diagnosis shows.
#[derive(Clone, Debug)]
pub struct Findings {
    /// Name of the rig.
    pub rig: String,
    /// The answer, as written to `diagnosis.json`.
    pub diagnosis: Diagnosis,
    /// One or two sentences for the head of the page, also when nothing is missing.
    pub headline: String,
    /// Measured and simulated signals of all recordings.
    pub traces: Vec<Trace>,
    /// Laws that were found, or the residual force of an `unlisted` mismatch.
    pub laws: Vec<Law>,
    /// The candidates, best first.
    pub ranking: Vec<Ranked>,
    /// Parameters before and after.
    pub parameters: Vec<ParameterLine>,
    /// Combinations of parameters that this data does not determine, and what would.
    pub undetermined: Vec<String>,
    /// What was odd in the input and how the work went on nevertheless.
    pub warnings: Vec<String>,
}
