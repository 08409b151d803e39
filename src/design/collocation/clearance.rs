//! Height of the swing foot with its toe drawn in as fast as the toe can. RT: no.

use crate::base::scalar::Scalar;
use crate::design::problem::Clearance;

impl Clearance {
    /// Time that the whole travel takes, s.
    #[must_use]
    pub fn travel_s(&self) -> f64 {
        let ramp = self.rate_m_s / self.acceleration_m_s2;
        let longest_ramp = libm::sqrt(self.retract_m / self.acceleration_m_s2);
        if ramp >= longest_ramp { 2.0 * longest_ramp } else { ramp + self.retract_m / self.rate_m_s }
    }

    /// Travel after `t` seconds from rest to rest: speed up, cruise, slow down.
    pub(crate) fn travelled<S: Scalar>(&self, t: S) -> S {
        let (a, all) = (self.acceleration_m_s2, self.travel_s());
        let ramp = (self.rate_m_s / a).min(all / 2.0);
        let left = -t + all;
        if t.value() <= 0.0 {
            S::zero()
        } else if t.value() < ramp {
            t.square() * (0.5 * a)
        } else if left.value() <= 0.0 {
            S::constant(self.retract_m)
        } else if left.value() < ramp {
            -(left.square() * (0.5 * a)) + self.retract_m
        } else {
            (t - 0.5 * ramp) * (a * ramp)
        }
    }

    /// How long before a phase its toe has begun to go in, s.
    pub(super) const fn begun_at(&self, phase: usize) -> f64 {
        if phase == 0 { self.begun_s } else { 0.0 }
    }

    /// How far the toe is drawn in at `t` of a phase of length `duration`, m. It is out again at touchdown.
    pub fn drawn_in<S: Scalar>(&self, t: S, duration: S) -> S {
        let (up, down) = (self.travelled(t), self.travelled(duration - t));
        if up.value() < down.value() { up } else { down }
    }

    /// Height of the foot asked for, m. It rises with the square of the retraction, so that a foot which has just left
    /// the floor need not jump, and falls away steeply (0.2 m in the time allowed) once the foot may come down.
    pub fn asked<S: Scalar>(&self, t: S, duration: S) -> S {
        let share = self.travelled(t) / self.retract_m;
        let asked = share.square() * self.height_m;
        let early = -(duration - t) + self.until_s;
        if early.value() <= 0.0 { asked } else { asked - (early / self.until_s).square() * 0.2 }
    }

    /// Height above the one asked for, in leg lengths, for legs of length `l` m with toes at their nominal length.
    /// `begun_s`: the toe has begun so long before the phase.
    pub fn margin<S: Scalar>(&self, q: [S; 2], t: S, duration: S, l: f64, begun_s: f64) -> S {
        let (t, duration) = (t + begun_s, duration + begun_s);
        let drawn = self.drawn_in(t, duration);
        q[0].cos() - q[1].cos() + (drawn * q[1].cos() - self.asked(t, duration)) / l
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOE: Clearance = Clearance {
        height_m: 0.02,
        retract_m: 0.02,
        rate_m_s: 0.25,
        acceleration_m_s2: 5.0,
        until_s: 0.1,
        begun_s: 0.0,
    };

    #[test]
    fn toe_takes_its_time_and_never_exceeds_speed_or_acceleration() {
        assert!((TOE.travel_s() - 0.13).abs() < 1e-12); // 0.05 + 0.02/0.25
        let (h, mut before, mut speed_before) = (1e-4, 0.0, 0.0);
        for k in 1..2000 {
            let x = TOE.travelled(f64::from(k) * h);
            let speed = (x - before) / h;
            assert!(speed <= 0.25 + 1e-9 && (speed - speed_before).abs() <= 5.0 * h + 1e-9);
            (before, speed_before) = (x, speed);
        }
        assert!((before - 0.02).abs() < 1e-15);
    }

    #[test]
    fn toe_is_out_at_both_ends_and_in_between() {
        for (t, want) in [(0.0, 0.0), (0.3, 0.02), (0.8, 0.0)] {
            assert!((TOE.drawn_in(t, 0.8) - want).abs() < 1e-15);
        }
    }
}
