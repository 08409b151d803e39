//! Harmonic drive with a spring between rotor and legs: six states. Thesis 4.4; section 6 of our notes. RT: yes.
//!
//! φ is the rotor's angle divided by the gear ratio, in the sense of σ = θs - θw. The reflected rotor inertia is part of
//! the identified c's (rigid limit), so it is taken out of them here.

use super::dynamics::{acceleration_without_friction, friction, mass_matrix};
use super::params::{Elasticity, Normalised};
use crate::base::linalg::solve2;
use crate::base::scalar::Scalar;

/// What moves with the legs alone: c1 - Jr, c2 - Jr, c3 + Jr (a rotor on the body's bisector has both signs).
#[inline]
#[must_use]
pub fn without_rotor<S: Scalar>(p: &Normalised<S>, rotor_inertia: S) -> Normalised<S> {
    let [c1, c2, c3, c4, c5, c6] = p.c;
    Normalised { c: [c1 - rotor_inertia, c2 - rotor_inertia, c3 + rotor_inertia, c4, c5, c6], ..*p }
}

/// Torque of the spring and its damper on the legs, for the twist `φ - σ`. `e` normalised.
#[inline]
#[must_use]
pub fn spring_torque<S: Scalar>(e: &Elasticity<S>, twist: S, twist_rate: S) -> S {
    e.stiffness_nm_rad * twist + e.damping_nm_s_rad * twist_rate
}

/// `[θ̈s, θ̈w, φ̈]` for `x = [θs, θw, φ, θ̇s, θ̇w, φ̇]`, motor torque `tau`, friction torque `tau_f` at the hip.
///
/// `legs` from [`without_rotor`], `e` from [`Elasticity::normalised`] (all normalised here, whatever its field names say).
#[inline]
#[must_use]
pub fn acceleration_with<S: Scalar>(legs: &Normalised<S>, e: &Elasticity<S>, x: &[S; 6], tau: S, tau_f: S) -> [S; 3] {
    let [ts, tw, phi, vs, vw, vphi] = *x;
    let tau_s = spring_torque(e, phi - ts + tw, vphi - vs + vw);
    let a = acceleration_without_friction(legs, [ts, tw], [vs, vw], tau_s + tau_f);
    [a[0], a[1], (tau - tau_s - e.rotor_damping_nm_s_rad * vphi) / e.rotor_inertia_kg_m2]
}

/// [`acceleration_with`] and the smoothed friction of the legs.
#[inline]
#[must_use]
pub fn acceleration<S: Scalar>(legs: &Normalised<S>, e: &Elasticity<S>, x: &[S; 6], tau: S) -> [S; 3] {
    acceleration_with(legs, e, x, tau, friction(legs, x[3] - x[4]))
}

/// State derivative of `[θs, θw, φ, θ̇s, θ̇w, φ̇]`, with smoothed friction.
#[inline]
#[must_use]
pub fn derivative<S: Scalar>(legs: &Normalised<S>, e: &Elasticity<S>, x: &[S; 6], tau: S) -> [S; 6] {
    let a = acceleration(legs, e, x, tau);
    [x[3], x[4], x[5], a[0], a[1], a[2]]
}

/// Inertia that the spring sees on the legs' side: `1 / ([1,-1] H̃⁻¹ [1,-1]ᵀ)`.
#[must_use]
pub fn leg_inertia<S: Scalar>(legs: &Normalised<S>, q: [S; 2]) -> S {
    let a = solve2(&mass_matrix(legs, q), [S::one(), -S::one()]);
    S::one() / (a[0] - a[1])
}

/// Spring and damper (normalised) that give the resonance `frequency_hz` with damping ratio `ratio` at the upright.
#[must_use]
pub fn tuned(p: &Normalised<f64>, rotor_inertia: f64, frequency_hz: f64, ratio: f64) -> Elasticity<f64> {
    let legs = leg_inertia(&without_rotor(p, rotor_inertia), [0.0, 0.0]);
    let w = std::f64::consts::TAU * frequency_hz;
    let reduced = 1.0 / (1.0 / rotor_inertia + 1.0 / legs);
    Elasticity {
        stiffness_nm_rad: w * w * reduced,
        damping_nm_s_rad: 2.0 * ratio * w * reduced,
        rotor_inertia_kg_m2: rotor_inertia,
        rotor_damping_nm_s_rad: 0.0,
    }
}
