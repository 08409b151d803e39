//! A toe: lead screw with a one-sided, preloaded series spring and a potentiometer on it. Thesis 2.2.1. RT: yes.
//!
//! The screw does not back-drive, so the motor side is a position with limits of stroke and rate. The spring sits
//! between screw and toe against a hard stop: below the preload the toe is rigid, above it gives way by `(F - F0)/k`.

use crate::base::scalar::Scalar;

/// Share of the acceleration that a stop is planned with; the rest corrects.
const BRAKES: f64 = 0.8;
/// Bandwidth of a toe drive's position loop, 1/s: a position drive of this class holds 10 Hz.
const LOOP_1_S: f64 = 60.0;

/// Constants of a toe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Toe<S> {
    /// Stroke of the screw, m: 0 retracted, `stroke_m` fully out.
    pub stroke_m: S,
    /// Fastest travel, m/s.
    pub rate_limit_m_s: S,
    /// Series spring, N/m.
    pub spring_n_m: S,
    /// Preload of the spring against its stop, N.
    pub preload_n: S,
}

impl<S: Scalar> Toe<S> {
    /// Screw position after `dt_s` on the way from `position_m` to `target_m`, within rate and stroke.
    #[must_use]
    pub fn advance(&self, position_m: S, target_m: S, dt_s: f64) -> S {
        let reach = self.rate_limit_m_s.value() * dt_s;
        let travel = (target_m - position_m).clamp_to(-reach, reach);
        (position_m + travel).clamp_to(0.0, self.stroke_m.value())
    }

    /// Acceleration over the next `dt_s` of a position loop that takes the screw from `(position, rate)` to `target_m` as
    /// fast as rate, stroke and `limit_m_s2` allow, without overshoot.
    #[must_use]
    pub fn acceleration_towards(&self, (position_m, rate_m_s): (S, S), target_m: S, limit_m_s2: f64, dt_s: f64) -> S {
        if dt_s <= 0.0 {
            return S::zero();
        }
        let to_go = target_m.clamp_to(0.0, self.stroke_m.value()) - position_m;
        // v²/2a left to brake in, less what this step still travels.
        let half = 0.5 * limit_m_s2 * dt_s;
        let reach = (to_go.abs() * (2.0 * BRAKES * limit_m_s2) + half * half).sqrt() - half;
        let fastest = reach.clamp_to(0.0, self.rate_limit_m_s.value());
        let linear = to_go.abs() * LOOP_1_S.min(1.0 / dt_s);
        let wanted = if linear.value() < fastest.value() { linear } else { fastest } * to_go.sign();
        ((wanted - rate_m_s) * (4.0 * LOOP_1_S).min(1.0 / dt_s)).clamp_to(-limit_m_s2, limit_m_s2)
    }

    /// Compression of the spring (what the potentiometer reads), m, under the ground force `force_n` along the leg.
    #[must_use]
    pub fn compression_m(&self, force_n: S) -> S {
        ((force_n - self.preload_n) / self.spring_n_m).clamp_to(0.0, f64::INFINITY)
    }

    /// Force along the leg at a compression > 0, N. At the stop it may be anything from 0 to the preload.
    #[must_use]
    pub fn force_n(&self, compression_m: S) -> S {
        self.preload_n + self.spring_n_m * compression_m
    }

    /// Length of the toe beyond the retracted leg, m.
    #[must_use]
    pub fn length_m(&self, position_m: S, force_n: S) -> S {
        position_m - self.compression_m(force_n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOE: Toe<f64> = Toe { stroke_m: 0.1, rate_limit_m_s: 0.25, spring_n_m: 5000.0, preload_n: 40.0 };

    #[test]
    fn screw_is_never_faster_than_its_limit_and_stays_in_its_stroke() {
        let mut at = 0.02;
        for k in 0..2000 {
            let target = if k < 1000 { 5.0 } else { -5.0 };
            let next = TOE.advance(at, target, 1e-3);
            assert!((next - at).abs() <= 0.25e-3 + 1e-15 && (0.0..=0.1).contains(&next));
            at = next;
        }
        assert!(at.abs() < 1e-15);
    }

    #[test]
    fn toe_is_rigid_below_the_preload_and_a_spring_above() {
        assert!(TOE.compression_m(39.9) <= 0.0);
        assert!(TOE.compression_m(-10.0) <= 0.0);
        assert!((TOE.compression_m(90.0) - 0.01).abs() < 1e-15);
    }

    #[test]
    fn force_is_the_inverse_of_compression_above_the_preload() {
        for force in [41.0, 75.0, 300.0] {
            assert!((TOE.force_n(TOE.compression_m(force)) - force).abs() < 1e-12); // rounding
        }
    }

    #[test]
    fn loaded_toe_is_shorter() {
        assert!((TOE.length_m(0.05, 140.0) - 0.03).abs() < 1e-15);
    }
}
