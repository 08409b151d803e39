//! Accelerations of a machine in its present modes, and the RK4 step. RT: yes, no allocation.

use super::contact::{Feet, Ground};
use super::hold::{Held, Holder};
use super::solve::Factor;
use super::{MAX_BRISTLES, Machine, Play};
use crate::base::scalar::Scalar;
use crate::model::effect::actuator::Drive;
use crate::model::effect::drive::{Rotor, StructuralMode};
use crate::model::effect::friction::{Axis, BRISTLE_CREEP, BRISTLE_RATIO, Grip, Load};
use crate::model::mechanism::{Body, Equations, MAX, Mechanism};
use std::ops::Range;

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

    /// Adds the slopes of a stage with their weight, or starts with them.
    #[inline]
    fn gather(&mut self, starts: bool, weight: f64, at: &Self, work: &Work<S>, (n, bristles): (usize, usize)) {
        let add = |sum: &mut S, slope: S| *sum = if starts { slope * weight } else { *sum + slope * weight };
        for i in 0..n {
            add(&mut self.q[i], at.v[i]);
            add(&mut self.v[i], work.a[i]);
        }
        for i in 0..bristles {
            add(&mut self.z[i], work.zdot[i]);
        }
    }

    /// False if a rate is not a number or beyond anything a machine does.
    pub(super) fn is_bounded(&self, n: usize) -> bool {
        self.v.iter().chain(&self.q).take(MAX + n).all(|x| x.value().abs() < FASTEST)
    }
}

/// No joint turns at this rate, rad/s, and no angle gets there.
const FASTEST: f64 = 1e6;

/// Scratch of one evaluation, and its results.
#[derive(Clone, Debug)]
pub struct Work<S> {
    pub(super) eq: Equations<S>,
    /// Forces of the bare mechanism, kept for friction that depends on load.
    bare: [S; MAX],
    factor: Factor<S>,
    /// Accelerations.
    pub(super) a: [S; MAX],
    pub(super) zdot: [S; MAX_BRISTLES],
    pub(super) held: Held<S>,
    /// Dry friction level of each axis.
    pub(super) level: [S; MAX],
    /// Force on the toe's coordinates before the ground acts.
    pub(super) toe_bias: [S; 2],
    /// Coordinates that move as they are told, whatever the forces: toes.
    pub(super) driven: Range<usize>,
}

impl<S: Scalar> Default for Work<S> {
    fn default() -> Self {
        Self {
            eq: Equations::default(),
            bare: [S::zero(); MAX],
            factor: Factor::default(),
            a: [S::zero(); MAX],
            zdot: [S::zero(); MAX_BRISTLES],
            held: Held::default(),
            level: [S::zero(); MAX],
            toe_bias: [S::zero(); 2],
            driven: 0..0,
        }
    }
}

impl<S: Scalar> Work<S> {
    /// Change of rates by an impulse `p` along `row`: `M⁻¹ rowᵀ p`, no constraint acting.
    pub(super) fn kick(&mut self, row: &[S; MAX], n: usize) -> [S; MAX] {
        let mut response = *row;
        self.factor.factor(&self.eq.mass, (0..n).filter(|i| !self.driven.contains(i)));
        self.factor.solve(&mut response);
        for x in &mut response[self.driven.clone()] {
            *x = S::zero();
        }
        response
    }
}

/// Where the scratch holds the accelerations of; whatever changes state, modes or commands makes it nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum FlowOf {
    #[default]
    Nothing,
    /// `y` at `now`.
    Start,
    /// `end`.
    End,
}

/// Intermediate state and weighted sum of a step.
#[derive(Clone, Debug)]
pub(super) struct Stages<S> {
    at: Phase<S>,
    sum: Phase<S>,
}

impl<S: Scalar> Default for Stages<S> {
    fn default() -> Self {
        Self { at: Phase::default(), sum: Phase::default() }
    }
}

/// What moves, and in which mode: all that accelerations depend on, beside the state.
#[derive(Clone, Debug)]
pub(super) struct Plant<S> {
    pub(super) body: Body<S>,
    /// Generalised coordinates of the bare mechanism, and with rotors and modes.
    pub(super) n_body: usize,
    pub(super) n: usize,
    pub(super) bristles: usize,
    /// No bristle yields faster than this, 1/s: what the step resolves.
    pub(super) fastest_yield_1_s: f64,
    /// Some friction depends on what its joint transmits.
    pub(super) is_loaded: bool,
    pub(super) axes: Vec<Axis<S>>,
    pub(super) grips: Vec<Grip>,
    pub(super) rotors: Vec<Rotor<S>>,
    pub(super) plays: Vec<Play>,
    pub(super) structures: Vec<StructuralMode<S>>,
    pub(super) drives: Vec<Drive<S>>,
    pub(super) walks: bool,
    pub(super) ground: Ground<S>,
    pub(super) feet: Feet<S>,
    /// [`Self::stand`] is not used: a test asks for the general equations.
    pub(super) keeps_constraints: bool,
}

impl<S: Scalar> Plant<S> {
    /// Accelerations, bristle rates and forces of constraints at `y`, time `t`, into `work`.
    pub(super) fn flow(&self, y: &Phase<S>, t: S, work: &mut Work<S>) {
        self.body.equations(&y.q, &y.v, &mut work.eq);
        work.held.clear(true);
        self.balance(y, t, work);
    }

    /// [`Self::flow`] without the forces on a toe that stands still.
    fn flow_free(&self, y: &Phase<S>, t: S, work: &mut Work<S>) {
        match &self.body {
            Body::Legs(legs) if self.stands_still() => legs.leg_equations(&y.q, &y.v, &mut work.eq),
            body => body.equations(&y.q, &y.v, &mut work.eq),
        }
        work.held.clear(false);
        self.balance(y, t, work);
    }

    /// Adds all other forces to those of the bare mechanism and solves for the accelerations.
    #[inline]
    fn balance(&self, y: &Phase<S>, t: S, work: &mut Work<S>) {
        if self.is_loaded {
            work.bare = work.eq.force;
        }
        for i in self.n_body..self.n {
            work.eq.force[i] = S::zero();
        }
        for structure in &self.structures {
            structure.add_to(&y.q, &y.v, &mut work.eq);
        }
        self.add_rotors(y, work);
        for drive in &self.drives {
            drive.row.push(self.torque_of(drive, y, t), &mut work.eq.force);
        }
        self.add_axes(y, t, work);
        if self.stands_on_a_point() {
            return self.stand(y, work);
        }
        self.add_toes(work);
        self.add_second_foot(y, work);
        self.add_foot(y, work);
        work.held.accelerate(&work.eq, self.n, &mut work.factor, &mut work.a);
    }

    #[inline]
    fn torque_of(&self, drive: &Drive<S>, y: &Phase<S>, t: S) -> S {
        drive.torque(t, if drive.brakes() { drive.row.of(&y.v) } else { S::zero() })
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
                work.held.along(Holder::Rotor(i), row, row, S::zero());
            }
        }
    }

    fn add_axes(&self, y: &Phase<S>, t: S, work: &mut Work<S>) {
        let mut bristle = 0;
        for (i, axis) in self.axes.iter().enumerate() {
            let rate = axis.row.of(&y.v);
            axis.row.push(axis.smooth_torque(axis.row.of(&y.q), rate), &mut work.eq.force);
            let Some(dry) = &axis.dry else { continue };
            let load = if dry.needs_load() { self.load(axis.joint, y, t, &work.bare) } else { Load::default() };
            let level = dry.level(rate, t, load);
            work.level[i] = level;
            if let Some(stiffness) = dry.bristle {
                let (torque, zdot) = self.bristle(axis.joint, stiffness, y.z[bristle], rate, level);
                axis.row.push(-torque, &mut work.eq.force);
                work.zdot[bristle] = zdot;
                bristle += 1;
            } else if let Some(smooth) = dry.smooth_rate {
                axis.row.push(-(level * (rate / smooth).tanh()), &mut work.eq.force);
            } else if let Some(soft_1_s) = dry.soft_1_s {
                let mut row = [S::zero(); MAX];
                axis.row.push(S::one(), &mut row);
                work.held.softly(Holder::Axis(i), row, rate * soft_1_s, level);
            } else if self.grips[i] == Grip::Stuck {
                if let &[(index, factor)] = axis.row.terms() {
                    work.held.still(Holder::Axis(i), index, factor);
                } else {
                    let mut row = [S::zero(); MAX];
                    axis.row.push(S::one(), &mut row);
                    work.held.along(Holder::Axis(i), row, row, S::zero());
                }
            } else {
                axis.row.push(-(level * self.grips[i].direction()), &mut work.eq.force);
            }
        }
    }

    /// LuGre: torque and rate of the deflection `z`.
    fn bristle(&self, joint: usize, stiffness: S, z: S, rate: S, level: S) -> (S, S) {
        if level.value() <= WEAKEST_NM {
            return (S::zero(), S::zero());
        }
        let yields = stiffness * rate.abs() / level;
        // Faster than a step can follow the bristle is bent to its end within the step, however fast.
        let zdot = if yields.value() < self.fastest_yield_1_s {
            rate - yields * z
        } else {
            (level / stiffness * rate.value().signum() - z) * self.fastest_yield_1_s
        };
        let damping = (stiffness * self.body.link_inertia(joint)).sqrt() * (2.0 * BRISTLE_RATIO);
        let creeps = (-(rate / BRISTLE_CREEP).square()).exp();
        (stiffness * z + damping * creeps * zdot, zdot)
    }

    /// What passes through `joint`.
    fn load(&self, joint: usize, y: &Phase<S>, t: S, bias: &[S; MAX]) -> Load<S> {
        let mut motors = S::zero();
        for drive in self.drives.iter().filter(|d| d.joint == joint) {
            motors += self.torque_of(drive, y, t);
        }
        Load { motors, held: self.body.held_torque(joint, bias) }
    }

    /// One RK4 step of length `h` from `y` at `now` into `end`; modes and commands as they are. `flows`: `work` already
    /// holds the accelerations at `y`.
    pub(super) fn step(
        &self,
        start: (&Phase<S>, S, bool),
        h: S,
        end: &mut Phase<S>,
        stages: &mut Stages<S>,
        work: &mut Work<S>,
    ) {
        // The count known to the compiler: its loops were half of the walker's step.
        match self.n {
            1 => self.step_of::<1>(start, h, end, stages, work),
            2 => self.step_of::<2>(start, h, end, stages, work),
            3 => self.step_of::<3>(start, h, end, stages, work),
            WALKER => self.step_of::<WALKER>(start, h, end, stages, work),
            _ => self.step_of::<0>(start, h, end, stages, work),
        }
    }

    /// Of `N` coordinates, or as many as there are if `N` is 0.
    #[inline]
    fn step_of<const N: usize>(
        &self,
        (y, now, flows): (&Phase<S>, S, bool),
        h: S,
        end: &mut Phase<S>,
        Stages { at, sum }: &mut Stages<S>,
        work: &mut Work<S>,
    ) {
        let (n, bristles) = (if N == 0 { self.n } else { N }, self.bristles);
        // A step without derivatives of its own length, as most are, halves the products.
        let (length, plain) = (h.value(), !h.is_varied());
        let times = |x: S, part: f64| if plain { x * (length * part) } else { x * (h * part) };
        at.copy_from(y, n, bristles);
        for (stage, (reach, weight)) in STAGES.iter().enumerate() {
            if stage > 0 || !flows {
                self.flow_free(at, now + h * TIMES[stage], work);
            }
            sum.gather(stage == 0, *weight, at, work, (n, bristles));
            if stage < 3 {
                for i in 0..n {
                    at.q[i] = y.q[i] + times(at.v[i], *reach);
                    at.v[i] = y.v[i] + times(work.a[i], *reach);
                }
                for i in 0..bristles {
                    at.z[i] = y.z[i] + times(work.zdot[i], *reach);
                }
            }
        }
        for i in 0..n {
            end.q[i] = y.q[i] + times(sum.q[i], 1.0);
            end.v[i] = y.v[i] + times(sum.v[i], 1.0);
        }
        for i in 0..bristles {
            end.z[i] = y.z[i] + times(sum.z[i], 1.0);
        }
    }
}

impl<S: Scalar> Machine<S> {
    /// [`Plant::flow`] at the present state.
    pub(super) fn flow_at_start(&mut self) {
        if self.flow_of != FlowOf::Start {
            self.plant.flow(&self.y, self.now, &mut self.work);
            self.flow_of = FlowOf::Start;
        }
    }

    /// [`Plant::flow`] at the end of a step of length `h`.
    pub(super) fn flow_at_end(&mut self, h: S) {
        self.plant.flow(&self.end, self.now + h, &mut self.work);
        self.flow_of = FlowOf::End;
    }

    /// One step from `y` into `end`, by the machine's scheme.
    pub(super) fn step(&mut self, h: S) {
        if self.euler_step_s.is_some() { self.semi_implicit_euler(h) } else { self.rk4(h) }
    }

    /// Forces at the beginning of the step give the new rates, and these the new positions.
    fn semi_implicit_euler(&mut self, h: S) {
        self.flow_at_start();
        let Self { plant, y, end, work, flow_of, steps, .. } = self;
        *steps += 1;
        for i in 0..plant.n {
            end.v[i] = y.v[i] + work.a[i] * h;
            end.q[i] = y.q[i] + end.v[i] * h;
        }
        for i in 0..plant.bristles {
            end.z[i] = y.z[i] + work.zdot[i] * h;
        }
        // The flow at the start still stands in `work`.
        *flow_of = FlowOf::Start;
    }

    fn rk4(&mut self, h: S) {
        let Self { plant, y, now, end, stages, work, flow_of, steps, .. } = self;
        *steps += 1;
        plant.step((y, *now, *flow_of == FlowOf::Start), h, end, stages, work);
        *flow_of = FlowOf::Nothing;
    }
}

/// Coordinates of a walker with a sprung hip: legs, toe of the stance leg, rotor, lengths of both toes.
const WALKER: usize = 7;
/// Reach of the next stage and weight of this one (Kutta 1901).
const STAGES: [(f64, f64); 4] = [(0.5, 1.0 / 6.0), (0.5, 1.0 / 3.0), (1.0, 1.0 / 3.0), (0.0, 1.0 / 6.0)];
/// When each stage looks.
const TIMES: [f64; 4] = [0.0, 0.5, 0.5, 1.0];
/// A bristle under no more than this Coulomb level holds nothing.
const WEAKEST_NM: f64 = 1e-9;
