//! Where things are. Lengths in leg lengths, frame in [`crate::model`]. RT: yes.

use crate::base::scalar::Scalar;

/// Sines and cosines that all equations share, from two evaluations: of θb and of σ/2.
#[derive(Clone, Copy, Debug)]
pub struct Trig<S> {
    /// sin, cos of the stance angle.
    pub stance: (S, S),
    /// sin, cos of the swing angle.
    pub swing: (S, S),
    /// sin, cos of the body angle θb.
    pub body: (S, S),
    /// sin, cos of σ/2.
    pub half: (S, S),
    /// sin, cos of σ.
    pub sigma: (S, S),
}

impl<S: Scalar> Trig<S> {
    /// For the angles `[θs, θw]`. With θs = θb + σ/2 and θw = θb - σ/2 the rest follows by addition theorems.
    #[inline]
    #[must_use]
    pub fn new(q: [S; 2]) -> Self {
        let (sb, cb) = ((q[0] + q[1]) * 0.5).sin_cos();
        let (sh, ch) = ((q[0] - q[1]) * 0.5).sin_cos();
        Self {
            stance: (sb * ch + cb * sh, cb * ch - sb * sh),
            swing: (sb * ch - cb * sh, cb * ch + sb * sh),
            body: (sb, cb),
            half: (sh, ch),
            sigma: (sh * ch * 2.0, ch * ch - sh * sh),
        }
    }
}

/// Swing toe seen from the stance toe, x and y.
#[inline]
#[must_use]
pub fn swing_toe<S: Scalar>(q: [S; 2]) -> [S; 2] {
    let t = Trig::new(q);
    [t.swing.0 - t.stance.0, t.stance.1 - t.swing.1]
}

/// Velocity of the swing toe relative to the stance toe: the first two columns of A in Thesis (4.10), times q̇.
#[inline]
#[must_use]
pub fn swing_toe_velocity<S: Scalar>(q: [S; 2], v: [S; 2]) -> [S; 2] {
    let t = Trig::new(q);
    [t.swing.1 * v[1] - t.stance.1 * v[0], t.swing.0 * v[1] - t.stance.0 * v[0]]
}

/// Hip seen from the stance toe.
#[inline]
#[must_use]
pub fn hip<S: Scalar>(q: [S; 2]) -> [S; 2] {
    let (s, c) = q[0].sin_cos();
    [-s, c]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shared_trigonometry_is_that_of_the_angles() {
        let q = [0.37, -0.81];
        let t = Trig::new(q);
        for (ours, angle) in [(t.stance, q[0]), (t.swing, q[1]), (t.sigma, q[0] - q[1])] {
            let (s, c) = libm::sincos(angle);
            assert!((ours.0 - s).abs() < 1e-15 && (ours.1 - c).abs() < 1e-15); // rounding
        }
    }

    #[test]
    fn swing_toe_velocity_is_the_derivative_of_its_place() {
        let (q, v, h) = ([0.2, -0.4], [0.7, -1.1], 1e-6);
        let at = |s: f64| swing_toe([q[0] + s * v[0], q[1] + s * v[1]]);
        let (after, before, exact) = (at(h), at(-h), swing_toe_velocity(q, v));
        for i in 0..2 {
            assert!(((after[i] - before[i]) / (2.0 * h) - exact[i]).abs() < 1e-9); // central difference
        }
    }
}
