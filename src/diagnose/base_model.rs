//! The base: the rig as given, its numbers fitted to the recordings of a case, or why there is none.
//!
//! RT: no.

use crate::identify::base_fit::{fit_recordings, floors};
use crate::identify::computed::computed_inputs;
use crate::identify::experiment::{Experiment, Recording};
use crate::identify::fit::Limits;
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::white;
use crate::identify::rollout::{Pooled, RolloutError, free_run};
use crate::identify::units::wrong_units;
use crate::model::rig::Use;
use std::sync::Arc;

/// Why there is no answer.
#[derive(Debug, thiserror::Error)]
pub enum DiagnoseError {
    /// Nothing to fit on.
    #[error("no recording with use = \"fit\": mark at least one in rig.toml")]
    NothingToFit,
    /// No channel moves.
    #[error("no column of the fit recordings carries a signal: nothing can be told; record motion\n{0}")]
    NoSignal(String),
    /// Columns in the wrong unit.
    #[error("{}", .0.join("\n"))]
    Units(Vec<String>),
    /// Inputs that are control errors.
    #[error("{}", .0.join("\n"))]
    Computed(Vec<String>),
    /// The machine does not run.
    #[error(transparent)]
    Run(#[from] RolloutError),
    /// A supposed effect has no such place in this rig.
    #[error("`{effect}`: this rig has no such place; must be one of: {places}")]
    NoPlace {
        /// As typed.
        effect: String,
        /// Where it may stand.
        places: String,
    },
    /// A supposed effect cannot be added.
    #[error("`{0}`: stands in rig.toml already, and its free numbers are fitted")]
    AlreadyThere(String),
    /// There is no start for a supposed effect.
    #[error("`{0}`: the recordings give no start for a fit with it")]
    NoStart(String),
    /// All fits with a supposed effect leave the finite numbers.
    #[error("`{0}`: every fit with it diverges")]
    AddedDiverges(String),
    /// The base model leaves the finite numbers from every start.
    #[error("the base model diverges on the fit recordings; shorten `window_s` or check units and signs in rig.toml")]
    Diverges,
}

/// What a fit starts from: its recordings, the spread of their channels and the smallest residuals.
pub(in crate::diagnose) fn ready(experiment: &Experiment) -> Result<(Vec<Recording>, Pooled, Vec<f64>), DiagnoseError> {
    let recordings = fit_recordings(experiment);
    if recordings.is_empty() {
        return Err(DiagnoseError::NothingToFit);
    }
    let pooled = Pooled::of(&experiment.rig, experiment.of_use(Use::Fit));
    let floors = floors(&experiment.rig, &pooled, &recordings);
    let wrong: Vec<String> = experiment.recordings.iter().flat_map(|r| wrong_units(&experiment.rig, r)).collect();
    if !wrong.is_empty() {
        return Err(DiagnoseError::Units(wrong));
    }
    let computed: Vec<String> =
        experiment.recordings.iter().flat_map(|r| computed_inputs(&experiment.rig, r)).collect();
    if !computed.is_empty() {
        return Err(DiagnoseError::Computed(computed));
    }
    if floors.iter().any(|floor| floor.is_finite()) {
        return Ok((recordings, pooled, floors));
    }
    let why: Vec<&str> = recordings.iter().flat_map(|r| &r.warnings).map(String::as_str).collect();
    Err(DiagnoseError::NoSignal(why.join("\n")))
}

/// The base fit once more on cleaned recordings.
#[must_use]
pub(in crate::diagnose) fn again(first: &FittedModel, recordings: &[Recording], floors: &[f64]) -> Option<FittedModel> {
    let mut problem = first.problem.clone();
    problem.recordings = Arc::new(recordings.to_vec());
    let noise = white(&first.residuals, floors);
    let now = FittedModel::fitted(problem, first.point.clone(), &noise, floors, Limits::default())?;
    let finer = now.polished(&now.noise, floors, Limits { iterations: 8, tolerance: 1e-6 });
    Some(finer.filter(|f| f.likelihood > now.likelihood).unwrap_or(now))
}

/// The recording on which the rig as given runs away, and when: what a person can mend.
pub(in crate::diagnose) fn runaway(experiment: &Experiment, pooled: &Pooled) -> DiagnoseError {
    let runs = experiment.of_use(Use::Fit).map(|recording| free_run(&experiment.rig, recording, pooled));
    runs.filter_map(Result::err).next().map_or(DiagnoseError::Diverges, DiagnoseError::Run)
}

/// What was odd in the input. `dropped`: how many samples were left out.
pub(in crate::diagnose) fn warnings(experiment: &Experiment, dropped: usize) -> Vec<String> {
    let mut out: Vec<String> = experiment.recordings.iter().flat_map(|r| r.warnings.clone()).collect();
    if dropped > 0 {
        out.push(format!(
            "{dropped} single samples stick out of their neighbours like transmission errors; left out of fit and comparison"
        ));
    }
    out
}
