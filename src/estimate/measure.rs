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
    /// Of an IMU sample, each once.
    pub(super) sampled: Option<Sampled>,
}

/// Both legs at the time of an IMU sample, the hip's reading of the same instant: a rate that mixes two instants would see a
/// touchdown as a momentum out of nowhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sampled {
    /// Angles at the sample, rad: inner, outer.
    angle_rad: [f64; 2],
    /// Mean rates since the sample before: plain difference of the hip, mean of the gyro. Noisy, not late.
    rate_rad_s: [f64; 2],
    /// Time since the sample before.
    pub(super) dt_s: f64,
}

impl Sampled {
    /// `[θs, θw, θ̇s, θ̇w]`.
    pub(super) const fn stance_first(&self, stance: Leg) -> [f64; 4] {
        by_stance(self.angle_rad, self.rate_rad_s, stance)
    }
}

impl Measured {
    /// `[θs, θw, θ̇s, θ̇w]`, hip rate filtered.
    pub(super) const fn stance_first(&self, stance: Leg) -> [f64; 4] {
        by_stance(self.angle_rad, self.rate_rad_s, stance)
    }
}

const fn by_stance([inner, outer]: [f64; 2], [inner_rate, outer_rate]: [f64; 2], stance: Leg) -> [f64; 4] {
    match stance {
        Leg::Inner => [inner, outer, inner_rate, outer_rate],
        Leg::Outer => [outer, inner, outer_rate, inner_rate],
    }
}

/// What the IMU alone says of the inner leg.
#[derive(Clone, Copy, Debug)]
pub(super) struct Raw {
    pub(super) stamp: Stamp,
    pub(super) leg_rad: f64,
}

/// Turns snapshots to angles.
#[derive(Clone, Debug)]
pub(super) struct Sensors {
    attitude: Attitude,
    imu_sign: f64,
    imu_offset_rad: f64,
    imu_age: Span,
    imu_latency: Span,
    hip_age: Span,
    widest_gap_s: f64,
    hip: Option<HipRate>,
    hips: Past,
    sample: Option<Sample>,
    waiting: Option<Reading>,
}

/// An IMU sample that waits for the hip's reading after it: at a slow tick that is always a tick later.
#[derive(Clone, Copy, Debug)]
struct Reading {
    stamp: Stamp,
    leg_rad: f64,
    gyro_rad_s: f64,
}

/// The IMU sample before, with the hip of its time.
#[derive(Clone, Copy, Debug)]
struct Sample {
    stamp: Stamp,
    gyro_rad_s: f64,
    hip_rad: f64,
}

/// Hip angle of the last call and its rate.
#[derive(Clone, Copy, Debug)]
struct HipRate {
    stamp: Stamp,
    angle_rad: f64,
    rate_rad_s: f64,
}

/// Hip readings kept: more than an IMU sample is ever old.
const KEPT: usize = 32;

/// Hip readings farther apart than so many of their periods say nothing about the rate between them.
const WIDEST_GAP_PERIODS: f64 = 3.0;

/// The last hip readings.
#[derive(Clone, Copy, Debug)]
struct Past {
    readings: [(Stamp, f64); KEPT],
    next: usize,
}

impl Past {
    const EMPTY: Self = Self { readings: [(Stamp::NEVER, 0.0); KEPT], next: 0 };

    fn push(&mut self, stamp: Stamp, angle_rad: f64) {
        if let Some(slot) = self.readings.get_mut(self.next) {
            *slot = (stamp, angle_rad);
            self.next = (self.next + 1) % KEPT;
        }
    }

    /// The reading at `t`, between its neighbours; none beyond what is kept.
    fn at(&self, t: Stamp, widest_gap_s: f64) -> Option<f64> {
        let (mut before, mut after) = (None::<(Stamp, f64)>, None::<(Stamp, f64)>);
        for &(stamp, angle) in self.readings.iter().filter(|(stamp, _)| *stamp != Stamp::NEVER) {
            if stamp == t {
                return Some(angle);
            }
            if stamp <= t && before.is_none_or(|(b, _)| stamp > b) {
                before = Some((stamp, angle));
            } else if stamp > t && after.is_none_or(|(a, _)| stamp < a) {
                after = Some((stamp, angle));
            }
        }
        let ((from, a), (to, b)) = (before?, after?);
        let span_s = to.since(from).as_s();
        if span_s > widest_gap_s {
            return None;
        }
        Some(a + (b - a) * t.since(from).as_s() / span_s)
    }
}

impl Sensors {
    /// `period`: of the ticks.
    pub(super) fn new(robot: &Robot, attitude_time_s: f64, period: Span) -> Self {
        let [hip_drive, ..] = &robot.drives;
        Self {
            attitude: Attitude::new(attitude_time_s),
            imu_sign: robot.imu.sign,
            imu_offset_rad: robot.imu.offset_rad,
            imu_age: robot.limits.imu_age,
            imu_latency: robot.imu.latency,
            hip_age: robot.limits.drive_age,
            widest_gap_s: WIDEST_GAP_PERIODS * f64::from(hip_drive.sync_divisor) * period.as_s(),
            hip: None,
            hips: Past::EMPTY,
            sample: None,
            waiting: None,
        }
    }

    pub(super) fn reset(&mut self) {
        self.attitude.reset();
        self.hip = None;
        self.hips = Past::EMPTY;
        self.sample = None;
        self.waiting = None;
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
        let inner = leg_rad + s.leg_rate_rad_s * (s.imu_age.as_s() + self.imu_latency.as_s()) - bias_rad;
        let hip = s.hip_angle_rad + hip_now.rate_rad_s * s.hip_age.as_s();
        let gyro = s.leg_rate_rad_s;
        Some(Measured {
            angle_rad: [inner, inner - hip],
            rate_rad_s: [gyro, gyro - hip_now.rate_rad_s],
            sampled: self.sampled(s, leg_rad, bias_rad),
        })
    }

    /// The inner leg's angle by the IMU alone, with its time. `None` before the first.
    pub(super) fn raw(&self, s: &Snapshot) -> Option<Raw> {
        let leg_rad = self.imu_offset_rad + self.imu_sign * self.attitude.pitch_rad()?;
        Some(Raw { stamp: s.stamp - s.imu_age - self.imu_latency, leg_rad })
    }

    /// Both legs at the IMU's oldest sample that was not used yet and has hip readings around it.
    fn sampled(&mut self, s: &Snapshot, leg_rad: f64, bias_rad: f64) -> Option<Sampled> {
        let newest = Reading { stamp: s.stamp - s.imu_age - self.imu_latency, leg_rad, gyro_rad_s: s.leg_rate_rad_s };
        let Reading { stamp, leg_rad, gyro_rad_s } = self.waiting.filter(|w| w.stamp < newest.stamp).unwrap_or(newest);
        let last = self.sample;
        if last.is_some_and(|last| stamp <= last.stamp) {
            return None;
        }
        let hip_rad = self.hips.at(stamp, self.widest_gap_s);
        if hip_rad.is_none() && self.hip.is_some_and(|hip| stamp > hip.stamp) {
            self.waiting = Some(Reading { stamp, leg_rad, gyro_rad_s });
            return None;
        }
        self.waiting = Some(newest).filter(|w| w.stamp > stamp);
        let hip_rad = hip_rad?;
        self.sample = Some(Sample { stamp, gyro_rad_s, hip_rad });
        let last = last?;
        let dt_s = stamp.since(last.stamp).as_s();
        let (gyro, hip) = (0.5 * (gyro_rad_s + last.gyro_rad_s), (hip_rad - last.hip_rad) / dt_s);
        let inner_rad = leg_rad - bias_rad;
        Some(Sampled { angle_rad: [inner_rad, inner_rad - hip_rad], rate_rad_s: [gyro, gyro - hip], dt_s })
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
                self.hips.push(stamp, angle_rad);
                HipRate { stamp, angle_rad, rate_rad_s }
            }
            Some(last) => last,
            None => {
                self.hips.push(stamp, angle_rad);
                HipRate { stamp, angle_rad, rate_rad_s: 0.0 }
            }
        };
        // A reading that is not finite must not stay in the filter: safety latches it, and the next start is clean.
        self.hip = next.rate_rad_s.is_finite().then_some(next);
        next
    }
}
