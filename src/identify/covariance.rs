//! How far fitted numbers may be off: the information that intervals come from.
//!
//! The normal matrix of a fit would be the inverse covariance if the whitened residual were white, Gauss and not fitted.
//! Three things make it too large: a robust loss uses less of the data than squares would; what was fitted took part of
//! the slow noise along, so the residual shows less than there was; and a residual that is misfit rather than noise stays
//! correlated after whitening. The first two are factors; for the third the scores are summed over blocks of time: where
//! they scatter more than independent samples would, that scatter counts (sandwich, Liang and Zeger 1986).
//!
//! What no residual shows is an error that the numbers take along. [`Knowledge::shifts`] tells for given changes of the
//! predictions how far the minimum moves: `-(J'J)^-1 J'd`, states following.
//! RT: no.

use crate::identify::fit::{FreeRuns, Point, Series, present};
use crate::identify::noise::{Colour, loss_bend, weight};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use statrs::distribution::{ContinuousCDF, Normal};

/// Blocks over all windows: enough to see their scatter to a third, long enough to hold what correlates.
const BLOCKS: usize = 24;
/// Fewest rows of a block: a few times the longest memory of a noise model.
const SHORTEST: usize = 24;
/// Block scores may scatter by this factor more than independent samples (variance) before it counts: by chance the
/// mean over four directions of 24 blocks stays below 1.4.
const BY_CHANCE: f64 = 1.5;
/// Fewer blocks per direction than this cannot tell directions apart, only their mean.
const PER_DIRECTION: usize = 3;
/// Directions below this part of the largest carry no information at all.
const NOTHING: f64 = 1e-12;

/// Sums of one channel over one window, directions in the order of the slopes.
struct Channel {
    /// `J'J`, whitened.
    square: DMatrix<f64>,
    /// Score of each block.
    blocks: Vec<DVector<f64>>,
    /// Sums over samples of the bend of the loss and of its squared slope, halves of them; number of samples.
    bend: f64,
    slope_squared: f64,
    count: f64,
    /// Independent samples that the mean of this residual is worth.
    effective: f64,
    /// `J'd` of each change of the predictions, whitened.
    pulls: Vec<DVector<f64>>,
}

/// A change of all predictions: per window, per channel, row by row.
pub type Change = Vec<Vec<Vec<f64>>>;

/// What a fit knows of its shared parameters.
#[derive(Clone, Debug)]
pub struct Knowledge {
    /// Inverse covariance, by what the residual shows.
    pub information: DMatrix<f64>,
    /// How far the minimum moves under each change of the predictions.
    pub shifts: Vec<DVector<f64>>,
}

/// Inverse covariance of the shared parameters at the minimum `at` of a fit under `noise`, and how far it moves under
/// `changes`. `widths`: of the parameters' ranges, which no shift leaves. `None` if a run leaves the finite numbers.
#[must_use]
pub fn knowledge(
    runs: &impl FreeRuns,
    at: &Point,
    noise: &[Colour],
    (changes, widths): (&[Change], &[f64]),
) -> Option<Knowledge> {
    let shared = at.parameters.len();
    let swept = |w: usize| runs.run(w, &at.parameters, &at.states[w], true);
    let windows: Vec<Vec<Series>> = (0..runs.windows()).into_par_iter().map(swept).collect::<Option<_>>()?;
    let rows: usize = windows.iter().map(|w| w.first().map_or(0, |s| s.residual.len())).sum();
    let block = (rows / BLOCKS).max(SHORTEST);
    let sums = |(w, channels): (usize, Vec<Series>)| -> Vec<Channel> {
        let changed = |c: usize| changes.iter().map(|change| change[w][c].as_slice()).collect::<Vec<_>>();
        let pairs = channels.into_iter().zip(noise).enumerate();
        pairs.map(|(c, (series, colour))| Channel::of(series, colour, block, &changed(c))).collect()
    };
    let windows: Vec<Vec<Channel>> = windows.into_par_iter().enumerate().map(sums).collect();
    // Decompositions do not end on numbers that are not finite: a derivative at a corner may be none.
    if !windows.iter().flatten().all(Channel::is_finite) {
        return None;
    }
    let factors: Vec<(f64, f64)> = (0..noise.len()).map(|c| robust_factors(&windows, c)).collect();
    let (mut total, mut scores) = (DMatrix::zeros(shared, shared), Vec::new());
    let mut pulls = vec![DVector::zeros(shared); changes.len()];
    for channels in &windows {
        let own = without_states(channels, &factors, shared);
        total += own.square;
        scores.extend(own.blocks);
        pulls.iter_mut().zip(&own.pulls).for_each(|(sum, pull)| *sum += pull);
    }
    let within = DVector::from_iterator(shared, widths.iter().map(|w| 12.0 / (w * w)));
    let shifts = if pulls.is_empty() { Vec::new() } else { shifts(&total, &within, &pulls) };
    let fitted = shared + at.states.iter().map(Vec::len).sum::<usize>();
    let effective: f64 = windows.iter().flatten().map(|c| c.effective).sum();
    total *= (1.0 - fitted as f64 / effective.max(1.0)).max(LEAST_LEFT);
    Some(Knowledge { information: scattered(&total, &scores), shifts })
}

/// Where the minimum goes under each pull, of numbers that are known beforehand to lie `within` their ranges.
fn shifts(square: &DMatrix<f64>, within: &DVector<f64>, pulls: &[DVector<f64>]) -> Vec<DVector<f64>> {
    let inverse = pseudo_inverse(square + DMatrix::from_diagonal(within));
    pulls.iter().map(|pull| -(&inverse * pull)).collect()
}

/// Fitting never takes more than this part away from what a residual shows of its noise.
const LEAST_LEFT: f64 = 0.25;

impl Channel {
    fn is_finite(&self) -> bool {
        let vectors = self.blocks.iter().chain(&self.pulls).flat_map(|v| v.iter());
        self.square.iter().chain(vectors).all(|x| x.is_finite())
    }

    fn of(mut series: Series, colour: &Colour, block: usize, changes: &[&[f64]]) -> Self {
        let n = series.slopes.len();
        let mut out = Self {
            square: DMatrix::zeros(n, n),
            blocks: Vec::new(),
            bend: 0.0,
            slope_squared: 0.0,
            count: 0.0,
            effective: 0.0,
            pulls: vec![DVector::zeros(n); changes.len()],
        };
        if !(colour.sigma.is_finite() && colour.sigma > 0.0) {
            return out;
        }
        let rows = present(&series);
        let length = series.residual.len();
        colour.whiten(&mut series.residual, &rows);
        series.slopes.iter_mut().for_each(|slope| colour.whiten(slope, &rows));
        let mut changes: Vec<Vec<f64>> = changes.iter().map(|change| change.to_vec()).collect();
        changes.iter_mut().for_each(|change| colour.whiten(change, &rows));
        out.blocks = vec![DVector::zeros(n); (length / block).max(1)];
        out.effective = rows.len() as f64 * colour.independent_part();
        for k in rows {
            let e = series.residual[k];
            let psi = weight(e) * e;
            out.bend += loss_bend(e);
            out.slope_squared += psi * psi;
            out.count += 1.0;
            let j = DVector::from_iterator(n, series.slopes.iter().map(|s| s[k]));
            out.square.ger(1.0, &j, &j, 1.0);
            let last = out.blocks.len() - 1;
            out.blocks[(k / block).min(last)].axpy(psi, &j, 1.0);
            out.pulls.iter_mut().zip(&changes).for_each(|(pull, change)| pull.axpy(change[k], &j, 1.0));
        }
        out
    }
}

/// Of one channel over all windows: the information of a sample in units of its square, and the factor of its scores.
fn robust_factors(windows: &[Vec<Channel>], c: usize) -> (f64, f64) {
    let sum = |of: fn(&Channel) -> f64| windows.iter().filter_map(|w| w.get(c)).map(of).sum::<f64>();
    let count = sum(|c| c.count).max(1.0);
    let (bend, slope_squared) = ((sum(|c| c.bend) / count).max(0.1), sum(|c| c.slope_squared) / count);
    // A residual below the floor of its channel says nothing about noise: never more than plain squares.
    let part = if slope_squared > 0.0 { (bend * bend / slope_squared).min(1.0) } else { 1.0 };
    (part, part / bend)
}

/// Of the shared parameters of one window, once its states follow them.
struct Own {
    square: DMatrix<f64>,
    blocks: Vec<DVector<f64>>,
    pulls: Vec<DVector<f64>>,
}

fn without_states(channels: &[Channel], factors: &[(f64, f64)], shared: usize) -> Own {
    let n = channels.first().map_or(shared, |c| c.square.nrows());
    let count = |of: fn(&Channel) -> usize| channels.iter().map(of).max().unwrap_or(0);
    let zeros = |count: usize| vec![DVector::zeros(n); count];
    let (mut square, mut blocks) = (DMatrix::zeros(n, n), zeros(count(|c| c.blocks.len())));
    let mut pulls = zeros(count(|c| c.pulls.len()));
    for (channel, (part, score)) in channels.iter().zip(factors) {
        square += &channel.square * *part;
        for (sum, block) in blocks.iter_mut().zip(&channel.blocks) {
            sum.axpy(*score, block, 1.0);
        }
        for (sum, pull) in pulls.iter_mut().zip(&channel.pulls) {
            sum.axpy(*part, pull, 1.0);
        }
    }
    let states = n - shared;
    if states == 0 {
        return Own { square, blocks, pulls };
    }
    let xx = square.view((shared, shared), (states, states)).into_owned();
    let follows = square.view((0, shared), (shared, states)) * pseudo_inverse(xx);
    let own = square.view((0, 0), (shared, shared)) - &follows * square.view((shared, 0), (states, shared));
    let followed = |all: &[DVector<f64>]| -> Vec<DVector<f64>> {
        all.iter().map(|v| v.rows(0, shared) - &follows * v.rows(shared, states)).collect()
    };
    Own { square: own, blocks: followed(&blocks), pulls: followed(&pulls) }
}

fn pseudo_inverse(a: DMatrix<f64>) -> DMatrix<f64> {
    let n = a.nrows();
    let scale = DVector::from_fn(n, |i, _| 1.0 / libm::sqrt(a[(i, i)].max(1e-300)));
    let unit = DMatrix::from_fn(n, n, |r, c| a[(r, c)] * scale[r] * scale[c]).symmetric_eigen();
    let inverse = unit.eigenvalues.map(|x| if x > NOTHING { 1.0 / x } else { 0.0 });
    let q = DMatrix::from_fn(n, n, |r, c| unit.eigenvectors[(r, c)] * scale[r]);
    &q * DMatrix::from_diagonal(&inverse) * q.transpose()
}

/// `information`, less where the scores of blocks scatter by more than it says.
fn scattered(information: &DMatrix<f64>, scores: &[DVector<f64>]) -> DMatrix<f64> {
    let n = information.nrows();
    let root = DVector::from_fn(n, |i, _| libm::sqrt(information[(i, i)].max(1e-300)));
    let unit = DMatrix::from_fn(n, n, |r, c| information[(r, c)] / (root[r] * root[c])).symmetric_eigen();
    let seen: Vec<usize> = (0..n).filter(|k| unit.eigenvalues[*k] > NOTHING * n as f64).collect();
    if seen.is_empty() || scores.len() < 2 {
        return information.clone();
    }
    // Coordinates in which each direction has information 1.
    let direction = |k: usize| unit.eigenvectors.column(k).component_div(&root) / libm::sqrt(unit.eigenvalues[k]);
    let to = DMatrix::from_columns(&seen.iter().map(|k| direction(*k)).collect::<Vec<_>>());
    let mean = scores.iter().sum::<DVector<f64>>() / scores.len() as f64;
    let mut scatter = DMatrix::zeros(seen.len(), seen.len());
    for score in scores {
        // At its minimum the sum is zero but for parameters at a bound.
        let s = to.tr_mul(&(score - &mean));
        scatter.ger(1.0, &s, &s, 1.0);
    }
    // One for the mean, and what was fitted took its part of the scatter.
    let left = scores.len().saturating_sub(1 + seen.len()).max(1);
    scatter *= scores.len() as f64 / left as f64;
    let excess = scatter.trace() / seen.len() as f64;
    if excess < BY_CHANCE {
        return information.clone();
    }
    if scores.len() < PER_DIRECTION * seen.len() {
        return information / excess;
    }
    let along = scatter.symmetric_eigen();
    let inverse = along.eigenvalues.map(|x| 1.0 / x.max(1.0));
    let back = |k: usize| unit.eigenvectors.column(k).component_mul(&root) * libm::sqrt(unit.eigenvalues[k]);
    let from = DMatrix::from_columns(&seen.iter().map(|k| back(*k)).collect::<Vec<_>>()) * along.eigenvectors;
    &from * DMatrix::from_diagonal(&inverse) * from.transpose()
}

/// How many standard deviations a two-sided band of 95 % spans on each side.
#[must_use]
pub fn band_95() -> f64 {
    Normal::standard().inverse_cdf(0.975)
}

#[cfg(test)]
mod tests;
