//! The robot between two steps as an inverted pendulum about its foot. RT: yes.
//!
//! `ξ² = θ̇s² - κ² θs²` is kept: ξ is the rate at which the leg passes the vertical (orbital energy: Kajita 1991; capture
//! point: Pratt 2006).

use crate::msg::Estimate;

/// ξ²: above zero the stance leg passes (or has passed) the vertical, rad²/s².
pub(super) fn energy(e: &Estimate) -> f64 {
    e.theta_stance_rad_s * e.theta_stance_rad_s - KAPPA2 * e.theta_stance_rad * e.theta_stance_rad
}

/// Time until the stance leg comes to `angle_rad` (below zero) as an inverted pendulum, s.
pub(super) fn time_to(e: &Estimate, angle_rad: f64) -> f64 {
    let kappa = libm::sqrt(KAPPA2);
    let (grows, decays) = (
        0.5 * (e.theta_stance_rad + e.theta_stance_rad_s / kappa),
        0.5 * (e.theta_stance_rad - e.theta_stance_rad_s / kappa),
    );
    // grows u + decays / u = angle, u = exp(κ t) >= 1.
    let root = angle_rad * angle_rad - 4.0 * grows * decays;
    if grows >= -LEAST_GROWTH || root < 0.0 {
        return LONGEST_S;
    }
    let u = (angle_rad - libm::sqrt(root)) / (2.0 * grows);
    (libm::log(u.max(1.0)) / kappa).min(LONGEST_S)
}

/// Passing rate ξ of steady walking with steps of swing angle `angle_rad` at `speed_1_s` leg lengths a second.
pub(super) fn passing_rad_s(angle_rad: f64, speed_1_s: f64) -> f64 {
    let kappa = libm::sqrt(KAPPA2);
    let half_s = libm::sin(angle_rad) / speed_1_s.max(SLOWEST_1_S);
    kappa * angle_rad / libm::sinh((kappa * half_s).min(LONGEST_HALF))
}

/// Square of the rate with which the robot falls about a foot, 1/s² (section 8 of our notes: 3.18² and 3.13²).
pub(super) const KAPPA2: f64 = 10.0;
/// Longest time that is told, s.
pub(super) const LONGEST_S: f64 = 1.5;
/// Slowest growth of a fall, rad; slowest walk, 1/s; κ times the longest half step.
const LEAST_GROWTH: f64 = 1e-4;
const SLOWEST_1_S: f64 = 0.05;
const LONGEST_HALF: f64 = 4.0;

#[cfg(test)]
mod tests {
    use super::*;

    fn state(angle: f64, rate: f64) -> Estimate {
        Estimate { theta_stance_rad: angle, theta_stance_rad_s: rate, ..Estimate::default() }
    }

    #[test]
    fn time_to_an_angle_is_that_of_the_inverted_pendulum() {
        let (kappa, e) = (KAPPA2.sqrt(), state(0.16, -0.65));
        let t = time_to(&e, -0.16);
        let angle = 0.16 * (kappa * t).cosh() - 0.65 / kappa * (kappa * t).sinh();
        assert!((angle + 0.16).abs() < 1e-12 && t > 0.3, "{t} {angle}");
        assert!((time_to(&state(0.16, -0.2), -0.16) - LONGEST_S).abs() < 1e-12, "falls back");
    }

    #[test]
    fn a_steady_walk_has_the_speed_that_its_passing_rate_was_chosen_for() {
        for (angle, speed) in [(0.16, 0.5), (0.1, 0.3)] {
            let passing = passing_rad_s(angle, speed);
            let rate = -(passing * passing + KAPPA2 * angle * angle).sqrt();
            let t = time_to(&state(angle, rate), -angle);
            assert!((2.0 * angle.sin() / t - speed).abs() < 1e-9);
        }
    }
}
