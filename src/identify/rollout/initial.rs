//! The initial state of a window: a guess from its first samples, and the least-squares fit over the whole window.
//!
//! RT: no.

use super::{Linearised, Readings, Rollout, RolloutError};
use crate::identify::theta::Theta;
use crate::model::machine::{Inner, Machine};
use nalgebra::{DMatrix, DVector};
use std::borrow::Cow;

/// Samples of the local line that gives the guess.
const GUESS_ROWS: usize = 12;
/// Limit of the Levenberg-Marquardt iterations; 4 to 8 are usual.
const MOST_ITERATIONS: usize = 40;
/// Rounds of probing.
const MOST_PROBES: usize = 4;
/// Probes, in parts of the number (or of [`SMALL`] if it is smaller).
const PROBES: [f64; 6] = [-1.0, -0.3, -0.05, 0.05, 0.3, 1.0];
/// rad or rad/s.
const SMALL: f64 = 0.02;
/// A probe must save this part of the cost.
const WORTHWHILE: f64 = 0.01;
/// A cost above this many times that of the noise makes other starts worth their time.
const NOISY: f64 = 1.3;
/// Parts of the window that the growing horizon takes first: an eighth, then a third.
const PARTS: [usize; 2] = [8, 3];
/// Relative gain, had or promised, below which the fit has arrived.
const ARRIVED: f64 = 1e-10;
/// Damping at the start, growth and decay.
const DAMPING: f64 = 1e-4;
const HARDER: f64 = 8.0;
const EASIER: f64 = 0.2;
/// Beyond this damping no step helps.
const HARDEST: f64 = 1e10;

impl Rollout<'_> {
    /// A start for [`Self::fit_initial`], from the samples at the beginning of the window.
    #[must_use]
    pub fn guess(&self, window: usize) -> Vec<f64> {
        let Ok(machine) = self.plain_machine() else { return Vec::new() };
        let layout = machine.initial_layout();
        let mut guess = vec![0.0; layout.len()];
        let coordinates = layout.iter().filter(|i| matches!(i, Inner::Coordinate(_))).count();
        let (angles, rates) = self.local_lines(&machine, window, coordinates);
        for (x, what) in guess.iter_mut().zip(&layout) {
            match *what {
                Inner::Coordinate(i) => *x = angles[i],
                Inner::Rate(i) => *x = rates[i],
                _ => {}
            }
        }
        guess
    }

    /// Least-squares angle and rate of each generalised coordinate from lines through the first samples.
    fn local_lines(&self, machine: &Machine<f64>, window: usize, n: usize) -> (DVector<f64>, DVector<f64>) {
        let rows = self.windows[window].clone();
        let times = &self.recording.times;
        let (mut angle, mut rate) = (Normal::new(n), Normal::new(n));
        for channel in 0..self.setting.sensors.len() {
            // Only the first rows: a leg that is measured later in the window says nothing about its start.
            let first = rows.clone().take(GUESS_ROWS);
            let samples = first.map(|r| (times[r] - times[rows.start], self.recording.measured[channel][r]));
            let samples: Vec<(f64, f64)> = samples.filter(|(_, y)| !y.is_nan()).collect();
            let Some((y0, slope)) = line(&samples) else { continue };
            let row = machine.sensor_row(channel, n);
            if self.setting.sensors[channel].is_rate {
                rate.add(&row, machine.undo_offsets(channel, y0), SURE);
            } else {
                angle.add(&row, machine.undo_offsets(channel, y0), 1.0);
                rate.add(&row, slope, 1.0);
            }
        }
        (angle.solve(), rate.solve())
    }

    /// The initial state that fits the window best, each channel multiplied by its weight (1 / pooled deviation; 0 for a
    /// channel that is only noise).
    ///
    /// Sticking and impacts make plateaus where derivatives say nothing: where the residual stays above the noise of the
    /// samples, probes along every number look for a lower valley beside each minimum, and the fit is also made on a
    /// horizon that grows from the start of the window; the better one is taken.
    ///
    /// # Errors
    /// The simulation diverged from the start.
    pub fn fit_initial(&self, window: usize, weights: &[f64], start: &[f64]) -> Result<Vec<f64>, RolloutError> {
        let best = self.explore(window, weights, start)?;
        if best.1 <= NOISY * self.noise_cost(window, weights) {
            return Ok(best.0);
        }
        let grown = self.grown(window, weights, start);
        Ok(match self.explore(window, weights, &grown) {
            Ok(other) if other.1 < best.1 => other.0,
            _ => best.0,
        })
    }

    /// A better initial state than `fitted`, from where the window before arrives that starts `before`; `None` if there is none. Asked where
    /// more than noise stays and something is inside (a bristle, a spring): no first sample tells how far that is deflected.
    ///
    /// # Errors
    /// The simulation diverged.
    pub fn fit_initial_after(
        &self,
        window: usize,
        weights: &[f64],
        before: &[f64],
        fitted: &[f64],
    ) -> Result<Option<Vec<f64>>, RolloutError> {
        if self.rigid_len() == self.initial_len() {
            return Ok(None);
        }
        let mut readings = Readings::default();
        self.simulate(window, fitted, &mut readings)?;
        let cost = self.cost_of(window, weights, &readings);
        if cost <= NOISY * self.noise_cost(window, weights) {
            return Ok(None);
        }
        let Ok(Some(start)) = self.arrived(window - 1, before) else { return Ok(None) };
        let other = self.explore(window, weights, &start).ok();
        Ok(other.filter(|other| other.1 < cost).map(|other| other.0))
    }

    /// A start from fits on the first parts of the window.
    fn grown(&self, window: usize, weights: &[f64], start: &[f64]) -> Vec<f64> {
        let rows = self.windows[window].clone();
        let mut x = start.to_vec();
        for part in PARTS {
            let short = rows.start..rows.start + (rows.len() / part).max(2 * GUESS_ROWS).min(rows.len());
            let first = Rollout {
                recording: self.recording,
                setting: Cow::Borrowed(&self.setting),
                moved: self.moved.clone(),
                windows: vec![short],
                fidelity: self.fidelity,
                effort: self.effort,
            };
            if let Ok((next, _)) = first.explore(0, weights, &x) {
                x = next;
            }
        }
        x
    }

    /// Cost that the noise of the samples alone would have, from their second differences.
    fn noise_cost(&self, window: usize, weights: &[f64]) -> f64 {
        let rows = self.windows[window].clone();
        let one = |(weight, samples): (&f64, &Vec<f64>)| {
            let present: Vec<f64> = samples[rows.clone()].iter().copied().filter(|y| !y.is_nan()).collect();
            let bends: f64 = present.windows(3).map(|y| (y[0] - 2.0 * y[1] + y[2]) * (y[0] - 2.0 * y[1] + y[2])).sum();
            // White noise bends by six times its variance.
            weight * weight * bends / 6.0
        };
        weights.iter().zip(&self.recording.measured).map(one).sum()
    }

    /// The minimum below `start`, and lower valleys that probes find beside it where the machine makes any.
    fn explore(&self, window: usize, weights: &[f64], start: &[f64]) -> Result<(Vec<f64>, f64), RolloutError> {
        let mut best = self.descend(window, weights, start)?;
        if self.plain_machine()?.is_smooth() || best.1 <= NOISY * self.noise_cost(window, weights) {
            return Ok(best);
        }
        for _ in 0..MOST_PROBES {
            let Some(probe) = self.probe(window, weights, &best) else { break };
            let next = self.descend(window, weights, &probe)?;
            if next.1 >= best.1 {
                break;
            }
            best = next;
        }
        Ok(best)
    }

    /// Best of the points beside `best` that costs clearly less.
    fn probe(&self, window: usize, weights: &[f64], best: &(Vec<f64>, f64)) -> Option<Vec<f64>> {
        let mut readings = Readings::default();
        let (mut found, mut least) = (None, best.1 * (1.0 - WORTHWHILE));
        for i in 0..best.0.len() {
            for reach in PROBES {
                let mut x = best.0.clone();
                x[i] += reach * x[i].abs().max(SMALL);
                if self.simulate(window, &x, &mut readings).is_ok() {
                    let cost = self.cost_of(window, weights, &readings);
                    if cost < least {
                        (found, least) = (Some(x), cost);
                    }
                }
            }
        }
        found
    }

    /// Levenberg-Marquardt from `start`: the state and its cost.
    fn descend(&self, window: usize, weights: &[f64], start: &[f64]) -> Result<(Vec<f64>, f64), RolloutError> {
        let theta = Theta { entries: Vec::new(), values: Vec::new() };
        let (mut x, mut damping) = (DVector::from_column_slice(start), DAMPING);
        let mut lin = Linearised::default();
        let mut readings = Readings::default();
        self.linearise(&theta, window, x.as_slice(), &mut lin)?;
        let mut cost = weighted_cost(&lin, weights);
        for _ in 0..MOST_ITERATIONS {
            let (jtj, jtr) = normal_equations(&lin, weights);
            let mut improved = None;
            while improved.is_none() && damping < HARDEST {
                let step = damped_step(&jtj, &jtr, damping);
                if 2.0 * step.dot(&jtr) - step.dot(&(&jtj * &step)) <= ARRIVED * cost {
                    break;
                }
                let trial = &x + step;
                let trial_cost = match self.simulate(window, trial.as_slice(), &mut readings) {
                    Ok(()) => self.cost_of(window, weights, &readings),
                    Err(_) => f64::INFINITY,
                };
                if trial_cost < cost {
                    improved = Some((trial, trial_cost));
                    damping = (damping * EASIER).max(1e-12);
                } else {
                    damping *= HARDER;
                }
            }
            let Some((next, next_cost)) = improved else { break };
            let gain = cost - next_cost;
            (x, cost) = (next, next_cost);
            if gain <= ARRIVED * cost {
                break;
            }
            self.linearise(&theta, window, x.as_slice(), &mut lin)?;
        }
        Ok((x.as_slice().to_vec(), cost))
    }

    fn cost_of(&self, window: usize, weights: &[f64], readings: &Readings) -> f64 {
        let rows = self.windows[window].clone();
        let mut sum = 0.0;
        for ((weight, predicted), measured) in weights.iter().zip(&readings.channels).zip(&self.recording.measured) {
            let pairs = predicted.iter().zip(&measured[rows.clone()]).filter(|(_, y)| !y.is_nan());
            sum += weight * weight * pairs.map(|(p, y)| (y - p) * (y - p)).sum::<f64>();
        }
        sum
    }
}

/// Weight of a measured rate against the slope of angles.
const SURE: f64 = 3.0;

/// Small weighted least squares.
struct Normal {
    a: DMatrix<f64>,
    b: DVector<f64>,
}

impl Normal {
    fn new(n: usize) -> Self {
        // A faint pull to zero decides what no sensor sees.
        Self { a: DMatrix::identity(n, n) * 1e-9, b: DVector::zeros(n) }
    }
    fn add(&mut self, row: &[f64], y: f64, weight: f64) {
        let row = DVector::from_column_slice(row);
        self.a += &row * row.transpose() * weight;
        self.b += row * (y * weight);
    }
    fn solve(self) -> DVector<f64> {
        let n = self.b.len();
        self.a.cholesky().map_or_else(|| DVector::zeros(n), |c| c.solve(&self.b))
    }
}

/// Value at the first instant and slope of the line through samples.
fn line(samples: &[(f64, f64)]) -> Option<(f64, f64)> {
    let (&(t0, first), rest) = samples.split_first()?;
    if rest.is_empty() {
        return Some((first, 0.0));
    }
    let mut normal = Normal::new(2);
    for (t, y) in samples {
        normal.add(&[1.0, *t], *y, 1.0);
    }
    let x = normal.solve();
    // Samples that begin late say nothing about the start: take the line back to it.
    if t0 > LATE_S { Some((first, x[1])) } else { Some((x[0], x[1])) }
}

/// A first sample later than this is not extrapolated to the start, s.
const LATE_S: f64 = 0.1;

/// JᵀJ and Jᵀr of one window.
pub(super) fn normal_equations(lin: &Linearised, weights: &[f64]) -> (DMatrix<f64>, DVector<f64>) {
    let n = lin.columns;
    let (mut a, mut b) = (DMatrix::zeros(n, n), DVector::zeros(n));
    for (sample, residual) in lin.residual.iter().enumerate() {
        let weight = weights[sample / lin.rows];
        if residual.is_nan() || weight <= 0.0 {
            continue;
        }
        let row = &lin.jacobian[sample * n..(sample + 1) * n];
        for i in 0..n {
            let x = row[i] * weight * weight;
            b[i] += x * residual;
            for j in 0..=i {
                a[(i, j)] += x * row[j];
            }
        }
    }
    a.fill_upper_triangle_with_lower_triangle();
    (a, b)
}

fn weighted_cost(lin: &Linearised, weights: &[f64]) -> f64 {
    let terms = lin.residual.iter().enumerate().filter(|(_, r)| !r.is_nan());
    terms.map(|(sample, r)| (r * weights[sample / lin.rows]) * (r * weights[sample / lin.rows])).sum()
}

/// Step of Levenberg-Marquardt with the diagonal of JᵀJ as scale; a direction without effect stays.
fn damped_step(jtj: &DMatrix<f64>, jtr: &DVector<f64>, damping: f64) -> DVector<f64> {
    let n = jtr.len();
    let mut a = jtj.clone();
    let largest = (0..n).map(|i| jtj[(i, i)]).fold(0.0, f64::max);
    for i in 0..n {
        a[(i, i)] += damping * jtj[(i, i)] + largest * 1e-15 + f64::MIN_POSITIVE;
    }
    a.cholesky().map_or_else(|| DVector::zeros(n), |c| c.solve(jtr))
}
