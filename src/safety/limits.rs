//! What torque and toes may pass. Total: any input, finite or not, gives a finite output within limits. RT: yes.

use crate::base::time::Span;
use crate::config::checked::Limits;
use crate::msg::{FaultCode, TOES};

/// Limits torque and its rate.
#[derive(Clone, Copy, Debug)]
pub(super) struct TorqueGate {
    limit_nm: f64,
    step_nm: f64,
    last_nm: f64,
    active: Option<(FaultCode, f64)>,
}

impl TorqueGate {
    /// Shut.
    pub(super) fn new(limits: &Limits, period: Span) -> Self {
        let step_nm = limits.hip_torque_rate_nm_s * period.as_s();
        Self { limit_nm: limits.hip_torque_nm, step_nm, last_nm: 0.0, active: None }
    }

    /// Lets through what fits under `ramp` times the limit, and not faster than the rate allows.
    pub(super) fn pass(&mut self, wanted_nm: f64, ramp: f64) -> f64 {
        let wanted_nm = if wanted_nm.is_finite() { wanted_nm } else { 0.0 };
        let bound_nm = self.limit_nm * ramp;
        let bounded_nm = wanted_nm.max(-bound_nm).min(bound_nm);
        let passed_nm = slew(self.last_nm, bounded_nm, self.step_nm);
        self.active = if wanted_nm.abs() > bound_nm {
            Some((FaultCode::TorqueLimited, wanted_nm))
        } else if (bounded_nm - self.last_nm).abs() > self.step_nm {
            Some((FaultCode::TorqueRateLimited, (bounded_nm - self.last_nm) / self.step_nm))
        } else {
            None
        };
        self.last_nm = passed_nm;
        passed_nm
    }

    /// Zero at once: a fault does not ramp down.
    pub(super) fn close(&mut self) -> f64 {
        self.active = None;
        self.last_nm = 0.0;
        0.0
    }

    /// The limit that is at work, with what was asked for.
    pub(super) const fn active(&self) -> Option<(FaultCode, f64)> {
        self.active
    }
}

/// Limits the toes' stroke and speed.
#[derive(Clone, Copy, Debug)]
pub(super) struct ToeSlew {
    stroke_m: f64,
    step_m: f64,
    last_m: [f64; TOES],
}

impl ToeSlew {
    /// Retracted.
    pub(super) fn new(stroke_m: f64, rate_m_s: f64, period: Span) -> Self {
        Self { stroke_m, step_m: rate_m_s * period.as_s(), last_m: [0.0; TOES] }
    }

    /// Goes towards what is wanted from where the toes last were.
    pub(super) fn follow(&mut self, wanted_m: &[f64; TOES]) -> [f64; TOES] {
        for (last, wanted) in self.last_m.iter_mut().zip(wanted_m) {
            if wanted.is_finite() {
                *last = slew(*last, wanted.max(0.0).min(self.stroke_m), self.step_m);
            }
        }
        self.last_m
    }

    /// Stays where the toes are measured: the next [`ToeSlew::follow`] starts without a jump.
    pub(super) fn stay(&mut self, measured_m: &[f64; TOES]) -> [f64; TOES] {
        for (last, measured) in self.last_m.iter_mut().zip(measured_m) {
            if measured.is_finite() {
                *last = measured.max(0.0).min(self.stroke_m);
            }
        }
        self.last_m
    }
}

/// From `last` towards `target`, at most by `step`.
fn slew(last: f64, target: f64, step: f64) -> f64 {
    last + (target - last).max(-step).min(step)
}
