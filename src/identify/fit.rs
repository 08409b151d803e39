//! Least squares on free runs: Levenberg-Marquardt with bounds, initial states eliminated window by window.
//!
//! Each window of a recording is a free run from its own initial state. Its normal equations are reduced by a Schur
//! complement to the parameters that all windows share (variable projection), so neither the number of windows nor
//! the length of the recordings enters the size of the system that is solved.
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
#[must_use]
pub fn cost_of(channels: &[Series], noise: &[Colour]) -> f64 {
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
    for (series, colour) in channels.into_iter().zip(noise).filter(|(_, c)| has_weight(c)) {
        cost += accumulate(series, colour, &mut h, &mut g);
    }
    Normal {
        pp: h.view((0, 0), (shared, shared)).into_owned(),
        px: h.view((0, shared), (shared, states)).into_owned(),
        xx: h.view((shared, shared), (states, states)).into_owned(),
        gp: g.rows(0, shared).into_owned(),
        gx: g.rows(shared, states).into_owned(),
        cost,
    }
}

/// Adds one channel to `J'WJ` and `J'We`; gives its cost.
fn accumulate(mut series: Series, colour: &Colour, h: &mut DMatrix<f64>, g: &mut DVector<f64>) -> f64 {
    let rows = present(&series);
    colour.whiten(&mut series.residual, &rows);
    for slope in &mut series.slopes {
        colour.whiten(slope, &rows);
    }
    let e: Vec<f64> = rows.iter().map(|k| series.residual[*k]).collect();
    let w: Vec<f64> = e.iter().map(|x| weight(*x)).collect();
    let j: Vec<Vec<f64>> = series.slopes.iter().map(|s| rows.iter().map(|k| s[*k]).collect()).collect();
    for (a, ja) in j.iter().enumerate() {
        let weighted: Vec<f64> = ja.iter().zip(&w).map(|(x, w)| x * w).collect();
        g[a] += dot(&weighted, &e);
        for (b, jb) in j.iter().enumerate().take(a + 1) {
            let x = dot(&weighted, jb);
            h[(a, b)] += x;
            if a != b {
                h[(b, a)] += x;
            }
        }
    }
    e.iter().map(|x| loss(*x)).sum()
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

/// Cost of all windows at a point; infinite if one leaves the finite numbers.
pub fn cost(runs: &impl FreeRuns, at: &Point, noise: &[Colour]) -> f64 {
    let one = |w: usize| {
        runs.run(w, &at.parameters, &at.states[w], false).map_or(f64::INFINITY, |channels| cost_of(&channels, noise))
    };
    let costs: Vec<f64> = (0..runs.windows()).into_par_iter().map(one).collect();
    let total: f64 = costs.iter().sum();
    if total.is_finite() { total } else { f64::INFINITY }
}

/// A step and the fall of cost that the linear model promises for it.
struct Step {
    parameters: DVector<f64>,
    states: Vec<DVector<f64>>,
    promised: f64,
}

impl Reduced {
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

/// Minimises the sum of losses from `start`. Deterministic: windows run in parallel, sums are taken in order.
pub fn fit(runs: &impl FreeRuns, start: Point, bounds: &[Bound], noise: &[Colour], limits: Limits) -> Fit {
    let shared = start.parameters.len();
    let mut at = start;
    let mut damping = 1e-4;
    let mut information = DMatrix::zeros(shared, shared);
    let (mut best, mut outcome, mut iterations) = (f64::INFINITY, Outcome::Infeasible, 0);
    while iterations < limits.iterations {
        let Some(system) = linearise(runs, &at, noise) else { break };
        iterations += 1;
        best = system.cost;
        let mut accepted = None;
        for _ in 0..8 {
            let step = system.step(&at, bounds, damping);
            if step.promised <= limits.tolerance * (1.0 + best) {
                accepted = Some((None, Outcome::Converged));
                break;
            }
            let next = moved(&at, &step, bounds);
            let value = cost(runs, &next, noise);
            if value < best {
                damping = if best - value > 0.7 * step.promised { damping * 0.1 } else { damping }.max(1e-9);
                let small = best - value <= limits.tolerance * (1.0 + best);
                best = value;
                accepted = Some((Some(next), if small { Outcome::Converged } else { Outcome::IterationLimit }));
                break;
            }
            damping = (damping * 10.0).min(1e6);
        }
        information = system.pp;
        let Some((next, how)) = accepted else {
            outcome = Outcome::Stalled;
            break;
        };
        at = next.unwrap_or(at);
        outcome = how;
        if how == Outcome::Converged {
            break;
        }
    }
    Fit { point: at, cost: best, information, outcome, iterations }
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
    fn a_bound_is_kept_and_the_rest_makes_up_for_it() {
        let bounds = [Bound { min: 0.0, max: 0.5 }, WIDE[1]];
        let found = fit(&Decay::new(0.7, 0.05), start(), &bounds, &[Colour::white(0.01)], Limits::default());
        assert!((found.point.parameters[0] - 0.5).abs() < 1e-9, "{:?}", found.point);
        assert_ne!(found.outcome, Outcome::Infeasible);
    }
}
