//! `M a = f` under constraints. RT: yes, no allocation.
//!
//! A constraint that holds one generalised coordinate still (a stuck pendulum, a foot that stands) takes it out of the
//! equations; its force follows from the row that was left out. Others are solved for by their forces.

use super::solve::{Factor, MAX_CONSTRAINTS, solve_small};
use crate::base::scalar::Scalar;
use crate::model::effect::friction::SOFT_PART;
use crate::model::mechanism::{Equations, MAX};

/// Who holds a constraint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Holder {
    Axis(usize),
    Rotor(usize),
    /// Foot, along the ground.
    Tangent,
    /// Foot, normal to the ground.
    Normal,
    /// A toe's screw.
    Toe,
}

/// How a constraint is kept.
#[derive(Clone, Copy, Debug)]
enum Kind {
    /// `factor · a[index] = 0`.
    Still { index: usize, factor: f64 },
    /// `a[index] = -bias`: a massless coordinate that a motor moves as it is told.
    Driven { index: usize },
    /// `row · a = -bias`, by a force along `push`.
    Along,
    /// The same by part of that force, of at most its level.
    Softly,
}

/// The constraints of one evaluation and their forces.
#[derive(Clone, Debug)]
pub(super) struct Held<S> {
    len: usize,
    /// Forces of what is held still are wanted; the others come with the accelerations.
    wants_forces: bool,
    holders: [Holder; MAX_CONSTRAINTS],
    kinds: [Kind; MAX_CONSTRAINTS],
    rows: [[S; MAX]; MAX_CONSTRAINTS],
    pushes: [[S; MAX]; MAX_CONSTRAINTS],
    bias: [S; MAX_CONSTRAINTS],
    /// Largest force of what is kept softly.
    level: [S; MAX_CONSTRAINTS],
    force: [S; MAX_CONSTRAINTS],
    /// `M⁻¹ push`.
    response: [[S; MAX]; MAX_CONSTRAINTS],
    gram: [[S; MAX_CONSTRAINTS]; MAX_CONSTRAINTS],
}

impl<S: Scalar> Default for Held<S> {
    fn default() -> Self {
        Self {
            len: 0,
            wants_forces: true,
            holders: [Holder::Normal; MAX_CONSTRAINTS],
            kinds: [Kind::Along; MAX_CONSTRAINTS],
            rows: [[S::zero(); MAX]; MAX_CONSTRAINTS],
            pushes: [[S::zero(); MAX]; MAX_CONSTRAINTS],
            bias: [S::zero(); MAX_CONSTRAINTS],
            level: [S::zero(); MAX_CONSTRAINTS],
            force: [S::zero(); MAX_CONSTRAINTS],
            response: [[S::zero(); MAX]; MAX_CONSTRAINTS],
            gram: [[S::zero(); MAX_CONSTRAINTS]; MAX_CONSTRAINTS],
        }
    }
}

impl<S: Scalar> Held<S> {
    /// Lets everything go.
    #[inline]
    pub(super) fn clear(&mut self, wants_forces: bool) {
        self.len = 0;
        self.wants_forces = wants_forces;
    }

    /// Forces are wanted, not accelerations alone.
    #[inline]
    pub(super) const fn wants_forces(&self) -> bool {
        self.wants_forces
    }

    /// Holds generalised coordinate `index` still by a force on `factor` times it.
    #[inline]
    pub(super) fn still(&mut self, holder: Holder, index: usize, factor: f64) {
        self.push(holder, Kind::Still { index, factor });
    }

    /// Moves massless coordinate `index` with `acceleration`.
    pub(super) fn drive(&mut self, index: usize, acceleration: S) {
        if let Some(k) = self.push(Holder::Toe, Kind::Driven { index }) {
            self.bias[k] = -acceleration;
            self.force[k] = S::zero();
        }
    }

    /// Keeps `row · a = -bias` by a force along `push`.
    pub(super) fn along(&mut self, holder: Holder, row: [S; MAX], push: [S; MAX], bias: S) {
        if let Some(k) = self.push(holder, Kind::Along) {
            self.rows[k] = row;
            self.pushes[k] = push;
            self.bias[k] = bias;
        }
    }

    /// A soft constraint, as friction is one in MuJoCo: towards `row · a = -bias` by a force along `row` of at most `level`.
    pub(super) fn softly(&mut self, holder: Holder, row: [S; MAX], bias: S, level: S) {
        if let Some(k) = self.push(holder, Kind::Softly) {
            self.rows[k] = row;
            self.pushes[k] = row;
            self.bias[k] = bias;
            self.level[k] = level;
        }
    }

    /// A force that was found elsewhere.
    #[inline]
    pub(super) fn note(&mut self, holder: Holder, force: S) {
        if let Some(k) = self.push(holder, Kind::Along) {
            self.force[k] = force;
        }
    }

    #[inline]
    fn push(&mut self, holder: Holder, kind: Kind) -> Option<usize> {
        let k = self.len;
        if k >= MAX_CONSTRAINTS {
            return None;
        }
        self.holders[k] = holder;
        self.kinds[k] = kind;
        self.len += 1;
        Some(k)
    }

    /// Each holder with its force.
    #[inline]
    pub(super) fn forces(&self) -> impl Iterator<Item = (Holder, S)> {
        (0..self.len).map(|k| (self.holders[k], self.force[k]))
    }

    /// Force of the constraint that `holder` holds.
    #[inline]
    pub(super) fn force_of(&self, holder: Holder) -> Option<S> {
        self.forces().find(|(h, _)| *h == holder).map(|(_, force)| force)
    }

    /// Accelerations under the constraints into `a`, and their forces.
    pub(super) fn accelerate(&mut self, eq: &Equations<S>, n: usize, factor: &mut Factor<S>, a: &mut [S; MAX]) {
        let mut free = [true; MAX];
        for kind in &self.kinds[..self.len] {
            if let Kind::Still { index, .. } | Kind::Driven { index } = *kind {
                free[index] = false;
            }
        }
        factor.factor(&eq.mass, (0..n).filter(|i| free[*i]));
        for i in 0..n {
            a[i] = if free[i] { eq.force[i] } else { S::zero() };
        }
        for (kind, bias) in self.kinds[..self.len].iter().zip(&self.bias) {
            if let Kind::Driven { index } = *kind {
                a[index] = -*bias;
            }
        }
        factor.solve(a);
        if self.len > 0 {
            self.constrain(n, &free, factor, a);
            if self.wants_forces {
                self.hold_still(eq, n, a);
            }
        }
    }

    fn constrain(&mut self, n: usize, free: &[bool; MAX], factor: &Factor<S>, a: &mut [S; MAX]) {
        let mut along = [0; MAX_CONSTRAINTS];
        let mut count = 0;
        for k in (0..self.len).filter(|k| matches!(self.kinds[*k], Kind::Along | Kind::Softly)) {
            along[count] = k;
            count += 1;
        }
        let along = &along[..count];
        for (j, &k) in along.iter().enumerate() {
            for i in 0..n {
                self.response[j][i] = if free[i] { self.pushes[k][i] } else { S::zero() };
            }
            factor.solve(&mut self.response[j]);
        }
        let mut force = [S::zero(); MAX_CONSTRAINTS];
        for (i, &k) in along.iter().enumerate() {
            force[i] = -self.bias[k] - product(&self.rows[k], a, n);
            for j in 0..count {
                self.gram[i][j] = product(&self.rows[k], &self.response[j], n);
            }
        }
        if along.iter().any(|k| matches!(self.kinds[*k], Kind::Softly)) {
            self.solve_softly(along, &mut force);
        } else {
            solve_small(&mut self.gram, &mut force, count);
        }
        for (j, &k) in along.iter().enumerate() {
            self.force[k] = force[j];
            for i in 0..n {
                a[i] += self.response[j][i] * force[j];
            }
        }
    }

    /// Forces of the constraints `along` where some are soft, in place of the right-hand side. What would be beyond its level, the farthest
    /// first, gives its level; the others follow.
    fn solve_softly(&mut self, along: &[usize], force: &mut [S; MAX_CONSTRAINTS]) {
        let is_soft = |j: usize| matches!(self.kinds[along[j]], Kind::Softly);
        let mut gram = self.gram;
        for j in (0..along.len()).filter(|j| is_soft(*j)) {
            gram[j][j] = gram[j][j] / SOFT_PART;
        }
        let asked = *force;
        let mut ended = [false; MAX_CONSTRAINTS];
        for _ in 0..=along.len() {
            let mut left = gram;
            for i in 0..along.len() {
                if ended[i] {
                    left[i] = [S::zero(); MAX_CONSTRAINTS];
                    left[i][i] = S::one();
                } else {
                    force[i] = asked[i];
                }
            }
            solve_small(&mut left, force, along.len());
            let beyond = |j: usize| force[j].value().abs() - self.level[along[j]].value();
            let soft = (0..along.len()).filter(|j| is_soft(*j) && !ended[*j] && beyond(*j) > 0.0);
            let Some(farthest) = soft.max_by(|a, b| beyond(*a).total_cmp(&beyond(*b))) else { return };
            ended[farthest] = true;
            force[farthest] = self.level[along[farthest]] * force[farthest].value().signum();
        }
    }

    /// Forces on the coordinates that were left out.
    fn hold_still(&mut self, eq: &Equations<S>, n: usize, a: &[S; MAX]) {
        for k in 0..self.len {
            let Kind::Still { index, factor } = self.kinds[k] else { continue };
            let mut force = product(&eq.mass[index], a, n) - eq.force[index];
            for j in (0..self.len).filter(|j| matches!(self.kinds[*j], Kind::Along | Kind::Softly)) {
                force -= self.pushes[j][index] * self.force[j];
            }
            self.force[k] = force / factor;
        }
    }
}

/// Scalar product of the first `n`.
#[inline]
pub(super) fn product<S: Scalar>(a: &[S; MAX], b: &[S; MAX], n: usize) -> S {
    let mut sum = S::zero();
    for i in 0..n {
        sum += a[i] * b[i];
    }
    sum
}
