//! Energy and momenta of the compass gait in floating coordinates: what the laws are checked with. RT: yes.

use super::compass_gait::dynamics::potential;
use super::compass_gait::floating::mass_matrix;
use super::compass_gait::params::Normalised;
use crate::base::linalg::{dot, times};
use crate::base::scalar::Scalar;

/// Kinetic energy for `v = [θ̇s, θ̇w, ẋ, ẏ]`, in m_t l².
#[must_use]
pub fn kinetic<S: Scalar>(p: &Normalised<S>, q: [S; 2], v: [S; 4]) -> S {
    dot(&v, &times(&mass_matrix(p, q), &v)) * 0.5
}

/// Kinetic and potential energy together, the stance toe at the height `y` (leg lengths).
#[must_use]
pub fn total<S: Scalar>(p: &Normalised<S>, q: [S; 2], y: S, v: [S; 4]) -> S {
    kinetic(p, q, v) + potential(p, q) + p.w2 * y
}

/// Linear momentum, x and y, in m_t l.
#[must_use]
pub fn linear_momentum<S: Scalar>(p: &Normalised<S>, q: [S; 2], v: [S; 4]) -> [S; 2] {
    let momentum = times(&mass_matrix(p, q), &v);
    [momentum[2], momentum[3]]
}

/// Angular momentum about the point `about`, seen from the stance toe in leg lengths; in m_t l², + counter-clockwise.
///
/// Turning the whole robot about its stance toe changes both angles alike, so the momentum about the toe is the sum of
/// the first two generalised momenta; another point sees the linear momentum at the toe in addition.
#[must_use]
pub fn angular_momentum<S: Scalar>(p: &Normalised<S>, q: [S; 2], v: [S; 4], about: [S; 2]) -> S {
    let m = times(&mass_matrix(p, q), &v);
    m[0] + m[1] - about[0] * m[3] + about[1] * m[2]
}
