//! Pinned dynamics `H q̈ + C q̇ + G = [1,-1]ᵀ (τ + τ_f)`, stance leg first, normalised. RT: yes, ~0.1 µs in f64.
//!
//! Source: Thesis (4.1)-(4.6), (4.12), corrected (sections 3 and 4 of our notes: stance row first, θ₋ = σ, argument
//! θ₊/2 in the body's gravity, friction that takes energy away).

#![expect(non_snake_case, reason = "thesis symbols")]

use super::kinematics::Trig;
use super::params::Normalised;
use crate::base::linalg::solve2;
use crate::base::scalar::Scalar;

/// Steepness of the smoothed Coulomb friction, s/rad: Thesis (4.12) has 2/(1+e^(-200 r)) - 1 = tanh(100 r).
pub const COULOMB_SLOPE_S_RAD: f64 = 100.0;

/// Mass matrix H, Thesis (4.4).
#[inline]
#[must_use]
pub fn mass_matrix<S: Scalar>(p: &Normalised<S>, q: [S; 2]) -> [[S; 2]; 2] {
    mass_matrix_at(p, &Trig::new(q))
}

/// [`mass_matrix`] with the trigonometry at hand.
#[inline]
#[must_use]
pub fn mass_matrix_at<S: Scalar>(p: &Normalised<S>, t: &Trig<S>) -> [[S; 2]; 2] {
    let [c1, c2, c3, c4, c5, c6] = p.c;
    let H11 = c1 - c4 * 2.0 + c6 * t.half.1 * 4.0 + 1.0;
    let H12 = c3 - c5 * t.sigma.1 + c6 * t.half.1 * 2.0;
    [[H11, H12], [H12, c2]]
}

/// C, Thesis (4.5). `Ḣ - 2C` is *not* skew-symmetric for this choice; only `q̇ᵀ(Ḣ - 2C)q̇ = 0`.
#[inline]
#[must_use]
pub fn coriolis_matrix<S: Scalar>(p: &Normalised<S>, q: [S; 2], v: [S; 2]) -> [[S; 2]; 2] {
    let t = Trig::new(q);
    let [.., c5, c6] = p.c;
    let (body, swing) = (c6 * t.half.0, c5 * t.sigma.0);
    [[body * (v[1] * 2.0 - v[0]), (body - swing) * v[1]], [(swing - body * 2.0) * v[0], S::zero()]]
}

/// C q̇.
#[inline]
#[must_use]
pub fn coriolis_at<S: Scalar>(p: &Normalised<S>, t: &Trig<S>, v: [S; 2]) -> [S; 2] {
    let [.., c5, c6] = p.c;
    let (body, swing) = (c6 * t.half.0, c5 * t.sigma.0);
    [body * (v[1] * 2.0 - v[0]) * v[0] + (body - swing) * v[1] * v[1], (swing - body * 2.0) * v[0] * v[0]]
}

/// Gravity G, Thesis (4.6).
#[inline]
#[must_use]
pub fn gravity<S: Scalar>(p: &Normalised<S>, q: [S; 2]) -> [S; 2] {
    gravity_at(p, &Trig::new(q))
}

/// [`gravity`] with the trigonometry at hand.
#[inline]
#[must_use]
pub fn gravity_at<S: Scalar>(p: &Normalised<S>, t: &Trig<S>) -> [S; 2] {
    let [_, _, _, c4, c5, c6] = p.c;
    let body = c6 * t.body.0 * 2.0;
    [p.w2 * ((c4 - 1.0) * t.stance.0 - body), p.w2 * (c5 * t.swing.0 - body)]
}

/// C q̇ + G: what is left of the equation of motion at zero acceleration.
#[inline]
#[must_use]
pub fn bias_at<S: Scalar>(p: &Normalised<S>, t: &Trig<S>, v: [S; 2]) -> [S; 2] {
    let (c, g) = (coriolis_at(p, t, v), gravity_at(p, t));
    [c[0] + g[0], c[1] + g[1]]
}

/// Potential energy U, zero at toe height.
#[inline]
#[must_use]
pub fn potential<S: Scalar>(p: &Normalised<S>, q: [S; 2]) -> S {
    let t = Trig::new(q);
    let [_, _, _, c4, c5, c6] = p.c;
    p.w2 * ((-c4 + 1.0) * t.stance.1 - c5 * t.swing.1 + c6 * t.body.1 * 4.0)
}

/// Kinetic energy T of the pinned robot.
#[inline]
#[must_use]
pub fn kinetic<S: Scalar>(p: &Normalised<S>, q: [S; 2], v: [S; 2]) -> S {
    let H = mass_matrix(p, q);
    (H[0][0] * v[0] * v[0] + H[0][1] * v[0] * v[1] * 2.0 + H[1][1] * v[1] * v[1]) * 0.5
}

/// Hip friction `τ_f` at the rate `r = θ̇s - θ̇w`, smoothed, Thesis (4.12) with the sign that dissipates.
///
/// Near rest this is a damper of `b_v + 100 b_c` (rates of 78 and 111 1/s): explicit steps must stay below 18 ms.
#[inline]
#[must_use]
pub fn friction<S: Scalar>(p: &Normalised<S>, r: S) -> S {
    -(p.viscous * r) - p.coulomb * (r * COULOMB_SLOPE_S_RAD).tanh()
}

/// Accelerations `[θ̈s, θ̈w]` under the hip torque `tau` (friction included in it by the caller).
#[inline]
#[must_use]
pub fn acceleration_without_friction<S: Scalar>(p: &Normalised<S>, q: [S; 2], v: [S; 2], tau: S) -> [S; 2] {
    let t = Trig::new(q);
    let bias = bias_at(p, &t, v);
    solve2(&mass_matrix_at(p, &t), [tau - bias[0], -tau - bias[1]])
}

/// Accelerations `[θ̈s, θ̈w]` under the motor's torque `tau`, with smoothed friction.
#[inline]
#[must_use]
pub fn acceleration<S: Scalar>(p: &Normalised<S>, q: [S; 2], v: [S; 2], tau: S) -> [S; 2] {
    acceleration_without_friction(p, q, v, tau + friction(p, v[0] - v[1]))
}

/// State derivative of `x = [θs, θw, θ̇s, θ̇w]`, with smoothed friction.
#[inline]
#[must_use]
pub fn derivative<S: Scalar>(p: &Normalised<S>, x: &[S; 4], tau: S) -> [S; 4] {
    let a = acceleration(p, [x[0], x[1]], [x[2], x[3]], tau);
    [x[2], x[3], a[0], a[1]]
}

/// Total hip torque that keeps the hip angle from accelerating (`σ̈ = 0`): what a locked hip transmits.
/// Own derivation; proven by the test `locked_hip_does_not_accelerate`.
#[must_use]
pub fn locking_torque<S: Scalar>(p: &Normalised<S>, q: [S; 2], v: [S; 2]) -> S {
    let t = Trig::new(q);
    let (H, bias) = (mass_matrix_at(p, &t), bias_at(p, &t, v));
    let (free, per_torque) = (solve2(&H, bias), solve2(&H, [S::one(), -S::one()]));
    (free[0] - free[1]) / (per_torque[0] - per_torque[1])
}

/// True (set-valued) Coulomb and viscous friction of the hip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HipFriction<S> {
    /// The hip does not move and friction takes up this torque, at most the Coulomb level.
    Stick(S),
    /// The hip moves, or breaks away under this friction torque.
    Slip(S),
}

impl<S: Copy> HipFriction<S> {
    /// The friction torque, whichever way.
    pub const fn torque(&self) -> S {
        match self {
            Self::Stick(f) | Self::Slip(f) => *f,
        }
    }
}

/// Friction by the exact law: `-b_v r - b_c sign r` in motion; at rest whatever holds the hip, up to `b_c`.
///
/// `stuck` is the caller's discrete state (rates never hit zero exactly); `transmitted` the torque that the friction
/// would have to carry, that is locking torque minus motor torque.
#[must_use]
pub fn stick_slip<S: Scalar>(p: &Normalised<S>, r: S, stuck: bool, transmitted: S) -> HipFriction<S> {
    if !stuck {
        return HipFriction::Slip(-(p.viscous * r) - p.coulomb * r.sign());
    }
    if transmitted.abs() <= p.coulomb {
        HipFriction::Stick(transmitted)
    } else {
        HipFriction::Slip(p.coulomb * transmitted.sign())
    }
}
