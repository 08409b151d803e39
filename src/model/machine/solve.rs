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
        match self.len {
            1 => self.factor_rows::<1>(m, 1),
            2 => self.factor_rows::<2>(m, 2),
            3 => self.factor_rows::<3>(m, 3),
            4 => self.factor_rows::<4>(m, 4),
            5 => self.factor_rows::<5>(m, 5),
            len => self.factor_rows::<MAX>(m, len),
        }
    }

    /// `len` is `N`, known to the compiler, or less: the same operations in the same order.
    #[inline]
    fn factor_rows<const N: usize>(&mut self, m: &[[S; MAX]; MAX], len: usize) {
        let len = len.min(N);
        for j in 0..len {
            let row = self.rows[j];
            let mut d = m[row][row];
            for k in 0..j {
                // l holds L·D here until the row is finished.
                let lkd = self.l[j][k];
                let lk = lkd * self.inverse[k];
                d -= lk * lkd;
                self.l[j][k] = lk;
            }
            self.inverse[j] = S::one() / d;
            for i in j + 1..len {
                let mut x = m[self.rows[i]][row];
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
        match self.len {
            1 => self.solve_rows::<1>(x, 1),
            2 => self.solve_rows::<2>(x, 2),
            3 => self.solve_rows::<3>(x, 3),
            4 => self.solve_rows::<4>(x, 4),
            5 => self.solve_rows::<5>(x, 5),
            len => self.solve_rows::<MAX>(x, len),
        }
    }

    /// Of the rows that were factored, gathered once: looked up in every product they cost more than the products.
    #[inline]
    fn solve_rows<const N: usize>(&self, x: &mut [S; MAX], len: usize) {
        let len = len.min(N);
        let mut y = [S::zero(); N];
        for i in 0..len {
            y[i] = x[self.rows[i]];
        }
        for i in 1..len {
            for k in 0..i {
                let below = self.l[i][k] * y[k];
                y[i] -= below;
            }
        }
        for i in 0..len {
            y[i] *= self.inverse[i];
        }
        for i in (0..len).rev() {
            for k in i + 1..len {
                let above = self.l[k][i] * y[k];
                y[i] -= above;
            }
        }
        for i in 0..len {
            x[self.rows[i]] = y[i];
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
        if pivot != k {
            a.swap(k, pivot);
            b.swap(k, pivot);
        }
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
