//! Linearisation by dual numbers: the *full* Jacobian, where Thesis (4.8) has only its value at rest. RT: yes.

use super::params::{Elasticity, Normalised};
use super::{dynamics, elastic};
use crate::base::scalar::{Dual, Scalar};

/// `ẋ ≈ A (x - x₀) + B (τ - τ₀) + f(x₀, τ₀)`.
#[derive(Clone, Copy, Debug)]
pub struct Linear<const N: usize> {
    /// State matrix.
    pub a: [[f64; N]; N],
    /// Input column.
    pub b: [f64; N],
}

impl Normalised<f64> {
    /// The same numbers as constants of another scalar.
    #[must_use]
    pub fn lift<S: Scalar>(&self) -> Normalised<S> {
        Normalised {
            c: self.c.map(S::constant),
            w2: S::constant(self.w2),
            viscous: S::constant(self.viscous),
            coulomb: S::constant(self.coulomb),
        }
    }
}

impl Elasticity<f64> {
    /// The same numbers as constants of another scalar.
    #[must_use]
    pub fn lift<S: Scalar>(&self) -> Elasticity<S> {
        Elasticity {
            stiffness_nm_rad: S::constant(self.stiffness_nm_rad),
            damping_nm_s_rad: S::constant(self.damping_nm_s_rad),
            rotor_inertia_kg_m2: S::constant(self.rotor_inertia_kg_m2),
            rotor_damping_nm_s_rad: S::constant(self.rotor_damping_nm_s_rad),
        }
    }
}

/// Rigid hip, states `[θs, θw, θ̇s, θ̇w]`. Take [`Normalised::frictionless`] when friction is compensated.
#[must_use]
pub fn rigid(p: &Normalised<f64>, x: &[f64; 4], tau: f64) -> Linear<4> {
    let state: [Dual<5>; 4] = std::array::from_fn(|i| Dual::variable(x[i], i));
    let d = dynamics::derivative(&p.lift(), &state, Dual::variable(tau, 4));
    Linear { a: std::array::from_fn(|i| std::array::from_fn(|j| d[i].d[j])), b: std::array::from_fn(|i| d[i].d[4]) }
}

/// Elastic hip, states `[θs, θw, φ, θ̇s, θ̇w, φ̇]`; `legs` from [`elastic::without_rotor`].
#[must_use]
pub fn elastic_hip(legs: &Normalised<f64>, e: &Elasticity<f64>, x: &[f64; 6], tau: f64) -> Linear<6> {
    let state: [Dual<7>; 6] = std::array::from_fn(|i| Dual::variable(x[i], i));
    let d = elastic::derivative(&legs.lift(), &e.lift(), &state, Dual::variable(tau, 6));
    Linear { a: std::array::from_fn(|i| std::array::from_fn(|j| d[i].d[j])), b: std::array::from_fn(|i| d[i].d[6]) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::riccati::{continuous, discrete, zero_order_hold};
    use crate::model::compass_gait::params::Params;
    use nalgebra::{Matrix1, Matrix4, SMatrix, Vector4};

    fn upright(p: &Params<f64>) -> (Matrix4<f64>, Vector4<f64>) {
        let l = rigid(&p.normalised().frictionless(), &[0.0; 4], 0.0);
        (SMatrix::from_fn(|i, j| l.a[i][j]), SMatrix::from_fn(|i, _| l.b[i]))
    }

    fn both() -> [Params<f64>; 2] {
        [Params::sysid(), Params::sysid().swapped()]
    }

    #[test]
    fn upright_matrices_and_poles_are_as_printed() {
        let a = [[10.714_981, -1.222_658, 9.181_850, -9.132_757], [10.547_454, -1.434_036, 11.691_029, -12.044_155]];
        let b = [[0.203_944, -6.801_977], [-0.109_211, -10.049_029]];
        let poles = [[3.183_120, 2.924_043], [3.127_175, 3.357_964]];
        for (i, p) in both().iter().enumerate() {
            let (ours, input) = upright(p);
            let got = [ours[(2, 0)], ours[(2, 1)], ours[(3, 0)], ours[(3, 1)]];
            for (g, w) in got.iter().zip(a[i]).chain([input[2], input[3]].iter().zip(b[i])) {
                assert!((g - w).abs() < 6e-7, "{g} {w}"); // printed digits
            }
            let eigen = ours.complex_eigenvalues();
            let fastest = eigen.iter().map(|e| e.re).fold(0.0, f64::max);
            let swing = eigen.iter().map(|e| e.im).fold(0.0, f64::max);
            assert!((fastest - poles[i][0]).abs() < 6e-7 && (swing - poles[i][1]).abs() < 6e-7);
        }
    }

    #[test]
    fn lqr_gains_are_as_printed() {
        let slow =
            [[95.456_736, -8.206_190, 29.059_337, -0.960_467], [120.570_830, -10.465_273, 37.595_338, -1.795_003]];
        let fast =
            [[95.014_623, -8.168_550, 28.926_418, -0.958_591], [119.920_818, -10.408_697, 37.394_386, -1.787_753]];
        let (q, r, t) = (Matrix4::from_diagonal(&Vector4::new(100.0, 10.0, 1.0, 0.1)), Matrix1::new(1.0), 1e-3);
        for (i, p) in both().iter().enumerate() {
            let (a, b) = upright(p);
            let (ad, bd) = zero_order_hold(&a, &b, t);
            let gains = [
                (continuous(&a, &b, &q, &r).unwrap().gain, slow[i]),
                (discrete(&ad, &bd, &(q * t), &(r * t)).unwrap().gain, fast[i]),
            ];
            for (gain, printed) in gains {
                for (g, w) in gain.iter().zip(printed) {
                    // Printed digits. One of the 16 is a unit off there: -8.206189035 is printed as -8.206190.
                    assert!((g - w).abs() < 1.0e-6, "{g:.9} {w}");
                }
            }
        }
    }

    #[test]
    fn elastic_modes_are_at_the_frequency_they_were_tuned_to() {
        for p in both() {
            let p = p.normalised().frictionless();
            let e = elastic::tuned(&p, 0.005_422_085, 10.5, 0.02);
            let l = elastic_hip(&elastic::without_rotor(&p, 0.005_422_085), &e, &[0.0; 6], 0.0);
            let a = SMatrix::<f64, 6, 6>::from_fn(|i, j| l.a[i][j]);
            let fastest = a.complex_eigenvalues().iter().map(|e| e.im).fold(0.0, f64::max);
            assert!((fastest / std::f64::consts::TAU - 10.5).abs() < 0.02); // gravity and damping move it a little
        }
    }
}
