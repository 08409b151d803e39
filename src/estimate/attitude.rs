//! Leg angle: gyro for fast motion, a slow reference for the rest. A complementary filter. RT: yes.
//!
//! The reference is the device's own attitude, or the direction of the specific force for an IMU that streams none. Both
//! lie in motion: the 3DM-GX3's filter lags and errs by up to 2° (Thesis 2.1.2), and while the robot falls freely about
//! its toe an accelerometer near the hip sees hardly any tilt. The gyro does neither, so the reference's share is slow.
//! It matters most on the outer leg, when the IMU rides on the swinging one: with the device's attitude taken as it is
//! the simulated robot fell there from 2° of tilt. What is left at low frequency is learnt by [`super::bias`].

use crate::base::time::Stamp;
use crate::msg::ImuSample;

/// Specific force below this (in g) says nothing about down.
const LEAST_FORCE_G: f64 = 0.5;
/// Longest gap between samples that the gyro bridges, s.
const LONGEST_GAP_S: f64 = 0.05;

/// Pitch by complementary filter, in the IMU's own sense.
#[derive(Clone, Copy, Debug)]
pub(super) struct Attitude {
    time_s: f64,
    pitch_rad: Option<f64>,
    rate_rad_s: f64,
    last: Stamp,
}

impl Attitude {
    /// Gyro above `1/time_s`, reference below.
    pub(super) const fn new(time_s: f64) -> Self {
        Self { time_s, pitch_rad: None, rate_rad_s: 0.0, last: Stamp::NEVER }
    }

    /// Forgets everything.
    pub(super) const fn reset(&mut self) {
        self.pitch_rad = None;
        self.last = Stamp::NEVER;
    }

    /// The pitch of the newest sample.
    pub(super) const fn pitch_rad(&self) -> Option<f64> {
        self.pitch_rad
    }

    /// Takes a sample (again, if it is the same) and says the pitch at its time. `None` until one told where down is.
    pub(super) fn update(&mut self, sample: &ImuSample) -> Option<f64> {
        let dt_s = sample.stamp.since(self.last).as_s();
        if dt_s <= 0.0 && self.pitch_rad.is_some() {
            return self.pitch_rad;
        }
        let reference = reference(sample);
        let [_, rate, _] = sample.rate_rad_s;
        self.pitch_rad = match self.pitch_rad {
            Some(pitch) if dt_s <= LONGEST_GAP_S => {
                let turned = pitch + 0.5 * (rate + self.rate_rad_s) * dt_s;
                let share = dt_s / (self.time_s + dt_s);
                Some(reference.map_or(turned, |r| turned + share * (r - turned)))
            }
            _ => reference,
        };
        self.rate_rad_s = rate;
        self.last = sample.stamp;
        self.pitch_rad
    }
}

/// Pitch without the gyro: the device's own, or where the specific force says down is.
fn reference(sample: &ImuSample) -> Option<f64> {
    let [_, pitch, _] = sample.euler_rad;
    if sample.has_attitude { Some(pitch) } else { pitch_by_force(sample.accel_g) }
}

/// Pitch from the specific force, axes forward, right, down: at rest and level it is (0, 0, -1) g.
fn pitch_by_force([x, y, z]: [f64; 3]) -> Option<f64> {
    let size = libm::sqrt(x * x + y * y + z * z);
    (size > LEAST_FORCE_G && size.is_finite()).then(|| libm::atan2(x, -z))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::time::Span;

    fn sample(k: i64, pitch: f64, rate: f64) -> ImuSample {
        let (s, c) = libm::sincos(pitch);
        ImuSample {
            stamp: Stamp(0) + Span::from_ms(k),
            rate_rad_s: [0.0, rate, 0.0],
            accel_g: [s, 0.0, -c],
            ..ImuSample::default()
        }
    }

    #[test]
    fn at_rest_it_is_the_direction_of_gravity() {
        let mut filter = Attitude::new(2.0);
        for k in 0..100 {
            assert!((filter.update(&sample(k, 0.3, 0.0)).unwrap() - 0.3).abs() < 1e-12);
        }
    }

    #[test]
    fn attitude_of_the_device_that_lags_is_overruled_by_the_gyro() {
        let mut filter = Attitude::new(4.0);
        let mut last = 0.0;
        for k in 0..=200 {
            let (truth, rate) = (0.5 * k as f64 * 1e-3, 0.5);
            let lagging =
                ImuSample { has_attitude: true, euler_rad: [0.0, truth - 0.035, 0.0], ..sample(k, 0.0, rate) };
            let still = ImuSample { euler_rad: [0.0; 3], rate_rad_s: [0.0, rate, 0.0], ..lagging };
            last = filter.update(if k == 0 { &still } else { &lagging }).unwrap();
        }
        assert!((last - 0.1).abs() < 0.002, "{last}"); // .2 s of 4 s of .035 rad
    }

    #[test]
    fn fast_motion_comes_from_the_gyro_even_if_the_force_lies() {
        let mut filter = Attitude::new(5.0);
        filter.update(&sample(0, 0.0, 0.0));
        let mut last = 0.0;
        for k in 1..=100 {
            // The accelerometer says upright throughout; the gyro 1 rad/s for .1 s.
            last = filter.update(&sample(k, 0.0, 1.0)).unwrap();
        }
        assert!((last - 0.1).abs() < 2e-3);
    }

    #[test]
    fn gyro_bias_costs_bias_times_time_constant_and_no_more() {
        let mut filter = Attitude::new(2.0);
        let mut last = 0.0;
        for k in 0..20_000 {
            last = filter.update(&sample(k, 0.1, 0.01)).unwrap();
        }
        assert!((last - 0.1 - 0.02).abs() < 1e-4);
    }

    #[test]
    fn same_sample_twice_changes_nothing() {
        let mut filter = Attitude::new(2.0);
        filter.update(&sample(0, 0.1, 0.0));
        let once = filter.update(&sample(1, 0.1, 3.0));
        assert_eq!(filter.update(&sample(1, 0.1, 3.0)), once);
    }
}
