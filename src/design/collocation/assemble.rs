//! Gradients, Jacobians and the Hessian of the Lagrangian, exact, in the chain's blocks. RT: no.
//!
//! Symbols: `f` flow, `h` step, `D` derivative of the midpoint's state and torque by the interval's twelve unknowns
//! `z = (x0, τ0 | τm, x1, τ1 | T)`, `λ` multipliers of the defects, `ρ` how much the Lagrangian feels the midpoint's
//! state. With `Φ = -(2h/3) λᵀf_m + (2h/3) l_m + yᵀg_m` at the midpoint the interval's Hessian is
//! `Dᵀ Φ'' D + Σ ρ_i x_m,i''` and the terms of the knots; `x_m''` is `± h/8 f''` plus the terms of `h = T/N`.

#![expect(non_snake_case, reason = "symbols of the head")]

use super::layout::Stage;
use super::point::{Point, ROWS, point};
use super::program::{Program, Row};
use super::terminal::conditions;
use super::values::{Values, arrives, knot_number, midpoint, orbit_posture};
use crate::base::jet::Jet;
use crate::base::scalar::Scalar;
use crate::design::nlp::bordered::CARRY;
use crate::design::problem::{Finish, Start};
use crate::model::compass_gait::impact;

/// Second-order numbers of a point: state and torque.
pub(super) type Jet5 = Jet<5, 15>;
type Jet4 = Jet<4, 10>;
type Jet3 = Jet<3, 6>;

/// Unknowns of an interval.
const Z: usize = 12;
/// Where the midpoint's torque stands in z, and the duration.
const MID: usize = 5;
const TIME: usize = 11;

/// A point with its derivatives.
pub(super) struct Evaluated {
    x: [f64; 5],
    f: [f64; 4],
    /// Rows of the flow's Jacobian by state and torque.
    F: [[f64; 5]; 4],
    jets: Point<Jet5>,
}

impl Evaluated {
    fn new(x: [f64; 5], jets: Point<Jet5>) -> Self {
        let a = &jets.acceleration;
        let mut F = [[0.0; 5]; 4];
        F[0][2] = 1.0;
        F[1][3] = 1.0;
        (F[2], F[3]) = (a[0].d, a[1].d);
        Self { x, f: [x[2], x[3], a[0].v, a[1].v], F, jets }
    }
}

/// A weighted sum of second-order numbers: gradient and Hessian.
fn weighted<const N: usize, const H: usize>(terms: &[(f64, &Jet<N, H>)]) -> ([f64; N], [f64; H]) {
    let (mut d, mut h) = ([0.0; N], [0.0; H]);
    for (weight, jet) in terms {
        for i in 0..N {
            d[i] += weight * jet.d[i];
        }
        for k in 0..H {
            h[k] += weight * jet.h[k];
        }
    }
    (d, h)
}

fn full<const N: usize, const H: usize>(h: [f64; H]) -> [[f64; N]; N] {
    Jet::<N, H> { v: 0.0, d: [0.0; N], h }.hessian()
}

/// What an interval is evaluated with.
struct Interval<'a> {
    stage: usize,
    h: f64,
    intervals: f64,
    left: &'a Evaluated,
    mid: &'a Evaluated,
    right: &'a Evaluated,
    lambda: [f64; 4],
    scale: f64,
}

impl Program {
    /// Everything at `w`.
    pub(super) fn assemble(&mut self, w: &[f64], lambda: &[f64], y: &[f64], scale: f64) {
        self.clear();
        let mut before: Option<Evaluated> = None;
        for s in 0..self.layout.stages.len() {
            let stage = self.layout.stages[s].clone();
            let here = self.evaluate(stage.phase, stage.state(w));
            match (stage.knot, &before) {
                (0, None) => self.start(s),
                (0, Some(from)) => self.link(s, from, lambda),
                (_, Some(left)) => self.interval(s, w, (left, &here), lambda, y, scale),
                (_, None) => {}
            }
            self.knot_bounds(s, &here, y);
            self.clearance(s, w, &here, y);
            if stage.last {
                self.end(s, &here, lambda, y);
            }
            before = Some(here);
        }
        self.border_terms(w, lambda);
    }

    fn evaluate(&self, phase: usize, x: [f64; 5]) -> Evaluated {
        let (limits, cost) = (&self.problem.limits, &self.problem.cost);
        Evaluated::new(x, point(&self.lifted[phase], limits, cost, &Jet5::point(&x)))
    }

    /// `x - start = 0`.
    fn start(&mut self, s: usize) {
        let stage = self.layout.stages[s].clone();
        let (nb, periodic) = (self.hessian.border, self.problem.start == Start::Periodic);
        let block = &mut self.hessian.blocks[s];
        for i in 0..4 {
            let row = stage.nv + i;
            block.a[row * block.m + stage.xo + i] = 1.0;
            if periodic {
                block.b[row * nb + self.layout.phases() + i] = -1.0;
            }
        }
    }

    /// `x - impact(x_before) = 0`.
    fn link(&mut self, s: usize, from: &Evaluated, lambda: &[f64]) {
        let stage = self.layout.stages[s].clone();
        let after = self.impact(stage.phase - 1, &from.x);
        let block = &mut self.hessian.blocks[s];
        for i in 0..4 {
            let row = stage.nv + i;
            block.a[row * block.m + stage.xo + i] = 1.0;
            for j in 0..4 {
                block.c[row * CARRY + j] = -after[i].d[j];
            }
        }
        let terms: [(f64, &Jet4); 4] = std::array::from_fn(|i| (-lambda[stage.e0 + i], &after[i]));
        let (_, h) = weighted(&terms);
        self.add_state_hessian(s - 1, &full::<4, 10>(h));
    }

    fn impact(&self, phase: usize, x: &[f64; 5]) -> [Jet4; 4] {
        let state = Jet4::point(&[x[0], x[1], x[2], x[3]]);
        impact::step(&self.values_of(phase).lift(), &state).unwrap_or([Jet4::constant(f64::NAN); 4])
    }

    fn interval(
        &mut self,
        s: usize,
        w: &[f64],
        (left, right): (&Evaluated, &Evaluated),
        lambda: &[f64],
        y: &[f64],
        scale: f64,
    ) {
        let stage = self.layout.stages[s].clone();
        let values = Values { problem: &self.problem, layout: &self.layout, params: &self.params };
        let (h, intervals) = (values.step_s(stage.phase, w), values.intervals(stage.phase));
        let x = midpoint(&left.x, &left.f, &right.x, &right.f, h, stage.mid_torque(w));
        let mid = self.evaluate(stage.phase, x);
        let lambda = std::array::from_fn(|i| lambda[stage.e0 + i]);
        let it = Interval { stage: s, h, intervals, left, mid: &mid, right, lambda, scale };
        let D = it.midpoint_derivative();
        let hessian = it.hessian(&D, &y[stage.g0..stage.g0 + ROWS]);
        self.add_interval_hessian(s, &hessian);
        self.defects(&it, &D);
        self.cost_gradient(&it, &D);
        for i in 0..ROWS {
            let gradient = pull_back(&mid.jets.rows[i].d, &D);
            self.rows[stage.g0 + i] = Row::of_interval(&gradient);
        }
    }

    /// Rows of the defects' Jacobian.
    fn defects(&mut self, it: &Interval<'_>, D: &[[f64; Z]; 5]) {
        let stage = self.layout.stages[it.stage].clone();
        let (sixth, nb) = (it.h / 6.0, self.hessian.border);
        let block = &mut self.hessian.blocks[it.stage];
        for i in 0..4 {
            let mut row = pull_back(&it.mid.F[i], D).map(|x| -4.0 * sixth * x);
            for j in 0..5 {
                row[j] -= sixth * it.left.F[i][j];
                row[MID + 1 + j] -= sixth * it.right.F[i][j];
            }
            row[i] -= 1.0;
            row[MID + 1 + i] += 1.0;
            row[TIME] -= (it.left.f[i] + 4.0 * it.mid.f[i] + it.right.f[i]) / (6.0 * it.intervals);
            let r = stage.nv + i;
            block.c[r * CARRY..(r + 1) * CARRY].copy_from_slice(&row[..5]);
            block.a[r * block.m..r * block.m + 6].copy_from_slice(&row[MID..TIME]);
            block.b[r * nb + stage.phase] = row[TIME];
        }
    }

    fn cost_gradient(&mut self, it: &Interval<'_>, D: &[[f64; Z]; 5]) {
        let stage = &self.layout.stages[it.stage];
        let before = &self.layout.stages[it.stage - 1];
        let sixth = it.scale * it.h / 6.0;
        let (l0, lm, l1) = (&it.left.jets.cost, &it.mid.jets.cost, &it.right.jets.cost);
        let mut row = pull_back(&lm.d, D).map(|x| 4.0 * sixth * x);
        for j in 0..5 {
            row[j] += sixth * l0.d[j];
            row[MID + 1 + j] += sixth * l1.d[j];
        }
        row[TIME] += it.scale * (l0.v + 4.0 * lm.v + l1.v) / (6.0 * it.intervals);
        for j in 0..5 {
            self.gradient[before.w0 + before.xo + j] += row[j];
        }
        for j in 0..6 {
            self.gradient[stage.w0 + j] += row[MID + j];
        }
        self.gradient[self.layout.durations + stage.phase] += row[TIME];
    }

    fn knot_bounds(&mut self, s: usize, here: &Evaluated, y: &[f64]) {
        let stage = self.layout.stages[s].clone();
        let first = stage.knot_rows();
        let jets = &here.jets.rows;
        for i in 0..ROWS {
            self.rows[first + i] = Row::of_knot(&stage, &jets[i].d);
        }
        let terms: [(f64, &Jet5); ROWS] = std::array::from_fn(|i| (y[first + i], &jets[i]));
        if terms.iter().any(|(weight, _)| *weight != 0.0) {
            let (_, h) = weighted(&terms);
            self.add_knot_hessian(s, &full::<5, 15>(h));
        }
    }

    fn clearance(&mut self, s: usize, w: &[f64], here: &Evaluated, y: &[f64]) {
        let stage = self.layout.stages[s].clone();
        if stage.swing {
            self.rows[stage.swing_row()] = Row::of_knot(&stage, &[0.0, 1.0, 0.0, 0.0, 0.0]);
        }
        let (true, Some(clearance)) = (stage.clear, self.problem.limits.clearance) else { return };
        let intervals =
            Values { problem: &self.problem, layout: &self.layout, params: &self.params }.intervals(stage.phase);
        let [q0, q1, T] = Jet3::point(&[here.x[0], here.x[1], w[self.layout.durations + stage.phase]]);
        let t = T * (knot_number(&stage) / intervals);
        let margin = clearance.margin([q0, q1], t, T, self.problem.robot.leg_length_m, clearance.begun_at(stage.phase));
        let row = stage.clearance_row();
        self.rows[row] = Row::of_knot(&stage, &[margin.d[0], margin.d[1], 0.0, 0.0, 0.0]);
        self.rows[row].time = margin.d[2];
        let H = margin.hessian();
        let (m, nb, weight) = (self.hessian.blocks[s].m, self.hessian.border, y[row]);
        let block = &mut self.hessian.blocks[s];
        for i in 0..2 {
            for j in 0..=i {
                block.a[(stage.xo + i) * m + stage.xo + j] += weight * H[i][j];
            }
            block.b[(stage.xo + i) * nb + stage.phase] += weight * H[2][i];
        }
        self.hessian.corner[stage.phase * nb + stage.phase] += weight * H[2][2];
    }

    fn end(&mut self, s: usize, here: &Evaluated, lambda: &[f64], y: &[f64]) {
        let stage = self.layout.stages[s].clone();
        let x = Jet4::point(&[here.x[0], here.x[1], here.x[2], here.x[3]]);
        let (limits, l) = (self.problem.limits, self.problem.robot.leg_length_m);
        let end = self.problem.phases[stage.phase].end;
        let ends = conditions(&end, &self.values_of(stage.phase).lift(), &limits, l, &x);
        let arrival = arrives(&self.problem, stage.phase);
        let equations: Vec<Jet4> = if arrival {
            self.impact(stage.phase, &here.x).to_vec()
        } else {
            ends.equations.into_iter().map(|(_, jet)| jet).collect()
        };
        let (m, nb, first) = (self.hessian.blocks[s].m, self.hessian.border, stage.nv + 4);
        for (i, jet) in equations.iter().enumerate() {
            let row = (first + i) * m + stage.xo;
            self.hessian.blocks[s].a[row..row + 4].copy_from_slice(&jet.d);
        }
        if arrival && self.problem.finish == Finish::Periodic {
            for i in 0..4 {
                self.hessian.blocks[s].b[(first + i) * nb + self.layout.phases() + i] = -1.0;
            }
        }
        let rows = stage.end_rows();
        for (i, (_, jet, ..)) in ends.bounds.iter().enumerate() {
            self.rows[rows + i] = Row::of_knot(&stage, &[jet.d[0], jet.d[1], jet.d[2], jet.d[3], 0.0]);
        }
        let e = stage.end_equations();
        let of_equations = equations.iter().enumerate().map(|(i, jet)| (lambda[e + i], jet));
        let of_bounds = ends.bounds.iter().enumerate().map(|(i, (_, jet, ..))| (y[rows + i], jet));
        let terms: Vec<(f64, &Jet4)> = of_equations.chain(of_bounds).collect();
        self.add_state_hessian(s, &full::<4, 10>(weighted(&terms).1));
    }

    fn border_terms(&mut self, w: &[f64], lambda: &[f64]) {
        let (nb, phases) = (self.hessian.border, self.layout.phases());
        let nw = self.layout.border_w;
        if let Some(orbit) = self.layout.orbit {
            let e = self.layout.border_equations();
            let posture = orbit_posture(&self.problem, &Jet::<2, 3>::point(&[w[orbit], w[orbit + 1]]));
            let h = full::<2, 3>(weighted(&[(lambda[e], &posture[0]), (lambda[e + 1], &posture[1])]).1);
            for i in 0..2 {
                self.hessian.corner[(nw + i) * nb + phases..][..2].copy_from_slice(&posture[i].d);
                (0..=i).for_each(|j| self.hessian.corner[(phases + i) * nb + phases + j] += h[i][j]);
            }
        }
        if self.problem.total_time_s.is_some() {
            self.hessian.corner[(nb - 1) * nb..][..phases].fill(1.0);
        }
        let first = self.layout.duration_rows();
        for p in 0..phases {
            self.rows[first + p] = Row { time: 1.0, ..Row::default() };
        }
    }

    /// Adds a Hessian by state and torque of stage `s`.
    fn add_knot_hessian(&mut self, s: usize, h: &[[f64; 5]; 5]) {
        let xo = self.layout.stages[s].xo;
        let block = &mut self.hessian.blocks[s];
        for i in 0..5 {
            for j in 0..=i {
                block.a[(xo + i) * block.m + xo + j] += h[i][j];
            }
        }
    }

    fn add_state_hessian(&mut self, s: usize, h: &[[f64; 4]; 4]) {
        let xo = self.layout.stages[s].xo;
        let block = &mut self.hessian.blocks[s];
        for i in 0..4 {
            for j in 0..=i {
                block.a[(xo + i) * block.m + xo + j] += h[i][j];
            }
        }
    }

    fn add_interval_hessian(&mut self, s: usize, h: &[[f64; Z]; Z]) {
        let phase = self.layout.stages[s].phase;
        let nb = self.hessian.border;
        let xo = self.layout.stages[s - 1].xo;
        let before = &mut self.hessian.blocks[s - 1];
        for i in 0..5 {
            for j in 0..=i {
                before.a[(xo + i) * before.m + xo + j] += h[i][j];
            }
            before.b[(xo + i) * nb + phase] += h[TIME][i];
        }
        let block = &mut self.hessian.blocks[s];
        for i in 0..6 {
            for j in 0..=i {
                block.a[i * block.m + j] += h[MID + i][MID + j];
            }
            for j in 0..CARRY {
                block.c[i * CARRY + j] += h[MID + i][j];
            }
            block.b[i * nb + phase] += h[TIME][MID + i];
        }
        self.hessian.corner[phase * nb + phase] += h[TIME][TIME];
    }
}

impl Interval<'_> {
    /// D: midpoint's state and torque by z.
    fn midpoint_derivative(&self) -> [[f64; Z]; 5] {
        let mut D = [[0.0; Z]; 5];
        let eighth = self.h / 8.0;
        for i in 0..4 {
            for j in 0..5 {
                D[i][j] = eighth * self.left.F[i][j];
                D[i][MID + 1 + j] = -eighth * self.right.F[i][j];
            }
            D[i][i] += 0.5;
            D[i][MID + 1 + i] += 0.5;
            D[i][TIME] = (self.left.f[i] - self.right.f[i]) / (8.0 * self.intervals);
        }
        D[4][MID] = 1.0;
        D
    }

    /// Hessian of the interval's part of the Lagrangian.
    fn hessian(&self, D: &[[f64; Z]; 5], y: &[f64]) -> [[f64; Z]; Z] {
        let (two_thirds, sixth) = (2.0 / 3.0 * self.h, self.h / 6.0);
        let (mid, l) = (&self.mid.jets, &self.lambda);
        // Φ: gradient and Hessian, the flow's linear rows included.
        let (mut phi, phi2) = weighted(&[
            (-two_thirds * l[2], &mid.acceleration[0]),
            (-two_thirds * l[3], &mid.acceleration[1]),
            (two_thirds * self.scale, &mid.cost),
            (y[0], &mid.rows[0]),
            (y[1], &mid.rows[1]),
            (y[2], &mid.rows[2]),
            (y[3], &mid.rows[3]),
        ]);
        phi[2] -= two_thirds * l[0];
        phi[3] -= two_thirds * l[1];
        let mut H = sandwich(&full::<5, 15>(phi2), D);
        // Φ depends on T by itself, through h.
        let mut cross = [0.0; Z];
        let flow = times_rows(l, &self.mid.F);
        let rate: [f64; 5] = std::array::from_fn(|j| (self.scale * mid.cost.d[j] - flow[j]) / (1.5 * self.intervals));
        add_to(&mut cross, &pull_back(&rate, D));
        let rho = [phi[0], phi[1], phi[2], phi[3]];
        for (end, at, side) in [(self.left, 0, 1.0), (self.right, MID + 1, -1.0)] {
            let weight: [f64; 4] = std::array::from_fn(|i| side * self.h / 8.0 * rho[i] - sixth * l[i]);
            let (a, cost) = (&end.jets.acceleration, &end.jets.cost);
            let (_, h2) = weighted(&[(weight[2], &a[0]), (weight[3], &a[1]), (sixth * self.scale, cost)]);
            add_block(&mut H, at, &full::<5, 15>(h2));
            let per_time: [f64; 4] = std::array::from_fn(|i| (side / 8.0 * rho[i] - l[i] / 6.0) / self.intervals);
            let by_flow = times_rows(&per_time, &end.F);
            for j in 0..5 {
                cross[at + j] += by_flow[j] + self.scale * cost.d[j] / (6.0 * self.intervals);
            }
        }
        for j in 0..Z {
            H[TIME][j] += cross[j];
            H[j][TIME] += cross[j];
        }
        H
    }
}

/// `rowᵀ D`.
fn pull_back(row: &[f64; 5], D: &[[f64; Z]; 5]) -> [f64; Z] {
    let mut out = [0.0; Z];
    for k in 0..5 {
        for j in 0..Z {
            out[j] += row[k] * D[k][j];
        }
    }
    out
}

/// `Dᵀ H D`.
fn sandwich(H: &[[f64; 5]; 5], D: &[[f64; Z]; 5]) -> [[f64; Z]; Z] {
    let HD: [[f64; Z]; 5] = std::array::from_fn(|i| pull_back(&H[i], D));
    let mut out = [[0.0; Z]; Z];
    for k in 0..5 {
        for i in 0..Z {
            for j in 0..Z {
                out[i][j] += D[k][i] * HD[k][j];
            }
        }
    }
    out
}

fn add_block(H: &mut [[f64; Z]; Z], at: usize, block: &[[f64; 5]; 5]) {
    for i in 0..5 {
        for j in 0..5 {
            H[at + i][at + j] += block[i][j];
        }
    }
}

fn times_rows(weight: &[f64; 4], rows: &[[f64; 5]; 4]) -> [f64; 5] {
    std::array::from_fn(|j| (0..4).map(|i| weight[i] * rows[i][j]).sum())
}

fn add_to(x: &mut [f64; Z], y: &[f64; Z]) {
    x.iter_mut().zip(y).for_each(|(x, y)| *x += y);
}

impl Row {
    fn of_interval(gradient: &[f64; Z]) -> Self {
        let mut out = Self { time: gradient[TIME], ..Self::default() };
        out.before.copy_from_slice(&gradient[..MID]);
        out.own.copy_from_slice(&gradient[MID..TIME]);
        out
    }

    fn of_knot(stage: &Stage, gradient: &[f64; 5]) -> Self {
        let mut out = Self::default();
        out.own[stage.xo..stage.xo + 5].copy_from_slice(gradient);
        out
    }
}
