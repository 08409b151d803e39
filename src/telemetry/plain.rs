//! One line for a log: what a person would look at first. RT: no.

use super::state::{State, mode_name, terrain_in_words};
use crate::msg::{FaultCode, Motion, RecorderState};
use hdrhistogram::Histogram;

/// The line.
pub(super) fn line(state: &State) -> String {
    let (estimate, status) = (&state.tick.estimate, &state.tick.status);
    let mut line = format!(
        "{:9.3} s  {:8}  {:5}  stance {:+7.3}  swing {:+7.3} deg  hip {:+7.2} Nm  wake {} us  step {} us  skipped {}",
        state.elapsed().as_s(),
        mode_name(status.mode),
        estimate.stance.name().to_lowercase(),
        estimate.theta_stance_rad.to_degrees(),
        estimate.theta_swing_rad.to_degrees(),
        state.tick.allowed.hip_torque_nm,
        percentiles(&state.wake_ns),
        percentiles(&state.step_ns),
        status.overruns,
    );
    let doing = &state.tick.control;
    if doing.motion != Motion::Stand {
        line += &format!("  {} step {}", doing.motion.name(), doing.steps);
    }
    if let Some(terrain) = terrain_in_words(&state.tick.terrain) {
        line += &format!("  terrain: {terrain}");
    }
    if status.first_fault.code != FaultCode::None {
        line += &format!("  fault {}", status.first_fault.code.name());
    }
    let recorder = &state.side.recorder;
    if recorder.state != RecorderState::Off {
        line += &format!("  recorded {} lost {}", recorder.written, recorder.dropped);
    }
    line
}

/// Median, 99th percentile and maximum in microseconds.
fn percentiles(ns: &Histogram<u64>) -> String {
    let us = |value: u64| format!("{:.1}", microseconds(value));
    [us(ns.value_at_quantile(0.5)), us(ns.value_at_quantile(0.99)), us(ns.max())].join("/")
}

/// Nanoseconds as microseconds.
#[expect(clippy::cast_precision_loss, reason = "to show")]
pub(super) fn microseconds(ns: u64) -> f64 {
    ns as f64 * 1e-3
}
