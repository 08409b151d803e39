//! A collocation problem as a nonlinear program with chain-structured linear algebra. RT: no.

use super::assemble::Jet5;
use super::layout::Layout;
use super::rows::{Name, Quantity};
use super::values::Values;
use crate::design::nlp::bordered::{Block, Bordered, BorderedFactor, CARRY};
use crate::design::nlp::{Nlp, Size};
use crate::design::problem::{Problem, State};
use crate::model::compass_gait::params::Normalised;

/// Gradient of a bound: by the unknowns of its stage, those carried from the stage before, and its phase's duration.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Row {
    pub(super) own: [f64; 6],
    pub(super) before: [f64; CARRY],
    pub(super) time: f64,
}

/// The program of a problem.
#[derive(Clone, Debug)]
pub struct Program {
    pub(super) problem: Problem,
    pub(super) layout: Layout,
    pub(super) params: Vec<Normalised<f64>>,
    pub(super) lifted: Vec<Normalised<Jet5>>,
    pub(super) gradient: Vec<f64>,
    pub(super) rows: Vec<Row>,
    /// Hessian and equations' Jacobian at the last linearisation.
    pub(super) hessian: Bordered,
    /// With the bounds' share: as factored, and used up by factoring.
    system: Bordered,
    work: Bordered,
    factor: BorderedFactor,
    packed: Vec<f64>,
    rest: Vec<f64>,
}

impl Program {
    /// Lays the program out.
    #[must_use]
    pub fn new(problem: &Problem) -> Self {
        let layout = Layout::new(problem);
        let params: Vec<_> = problem.phases.iter().map(|phase| problem.params(phase).normalised()).collect();
        let lifted = params.iter().map(Normalised::lift).collect();
        let nb = layout.border();
        let blocks = layout.stages.iter().map(|s| Block::new(s.nv + s.ne, s.xo, nb)).collect();
        let hessian = Bordered { blocks, border: nb, corner: vec![0.0; nb * nb] };
        let total = layout.n + layout.m;
        Self {
            problem: problem.clone(),
            gradient: vec![0.0; layout.n],
            rows: vec![Row::default(); layout.bounds.len()],
            system: hessian.clone(),
            work: hessian.clone(),
            hessian,
            factor: BorderedFactor::default(),
            packed: vec![0.0; total],
            rest: vec![0.0; total],
            layout,
            params,
            lifted,
        }
    }

    /// What each equation is about.
    #[must_use]
    pub fn equations(&self) -> &[Name] {
        &self.layout.equations
    }

    /// What each bound is about.
    #[must_use]
    pub fn bound_names(&self) -> &[Name] {
        &self.layout.bounds
    }

    /// The problem.
    #[must_use]
    pub const fn problem(&self) -> &Problem {
        &self.problem
    }

    /// Durations of the phases in the unknowns `w`, s.
    #[must_use]
    pub fn durations<'w>(&self, w: &'w [f64]) -> &'w [f64] {
        &w[self.layout.durations..self.layout.durations + self.layout.phases()]
    }

    /// States and torques at the knots of a phase.
    #[must_use]
    pub fn knots(&self, phase: usize, w: &[f64]) -> Vec<[f64; 5]> {
        self.layout.stages.iter().filter(|stage| stage.phase == phase).map(|stage| stage.state(w)).collect()
    }

    /// Torques at the midpoints of a phase.
    #[must_use]
    pub fn mid_torques(&self, phase: usize, w: &[f64]) -> Vec<f64> {
        let later = self.layout.stages.iter().filter(|stage| stage.phase == phase && stage.knot > 0);
        later.map(|stage| stage.mid_torque(w)).collect()
    }

    /// Unknowns from functions: state, torque and duration at a share (0 to 1) of a phase.
    pub fn unknowns(&self, at: impl Fn(usize, f64) -> (State, f64, f64)) -> Vec<f64> {
        let mut w = vec![0.0; self.layout.n];
        for stage in &self.layout.stages {
            #[expect(clippy::cast_precision_loss, reason = "a few hundred knots")]
            let share = |k: f64| (stage.knot as f64 + k) / (self.problem.phases[stage.phase].knots - 1) as f64;
            let (x, torque, duration) = at(stage.phase, share(0.0));
            let own = &mut w[stage.w0..stage.w0 + stage.nv];
            own[stage.xo..stage.xo + 4].copy_from_slice(&x);
            own[stage.xo + 4] = torque;
            if stage.knot > 0 {
                own[0] = at(stage.phase, share(-0.5)).1;
            }
            w[self.layout.durations + stage.phase] = duration;
        }
        if let Some(orbit) = self.layout.orbit {
            let first = at(0, 0.0).0;
            w[orbit..orbit + 4].copy_from_slice(&first);
        }
        w
    }

    pub(super) fn values_of(&self, phase: usize) -> &Normalised<f64> {
        &self.params[phase]
    }

    pub(super) fn clear(&mut self) {
        self.hessian.blocks.iter_mut().for_each(Block::clear);
        self.hessian.corner.fill(0.0);
        self.gradient.fill(0.0);
        self.rows.fill(Row::default());
    }

    /// Adds `Jgᵀ diag(sigma) Jg`.
    fn add_bounds(&mut self, sigma: &[f64]) {
        let nb = self.system.border;
        for s in 0..self.layout.stages.len() {
            let stage = &self.layout.stages[s];
            for row in stage.g0..stage.g0 + stage.ng {
                if sigma[row] == 0.0 {
                    continue;
                }
                let r = &self.rows[row];
                let (done, rest) = self.system.blocks.split_at_mut(s);
                let block = &mut rest[0];
                for i in 0..stage.nv {
                    let weight = sigma[row] * r.own[i];
                    if weight == 0.0 {
                        continue;
                    }
                    for j in 0..=i {
                        block.a[i * block.m + j] += weight * r.own[j];
                    }
                    for j in 0..CARRY {
                        block.c[i * CARRY + j] += weight * r.before[j];
                    }
                    block.b[i * nb + stage.phase] += weight * r.time;
                }
                self.system.corner[stage.phase * nb + stage.phase] += sigma[row] * r.time * r.time;
                if let (Some(before), true) = (done.last_mut(), stage.knot > 0) {
                    let xo = before.carry;
                    for i in 0..CARRY {
                        let weight = sigma[row] * r.before[i];
                        for j in 0..=i {
                            before.a[(xo + i) * before.m + xo + j] += weight * r.before[j];
                        }
                        before.b[(xo + i) * nb + stage.phase] += weight * r.time;
                    }
                }
            }
        }
        let first = self.layout.duration_rows();
        for p in 0..self.layout.phases() {
            self.system.corner[p * nb + p] += sigma[first + p];
        }
    }

    /// Jacobian rows of the border's equations by the border's unknowns.
    fn border_rows(&self) -> impl Iterator<Item = &[f64]> {
        let (nb, nw) = (self.hessian.border, self.layout.border_w);
        (nw..nb).map(move |i| &self.hessian.corner[i * nb..i * nb + nw])
    }

    fn add_diagonal(&mut self, shift: f64, soft: &[f64]) {
        for (stage, block) in self.layout.stages.iter().zip(&mut self.system.blocks) {
            let m = block.m;
            (0..stage.nv).for_each(|i| block.a[i * m + i] += shift);
            (0..stage.ne).for_each(|i| block.a[(stage.nv + i) * (m + 1)] -= soft[stage.e0 + i]);
        }
        let (nb, nw) = (self.system.border, self.layout.border_w);
        (0..nw).for_each(|i| self.system.corner[i * (nb + 1)] += shift);
        (nw..nb).for_each(|i| self.system.corner[i * (nb + 1)] -= soft[self.layout.m - nb + i]);
    }

    /// Hessian of the Lagrangian times a direction: for tests.
    #[cfg(test)]
    pub(super) fn hessian_times(&mut self, direction: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.layout.n];
        let nothing = vec![0.0; self.layout.m];
        self.pack(direction, &nothing);
        let mut rest = vec![0.0; self.packed.len()];
        self.hessian.subtract_product(&self.packed, &mut rest);
        self.packed = rest.iter().map(|x| -x).collect();
        let mut lower = nothing;
        self.unpack(&mut out, &mut lower);
        out
    }

    fn pack(&mut self, dw: &[f64], dl: &[f64]) {
        let mut at = 0;
        for stage in &self.layout.stages {
            self.packed[at..at + stage.nv].copy_from_slice(&dw[stage.w0..stage.w0 + stage.nv]);
            self.packed[at + stage.nv..at + stage.nv + stage.ne].copy_from_slice(&dl[stage.e0..stage.e0 + stage.ne]);
            at += stage.nv + stage.ne;
        }
        let (nw, ne) = (self.layout.border_w, self.layout.border_e);
        self.packed[at..at + nw].copy_from_slice(&dw[self.layout.durations..]);
        self.packed[at + nw..].copy_from_slice(&dl[self.layout.m - ne..]);
    }

    fn unpack(&self, dw: &mut [f64], dl: &mut [f64]) {
        let mut at = 0;
        for stage in &self.layout.stages {
            dw[stage.w0..stage.w0 + stage.nv].copy_from_slice(&self.packed[at..at + stage.nv]);
            dl[stage.e0..stage.e0 + stage.ne].copy_from_slice(&self.packed[at + stage.nv..at + stage.nv + stage.ne]);
            at += stage.nv + stage.ne;
        }
        let (nw, ne) = (self.layout.border_w, self.layout.border_e);
        dw[self.layout.durations..].copy_from_slice(&self.packed[at..at + nw]);
        dl[self.layout.m - ne..].copy_from_slice(&self.packed[at + nw..]);
    }
}

impl Nlp for Program {
    fn size(&self) -> Size {
        Size { n: self.layout.n, m: self.layout.m, p: self.layout.bounds.len() }
    }

    fn bounds(&self) -> (&[f64], &[f64]) {
        (&self.layout.low, &self.layout.high)
    }

    /// All of them: with hard equations of motion the softened program can stall as the first one did, far from any
    /// motion. At equal prices the end or a limit gives way first, for one broken equation of motion saves little.
    fn may_soften(&self, _equation: usize) -> bool {
        true
    }

    fn may_soften_bound(&self, bound: usize) -> bool {
        self.layout.bounds[bound].quantity != Quantity::Duration
    }

    fn values(&mut self, w: &[f64], c: &mut [f64], g: &mut [f64]) -> f64 {
        Values { problem: &self.problem, layout: &self.layout, params: &self.params }.evaluate(w, c, g)
    }

    fn linearise(&mut self, w: &[f64], lambda: &[f64], y: &[f64], scale: f64) {
        self.assemble(w, lambda, y, scale);
    }

    fn cost_gradient(&self) -> &[f64] {
        &self.gradient
    }

    fn add_transposed(&self, lambda: &[f64], y: &[f64], out: &mut [f64]) {
        let nb = self.hessian.border;
        for (s, stage) in self.layout.stages.iter().enumerate() {
            let block = &self.hessian.blocks[s];
            let before = (stage.w0 > 0).then(|| &self.layout.stages[s - 1]).map(|b| b.w0 + b.xo);
            for i in 0..stage.ne {
                let (row, l) = (stage.nv + i, lambda[stage.e0 + i]);
                if l == 0.0 {
                    continue;
                }
                (0..stage.nv).for_each(|j| out[stage.w0 + j] += l * block.a[row * block.m + j]);
                (0..self.layout.border_w).for_each(|j| out[self.layout.durations + j] += l * block.b[row * nb + j]);
                if let Some(x) = before {
                    (0..CARRY).for_each(|j| out[x + j] += l * block.c[row * CARRY + j]);
                }
            }
            for k in stage.g0..stage.g0 + stage.ng {
                let (row, y) = (&self.rows[k], y[k]);
                if y == 0.0 {
                    continue;
                }
                (0..stage.nv).for_each(|j| out[stage.w0 + j] += y * row.own[j]);
                out[self.layout.durations + stage.phase] += y * row.time;
                if let Some(x) = before {
                    (0..CARRY).for_each(|j| out[x + j] += y * row.before[j]);
                }
            }
        }
        let first = self.layout.duration_rows();
        for p in 0..self.layout.phases() {
            out[self.layout.durations + p] += y[first + p];
        }
        for (row, l) in self.border_rows().zip(&lambda[self.layout.border_equations()..]) {
            row.iter().zip(&mut out[self.layout.durations..]).for_each(|(d, out)| *out += l * d);
        }
    }

    fn jacobian_times(&self, dw: &[f64], dc: &mut [f64], dg: &mut [f64]) {
        let nb = self.hessian.border;
        let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let border = &dw[self.layout.durations..];
        for (s, stage) in self.layout.stages.iter().enumerate() {
            let block = &self.hessian.blocks[s];
            let own = &dw[stage.w0..stage.w0 + stage.nv];
            let before: &[f64] = match self.layout.stages.get(s.wrapping_sub(1)) {
                Some(b) => &dw[b.w0 + b.xo..b.w0 + b.xo + CARRY],
                None => &[],
            };
            for i in 0..stage.ne {
                let row = stage.nv + i;
                dc[stage.e0 + i] = sum(&block.a[row * block.m..], own)
                    + sum(&block.c[row * CARRY..(row + 1) * CARRY], before)
                    + sum(&block.b[row * nb..row * nb + self.layout.border_w], border);
            }
            for k in stage.g0..stage.g0 + stage.ng {
                let row = &self.rows[k];
                dg[k] = sum(&row.own, own) + sum(&row.before, before) + row.time * border[stage.phase];
            }
        }
        let first = self.layout.duration_rows();
        dg[first..first + self.layout.phases()].copy_from_slice(&border[..self.layout.phases()]);
        for (row, c) in self.border_rows().zip(&mut dc[self.layout.border_equations()..]) {
            *c = sum(row, border);
        }
    }

    fn factor(&mut self, sigma: &[f64], shift: f64, soft: &[f64]) -> bool {
        self.system.copy_from(&self.hessian);
        self.add_bounds(sigma);
        self.add_diagonal(shift, soft);
        self.work.copy_from(&self.system);
        let (positive, negative, zero) = self.factor.compute(&mut self.work);
        positive == self.layout.n && negative == self.layout.m && zero == 0
    }

    fn back_solve(&mut self, dw: &mut [f64], dl: &mut [f64]) {
        self.pack(dw, dl);
        self.rest.copy_from_slice(&self.packed);
        self.factor.solve(&mut self.packed);
        // One round of refinement: elimination without pivots across stages may lose digits.
        self.system.subtract_product(&self.packed, &mut self.rest);
        self.factor.solve(&mut self.rest);
        self.packed.iter_mut().zip(&self.rest).for_each(|(x, d)| *x += d);
        self.unpack(dw, dl);
    }
}
