//! Symmetric indefinite factorisation `P A Pᵀ = L D Lᵀ` of a small dense matrix, D of 1x1 and 2x2 blocks. RT: no.
//!
//! Source: Bunch and Kaufman 1977, partial pivoting, as LAPACK's `dsytf2` does it. It gives the inertia, which tells an
//! interior-point method whether its step is a descent.

/// (1 + √17)/8: balances the growth of 1x1 against 2x2 pivots.
const ALPHA: f64 = 0.640_388_203_202_208;

/// Positive and negative eigenvalues.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Inertia {
    pub(super) positive: usize,
    pub(super) negative: usize,
    pub(super) zero: usize,
}

impl Inertia {
    pub(super) const fn plus(self, other: Self) -> Self {
        Self {
            positive: self.positive + other.positive,
            negative: self.negative + other.negative,
            zero: self.zero + other.zero,
        }
    }
}

/// A pivot: one row, or this row and the next; with which row the (last) one was exchanged.
#[derive(Clone, Copy, Debug)]
enum Pivot {
    One(usize),
    Two(usize),
    Second,
}

/// A factor, ready to solve.
#[derive(Clone, Debug, Default)]
pub(super) struct Factor {
    n: usize,
    a: Vec<f64>,
    pivots: Vec<Pivot>,
}

impl Factor {
    /// Factors the symmetric matrix of order `n` whose lower triangle stands in `a` (by rows, `n` to a row).
    pub(super) fn compute(&mut self, a: &[f64], n: usize) -> Inertia {
        self.n = n;
        self.a.clear();
        self.a.extend_from_slice(&a[..n * n]);
        self.pivots.clear();
        let mut inertia = Inertia::default();
        let mut k = 0;
        while k < n {
            k += self.eliminate(k, &mut inertia);
        }
        inertia
    }

    /// One pivot from row `k`; how many rows it took.
    fn eliminate(&mut self, k: usize, inertia: &mut Inertia) -> usize {
        let n = self.n;
        let diagonal = self.a[k * n + k].abs();
        let (largest, row) = self.largest_below(k);
        if diagonal.max(largest) <= 1e-300 || !diagonal.is_finite() || !largest.is_finite() {
            inertia.zero += 1;
            self.pivots.push(Pivot::One(k));
            self.a[k * n + k] = 1.0;
            (k + 1..n).for_each(|i| self.a[i * n + k] = 0.0);
            return 1;
        }
        if diagonal >= ALPHA * largest {
            return self.eliminate_one(k, k, inertia);
        }
        let beside = self.largest_of_row(k, row);
        if diagonal * beside >= ALPHA * largest * largest {
            self.eliminate_one(k, k, inertia)
        } else if self.a[row * n + row].abs() >= ALPHA * beside {
            self.eliminate_one(k, row, inertia)
        } else {
            self.eliminate_two(k, row, inertia)
        }
    }

    fn largest_below(&self, k: usize) -> (f64, usize) {
        let mut best = (0.0, k);
        for i in k + 1..self.n {
            let size = self.a[i * self.n + k].abs();
            if size > best.0 || size.is_nan() {
                best = (size, i);
            }
        }
        best
    }

    /// Largest entry of row `r` of the remaining matrix beside its diagonal.
    fn largest_of_row(&self, k: usize, r: usize) -> f64 {
        let n = self.n;
        let left = (k..r).map(|j| self.a[r * n + j].abs());
        let below = (r + 1..n).map(|i| self.a[i * n + r].abs());
        left.chain(below).fold(0.0, f64::max)
    }

    /// Exchanges rows and columns `p < q` of the remaining matrix, whose first row is `k`.
    fn exchange(&mut self, k: usize, p: usize, q: usize) {
        if p == q {
            return;
        }
        let n = self.n;
        for j in k..p {
            self.a.swap(p * n + j, q * n + j);
        }
        self.a.swap(p * n + p, q * n + q);
        for i in p + 1..q {
            self.a.swap(i * n + p, q * n + i);
        }
        for i in q + 1..n {
            self.a.swap(i * n + p, i * n + q);
        }
    }

    fn eliminate_one(&mut self, k: usize, with: usize, inertia: &mut Inertia) -> usize {
        let n = self.n;
        self.exchange(k, k, with);
        self.pivots.push(Pivot::One(with));
        let d = self.a[k * n + k];
        if d > 0.0 {
            inertia.positive += 1;
        } else {
            inertia.negative += 1;
        }
        for i in k + 1..n {
            let l = self.a[i * n + k] / d;
            for j in k + 1..=i {
                self.a[i * n + j] -= l * self.a[j * n + k];
            }
        }
        for i in k + 1..n {
            self.a[i * n + k] /= d;
        }
        1
    }

    fn eliminate_two(&mut self, k: usize, with: usize, inertia: &mut Inertia) -> usize {
        let n = self.n;
        self.exchange(k, k + 1, with);
        self.pivots.push(Pivot::Two(with));
        self.pivots.push(Pivot::Second);
        // A 2x2 pivot is only chosen when it is indefinite.
        inertia.positive += 1;
        inertia.negative += 1;
        let (p, q, r) = (self.a[k * n + k], self.a[(k + 1) * n + k], self.a[(k + 1) * n + k + 1]);
        let det = p * r - q * q;
        for i in k + 2..n {
            let (x, y) = (self.a[i * n + k], self.a[i * n + k + 1]);
            let (l, m) = ((r * x - q * y) / det, (p * y - q * x) / det);
            for j in k + 2..=i {
                // Columns k, k+1 of rows below i are still A's; of rows above they are L already: keep both apart.
                let (u, v) = if j == i { (x, y) } else { self.unscaled(k, j, p, q, r) };
                self.a[i * n + j] -= l * u + m * v;
            }
            self.a[i * n + k] = l;
            self.a[i * n + k + 1] = m;
        }
        2
    }

    /// Row `j` of A in the pivot's columns, from its row of L: `[u v] = [l m] D`.
    fn unscaled(&self, k: usize, j: usize, p: f64, q: f64, r: f64) -> (f64, f64) {
        let (l, m) = (self.a[j * self.n + k], self.a[j * self.n + k + 1]);
        (l * p + m * q, l * q + m * r)
    }

    /// Solves for `columns` right-hand sides in place; `x` has a row of `columns` numbers per unknown.
    pub(super) fn solve(&self, x: &mut [f64], columns: usize) {
        let n = self.n;
        for k in 0..n {
            match self.pivots[k] {
                Pivot::One(with) => {
                    swap_rows(x, k, with, columns);
                    (k + 1..n).for_each(|i| add_row(x, i, k, -self.a[i * n + k], columns));
                }
                Pivot::Two(with) => {
                    swap_rows(x, k + 1, with, columns);
                    for i in k + 2..n {
                        add_row(x, i, k, -self.a[i * n + k], columns);
                        add_row(x, i, k + 1, -self.a[i * n + k + 1], columns);
                    }
                }
                Pivot::Second => {}
            }
        }
        self.divide(x, columns);
        for k in (0..n).rev() {
            match self.pivots[k] {
                Pivot::One(with) => {
                    (k + 1..n).for_each(|i| add_row(x, k, i, -self.a[i * n + k], columns));
                    swap_rows(x, k, with, columns);
                }
                Pivot::Two(with) => {
                    for i in k + 2..n {
                        add_row(x, k, i, -self.a[i * n + k], columns);
                        add_row(x, k + 1, i, -self.a[i * n + k + 1], columns);
                    }
                    swap_rows(x, k + 1, with, columns);
                }
                Pivot::Second => {}
            }
        }
    }

    fn divide(&self, x: &mut [f64], columns: usize) {
        let n = self.n;
        for k in 0..n {
            match self.pivots[k] {
                Pivot::One(_) => {
                    let inverse = 1.0 / self.a[k * n + k];
                    x[k * columns..(k + 1) * columns].iter_mut().for_each(|x| *x *= inverse);
                }
                Pivot::Two(_) => {
                    let (p, q, r) = (self.a[k * n + k], self.a[(k + 1) * n + k], self.a[(k + 1) * n + k + 1]);
                    let det = p * r - q * q;
                    for c in 0..columns {
                        let (u, v) = (x[k * columns + c], x[(k + 1) * columns + c]);
                        x[k * columns + c] = (r * u - q * v) / det;
                        x[(k + 1) * columns + c] = (p * v - q * u) / det;
                    }
                }
                Pivot::Second => {}
            }
        }
    }
}

fn swap_rows(x: &mut [f64], i: usize, j: usize, columns: usize) {
    if i != j {
        (0..columns).for_each(|c| x.swap(i * columns + c, j * columns + c));
    }
}

/// Row `to` += `factor` row `from`.
fn add_row(x: &mut [f64], to: usize, from: usize, factor: f64, columns: usize) {
    if factor == 0.0 {
        return;
    }
    let (low, high) = x.split_at_mut(to.max(from) * columns);
    let (target, source) = if to < from {
        (&mut low[to * columns..(to + 1) * columns], &high[..columns])
    } else {
        (&mut high[..columns], &low[from * columns..(from + 1) * columns])
    };
    for (t, s) in target.iter_mut().zip(source) {
        *t += factor * s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn solves_and_counts_signs_of_random_saddle_matrices() {
        let mut dice = ChaCha8Rng::seed_from_u64(3);
        for n in 1..14 {
            for round in 0..20 {
                let mut m = DMatrix::<f64>::from_fn(n, n, |_, _| dice.random_range(-1.0..1.0));
                m = &m + m.transpose();
                // Saddles: no diagonal in the second half, as multipliers have it.
                if round % 2 == 0 {
                    (n / 2..n).for_each(|i| (n / 2..n).for_each(|j| m[(i, j)] = if i == j { -1e-9 } else { 0.0 }));
                }
                let eigen = m.clone().symmetric_eigen().eigenvalues;
                if eigen.iter().any(|e| e.abs() < 1e-6) {
                    continue;
                }
                let mut factor = Factor::default();
                let flat: Vec<f64> = (0..n * n).map(|k| m[(k / n, k % n)]).collect();
                let inertia = factor.compute(&flat, n);
                assert_eq!(inertia.positive, eigen.iter().filter(|e| **e > 0.0).count());
                assert_eq!(inertia.negative + inertia.positive, n);
                let x = DMatrix::<f64>::from_fn(n, 3, |_, _| dice.random_range(-1.0..1.0));
                let b = &m * &x;
                let mut flat: Vec<f64> = (0..n * 3).map(|k| b[(k / 3, k % 3)]).collect();
                factor.solve(&mut flat, 3);
                for (k, got) in flat.iter().enumerate() {
                    assert!((got - x[(k / 3, k % 3)]).abs() < 1e-7, "{n}"); // condition up to 1e6
                }
            }
        }
    }
}
