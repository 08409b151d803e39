//! Normal equations of all windows, initial states eliminated, and the damped step that they give.
//!
//! Each window of a recording is a free run from its own initial state. Its normal equations are reduced by a Schur
//! complement to the parameters that all windows share (variable projection), so neither the number of windows nor
//! the length of the recordings enters the size of the system that is solved.
//! RT: no.

use super::{Bound, FreeRuns, Point, Series, present};
use crate::base::linalg::inner_product;
use crate::identify::noise::{Colour, loss, weight};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

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
pub(super) struct Reduced {
    windows: Vec<Normal>,
    /// Undamped.
    pub(super) pp: DMatrix<f64>,
    pub(super) cost: f64,
}

pub(super) fn has_weight(colour: &Colour) -> bool {
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
            g[a] += inner_product(slope, &pull);
        }
        residual.iter().map(|x| loss(*x)).sum()
    }

    /// Adds `J'WJ` to `h`.
    fn products(&self, residual: &[f64], h: &mut DMatrix<f64>) {
        let weights: Vec<f64> = residual.iter().map(|x| weight(*x)).collect();
        for (a, slope) in self.slopes.iter().enumerate() {
            let weighted: Vec<f64> = slope.iter().zip(&weights).map(|(x, w)| x * w).collect();
            for (b, other) in self.slopes.iter().enumerate().take(a + 1) {
                let x = inner_product(&weighted, other);
                h[(a, b)] += x;
                if a != b {
                    h[(b, a)] += x;
                }
            }
        }
    }
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
pub(super) fn linearise(runs: &impl FreeRuns, at: &Point, noise: &[Colour]) -> Option<Reduced> {
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

/// A step and the fall of cost that the linear model promises for it.
pub(super) struct Step {
    parameters: DVector<f64>,
    states: Vec<DVector<f64>>,
    pub(super) promised: f64,
}

impl Reduced {
    /// The same derivatives with another residual.
    pub(super) fn renew(&mut self, residuals: Vec<Vec<Series>>, noise: &[Colour]) {
        self.windows.par_iter_mut().zip(residuals).for_each(|(window, channels)| window.renew(channels, noise));
        self.cost = self.windows.iter().map(|w| w.cost).sum();
    }

    /// Damped Gauss-Newton step within the bounds: parameters that would leave are held at their bound and the rest
    /// is solved again, so that the others make up for it.
    pub(super) fn step(&self, at: &Point, bounds: &[Bound], damping: f64) -> Step {
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

pub(super) fn moved(at: &Point, step: &Step, bounds: &[Bound]) -> Point {
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

#[cfg(test)]
mod tests {
    use super::super::looked;
    use super::super::tests::{Decay, start};
    use super::*;

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
}
