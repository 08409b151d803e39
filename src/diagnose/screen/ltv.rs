//! The base solution made linear, row by row: what any small force or sensor error would have done to the readings.
//!
//! A candidate that adds a force `f(t)` at a joint has the response of the linear time-varying system
//! `x_(k+1) = Phi_k x_k + Gamma_k f_k`, `y_k = C x_k`. With `Phi`, `Gamma` at hand, thousands of candidate forces (every
//! order of ripple, every instant of a push, a free curve over angle, rate or time) cost microseconds each.
//! RT: no.

use crate::diagnose::screen::score_test::Column;
use nalgebra::{SMatrix, SVector};

/// Most numbers of a rigid mechanism's state; shorter ones are padded with zeros.
pub const STATES: usize = 4;

/// Most named coordinates.
pub const JOINTS: usize = 3;

/// From a state to the next.
pub type StateMap = SMatrix<f64, STATES, STATES>;

/// From forces to the next state: columns are joints.
pub type InputMap = SMatrix<f64, STATES, JOINTS>;

/// A state, or a reading by the state.
pub type StateRow = SVector<f64, STATES>;

/// One window of the base solution, linearised.
#[derive(Clone, Debug, Default)]
pub struct LtvWindow {
    /// Index of the recording.
    pub recording: usize,
    /// Time of each row, s of the recording.
    pub t_s: Vec<f64>,
    /// State (coordinates, then rates) at each row.
    pub states: Vec<Vec<f64>>,
    /// From row k to row k+1: derivative of the next state by the state.
    pub phi: Vec<StateMap>,
    /// Derivative of the next state by a constant force at each joint during the row.
    pub gamma: Vec<InputMap>,
    /// Rate of each coordinate by state.
    pub rates: Vec<StateRow>,
    /// Readings by state, per channel.
    pub output: Vec<StateRow>,
}

impl LtvWindow {
    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.t_s.len()
    }

    /// A window in which nothing acts, for a first look at others: its response is empty.
    #[must_use]
    pub fn left_out(&self) -> Self {
        Self { recording: self.recording, ..Self::default() }
    }

    /// Response of the channels to a force at `joint` given per row.
    #[must_use]
    pub fn respond(&self, joint: usize, force: impl Fn(usize) -> f64) -> Vec<Vec<f64>> {
        let mut out = vec![Vec::with_capacity(self.rows()); self.output.len()];
        let mut x = StateRow::zeros();
        let mut quiet = true;
        for k in 0..self.rows() {
            for (channel, row) in out.iter_mut().zip(&self.output) {
                channel.push(if quiet { 0.0 } else { row.dot(&x) });
            }
            let f = force(k);
            quiet &= f == 0.0;
            if k + 1 < self.rows() && !quiet {
                x = self.phi[k] * x + self.gamma[k].column(joint) * f;
            }
        }
        out
    }

    /// A signal added to one channel, the others untouched.
    #[must_use]
    pub fn reading(&self, channel: usize, signal: impl Fn(usize) -> f64) -> Vec<Vec<f64>> {
        let mut out = vec![vec![0.0; self.rows()]; self.output.len()];
        out[channel] = (0..self.rows()).map(signal).collect();
        out
    }
}

/// Response of all windows to a force at `joint` that depends on window and row.
#[must_use]
pub fn force_column(windows: &[LtvWindow], joint: usize, force: impl Fn(&LtvWindow, usize) -> f64) -> Column {
    windows.iter().map(|w| w.respond(joint, |k| force(w, k))).collect()
}

/// A signal on one channel in all windows.
#[must_use]
pub fn reading_column(windows: &[LtvWindow], channel: usize, signal: impl Fn(&LtvWindow, usize) -> f64) -> Column {
    windows.iter().map(|w| w.reading(channel, |k| signal(w, k))).collect()
}

/// A force in one window only.
#[must_use]
pub fn local_force(windows: &[LtvWindow], only: usize, joint: usize, force: impl Fn(usize) -> f64) -> Column {
    let mut column: Column = vec![Vec::new(); windows.len()];
    column[only] = windows[only].respond(joint, force);
    column
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A unit mass on one axis, 10 ms rows, 100 rows, reading its position.
    pub(crate) fn mass() -> LtvWindow {
        let h = 0.01;
        LtvWindow {
            recording: 0,
            t_s: (0..100).map(|k| f64::from(k) * h).collect(),
            states: (0..100).map(|k| vec![f64::from(k) * h, 1.0]).collect(),
            phi: vec![
                StateMap::from_fn(|i, j| [[1.0, h], [0.0, 1.0]]
                    .get(i)
                    .and_then(|r| r.get(j))
                    .copied()
                    .unwrap_or(0.0));
                100
            ],
            gamma: vec![InputMap::from_fn(|i, j| if j == 0 { [0.5 * h * h, h, 0.0, 0.0][i] } else { 0.0 }); 100],
            rates: vec![StateRow::new(0.0, 1.0, 0.0, 0.0)],
            output: vec![StateRow::new(1.0, 0.0, 0.0, 0.0)],
        }
    }

    #[test]
    fn constant_force_moves_a_mass_by_half_a_t_squared() {
        let y = mass().respond(0, |_| 2.0);
        assert!((y[0][99] - 0.99 * 0.99).abs() < 1e-12);
    }

    #[test]
    fn in_a_window_that_is_left_out_nothing_acts() {
        let column = force_column(&[mass(), mass().left_out()], 0, |_, _| 2.0);
        assert!(!column[0].is_empty() && column[1].is_empty());
    }

    #[test]
    fn a_push_acts_only_after_it() {
        let y = mass().respond(0, |k| if k == 50 { 100.0 } else { 0.0 });
        assert!(y[0][50].abs() < 1e-15 && (y[0][99] - 0.485).abs() < 1e-9, "{}", y[0][99]);
    }
}
