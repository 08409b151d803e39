//! Algebraic Riccati equations of fixed size by structure-preserving doubling. RT: before arming only (bounded loops).
//!
//! Preconditions: `(A, B)` stabilisable, `(A, Q)` detectable, `Q ≥ 0`, `R > 0`. Mind the factor: the cost is
//! `∫ xᵀQx + uᵀRu`, without a half.
//!
//! Doubling (Chu, Fan, Lin 2005 for CARE; Chu, Fan, Lin, Wang 2004 for DARE) needs only N x N solves, so it fits
//! fixed-size types, where the Hamiltonian's Schur form would need 2N. It squares the closed loop in each round, hence
//! converges in about log2(1/(slowest decay)) rounds.

use nalgebra::SMatrix;

/// Rounds allowed: 2^40 periods of the slowest closed-loop mode.
const ROUNDS: usize = 40;
/// Newton steps after the doubling, which alone leaves 1e-7 of relative error where open loops are fast.
const REFINEMENTS: usize = 3;
/// Largest residual, relative to the terms of the equation, that counts as solved.
const RESIDUAL: f64 = 1e-10;

/// Cost-to-go and gain.
#[derive(Clone, Copy, Debug)]
pub struct Solution<const N: usize, const M: usize> {
    /// Cost-to-go S: `xᵀ S x`.
    pub cost: SMatrix<f64, N, N>,
    /// Gain K: `u = -K x`.
    pub gain: SMatrix<f64, M, N>,
}

/// Why there is no solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RiccatiError {
    /// A matrix that must be invertible is not (R, or a step of the doubling).
    #[error("a matrix of the Riccati equation is singular: is R positive and (A, B) stabilisable?")]
    Singular,
    /// The rounds ran out, or the result does not satisfy the equation.
    #[error("the Riccati equation has no stabilising solution: is (A, B) stabilisable and (A, Q) detectable?")]
    NoSolution,
}

/// Iterate of the doubling: after k rounds `cost` is the cost of a horizon of 2^k periods.
struct Doubling<const N: usize> {
    transition: SMatrix<f64, N, N>,
    reach: SMatrix<f64, N, N>,
    cost: SMatrix<f64, N, N>,
}

impl<const N: usize> Doubling<N> {
    fn round(&self) -> Option<Self> {
        let (a, g, h) = (&self.transition, &self.reach, &self.cost);
        let inverse = (SMatrix::identity() + g * h).try_inverse()?;
        let reach = g + a * inverse * g * a.transpose();
        let cost = h + a.transpose() * h * inverse * a;
        Some(Self { transition: a * inverse * a, reach: symmetric(&reach), cost: symmetric(&cost) })
    }

    fn settle(mut self) -> Result<SMatrix<f64, N, N>, RiccatiError> {
        for _ in 0..ROUNDS {
            let next = self.round().ok_or(RiccatiError::Singular)?;
            let change = (next.cost - self.cost).norm();
            let scale = next.cost.norm();
            self = next;
            if !scale.is_finite() {
                return Err(RiccatiError::NoSolution);
            }
            if change <= 1e-15 * scale {
                return Ok(self.cost);
            }
        }
        // The last digits may flicker for ever; the residual decides.
        Ok(self.cost)
    }
}

fn symmetric<const N: usize>(m: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    (m + m.transpose()) * 0.5
}

/// Continuous time: `AᵀS + SA - S B R⁻¹ Bᵀ S + Q = 0`, `K = R⁻¹ Bᵀ S`.
///
/// # Errors
/// [`RiccatiError`] when the preconditions do not hold.
pub fn continuous<const N: usize, const M: usize>(
    a: &SMatrix<f64, N, N>,
    b: &SMatrix<f64, N, M>,
    q: &SMatrix<f64, N, N>,
    r: &SMatrix<f64, M, M>,
) -> Result<Solution<N, M>, RiccatiError> {
    let r_inverse = r.try_inverse().ok_or(RiccatiError::Singular)?;
    let g = b * r_inverse * b.transpose();
    let mut cost = cayley(a, &g, q).ok_or(RiccatiError::Singular)?.settle()?;
    for _ in 0..REFINEMENTS {
        cost += lyapunov(&(a - g * cost), &continuous_residual(a, &g, q, &cost)).ok_or(RiccatiError::Singular)?;
    }
    let scale = 2.0 * (a.transpose() * cost).norm() + (cost * g * cost).norm() + q.norm();
    accept(&continuous_residual(a, &g, q, &cost), scale)?;
    Ok(Solution { cost, gain: r_inverse * b.transpose() * cost })
}

fn continuous_residual<const N: usize>(
    a: &SMatrix<f64, N, N>,
    g: &SMatrix<f64, N, N>,
    q: &SMatrix<f64, N, N>,
    s: &SMatrix<f64, N, N>,
) -> SMatrix<f64, N, N> {
    a.transpose() * s + s * a - s * g * s + q
}

/// X of `AᵀX + XA + Q = 0` for a stable A, by way of the discrete equation.
fn lyapunov<const N: usize>(a: &SMatrix<f64, N, N>, q: &SMatrix<f64, N, N>) -> Option<SMatrix<f64, N, N>> {
    let shift = a.norm();
    let inverse = (SMatrix::identity() * shift - a).try_inverse()?;
    let transition = inverse * (SMatrix::identity() * shift + a);
    Some(stein(transition, inverse.transpose() * q * inverse * (2.0 * shift)))
}

/// X of `X = AᵀXA + Q` for a stable A, by squaring.
fn stein<const N: usize>(mut a: SMatrix<f64, N, N>, q: SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    let mut x = q;
    for _ in 0..ROUNDS {
        x += a.transpose() * x * a;
        a *= a;
    }
    symmetric(&x)
}

/// The Cayley transform that makes a continuous problem a discrete one with the same solution.
fn cayley<const N: usize>(
    a: &SMatrix<f64, N, N>,
    g: &SMatrix<f64, N, N>,
    q: &SMatrix<f64, N, N>,
) -> Option<Doubling<N>> {
    // Any shift beyond the spectrum works; twice the norm keeps A - γI far from singular.
    let shift = 2.0 * a.norm().max(1.0);
    let inverse = (a - SMatrix::identity() * shift).try_inverse()?;
    let w = (a - SMatrix::identity() * shift).transpose() + q * inverse * g;
    let w_inverse = w.try_inverse()?;
    Some(Doubling {
        transition: SMatrix::identity() + w_inverse.transpose() * (2.0 * shift),
        reach: symmetric(&(inverse * g * w_inverse * (2.0 * shift))),
        cost: symmetric(&(w_inverse * q * inverse * (2.0 * shift))),
    })
}

/// Discrete time: `S = AᵀSA - AᵀSB (R + BᵀSB)⁻¹ BᵀSA + Q`, `K = (R + BᵀSB)⁻¹ BᵀSA`.
///
/// # Errors
/// [`RiccatiError`] when the preconditions do not hold.
pub fn discrete<const N: usize, const M: usize>(
    a: &SMatrix<f64, N, N>,
    b: &SMatrix<f64, N, M>,
    q: &SMatrix<f64, N, N>,
    r: &SMatrix<f64, M, M>,
) -> Result<Solution<N, M>, RiccatiError> {
    let r_inverse = r.try_inverse().ok_or(RiccatiError::Singular)?;
    let start = Doubling { transition: *a, reach: b * r_inverse * b.transpose(), cost: *q };
    let mut cost = start.settle()?;
    let gain = |s: &SMatrix<f64, N, N>| {
        let inner = (r + b.transpose() * s * b).try_inverse().ok_or(RiccatiError::Singular)?;
        Ok(inner * b.transpose() * s * a)
    };
    let residual = |s: &SMatrix<f64, N, N>, k: &SMatrix<f64, M, N>| a.transpose() * s * (a - b * k) + q - s;
    for _ in 0..REFINEMENTS {
        let k = gain(&cost)?;
        cost += stein(a - b * k, symmetric(&residual(&cost, &k)));
    }
    let gain = gain(&cost)?;
    accept(&residual(&cost, &gain), (a.transpose() * cost * a).norm() + cost.norm() + q.norm())?;
    Ok(Solution { cost, gain })
}

fn accept<const N: usize>(residual: &SMatrix<f64, N, N>, scale: f64) -> Result<(), RiccatiError> {
    let relative = residual.norm() / scale;
    if relative.is_finite() && relative < RESIDUAL { Ok(()) } else { Err(RiccatiError::NoSolution) }
}

/// Zero-order hold over `period_s`: `x⁺ = A_d x + B_d u` by the series of the exponential, scaled and squared.
#[must_use]
pub fn zero_order_hold<const N: usize, const M: usize>(
    a: &SMatrix<f64, N, N>,
    b: &SMatrix<f64, N, M>,
    period_s: f64,
) -> (SMatrix<f64, N, N>, SMatrix<f64, N, M>) {
    let mut halvings = 0;
    while a.norm() * period_s / f64::from(1u32 << halvings) > 0.1 && halvings < 30 {
        halvings += 1;
    }
    let h = period_s / f64::from(1u32 << halvings);
    // Φ = Σ (Ah)^k/k!, Γ = h Σ (Ah)^k/(k+1)!; 12 terms of norm 0.1 reach rounding.
    let (mut phi, mut gamma) = (SMatrix::identity(), SMatrix::identity() * h);
    let mut term = SMatrix::<f64, N, N>::identity();
    for k in 1..=12 {
        term = term * a * (h / f64::from(k));
        phi += term;
        gamma += term * (h / f64::from(k + 1));
    }
    for _ in 0..halvings {
        gamma += phi * gamma;
        phi *= phi;
    }
    (phi, gamma * b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix1, Matrix2, SMatrix, Vector2, matrix, vector};

    #[test]
    fn scalar_equations_meet_their_closed_forms() {
        let one = |x| Matrix1::new(x);
        for (a, b, q, r) in [(1.5, 0.7, 2.0, 0.3), (-0.4, 1.0, 1.0, 5.0), (0.0, 2.0, 1.0, 1.0)] {
            let s = continuous(&one(a), &one(b), &one(q), &one(r)).unwrap();
            let g: f64 = b * b / r;
            let exact = (a + (a * a + g * q).sqrt()) / g;
            assert!((s.cost[0] - exact).abs() < 1e-12 * exact);
            // Discrete: g s² + (1 - a² - g q) s - q = 0.
            let s = discrete(&one(a), &one(b), &one(q), &one(r)).unwrap();
            let half = (1.0 - a * a - g * q) / 2.0;
            let exact = (-half + (half * half + g * q).sqrt()) / g;
            assert!((s.cost[0] - exact).abs() < 1e-12 * exact);
        }
    }

    #[test]
    fn double_integrator_has_the_textbook_gain() {
        let (a, b) = (matrix![0.0, 1.0; 0.0, 0.0], Vector2::new(0.0, 1.0));
        let s = continuous(&a, &b, &Matrix2::identity(), &Matrix1::new(1.0)).unwrap();
        assert!((s.gain[0] - 1.0).abs() < 1e-12 && (s.gain[1] - 3.0_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn fast_sampling_meets_continuous_time() {
        let (a, b) = (matrix![0.0, 1.0; 9.0, -0.3], Vector2::new(0.0, 2.0));
        let (q, r) = (matrix![3.0, 0.2; 0.2, 1.0], Matrix1::new(0.7));
        let exact = continuous(&a, &b, &q, &r).unwrap().gain;
        let gap = |h: f64| {
            let (ad, bd) = zero_order_hold(&a, &b, h);
            (discrete(&ad, &bd, &(q * h), &(r * h)).unwrap().gain - exact).norm()
        };
        assert!(gap(1e-3) < 0.02 && gap(1e-4) < 0.11 * gap(1e-3));
    }

    #[test]
    fn closed_loop_is_stable_and_the_residual_small_on_awkward_problems() {
        // Slow, fast, unstable and oscillating modes together, weak input.
        let a = matrix![0.01, 1.0, 0.0, 0.0; 0.0, 4.0, 1.0, 0.0; 0.0, 0.0, -0.5, 60.0; 0.0, 0.0, -60.0, -0.5];
        let b = vector![0.0, 0.1, 0.0, 2.0];
        let s = continuous(&a, &b, &SMatrix::identity(), &Matrix1::new(0.01)).unwrap();
        let closed = a - b * s.gain;
        assert!(closed.complex_eigenvalues().iter().all(|e| e.re < 0.0));
        assert!(s.cost.symmetric_eigenvalues().iter().all(|e| *e > 0.0));
    }

    #[test]
    fn what_cannot_be_stabilised_is_refused() {
        let a = matrix![1.0, 0.0; 0.0, -1.0];
        let b = Vector2::new(0.0, 1.0);
        assert!(continuous(&a, &b, &Matrix2::identity(), &Matrix1::new(1.0)).is_err());
        let (a, b) = zero_order_hold(&a, &b, 0.1);
        assert!(discrete(&a, &b, &Matrix2::identity(), &Matrix1::new(1.0)).is_err());
        assert!(discrete(&a, &b, &Matrix2::identity(), &Matrix1::new(0.0)).is_err());
    }

    #[test]
    fn zero_order_hold_is_the_exponential() {
        let a = matrix![0.0, 3.0; -3.0, 0.0];
        let (phi, gamma) = zero_order_hold(&a, &Vector2::new(1.0, 0.0), 2.5);
        let (s, c) = libm::sincos(7.5);
        assert!((phi - matrix![c, s; -s, c]).norm() < 1e-13);
        assert!((gamma - vector![s / 3.0, (c - 1.0) / 3.0]).norm() < 1e-13);
    }
}
