//! The number type of the model: `f64`, or a dual number that carries exact derivatives along.
//!
//! Every equation of [`crate::model`] is written once over [`Scalar`]. Transcendental functions come from `libm`
//! (pure Rust), so that a recording replays to the same bits on another machine, whatever its C library.
//! RT: yes, no allocation.

use std::cmp::Ordering;
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

/// A real number with the functions that the model needs. Comparisons look at the value only.
pub trait Scalar:
    Copy
    + std::fmt::Debug
    + Default
    + PartialOrd
    + Neg<Output = Self>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
    + Div<f64, Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + DivAssign
    + Send
    + Sync
    + 'static
{
    /// A constant: derivative zero.
    fn constant(value: f64) -> Self;
    /// The value without its derivative.
    fn value(self) -> f64;
    /// Sine and cosine of an angle in rad.
    fn sin_cos(self) -> (Self, Self);
    /// Hyperbolic tangent.
    fn tanh(self) -> Self;
    /// Exponential.
    fn exp(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    /// Square root; the derivative at 0 is taken as 0.
    fn sqrt(self) -> Self;
    /// Two-argument arc tangent, `self` being the ordinate.
    fn atan2(self, x: Self) -> Self;

    /// Zero.
    #[inline]
    #[must_use]
    fn zero() -> Self {
        Self::constant(0.0)
    }
    /// One.
    #[inline]
    #[must_use]
    fn one() -> Self {
        Self::constant(1.0)
    }
    /// Sine of an angle in rad.
    #[inline]
    #[must_use]
    fn sin(self) -> Self {
        self.sin_cos().0
    }
    /// Cosine of an angle in rad.
    #[inline]
    #[must_use]
    fn cos(self) -> Self {
        self.sin_cos().1
    }
    /// Absolute value; the derivative at 0 is that of the right side.
    #[inline]
    #[must_use]
    fn abs(self) -> Self {
        if self.value() < 0.0 { -self } else { self }
    }
    /// -1, 0 or 1, a constant.
    #[inline]
    #[must_use]
    fn sign(self) -> f64 {
        let v = self.value();
        if v > 0.0 {
            1.0
        } else if v < 0.0 {
            -1.0
        } else {
            0.0
        }
    }
    /// Square.
    #[inline]
    #[must_use]
    fn square(self) -> Self {
        self * self
    }
    /// `self` held within constant bounds; the derivative is 0 outside.
    #[inline]
    #[must_use]
    fn clamp_to(self, low: f64, high: f64) -> Self {
        if self.value() < low {
            Self::constant(low)
        } else if self.value() > high {
            Self::constant(high)
        } else {
            self
        }
    }
    /// True if the value and all derivatives are finite.
    fn is_finite(self) -> bool;
    /// True if it carries a derivative that is not zero.
    fn is_varied(self) -> bool;
}

impl Scalar for f64 {
    #[inline]
    fn constant(value: f64) -> Self {
        value
    }
    #[inline]
    fn value(self) -> f64 {
        self
    }
    #[inline]
    fn sin_cos(self) -> (Self, Self) {
        libm::sincos(self)
    }
    #[inline]
    fn tanh(self) -> Self {
        libm::tanh(self)
    }
    #[inline]
    fn exp(self) -> Self {
        libm::exp(self)
    }
    #[inline]
    fn ln(self) -> Self {
        libm::log(self)
    }
    #[inline]
    fn sqrt(self) -> Self {
        libm::sqrt(self)
    }
    #[inline]
    fn atan2(self, x: Self) -> Self {
        libm::atan2(self, x)
    }
    #[inline]
    fn is_finite(self) -> bool {
        Self::is_finite(self)
    }
    #[inline]
    fn is_varied(self) -> bool {
        false
    }
}

/// A first-order dual number: a value and its derivatives in `N` directions.
#[derive(Clone, Copy, Debug)]
pub struct Dual<const N: usize> {
    /// The value.
    pub v: f64,
    /// Its derivative in each direction.
    pub d: [f64; N],
}

impl<const N: usize> Dual<N> {
    /// The variable of direction `i`: value `v`, derivative 1 there. Beyond `N` it is a constant.
    #[inline]
    #[must_use]
    pub fn variable(v: f64, i: usize) -> Self {
        let mut d = [0.0; N];
        if let Some(slot) = d.get_mut(i) {
            *slot = 1.0;
        }
        Self { v, d }
    }

    /// `f(self)` by the chain rule, `df` being f' at the value.
    #[inline]
    #[must_use]
    fn chain(self, f: f64, df: f64) -> Self {
        let mut d = self.d;
        for x in &mut d {
            *x *= df;
        }
        Self { v: f, d }
    }

    #[inline]
    fn zip(self, rhs: Self, v: f64, a: f64, b: f64) -> Self {
        let mut d = [0.0; N];
        for i in 0..N {
            d[i] = a * self.d[i] + b * rhs.d[i];
        }
        Self { v, d }
    }
}

impl<const N: usize> Default for Dual<N> {
    #[inline]
    fn default() -> Self {
        Self { v: 0.0, d: [0.0; N] }
    }
}
impl<const N: usize> PartialEq for Dual<N> {
    #[inline]
    fn eq(&self, other: &Self) -> bool {
        self.v == other.v
    }
}
impl<const N: usize> PartialOrd for Dual<N> {
    #[inline]
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        self.v.partial_cmp(&other.v)
    }
}
impl<const N: usize> Neg for Dual<N> {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        self.chain(-self.v, -1.0)
    }
}
impl<const N: usize> Add for Dual<N> {
    type Output = Self;
    #[inline]
    fn add(self, rhs: Self) -> Self {
        self.zip(rhs, self.v + rhs.v, 1.0, 1.0)
    }
}
impl<const N: usize> Sub for Dual<N> {
    type Output = Self;
    #[inline]
    fn sub(self, rhs: Self) -> Self {
        self.zip(rhs, self.v - rhs.v, 1.0, -1.0)
    }
}
impl<const N: usize> Mul for Dual<N> {
    type Output = Self;
    #[inline]
    fn mul(self, rhs: Self) -> Self {
        self.zip(rhs, self.v * rhs.v, rhs.v, self.v)
    }
}
impl<const N: usize> Div for Dual<N> {
    type Output = Self;
    #[inline]
    fn div(self, rhs: Self) -> Self {
        let inv = 1.0 / rhs.v;
        let v = self.v * inv;
        self.zip(rhs, v, inv, -v * inv)
    }
}
impl<const N: usize> Add<f64> for Dual<N> {
    type Output = Self;
    #[inline]
    fn add(self, rhs: f64) -> Self {
        Self { v: self.v + rhs, d: self.d }
    }
}
impl<const N: usize> Sub<f64> for Dual<N> {
    type Output = Self;
    #[inline]
    fn sub(self, rhs: f64) -> Self {
        Self { v: self.v - rhs, d: self.d }
    }
}
impl<const N: usize> Mul<f64> for Dual<N> {
    type Output = Self;
    #[inline]
    fn mul(self, rhs: f64) -> Self {
        self.chain(self.v * rhs, rhs)
    }
}
impl<const N: usize> Div<f64> for Dual<N> {
    type Output = Self;
    #[inline]
    fn div(self, rhs: f64) -> Self {
        self.chain(self.v / rhs, 1.0 / rhs)
    }
}
impl<const N: usize> AddAssign for Dual<N> {
    #[inline]
    fn add_assign(&mut self, rhs: Self) {
        *self = *self + rhs;
    }
}
impl<const N: usize> SubAssign for Dual<N> {
    #[inline]
    fn sub_assign(&mut self, rhs: Self) {
        *self = *self - rhs;
    }
}
impl<const N: usize> MulAssign for Dual<N> {
    #[inline]
    fn mul_assign(&mut self, rhs: Self) {
        *self = *self * rhs;
    }
}
impl<const N: usize> DivAssign for Dual<N> {
    #[inline]
    fn div_assign(&mut self, rhs: Self) {
        *self = *self / rhs;
    }
}

impl<const N: usize> Scalar for Dual<N> {
    #[inline]
    fn constant(value: f64) -> Self {
        Self { v: value, d: [0.0; N] }
    }
    #[inline]
    fn value(self) -> f64 {
        self.v
    }
    #[inline]
    fn sin_cos(self) -> (Self, Self) {
        let (s, c) = libm::sincos(self.v);
        (self.chain(s, c), self.chain(c, -s))
    }
    #[inline]
    fn tanh(self) -> Self {
        let t = libm::tanh(self.v);
        self.chain(t, 1.0 - t * t)
    }
    #[inline]
    fn exp(self) -> Self {
        let e = libm::exp(self.v);
        self.chain(e, e)
    }
    #[inline]
    fn ln(self) -> Self {
        self.chain(libm::log(self.v), 1.0 / self.v)
    }
    #[inline]
    fn sqrt(self) -> Self {
        let r = libm::sqrt(self.v);
        self.chain(r, if r > 0.0 { 0.5 / r } else { 0.0 })
    }
    #[inline]
    fn atan2(self, x: Self) -> Self {
        let n = self.v * self.v + x.v * x.v;
        self.zip(x, libm::atan2(self.v, x.v), x.v / n, -self.v / n)
    }
    #[inline]
    fn is_finite(self) -> bool {
        self.v.is_finite() && self.d.iter().all(|x| x.is_finite())
    }
    #[inline]
    fn is_varied(self) -> bool {
        self.d.iter().any(|x| x.abs() > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use num_dual::{Dual64, DualNum};

    fn ours<S: Scalar>(x: S) -> S {
        ((x.sin() * x.exp() + x.cos() / (x.square() + 1.0)).tanh() + x.abs().sqrt()).atan2(x + 2.0) - x.square().ln()
    }

    #[test]
    fn derivatives_agree_with_num_dual() {
        for x in [-1.3, -0.2, 0.4, 1.7] {
            let y = ours(Dual::<1>::variable(x, 0));
            let z = Dual64::new(x, 1.0);
            let root = if x < 0.0 { (-z).sqrt() } else { z.sqrt() };
            let num = (z.sin() * z.exp() + z.cos() / (z * z + 1.0)).tanh() + root;
            let den = z + 2.0;
            // atan2 has no counterpart there: den > 0 here, so atan serves.
            let r = (num / den).atan() - (z * z).ln();
            assert!((y.v - r.re).abs() < 1e-14, "value at {x}");
            assert!((y.d[0] - r.eps).abs() < 1e-12 * r.eps.abs().max(1.0), "derivative at {x}"); // rounding
        }
    }

    #[test]
    fn plain_numbers_and_duals_agree_to_the_bit() {
        for x in [-1.3, 0.4, 1.7] {
            assert_eq!(ours(x).to_bits(), ours(Dual::<3>::constant(x)).v.to_bits());
        }
    }
}
