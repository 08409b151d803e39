//! Least squares on free runs: Levenberg-Marquardt with bounds, initial states eliminated window by window.
//!
//! Derivatives cost some ten times what a run costs. Each linearisation therefore serves for several steps: after a step
//! that kept its promise only the residual is new, and its gradient follows from the derivatives that are there.
//! RT: no.

mod normal;

use crate::identify::noise::{Colour, loss};
use nalgebra::DMatrix;
use normal::{Reduced, has_weight, linearise, moved};
use rayon::prelude::*;

/// One channel of one window: simulated minus measured, and its derivatives.
#[derive(Clone, Debug, Default)]
pub struct Series {
    /// Residual per row; NaN where a sample is missing.
    pub residual: Vec<f64>,
    /// Derivatives per direction (shared parameters first, then initial states), each as long as `residual`; empty if
    /// none were asked for.
    pub slopes: Vec<Vec<f64>>,
}

/// Free runs whose shared parameters are free: what [`fit`] needs to know about a rig and its recordings.
pub trait FreeRuns: Sync {
    /// Number of windows over all recordings.
    fn windows(&self) -> usize;
    /// Residual of each channel over window `window`, with derivatives if `slopes`. `None` if the run leaves the
    /// finite numbers.
    fn run(&self, window: usize, parameters: &[f64], state: &[f64], slopes: bool) -> Option<Vec<Series>>;
    /// Farthest that one step may move shared parameter `_index`.
    fn reach(&self, _index: usize) -> f64 {
        f64::INFINITY
    }
    /// True once the runs have cost what they may: a fit then stays where it is.
    fn is_exhausted(&self) -> bool {
        false
    }
}

/// Where a fit starts, and where it stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// Shared parameters.
    pub parameters: Vec<f64>,
    /// Initial state of each window.
    pub states: Vec<Vec<f64>>,
}

/// Bounds of a shared parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bound {
    /// Smallest value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
}

/// How a fit ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The last step promised less than the tolerance.
    Converged,
    /// The limit of iterations came first; the best point is returned.
    IterationLimit,
    /// No step lowers the cost although one should.
    Stalled,
    /// The run at the start leaves the finite numbers.
    Infeasible,
}

/// Limits of a fit.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Most linearisations.
    pub iterations: usize,
    /// A step that promises less than this part of the cost ends the fit.
    pub tolerance: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { iterations: 30, tolerance: 1e-6 }
    }
}

/// Result of a fit.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Best point.
    pub point: Point,
    /// Sum of Student losses of the whitened residuals there.
    pub cost: f64,
    /// Reduced normal matrix at the last linearisation (its inverse is the covariance of the parameters for unit noise).
    pub information: DMatrix<f64>,
    /// How it ended.
    pub outcome: Outcome,
    /// Linearisations used.
    pub iterations: usize,
}

/// Rows of `series` that carry a sample.
#[must_use]
pub fn present(series: &Series) -> Vec<usize> {
    (0..series.residual.len()).filter(|k| series.residual[*k].is_finite()).collect()
}

/// Sum of losses of one window's whitened residuals.
fn cost_of(channels: &[Series], noise: &[Colour]) -> f64 {
    let one = |(series, colour): (&Series, &Colour)| {
        if !has_weight(colour) {
            return 0.0;
        }
        let rows = present(series);
        let mut e = series.residual.clone();
        colour.whiten(&mut e, &rows);
        rows.iter().map(|k| loss(e[*k])).sum::<f64>()
    };
    channels.iter().zip(noise).map(one).sum()
}

/// Residuals of all windows at a point and their cost; `None` if one leaves the finite numbers.
fn looked(runs: &impl FreeRuns, at: &Point, noise: &[Colour]) -> Option<(Vec<Vec<Series>>, f64)> {
    let one = |w: usize| {
        let channels = runs.run(w, &at.parameters, &at.states[w], false)?;
        let cost = cost_of(&channels, noise);
        Some((channels, cost))
    };
    let parts: Vec<(Vec<Series>, f64)> = (0..runs.windows()).into_par_iter().map(one).collect::<Option<_>>()?;
    let total: f64 = parts.iter().map(|p| p.1).sum();
    total.is_finite().then(|| (parts.into_iter().map(|p| p.0).collect(), total))
}

/// Cost of one window; infinite if it leaves the finite numbers.
pub fn cost_of_window(runs: &impl FreeRuns, window: usize, at: &Point, noise: &[Colour]) -> f64 {
    let channels = runs.run(window, &at.parameters, &at.states[window], false);
    channels.map_or(f64::INFINITY, |channels| cost_of(&channels, noise))
}

/// Cost of all windows at a point; infinite if one leaves the finite numbers.
pub fn cost(runs: &impl FreeRuns, at: &Point, noise: &[Colour]) -> f64 {
    looked(runs, at, noise).map_or(f64::INFINITY, |(_, cost)| cost)
}

/// Most steps on one linearisation.
const STEPS: usize = 4;

/// A step that brings less than this part of its promise asks for new derivatives.
const KEPT: f64 = 0.5;

/// A fit of this tolerance or a coarser one may end on old derivatives; a finer one looks once more.
const COARSE_TOLERANCE: f64 = 1e-4;

/// Tries of a step on new derivatives, harder damped each time; on old ones the first must do.
const TRIES: usize = 8;

/// What became of a step.
enum Taken {
    /// It promises less than the tolerance.
    Arrived,
    /// No damping makes it fall.
    Stalled,
    /// It fell to `cost`; `kept`: by which part of what was promised.
    Fell { to: Point, residuals: Vec<Vec<Series>>, cost: f64, kept: f64 },
}

/// Where a fit stands.
struct Walk<'w, R> {
    runs: &'w R,
    bounds: &'w [Bound],
    noise: &'w [Colour],
    tolerance: f64,
    at: Point,
    best: f64,
    damping: f64,
}

impl<R: FreeRuns> Walk<'_, R> {
    fn step(&mut self, system: &Reduced, tries: usize) -> Taken {
        let bounds = self.within_reach();
        for tried in 0..tries {
            if tried > 0 && self.runs.is_exhausted() {
                break;
            }
            let step = system.step(&self.at, &bounds, self.damping);
            if step.promised <= self.least() {
                return Taken::Arrived;
            }
            let to = moved(&self.at, &step, &bounds);
            if let Some((residuals, cost)) = looked(self.runs, &to, self.noise).filter(|(_, cost)| *cost < self.best) {
                let kept = (self.best - cost) / step.promised;
                self.damping = if kept > 0.7 { self.damping * 0.1 } else { self.damping }.max(1e-9);
                return Taken::Fell { to, residuals, cost, kept };
            }
            // That old derivatives fail says nothing of the damping.
            if tries > 1 {
                self.damping = (self.damping * 10.0).min(1e6);
            }
        }
        Taken::Stalled
    }

    /// Bounds of one step.
    fn within_reach(&self) -> Vec<Bound> {
        let one = |(i, (b, x)): (usize, (&Bound, &f64))| {
            let reach = self.runs.reach(i);
            Bound { min: b.min.max(x - reach), max: b.max.min(x + reach) }
        };
        self.bounds.iter().zip(&self.at.parameters).enumerate().map(one).collect()
    }

    fn least(&self) -> f64 {
        self.tolerance * (1.0 + self.best)
    }

    /// Steps on one linearisation until it no longer serves, or the fit has ended.
    fn descend(&mut self, system: &mut Reduced) -> Option<Outcome> {
        let coarse = self.tolerance >= COARSE_TOLERANCE;
        for taken in 0..STEPS {
            let fresh = taken == 0;
            if !fresh && self.runs.is_exhausted() {
                return None;
            }
            match self.step(system, if fresh { TRIES } else { 1 }) {
                Taken::Arrived => return (fresh || coarse).then_some(Outcome::Converged),
                Taken::Stalled => return fresh.then_some(Outcome::Stalled),
                Taken::Fell { to, residuals, cost, kept } => {
                    let small = self.best - cost <= self.least();
                    (self.at, self.best) = (to, cost);
                    if small && (fresh || coarse) {
                        return Some(Outcome::Converged);
                    }
                    if small || kept < KEPT {
                        return None;
                    }
                    system.renew(residuals, self.noise);
                }
            }
        }
        None
    }
}

/// Minimises the sum of losses from `start`. Deterministic: windows run in parallel, sums are taken in order.
pub fn fit(runs: &impl FreeRuns, start: Point, bounds: &[Bound], noise: &[Colour], limits: Limits) -> Fit {
    let shared = start.parameters.len();
    let mut information = DMatrix::zeros(shared, shared);
    let (mut outcome, mut iterations) = (Outcome::Infeasible, 0);
    let tolerance = limits.tolerance;
    let mut walk = Walk { runs, bounds, noise, tolerance, at: start, best: f64::INFINITY, damping: 1e-4 };
    while iterations < limits.iterations && !(iterations > 0 && runs.is_exhausted()) {
        let Some(mut system) = linearise(runs, &walk.at, noise) else { break };
        iterations += 1;
        walk.best = system.cost;
        let end = walk.descend(&mut system);
        information = system.pp;
        outcome = end.unwrap_or(Outcome::IterationLimit);
        if end.is_some() {
            break;
        }
    }
    Fit { point: walk.at, cost: walk.best, information, outcome, iterations }
}

/// One window of many.
struct One<'r, R> {
    runs: &'r R,
    window: usize,
}

impl<R: FreeRuns> FreeRuns for One<'_, R> {
    fn windows(&self) -> usize {
        1
    }
    fn run(&self, _: usize, parameters: &[f64], state: &[f64], slopes: bool) -> Option<Vec<Series>> {
        self.runs.run(self.window, parameters, state, slopes)
    }
}

/// Fits the initial states alone, no parameter being free. Each window for itself: one that sticks, or is chaotic, then
/// neither damps nor holds up the others. A window whose run leaves the finite numbers keeps its start.
pub fn fit_states(runs: &impl FreeRuns, start: Vec<Vec<f64>>, noise: &[Colour], limits: Limits) -> Vec<Vec<f64>> {
    let one = |(window, state): (usize, Vec<f64>)| {
        let start = Point { parameters: Vec::new(), states: vec![state] };
        fit(&One { runs, window }, start, &[], noise, limits).point.states.swap_remove(0)
    };
    start.into_par_iter().enumerate().map(one).collect()
}

#[cfg(test)]
mod tests;
