//! Leg angles from the snapshot, forwarded to the tick's instant. RT: yes.

use super::attitude::Attitude;
use crate::base::time::{Span, Stamp};
use crate::config::checked::Robot;
use crate::msg::{Leg, Snapshot};

/// Time constant of the hip rate by differences, s: only used until the observer starts.
const DIFFERENCE_TIME_S: f64 = 0.02;

/// Angles and rates of both legs now, rad and rad/s: inner, outer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Measured {
    pub(super) angle_rad: [f64; 2],
    /// Rates with the hip's filtered.
    pub(super) rate_rad_s: [f64; 2],
    /// Rates in the middle of the last period: plain difference of the hip, mean of the gyro. Noisy, not late.
    pub(super) prompt_rad_s: [f64; 2],
}

impl Measured {
    /// `[θs, θw, θ̇s, θ̇w]`, hip rate filtered.
    pub(super) const fn stance_first(&self, stance: Leg) -> [f64; 4] {
        by_stance(self.angle_rad, self.rate_rad_s, stance)
    }

    /// `[θs, θw, θ̇s, θ̇w]`, hip rate prompt.
    pub(super) const fn prompt_stance_first(&self, stance: Leg) -> [f64; 4] {
        by_stance(self.angle_rad, self.prompt_rad_s, stance)
    }
}

const fn by_stance([inner, outer]: [f64; 2], [inner_rate, outer_rate]: [f64; 2], stance: Leg) -> [f64; 4] {
    match stance {
        Leg::Inner => [inner, outer, inner_rate, outer_rate],
        Leg::Outer => [outer, inner, outer_rate, inner_rate],
    }
}

/// Turns snapshots to angles.
#[derive(Clone, Debug)]
pub(super) struct Sensors {
    attitude: Attitude,
    imu_sign: f64,
    imu_offset_rad: f64,
    imu_age: Span,
    hip_age: Span,
    hip: Option<HipRate>,
    gyro_rad_s: Option<f64>,
}

/// Hip angle of the last call and its rate.
#[derive(Clone, Copy, Debug)]
struct HipRate {
    stamp: Stamp,
    angle_rad: f64,
    rate_rad_s: f64,
    prompt_rad_s: f64,
}

impl Sensors {
    pub(super) fn new(robot: &Robot, attitude_time_s: f64) -> Self {
        Self {
            attitude: Attitude::new(attitude_time_s),
            imu_sign: robot.imu.sign,
            imu_offset_rad: robot.imu.offset_rad,
            imu_age: robot.limits.imu_age,
            hip_age: robot.limits.drive_age,
            hip: None,
            gyro_rad_s: None,
        }
    }

    pub(super) fn reset(&mut self) {
        self.attitude.reset();
        self.hip = None;
        self.gyro_rad_s = None;
    }

    /// Both legs at the tick's time, the attitude less `bias_rad`. `None` while a source is silent or too old.
    ///
    /// Samples are forwarded by their age at their own rate (gyro, filtered difference): some ms of latency cost .1° at
    /// the rates of a recovery.
    pub(super) fn measure(&mut self, s: &Snapshot, bias_rad: f64) -> Option<Measured> {
        if s.imu_age > self.imu_age {
            return None;
        }
        let leg_rad = self.imu_offset_rad + self.imu_sign * self.attitude.update(&s.imu)?;
        if s.hip_age > self.hip_age {
            return None;
        }
        let hip_now = self.hip_rate(s);
        let inner = leg_rad + s.leg_rate_rad_s * s.imu_age.as_s() - bias_rad;
        let hip = s.hip_angle_rad + hip_now.rate_rad_s * s.hip_age.as_s();
        let gyro = s.leg_rate_rad_s;
        let mean = 0.5 * (gyro + self.gyro_rad_s.replace(gyro).unwrap_or(gyro));
        Some(Measured {
            angle_rad: [inner, inner - hip],
            rate_rad_s: [gyro, gyro - hip_now.rate_rad_s],
            prompt_rad_s: [mean, mean - hip_now.prompt_rad_s],
        })
    }

    /// Rate of the hip angle by differences; holds between samples.
    fn hip_rate(&mut self, s: &Snapshot) -> HipRate {
        let (stamp, angle_rad) = (s.stamp - s.hip_age, s.hip_angle_rad);
        let next = match self.hip {
            Some(last) if stamp > last.stamp => {
                let dt_s = stamp.since(last.stamp).as_s();
                let prompt_rad_s = (angle_rad - last.angle_rad) / dt_s;
                let share = dt_s / (DIFFERENCE_TIME_S + dt_s);
                let rate_rad_s = last.rate_rad_s + share * (prompt_rad_s - last.rate_rad_s);
                HipRate { stamp, angle_rad, rate_rad_s, prompt_rad_s }
            }
            Some(last) => last,
            None => HipRate { stamp, angle_rad, rate_rad_s: 0.0, prompt_rad_s: 0.0 },
        };
        // A reading that is not finite must not stay in the filter: safety latches it, and the next start is clean.
        self.hip = next.rate_rad_s.is_finite().then_some(next);
        next
    }
}
