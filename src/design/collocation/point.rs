//! What is evaluated at every knot and midpoint: accelerations, bounded quantities, cost rate. RT: no.

use crate::base::linalg::{dot, solve2};
use crate::base::scalar::Scalar;
use crate::design::problem::{Cost, Limits};
use crate::model::compass_gait::dynamics::{bias_at, friction, mass_matrix_at};
use crate::model::compass_gait::floating::{centripetal, momentum_rows};
use crate::model::compass_gait::kinematics::Trig;
use crate::model::compass_gait::params::Normalised;

/// Bounded quantities at a point: motor torque, μFy - Fx, μFy + Fx, Fy.
pub(super) const ROWS: usize = 4;
/// Width over which positive power is smoothed, normalised: 0.02 is 0.3 W.
const POWER_SMOOTHING: f64 = 0.02;

/// Values at a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point<S> {
    /// Accelerations of stance and swing leg.
    pub(super) acceleration: [S; 2],
    /// The bounded quantities.
    pub(super) rows: [S; ROWS],
    /// Cost rate.
    pub(super) cost: S,
}

/// Evaluates at `[θs, θw, θ̇s, θ̇w, τ]`, all normalised.
pub(super) fn point<S: Scalar>(p: &Normalised<S>, limits: &Limits, cost: &Cost, w: &[S; 5]) -> Point<S> {
    let (q, v, tau) = ([w[0], w[1]], [w[2], w[3]], w[4]);
    let t = Trig::new(q);
    let bias = bias_at(p, &t, v);
    let acceleration = solve2(&mass_matrix_at(p, &t), [tau - bias[0], -tau - bias[1]]);
    let (rows, b) = (momentum_rows(p, &t), centripetal(p, &t, v));
    let fx = dot(&rows[0], &acceleration) + b[0];
    let fy = dot(&rows[1], &acceleration) + b[1] + p.w2;
    let rate = v[0] - v[1];
    let motor = tau - friction(p, rate) * limits.compensation;
    let cone = fy * limits.friction;
    Point { acceleration, rows: [motor, cone - fx, cone + fx, fy], cost: cost_rate(cost, tau, motor, rate) }
}

fn cost_rate<S: Scalar>(cost: &Cost, tau: S, motor: S, rate: S) -> S {
    let mut sum = tau.square() * cost.torque + cost.time;
    if cost.motor > 0.0 {
        sum += motor.square() * cost.motor;
    }
    if cost.power > 0.0 {
        let power = motor * rate;
        sum += (power + (power.square() + POWER_SMOOTHING * POWER_SMOOTHING).sqrt()) * (0.5 * cost.power);
    }
    sum
}
