//! How much better one model explains the data than another, noise of unknown colour and outliers allowed for.
//!
//! RT: no.

use crate::identify::noise::{Colour, estimate, loss, spread};
use crate::model::rig::{Rig, Sensor};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Residuals: per channel, per window, samples in order, missing ones left out.
pub type Residuals = Vec<Vec<Vec<f64>>>;

/// Samples per block of the bootstrap: longer than the memory of any noise model, short enough for hundreds of blocks.
const BLOCK: usize = 25;

/// Rounds of the block bootstrap.
const BOOTSTRAP_ROUNDS: usize = 400;

/// Noise of each channel: as the rig declares it where the residual agrees, else as the residual shows it. `floors`:
/// smallest standard deviations (quantisation). What stands for more than `longest_memory` samples is no noise.
#[must_use]
pub fn colours(residuals: &Residuals, floors: &[f64], rig: &Rig, longest_memory: f64) -> Vec<Colour> {
    residuals
        .iter()
        .zip(floors)
        .zip(&rig.sensors)
        .map(|((runs, floor), sensor)| {
            if !floor.is_finite() {
                return MUTE;
            }
            declared(runs, *floor, sensor).unwrap_or_else(|| shown(runs, *floor, longest_memory))
        })
        .collect()
}

/// A residual whose innovations are below this part of it is a smooth misfit, not noise: first-order noise would need a
/// pole beyond .993. Whitened, such a residual would be judged by its finest wiggles alone.
const SMOOTH: f64 = 0.12;

/// Noise as the residual shows it.
fn shown(runs: &[Vec<f64>], floor: f64, longest_memory: f64) -> Colour {
    let colour = estimate(runs, floor);
    if is_smooth(runs, &colour) || memory(&colour) > longest_memory { white_of(runs, floor) } else { colour }
}

/// For how many samples this noise stands: the gain of its filter at rest.
#[must_use]
pub fn memory(colour: &Colour) -> f64 {
    1.0 / (1.0 - colour.ar.iter().sum::<f64>()).max(1e-9)
}

fn is_smooth(runs: &[Vec<f64>], colour: &Colour) -> bool {
    let all: Vec<f64> = runs.iter().flatten().copied().collect();
    colour.sigma < SMOOTH * robust_spread(&all)
}

/// True if what `residuals` leave is smooth misfit rather than noise on any channel that carries weight.
#[must_use]
pub fn is_misfit(residuals: &Residuals, floors: &[f64]) -> bool {
    let one = |(runs, floor): (&Vec<Vec<f64>>, &f64)| floor.is_finite() && is_smooth(runs, &estimate(runs, *floor));
    residuals.iter().zip(floors).any(one)
}

fn white_of(runs: &[Vec<f64>], floor: f64) -> Colour {
    let all: Vec<f64> = runs.iter().flatten().copied().collect();
    Colour::white(robust_spread(&all).max(floor))
}

/// A residual whose sample-to-sample scatter is below this part of the declared noise is coloured noise: what is slow
/// in it may be noise as well. First-order noise with a pole of 0.3 has .79.
const COLOURED: f64 = 0.8;

/// The noise is never taken for less than the residual's spread over this: far from the right model, a loss in units of
/// the true noise would see nothing but its tails.
const FAR: f64 = 1.5;

/// White noise of the declared size, if the residual's scatter from sample to sample is of that size: all that is slow
/// in the residual is mismatch then, none of it passes for colour.
fn declared(runs: &[Vec<f64>], floor: f64, sensor: &Sensor) -> Option<Colour> {
    let std = noise_of(sensor)?.max(floor);
    let all: Vec<f64> = runs.iter().flatten().copied().collect();
    let scatter = scatter(runs);
    (scatter >= COLOURED * std).then(|| Colour::white(std.max(scatter).max(robust_spread(&all) / FAR)))
}

/// Noise and quantisation of a sensor that declares its noise.
#[must_use]
pub fn noise_of(sensor: &Sensor) -> Option<f64> {
    sensor.noise_std.filter(|s| *s > 0.0).map(|s| libm::sqrt(s * s + sensor.quantum * sensor.quantum / 12.0))
}

/// Standard deviation of the white part of a residual, by its second differences.
fn scatter(runs: &[Vec<f64>]) -> f64 {
    let bends: Vec<f64> = runs.iter().flat_map(|r| r.windows(3).map(|y| y[0] - 2.0 * y[1] + y[2])).collect();
    spread(&bends) / libm::sqrt(6.0)
}

/// A channel without weight.
const MUTE: Colour = Colour::white(f64::INFINITY);

/// White noise of the size of the residual, per channel.
#[must_use]
pub fn white(residuals: &Residuals, floors: &[f64]) -> Vec<Colour> {
    let one = |(runs, floor): (&Vec<Vec<f64>>, &f64)| {
        if floor.is_finite() { white_of(runs, *floor) } else { MUTE }
    };
    residuals.iter().zip(floors).map(one).collect()
}

/// White noise so large that the loss is a square: what smooth misfit is weighed by, as none of it is an outlier and its
/// largest errors are what a prediction will show again.
#[must_use]
pub fn squares(residuals: &Residuals, floors: &[f64]) -> Vec<Colour> {
    let one = |(runs, floor): (&Vec<Vec<f64>>, &f64)| {
        let count = runs.iter().map(Vec::len).sum::<usize>().max(1) as f64;
        let rms = libm::sqrt(runs.iter().flatten().map(|x| x * x).sum::<f64>() / count);
        if floor.is_finite() { Colour::white(SQUARE * rms.max(*floor)) } else { MUTE }
    };
    residuals.iter().zip(floors).map(one).collect()
}

/// Root mean squares below which the loss is a square.
const SQUARE: f64 = 3.0;

fn robust_spread(all: &[f64]) -> f64 {
    // The robust spread, but never below a third of the plain one: a mismatch that lives in a few places is no outlier.
    let rms = libm::sqrt(all.iter().map(|x| x * x).sum::<f64>() / all.len().max(1) as f64);
    spread(all).max(rms / 3.0)
}

/// Twice the log-likelihood of each block of samples under a noise model, but for a constant.
#[must_use]
pub fn blocks(residuals: &Residuals, noise: &[Colour]) -> Vec<f64> {
    let mut out = Vec::new();
    for (runs, colour) in residuals.iter().zip(noise) {
        if !(colour.sigma > 0.0 && colour.sigma.is_finite()) {
            continue;
        }
        let base = -2.0 * libm::log(colour.sigma);
        for run in runs {
            let mut e = run.clone();
            colour.whiten(&mut e, &(0..run.len()).collect::<Vec<_>>());
            out.extend(e.chunks(BLOCK).map(|c| c.iter().map(|x| base - loss(*x)).sum::<f64>()));
        }
    }
    out
}

/// Number of samples that carry weight.
#[must_use]
pub fn samples(residuals: &Residuals, floors: &[f64]) -> usize {
    residuals
        .iter()
        .zip(floors)
        .filter(|(_, f)| f.is_finite())
        .map(|(r, _)| r.iter().map(Vec::len).sum::<usize>())
        .sum()
}

/// Sum of the differences `a - b` with the lower and upper bound of a block bootstrap (2.5 and 97.5 %).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// Sum over all blocks.
    pub total: f64,
    /// 2.5 % point.
    pub low: f64,
    /// 97.5 % point.
    pub high: f64,
    /// Standard deviation of the sum.
    pub std: f64,
}

/// Compares two models block by block.
#[must_use]
pub fn difference(a: &[f64], b: &[f64], seed: u64) -> Difference {
    let d: Vec<f64> = a.iter().zip(b).map(|(x, y)| x - y).collect();
    let total: f64 = d.iter().sum();
    if d.is_empty() {
        return Difference { total: 0.0, low: 0.0, high: 0.0, std: 0.0 };
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut sums: Vec<f64> =
        (0..BOOTSTRAP_ROUNDS).map(|_| (0..d.len()).map(|_| d[rng.random_range(0..d.len())]).sum::<f64>()).collect();
    sums.sort_by(f64::total_cmp);
    let mean = total / d.len() as f64;
    let variance = d.iter().map(|x| (x - mean).powi(2)).sum::<f64>();
    Difference {
        total,
        low: sums[BOOTSTRAP_ROUNDS / 40],
        high: sums[BOOTSTRAP_ROUNDS - 1 - BOOTSTRAP_ROUNDS / 40],
        std: libm::sqrt(variance),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_that_is_better_everywhere_is_surely_better() {
        let (a, b): (Vec<f64>, Vec<f64>) =
            ((0..100).map(f64::from).collect(), (0..100).map(|x| f64::from(x) - 1.0).collect());
        let d = difference(&a, &b, 1);
        assert!((d.total - 100.0).abs() < 1e-9 && d.low > 99.0);
    }

    #[test]
    fn a_model_that_is_better_by_chance_is_not() {
        let a: Vec<f64> = (0..100).map(|k| if k % 2 == 0 { 10.0 } else { -9.9 }).collect();
        let d = difference(&a, &[0.0; 100], 1);
        assert!(d.low < 0.0 && d.high > 0.0, "{d:?}");
    }
}
