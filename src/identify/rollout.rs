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
//! RT: no.

use super::experiment::Recording;
use super::theta::Theta;
use crate::model::rig::Rig;
use std::ops::Range;

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

/// Standard deviation of each channel over the recordings of one use, the mean of each recording taken out.
#[derive(Clone, Debug, PartialEq)]
pub struct Pooled {
    /// One per sensor; NaN if the channel has no samples.
    pub std: Vec<f64>,
}

/// A recording made ready for free runs of a rig. Cheap to build: it borrows the data.
#[derive(Debug)]
pub struct Rollout<'r> {
    recording: &'r Recording,
    windows: Vec<Range<usize>>,
}

impl<'r> Rollout<'r> {
    /// Builds the machine of `rig` for `recording` (which must have been read for this rig, or for one that differs in
    /// values and effects only).
    ///
    /// # Errors
    /// The rig asks for something the machine cannot do.
    pub fn new(rig: &Rig, recording: &'r Recording, fidelity: Fidelity) -> Result<Self, RolloutError> {
        let _ = fidelity;
        let kind = rig.mechanism.id();
        let rollout = Self { recording, windows: recording.windows() };
        if rollout.windows.is_empty() || !kind.is_empty() {
            return Err(RolloutError::Unsupported(format!("mechanism {kind} does not run yet")));
        }
        Ok(rollout)
    }

    /// Rows of each window.
    #[must_use]
    pub fn windows(&self) -> &[Range<usize>] {
        &self.windows
    }

    /// Numbers of the initial state of a window: coordinates, rates, then inner states of effects (deflections, lags).
    #[must_use]
    pub fn initial_len(&self) -> usize {
        0
    }

    /// A start for [`Self::fit_initial`], from the samples at the beginning of the window.
    #[must_use]
    pub fn guess(&self, window: usize) -> Vec<f64> {
        let _ = window;
        Vec::new()
    }

    /// Runs one window from `initial`.
    ///
    /// # Errors
    /// The simulation diverged.
    pub fn simulate(&self, window: usize, initial: &[f64], out: &mut Readings) -> Result<(), RolloutError> {
        let _ = (window, initial, &self.recording.name);
        out.channels.clear();
        Ok(())
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
        let _ = (theta, window, initial);
        out.residual.clear();
        Ok(())
    }

    /// The initial state that fits the window best, each channel multiplied by its weight (1 / pooled deviation; 0 for a
    /// channel that is only noise).
    ///
    /// # Errors
    /// The simulation diverged from every start.
    pub fn fit_initial(&self, window: usize, weights: &[f64], start: &[f64]) -> Result<Vec<f64>, RolloutError> {
        let _ = (window, weights);
        Ok(start.to_vec())
    }
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
    let initial = (0..rollout.windows().len()).map(|w| rollout.guess(w)).collect();
    Ok(FreeRun { predicted: Vec::new(), initial, nrmse: vec![None; pooled.std.len()] })
}
