//! Free runs of a rig against a recording, with exact sensitivities.
//!
//! A free run follows the recorded inputs, restarts at each window ([`Recording::windows`]) and fits nothing but the
//! initial state of each window (contract section 4). Sensitivities are forward dual numbers through the whole machine,
//! events included; nothing is differenced.
//!
//! ```text
//! let mut theta = Theta::of(&rig);                       // what is uncertain
//! let pooled = Pooled::of(&rig, experiment.of_use(Use::Fit));
//! loop {
//!     let rig = theta.applied(&rig);
//!     let rollout = Rollout::new(&rig, &recording, Fidelity::default())?;
//!     for w in 0..rollout.windows().len() {              // independent of each other: rayon
//!         let x0 = rollout.fit_initial(w, &weights, &guess[w])?;
//!         rollout.linearise(&theta, w, &x0, &mut lin)?;  // residual and Jacobian of this window
//!         ...accumulate into JᵀJ...
//!     }
//! }
//! ```
//! A sensor with a delay or a fast clock reads the motion before the window's start; there the motion is run backwards
//! from the initial state in its present modes.
//! RT: no.

mod initial;
mod pooled;
mod run;
#[cfg(test)]
mod tests;

use super::effort::Effort;
use super::experiment::Recording;
use super::theta::Theta;
use crate::base::scalar::{Dual, Scalar};
use crate::model::machine::{Inner, Machine, MachineError};
use crate::model::rig::{Rig, Slot};
use crate::model::setting::{Number, Setting};
use rayon::prelude::*;
use std::borrow::Cow;
use std::ops::Range;

pub use pooled::Pooled;

/// How finely a run is integrated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fidelity {
    /// Steps are this many times shorter than the rule of the machine says. 4 against 1 is the numerical floor.
    pub refine: u32,
}

impl Default for Fidelity {
    fn default() -> Self {
        Self { refine: 1 }
    }
}

/// Why a free run cannot be made or did not end.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RolloutError {
    /// The rig asks for something that this machine cannot do.
    #[error("{0}")]
    Unsupported(String),
    /// The state left all bounds: an unstable mechanism without windows, or impossible parameters.
    #[error("{recording}: the simulation diverged at t = {time_s:.3} s; give the recording a shorter `window_s`")]
    Diverged {
        /// Which recording.
        recording: String,
        /// When.
        time_s: f64,
    },
    /// More steps than this piece of work is worth.
    #[error("the simulation needs too many steps")]
    TooCostly,
}

/// What a window's simulation reads: one list per sensor of the rig, one number per row of the window.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Readings {
    /// Predicted samples, before quantisation.
    pub channels: Vec<Vec<f64>>,
}

/// A window's residual and its derivatives.
///
/// Row `channel * rows + r` is sample `r` of the window on that channel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Linearised {
    /// Samples per channel.
    pub rows: usize,
    /// Derivatives per row: first those by theta, then those by the window's initial state.
    pub columns: usize,
    /// Measured - predicted; NaN where there is no sample.
    pub residual: Vec<f64>,
    /// Derivative of the *prediction*, row after row of `columns` numbers.
    pub jacobian: Vec<f64>,
}

/// A recording made ready for free runs of a rig. Cheap to build: it borrows the data.
#[derive(Debug)]
pub struct Rollout<'r> {
    recording: &'r Recording,
    setting: Cow<'r, Setting>,
    /// Numbers that differ from those of the setting.
    moved: Vec<(Slot, f64)>,
    windows: Vec<Range<usize>>,
    fidelity: Fidelity,
    /// Where runs are counted, if anyone wants to know.
    effort: Option<&'r Effort>,
}

/// Directions carried by one run: few enough to stay in registers and cache, many enough to share the values' cost.
const LANES: usize = 8;

impl<'r> Rollout<'r> {
    /// Builds the machine of `rig` for `recording` (which must have been read for this rig, or for one that differs in
    /// values and effects only).
    ///
    /// # Errors
    /// The rig asks for something the machine cannot do.
    pub fn new(rig: &Rig, recording: &'r Recording, fidelity: Fidelity) -> Result<Self, RolloutError> {
        let setting = Cow::Owned(Setting::of(rig, Some(recording.index), recording.setup));
        let rollout =
            Self { recording, setting, moved: Vec::new(), windows: recording.windows(), fidelity, effort: None };
        rollout.plain_machine()?;
        Ok(rollout)
    }

    /// The one window `rows` of `recording` in a setting that is known already, with other numbers of `theta`. What a
    /// fit does thousands of times: nothing is built here.
    #[must_use]
    pub fn of_window(
        setting: &'r Setting,
        theta: &Theta,
        recording: &'r Recording,
        rows: Range<usize>,
        fidelity: Fidelity,
    ) -> Self {
        let moved = theta.entries.iter().map(|e| e.slot).zip(theta.values.iter().copied()).collect();
        Self { recording, setting: Cow::Borrowed(setting), moved, windows: vec![rows], fidelity, effort: None }
    }

    /// The same, its runs counted.
    #[must_use]
    pub fn counted(self, effort: &'r Effort) -> Self {
        Self { effort: Some(effort), ..self }
    }

    /// The recording.
    #[must_use]
    pub const fn recording(&self) -> &'r Recording {
        self.recording
    }

    /// Rows of each window.
    #[must_use]
    pub fn windows(&self) -> &[Range<usize>] {
        &self.windows
    }

    /// Numbers of the initial state of a window: coordinates, rates, then inner states of effects (deflections, lags).
    #[must_use]
    pub fn initial_len(&self) -> usize {
        self.plain_machine().map_or(0, |machine| machine.initial_layout().len())
    }

    /// How many of these are coordinates and rates, which come first.
    #[must_use]
    pub fn rigid_len(&self) -> usize {
        let is_rigid = |what: &Inner| matches!(what, Inner::Coordinate(_) | Inner::Rate(_));
        self.plain_machine().map_or(0, |machine| machine.initial_layout().iter().filter(|w| is_rigid(w)).count())
    }

    /// Runs one window from `initial`.
    ///
    /// # Errors
    /// The simulation diverged.
    pub fn simulate(&self, window: usize, initial: &[f64], out: &mut Readings) -> Result<(), RolloutError> {
        let rows = self.windows[window].clone();
        let mut machine = self.plain_machine()?;
        out.channels = vec![vec![0.0; rows.len()]; self.setting.sensors.len()];
        let channels = &mut out.channels;
        self.run(&mut machine, rows, initial, &mut |channel, row, y: f64| channels[channel][row] = y)
    }

    /// Where one window's run from `initial` is when the next window starts; `None` after the last row of a stretch.
    ///
    /// # Errors
    /// The simulation diverged.
    pub fn arrived(&self, window: usize, initial: &[f64]) -> Result<Option<Vec<f64>>, RolloutError> {
        let rows = self.windows[window].clone();
        if rows.end >= self.recording.len() || self.recording.is_fresh(rows.end) {
            return Ok(None);
        }
        let mut machine = self.plain_machine()?;
        self.run(&mut machine, rows.start..rows.end + 1, initial, &mut |_, _, _: f64| {})?;
        Ok(Some(machine.state()))
    }

    /// Runs one window from `initial` and differentiates by all of `theta` and by `initial`.
    ///
    /// # Errors
    /// The simulation diverged.
    pub fn linearise(
        &self,
        theta: &Theta,
        window: usize,
        initial: &[f64],
        out: &mut Linearised,
    ) -> Result<(), RolloutError> {
        self.linearise_beyond(0, theta, window, initial, out)
    }

    /// As [`Self::linearise`], but the first `held` numbers of the initial state are no directions: columns are those
    /// of theta, then those of the rest of the initial state.
    ///
    /// # Errors
    /// The simulation diverged.
    pub fn linearise_beyond(
        &self,
        held: usize,
        theta: &Theta,
        window: usize,
        initial: &[f64],
        out: &mut Linearised,
    ) -> Result<(), RolloutError> {
        let slots: Vec<Slot> = self.setting.slots().collect();
        let mut directions: Vec<Direction> = Vec::new();
        let active = theta.entries.iter().enumerate().filter(|(_, e)| slots.contains(&e.slot));
        directions.extend(active.map(|(column, e)| Direction { column, what: What::Slot(e.slot) }));
        let states = held.min(initial.len())..initial.len();
        let column = |i: usize| theta.len() + i - states.start;
        directions.extend(states.clone().map(|i| Direction { column: column(i), what: What::Initial(i) }));
        self.prepare(window, theta.len() + states.len(), out);
        if directions.is_empty() {
            return self.residuals(window, initial, out);
        }
        for chunk in directions.chunks(LANES) {
            match chunk.len() {
                1 | 2 => self.run_chunk::<2>(chunk, window, initial, out)?,
                3 | 4 => self.run_chunk::<4>(chunk, window, initial, out)?,
                5 | 6 => self.run_chunk::<6>(chunk, window, initial, out)?,
                _ => self.run_chunk::<LANES>(chunk, window, initial, out)?,
            }
        }
        Ok(())
    }

    fn prepare(&self, window: usize, columns: usize, out: &mut Linearised) {
        let rows = self.windows[window].len();
        let samples = rows * self.setting.sensors.len();
        out.rows = rows;
        out.columns = columns;
        out.residual.clear();
        out.residual.resize(samples, f64::NAN);
        out.jacobian.clear();
        out.jacobian.resize(samples * columns, 0.0);
    }

    fn residuals(&self, window: usize, initial: &[f64], out: &mut Linearised) -> Result<(), RolloutError> {
        let range = self.windows[window].clone();
        let (start, rows) = (range.start, out.rows);
        let mut machine = self.plain_machine()?;
        self.run(&mut machine, range, initial, &mut |channel, row, y: f64| {
            out.residual[channel * rows + row] = self.recording.measured[channel][start + row] - y;
        })
    }

    /// Runs with the directions of `chunk` and writes their columns.
    fn run_chunk<const N: usize>(
        &self,
        chunk: &[Direction],
        window: usize,
        initial: &[f64],
        out: &mut Linearised,
    ) -> Result<(), RolloutError> {
        let lane_of = |what: What| chunk.iter().position(|d| d.what == what);
        let lift = |x: f64, what: What| match lane_of(what) {
            Some(lane) => Dual::<N>::variable(x, lane),
            None => Dual::constant(x),
        };
        let mut machine = self.machine(&|n: &Number| match n.slot {
            Some(slot) => lift(self.value(n), What::Slot(slot)),
            None => Dual::constant(n.value),
        })?;
        let initial: Vec<Dual<N>> = initial.iter().enumerate().map(|(i, x)| lift(*x, What::Initial(i))).collect();
        let range = self.windows[window].clone();
        let (start, rows, columns) = (range.start, out.rows, out.columns);
        self.run(&mut machine, range, &initial, &mut |channel, row, y: Dual<N>| {
            let sample = channel * rows + row;
            out.residual[sample] = self.recording.measured[channel][start + row] - y.v;
            for (direction, slope) in chunk.iter().zip(y.d) {
                out.jacobian[sample * columns + direction.column] = slope;
            }
        })
    }

    /// A number of the setting, or what it was moved to.
    fn value(&self, number: &Number) -> f64 {
        let moved = self.moved.iter().find(|(slot, _)| number.slot == Some(*slot));
        moved.map_or(number.value, |(_, value)| *value)
    }

    fn plain_machine(&self) -> Result<Machine<f64>, RolloutError> {
        self.machine(&|n: &Number| self.value(n))
    }

    fn machine<S: Scalar>(&self, lift: &dyn Fn(&Number) -> S) -> Result<Machine<S>, RolloutError> {
        Machine::new(&self.setting, lift, self.fidelity.refine).map_err(|e| self.error(&e))
    }

    fn error(&self, error: &MachineError) -> RolloutError {
        match error {
            MachineError::Unsupported(text) => RolloutError::Unsupported(text.clone()),
            MachineError::Diverged(time_s) => {
                RolloutError::Diverged { recording: self.recording.name.clone(), time_s: *time_s }
            }
        }
    }
}

/// What a run is differentiated by, and the column it goes to.
#[derive(Clone, Copy, Debug)]
struct Direction {
    column: usize,
    what: What,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum What {
    Slot(Slot),
    Initial(usize),
}

/// A free run over all windows of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct FreeRun {
    /// One list per sensor, one number per row of the recording.
    pub predicted: Vec<Vec<f64>>,
    /// Fitted initial state of each window.
    pub initial: Vec<Vec<f64>>,
    /// RMSE / pooled standard deviation of each channel; none where the channel is only noise or has no samples.
    pub nrmse: Vec<Option<f64>>,
}

/// The free run of contract section 4.
///
/// # Errors
/// See [`RolloutError`].
pub fn free_run(rig: &Rig, recording: &Recording, pooled: &Pooled) -> Result<FreeRun, RolloutError> {
    let rollout = Rollout::new(rig, recording, Fidelity::default())?;
    let weights = pooled.weights(rig, recording);
    let one = |window: usize| {
        let initial = rollout.fit_initial(window, &weights, &rollout.guess(window))?;
        let mut readings = Readings::default();
        rollout.simulate(window, &initial, &mut readings)?;
        Ok((initial, readings))
    };
    let mut parts: Vec<(Vec<f64>, Readings)> =
        (0..rollout.windows().len()).into_par_iter().map(one).collect::<Result<_, RolloutError>>()?;
    for window in 1..parts.len() {
        if let Some(initial) = rollout.fit_initial_after(window, &weights, &parts[window - 1].0, &parts[window].0)? {
            let mut readings = Readings::default();
            rollout.simulate(window, &initial, &mut readings)?;
            parts[window] = (initial, readings);
        }
    }
    let mut run = FreeRun {
        predicted: vec![Vec::with_capacity(recording.len()); rig.sensors.len()],
        initial: Vec::with_capacity(parts.len()),
        nrmse: Vec::new(),
    };
    for (initial, readings) in parts {
        for (all, part) in run.predicted.iter_mut().zip(&readings.channels) {
            all.extend_from_slice(part);
        }
        run.initial.push(initial);
    }
    run.nrmse = pooled.nrmse(&weights, recording, &run.predicted);
    Ok(run)
}
