//! A case as data: the rig, and each recording with its columns where the rig wants them. Recordings are CSV files, or
//! those of our own controller ([`mcap`]).
//!
//! CSV errors name file, row (as an editor counts, the header being 1), column and remedy. What is only suspicious
//! (an angle that looks like degrees, gaps, a channel that never moves) is a warning: the work goes on.
//! RT: no.

mod csv_table;
pub mod mcap;
#[cfg(test)]
mod tests;
mod toes;
mod warn;

use crate::model::machine::ToeMotion;
use crate::model::rig::{RecordingEntry, Rig, RigErrors, Setup, Use};
use std::fs;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};

use mcap::Own;

pub use csv_table::Table;

/// A recording that the rig can run against.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// File name as in the rig.
    pub name: String,
    /// Index into [`Rig::recordings`] of the rig it was read for.
    pub index: usize,
    /// What it is for.
    pub usage: Use,
    /// Free runs restart this often, s.
    pub window_s: Option<f64>,
    /// Set-up of the compass gait.
    pub setup: Option<Setup>,
    /// Instants of the rows, s, strictly increasing; the first need not be 0.
    pub times: Vec<f64>,
    /// One list per actuator of the rig: the command that acts from its row to the next, in units of the column.
    pub inputs: Vec<Vec<f64>>,
    /// One list per actuator: drive enabled. Empty if the actuator has no such column: always on.
    pub enabled: Vec<Vec<bool>>,
    /// One list per sensor of the rig; NaN = no sample.
    pub measured: Vec<Vec<f64>>,
    /// Stance leg of each row, 0 inner, 1 outer; empty if the recording does not say.
    pub stance: Vec<u8>,
    /// How the toes of the inner and the outer leg move at each row; empty if the recording does not say.
    pub toes: Vec<[ToeMotion<f64>; 2]>,
    /// First rows of stretches that know nothing of what was before them, the first row of all among them.
    pub fresh: Vec<usize>,
    /// What looked wrong but did not stop the reading.
    pub warnings: Vec<String>,
}

impl Recording {
    /// One for fitting, without windows, its drives always on. One list of `inputs` per actuator and of `measured` per
    /// sensor.
    #[must_use]
    pub fn new(name: &str, times: Vec<f64>, inputs: Vec<Vec<f64>>, measured: Vec<Vec<f64>>) -> Self {
        Self {
            name: name.to_owned(),
            index: 0,
            usage: Use::Fit,
            window_s: None,
            setup: None,
            times,
            enabled: vec![Vec::new(); inputs.len()],
            inputs,
            measured,
            stance: Vec::new(),
            toes: Vec::new(),
            fresh: vec![0],
            warnings: Vec::new(),
        }
    }
}

/// A rig with its recordings.
#[derive(Clone, Debug, PartialEq)]
pub struct Experiment {
    /// The model as given.
    pub rig: Rig,
    /// In the order of the rig.
    pub recordings: Vec<Recording>,
}

/// Why a case cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// A file cannot be read.
    #[error("{}: {}", path.display(), unreadable(*wanted, cause))]
    File {
        /// Which.
        path: PathBuf,
        /// What it should be.
        wanted: Wanted,
        /// Why. In the words above, so not told again as their source.
        cause: io::Error,
    },
    /// The rig file is wrong.
    #[error(transparent)]
    Rig(#[from] RigErrors),
    /// A table is wrong.
    #[error("{}", .0.join("\n"))]
    Table(Vec<String>),
    /// The form is not read here.
    #[error("{0}")]
    Form(String),
}

/// What a file should be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// A folder with `rig.toml` and its recordings.
    Case,
    /// A rig file.
    Rig,
    /// A recording.
    Recording,
}

/// What is wrong with a file that cannot be read, and what it must be.
fn unreadable(wanted: Wanted, cause: &io::Error) -> String {
    let must_be = match wanted {
        Wanted::Case => "must be a case: a folder with rig.toml and, beside it, the recordings that it names",
        Wanted::Rig => "must be a rig file, such as the rig.toml of a case",
        Wanted::Recording => "must be a recording: a CSV file, or an .mcap of our own controller",
    };
    match cause.kind() {
        io::ErrorKind::NotFound => format!("is not there; {must_be}"),
        io::ErrorKind::IsADirectory => format!("is a folder; {must_be}"),
        io::ErrorKind::NotADirectory => format!("is a file; {must_be}"),
        _ => format!("cannot be read ({cause}); {must_be}"),
    }
}

impl Experiment {
    /// Reads `case/rig.toml` and the recordings that it names.
    ///
    /// # Errors
    /// The first file that cannot be used; within it everything that is wrong.
    pub fn load(case: &Path) -> Result<Self, ExperimentError> {
        let rig = load_rig(&case.join("rig.toml")).map_err(|error| of_case(error, case))?;
        let mut recordings = Vec::new();
        let mut wrong = Vec::new();
        for (index, entry) in rig.recordings.iter().enumerate() {
            match Recording::load(&rig, index, &case.join(&entry.file)) {
                Ok(recording) => recordings.push(recording),
                Err(ExperimentError::Table(lines)) => wrong.extend(lines),
                Err(other) => return Err(other),
            }
        }
        if wrong.is_empty() { Ok(Self { rig, recordings }) } else { Err(ExperimentError::Table(wrong)) }
    }

    /// The recordings of one use.
    pub fn of_use(&self, usage: Use) -> impl Iterator<Item = &Recording> {
        self.recordings.iter().filter(move |r| r.usage == usage)
    }
}

/// A rig that cannot be read, where a case was named: the folder is told if it is none.
fn of_case(error: ExperimentError, case: &Path) -> ExperimentError {
    match error {
        ExperimentError::File { path, cause, .. } => {
            let path = if case.is_dir() { path } else { case.to_owned() };
            ExperimentError::File { path, wanted: Wanted::Case, cause }
        }
        other => other,
    }
}

/// Reads a rig file.
///
/// # Errors
/// The file cannot be read, or all that is wrong with it.
pub fn load_rig(path: &Path) -> Result<Rig, ExperimentError> {
    let text = fs::read_to_string(path).map_err(|cause| ExperimentError::File {
        path: path.to_owned(),
        wanted: Wanted::Rig,
        cause,
    })?;
    Ok(Rig::parse(&text, &path.display().to_string())?)
}

impl Recording {
    /// Reads the recording `index` of `rig` from `path`.
    ///
    /// # Errors
    /// The file cannot be read, a column is missing, a row is short, a number is not finite or time does not increase.
    pub fn load(rig: &Rig, index: usize, path: &Path) -> Result<Self, ExperimentError> {
        let entry = rig
            .recordings
            .get(index)
            .ok_or_else(|| ExperimentError::Form(format!("the rig has no recording number {index}")))?;
        let unread = |cause| ExperimentError::File { path: path.to_owned(), wanted: Wanted::Recording, cause };
        if path.extension().is_some_and(|e| e == "mcap") {
            // What is no file is told alike for both kinds.
            if !path.is_file() {
                fs::read(path).map_err(unread)?;
            }
            let own = Own::read(path)?;
            return Self::from_table(rig, index, entry, &own.table).map_err(ExperimentError::Table);
        }
        let file = path.display().to_string();
        let bytes = fs::read(path).map_err(unread)?;
        let table = Table::parse(&file, &bytes).map_err(ExperimentError::Table)?;
        Self::from_table(rig, index, entry, &table).map_err(ExperimentError::Table)
    }

    /// Takes the columns that `rig` names out of `table`.
    fn from_table(rig: &Rig, index: usize, entry: &RecordingEntry, table: &Table) -> Result<Self, Vec<String>> {
        let mut wrong = Vec::new();
        let mut full = |name: &str, empty_is: Option<f64>| {
            table.column(name, empty_is).unwrap_or_else(|lines| {
                wrong.extend(lines);
                Vec::new()
            })
        };
        let times = full("t_s", None);
        let inputs: Vec<Vec<f64>> = rig.actuators.iter().map(|a| full(&a.column, None)).collect();
        let enabled = rig.actuators.iter().map(|a| {
            a.enable_column.as_ref().map(|c| full(c, None).iter().map(|x| *x >= 0.5).collect()).unwrap_or_default()
        });
        let enabled = enabled.collect();
        let measured = rig.sensors.iter().map(|s| full(&s.column, Some(f64::NAN))).collect();
        let stance = entry.stance_column.as_ref().map(|c| full(c, None)).unwrap_or_default();
        let stretch = entry.window_column.as_ref().map(|c| full(c, None)).unwrap_or_default();
        let short_m = entry.toe_columns.as_ref().map(|names| names.each_ref().map(|c| full(c, None)));
        wrong.extend(table.check_time(&times));
        wrong.extend(table.check_stance(entry.stance_column.as_deref(), &stance));
        if !rig.sensors.is_empty() && table.len() < FEWEST_ROWS {
            wrong.push(table.too_few(FEWEST_ROWS));
        }
        if !wrong.is_empty() {
            return Err(wrong);
        }
        let mut recording = Self {
            name: entry.file.clone(),
            index,
            usage: entry.usage,
            window_s: entry.window_s,
            setup: entry.setup,
            times,
            inputs,
            enabled,
            measured,
            stance: stance.iter().map(|x| u8::from(*x > 0.5)).collect(),
            toes: Vec::new(),
            fresh: fresh(&stretch),
            warnings: Vec::new(),
        };
        if let Some([inner, outer]) = &short_m {
            recording.toes = toes::motions(&recording.times, [inner, outer], &recording.stretches());
        }
        if let Some(line) = recording.short_windows(table).filter(|_| !rig.sensors.is_empty()) {
            return Err(vec![line]);
        }
        recording.warnings = warn::warnings(rig, &recording);
        Ok(recording)
    }

    /// What to say of windows that usually hold too few rows for their initial state to be told from the motion.
    fn short_windows(&self, table: &Table) -> Option<String> {
        let window_s = self.window_s?;
        let mut rows: Vec<usize> = self.windows().iter().map(Range::len).collect();
        rows.sort_unstable();
        let usual = rows[rows.len() / 2];
        (usual < FEWEST_ROWS).then(|| table.short_windows(window_s, usual, FEWEST_ROWS))
    }

    /// How many rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.times.len()
    }

    /// True if it has no rows (cannot come from a file).
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.times.is_empty()
    }

    /// Rows of the stretches that know nothing of one another; all rows if there is one.
    #[must_use]
    pub fn stretches(&self) -> Vec<Range<usize>> {
        ranges(&self.fresh, self.len())
    }

    /// True if `row` begins a stretch: nothing is known of the time before it.
    #[must_use]
    pub fn is_fresh(&self, row: usize) -> bool {
        self.fresh.binary_search(&row).is_ok()
    }

    /// Rows that another one of their stretch follows, with the time to that, s.
    pub fn row_times_s(&self) -> impl Iterator<Item = (usize, f64)> {
        let within = (1..self.len()).filter(|row| !self.is_fresh(*row));
        within.map(|row| (row - 1, self.times[row] - self.times[row - 1]))
    }

    /// The usual time from row to row, s: the median. `None` where no row follows another.
    #[must_use]
    pub fn usual_row_s(&self) -> Option<f64> {
        let mut steps: Vec<f64> = self.row_times_s().map(|(_, step)| step).collect();
        steps.sort_unstable_by(f64::total_cmp);
        steps.get(steps.len() / 2).copied()
    }

    /// The stretch that `row` belongs to begins with this row.
    #[must_use]
    pub fn begin_of_stretch(&self, row: usize) -> usize {
        let next = self.fresh.partition_point(|first| *first <= row);
        next.checked_sub(1).map_or(0, |i| self.fresh[i])
    }

    /// True if it has touchdowns, as far as it tells.
    #[must_use]
    pub fn has_steps(&self) -> bool {
        self.setup == Some(Setup::Walk) && (self.stance.is_empty() || self.touchdowns().next().is_some())
    }

    /// Rows at which another leg stands than in the row before, that being of the same stretch.
    pub fn touchdowns(&self) -> impl Iterator<Item = usize> {
        (1..self.stance.len()).filter(|row| !self.is_fresh(*row) && self.stance[*row] != self.stance[*row - 1])
    }

    /// Rows of each window: within a stretch, window k starts at the first row at or after t0 + k · window_s; a last
    /// piece shorter than half a window joins the one before (contract section 4).
    #[must_use]
    pub fn windows(&self) -> Vec<Range<usize>> {
        self.stretches().into_iter().flat_map(|rows| self.windows_of(rows)).collect()
    }

    fn windows_of(&self, rows: Range<usize>) -> Vec<Range<usize>> {
        let times = &self.times[rows.clone()];
        let (Some(window_s), Some(&t0), Some(&last)) = (self.window_s, times.first(), times.last()) else {
            return vec![rows];
        };
        let mut starts = vec![rows.start];
        let mut k = 1.0;
        while t0 + k * window_s <= last {
            let row = rows.start + times.partition_point(|t| *t < t0 + k * window_s - ROUNDING_S);
            if starts.last() != Some(&row) && row < rows.end {
                starts.push(row);
            }
            // A gap, or a window shorter than a row, holds no rows: on to the next one that does.
            let next = times.get(row + 1 - rows.start).map_or(k, |t| ((t - t0) / window_s).floor());
            k = next.max(k + 1.0);
        }
        // Length of the last piece: to the end of its last row's interval is not known, so to its last row.
        if let [.., _, start] = starts[..]
            && last - self.times[start] < 0.5 * window_s
        {
            starts.pop();
        }
        ranges(&starts, rows.end)
    }
}

/// From each start to the next, the last one to `end`.
fn ranges(starts: &[usize], end: usize) -> Vec<Range<usize>> {
    let ends = starts.iter().skip(1).copied().chain(std::iter::once(end));
    starts.iter().copied().zip(ends).map(|(a, b)| a..b).collect()
}

/// Rows at which the number of the stretch differs from that of the row before.
fn fresh(stretch: &[f64]) -> Vec<usize> {
    let changes = (1..stretch.len()).filter(|row| stretch[*row].to_bits() != stretch[*row - 1].to_bits());
    std::iter::once(0).chain(changes).collect()
}

/// With fewer rows than this nothing can be told apart from noise.
pub(super) const FEWEST_ROWS: usize = 10;

/// A row that misses a window's start by less belongs to it: decimal instants are not exact in binary.
const ROUNDING_S: f64 = 1e-9;
