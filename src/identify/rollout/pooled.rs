//! Standard deviations that make errors of different channels comparable. RT: no.

use crate::identify::experiment::Recording;
use crate::model::rig::{MechanismKind, Rig, Setup};

/// Standard deviation of each channel over the recordings of one use, the mean of each recording taken out
/// (so the published reference errors were made; agreement 1e-5).
#[derive(Clone, Debug, PartialEq)]
pub struct Pooled {
    /// One per sensor; NaN if the channel has no samples.
    pub std: Vec<f64>,
}

impl Pooled {
    /// Over these recordings, which should be those of one use.
    #[must_use]
    pub fn of<'a>(rig: &Rig, recordings: impl Iterator<Item = &'a Recording>) -> Self {
        let mut sums = vec![(0.0, 0.0, 0.0_f64); rig.sensors.len()];
        for recording in recordings {
            for (sum, samples) in sums.iter_mut().zip(&recording.measured) {
                let (count, mean) = count_and_mean(samples);
                sum.0 += count;
                sum.1 += samples.iter().filter(|x| !x.is_nan()).map(|x| (x - mean) * (x - mean)).sum::<f64>();
                sum.2 = samples.iter().filter(|x| !x.is_nan()).fold(sum.2, |most, x| most.max(x.abs()));
            }
        }
        let std = |(count, squares, most): &(f64, f64, f64)| {
            let std = libm::sqrt(squares / count);
            // The mean of a constant is rounded: what it leaves is no spread.
            if std <= ROUNDING * most { 0.0 } else { std }
        };
        Self { std: sums.iter().map(std).collect() }
    }

    /// Weight of each channel of a recording: 1 / std, or 0 where it has no samples or is only noise.
    #[must_use]
    pub fn weights(&self, rig: &Rig, recording: &Recording) -> Vec<f64> {
        let channels = rig.sensors.iter().zip(&recording.measured).zip(&self.std);
        channels
            .map(|((sensor, samples), std)| {
                let held = is_held(rig.mechanism, recording.setup, sensor.joint);
                let usable = *std > 0.0 && !held && !is_white(samples);
                if usable { 1.0 / std } else { 0.0 }
            })
            .collect()
    }

    /// RMSE / std of each channel that has a weight.
    #[must_use]
    pub fn nrmse(&self, weights: &[f64], recording: &Recording, predicted: &[Vec<f64>]) -> Vec<Option<f64>> {
        let channels = weights.iter().zip(&recording.measured).zip(predicted);
        channels.map(|((weight, y), p)| (*weight > 0.0).then(|| rmse(y, p) * weight)).collect()
    }
}

/// Relative rounding of a mean over many samples, with a margin.
const ROUNDING: f64 = 1e-12;

/// Root of the mean squared difference over the samples that exist.
#[must_use]
pub(crate) fn rmse(measured: &[f64], predicted: &[f64]) -> f64 {
    let pairs = measured.iter().zip(predicted).filter(|(y, _)| !y.is_nan());
    let (count, sum) = pairs.fold((0.0, 0.0), |(n, s), (y, p)| (n + 1.0, s + (y - p) * (y - p)));
    libm::sqrt(sum / count)
}

fn count_and_mean(samples: &[f64]) -> (f64, f64) {
    let present = samples.iter().filter(|x| !x.is_nan());
    let (count, sum) = present.fold((0.0, 0.0), |(n, s), x| (n + 1.0, s + x));
    (count, sum / count)
}

/// True if the set-up holds coordinate `joint`.
fn is_held(mechanism: MechanismKind, setup: Option<Setup>, joint: usize) -> bool {
    mechanism == MechanismKind::CompassGait
        && matches!(
            (setup, joint),
            (Some(Setup::InnerFixed), 0) | (Some(Setup::OuterFixed), 1) | (Some(Setup::Parallel), 2)
        )
}

/// True if the samples are white: neighbours differ as much as strangers (lag-one correlation below this).
fn is_white(samples: &[f64]) -> bool {
    let (count, mean) = count_and_mean(samples);
    if count < 3.0 {
        return true;
    }
    let present: Vec<f64> = samples.iter().copied().filter(|x| !x.is_nan()).map(|x| x - mean).collect();
    let variance: f64 = present.iter().map(|x| x * x).sum();
    let neighbours: f64 = present.windows(2).map(|p| p[0] * p[1]).sum();
    variance <= 0.0 || neighbours < WHITE * variance
}

/// A motion sampled fast enough to be simulated has more than .9.
const WHITE: f64 = 0.3;
