//! A step that catches: in the direction in which the robot falls, to where it comes to rest over its new foot. RT: yes.
//!
//! Foot placement to a speed of zero (capture point: Pratt 2006). The robot is symmetric in front and back: one that falls
//! backward is seen, and moved, mirrored.

use super::foot_placement::{FootPlacement, Wish};
use super::pendulum::KAPPA2;
use crate::base::time::Stamp;
use crate::config::checked::Config;
use crate::msg::{Estimate, Snapshot};

/// Foot placement, and the direction of the present catch.
#[derive(Clone, Debug)]
pub(super) struct Catch {
    placement: FootPlacement,
    /// +1 forward, -1 backward; `None`: it does not catch.
    forward: Option<f64>,
}

impl Catch {
    /// Before arming only.
    pub(super) fn new(config: &Config) -> Self {
        Self { placement: FootPlacement::new(config), forward: None }
    }

    /// Another law has taken over.
    pub(super) const fn reset(&mut self) {
        self.forward = None;
    }

    /// Torque and toes. Once begun it keeps its direction: foot placement itself catches one that then falls back.
    pub(super) fn step(&mut self, now: Stamp, e: &Estimate, seen: &Snapshot) -> Wish {
        let begins = self.forward.is_none();
        let sign = *self.forward.get_or_insert_with(|| forward(e));
        let as_forward = Estimate {
            theta_stance_rad: sign * e.theta_stance_rad,
            theta_swing_rad: sign * e.theta_swing_rad,
            theta_stance_rad_s: sign * e.theta_stance_rad_s,
            theta_swing_rad_s: sign * e.theta_swing_rad_s,
            ..*e
        };
        if begins {
            self.placement.catch(now, &as_forward, seen);
        }
        let wish = self.placement.step(now, &as_forward, seen, 0.0);
        Wish { hip_torque_nm: sign * wish.hip_torque_nm, swing_goal_rad: sign * wish.swing_goal_rad, ..wish }
    }
}

/// +1 if the robot falls forward as an inverted pendulum about its foot, to negative angles; else -1.
fn forward(e: &Estimate) -> f64 {
    let capture_rad = e.theta_stance_rad + e.theta_stance_rad_s / libm::sqrt(KAPPA2);
    if capture_rad > 0.0 { -1.0 } else { 1.0 }
}
