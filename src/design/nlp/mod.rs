//! Nonlinear programs `min f(w)  s.t.  c(w) = 0,  low ≤ g(w) ≤ high` with a structure of their own. RT: no.
//!
//! | file | what |
//! |---|---|
//! | [`interior_point`] | primal-dual interior point, filter line search, inertia correction |
//! | `step` | slacks, their multipliers, softened rows; one Newton step |
//! | [`bordered`] | the chain of stages with a border: factor and solve |
//! | `dense` | Bunch-Kaufman of one stage |
//!
//! Own code and not a crate: the matrix of a trajectory has blocks of ten unknowns that couple only with their
//! neighbours, and a general sparse factorisation spends its time on finding that out (bench/plan/compare).

pub mod bordered;
mod dense;
pub mod interior_point;
mod step;

pub use interior_point::{Iterate, Options, Outcome, Solved, solve};

/// Number of variables, equations and inequalities.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Variables w.
    pub n: usize,
    /// Equations c.
    pub m: usize,
    /// Inequalities g.
    pub p: usize,
}

/// A nonlinear program with its own linear algebra.
pub trait Nlp {
    /// How large it is.
    fn size(&self) -> Size;
    /// Bounds of the inequalities; infinite where there is none.
    fn bounds(&self) -> (&[f64], &[f64]);
    /// Equations that may be softened when one asks which of them cannot be met.
    fn may_soften(&self, equation: usize) -> bool;
    /// The same of bounds.
    fn may_soften_bound(&self, bound: usize) -> bool;
    /// Cost, equations and inequalities at `w`.
    fn values(&mut self, w: &[f64], c: &mut [f64], g: &mut [f64]) -> f64;
    /// Derivatives at `w`: gradients, Jacobians and the Hessian of `scale f + λᵀc + yᵀg`.
    fn linearise(&mut self, w: &[f64], lambda: &[f64], y: &[f64], scale: f64);
    /// Gradient of the (scaled) cost at the last linearisation.
    fn cost_gradient(&self) -> &[f64];
    /// `out += Jcᵀ λ + Jgᵀ y`.
    fn add_transposed(&self, lambda: &[f64], y: &[f64], out: &mut [f64]);
    /// `Jc dw` and `Jg dw`.
    fn jacobian_times(&self, dw: &[f64], dc: &mut [f64], dg: &mut [f64]);
    /// Factors `[H + Jgᵀ diag(sigma) Jg + shift I, Jcᵀ; Jc, -diag(soft)]`. True if it has n positive and m negative
    /// eigenvalues, so that the step goes downhill.
    fn factor(&mut self, sigma: &[f64], shift: f64, soft: &[f64]) -> bool;
    /// Solves with the last factor: `dw` holds the upper right-hand side and takes the solution, `dl` the lower.
    fn back_solve(&mut self, dw: &mut [f64], dl: &mut [f64]);
}
