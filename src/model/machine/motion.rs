//! Accelerations of a machine in its present modes, and the RK4 step. RT: yes, no allocation.

use super::solve::{Factor, MAX_CONSTRAINTS, solve_small};
use super::{MAX_BRISTLES, Machine, Play};
use crate::base::scalar::Scalar;
use crate::model::effect::friction::{BRISTLE_RATIO, Grip};
use crate::model::mechanism::{Equations, MAX, Mechanism};

/// Continuous state: coordinates, rates, bristle deflections.
#[derive(Clone, Debug)]
pub struct Phase<S> {
    /// Generalised coordinates: mechanism, rotors, structures.
    pub q: [S; MAX],
    /// Their rates.
    pub v: [S; MAX],
    /// Deflection of each bristle, rad.
    pub z: [S; MAX_BRISTLES],
}

impl<S: Scalar> Default for Phase<S> {
    fn default() -> Self {
        Self { q: [S::zero(); MAX], v: [S::zero(); MAX], z: [S::zero(); MAX_BRISTLES] }
    }
}

impl<S: Scalar> Phase<S> {
    /// Takes over the first `n` coordinates and `bristles`; cheaper than a copy of the whole.
    #[inline]
    pub(super) fn copy_from(&mut self, other: &Self, n: usize, bristles: usize) {
        for i in 0..n {
            self.q[i] = other.q[i];
            self.v[i] = other.v[i];
        }
        for i in 0..bristles {
            self.z[i] = other.z[i];
        }
    }

    /// Moves along the flow in `work` for `h`.
    pub(super) fn drift(&mut self, work: &Work<S>, h: S, n: usize, bristles: usize) {
        for i in 0..n {
            self.q[i] += self.v[i] * h;
            self.v[i] += work.a[i] * h;
        }
        for i in 0..bristles {
            self.z[i] += work.zdot[i] * h;
        }
    }

    /// False if a rate is not a number or beyond anything a machine does.
    pub(super) fn is_bounded(&self, n: usize) -> bool {
        self.v.iter().chain(&self.q).take(MAX + n).all(|x| x.value().abs() < FASTEST)
    }
}

/// No joint turns at this rate, rad/s, and no angle gets there.
const FASTEST: f64 = 1e6;

/// Who holds a constraint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Holder {
    Axis(usize),
    Rotor(usize),
    /// Foot, along the ground.
    Tangent,
    /// Foot, normal to the ground.
    Normal,
}

/// `row · a = -bias`, held by a force along `force`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Constraint<S> {
    pub(super) holder: Holder,
    pub(super) row: [S; MAX],
    pub(super) force: [S; MAX],
    pub(super) bias: S,
}

/// Scratch of one evaluation, and its results.
#[derive(Clone, Debug)]
pub struct Work<S> {
    pub(super) eq: Equations<S>,
    pub(super) factor: Factor<S>,
    /// Accelerations.
    pub(super) a: [S; MAX],
    pub(super) zdot: [S; MAX_BRISTLES],
    pub(super) constraints: [Option<Constraint<S>>; MAX_CONSTRAINTS],
    pub(super) held: usize,
    /// Force of each constraint.
    pub(super) lambda: [S; MAX_CONSTRAINTS],
    /// Dry friction level of each axis.
    pub(super) level: [S; MAX],
    /// Force on the toe's coordinates before the ground acts.
    pub(super) toe_bias: [S; 2],
    at: Phase<S>,
    sum: Phase<S>,
}

impl<S: Scalar> Default for Work<S> {
    fn default() -> Self {
        Self {
            eq: Equations::default(),
            factor: Factor::default(),
            a: [S::zero(); MAX],
            zdot: [S::zero(); MAX_BRISTLES],
            constraints: [None; MAX_CONSTRAINTS],
            held: 0,
            lambda: [S::zero(); MAX_CONSTRAINTS],
            level: [S::zero(); MAX],
            toe_bias: [S::zero(); 2],
            at: Phase::default(),
            sum: Phase::default(),
        }
    }
}

impl<S: Scalar> Work<S> {
    pub(super) fn hold(&mut self, constraint: Constraint<S>) {
        if self.held < MAX_CONSTRAINTS {
            self.constraints[self.held] = Some(constraint);
            self.held += 1;
        }
    }

    /// Force of the constraint that `holder` holds.
    pub(super) fn force_of(&self, holder: Holder) -> Option<S> {
        (0..self.held).find(|k| self.constraints[*k].is_some_and(|c| c.holder == holder)).map(|k| self.lambda[k])
    }

    /// Solves `M a = f` with all constraints.
    fn accelerate(&mut self, n: usize) {
        self.a = self.eq.force;
        if n == 1 && self.held == 0 {
            self.a[0] /= self.eq.mass[0][0];
            return;
        }
        self.factor.factor(&self.eq.mass, n);
        self.factor.solve(&mut self.a, n);
        if self.held > 0 {
            self.constrain(n);
        }
    }

    fn constrain(&mut self, n: usize) {
        let k = self.held;
        let mut response = [[S::zero(); MAX]; MAX_CONSTRAINTS];
        let mut gram = [[S::zero(); MAX_CONSTRAINTS]; MAX_CONSTRAINTS];
        let mut rhs = [S::zero(); MAX_CONSTRAINTS];
        for (j, constraint) in self.constraints.iter().take(k).flatten().enumerate() {
            response[j] = constraint.force;
            self.factor.solve(&mut response[j], n);
        }
        for (i, constraint) in self.constraints.iter().take(k).flatten().enumerate() {
            rhs[i] = -constraint.bias - product(&constraint.row, &self.a, n);
            for j in 0..k {
                gram[i][j] = product(&constraint.row, &response[j], n);
            }
        }
        solve_small(&mut gram, &mut rhs, k);
        for j in 0..k {
            self.lambda[j] = rhs[j];
            for i in 0..n {
                self.a[i] += response[j][i] * rhs[j];
            }
        }
    }

    /// Change of rates by an impulse `p` along `row`: `M⁻¹ rowᵀ p`, no constraint acting.
    pub(super) fn kick(&mut self, row: &[S; MAX], n: usize) -> [S; MAX] {
        let mut response = *row;
        self.factor.factor(&self.eq.mass, n);
        self.factor.solve(&mut response, n);
        response
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

impl<S: Scalar> Machine<S> {
    /// Accelerations and bristle rates at `y`, time `t`, into `work`.
    pub(super) fn flow(&self, y: &Phase<S>, t: S, work: &mut Work<S>) {
        self.body.equations(&y.q, &y.v, &mut work.eq);
        let bias = work.eq.force;
        for i in self.n_body..self.n {
            work.eq.force[i] = S::zero();
        }
        work.held = 0;
        for structure in &self.structures {
            structure.add_to(&y.q, &y.v, &mut work.eq);
        }
        self.add_rotors(y, work);
        for drive in &self.drives {
            let torque = drive.torque(t, drive.row.of(&y.v));
            drive.row.push(torque, &mut work.eq.force);
        }
        self.add_axes(y, t, &bias, work);
        self.add_foot(y, work);
        work.accelerate(self.n);
    }

    /// [`Self::flow`] at the present state.
    pub(super) fn flow_at_start(&mut self) {
        let mut work = std::mem::take(&mut self.work);
        self.flow(&self.y, self.now, &mut work);
        self.work = work;
    }

    fn add_rotors(&self, y: &Phase<S>, work: &mut Work<S>) {
        for (i, rotor) in self.rotors.iter().enumerate() {
            rotor.add_to(&mut work.eq);
            if rotor.spring.is_some() {
                let torque = rotor.spring_torque(rotor.twist(&y.q), rotor.twist(&y.v));
                rotor.link.push(torque, &mut work.eq.force);
                work.eq.force[rotor.index] -= torque;
            } else if self.plays[i] != Play::Free {
                let row = rotor.contact_row();
                work.hold(Constraint { holder: Holder::Rotor(i), row, force: row, bias: S::zero() });
            }
        }
    }

    fn add_axes(&self, y: &Phase<S>, t: S, bias: &[S; MAX], work: &mut Work<S>) {
        let mut bristle = 0;
        for (i, axis) in self.axes.iter().enumerate() {
            let rate = axis.row.of(&y.v);
            axis.row.push(axis.smooth_torque(axis.row.of(&y.q), rate), &mut work.eq.force);
            let Some(dry) = &axis.dry else { continue };
            let transmitted = if dry.needs_load() { self.transmitted(axis.joint, y, t, bias) } else { S::zero() };
            let level = dry.level(rate, t, transmitted);
            work.level[i] = level;
            if let Some(stiffness) = dry.bristle {
                let (torque, zdot) = self.bristle(axis.joint, stiffness, y.z[bristle], rate, level);
                axis.row.push(-torque, &mut work.eq.force);
                work.zdot[bristle] = zdot;
                bristle += 1;
            } else if self.grips[i] == Grip::Stuck {
                let mut row = [S::zero(); MAX];
                axis.row.push(S::one(), &mut row);
                work.hold(Constraint { holder: Holder::Axis(i), row, force: row, bias: S::zero() });
            } else {
                axis.row.push(-(level * self.grips[i].direction()), &mut work.eq.force);
            }
        }
    }

    /// LuGre: torque and rate of the deflection `z`.
    fn bristle(&self, joint: usize, stiffness: S, z: S, rate: S, level: S) -> (S, S) {
        let level = if level.value() > WEAKEST_NM { level } else { S::constant(WEAKEST_NM) };
        let zdot = rate - stiffness * rate.abs() * z / level;
        let damping = (stiffness * self.body.link_inertia(joint)).sqrt() * (2.0 * BRISTLE_RATIO);
        (stiffness * z + damping * zdot, zdot)
    }

    /// Mean of the motors' torque on `joint` and of what they hold up.
    fn transmitted(&self, joint: usize, y: &Phase<S>, t: S, bias: &[S; MAX]) -> S {
        let mut motors = S::zero();
        for drive in self.drives.iter().filter(|d| d.joint == joint) {
            motors += drive.torque(t, drive.row.of(&y.v));
        }
        (motors + self.body.held_torque(joint, bias)) * 0.5
    }

    /// One RK4 step of length `h` from `y` into `end`; modes and commands as they are.
    pub(super) fn rk4(&mut self, h: S) {
        let mut work = std::mem::take(&mut self.work);
        let (n, bristles) = (self.n, self.bristles);
        let mut at = std::mem::take(&mut work.at);
        let mut sum = std::mem::take(&mut work.sum);
        at.copy_from(&self.y, n, bristles);
        for i in 0..n {
            sum.q[i] = S::zero();
            sum.v[i] = S::zero();
        }
        for i in 0..bristles {
            sum.z[i] = S::zero();
        }
        for (stage, (reach, weight)) in STAGES.iter().enumerate() {
            self.flow(&at, self.now + h * TIMES[stage], &mut work);
            for i in 0..n {
                sum.q[i] += at.v[i] * *weight;
                sum.v[i] += work.a[i] * *weight;
            }
            for i in 0..bristles {
                sum.z[i] += work.zdot[i] * *weight;
            }
            if stage == 3 {
                break;
            }
            let reach = h * *reach;
            for i in 0..n {
                at.q[i] = self.y.q[i] + at.v[i] * reach;
                at.v[i] = self.y.v[i] + work.a[i] * reach;
            }
            for i in 0..bristles {
                at.z[i] = self.y.z[i] + work.zdot[i] * reach;
            }
        }
        for i in 0..n {
            self.end.q[i] = self.y.q[i] + sum.q[i] * h;
            self.end.v[i] = self.y.v[i] + sum.v[i] * h;
        }
        for i in 0..bristles {
            self.end.z[i] = self.y.z[i] + sum.z[i] * h;
        }
        work.at = at;
        work.sum = sum;
        self.work = work;
    }
}

/// Reach of the next stage and weight of this one (Kutta 1901).
const STAGES: [(f64, f64); 4] = [(0.5, 1.0 / 6.0), (0.5, 1.0 / 3.0), (1.0, 1.0 / 3.0), (0.0, 1.0 / 6.0)];
/// When each stage looks.
const TIMES: [f64; 4] = [0.0, 0.5, 0.5, 1.0];
/// A bristle under no Coulomb level slides under this.
const WEAKEST_NM: f64 = 1e-9;
