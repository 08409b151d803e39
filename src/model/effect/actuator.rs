//! From command to torque: gain, delay, lag, limit, back-EMF.
//!
//! Commands are held constant between rows. The lag is solved in closed form between changes, so the torque at any
//! instant is exact. Order: gain, delay, lag, limit; the enable switch acts at once and last.
//! RT: yes, no allocation after [`Drive::new`].

use crate::base::scalar::Scalar;
use crate::model::mechanism::Row;
use std::collections::VecDeque;

/// A command on its way.
#[derive(Clone, Copy, Debug)]
struct Pending<S> {
    arrival: S,
    torque: S,
}

/// One actuator.
#[derive(Clone, Debug)]
pub struct Drive<S> {
    /// Coordinate that it drives (the rotor's on an elastic or loose joint).
    pub row: Row,
    /// Coordinate of the mechanism.
    pub joint: usize,
    gain: S,
    back_emf: S,
    brakes: bool,
    delay: S,
    lag: S,
    limit: Option<S>,
    enabled: bool,
    /// Torque that the lag tends to.
    target: S,
    /// Torque at `since`.
    start: S,
    since: S,
    pending: VecDeque<Pending<S>>,
}

/// Longest queue: a delay of 1 s at 4 kHz.
const QUEUE: usize = 4096;

impl<S: Scalar> Drive<S> {
    /// A drive at rest, enabled, torque zero.
    #[must_use]
    pub fn new(row: Row, joint: usize, gain: S, back_emf: S) -> Self {
        let zero = S::zero();
        Self {
            row,
            joint,
            gain,
            back_emf,
            brakes: back_emf.value() != 0.0 || back_emf.is_varied(),
            delay: zero,
            lag: zero,
            limit: None,
            enabled: true,
            target: zero,
            start: zero,
            since: zero,
            pending: VecDeque::new(),
        }
    }

    /// Adds a delay of the command.
    pub fn add_delay(&mut self, delay: S) {
        self.delay += delay;
        self.pending.reserve(QUEUE.saturating_sub(self.pending.len()));
    }

    /// Sets the time constant. At zero the first-order effect of a lag is that of a delay, and so it is differentiated.
    pub fn set_lag(&mut self, time_constant: S) {
        if time_constant.value() > SHORTEST_LAG_S {
            self.lag = time_constant;
        } else {
            self.add_delay(time_constant);
        }
    }

    /// Sets the saturation, Nm.
    pub fn set_limit(&mut self, limit: S) {
        self.limit = Some(limit);
    }

    /// True if a command takes effect later than it is given, or does so to first order.
    fn is_delayed(&self) -> bool {
        self.delay.value() > 0.0 || self.delay.is_varied()
    }

    /// Puts the drive at rest under a command that has always been there.
    pub fn settle(&mut self, command: f64, now: S) {
        let torque = self.gain * command;
        (self.target, self.start, self.since) = (torque, torque, now);
        self.pending.clear();
    }

    /// A command given at `now`.
    pub fn command(&mut self, command: f64, enabled: bool, now: S) {
        let torque = self.gain * command;
        self.enabled = enabled;
        if self.is_delayed() {
            if self.pending.len() >= QUEUE {
                self.pending.pop_front();
            }
            self.pending.push_back(Pending { arrival: now + self.delay, torque });
        } else {
            self.switch(torque, now);
        }
    }

    /// How long a command is felt, s.
    #[must_use]
    pub fn memory_s(&self) -> f64 {
        self.delay.value() + self.lag.value() * LAGS_FELT
    }

    /// When the next delayed command takes effect.
    #[must_use]
    pub fn next_arrival(&self) -> Option<S> {
        self.pending.front().map(|p| p.arrival)
    }

    /// Lets the next delayed command take effect.
    pub fn arrive(&mut self) {
        if let Some(pending) = self.pending.pop_front() {
            self.switch(pending.torque, pending.arrival);
        }
    }

    fn switch(&mut self, torque: S, now: S) {
        self.start = self.lagged(now);
        self.target = torque;
        self.since = now;
    }

    #[inline]
    fn lagged(&self, now: S) -> S {
        if self.lag.value() <= 0.0 {
            return self.target;
        }
        self.target + (self.start - self.target) * (-((now - self.since) / self.lag)).exp()
    }

    /// True if the torque depends on the rate.
    #[inline]
    #[must_use]
    pub const fn brakes(&self) -> bool {
        self.brakes
    }

    /// Torque at `now` while the motor turns at `rate`.
    #[inline]
    #[must_use]
    pub fn torque(&self, now: S, rate: S) -> S {
        if !self.enabled {
            return S::zero();
        }
        let mut torque = self.lagged(now);
        if let Some(limit) = self.limit {
            if torque.value() > limit.value() {
                torque = limit;
            } else if torque.value() < -limit.value() {
                torque = -limit;
            }
        }
        if self.brakes { torque - self.back_emf * rate } else { torque }
    }
}

/// After so many time constants a command is forgotten: e⁻²⁰ = 2e-9.
const LAGS_FELT: f64 = 20.0;
/// A lag below this is none: far below any step.
const SHORTEST_LAG_S: f64 = 1e-7;
