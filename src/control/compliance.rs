//! What a walking law makes of a compliant hip drive: it steers the legs as a rigid drive would carry them, and damps the
//! twist by itself. RT: yes.
//!
//! Two time scales (Spong, *Modeling and control of elastic joint robots*, 1987): with the twist δ = φ - σ the legs ring by
//! `-H̃⁻¹ [1,-1]ᵀ μ δ`, μ = 1 / (1/Jr + [1,-1] H̃⁻¹ [1,-1]ᵀ), and the rotor against them. Feedback of the legs alone would
//! feed that ringing: motor and legs move in opposite directions in it. Taken out, the legs accelerate as the rigid robot
//! of the same rotor does, whatever the twist (test); the ringing is damped where the motor acts.

use super::motor_sign;
use crate::base::linalg::solve2;
use crate::config::checked::Config;
use crate::model::compass_gait::dynamics::mass_matrix;
use crate::model::compass_gait::elastic::without_rotor;
use crate::model::compass_gait::params::{Elasticity, Normalised};
use crate::msg::{Estimate, Leg};

/// Damping ratio that the ringing gets from the motor: it is gone within two periods, and a motor that comes a quarter of a
/// period late still damps.
const RATIO: f64 = 0.2;

/// The hip drive's compliance as the controller knows it; none: a rigid hip.
#[derive(Clone, Copy, Debug)]
pub(super) struct Compliance {
    known: Option<Known>,
}

#[derive(Clone, Copy, Debug)]
struct Known {
    /// Legs without the rotor, by stance leg.
    legs: [Normalised<f64>; 2],
    drive: Elasticity<f64>,
    torque_unit_nm: f64,
}

impl Compliance {
    pub(super) fn new(config: &Config) -> Self {
        let params = config.robot.model.params();
        let known = config.robot.model.hip_elasticity.map(|e| {
            let drive = e.elasticity().normalised(params.inertia_kg_m2());
            let legs = [params, params.swapped()];
            Known {
                legs: legs.map(|p| without_rotor(&p.normalised(), drive.rotor_inertia_kg_m2)),
                drive,
                torque_unit_nm: params.inertia_kg_m2(),
            }
        });
        Self { known }
    }

    /// The legs without the ringing.
    pub(super) fn slow(&self, e: &Estimate) -> Estimate {
        let Some(known) = &self.known else { return *e };
        let (reply, reduced) = known.mode(e);
        let [stance, swing] = reply.map(|r| r * reduced);
        Estimate {
            theta_stance_rad: e.theta_stance_rad + stance * e.hip_twist_rad,
            theta_swing_rad: e.theta_swing_rad + swing * e.hip_twist_rad,
            theta_stance_rad_s: e.theta_stance_rad_s + stance * e.hip_twist_rad_s,
            theta_swing_rad_s: e.theta_swing_rad_s + swing * e.hip_twist_rad_s,
            ..*e
        }
    }

    /// Torque that damps the ringing, + on inner, Nm.
    pub(super) fn damping_nm(&self, e: &Estimate) -> f64 {
        let Some(known) = &self.known else { return 0.0 };
        let (_, reduced) = known.mode(e);
        // 2 ζ ω μ with ω² = k / μ.
        let damping = 2.0 * RATIO * libm::sqrt(known.drive.stiffness_nm_rad * reduced);
        -motor_sign(e.stance) * damping * e.hip_twist_rad_s * known.torque_unit_nm
    }
}

impl Known {
    /// How the legs answer a torque of the hip, `H̃⁻¹ [1,-1]ᵀ`, and the inertia μ that rings on the spring.
    fn mode(&self, e: &Estimate) -> ([f64; 2], f64) {
        let [inner, outer] = &self.legs;
        let legs = if e.stance == Leg::Inner { inner } else { outer };
        let reply = solve2(&mass_matrix(legs, [e.theta_stance_rad, e.theta_swing_rad]), [1.0, -1.0]);
        let [stance, swing] = reply;
        (reply, 1.0 / (1.0 / self.drive.rotor_inertia_kg_m2 + stance - swing))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;
    use crate::model::compass_gait::{dynamics, elastic};

    const SPRING: &str =
        "robot.model.hip_elasticity={ stiffness_nm_rad = 377.0, damping_nm_s_rad = 0.2, rotor_inertia_kg_m2 = 0.09 }";

    fn known(keys: &[&str]) -> (Compliance, Normalised<f64>) {
        let config = config::load(None, &keys.iter().map(|k| (*k).to_owned()).collect::<Vec<_>>()).unwrap().config;
        (Compliance::new(&config), config.robot.model.params().normalised())
    }

    fn twisted(twist_rad: f64) -> Estimate {
        Estimate {
            stance: Leg::Inner,
            theta_stance_rad: 0.1,
            theta_swing_rad: -0.2,
            hip_twist_rad: twist_rad,
            hip_twist_rad_s: 1.0,
            ..Estimate::default()
        }
    }

    /// From rest: the spring's torque moves the legs and the rotor, and not what the laws see.
    #[test]
    fn without_the_ringing_the_legs_accelerate_as_with_a_rigid_drive() {
        let (compliance, whole) = known(&[SPRING]);
        let Known { legs: [legs, _], drive, .. } = compliance.known.unwrap();
        let (q, tau) = ([0.1, -0.2], 0.7);
        let rigid = dynamics::acceleration_without_friction(&whole, q, [0.0; 2], tau);
        for twist in [-0.1, 0.0, 0.05] {
            let x = [q[0], q[1], q[0] - q[1] + twist, 0.0, 0.0, 0.0];
            let [stance, swing, rotor] = elastic::acceleration_with(&legs, &drive, &x, tau, 0.0);
            let twisting = Estimate { hip_twist_rad_s: rotor - (stance - swing), ..twisted(twist) };
            let slow = compliance.slow(&Estimate { theta_stance_rad_s: stance, theta_swing_rad_s: swing, ..twisting });
            assert!((slow.theta_stance_rad_s - rigid[0]).abs() < 1e-9, "{twist}: {slow:?} {rigid:?}");
            assert!((slow.theta_swing_rad_s - rigid[1]).abs() < 1e-9, "{twist}: {slow:?} {rigid:?}");
        }
    }

    #[test]
    fn the_motor_turns_against_the_twist() {
        let (compliance, _) = known(&[SPRING]);
        let e = twisted(0.0);
        assert!(compliance.damping_nm(&e) < 0.0);
        assert!(compliance.damping_nm(&Estimate { stance: Leg::Outer, ..e }) > 0.0);
    }

    #[test]
    fn a_rigid_hip_is_left_as_it_is() {
        let (compliance, _) = known(&[]);
        assert_eq!(compliance.slow(&twisted(0.1)), twisted(0.1));
        assert!(compliance.damping_nm(&twisted(0.1)).abs() < f64::EPSILON);
    }
}
