//! Does the velocity that an MIT motor tells fit the way that it goes? RT: yes.
//!
//! Of a motor in torque mode: one that is led to a place goes there in steps, faster than it answers (seen: toes at 4 ms).
//! Both are coded by ranges that are nowhere on the wire. Those of another motor scale them by unequal factors, unless they
//! differ in torque alone; that shows as soon as it moves, by a hand too, so it can be told before any torque. A motor that was
//! found wrong stays so until it has gone as far again and fits.

use crate::base::time::{Span, Stamp};
use crate::config::checked::Mit;

/// The way is looked at in stretches in one direction, rad at the output: 260 steps of its code at 12.5 rad.
const STRETCH_RAD: f64 = 0.1;
/// At a mean of so many steps of the velocity's code at least: half a step, by which a code is too low, is a sixteenth.
const LEAST_STEPS: f64 = 8.0;
/// Steps of the velocity's code.
const STEPS: f64 = 4095.0;
/// Judged after so many rad and so long a time in all. What the motor's filter is late by cancels over a swing but for where it
/// began and ended: with 5 ms and swings of .2 s that is a twenty-fifth.
const ENOUGH_RAD: f64 = 1.0;
const ENOUGH_S: f64 = 0.25;
/// What is told may be so many times what is gone, or a part of it: the two errors above, twice. AK motors of 8, 50 and 76 rad/s
/// are told apart.
const TOLERANCE: f64 = 1.25;
/// No motor goes so many times as fast as its code can tell, but for some steps of the position's.
const FASTEST: f64 = 2.0;
const ROUNDING_RAD: f64 = 0.02;
/// Answers farther apart tell nothing of the velocity between them.
const WIDEST_GAP: Span = Span::from_ms(20);

#[derive(Clone, Copy, Debug)]
struct Point {
    stamp: Stamp,
    position_rad: f64,
    velocity_rad_s: f64,
}

/// The way of one motor.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pace {
    range_rad_s: f64,
    /// Where the stretch begins, the newest point of it, and the way between them by the velocity.
    begin: Option<Point>,
    newest: Option<Point>,
    told_rad: f64,
    /// Of all stretches since the last verdict, along their directions.
    gone_sum_rad: f64,
    told_sum_rad: f64,
    lasted_s: f64,
    is_wrong: bool,
}

impl Pace {
    /// `None` for a motor in position mode.
    pub(super) fn of(mit: &Mit) -> Option<Self> {
        let [stiffness_nm_rad, _] = mit.gains;
        (stiffness_nm_rad <= 0.0).then_some(Self {
            range_rad_s: mit.velocity_range_rad_s,
            begin: None,
            newest: None,
            told_rad: 0.0,
            gone_sum_rad: 0.0,
            told_sum_rad: 0.0,
            lasted_s: 0.0,
            is_wrong: false,
        })
    }

    /// An answer. True if the two do not fit.
    pub(super) fn is_broken_by(&mut self, stamp: Stamp, position_rad: f64, velocity_rad_s: f64) -> bool {
        let point = Point { stamp, position_rad, velocity_rad_s };
        match (self.begin, self.newest) {
            (Some(begin), Some(newest)) if self.continues(&newest, &point) => self.go_on(&begin, &newest, point),
            _ => self.start(point),
        }
        self.is_wrong
    }

    fn start(&mut self, point: Point) {
        (self.begin, self.newest, self.told_rad) = (Some(point), Some(point), 0.0);
    }

    /// A velocity at the end of its code may be any that is larger; a motor that restarted, or whose turns are counted anew, jumps.
    fn continues(&self, newest: &Point, point: &Point) -> bool {
        let gap = point.stamp.since(newest.stamp);
        let step_rad = (point.position_rad - newest.position_rad).abs();
        let jumps = step_rad > FASTEST * self.range_rad_s * gap.as_s() + ROUNDING_RAD;
        let ends = point.velocity_rad_s.abs() >= self.range_rad_s * (1.0 - 1.0 / STEPS);
        (Span::ZERO..=WIDEST_GAP).contains(&gap) && !jumps && !ends
    }

    fn go_on(&mut self, begin: &Point, newest: &Point, point: Point) {
        self.newest = Some(point);
        let dt_s = point.stamp.since(newest.stamp).as_s();
        self.told_rad += 0.5 * (newest.velocity_rad_s + point.velocity_rad_s) * dt_s;
        let gone_rad = point.position_rad - begin.position_rad;
        let stretch_s = point.stamp.since(begin.stamp).as_s();
        if gone_rad.abs() >= STRETCH_RAD {
            self.gone_sum_rad += gone_rad.abs();
            self.told_sum_rad += self.told_rad * gone_rad.signum();
            self.lasted_s += stretch_s;
            self.start(point);
            self.judge();
        } else if stretch_s * LEAST_STEPS * 2.0 * self.range_rad_s / STEPS > STRETCH_RAD {
            self.start(point);
        }
    }

    fn judge(&mut self) {
        if self.gone_sum_rad >= ENOUGH_RAD && self.lasted_s >= ENOUGH_S {
            let (gone, told) = (self.gone_sum_rad, self.told_sum_rad);
            self.is_wrong = told > TOLERANCE * gone || told * TOLERANCE < gone;
            (self.gone_sum_rad, self.told_sum_rad, self.lasted_s) = (0.0, 0.0, 0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::mit::Reply;
    use crate::config::{self, checked::DriveProtocol};

    fn cubemars() -> Mit {
        let text = include_str!("../../../config/examples/mit.toml");
        let config = config::load_text("mit.toml", text, &[]).unwrap().config;
        let DriveProtocol::Mit(mit) = config.robot.drives[0].protocol else { panic!("an MIT hip") };
        mit
    }

    /// A motor of these ranges that swings so wide, so often; its velocity comes late. Verdicts of 20 s at 1 kHz.
    fn verdicts(of: &Mit, swing_rad: f64, hz: f64, late_s: f64) -> Vec<bool> {
        let as_configured = cubemars();
        let mut pace = Pace::of(&as_configured).unwrap();
        let at = |t: f64| libm::sincos(std::f64::consts::TAU * hz * t);
        let answer = |k: i32| {
            let t = 1e-3 * f64::from(k);
            let velocity_rad_s = swing_rad * std::f64::consts::TAU * hz * at(t - late_s).1;
            let told = Reply { position_rad: swing_rad * at(t).0, velocity_rad_s, ..Reply::default() };
            let (bytes, len) = told.emit(of);
            let heard = Reply::parse(&bytes[..len], &as_configured).unwrap();
            pace.is_broken_by(Stamp(i64::from(k) * 1_000_000), heard.position_rad, heard.velocity_rad_s)
        };
        (0..20_000).map(answer).collect()
    }

    #[test]
    fn the_motor_of_the_configuration_fits_however_it_moves() {
        for (swing_rad, hz) in [(0.06, 4.0), (0.2, 0.5), (0.3, 2.5), (1.0, 0.2), (1.0, 1.0), (0.02, 20.0)] {
            for late_s in [0.0, 0.005] {
                assert!(!verdicts(&cubemars(), swing_rad, hz, late_s).contains(&true), "{swing_rad} rad, {hz} Hz");
            }
        }
    }

    #[test]
    fn a_motor_of_another_velocity_or_position_range_is_found() {
        let mit = cubemars();
        for (other, swing_rad) in [
            (Mit { velocity_range_rad_s: 8.0, torque_range_nm: 144.0, ..mit }, 0.3),
            (Mit { velocity_range_rad_s: 76.0, ..mit }, 0.3),
            (Mit { velocity_range_rad_s: 30.0, ..mit }, 0.3),
            // By our code it swings an eighth as wide.
            (Mit { position_range_rad: 95.5, ..mit }, 1.0),
        ] {
            let found = verdicts(&other, swing_rad, 1.0, 0.002);
            assert!(found.iter().filter(|wrong| **wrong).count() > 16_000, "{other:?}");
        }
        // One that is led to a place is not looked at.
        assert!(Pace::of(&Mit { gains: [0.2, 0.0], ..mit }).is_none());
        // What differs in torque alone moves as it should.
        assert!(!verdicts(&Mit { torque_range_nm: 18.0, ..mit }, 0.3, 1.0, 0.002).contains(&true));
    }

    /// As a spindle that turns 25 times a second: a stretch is shorter than the time between two answers.
    #[test]
    fn a_fast_motor_fits_from_its_start_on() {
        let fast = Mit { velocity_range_rad_s: 200.0, position_range_rad: 95.5, ..cubemars() };
        let mut pace = Pace::of(&fast).unwrap();
        let mut position_rad = 0.0;
        for k in 0..5000 {
            // Off and to and fro; the velocity is the mean of the 4 ms before.
            let velocity_rad_s = [0.0, 150.0, 0.0, -150.0][k as usize / 20 % 4];
            position_rad += 4e-3 * velocity_rad_s;
            assert!(!pace.is_broken_by(Stamp(k * 4_000_000), position_rad, velocity_rad_s), "{k}");
        }
    }

    #[test]
    fn gaps_and_a_motor_at_rest_say_nothing() {
        let mut pace = Pace::of(&cubemars()).unwrap();
        for k in 0..1000 {
            let stamp = Stamp(k * 30_000_000);
            assert!(!pace.is_broken_by(stamp, 0.2 * k as f64, 0.0), "answers 30 ms apart");
        }
        for k in 0..10_000 {
            let stamp = Stamp(40_000_000_000 + k * 1_000_000);
            // It creeps by .1 rad/s and its code has no zero.
            assert!(!pace.is_broken_by(stamp, 1e-4 * k as f64, -0.0122), "too slow for its code");
        }
    }
}
