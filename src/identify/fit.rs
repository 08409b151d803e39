//! Least squares on free runs: Levenberg-Marquardt with bounds, initial states eliminated window by window.
//!
//! Each window of a recording is a free run from its own initial state. Its normal equations are reduced by a Schur
//! complement to the parameters that all windows share (variable projection), so neither the number of windows nor
//! the length of the recordings enters the size of the system that is solved.
//!
//! Derivatives cost some ten times what a run costs. Each linearisation therefore serves for several steps: after a step
//! that kept its promise only the residual is new, and its gradient follows from the derivatives that are there.
//! RT: no.

use crate::identify::noise::{Colour, loss, weight};
use nalgebra::{DMatrix, DVector};
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
}

/// Where a fit starts, and where it stands.
#[derive(Clone, Debug)]
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

/// Normal equations of one window in parameters `p` and states `x`.
struct Normal {
    pp: DMatrix<f64>,
    px: DMatrix<f64>,
    xx: DMatrix<f64>,
    gp: DVector<f64>,
    gx: DVector<f64>,
    cost: f64,
    /// Per channel; without rows where it has no weight.
    derivatives: Vec<Derivatives>,
}

/// Whitened derivatives of one channel at the rows that carry a sample.
#[derive(Default)]
struct Derivatives {
    rows: Vec<usize>,
    slopes: Vec<Vec<f64>>,
}

/// Normal equations of all windows, states eliminated.
struct Reduced {
    windows: Vec<Normal>,
    /// Undamped.
    pp: DMatrix<f64>,
    cost: f64,
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

fn has_weight(colour: &Colour) -> bool {
    colour.sigma.is_finite() && colour.sigma > 0.0
}

fn normal(channels: Vec<Series>, noise: &[Colour], shared: usize, states: usize) -> Normal {
    let n = shared + states;
    let (mut h, mut g, mut cost) = (DMatrix::zeros(n, n), DVector::zeros(n), 0.0);
    let mut derivatives = Vec::with_capacity(noise.len());
    for (series, colour) in channels.into_iter().zip(noise) {
        let mut kept = Derivatives::default();
        if has_weight(colour) {
            let residual;
            (kept, residual) = whitened(series, colour);
            cost += kept.gradient(&residual, &mut g);
            kept.products(&residual, &mut h);
        }
        derivatives.push(kept);
    }
    Normal {
        pp: h.view((0, 0), (shared, shared)).into_owned(),
        px: h.view((0, shared), (shared, states)).into_owned(),
        xx: h.view((shared, shared), (states, states)).into_owned(),
        gp: g.rows(0, shared).into_owned(),
        gx: g.rows(shared, states).into_owned(),
        cost,
        derivatives,
    }
}

/// Derivatives and residual of a channel at the rows that carry a sample, whitened.
fn whitened(mut series: Series, colour: &Colour) -> (Derivatives, Vec<f64>) {
    let rows = present(&series);
    colour.whiten(&mut series.residual, &rows);
    for slope in &mut series.slopes {
        colour.whiten(slope, &rows);
    }
    let pick = |s: &Vec<f64>| rows.iter().map(|k| s[*k]).collect();
    let residual = pick(&series.residual);
    let slopes = series.slopes.iter().map(pick).collect();
    (Derivatives { rows, slopes }, residual)
}

impl Derivatives {
    /// Adds `J'We` to `g`; gives the cost of the residual.
    fn gradient(&self, residual: &[f64], g: &mut DVector<f64>) -> f64 {
        let pull: Vec<f64> = residual.iter().map(|x| weight(*x) * x).collect();
        for (a, slope) in self.slopes.iter().enumerate() {
            g[a] += dot(slope, &pull);
        }
        residual.iter().map(|x| loss(*x)).sum()
    }

    /// Adds `J'WJ` to `h`.
    fn products(&self, residual: &[f64], h: &mut DMatrix<f64>) {
        let weights: Vec<f64> = residual.iter().map(|x| weight(*x)).collect();
        for (a, slope) in self.slopes.iter().enumerate() {
            let weighted: Vec<f64> = slope.iter().zip(&weights).map(|(x, w)| x * w).collect();
            for (b, other) in self.slopes.iter().enumerate().take(a + 1) {
                let x = dot(&weighted, other);
                h[(a, b)] += x;
                if a != b {
                    h[(b, a)] += x;
                }
            }
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    // Four sums in flight: about three times faster than one, and the order is fixed.
    let mut s = [0.0; 4];
    let (a4, b4) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest: f64 = a4.remainder().iter().zip(b4.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in a4.zip(b4) {
        for i in 0..4 {
            s[i] += x[i] * y[i];
        }
    }
    (s[0] + s[1]) + (s[2] + s[3]) + rest
}

impl Normal {
    /// Gradient and cost of another residual, derivatives as they are.
    fn renew(&mut self, channels: Vec<Series>, noise: &[Colour]) {
        let (shared, states) = (self.gp.len(), self.gx.len());
        let mut g = DVector::zeros(shared + states);
        self.cost = 0.0;
        for ((mut series, colour), kept) in channels.into_iter().zip(noise).zip(&self.derivatives) {
            if has_weight(colour) {
                colour.whiten(&mut series.residual, &kept.rows);
                let residual: Vec<f64> = kept.rows.iter().map(|k| series.residual[*k]).collect();
                self.cost += kept.gradient(&residual, &mut g);
            }
        }
        (self.gp, self.gx) = (g.rows(0, shared).into_owned(), g.rows(shared, states).into_owned());
    }

    /// `xx` with a ridge of `damping` times its diagonal, inverted; directions without effect stay put.
    fn states_inverse(&self, damping: f64) -> DMatrix<f64> {
        let mut a = self.xx.clone();
        let largest = a.diagonal().iter().copied().fold(0.0, f64::max);
        for i in 0..a.nrows() {
            a[(i, i)] += a[(i, i)] * damping + largest * 1e-12 + 1e-300;
        }
        a.clone().cholesky().map_or_else(|| DMatrix::zeros(a.nrows(), a.nrows()), |c| c.inverse())
    }
}

/// Linearises all windows in parallel. `None` if one of them leaves the finite numbers.
fn linearise(runs: &impl FreeRuns, at: &Point, noise: &[Colour]) -> Option<Reduced> {
    let shared = at.parameters.len();
    let one = |w: usize| {
        let states = &at.states[w];
        let channels = runs.run(w, &at.parameters, states, true)?;
        Some(normal(channels, noise, shared, states.len()))
    };
    let windows: Vec<Normal> = (0..runs.windows()).into_par_iter().map(one).collect::<Option<_>>()?;
    let cost: f64 = windows.iter().map(|w| w.cost).sum();
    let (pp, _) = eliminated(&windows, shared, 0.0);
    (cost.is_finite() && pp.iter().all(|x: &f64| x.is_finite())).then_some(Reduced { windows, pp, cost })
}

/// Normal equations of the shared parameters once each window's states follow them, states damped.
fn eliminated(windows: &[Normal], shared: usize, damping: f64) -> (DMatrix<f64>, DVector<f64>) {
    let (mut pp, mut gp) = (DMatrix::zeros(shared, shared), DVector::zeros(shared));
    for w in windows {
        let inverse = w.states_inverse(damping);
        pp += &w.pp - &w.px * &inverse * w.px.transpose();
        gp += &w.gp - &w.px * &inverse * &w.gx;
    }
    (pp, gp)
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

/// Cost of all windows at a point; infinite if one leaves the finite numbers.
pub fn cost(runs: &impl FreeRuns, at: &Point, noise: &[Colour]) -> f64 {
    looked(runs, at, noise).map_or(f64::INFINITY, |(_, cost)| cost)
}

/// A step and the fall of cost that the linear model promises for it.
struct Step {
    parameters: DVector<f64>,
    states: Vec<DVector<f64>>,
    promised: f64,
}

impl Reduced {
    /// The same derivatives with another residual.
    fn renew(&mut self, residuals: Vec<Vec<Series>>, noise: &[Colour]) {
        self.windows.par_iter_mut().zip(residuals).for_each(|(window, channels)| window.renew(channels, noise));
        self.cost = self.windows.iter().map(|w| w.cost).sum();
    }

    /// Damped Gauss-Newton step within the bounds: parameters that would leave are held at their bound and the rest
    /// is solved again, so that the others make up for it.
    fn step(&self, at: &Point, bounds: &[Bound], damping: f64) -> Step {
        let n = at.parameters.len();
        // Damped alike in states and parameters: else the step solves no one problem, and where parameters move the
        // states far it promises to go uphill.
        let (pp, gp) = eliminated(&self.windows, n, damping);
        let mut fixed: Vec<Option<f64>> = vec![None; n];
        let mut dp = DVector::zeros(n);
        for _ in 0..=n {
            dp = solve(&pp, &gp, &fixed, damping);
            let leaving: Vec<usize> = (0..n).filter(|i| fixed[*i].is_none() && leaves(at, bounds, &dp, *i)).collect();
            if leaving.is_empty() {
                break;
            }
            for i in leaving {
                let b = bounds[i];
                fixed[i] = Some(if dp[i] > 0.0 { b.max } else { b.min } - at.parameters[i]);
            }
        }
        let states: Vec<DVector<f64>> =
            self.windows.iter().map(|w| -(w.states_inverse(damping) * (&w.gx + w.px.transpose() * &dp))).collect();
        let promised = self.promise(&dp, &states);
        Step { parameters: dp, states, promised }
    }

    fn promise(&self, dp: &DVector<f64>, states: &[DVector<f64>]) -> f64 {
        let one = |(w, dx): (&Normal, &DVector<f64>)| {
            let linear = w.gp.dot(dp) + w.gx.dot(dx);
            let quadratic = dp.dot(&(&w.pp * dp)) + 2.0 * dp.dot(&(&w.px * dx)) + dx.dot(&(&w.xx * dx));
            -2.0 * linear - quadratic
        };
        self.windows.iter().zip(states).map(one).sum()
    }
}

/// The shared parameters' part of a step; `fixed` ones move as told.
fn solve(pp: &DMatrix<f64>, gp: &DVector<f64>, fixed: &[Option<f64>], damping: f64) -> DVector<f64> {
    let n = fixed.len();
    let held = DVector::from_iterator(n, fixed.iter().map(|f| f.unwrap_or(0.0)));
    let free: Vec<usize> = (0..n).filter(|i| fixed[*i].is_none()).collect();
    let right = gp + pp * &held;
    let mut out = held;
    // Scaled to unit diagonal: the parameters differ by orders of magnitude.
    let scale: Vec<f64> = free.iter().map(|i| 1.0 / libm::sqrt(pp[(*i, *i)].max(1e-300))).collect();
    let ridge = damping + 1e-11;
    let a = DMatrix::from_fn(free.len(), free.len(), |r, c| {
        pp[(free[r], free[c])] * scale[r] * scale[c] + if r == c { ridge } else { 0.0 }
    });
    let b = DVector::from_fn(free.len(), |r, _| -right[free[r]] * scale[r]);
    if let Some(x) = a.cholesky().map(|c| c.solve(&b)) {
        for (r, i) in free.iter().enumerate() {
            out[*i] = x[r] * scale[r];
        }
    }
    out
}

fn leaves(at: &Point, bounds: &[Bound], dp: &DVector<f64>, i: usize) -> bool {
    let next = at.parameters[i] + dp[i];
    let slack = 1e-12 * (bounds[i].max - bounds[i].min).abs().min(1e9);
    next > bounds[i].max + slack || next < bounds[i].min - slack
}

fn moved(at: &Point, step: &Step, bounds: &[Bound]) -> Point {
    let parameters = at.parameters.iter().zip(step.parameters.iter()).zip(bounds);
    Point {
        parameters: parameters.map(|((p, d), b)| (p + d).clamp(b.min, b.max)).collect(),
        states: at
            .states
            .iter()
            .zip(&step.states)
            .map(|(x, d)| x.iter().zip(d.iter()).map(|(x, d)| x + d).collect())
            .collect(),
    }
}

/// Most steps on one linearisation.
const STEPS: usize = 4;

/// A step that brings less than this part of its promise asks for new derivatives.
const KEPT: f64 = 0.5;

/// A fit of this tolerance or a coarser one may end on old derivatives; a finer one looks once more.
const COARSE: f64 = 1e-4;

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
        for _ in 0..tries {
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
        let coarse = self.tolerance >= COARSE;
        for taken in 0..STEPS {
            let fresh = taken == 0;
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
    while iterations < limits.iterations {
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
mod tests {
    use super::*;

    /// `y = x0 exp(-a t) + b t`, one window per start value.
    struct Decay {
        measured: Vec<Vec<f64>>,
    }

    fn model(a: f64, b: f64, x0: f64, t: f64) -> f64 {
        x0 * libm::exp(-a * t) + b * t
    }

    impl Decay {
        fn new(a: f64, b: f64) -> Self {
            let window = |x0: f64| (0..50).map(|k| model(a, b, x0, f64::from(k) * 0.1)).collect();
            Self { measured: vec![window(1.0), window(-2.0), window(0.3)] }
        }
    }

    impl FreeRuns for Decay {
        fn windows(&self) -> usize {
            self.measured.len()
        }
        fn run(&self, w: usize, p: &[f64], x: &[f64], _: bool) -> Option<Vec<Series>> {
            let t: Vec<f64> = (0..50).map(|k| f64::from(k) * 0.1).collect();
            let e: Vec<f64> = t.iter().map(|t| libm::exp(-p[0] * t)).collect();
            let residual = (0..50).map(|k| x[0] * e[k] + p[1] * t[k] - self.measured[w][k]).collect();
            let slopes = vec![(0..50).map(|k| -t[k] * x[0] * e[k]).collect(), t.clone(), e];
            Some(vec![Series { residual, slopes }])
        }
    }

    const WIDE: [Bound; 2] = [Bound { min: 0.0, max: 10.0 }, Bound { min: -10.0, max: 10.0 }];

    fn start() -> Point {
        Point { parameters: vec![0.2, 0.0], states: vec![vec![0.5]; 3] }
    }

    #[test]
    fn parameters_and_initial_states_are_found_together() {
        let found = fit(&Decay::new(0.7, 0.05), start(), &WIDE, &[Colour::white(0.01)], Limits::default());
        assert_eq!(found.outcome, Outcome::Converged);
        assert!((found.point.parameters[0] - 0.7).abs() < 1e-4 && (found.point.parameters[1] - 0.05).abs() < 1e-4);
        assert!((found.point.states[1][0] + 2.0).abs() < 1e-3);
    }

    /// `y = x0 + b (t + 1e5)`: the shared slope moves the initial state far.
    struct Lever;

    impl FreeRuns for Lever {
        fn windows(&self) -> usize {
            1
        }
        fn run(&self, _: usize, p: &[f64], x: &[f64], _: bool) -> Option<Vec<Series>> {
            let arm: Vec<f64> = (0..50).map(|k| f64::from(k) * 0.1 + 1e5).collect();
            let residual = arm.iter().map(|arm| x[0] + p[0] * arm).collect();
            Some(vec![Series { residual, slopes: vec![arm, vec![1.0; 50]] }])
        }
    }

    #[test]
    fn a_step_never_promises_to_go_uphill_however_far_it_moves_the_states() {
        // The state is the best for this slope, and both are wrong.
        let at = Point { parameters: vec![1e-3], states: vec![vec![-100.00245]] };
        let bounds = [Bound { min: -1.0, max: 1.0 }];
        let system = linearise(&Lever, &at, &[Colour::white(1e-3)]).unwrap();
        for damping in [1e-9, 1e-4, 1e-2, 1.0] {
            assert!(system.step(&at, &bounds, damping).promised > 0.0, "{damping}");
        }
    }

    #[test]
    fn old_derivatives_with_the_residual_of_the_same_point_give_the_same_equations() {
        let (runs, noise) = (Decay::new(0.7, 0.05), [Colour::white(0.01)]);
        let mut system = linearise(&runs, &start(), &noise).unwrap();
        let (gp, gx, cost) = (system.windows[1].gp.clone(), system.windows[1].gx.clone(), system.cost);
        let elsewhere = Point { parameters: vec![0.5, 0.1], states: start().states };
        system.renew(looked(&runs, &elsewhere, &noise).unwrap().0, &noise);
        assert!((&system.windows[1].gp - &gp).norm() > 0.1 * gp.norm());
        let (residuals, there) = looked(&runs, &start(), &noise).unwrap();
        system.renew(residuals, &noise);
        assert_eq!((&system.windows[1].gp, &system.windows[1].gx), (&gp, &gx));
        assert!((system.cost - cost).abs() < 1e-9 * cost && (there - cost).abs() < 1e-9 * cost);
    }

    /// [`Decay`] that counts how far from 0.2 its first parameter was ever tried, and may move it by 0.1 a step.
    struct Short(Decay, std::sync::Mutex<f64>);

    impl FreeRuns for Short {
        fn windows(&self) -> usize {
            self.0.windows()
        }
        fn run(&self, w: usize, p: &[f64], x: &[f64], slopes: bool) -> Option<Vec<Series>> {
            let mut farthest = self.1.lock().unwrap();
            *farthest = farthest.max(p[0]);
            self.0.run(w, p, x, slopes)
        }
        fn reach(&self, index: usize) -> f64 {
            if index == 0 { 0.1 } else { f64::INFINITY }
        }
    }

    #[test]
    fn a_step_goes_no_farther_than_its_reach_and_arrives_all_the_same() {
        let runs = Short(Decay::new(0.7, 0.05), std::sync::Mutex::new(0.0));
        let one = Limits { iterations: 1, tolerance: 1e-3 };
        let found = fit(&runs, start(), &WIDE, &[Colour::white(0.01)], one);
        let steps = STEPS as f64;
        assert!(*runs.1.lock().unwrap() <= 0.2 + 0.1 * steps + 1e-12 && found.cost.is_finite());
        let found = fit(&runs, start(), &WIDE, &[Colour::white(0.01)], Limits::default());
        assert!((found.point.parameters[0] - 0.7).abs() < 1e-4, "{:?}", found.point);
    }

    /// `y = x0 + 0.05 sin(40 x0)` against 0 in each of two windows: the second is a maze, the first is plain.
    struct Maze;

    impl FreeRuns for Maze {
        fn windows(&self) -> usize {
            2
        }
        fn run(&self, w: usize, _: &[f64], x: &[f64], _: bool) -> Option<Vec<Series>> {
            let bend = if w == 1 { 0.05 } else { 0.0 };
            let y = x[0] + bend * libm::sin(40.0 * x[0]);
            let slope = 1.0 + 40.0 * bend * libm::cos(40.0 * x[0]);
            Some(vec![Series { residual: vec![y; 20], slopes: vec![vec![slope; 20]] }])
        }
    }

    #[test]
    fn states_of_a_plain_window_arrive_whatever_its_neighbour_does() {
        let limits = Limits { iterations: 2, tolerance: 1e-6 };
        let states = fit_states(&Maze, vec![vec![1.0], vec![1.0]], &[Colour::white(0.01)], limits);
        assert!(states[0][0].abs() < 1e-3, "{states:?}");
    }

    #[test]
    fn a_bound_is_kept_and_the_rest_makes_up_for_it() {
        let bounds = [Bound { min: 0.0, max: 0.5 }, WIDE[1]];
        let found = fit(&Decay::new(0.7, 0.05), start(), &bounds, &[Colour::white(0.01)], Limits::default());
        assert!((found.point.parameters[0] - 0.5).abs() < 1e-9, "{:?}", found.point);
        assert_ne!(found.outcome, Outcome::Infeasible);
    }
}
