//! From truth to reading: lag, delay, clock, scale, eccentricity, offsets.
//!
//! The lag follows the motion exactly for a truth that is linear over a step, and vanishes smoothly at zero. Times are
//! those of the recording's own clock.
//! RT: yes, no allocation after building.

use crate::base::scalar::Scalar;
use crate::model::mechanism::{MAX, Row};

/// One sensor with everything that stands between truth and reading.
#[derive(Clone, Debug)]
pub struct Pickup<S> {
    /// What it measures, in generalised coordinates or rates.
    pub row: Row,
    /// It reads the rate.
    pub is_rate: bool,
    /// First-order lag, s; none if no effect names it.
    pub lag: Option<S>,
    /// Pure delay, s.
    pub delay: S,
    /// The reading labelled t was taken at t / (1 + skew).
    pub skew: S,
    /// Factor.
    pub scale: S,
    /// Offset.
    pub bias: S,
    /// Offset per second.
    pub drift: S,
    /// amplitude · sin(angle + phase).
    pub eccentricity: Option<(S, S)>,
    /// Jumps: step and time.
    pub jumps: Vec<(S, S)>,
}

impl<S: Scalar> Pickup<S> {
    /// A perfect sensor.
    #[must_use]
    pub fn new(row: Row, is_rate: bool) -> Self {
        let zero = S::zero();
        Self {
            row,
            is_rate,
            lag: None,
            delay: zero,
            skew: zero,
            scale: S::one(),
            bias: zero,
            drift: zero,
            eccentricity: None,
            jumps: Vec::new(),
        }
    }

    /// The true quantity.
    #[inline]
    #[must_use]
    pub fn truth(&self, q: &[S; MAX], v: &[S; MAX]) -> S {
        self.row.of(if self.is_rate { v } else { q })
    }

    /// True if its readings come from another instant than their label says, or do so to first order.
    #[must_use]
    pub fn is_shifted(&self) -> bool {
        self.delay.value() != 0.0 || self.delay.is_varied() || self.skew.value() != 0.0 || self.skew.is_varied()
    }

    /// When the reading labelled `t` was taken.
    #[must_use]
    pub fn taken_at(&self, t: S) -> S {
        t / (self.skew + 1.0) - self.delay
    }

    /// The lagged signal after `h` in which the truth went from `y0` to `y1` on a straight line.
    #[must_use]
    pub fn follow(&self, lagged: S, y0: S, y1: S, h: S) -> S {
        let Some(lag) = self.lag else { return y1 };
        if h.value() <= 0.0 {
            return lagged;
        }
        let slope = (y1 - y0) / h;
        let steady = y1 - lag * slope;
        if lag.value() <= SHORTEST_LAG_S {
            return steady;
        }
        steady + (lagged - y0 + lag * slope) * (-(h / lag)).exp()
    }

    /// The reading labelled `t`, from the (lagged, delayed) signal and the angle at that instant.
    #[inline]
    #[must_use]
    pub fn reading(&self, signal: S, t: S) -> S {
        let mut y = signal * self.scale + self.bias;
        if let Some((amplitude, phase)) = self.eccentricity {
            y += amplitude * (signal + phase).sin();
        }
        if self.drift.value() != 0.0 || self.drift.is_varied() {
            y += self.drift * t;
        }
        for (step, time) in &self.jumps {
            if t.value() >= time.value() {
                y += *step;
            }
        }
        y
    }
}

/// A lag below this is none: far below any step.
pub const SHORTEST_LAG_S: f64 = 1e-7;
