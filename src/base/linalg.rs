//! Small solves over any [`Scalar`], so that derivatives pass through them. RT: yes, no allocation, fixed size.

use super::scalar::Scalar;

/// A square matrix by rows.
pub type Square<S, const N: usize> = [[S; N]; N];

/// `a x = b` for a 2x2 matrix by Cramer's rule; infinite or NaN when `a` is singular.
#[inline]
#[must_use]
pub fn solve2<S: Scalar>(a: &Square<S, 2>, b: [S; 2]) -> [S; 2] {
    let det = a[0][0] * a[1][1] - a[0][1] * a[1][0];
    [(a[1][1] * b[0] - a[0][1] * b[1]) / det, (a[0][0] * b[1] - a[1][0] * b[0]) / det]
}

/// `a x = b` by elimination with row pivots. `None` when a pivot is zero or not finite.
#[must_use]
pub fn solve<S: Scalar, const N: usize>(mut a: Square<S, N>, mut b: [S; N]) -> Option<[S; N]> {
    for k in 0..N {
        let pivot = pivot_row(&a, k);
        a.swap(k, pivot);
        b.swap(k, pivot);
        let p = a[k][k];
        if p.value() == 0.0 || !p.value().is_finite() {
            return None;
        }
        for i in k + 1..N {
            let factor = a[i][k] / p;
            for j in k..N {
                a[i][j] -= factor * a[k][j];
            }
            b[i] -= factor * b[k];
        }
    }
    Some(back_substitute(&a, b))
}

/// Row from `k` on with the largest entry in column `k`.
fn pivot_row<S: Scalar, const N: usize>(a: &Square<S, N>, k: usize) -> usize {
    let mut best = k;
    for i in k + 1..N {
        if a[i][k].value().abs() > a[best][k].value().abs() {
            best = i;
        }
    }
    best
}

/// Solves an upper triangular system.
fn back_substitute<S: Scalar, const N: usize>(a: &Square<S, N>, b: [S; N]) -> [S; N] {
    let mut x = b;
    for i in (0..N).rev() {
        for j in i + 1..N {
            x[i] -= a[i][j] * x[j];
        }
        x[i] /= a[i][i];
    }
    x
}

/// `a x`.
#[inline]
#[must_use]
pub fn times<S: Scalar, const R: usize, const C: usize>(a: &[[S; C]; R], x: &[S; C]) -> [S; R] {
    let mut y = [S::zero(); R];
    for i in 0..R {
        for j in 0..C {
            y[i] += a[i][j] * x[j];
        }
    }
    y
}

/// Scalar product.
#[inline]
#[must_use]
pub fn dot<S: Scalar, const N: usize>(a: &[S; N], b: &[S; N]) -> S {
    let mut sum = S::zero();
    for i in 0..N {
        sum += a[i] * b[i];
    }
    sum
}

/// Scalar product of long rows of numbers, the shorter one's length.
#[must_use]
pub fn inner_product(a: &[f64], b: &[f64]) -> f64 {
    // Eight sums in flight: several times faster than one, and the order is fixed.
    let mut s = [0.0; 8];
    let (eights_a, eights_b) = (a.chunks_exact(8), b.chunks_exact(8));
    let from = a.len().min(b.len()) / 8 * 8;
    let rest: f64 = a[from..].iter().zip(&b[from..]).map(|(x, y)| x * y).sum();
    for (x, y) in eights_a.zip(eights_b) {
        for i in 0..8 {
            s[i] += x[i] * y[i];
        }
    }
    ((s[0] + s[4]) + (s[1] + s[5])) + ((s[2] + s[6]) + (s[3] + s[7])) + rest
}

/// `x + h y`, element by element.
#[inline]
#[must_use]
pub fn add_scaled<S: Scalar, const N: usize>(x: &[S; N], h: S, y: &[S; N]) -> [S; N] {
    let mut out = *x;
    for i in 0..N {
        out[i] += h * y[i];
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::scalar::Dual;

    #[test]
    fn solution_satisfies_the_system_even_when_the_first_pivot_is_zero() {
        let a = [[0.0, 2.0, 1.0], [1.0, -1.0, 0.5], [3.0, 0.2, -1.0]];
        let b = [1.0, -2.0, 0.3];
        let x = solve(a, b).unwrap();
        let back = times(&a, &x);
        for i in 0..3 {
            assert!((back[i] - b[i]).abs() < 1e-14); // rounding
        }
    }

    #[test]
    fn singular_system_has_no_solution() {
        assert!(solve([[1.0, 2.0], [2.0, 4.0]], [1.0, 0.0]).is_none());
    }

    #[test]
    fn cramer_agrees_with_elimination_in_value_and_derivative() {
        let v = |x: f64| Dual::<1>::constant(x);
        let a = [[Dual::variable(3.0, 0), v(0.5)], [v(-1.0), v(2.0)]];
        let (x, y) = (solve2(&a, [v(1.0), v(2.0)]), solve(a, [v(1.0), v(2.0)]).unwrap());
        for i in 0..2 {
            assert!((x[i].v - y[i].v).abs() < 1e-15 && (x[i].d[0] - y[i].d[0]).abs() < 1e-15);
        }
    }
}
