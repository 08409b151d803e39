//! Holds the hip angle it found with a spring and a damper. RT: yes.

use super::motor_sign;
use crate::config::checked::Control;
use crate::msg::Estimate;

/// Spring, damper, and the angle to hold.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hold {
    stiffness_nm_rad: f64,
    damping_nm_s_rad: f64,
    angle_rad: Option<f64>,
}

impl Hold {
    pub(super) const fn new(control: &Control) -> Self {
        Self {
            stiffness_nm_rad: control.hold_stiffness_nm_rad,
            damping_nm_s_rad: control.hold_damping_nm_s_rad,
            angle_rad: None,
        }
    }

    /// Its spring alone: the hip's friction damps.
    ///
    /// At rest on both feet rates are differences that come 20 ms late. With them the damper drove the hip's elasticity at 10 Hz, and
    /// the feet hopped apart.
    pub(super) const fn spring(control: &Control) -> Self {
        Self { damping_nm_s_rad: 0.0, ..Self::new(control) }
    }

    /// Holds the present angle from now on.
    pub(super) const fn reset(&mut self, estimate: &Estimate) {
        self.angle_rad = Some(estimate.hip_angle_rad);
    }

    /// Torque, + on inner. Without a reset there is nothing to hold yet, and the damper acts alone.
    pub(super) fn torque_nm(&self, e: &Estimate) -> f64 {
        let rate = motor_sign(e.stance) * (e.theta_stance_rad_s - e.theta_swing_rad_s);
        let stretch = self.angle_rad.map_or(0.0, |angle| e.hip_angle_rad - angle);
        -self.stiffness_nm_rad * stretch - self.damping_nm_s_rad * rate
    }
}
