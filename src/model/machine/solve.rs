//! `M a = f` under constraints, for the few coordinates of a machine. RT: yes, no allocation.

use crate::base::scalar::Scalar;
use crate::model::mechanism::MAX;

/// Most constraints at once: three axes, two rotors, two of the foot, two toes.
pub(super) const MAX_CONSTRAINTS: usize = 9;

/// L D Lᵀ of a symmetric positive matrix: `l` below the diagonal, `inverse` of D; of some of its rows and columns.
#[derive(Clone, Debug)]
pub(super) struct Factor<S> {
    l: [[S; MAX]; MAX],
    inverse: [S; MAX],
    rows: [usize; MAX],
    len: usize,
}

impl<S: Scalar> Default for Factor<S> {
    fn default() -> Self {
        Self { l: [[S::zero(); MAX]; MAX], inverse: [S::zero(); MAX], rows: [0; MAX], len: 0 }
    }
}

impl<S: Scalar> Factor<S> {
    /// Factors `rows` (and columns) of `m`.
    #[inline]
    pub(super) fn factor(&mut self, m: &[[S; MAX]; MAX], rows: impl Iterator<Item = usize>) {
        self.len = 0;
        for (slot, row) in self.rows.iter_mut().zip(rows) {
            *slot = row;
            self.len += 1;
        }
        for j in 0..self.len {
            let mut d = m[self.rows[j]][self.rows[j]];
            for k in 0..j {
                // l holds L·D here until the row is finished.
                let lkd = self.l[j][k];
                let lk = lkd * self.inverse[k];
                d -= lk * lkd;
                self.l[j][k] = lk;
            }
            self.inverse[j] = S::one() / d;
            for i in j + 1..self.len {
                let mut x = m[self.rows[i]][self.rows[j]];
                for k in 0..j {
                    x -= self.l[i][k] * self.l[j][k];
                }
                self.l[i][j] = x;
            }
        }
    }

    /// Solves in place; the other rows of `x` stay as they are.
    #[inline]
    pub(super) fn solve(&self, x: &mut [S; MAX]) {
        let (rows, n) = (&self.rows, self.len);
        for i in 1..n {
            for k in 0..i {
                let below = self.l[i][k] * x[rows[k]];
                x[rows[i]] -= below;
            }
        }
        for i in 0..n {
            x[rows[i]] *= self.inverse[i];
        }
        for i in (0..n).rev() {
            for k in i + 1..n {
                let above = self.l[k][i] * x[rows[k]];
                x[rows[i]] -= above;
            }
        }
    }
}

/// `a x = b` for the first `n` rows by elimination with row pivots; a zero pivot gives infinities, which the caller's
/// check of finite states finds.
pub(super) fn solve_small<S: Scalar>(
    a: &mut [[S; MAX_CONSTRAINTS]; MAX_CONSTRAINTS],
    b: &mut [S; MAX_CONSTRAINTS],
    n: usize,
) {
    for k in 0..n {
        let mut pivot = k;
        for i in k + 1..n {
            if a[i][k].value().abs() > a[pivot][k].value().abs() {
                pivot = i;
            }
        }
        a.swap(k, pivot);
        b.swap(k, pivot);
        for i in k + 1..n {
            let factor = a[i][k] / a[k][k];
            for j in k..n {
                a[i][j] -= factor * a[k][j];
            }
            b[i] -= factor * b[k];
        }
    }
    for i in (0..n).rev() {
        for j in i + 1..n {
            b[i] -= a[i][j] * b[j];
        }
        b[i] /= a[i][i];
    }
}
