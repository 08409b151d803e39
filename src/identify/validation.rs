//! Proof: free runs of the three models on every recording, and the figures that contract §4 asks for.
//!
//! RT: no.

use crate::identify::experiment::{Experiment, Recording};
use crate::identify::rollout::{FreeRun, Pooled, RolloutError, free_run};
use crate::model::rig::{Rig, Use};
use crate::report::findings::{Figure, Trace};
use rayon::prelude::*;

/// The three models that are compared.
#[derive(Clone, Copy, Debug)]
pub struct Models<'r> {
    /// As in the case.
    pub given: &'r Rig,
    /// Parameters fitted again.
    pub refitted: &'r Rig,
    /// With the effects that were found.
    pub explained: &'r Rig,
}

/// Figures and signals of all recordings.
///
/// The model as given may run away where it is far off; its error is infinite then.
///
/// # Errors
/// One of the other two models does not run on a recording.
pub fn proof(experiment: &Experiment, models: Models<'_>) -> Result<(Vec<Figure>, Vec<Trace>), RolloutError> {
    let pooled = [Use::Fit, Use::Heldout].map(|u| Pooled::of(&experiment.rig, experiment.of_use(u)));
    let one = |recording: &Recording| {
        let pooled = &pooled[usize::from(recording.usage == Use::Heldout)];
        let run = |rig: &Rig| free_run(rig, recording, pooled);
        let same = models.refitted == models.explained;
        let refitted = run(models.refitted)?;
        let given = match run(models.given) {
            Err(RolloutError::Diverged { .. }) => ran_away(&refitted),
            other => other?,
        };
        let explained = if same { refitted.clone() } else { run(models.explained)? };
        Ok(lines(experiment, recording, [&given, &refitted, &explained]))
    };
    let parts: Vec<_> = experiment.recordings.par_iter().map(one).collect::<Result<_, _>>()?;
    let (figures, traces): (Vec<_>, Vec<_>) = parts.into_iter().unzip();
    Ok((figures.concat(), traces.concat()))
}

/// A run like `other` of which nothing is left.
fn ran_away(other: &FreeRun) -> FreeRun {
    FreeRun {
        predicted: other.predicted.iter().map(|channel| vec![f64::NAN; channel.len()]).collect(),
        initial: other.initial.clone(),
        nrmse: other.nrmse.iter().map(|error| error.map(|_| f64::INFINITY)).collect(),
    }
}

fn lines(experiment: &Experiment, recording: &Recording, runs: [&FreeRun; 3]) -> (Vec<Figure>, Vec<Trace>) {
    let use_ = if recording.usage == Use::Fit { "fit" } else { "heldout" };
    let (mut figures, mut traces) = (Vec::new(), Vec::new());
    for (c, sensor) in experiment.rig.sensors.iter().enumerate() {
        let [Some(given), Some(refitted), Some(explained)] = runs.map(|r| r.nrmse[c]) else { continue };
        let (name, channel) = (recording.name.clone(), sensor.column.clone());
        figures.push(Figure {
            recording: name.clone(),
            use_: use_.into(),
            channel: channel.clone(),
            nrmse_given: given,
            nrmse_refitted: refitted,
            nrmse_explained: explained,
        });
        traces.push(Trace {
            recording: name,
            use_: use_.into(),
            channel,
            unit: sensor.unit(experiment.rig.mechanism),
            t_s: recording.times.clone(),
            measured: recording.measured[c].clone(),
            given: runs[0].predicted[c].clone(),
            refitted: runs[1].predicted[c].clone(),
            explained: runs[2].predicted[c].clone(),
        });
    }
    (figures, traces)
}
