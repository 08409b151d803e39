//! The torque that the stance foot can bear: within its friction cone, pressed on the floor. RT: yes.
//!
//! The force on the foot is affine in the hip torque, so each condition bounds the torque from one side.

use super::State;
use crate::base::linalg::{dot, solve2};
use crate::model::compass_gait::dynamics::{bias_at, mass_matrix_at};
use crate::model::compass_gait::floating::{centripetal, momentum_rows};
use crate::model::compass_gait::kinematics::Trig;
use crate::model::compass_gait::params::Normalised;

/// The foot's share of its weight that it must bear at least.
const PRESSED: f64 = 0.2;

/// Net torque nearest to `wanted` for which the foot neither slips at friction `mu` nor lifts off; `wanted` itself where
/// there is none.
#[must_use]
pub fn bearable(model: &Normalised<f64>, x: &State, mu: f64, wanted: f64) -> f64 {
    let [stance, swing, stance_rate, swing_rate] = *x;
    let rates = [stance_rate, swing_rate];
    let t = Trig::new([stance, swing]);
    let (mass, [bias_s, bias_w]) = (mass_matrix_at(model, &t), bias_at(model, &t, rates));
    let ([along, up], [offset_x, offset_y]) = (momentum_rows(model, &t), centripetal(model, &t, rates));
    let (still, per_torque) = (solve2(&mass, [-bias_s, -bias_w]), solve2(&mass, [1.0, -1.0]));
    let fx = [dot(&along, &still) + offset_x, dot(&along, &per_torque)];
    let fy = [dot(&up, &still) + offset_y + model.w2, dot(&up, &per_torque)];
    let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
    // Each is: constant + slope * torque at least 0.
    let conditions = [
        [mu * fy[0] - fx[0], mu * fy[1] - fx[1]],
        [mu * fy[0] + fx[0], mu * fy[1] + fx[1]],
        [fy[0] - PRESSED * model.w2, fy[1]],
    ];
    for [constant, slope] in conditions {
        if slope > 0.0 {
            low = low.max(-constant / slope);
        } else if slope < 0.0 {
            high = high.min(-constant / slope);
        }
    }
    if low <= high { wanted.max(low).min(high) } else { wanted }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::compass_gait::floating;
    use crate::model::compass_gait::params::Params;

    #[test]
    fn torque_is_left_alone_inside_the_cone_and_ends_on_its_edge_outside() {
        let model = Params::sysid().normalised();
        // Section 10 of the notes: the force at 5 Nm is -17.839, 145.384 N.
        let x = [0.1, -0.2, 0.5, -1.0];
        let unit = Params::sysid().inertia_kg_m2();
        assert!((bearable(&model, &x, 0.6, 5.0 / unit) - 5.0 / unit).abs() < 1e-15);
        // The momentum of the floating robot, differenced in time, is the force less the weight.
        let force = |torque: f64| {
            let a = crate::model::compass_gait::dynamics::acceleration_without_friction(
                &model,
                [x[0], x[1]],
                [x[2], x[3]],
                torque,
            );
            let momentum = |h: f64| {
                let q = [x[0] + h * x[2] + 0.5 * h * h * a[0], x[1] + h * x[3] + 0.5 * h * h * a[1]];
                let rows = floating::momentum_rows(&model, &Trig::new(q));
                let v = [x[2] + h * a[0], x[3] + h * a[1]];
                [dot(&rows[0], &v), dot(&rows[1], &v)]
            };
            let (after, before) = (momentum(1e-5), momentum(-1e-5));
            [(after[0] - before[0]) / 2e-5, (after[1] - before[1]) / 2e-5 + model.w2]
        };
        let m = Params::sysid().mass_moment_kg_m();
        let [fx, fy] = force(0.301_227_0);
        assert!((m * fx + 17.839_173).abs() < 1e-2 && (m * fy - 145.383_615).abs() < 1e-2);
        for (mu, wanted) in [(0.1, 10.0), (0.1, -10.0), (0.3, 20.0)] {
            let torque = bearable(&model, &x, mu, wanted);
            let [fx, fy] = force(torque);
            let on_cone = (fx.abs() - mu * fy).abs() < 1e-4;
            assert!(
                (torque - wanted).abs() > 0.0 && (on_cone || (fy - PRESSED * model.w2).abs() < 1e-4),
                "{mu} {torque} {fx} {fy}"
            );
        }
    }
}
