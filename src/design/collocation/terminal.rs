//! What holds at the end of a phase: equations and bounds on its last state, and the impact. RT: no.

#![expect(non_snake_case, reason = "thesis symbols")]

use super::rows::Quantity;
use crate::base::linalg::solve2;
use crate::base::scalar::Scalar;
use crate::design::problem::{End, Landing, Limits};
use crate::model::compass_gait::dynamics::{gravity, mass_matrix};
use crate::model::compass_gait::floating::momentum_rows;
use crate::model::compass_gait::impact::{Ground, contact_rows, touchdown};
use crate::model::compass_gait::kinematics::{Trig, swing_toe, swing_toe_velocity};
use crate::model::compass_gait::params::Normalised;

/// A landing without any impulse is at the apex of all cones at once, where no gradient tells them apart; this much
/// (0.016 Ns, 0.016 N) keeps it inside.
const APEX: f64 = 1e-3;

/// Conditions on a last state.
#[derive(Clone, Debug, Default)]
pub(super) struct Terminal<S> {
    /// Equations: quantity, value that must vanish.
    pub(super) equations: Vec<(Quantity, S)>,
    /// Bounds: quantity, value, lowest, highest.
    pub(super) bounds: Vec<(Quantity, S, f64, f64)>,
}

/// The conditions of an end. Lengths in leg lengths, `l` in m.
pub(super) fn conditions<S: Scalar>(end: &End, p: &Normalised<S>, limits: &Limits, l: f64, x: &[S; 4]) -> Terminal<S> {
    let mut out = Terminal { equations: Vec::new(), bounds: Vec::new() };
    match end {
        End::State(target) => {
            out.equations = (0..4).map(|i| (Quantity::EndState(i), x[i] - target[i])).collect();
        }
        End::Basin { centre, form, level } => {
            let d: [S; 4] = std::array::from_fn(|i| x[i] - centre[i]);
            let mut sum = S::zero();
            for i in 0..4 {
                for j in 0..4 {
                    sum += d[i] * d[j] * form[i][j];
                }
            }
            out.bounds.push((Quantity::Basin, sum / *level, f64::NEG_INFINITY, 1.0));
        }
        End::Touchdown(landing) => {
            place(&mut out, landing, l, x);
            if limits.impact {
                leaving(&mut out, p, limits, x);
            }
        }
        End::Rest(landing) => {
            place(&mut out, landing, l, x);
            resting(&mut out, p, limits, x);
        }
    }
    out
}

/// The swing toe on the floor, at the step's length, falling.
fn place<S: Scalar>(out: &mut Terminal<S>, landing: &Landing, l: f64, x: &[S; 4]) {
    let (q, v) = ([x[0], x[1]], [x[2], x[3]]);
    let toe = swing_toe(q);
    let [short, long] = landing.step_m;
    out.equations.push((Quantity::TouchdownHeight, toe[1] - landing.floor_m / l));
    if short < long {
        out.bounds.push((Quantity::StepLength, toe[0], short / l, long / l));
    } else {
        out.equations.push((Quantity::StepLength, toe[0] - short / l));
    }
    if landing.descent_m_s > 0.0 {
        let fall = -swing_toe_velocity(q, v)[1];
        out.bounds.push((Quantity::Descent, fall, landing.descent_m_s / l, f64::INFINITY));
    }
}

/// The impact within the friction cone, and the old stance toe leaving upward.
fn leaving<S: Scalar>(out: &mut Terminal<S>, p: &Normalised<S>, limits: &Limits, x: &[S; 4]) {
    let rigid = Ground { restitution: S::zero(), friction: S::constant(f64::INFINITY) };
    let Some(hit) = touchdown(p, [x[0], x[1]], [x[2], x[3], S::zero(), S::zero()], &rigid) else { return };
    let cone = hit.impulse[1] * limits.friction;
    out.bounds.push((Quantity::ImpactCone, cone - hit.impulse[0], 0.0, f64::INFINITY));
    out.bounds.push((Quantity::ImpactCone, cone + hit.impulse[0], 0.0, f64::INFINITY));
    out.bounds.push((Quantity::LiftOff, hit.velocity[3], 0.0, f64::INFINITY));
}

/// Both feet take the impact and the weight within their cones.
///
/// Own derivation: with both toes fixed nothing can move, so the impulses end all motion. The leg rows of
/// `M v + A_newᵀ I_new + A_oldᵀ I_old = 0` hold I_new alone (the old toe's columns act on x, y only), then the other
/// two give I_old; the static forces follow alike from `G` and the weight.
fn resting<S: Scalar>(out: &mut Terminal<S>, p: &Normalised<S>, limits: &Limits, x: &[S; 4]) {
    let (q, v) = ([x[0], x[1]], [x[2], x[3]]);
    let A = contact_rows(q);
    let At = [[A[0][0], A[1][0]], [A[0][1], A[1][1]]];
    let (H, J) = (mass_matrix(p, q), momentum_rows(p, &Trig::new(q)));
    let momentum = |row: &[S; 2]| row[0] * v[0] + row[1] * v[1];
    let new = solve2(&At, [-momentum(&H[0]), -momentum(&H[1])]);
    let old = [-momentum(&J[0]) - new[0], -momentum(&J[1]) - new[1]];
    let weight_new = solve2(&At, gravity(p, q));
    let weight_old = [-weight_new[0], p.w2 - weight_new[1]];
    for (quantity, force) in [
        (Quantity::ImpactCone, new),
        (Quantity::ImpactCone, old),
        (Quantity::StandingCone, weight_new),
        (Quantity::StandingCone, weight_old),
    ] {
        let cone = force[1] * limits.friction;
        out.bounds.push((quantity, cone - force[0], -APEX, f64::INFINITY));
        out.bounds.push((quantity, cone + force[0], -APEX, f64::INFINITY));
    }
}
