//! Factorisation of a symmetric indefinite matrix whose blocks form a chain with a border. RT: no.
//!
//! ```text
//!   A0 C1ᵀ          B0ᵀ
//!   C1 A1 C2ᵀ       B1ᵀ      A: unknowns and multipliers of one stage, dense
//!      C2 A2  ..    B2ᵀ      C: reaches into the five carried unknowns (state, input) of the stage before only
//!         ..  ..    ..       B: parameters of the whole problem (durations, the orbit's state)
//!   B0 B1 B2  ..    D
//! ```
//! The stages are eliminated in order of time, each with pivots of its own. A stage's state stands beside the
//! multipliers of the equations that produce it, so its block is regular even where the Hessian is not.

use super::dense::{Factor, Inertia};

/// Unknowns that a stage hands on: four states and the input.
pub const CARRY: usize = 5;

/// One stage.
#[derive(Clone, Debug, Default)]
pub struct Block {
    /// Unknowns of the stage.
    pub m: usize,
    /// Place of the carried unknowns.
    pub carry: usize,
    /// `m` x `m`, lower triangle used.
    pub a: Vec<f64>,
    /// `m` x [`CARRY`]: coupling with the carried unknowns of the stage before.
    pub c: Vec<f64>,
    /// `m` x border.
    pub b: Vec<f64>,
}

impl Block {
    /// Zeros.
    #[must_use]
    pub fn new(m: usize, carry: usize, border: usize) -> Self {
        Self { m, carry, a: vec![0.0; m * m], c: vec![0.0; m * CARRY], b: vec![0.0; m * border] }
    }

    pub(super) fn copy_from(&mut self, other: &Self) {
        self.a.copy_from_slice(&other.a);
        self.c.copy_from_slice(&other.c);
        self.b.copy_from_slice(&other.b);
    }

    /// Sets everything to zero.
    pub fn clear(&mut self) {
        self.a.fill(0.0);
        self.c.fill(0.0);
        self.b.fill(0.0);
    }
}

/// The matrix.
#[derive(Clone, Debug, Default)]
pub struct Bordered {
    /// Stages in order of time.
    pub blocks: Vec<Block>,
    /// Size of the border.
    pub border: usize,
    /// Border x border, lower triangle used.
    pub corner: Vec<f64>,
}

impl Bordered {
    /// `out -= M x`.
    pub(crate) fn subtract_product(&self, x: &[f64], out: &mut [f64]) {
        let nb = self.border;
        let split = x.len() - nb;
        let mut at = 0;
        let mut before = 0;
        for block in &self.blocks {
            let m = block.m;
            for i in 0..m {
                let row = &block.a[i * m..(i + 1) * m];
                for j in 0..i {
                    out[at + i] -= row[j] * x[at + j];
                    out[at + j] -= row[j] * x[at + i];
                }
                out[at + i] -= row[i] * x[at + i];
                for k in 0..nb {
                    out[at + i] -= block.b[i * nb + k] * x[split + k];
                    out[split + k] -= block.b[i * nb + k] * x[at + i];
                }
                for k in 0..CARRY {
                    let c = block.c[i * CARRY + k];
                    if c != 0.0 {
                        out[at + i] -= c * x[before + k];
                        out[before + k] -= c * x[at + i];
                    }
                }
            }
            before = at + block.carry;
            at += m;
        }
        for i in 0..nb {
            for j in 0..i {
                let d = self.corner[i * nb + j];
                out[split + i] -= d * x[split + j];
                out[split + j] -= d * x[split + i];
            }
            out[split + i] -= self.corner[i * nb + i] * x[split + i];
        }
    }

    /// A matrix of the same shape takes the numbers of another.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        for (to, from) in self.blocks.iter_mut().zip(&other.blocks) {
            to.copy_from(from);
        }
        self.corner.copy_from_slice(&other.corner);
    }
}

/// Its factor.
#[derive(Clone, Debug, Default)]
pub struct BorderedFactor {
    stages: Vec<StageFactor>,
    corner: Factor,
    border: usize,
}

#[derive(Clone, Debug, Default)]
struct StageFactor {
    m: usize,
    carry: usize,
    factor: Factor,
    /// `A⁻¹ [E Bᵀ]`, E selecting the carried unknowns; a row of CARRY + border numbers per unknown.
    y: Vec<f64>,
    b: Vec<f64>,
    c: Vec<f64>,
}

impl BorderedFactor {
    /// Factors; the blocks of `matrix` are used up. Returns positive, negative and zero eigenvalues.
    pub fn compute(&mut self, matrix: &mut Bordered) -> (usize, usize, usize) {
        let nb = matrix.border;
        self.border = nb;
        self.stages.resize_with(matrix.blocks.len(), StageFactor::default);
        let mut inertia = Inertia::default();
        let mut gram = Vec::new();
        for s in 0..matrix.blocks.len() {
            let (done, rest) = matrix.blocks.split_at_mut(s + 1);
            let block = &done[s];
            let stage = &mut self.stages[s];
            inertia = inertia.plus(stage.compute(block, nb));
            stage.gram(nb, &mut gram);
            if let Some(next) = rest.first_mut() {
                pass_on(next, &gram, nb);
            }
            let width = CARRY + nb;
            for i in 0..nb {
                for j in 0..=i {
                    matrix.corner[i * nb + j] -= gram[(CARRY + i) * width + CARRY + j];
                }
            }
        }
        inertia = inertia.plus(self.corner.compute(&matrix.corner, nb));
        (inertia.positive, inertia.negative, inertia.zero)
    }

    /// Solves in place: `x` holds the stages one after the other, then the border.
    pub fn solve(&self, x: &mut [f64]) {
        let nb = self.border;
        let split = x.len() - nb;
        let (inner, border) = x.split_at_mut(split);
        let mut at = 0;
        let mut starts = Vec::with_capacity(self.stages.len());
        for (s, stage) in self.stages.iter().enumerate() {
            starts.push(at);
            let (own, rest) = inner[at..].split_at_mut(stage.m);
            stage.factor.solve(own, 1);
            for k in 0..nb {
                for i in 0..stage.m {
                    border[k] -= stage.b[i * nb + k] * own[i];
                }
            }
            if let Some(next) = self.stages.get(s + 1) {
                for i in 0..next.m {
                    for k in 0..CARRY {
                        rest[i] -= next.c[i * CARRY + k] * own[stage.carry + k];
                    }
                }
            }
            at += stage.m;
        }
        self.corner.solve(border, 1);
        let mut handed = [0.0; CARRY];
        for (stage, at) in self.stages.iter().zip(starts).rev() {
            stage.back(&mut inner[at..at + stage.m], &handed, border);
            handed = stage.reach_back(&inner[at..at + stage.m]);
        }
    }
}

impl StageFactor {
    fn compute(&mut self, block: &Block, nb: usize) -> Inertia {
        (self.m, self.carry) = (block.m, block.carry);
        let inertia = self.factor.compute(&block.a, block.m);
        let width = CARRY + nb;
        self.y.clear();
        self.y.resize(block.m * width, 0.0);
        for k in 0..CARRY {
            self.y[(block.carry + k) * width + k] = 1.0;
        }
        for i in 0..block.m {
            self.y[i * width + CARRY..(i + 1) * width].copy_from_slice(&block.b[i * nb..(i + 1) * nb]);
        }
        self.factor.solve(&mut self.y, width);
        self.b.clear();
        self.b.extend_from_slice(&block.b);
        self.c.clear();
        self.c.extend_from_slice(&block.c);
        inertia
    }

    /// `[E Bᵀ]ᵀ A⁻¹ [E Bᵀ]`.
    fn gram(&self, nb: usize, out: &mut Vec<f64>) {
        let width = CARRY + nb;
        out.clear();
        out.resize(width * width, 0.0);
        for k in 0..CARRY {
            let row = (self.carry + k) * width;
            out[k * width..(k + 1) * width].copy_from_slice(&self.y[row..row + width]);
        }
        for i in 0..self.m {
            let y = &self.y[i * width..(i + 1) * width];
            for k in 0..nb {
                let b = self.b[i * nb + k];
                if b != 0.0 {
                    let row = &mut out[(CARRY + k) * width..(CARRY + k + 1) * width];
                    row.iter_mut().zip(y).for_each(|(o, y)| *o += b * y);
                }
            }
        }
    }

    /// `x = A⁻¹ r - Y [handed; border]`.
    fn back(&self, x: &mut [f64], handed: &[f64; CARRY], border: &[f64]) {
        let width = CARRY + border.len();
        for i in 0..self.m {
            let y = &self.y[i * width..(i + 1) * width];
            let far: f64 = y[..CARRY].iter().zip(handed).map(|(y, h)| y * h).sum();
            let wide: f64 = y[CARRY..].iter().zip(border).map(|(y, b)| y * b).sum();
            x[i] -= far + wide;
        }
    }

    /// `Cᵀ x`: what the stage before feels of this one.
    fn reach_back(&self, x: &[f64]) -> [f64; CARRY] {
        let mut out = [0.0; CARRY];
        for i in 0..self.m {
            for k in 0..CARRY {
                out[k] += self.c[i * CARRY + k] * x[i];
            }
        }
        out
    }
}

/// The eliminated stage's share of the next one: `A -= C G_cc Cᵀ`, `B -= C G_cb`.
fn pass_on(next: &mut Block, gram: &[f64], nb: usize) {
    let width = CARRY + nb;
    let m = next.m;
    for i in 0..m {
        let mut row = [0.0; CARRY];
        let c: &[f64] = &next.c[i * CARRY..(i + 1) * CARRY];
        if c.iter().all(|x| *x == 0.0) {
            continue;
        }
        for k in 0..CARRY {
            for l in 0..CARRY {
                row[l] += c[k] * gram[k * width + l];
            }
        }
        for j in 0..nb {
            let share: f64 = (0..CARRY).map(|k| c[k] * gram[k * width + CARRY + j]).sum();
            next.b[i * nb + j] -= share;
        }
        for j in 0..=i {
            let other = &next.c[j * CARRY..(j + 1) * CARRY];
            next.a[i * m + j] -= row.iter().zip(other).map(|(r, c)| r * c).sum::<f64>();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn chain_with_border_solves_like_the_dense_matrix() {
        let mut dice = ChaCha8Rng::seed_from_u64(5);
        let (stages, nb) = (4, 3);
        let sizes = [9, 10, 12, 11];
        let total: usize = sizes.iter().sum::<usize>() + nb;
        let mut matrix = Bordered { blocks: Vec::new(), border: nb, corner: vec![0.0; nb * nb] };
        let mut dense = DMatrix::<f64>::zeros(total, total);
        let mut at = 0;
        for s in 0..stages {
            let mut block = Block::new(sizes[s], s % 2, nb);
            let m = sizes[s];
            for i in 0..m {
                for j in 0..=i {
                    let v = dice.random_range(-1.0..1.0);
                    block.a[i * m + j] = v;
                    (dense[(at + i, at + j)], dense[(at + j, at + i)]) = (v, v);
                }
                for k in 0..nb {
                    let v = dice.random_range(-1.0..1.0);
                    block.b[i * nb + k] = v;
                    (dense[(at + i, total - nb + k)], dense[(total - nb + k, at + i)]) = (v, v);
                }
                for k in 0..CARRY {
                    if s > 0 {
                        let v = dice.random_range(-1.0..1.0);
                        block.c[i * CARRY + k] = v;
                        let column = at - sizes[s - 1] + (s - 1) % 2 + k;
                        (dense[(at + i, column)], dense[(column, at + i)]) = (v, v);
                    }
                }
            }
            matrix.blocks.push(block);
            at += m;
        }
        for i in 0..nb {
            for j in 0..=i {
                let v = dice.random_range(-1.0..1.0);
                matrix.corner[i * nb + j] = v;
                (dense[(at + i, at + j)], dense[(at + j, at + i)]) = (v, v);
            }
        }
        let x: Vec<f64> = (0..total).map(|_| dice.random_range(-1.0..1.0)).collect();
        let mut b: Vec<f64> = (&dense * DMatrix::from_column_slice(total, 1, &x)).iter().copied().collect();
        let mut factor = BorderedFactor::default();
        let (positive, negative, zero) = factor.compute(&mut matrix);
        factor.solve(&mut b);
        for (got, want) in b.iter().zip(&x) {
            assert!((got - want).abs() < 1e-9); // condition about 1e3
        }
        let eigen = dense.symmetric_eigen().eigenvalues;
        assert_eq!((positive, negative, zero), (eigen.iter().filter(|e| **e > 0.0).count(), total - positive, 0));
    }
}
