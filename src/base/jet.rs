//! Second-order numbers: a value with its exact gradient and Hessian. RT: yes, no allocation.
//!
//! [`super::scalar::Dual`] carried one order further, for optimisers that want the Hessian of a Lagrangian. The Hessian
//! is kept as its lower triangle by rows: `N (N + 1) / 2` numbers, which the type names as `H`.

use super::scalar::Scalar;
use std::cmp::Ordering;
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

/// A value, its derivatives in `N` directions and its `H = N (N + 1) / 2` second derivatives.
#[derive(Clone, Copy, Debug)]
pub struct Jet<const N: usize, const H: usize> {
    /// The value.
    pub v: f64,
    /// Gradient.
    pub d: [f64; N],
    /// Lower triangle of the Hessian by rows: (0,0), (1,0), (1,1), (2,0), ...
    pub h: [f64; H],
}

impl<const N: usize, const H: usize> Jet<N, H> {
    const SIZED: () = assert!(H == N * (N + 1) / 2, "H must be N (N + 1) / 2");

    /// The variable of direction `i`.
    #[inline]
    #[must_use]
    pub fn variable(v: f64, i: usize) -> Self {
        let () = Self::SIZED;
        let mut out = Self { v, d: [0.0; N], h: [0.0; H] };
        if let Some(slot) = out.d.get_mut(i) {
            *slot = 1.0;
        }
        out
    }

    /// The variables of a point.
    #[inline]
    #[must_use]
    pub fn point(x: &[f64; N]) -> [Self; N] {
        std::array::from_fn(|i| Self::variable(x[i], i))
    }

    /// The Hessian as a full matrix.
    #[must_use]
    pub fn hessian(&self) -> [[f64; N]; N] {
        std::array::from_fn(|i| std::array::from_fn(|j| self.h[triangle(i.max(j)) + i.min(j)]))
    }

    /// `f(self)` by the chain rule, with f' and f'' at the value.
    #[inline]
    fn chain(&self, f: f64, df: f64, ddf: f64) -> Self {
        let mut out = Self { v: f, d: self.d, h: self.h };
        let mut k = 0;
        for i in 0..N {
            let scaled = ddf * self.d[i];
            for j in 0..=i {
                out.h[k] = df * self.h[k] + scaled * self.d[j];
                k += 1;
            }
            out.d[i] *= df;
        }
        out
    }

    /// `a self + b rhs` in all derivatives, the value given.
    #[inline]
    fn blend(&self, rhs: &Self, v: f64, a: f64, b: f64) -> Self {
        let mut out = Self { v, d: [0.0; N], h: [0.0; H] };
        for i in 0..N {
            out.d[i] = a * self.d[i] + b * rhs.d[i];
        }
        for k in 0..H {
            out.h[k] = a * self.h[k] + b * rhs.h[k];
        }
        out
    }

    #[inline]
    fn scale(&self, by: f64) -> Self {
        let mut out = *self;
        out.v *= by;
        out.d.iter_mut().for_each(|x| *x *= by);
        out.h.iter_mut().for_each(|x| *x *= by);
        out
    }
}

const fn triangle(i: usize) -> usize {
    i * (i + 1) / 2
}

impl<const N: usize, const H: usize> Default for Jet<N, H> {
    fn default() -> Self {
        Self { v: 0.0, d: [0.0; N], h: [0.0; H] }
    }
}
impl<const N: usize, const H: usize> PartialEq for Jet<N, H> {
    fn eq(&self, other: &Self) -> bool {
        self.v == other.v
    }
}
impl<const N: usize, const H: usize> PartialOrd for Jet<N, H> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        self.v.partial_cmp(&other.v)
    }
}
impl<const N: usize, const H: usize> Neg for Jet<N, H> {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        self.scale(-1.0)
    }
}
impl<const N: usize, const H: usize> Add for Jet<N, H> {
    type Output = Self;
    #[inline]
    fn add(mut self, rhs: Self) -> Self {
        self += rhs;
        self
    }
}
impl<const N: usize, const H: usize> Sub for Jet<N, H> {
    type Output = Self;
    #[inline]
    fn sub(mut self, rhs: Self) -> Self {
        self -= rhs;
        self
    }
}
impl<const N: usize, const H: usize> Mul for Jet<N, H> {
    type Output = Self;
    #[inline]
    fn mul(self, rhs: Self) -> Self {
        let mut out = self.blend(&rhs, self.v * rhs.v, rhs.v, self.v);
        let mut k = 0;
        for i in 0..N {
            for j in 0..=i {
                out.h[k] += self.d[i] * rhs.d[j] + rhs.d[i] * self.d[j];
                k += 1;
            }
        }
        out
    }
}
impl<const N: usize, const H: usize> Div for Jet<N, H> {
    type Output = Self;
    #[inline]
    fn div(self, rhs: Self) -> Self {
        let inverse = 1.0 / rhs.v;
        let square = inverse * inverse;
        self * rhs.chain(inverse, -square, 2.0 * square * inverse)
    }
}
impl<const N: usize, const H: usize> Add<f64> for Jet<N, H> {
    type Output = Self;
    #[inline]
    fn add(mut self, rhs: f64) -> Self {
        self.v += rhs;
        self
    }
}
impl<const N: usize, const H: usize> Sub<f64> for Jet<N, H> {
    type Output = Self;
    #[inline]
    fn sub(mut self, rhs: f64) -> Self {
        self.v -= rhs;
        self
    }
}
impl<const N: usize, const H: usize> Mul<f64> for Jet<N, H> {
    type Output = Self;
    #[inline]
    fn mul(self, rhs: f64) -> Self {
        self.scale(rhs)
    }
}
impl<const N: usize, const H: usize> Div<f64> for Jet<N, H> {
    type Output = Self;
    #[inline]
    fn div(self, rhs: f64) -> Self {
        let mut out = self.scale(1.0 / rhs);
        out.v = self.v / rhs;
        out
    }
}
impl<const N: usize, const H: usize> AddAssign for Jet<N, H> {
    #[inline]
    fn add_assign(&mut self, rhs: Self) {
        self.v += rhs.v;
        for i in 0..N {
            self.d[i] += rhs.d[i];
        }
        for k in 0..H {
            self.h[k] += rhs.h[k];
        }
    }
}
impl<const N: usize, const H: usize> SubAssign for Jet<N, H> {
    #[inline]
    fn sub_assign(&mut self, rhs: Self) {
        self.v -= rhs.v;
        for i in 0..N {
            self.d[i] -= rhs.d[i];
        }
        for k in 0..H {
            self.h[k] -= rhs.h[k];
        }
    }
}
impl<const N: usize, const H: usize> MulAssign for Jet<N, H> {
    #[inline]
    fn mul_assign(&mut self, rhs: Self) {
        *self = *self * rhs;
    }
}
impl<const N: usize, const H: usize> DivAssign for Jet<N, H> {
    #[inline]
    fn div_assign(&mut self, rhs: Self) {
        *self = *self / rhs;
    }
}

impl<const N: usize, const H: usize> Scalar for Jet<N, H> {
    fn constant(value: f64) -> Self {
        Self { v: value, d: [0.0; N], h: [0.0; H] }
    }
    fn value(self) -> f64 {
        self.v
    }
    fn sin_cos(self) -> (Self, Self) {
        let (s, c) = libm::sincos(self.v);
        (self.chain(s, c, -s), self.chain(c, -s, -c))
    }
    fn tanh(self) -> Self {
        let t = libm::tanh(self.v);
        let slope = 1.0 - t * t;
        self.chain(t, slope, -2.0 * t * slope)
    }
    fn exp(self) -> Self {
        let e = libm::exp(self.v);
        self.chain(e, e, e)
    }
    fn ln(self) -> Self {
        let inverse = 1.0 / self.v;
        self.chain(libm::log(self.v), inverse, -inverse * inverse)
    }
    fn sqrt(self) -> Self {
        let r = libm::sqrt(self.v);
        if r > 0.0 { self.chain(r, 0.5 / r, -0.25 / (r * self.v)) } else { Self::constant(r) }
    }
    fn atan2(self, x: Self) -> Self {
        // With r² = x² + y²: gradient (x dy - y dx)/r², and its derivative by the quotient rule.
        let n = self.v * self.v + x.v * x.v;
        let (gy, gx) = (x.v / n, -self.v / n);
        let (yy, xy, xx) = (-2.0 * gx * -gy, (self.v * self.v - x.v * x.v) / (n * n), 2.0 * gx * -gy);
        let mut out = self.blend(&x, libm::atan2(self.v, x.v), gy, gx);
        let mut k = 0;
        for i in 0..N {
            for j in 0..=i {
                let cross = self.d[i] * x.d[j] + x.d[i] * self.d[j];
                out.h[k] += yy * self.d[i] * self.d[j] + xy * cross + xx * x.d[i] * x.d[j];
                k += 1;
            }
        }
        out
    }
    fn is_finite(self) -> bool {
        self.v.is_finite() && self.d.iter().chain(&self.h).all(|x| x.is_finite())
    }
    fn is_varied(self) -> bool {
        self.d.iter().chain(&self.h).any(|x| x.abs() > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::scalar::Dual;

    fn expression<S: Scalar>(x: &[S; 3]) -> S {
        let [a, b, c] = *x;
        let ratio = (a.sin() * b.exp() + c.cos()) / (a.square() + b * c + 3.0);
        (ratio * 2.0 - a).tanh() + (a.square() + 1.0).sqrt() * c.atan2(b + 2.0) - (b.square() + 0.5).ln() / 3.0
    }

    #[test]
    fn gradient_is_that_of_first_order_duals_and_hessian_its_difference() {
        let (x, step) = ([0.3, -0.8, 1.1], 1e-5);
        let jet = expression(&Jet::<3, 6>::point(&x));
        let dual = |x: &[f64; 3]| expression(&std::array::from_fn::<Dual<3>, 3, _>(|i| Dual::variable(x[i], i)));
        assert!((jet.v - expression(&x)).abs() < 1e-15);
        let hessian = jet.hessian();
        for i in 0..3 {
            assert!((jet.d[i] - dual(&x).d[i]).abs() < 1e-14);
            let (mut up, mut down) = (x, x);
            up[i] += step;
            down[i] -= step;
            for j in 0..3 {
                let difference = (dual(&up).d[j] - dual(&down).d[j]) / (2.0 * step);
                assert!((hessian[i][j] - difference).abs() < 1e-9, "{i} {j}"); // central difference
            }
        }
    }
}
