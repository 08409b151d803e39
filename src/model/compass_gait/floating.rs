//! The robot with its stance toe free: unknowns `[θs, θw, x, y]`, x and y of the stance toe in leg lengths. RT: yes.
//!
//! Source: section 3 of our notes (the thesis refers to an appendix that does not contain it).

#![expect(non_snake_case, reason = "thesis symbols")]

use super::dynamics::{self, bias_at};
use super::kinematics::Trig;
use super::params::Normalised;
use crate::base::linalg::{Square, dot, solve};
use crate::base::scalar::Scalar;

/// Rows Jx and Jy: momentum of the whole robot per leg rate, the stance toe at rest.
#[inline]
#[must_use]
pub fn momentum_rows<S: Scalar>(p: &Normalised<S>, t: &Trig<S>) -> [[S; 2]; 2] {
    let [_, _, _, c4, c5, c6] = p.c;
    let above = -c4 + 1.0;
    let (sb, cb) = (c6 * t.body.0 * 2.0, c6 * t.body.1 * 2.0);
    [[-(above * t.stance.1) - cb, c5 * t.swing.1 - cb], [-(above * t.stance.0) - sb, c5 * t.swing.0 - sb]]
}

/// `J̇ q̇`: the part of the total force that comes from the rates.
#[inline]
#[must_use]
pub fn centripetal<S: Scalar>(p: &Normalised<S>, t: &Trig<S>, v: [S; 2]) -> [S; 2] {
    let [_, _, _, c4, c5, c6] = p.c;
    let above = (-c4 + 1.0) * v[0] * v[0];
    let swing = c5 * v[1] * v[1];
    let body = c6 * ((v[0] + v[1]) * 0.5).square() * 4.0;
    [
        above * t.stance.0 - swing * t.swing.0 + body * t.body.0,
        -(above * t.stance.1) + swing * t.swing.1 - body * t.body.1,
    ]
}

/// Mass matrix M = [H Jᵀ; J I].
#[inline]
#[must_use]
pub fn mass_matrix<S: Scalar>(p: &Normalised<S>, q: [S; 2]) -> Square<S, 4> {
    mass_matrix_at(p, &Trig::new(q))
}

/// [`mass_matrix`] with the trigonometry at hand.
#[inline]
#[must_use]
pub fn mass_matrix_at<S: Scalar>(p: &Normalised<S>, t: &Trig<S>) -> Square<S, 4> {
    let (H, J) = (dynamics::mass_matrix_at(p, t), momentum_rows(p, t));
    let (o, i) = (S::zero(), S::one());
    [
        [H[0][0], H[0][1], J[0][0], J[1][0]],
        [H[1][0], H[1][1], J[0][1], J[1][1]],
        [J[0][0], J[0][1], i, o],
        [J[1][0], J[1][1], o, i],
    ]
}

/// Right-hand side `[ [1,-1]ᵀ tau - C q̇ - G ; -b - (0, w²) ]` without ground force. `tau` includes friction.
/// The toe's own velocity does not enter: uniform motion of the whole robot changes no force.
#[inline]
#[must_use]
pub fn free_force<S: Scalar>(p: &Normalised<S>, q: [S; 2], v: [S; 2], tau: S) -> [S; 4] {
    let t = Trig::new(q);
    let (bias, b) = (bias_at(p, &t, v), centripetal(p, &t, v));
    [tau - bias[0], -tau - bias[1], -b[0], -b[1] - p.w2]
}

/// Force of the ground on a pinned stance toe, [x, y], for the accelerations `a` of [`super::dynamics`].
/// The contact holds while `Fy > 0` and `|Fx| ≤ μ Fy`.
#[inline]
#[must_use]
pub fn ground_force<S: Scalar>(p: &Normalised<S>, q: [S; 2], v: [S; 2], a: [S; 2]) -> [S; 2] {
    let t = Trig::new(q);
    let (J, b) = (momentum_rows(p, &t), centripetal(p, &t, v));
    [dot(&J[0], &a) + b[0], dot(&J[1], &a) + b[1] + p.w2]
}

/// Accelerations `[θ̈s, θ̈w, ẍ, ÿ]` in flight. `tau` includes friction. `None` only for a singular mass matrix.
#[must_use]
pub fn airborne<S: Scalar>(p: &Normalised<S>, q: [S; 2], v: [S; 2], tau: S) -> Option<[S; 4]> {
    solve(mass_matrix(p, q), free_force(p, q, v, tau))
}

/// What a sliding stance toe does.
#[derive(Clone, Copy, Debug)]
pub struct Sliding<S> {
    /// `[θ̈s, θ̈w, ẍ]`; the toe keeps its height.
    pub acceleration: [S; 3],
    /// Normal force; the toe lifts off when this falls below zero.
    pub normal_force: S,
}

/// Accelerations while the stance toe slides on level ground with friction `mu` against the direction `sign` (of ẋ).
/// `None` if friction jams it (Painlevé: the system is singular).
#[must_use]
pub fn sliding<S: Scalar>(p: &Normalised<S>, q: [S; 2], v: [S; 2], tau: S, mu: S, sign: f64) -> Option<Sliding<S>> {
    let (M, f) = (mass_matrix(p, q), free_force(p, q, v, tau));
    let mut a = M;
    // Unknowns [θ̈s, θ̈w, ẍ, N]: ÿ = 0 gives its column to the normal force, Fx = -mu sign N.
    let column = [S::zero(), S::zero(), mu * sign, -S::one()];
    for (row, force) in a.iter_mut().zip(column) {
        row[3] = force;
    }
    let x = solve(a, f)?;
    Some(Sliding { acceleration: [x[0], x[1], x[2]], normal_force: x[3] })
}
