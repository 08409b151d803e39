//! LQR balance on the leg that stands, with friction compensation. Thesis 4.4; section 8 of our notes. RT: yes.
//!
//! The torque's direct effect on the stance angle is tiny and changes sign between the legs: balance acts through the
//! weight and the inertia of the swing leg. So each leg has its own gain.

use super::friction::Compensation;
use super::gains::{Gain, balance_gain};
use super::{ControllerError, motor_sign};
use crate::config::checked::Config;
use crate::msg::{Estimate, Leg};

/// Gains of both legs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Balance {
    inner: Gain,
    outer: Gain,
    friction: Compensation,
    torque_unit_nm: f64,
}

impl Balance {
    /// Gains from the model. Before arming only.
    pub(super) fn new(config: &Config) -> Result<Self, ControllerError> {
        let gain = |leg| balance_gain(config, leg).map_err(|cause| ControllerError::NoGain { leg, cause });
        Ok(Self {
            inner: gain(Leg::Inner)?,
            outer: gain(Leg::Outer)?,
            friction: Compensation::new(&config.robot.model, config.control.friction_compensation),
            torque_unit_nm: config.robot.model.params().inertia_kg_m2(),
        })
    }

    /// Torque, + on inner. `late`: the phase is not to be trusted, so friction, which depends on it, stays.
    pub(super) fn torque_nm(&self, e: &Estimate, late: bool) -> f64 {
        let gain = match e.stance {
            Leg::Inner => &self.inner,
            Leg::Outer => &self.outer,
        };
        let hip_rate = e.theta_stance_rad_s - e.theta_swing_rad_s;
        let x = [
            e.theta_stance_rad,
            e.theta_swing_rad,
            e.theta_stance_rad - e.theta_swing_rad + e.hip_twist_rad,
            e.theta_stance_rad_s,
            e.theta_swing_rad_s,
            hip_rate + e.hip_twist_rad_s,
        ];
        let friction = if late { 0.0 } else { self.friction.torque(hip_rate) };
        motor_sign(e.stance) * self.torque_unit_nm * (gain.torque(&x) + friction)
    }
}
