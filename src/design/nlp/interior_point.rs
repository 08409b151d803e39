//! Primal-dual interior point with a filter line search. RT: no.
//!
//! Source: Wächter, Biegler 2006 (IPOPT), whose constants these are where nothing else is said: monotone barrier,
//! second-order correction, inertia correction by a shift of the Hessian. There is no restoration phase: a program whose
//! line search fails is solved once more with soft rows (ℓ1, exact for a high price), which either finds a feasible point
//! or tells which rows cannot be met.

use super::step::{Residual, State, Step};
use super::{Nlp, Size};

/// How to solve.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Largest scaled error of a solution.
    pub tolerance: f64,
    /// Iterations allowed.
    pub iterations: usize,
    /// First barrier parameter: small for a start that is almost a solution.
    pub barrier: f64,
    /// Factor on the cost.
    pub cost_scale: f64,
    /// Price of broken rows; `None`: nothing is soft.
    pub price: Option<f64>,
}

impl Options {
    /// From a rough guess.
    pub const COLD: Self = Self { tolerance: 1e-8, iterations: 200, barrier: 0.1, cost_scale: 1.0, price: None };
    /// From a rough guess, where giving up soon costs little: the softened program follows.
    pub const QUICK: Self = Self { iterations: 60, ..Self::COLD };
    /// From the solution of a coarser program.
    pub const SEEDED: Self = Self { barrier: 1e-4, ..Self::COLD };
    /// Which rows cannot be met? The price is a thousand times the cost's weight, above every multiplier of interest.
    pub const ELASTIC: Self =
        Self { cost_scale: 1e-3, price: Some(1.0), tolerance: 1e-6, iterations: 120, ..Self::COLD };
}

/// How it ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Optimal within the tolerance.
    Converged,
    /// The iterations ran out.
    IterationLimit,
    /// No step improves cost or feasibility.
    Stalled,
}

/// A point with its multipliers.
#[derive(Clone, Debug)]
pub struct Iterate {
    /// Variables.
    pub w: Vec<f64>,
    /// Multipliers of the equations.
    pub lambda: Vec<f64>,
    /// Multipliers of the inequalities.
    pub y: Vec<f64>,
}

/// Result of a solve: the last point, whatever the outcome.
#[derive(Clone, Debug)]
pub struct Solved {
    /// How it ended.
    pub outcome: Outcome,
    /// Where.
    pub at: Iterate,
    /// Cost there, not scaled.
    pub cost: f64,
    /// Largest broken equation or bound.
    pub infeasibility: f64,
    /// Scaled error of optimality.
    pub error: f64,
    /// Iterations used.
    pub iterations: usize,
}

/// Barrier, filter and shift on their way.
struct Search<'a> {
    nlp: &'a mut dyn Nlp,
    options: Options,
    state: State,
    mu: f64,
    cost: f64,
    residual: Residual,
    c: Vec<f64>,
    g: Vec<f64>,
    filter: Vec<(f64, f64)>,
    theta_max: f64,
    theta_min: f64,
    last_shift: f64,
}

/// Solves from `w`.
pub fn solve(nlp: &mut dyn Nlp, w: Vec<f64>, options: &Options) -> Solved {
    let mut search = Search::new(nlp, w, options);
    let mut outcome = Outcome::IterationLimit;
    let mut iterations = 0;
    while iterations < options.iterations {
        search.linearise();
        let error = search.error(0.0);
        if error <= options.tolerance {
            outcome = Outcome::Converged;
            break;
        }
        search.lower_barrier();
        if !search.advance() {
            outcome = Outcome::Stalled;
            break;
        }
        iterations += 1;
    }
    search.result(outcome, iterations)
}

impl<'a> Search<'a> {
    fn new(nlp: &'a mut dyn Nlp, w: Vec<f64>, options: &Options) -> Self {
        let push = options.barrier.clamp(1e-6, 1e-2);
        let state = State::new(nlp, w, options.price, push, options.barrier);
        let Size { m, p, .. } = nlp.size();
        let (mut c, mut g) = (vec![0.0; m], vec![0.0; p]);
        let cost = nlp.values(&state.w, &mut c, &mut g);
        let residual = state.residual(&c, &g);
        let theta = residual.sum();
        Self {
            nlp,
            options: *options,
            state,
            mu: options.barrier,
            cost,
            residual,
            c,
            g,
            filter: Vec::new(),
            theta_max: 1e4 * theta.max(1.0),
            theta_min: 1e-4 * theta.max(1.0),
            last_shift: 0.0,
        }
    }

    fn linearise(&mut self) {
        let s = &self.state;
        self.nlp.linearise(&s.w, &s.lambda, &s.y, self.options.cost_scale);
    }

    /// Scaled error of the optimality conditions at a barrier, Wächter and Biegler (5).
    fn error(&self, mu: f64) -> f64 {
        let mut gradient = self.nlp.cost_gradient().to_vec();
        self.nlp.add_transposed(&self.state.lambda, &self.state.y, &mut gradient);
        let stationarity = gradient.iter().fold(self.state.slack_stationarity(), |a, x| a.max(x.abs()));
        let scale = self.state.scales();
        (stationarity / scale).max(self.residual.largest()).max(self.state.complementarity(mu) / scale)
    }

    fn lower_barrier(&mut self) {
        let floor = self.options.tolerance / 10.0;
        while self.mu > floor && self.error(self.mu) <= 10.0 * self.mu {
            self.mu = (0.2 * self.mu).min(self.mu.powf(1.5)).max(floor);
            self.filter.clear();
        }
    }

    fn merit(&self, state: &State, cost: f64) -> f64 {
        self.options.cost_scale * cost + state.barrier(self.mu)
    }

    /// Factors with the smallest shift that gives the right inertia. Source: IPOPT's algorithm IC.
    fn factor(&mut self, sigma: &[f64], soft: &[f64]) -> bool {
        if self.nlp.factor(sigma, 0.0, soft) {
            return true;
        }
        let mut shift = if self.last_shift > 0.0 { (self.last_shift / 3.0).max(1e-20) } else { 1e-4 };
        while shift < 1e20 {
            if self.nlp.factor(sigma, shift, soft) {
                self.last_shift = shift;
                return true;
            }
            shift *= if self.last_shift > 0.0 { 8.0 } else { 100.0 };
        }
        false
    }

    /// One accepted step; false if there is none.
    fn advance(&mut self) -> bool {
        let (sigma, soft) = self.state.weights();
        if !self.factor(&sigma, &soft) {
            return false;
        }
        let step = self.state.step(self.nlp, &sigma, &self.residual, self.mu);
        if step.w.iter().any(|x| !x.is_finite()) {
            return false;
        }
        let tau = (1.0 - self.mu).max(0.99);
        let (primal, dual) = self.state.to_the_boundary(&step, tau);
        let Some((state, step, share)) = self.line_search(&step, &sigma, primal, tau) else { return false };
        self.state = state;
        self.state.move_multipliers(&step, share, dual, self.mu);
        true
    }

    fn line_search(&mut self, step: &Step, sigma: &[f64], longest: f64, tau: f64) -> Option<(State, Step, f64)> {
        let (theta, phi) = (self.residual.sum(), self.merit(&self.state, self.cost));
        let slope = self.nlp.cost_gradient().iter().zip(&step.w).map(|(g, d)| g * d).sum::<f64>()
            + self.state.barrier_slope(step, self.mu);
        let mut share = longest;
        let shortest = shortest_share(theta, slope, self.theta_min) * 0.05;
        let mut corrected = false;
        // Below the noise of rounding a full step is taken as it is.
        let noise = 10.0 * f64::EPSILON * phi.abs();
        while share >= shortest {
            let trial = self.state.moved(step, share);
            let (cost, residual) = self.evaluate(&trial);
            let (theta_trial, phi_trial) = (residual.sum(), self.merit(&trial, cost));
            if self.accepts(theta, phi, slope, share, theta_trial, phi_trial - noise) {
                self.take(cost, residual);
                return Some((trial, step.clone(), share));
            }
            if !corrected && theta_trial >= theta && share >= longest {
                corrected = true;
                if let Some(found) = self.second_order(sigma, &residual, longest, tau, (theta, phi, slope)) {
                    return Some(found);
                }
            }
            share *= 0.5;
        }
        None
    }

    /// Second-order correction: the step with the trial's own curvature of the constraints.
    fn second_order(
        &mut self,
        sigma: &[f64],
        trial: &Residual,
        share: f64,
        tau: f64,
        (theta, phi, slope): (f64, f64, f64),
    ) -> Option<(State, Step, f64)> {
        let both = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| share * a + b).collect();
        let residual = Residual { c: both(&self.residual.c, &trial.c), g: both(&self.residual.g, &trial.g) };
        let step = self.state.step(self.nlp, sigma, &residual, self.mu);
        let (primal, _) = self.state.to_the_boundary(&step, tau);
        let to = self.state.moved(&step, primal);
        let (cost, residual) = self.evaluate(&to);
        let accepted = self.accepts(theta, phi, slope, primal, residual.sum(), self.merit(&to, cost));
        accepted.then(|| {
            self.take(cost, residual);
            (to, step, primal)
        })
    }

    fn evaluate(&mut self, at: &State) -> (f64, Residual) {
        let cost = self.nlp.values(&at.w, &mut self.c, &mut self.g);
        (cost, at.residual(&self.c, &self.g))
    }

    fn take(&mut self, cost: f64, residual: Residual) {
        (self.cost, self.residual) = (cost, residual);
    }

    /// The filter's decision, Wächter and Biegler (18)-(20); a step that does not go downhill enters the filter.
    fn accepts(&mut self, theta: f64, phi: f64, slope: f64, share: f64, to_theta: f64, to_phi: f64) -> bool {
        if !to_theta.is_finite() || !to_phi.is_finite() || to_theta > self.theta_max {
            return false;
        }
        if self.filter.iter().any(|(t, p)| to_theta >= *t && to_phi >= *p) {
            return false;
        }
        let descent = slope < 0.0 && share * (-slope).powf(2.3) > theta.powf(1.1);
        if theta <= self.theta_min && descent {
            return to_phi <= phi + 1e-4 * share * slope;
        }
        let better = to_theta <= (1.0 - 1e-5) * theta || to_phi <= phi - 1e-8 * theta;
        if better && !(descent && to_phi <= phi + 1e-4 * share * slope) {
            self.filter.push(((1.0 - 1e-5) * theta, phi - 1e-8 * theta));
        }
        better
    }

    fn result(mut self, outcome: Outcome, iterations: usize) -> Solved {
        self.linearise();
        let error = self.error(0.0);
        let infeasibility = self.infeasibility();
        let State { w, lambda, y, .. } = self.state;
        Solved { outcome, at: Iterate { w, lambda, y }, cost: self.cost, infeasibility, error, iterations }
    }

    /// Of the program as given, soft or not.
    fn infeasibility(&mut self) -> f64 {
        self.nlp.values(&self.state.w, &mut self.c, &mut self.g);
        let rows = (0..self.g.len()).map(|i| (self.state.low[i] - self.g[i]).max(self.g[i] - self.state.high[i]));
        rows.chain(self.c.iter().map(|c| c.abs())).fold(0.0, f64::max)
    }
}

/// Shortest share worth trying, Wächter and Biegler (23).
fn shortest_share(theta: f64, slope: f64, theta_min: f64) -> f64 {
    if slope >= 0.0 {
        return 1e-5;
    }
    let by_merit = 1e-8 * theta / -slope;
    if theta <= theta_min {
        1e-5_f64.min(by_merit).min(theta.powf(1.1) / (-slope).powf(2.3)).max(1e-12)
    } else {
        1e-5_f64.min(by_merit).max(1e-10)
    }
}
