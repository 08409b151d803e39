//! The swing leg on a path: a quintic to the next foothold, tracked by computed torque. RT: yes.

use crate::model::compass_gait::dynamics::{bias_at, friction, mass_matrix_at};
use crate::model::compass_gait::kinematics::Trig;
use crate::model::compass_gait::params::Normalised;

/// Angle, rate, acceleration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Point {
    pub(super) angle_rad: f64,
    pub(super) rate_rad_s: f64,
    pub(super) acceleration_rad_s2: f64,
}

/// Quintic from `from` (at 0) to `to` (at `duration_s`), both with zero acceleration; beyond it goes on with the last rate.
pub(super) fn quintic(from: [f64; 2], to: [f64; 2], duration_s: f64, t_s: f64) -> Point {
    let ([x0, v0], [x1, v1]) = (from, to);
    if t_s >= duration_s || duration_s <= 0.0 {
        let angle_rad = x1 + v1 * (t_s - duration_s).max(0.0);
        return Point { angle_rad, rate_rad_s: v1, acceleration_rad_s2: 0.0 };
    }
    let (s, d) = ((t_s / duration_s).max(0.0), duration_s);
    let (dx, u0, u1) = (x1 - x0, v0 * d, v1 * d);
    // Hermite basis of order 5 without accelerations at the ends.
    let c3 = 10.0 * dx - 6.0 * u0 - 4.0 * u1;
    let c4 = -15.0 * dx + 8.0 * u0 + 7.0 * u1;
    let c5 = 6.0 * dx - 3.0 * u0 - 3.0 * u1;
    let (s2, s3) = (s * s, s * s * s);
    Point {
        angle_rad: x0 + u0 * s + s3 * (c3 + s * (c4 + s * c5)),
        rate_rad_s: (u0 + s2 * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5))) / d,
        acceleration_rad_s2: s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5)) / (d * d),
    }
}

/// Normalised torque on the stance row that gives the swing leg this acceleration, friction compensated by `share`.
pub(super) fn torque(p: &Normalised<f64>, q: [f64; 2], v: [f64; 2], swing_acceleration: f64, share: f64) -> f64 {
    coupled_torque(p, q, v, [swing_acceleration, 0.0], share)
}

/// The same for the swing acceleration `a + b θ̈s`, as a path by the stance angle asks for.
///
/// The stance leg does what it does: its row is eliminated by the sum of both rows, on which no torque acts.
pub(super) fn coupled_torque(p: &Normalised<f64>, q: [f64; 2], v: [f64; 2], [a, b]: [f64; 2], share: f64) -> f64 {
    let t = Trig::new(q);
    let ([[h11, h12], [h21, h22]], [bias_s, bias_w]) = (mass_matrix_at(p, &t), bias_at(p, &t, v));
    let stance = -((h12 + h22) * a + bias_s + bias_w) / (h11 + h21 + (h12 + h22) * b);
    let [rate_s, rate_w] = v;
    -(h21 * stance + h22 * (a + b * stance) + bias_w) - share * friction(p, rate_s - rate_w)
}

/// Bézier curve of order 5 at `s`: value, first and second derivative; straight on beyond its ends.
pub(super) fn bezier([c0, c1, c2, c3, c4, c5]: [f64; 6], s: f64) -> [f64; 3] {
    let inside = s.clamp(0.0, 1.0);
    let mix = |a: f64, b: f64| a + inside * (b - a);
    // De Casteljau; the last three and two points give the derivatives.
    let fourth = [mix(c0, c1), mix(c1, c2), mix(c2, c3), mix(c3, c4), mix(c4, c5)];
    let [d0, d1, d2, d3, d4] = fourth;
    let [e0, e1, e2, e3] = [mix(d0, d1), mix(d1, d2), mix(d2, d3), mix(d3, d4)];
    let [f0, f1, f2] = [mix(e0, e1), mix(e1, e2), mix(e2, e3)];
    let [g0, g1] = [mix(f0, f1), mix(f1, f2)];
    let slope = 5.0 * (g1 - g0);
    let curvature = if (0.0..=1.0).contains(&s) { 20.0 * (f2 - 2.0 * f1 + f0) } else { 0.0 };
    [mix(g0, g1) + slope * (s - inside), slope, curvature]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;
    use crate::model::compass_gait::dynamics::acceleration_without_friction;

    #[test]
    fn quintic_meets_its_ends_and_its_rates_are_its_derivatives() {
        let at = |t: f64| quintic([0.2, -0.5], [-0.1, 0.3], 0.6, t);
        assert!((at(0.0).angle_rad - 0.2).abs() < 1e-15 && (at(0.0).rate_rad_s + 0.5).abs() < 1e-15);
        assert!((at(0.6).angle_rad + 0.1).abs() < 1e-12 && (at(0.7).angle_rad + 0.07).abs() < 1e-12);
        for t in [0.05, 0.3, 0.55] {
            let rate = (at(t + 1e-6).angle_rad - at(t - 1e-6).angle_rad) / 2e-6;
            let acceleration = (at(t + 1e-6).rate_rad_s - at(t - 1e-6).rate_rad_s) / 2e-6;
            assert!((rate - at(t).rate_rad_s).abs() < 1e-8 && (acceleration - at(t).acceleration_rad_s2).abs() < 1e-7);
        }
    }

    #[test]
    fn computed_torque_gives_the_acceleration_that_was_asked_for() {
        let p = config::load(None, &[]).unwrap().config.robot.model.params().normalised().frictionless();
        for (q, v, wanted) in [([0.1, -0.2], [0.5, -1.0], 3.0), ([-0.2, 0.2], [-0.7, 0.4], -8.0)] {
            let tau = torque(&p, q, v, wanted, 1.0);
            assert!((acceleration_without_friction(&p, q, v, tau)[1] - wanted).abs() < 1e-10);
        }
    }

    #[test]
    fn bezier_meets_its_ends_and_its_derivatives_are_its_derivatives() {
        let c = [-0.2, -0.25, 0.0, 0.1, 0.22, 0.2];
        assert!((bezier(c, 0.0)[0] + 0.2).abs() < 1e-15 && (bezier(c, 1.0)[0] - 0.2).abs() < 1e-15);
        assert!((bezier(c, 1.2)[0] - 0.2 - 0.2 * 5.0 * (0.2 - 0.22)).abs() < 1e-12);
        for s in [0.1, 0.5, 0.8] {
            let slope = (bezier(c, s + 1e-6)[0] - bezier(c, s - 1e-6)[0]) / 2e-6;
            let curvature = (bezier(c, s + 1e-6)[1] - bezier(c, s - 1e-6)[1]) / 2e-6;
            assert!((slope - bezier(c, s)[1]).abs() < 1e-8 && (curvature - bezier(c, s)[2]).abs() < 1e-6);
        }
    }

    #[test]
    fn coupled_torque_keeps_the_accelerations_on_their_line() {
        let p = config::load(None, &[]).unwrap().config.robot.model.params().normalised().frictionless();
        let (q, v) = ([0.1, -0.2], [0.5, -1.0]);
        let tau = coupled_torque(&p, q, v, [3.0, -1.5], 1.0);
        let [stance, swing] = acceleration_without_friction(&p, q, v, tau);
        assert!((swing - 3.0 + 1.5 * stance).abs() < 1e-10);
    }
}
