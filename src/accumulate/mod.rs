//! L3, room 2: the newest sample of each sensor, turned to joint units and given its age. RT: yes.
//!
//! A source that is silent does not stop the walk: its last reading stays, its age grows, and `safety` judges the age.
//! A source that never spoke reads zero at an age beyond every limit.
//!
//! Limits: no interpolation to a common instant. At 1 kHz the samples lie within one period of each other; the
//! observer takes them as simultaneous.

#![cfg_attr(
    not(test),
    deny(
        clippy::disallowed_methods,
        clippy::disallowed_types,
        clippy::disallowed_macros,
        clippy::expect_used,
        clippy::indexing_slicing
    )
)]

mod joint;

use crate::base::time::{Span, Stamp};
use crate::config::checked::Robot;
use crate::msg::{DriveFeedback, DriveFeedbacks, ImuBatch, ImuSample, OperatorSample, Snapshot, TOES};
use joint::Joints;

/// Remembers the newest of each sensor.
#[derive(Clone, Debug)]
pub struct Accumulator {
    joints: Joints,
    imu: Option<ImuSample>,
    operator_age: Span,
    /// Speed of the operator's stick at its end, m/s; none without a stick.
    highest_m_s: Option<f64>,
}

impl Accumulator {
    /// Remembers nothing yet; the factors from drive units to joint units are computed here.
    #[must_use]
    pub fn new(robot: &Robot) -> Self {
        Self {
            joints: Joints::new(robot),
            imu: None,
            operator_age: robot.limits.operator_age,
            highest_m_s: robot.operator_speed.map(|speed| speed.highest_m_s),
        }
    }

    /// The newest of each sensor at `now`.
    pub fn snapshot(
        &mut self,
        now: Stamp,
        drives: &DriveFeedbacks,
        imu: &ImuBatch,
        operator: &OperatorSample,
    ) -> Snapshot {
        self.imu = imu.as_slice().last().copied().or(self.imu);
        let sample = self.imu.unwrap_or_default();
        let [hip, ..] = &drives.drives;
        Snapshot {
            stamp: now,
            imu: sample,
            imu_age: self.imu.map_or(age(now, Stamp::NEVER), |s| age(now, s.stamp)),
            leg_angle_rad: self.joints.leg_angle_rad(&sample),
            leg_rate_rad_s: self.joints.leg_rate_rad_s(&sample),
            hip_angle_rad: self.joints.hip_angle_rad(hip),
            hip_torque_nm: self.joints.hip_torque_nm(hip),
            hip_age: age(now, hip.stamp),
            toe_position_m: toes(drives).map(|toe| self.joints.toe_position_m(toe)),
            toe_spring_m: toes(drives).map(|toe| self.joints.toe_spring_m(toe)),
            toe_age: toes(drives).map(|toe| age(now, toe.stamp)).into_iter().max().unwrap_or(Span(i64::MAX)),
            operator_age: age(now, operator.stamp),
            dead_man: operator.dead_man,
            asked_m_s: self.asked_m_s(now, operator),
            ..Snapshot::default()
        }
    }

    /// What the stick asks for, as long as a hand that is heard of holds the switch.
    fn asked_m_s(&self, now: Stamp, operator: &OperatorSample) -> f64 {
        let Some(highest_m_s) = self.highest_m_s else { return 0.0 };
        let holds = operator.dead_man && age(now, operator.stamp) <= self.operator_age;
        let can_be = (0.0..=highest_m_s).contains(&operator.speed_m_s);
        if holds && can_be { operator.speed_m_s } else { 0.0 }
    }
}

/// Age at `now`; the time before the clock's zero counts as "never spoke".
fn age(now: Stamp, stamp: Stamp) -> Span {
    if stamp == Stamp::NEVER { Span(i64::MAX) } else { now.since(stamp) }
}

/// The four toes' feedback, in the order of [`crate::msg::Drive`].
fn toes(drives: &DriveFeedbacks) -> [&DriveFeedback; TOES] {
    let [_hip, inner_a, inner_b, outer_a, outer_b] = &drives.drives;
    [inner_a, inner_b, outer_a, outer_b]
}

#[cfg(test)]
mod tests;
