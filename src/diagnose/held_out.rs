//! Recordings that no fit saw, asked whether what was found holds there.
//!
//! An effect that only bends to the recordings it was fitted to costs elsewhere: a limit of a drive on top of the friction that
//! is the truth, a bristle on top of a leg's Coulomb friction. Nothing is fitted here but how each window begins.
//! RT: no.

use crate::diagnose::likelihood::{Residuals, white};
use crate::diagnose::outliers::clean;
use crate::identify::experiment::{Experiment, Recording};
use crate::identify::rollout::{FreeRun, Pooled, free_run};
use crate::model::rig::{Rig, Use};
use rayon::prelude::*;

/// The recordings that were kept back.
#[derive(Clone, Debug)]
pub struct HeldOut {
    recordings: Vec<Recording>,
    pooled: Pooled,
}

impl HeldOut {
    /// Those of `experiment`, without the samples that `rig` shows to be transmission errors. `None` if none was kept back.
    #[must_use]
    pub fn of(experiment: &Experiment, rig: &Rig) -> Option<Self> {
        let recordings: Vec<Recording> = experiment.of_use(Use::Heldout).cloned().collect();
        if recordings.is_empty() {
            return None;
        }
        let pooled = Pooled::of(rig, recordings.iter());
        Some(Self { recordings: clean(rig, recordings).0, pooled })
    }

    /// What the free runs of `rig` leave, window by window. `None` if it runs away on one of the recordings.
    #[must_use]
    pub fn residuals(&self, rig: &Rig) -> Option<Residuals> {
        let run = |recording: &Recording| free_run(rig, recording, &self.pooled).ok();
        let runs: Vec<FreeRun> = self.recordings.par_iter().map(run).collect::<Option<_>>()?;
        let channel = |c: usize| -> Vec<Vec<f64>> {
            let of = |(recording, run): (&Recording, &FreeRun)| {
                let error = |k: usize| run.predicted[c][k] - recording.measured[c][k];
                let window = |rows: std::ops::Range<usize>| rows.map(error).filter(|x| x.is_finite()).collect();
                recording.windows().into_iter().map(window).collect::<Vec<Vec<f64>>>()
            };
            self.recordings.iter().zip(&runs).flat_map(of).collect()
        };
        Some((0..rig.sensors.len()).map(channel).collect())
    }
}

/// What an effect does to predictions, in squares of the noise that the better of two models leaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Confirmation {
    /// Squares of the change that it makes: by so much the error falls where the change is the truth, and rises where there is
    /// nothing of the kind.
    pub promised: f64,
    /// By how much the error falls.
    pub gained: f64,
}

impl Confirmation {
    /// Of the effect that the one model has and the other has not.
    #[must_use]
    pub fn of(with: &Residuals, without: &Residuals, floors: &[f64]) -> Self {
        let mut out = Self { promised: 0.0, gained: 0.0 };
        let noises = white(with, floors).into_iter().zip(white(without, floors));
        for ((with, without), (a, b)) in with.iter().zip(without).zip(noises) {
            let sigma = a.sigma.min(b.sigma);
            if !(sigma > 0.0 && sigma.is_finite()) {
                continue;
            }
            for (x, y) in with.iter().flatten().zip(without.iter().flatten()) {
                out.promised += ((x - y) / sigma).powi(2);
                out.gained += (y * y - x * x) / (sigma * sigma);
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::synthesis::{SHAKEN_PENDULUM, shaken_pendulum};

    const DRAG: &str = "[[effect]]\neffect = \"quadratic_drag\"\nat = \"q1\"\nquadratic = 0.004\n";

    #[test]
    fn what_is_not_there_predicts_worse_and_what_is_there_leaves_the_noise() {
        let experiment = shaken_pendulum();
        let held_out = HeldOut::of(&experiment, &experiment.rig).unwrap();
        let truth = held_out.residuals(&experiment.rig).unwrap();
        assert_eq!((truth.len(), truth[0].len(), truth[0][0].len()), (1, 1, 400), "the one that was kept back");
        let rms = libm::sqrt(truth[0][0].iter().map(|x| x * x).sum::<f64>() / 400.0);
        assert!((rms / 0.001 - 1.0).abs() < 0.15, "{rms}");
        let dragged =
            Rig::parse(&SHAKEN_PENDULUM.replacen("[[recording]]", &format!("{DRAG}[[recording]]"), 1), "rig.toml")
                .unwrap();
        let wrong = held_out.residuals(&dragged).unwrap();
        let Confirmation { promised, gained } = Confirmation::of(&wrong, &truth, &[1e-6]);
        assert!(promised > 400.0 && (gained / promised + 1.0).abs() < 0.1, "{promised} {gained}");
        let Confirmation { promised, gained } = Confirmation::of(&truth, &wrong, &[1e-6]);
        assert!((gained / promised - 1.0).abs() < 0.1, "the other way round: {promised} {gained}");
    }

    #[test]
    fn nothing_kept_back_says_nothing() {
        let mut experiment = shaken_pendulum();
        experiment.recordings.truncate(1);
        assert!(HeldOut::of(&experiment, &experiment.rig).is_none());
    }
}
