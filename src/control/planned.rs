//! What the laws that follow a plan share: its phases by leg, and toes for legs that the plan takes as equally long. RT: yes.
//!
//! The planned impact happens on level ground with equal legs. So the stance toe stands at the nominal length; the swing
//! toe goes in, and comes out in time to pass the nominal length at the planned touchdown, then reaches on until it meets
//! the ground: a lower floor is met by a longer toe, a higher one earlier.

use super::tables::{Node, PhaseTable, PlanFile};
use super::{ControllerError, motor_sign};
use crate::base::linalg::{add_scaled, dot};
use crate::config::checked::{Config, Plan};
use crate::msg::{Estimate, Leg};

/// The plan of the configuration, which must be of this kind.
#[expect(clippy::disallowed_macros, clippy::disallowed_methods, reason = "before arming")]
pub(super) fn read(config: &Config, kind: &str) -> Result<PlanFile, ControllerError> {
    let refuse = |cause| ControllerError::Plan { cause };
    let Plan { name, text } = &config.control.plan;
    let plan = PlanFile::parse(name, text, &config.robot.model.params()).map_err(|e| refuse(e.to_string()))?;
    if plan.kind == kind {
        Ok(plan)
    } else {
        Err(refuse(format!("{name}: control.controller needs a plan of kind `{kind}`, this is a `{}`", plan.kind)))
    }
}

/// The leg that stands in a phase.
pub(super) const fn leg_of(phase: &PhaseTable) -> Leg {
    if phase.inner_stands { Leg::Inner } else { Leg::Outer }
}

/// State as plans have it.
pub(super) const fn state_of(e: &Estimate) -> [f64; 4] {
    [e.theta_stance_rad, e.theta_swing_rad, e.theta_stance_rad_s, e.theta_swing_rad_s]
}

/// Torque, + on inner: planned, less `share` of the feedback by `gain`; and friction, which plans leave out.
pub(super) fn torque_nm(e: &Estimate, node: &Node, gain_nm: &[f64; 4], share: f64, friction_nm: f64) -> f64 {
    let error = add_scaled(&state_of(e), -1.0, &node.state);
    motor_sign(e.stance) * (node.torque_nm - share * dot(gain_nm, &error) + friction_nm)
}

/// Cost-to-go of an error: `error' S error`, S by its upper triangle.
pub(super) fn cost(s: &[f64; 10], error: &[f64; 4]) -> f64 {
    let [a, b, c, d] = *error;
    let [aa, ab, ac, ad, bb, bc, bd, cc, cd, dd] = *s;
    aa * a * a
        + bb * b * b
        + cc * c * c
        + dd * d * d
        + 2.0 * (ab * a * b + ac * a * c + ad * a * d + bc * b * c + bd * b * d + cd * c * d)
}
