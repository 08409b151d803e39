//! Touchdown of the swing toe: Thesis (4.10), (4.11) in the floating coordinates, then exchange of the legs.
//!
//! Beyond the thesis: restitution, Coulomb cone, and a robot that slides or flies before (toe velocity not zero).
//! Source: section 5 of our notes. RT: yes, no allocation.

#![expect(non_snake_case, reason = "thesis symbols")]

use super::floating::mass_matrix_at;
use super::kinematics::{Trig, swing_toe};
use super::params::Normalised;
use crate::base::linalg::{Square, dot, solve2};
use crate::base::scalar::Scalar;

/// How the ground takes a toe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ground<S> {
    /// Coefficient of restitution e, 0 (thesis) to 1.
    pub restitution: S,
    /// Coefficient of friction μ; [`Ground::RIGID`] has none that could be exceeded.
    pub friction: S,
}

impl Ground<f64> {
    /// Inelastic, never slips: the thesis' ground.
    pub const RIGID: Self = Self { restitution: 0.0, friction: f64::INFINITY };
}

/// Result of an impact, labels as before (legs not yet exchanged).
#[derive(Clone, Copy, Debug)]
pub struct Impact<S> {
    /// `[θ̇s, θ̇w, ẋ, ẏ]` after, x and y of the *old* stance toe. It must leave upward (ẏ ≥ 0), or both feet stay down.
    pub velocity: [S; 4],
    /// Impulse at the new foot, x and y, in m_t l per second.
    pub impulse: [S; 2],
    /// The new foot slides.
    pub slips: bool,
}

/// Swing toe velocity = A v, Thesis (4.10) in stance-first order and leg lengths.
#[inline]
#[must_use]
pub fn contact_rows<S: Scalar>(q: [S; 2]) -> [[S; 4]; 2] {
    contact_rows_at(&Trig::new(q))
}

/// [`contact_rows`] with the trigonometry at hand.
#[inline]
fn contact_rows_at<S: Scalar>(t: &Trig<S>) -> [[S; 4]; 2] {
    let (o, i) = (S::zero(), S::one());
    [[-t.stance.1, t.swing.1, i, o], [-t.stance.0, t.swing.0, o, i]]
}

/// Velocities just after the swing foot hits level ground with `v = [θ̇s, θ̇w, ẋ, ẏ]` (zeros for a pinned toe before).
///
/// The impulse acts at the new foot only. Source: Thesis (4.11); slip by the Coulomb cone, section 5 of the notes.
/// `None` when the mass matrix is singular, or when friction jams the slipping foot.
#[must_use]
pub fn touchdown<S: Scalar>(p: &Normalised<S>, q: [S; 2], v: [S; 4], ground: &Ground<S>) -> Option<Impact<S>> {
    let t = Trig::new(q);
    let A = contact_rows_at(&t);
    let W = responses(&mass_matrix_at(p, &t), &A)?;
    let D = [[dot(&A[0], &W[0]), dot(&A[0], &W[1])], [dot(&A[1], &W[0]), dot(&A[1], &W[1])]];
    let c = [dot(&A[0], &v), dot(&A[1], &v)];
    let stick = solve2(&D, [-c[0], -((ground.restitution + 1.0) * c[1])]);
    let bounded = ground.friction.value().is_finite();
    let slips = bounded && stick[0].abs() > ground.friction * stick[1];
    let impulse = if slips { sliding_impulse(&D, c, ground, stick[0].sign())? } else { stick };
    let mut velocity = v;
    for i in 0..4 {
        velocity[i] += W[0][i] * impulse[0] + W[1][i] * impulse[1];
    }
    Some(Impact { velocity, impulse, slips })
}

/// Rows of `(M⁻¹ Aᵀ)ᵀ`. `M = [H Jᵀ; J I]`, so the toe is eliminated by hand: `(H - Jᵀ J) x = a - Jᵀ a_toe`.
fn responses<S: Scalar>(M: &Square<S, 4>, A: &[[S; 4]; 2]) -> Option<[[S; 4]; 2]> {
    let j = [[M[2][0], M[2][1]], [M[3][0], M[3][1]]];
    let left = |r: usize, c: usize| M[r][c] - j[0][r] * j[0][c] - j[1][r] * j[1][c];
    let off = left(0, 1);
    let schur = [[left(0, 0), off], [off, left(1, 1)]];
    let det = schur[0][0] * schur[1][1] - off * off;
    if det.value() == 0.0 || !det.value().is_finite() {
        return None;
    }
    Some(A.map(|a| {
        let right = |r: usize| a[r] - j[0][r] * a[2] - j[1][r] * a[3];
        let x = solve2(&schur, [right(0), right(1)]);
        let toe = |k: usize| a[2 + k] - j[k][0] * x[0] - j[k][1] * x[1];
        [x[0], x[1], toe(0), toe(1)]
    }))
}

/// `Ix = ±μ Iy` and the normal row alone: `Iy = -(1+e) c_y / (D_yy ± μ D_yx)`.
fn sliding_impulse<S: Scalar>(D: &Square<S, 2>, c: [S; 2], ground: &Ground<S>, side: f64) -> Option<[S; 2]> {
    let mu = ground.friction * side;
    let normal = -((ground.restitution + 1.0) * c[1]) / (D[1][1] + mu * D[1][0]);
    (normal.value() >= 0.0 && normal.value().is_finite()).then_some([mu * normal, normal])
}

/// Exchanges the labels: the old swing leg stands. Angles are absolute, so they only change places.
#[must_use]
pub fn exchange<S: Scalar>(x: &[S; 4]) -> [S; 4] {
    [x[1], x[0], x[3], x[2]]
}

/// Inelastic touchdown without slip and exchange of legs in one, for states `[θs, θw, θ̇s, θ̇w]` of a pinned robot:
/// the reset map of walking. The result belongs to the *other* leg's parameters.
#[must_use]
pub fn step<S: Scalar>(p: &Normalised<S>, x: &[S; 4]) -> Option<[S; 4]> {
    let rigid = Ground { restitution: S::zero(), friction: S::constant(f64::INFINITY) };
    let hit = touchdown(p, [x[0], x[1]], [x[2], x[3], S::zero(), S::zero()], &rigid)?;
    Some(exchange(&[x[0], x[1], hit.velocity[0], hit.velocity[1]]))
}

/// Height of the swing toe above ground that rises with `slope` (tangent) from the stance toe, in leg lengths.
///
/// Touchdown is its fall through zero with the feet apart (θs, θw of opposite sign on level ground): both legs side by
/// side (θs = θw) is a grazing zero of the same function, not an impact.
#[inline]
#[must_use]
pub fn clearance<S: Scalar>(q: [S; 2], slope: S) -> S {
    let toe = swing_toe(q);
    toe[1] - slope * toe[0]
}
