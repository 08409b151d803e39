//! LQR balance on the leg that stands, with friction compensation. Thesis 4.4; section 8 of our notes. RT: yes.
//!
//! The torque's direct effect on the stance angle is tiny and changes sign between the legs: balance acts through the
//! weight and the inertia of the swing leg. So each leg has its own gain.

use super::friction::Compensation;
use super::gains::{Gain, balance_gain};
use super::{ControllerError, motor_sign};
use crate::config::checked::Config;
use crate::model::compass_gait::dynamics::gravity;
use crate::model::compass_gait::params::Normalised;
use crate::msg::{Estimate, Leg};

/// Gains of both legs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Balance {
    inner: Gain,
    outer: Gain,
    models: [Normalised<f64>; 2],
    friction: Compensation,
    torque_unit_nm: f64,
}

impl Balance {
    /// Gains from the model. Before arming only.
    pub(super) fn new(config: &Config) -> Result<Self, ControllerError> {
        let gain = |leg| balance_gain(config, leg).map_err(|cause| ControllerError::NoGain { leg, cause });
        let params = config.robot.model.params();
        Ok(Self {
            models: [params.normalised(), params.swapped().normalised()],
            inner: gain(Leg::Inner)?,
            outer: gain(Leg::Outer)?,
            friction: Compensation::new(&config.robot.model, config.control.friction_compensation),
            torque_unit_nm: params.inertia_kg_m2(),
        })
    }

    /// The pose with this leg standing and the other at `swing_rad`.
    pub(super) fn pose(&self, stance: Leg, swing_rad: f64) -> Pose {
        let [inner, outer] = &self.models;
        Pose::new(if stance == Leg::Inner { inner } else { outer }, swing_rad)
    }

    /// Torque, + on inner, about the pose with the swing leg at `swing_rad`: 0 is upright.
    /// `late`: the phase is not to be trusted, so friction, which depends on it, stays.
    pub(super) fn torque_nm(&self, e: &Estimate, late: bool, swing_rad: f64) -> f64 {
        let gain = match e.stance {
            Leg::Inner => &self.inner,
            Leg::Outer => &self.outer,
        };
        let pose = self.pose(e.stance, swing_rad);
        let (stance_rad, swing_rad) = (e.theta_stance_rad - pose.stance_rad, e.theta_swing_rad - swing_rad);
        let hip_rate = e.theta_stance_rad_s - e.theta_swing_rad_s;
        let x = [
            stance_rad,
            swing_rad,
            stance_rad - swing_rad + e.hip_twist_rad,
            e.theta_stance_rad_s,
            e.theta_swing_rad_s,
            hip_rate + e.hip_twist_rad_s,
        ];
        let friction = if late { 0.0 } else { self.friction.torque(hip_rate) };
        motor_sign(e.stance) * self.torque_unit_nm * (pose.torque + gain.torque(&x) + friction)
    }
}

/// A pose at rest, the centre of mass over the foot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pose {
    /// The stance leg leans away from the swing leg, rad.
    pub(super) stance_rad: f64,
    /// Torque that holds the swing leg, + on the stance row, normalised.
    torque: f64,
}

impl Pose {
    /// With the swing leg at `swing_rad`: G₁ + G₂ = 0 for the stance angle, by Newton's method.
    pub(super) fn new(model: &Normalised<f64>, swing_rad: f64) -> Self {
        let moment = |stance_rad: f64| {
            let [stance, swing] = gravity(model, [stance_rad, swing_rad]);
            stance + swing
        };
        let mut stance_rad = 0.0;
        for _ in 0..NEWTON_STEPS {
            let slope =
                (moment(stance_rad + DIFFERENCE_RAD) - moment(stance_rad - DIFFERENCE_RAD)) / (2.0 * DIFFERENCE_RAD);
            stance_rad -= moment(stance_rad) / slope;
        }
        let [torque, _] = gravity(model, [stance_rad, swing_rad]);
        Self { stance_rad, torque }
    }
}

/// From upright to .1 nrad for a swing leg at half a radian.
const NEWTON_STEPS: usize = 3;
const DIFFERENCE_RAD: f64 = 1e-4;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;
    use crate::model::compass_gait::dynamics::acceleration_without_friction;

    #[test]
    fn a_pose_is_at_rest() {
        let params = config::load(None, &[]).unwrap().config.robot.model.params();
        for model in [params.normalised().frictionless(), params.swapped().normalised().frictionless()] {
            for swing_rad in [-0.5, -0.2, 0.0, 0.4] {
                let pose = Pose::new(&model, swing_rad);
                let rest = acceleration_without_friction(&model, [pose.stance_rad, swing_rad], [0.0; 2], pose.torque);
                assert!(rest[0].abs() < 1e-7 && rest[1].abs() < 1e-7, "{swing_rad}: {pose:?} {rest:?}");
                assert!(pose.stance_rad * swing_rad >= 0.0, "one leans forward, the other is behind: {pose:?}");
            }
        }
    }
}
