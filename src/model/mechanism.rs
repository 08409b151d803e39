//! Bare mechanisms behind one trait: mass matrix and bias force, in SI, without friction, motors or effects.
//!
//! RT: yes, no allocation.

use super::compass_gait::dynamics::{bias_at, mass_matrix_at};
use super::compass_gait::floating::{centripetal, momentum_rows};
use super::compass_gait::kinematics::Trig;
use super::compass_gait::params::{Normalised, Params};
use super::rig::Setup;
use crate::base::scalar::Scalar;

/// Most generalised coordinates of any machine: two legs, toe x and y, one rotor, three structural modes.
pub const MAX: usize = 8;

/// `M q̈ = force`, without inputs. Only the first `dof` rows and columns mean something.
#[derive(Clone, Debug)]
pub struct Equations<S> {
    /// Mass matrix M.
    pub mass: [[S; MAX]; MAX],
    /// -C q̇ - G.
    pub force: [S; MAX],
}

impl<S: Scalar> Default for Equations<S> {
    fn default() -> Self {
        Self { mass: [[S::zero(); MAX]; MAX], force: [S::zero(); MAX] }
    }
}

/// A coordinate as a combination of generalised coordinates: at most two of them, constant factors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    terms: [(usize, f64); 2],
    len: usize,
}

impl Row {
    /// Does not move at all (a held leg).
    pub const NONE: Self = Self { terms: [(0, 0.0); 2], len: 0 };

    /// Generalised coordinate `i` times `factor`.
    #[must_use]
    pub const fn one(i: usize, factor: f64) -> Self {
        Self { terms: [(i, factor), (0, 0.0)], len: 1 }
    }
    /// `q[i] - q[j]`, or with other factors.
    #[must_use]
    pub const fn two(i: usize, fi: f64, j: usize, fj: f64) -> Self {
        Self { terms: [(i, fi), (j, fj)], len: 2 }
    }
    /// True if it cannot move.
    #[must_use]
    pub const fn is_none(&self) -> bool {
        self.len == 0
    }
    /// Its terms.
    #[must_use]
    pub fn terms(&self) -> &[(usize, f64)] {
        self.terms.get(..self.len).unwrap_or_default()
    }
    /// Its value for generalised coordinates (or rates) `x`.
    #[inline]
    #[must_use]
    pub fn of<S: Scalar>(&self, x: &[S; MAX]) -> S {
        match self.len {
            0 => S::zero(),
            1 => x[self.terms[0].0] * self.terms[0].1,
            _ => x[self.terms[0].0] * self.terms[0].1 + x[self.terms[1].0] * self.terms[1].1,
        }
    }
    /// [`Self::of`] without derivatives.
    #[inline]
    #[must_use]
    pub fn value_of<S: Scalar>(&self, x: &[S; MAX]) -> f64 {
        self.terms().iter().map(|(i, factor)| x[*i].value() * factor).sum()
    }
    /// Adds a torque on the coordinate to the generalised force.
    #[inline]
    pub fn push<S: Scalar>(&self, torque: S, force: &mut [S; MAX]) {
        for k in 0..self.len {
            force[self.terms[k].0] += torque * self.terms[k].1;
        }
    }
}

/// A machine as equations. Coordinates `q` and rates `v` generalised, SI.
pub trait Mechanism<S: Scalar> {
    /// Number of generalised coordinates.
    fn dof(&self) -> usize;
    /// Named coordinate `joint` in generalised ones.
    fn row(&self, joint: usize) -> Row;
    /// What turns absolutely with the link behind coordinate `joint`: what a structure hung on it feels.
    fn absolute_row(&self, joint: usize) -> Row {
        self.row(joint)
    }
    /// Inertia of the link behind coordinate `joint`, kg m² (or kg).
    fn link_inertia(&self, joint: usize) -> S;
    /// True if that inertia contains the rotor of the joint's motor.
    fn holds_rotor(&self) -> bool {
        true
    }
    /// Torque of gravity and coupling that the motor of `joint` holds up at rest; `force` from [`Self::equations`].
    fn held_torque(&self, joint: usize, force: &[S; MAX]) -> S;
    /// Mass matrix and bias.
    fn equations(&self, q: &[S; MAX], v: &[S; MAX], out: &mut Equations<S>);
}

/// One link on a pivot: `I q̈ = -m g l_c sin q`.
#[derive(Clone, Debug)]
pub struct Pendulum<S> {
    /// About the joint, kg m², rotor included.
    pub inertia: S,
    /// m g l_c, Nm.
    pub gravity: S,
}

impl<S: Scalar> Mechanism<S> for Pendulum<S> {
    fn dof(&self) -> usize {
        1
    }
    fn row(&self, _joint: usize) -> Row {
        Row::one(0, 1.0)
    }
    fn link_inertia(&self, _joint: usize) -> S {
        self.inertia
    }
    fn held_torque(&self, _joint: usize, force: &[S; MAX]) -> S {
        -force[0]
    }
    #[inline]
    fn equations(&self, q: &[S; MAX], _v: &[S; MAX], out: &mut Equations<S>) {
        out.mass[0][0] = self.inertia;
        // A plain rotor needs no sine, unless gravity itself is differentiated.
        out.force[0] = if self.gravity == S::zero() && !self.gravity.is_varied() {
            S::zero()
        } else {
            -(self.gravity * q[0].sin())
        };
    }
}

/// A mass on a rail.
#[derive(Clone, Debug)]
pub struct Slider<S> {
    /// kg.
    pub mass: S,
}

impl<S: Scalar> Mechanism<S> for Slider<S> {
    fn dof(&self) -> usize {
        1
    }
    fn row(&self, _joint: usize) -> Row {
        Row::one(0, 1.0)
    }
    fn link_inertia(&self, _joint: usize) -> S {
        self.mass
    }
    fn held_torque(&self, _joint: usize, force: &[S; MAX]) -> S {
        -force[0]
    }
    fn equations(&self, _q: &[S; MAX], _v: &[S; MAX], out: &mut Equations<S>) {
        out.mass[0][0] = self.mass;
        out.force[0] = S::zero();
    }
}

/// Two links; `q2` relative to link 1. Standard manipulator form (Spong, Hutchinson, Vidyasagar, section 7.3).
#[derive(Clone, Debug)]
pub struct DoublePendulum<S> {
    /// Link 1 about joint 1, kg m².
    pub inertia1: S,
    /// Link 2 about joint 2, kg m².
    pub inertia2: S,
    /// m1 lc1, kg m.
    pub moment1: S,
    /// m2 lc2, kg m.
    pub moment2: S,
    /// m2, kg.
    pub mass2: S,
    /// Joint 1 to joint 2, m.
    pub length1: S,
    /// m/s².
    pub gravity: S,
}

impl<S: Scalar> Mechanism<S> for DoublePendulum<S> {
    fn dof(&self) -> usize {
        2
    }
    fn row(&self, joint: usize) -> Row {
        Row::one(joint, 1.0)
    }
    fn absolute_row(&self, joint: usize) -> Row {
        if joint == 0 { Row::one(0, 1.0) } else { Row::two(0, 1.0, 1, 1.0) }
    }
    fn link_inertia(&self, joint: usize) -> S {
        if joint == 0 { self.inertia1 } else { self.inertia2 }
    }
    fn holds_rotor(&self) -> bool {
        false
    }
    fn held_torque(&self, joint: usize, force: &[S; MAX]) -> S {
        -force[joint]
    }
    #[inline]
    fn equations(&self, q: &[S; MAX], v: &[S; MAX], out: &mut Equations<S>) {
        let (s2, c2) = q[1].sin_cos();
        let coupling = self.length1 * self.moment2;
        let m12 = self.inertia2 + coupling * c2;
        out.mass[0][0] = self.inertia1 + self.inertia2 + self.mass2 * self.length1 * self.length1 + coupling * c2 * 2.0;
        out.mass[0][1] = m12;
        out.mass[1][0] = m12;
        out.mass[1][1] = self.inertia2;
        let h = coupling * s2;
        let (s1, s12) = (q[0].sin(), (q[0] + q[1]).sin());
        let g2 = self.gravity * self.moment2 * s12;
        let g1 = self.gravity * (self.moment1 + self.mass2 * self.length1) * s1 + g2;
        out.force[0] = h * (v[0] * 2.0 + v[1]) * v[1] - g1;
        out.force[1] = -(h * v[0] * v[0]) - g2;
    }
}

/// How the compass gait's legs are free to move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Freedom {
    /// Both legs about the pinned stance toe: coordinates inner, outer.
    Pinned,
    /// One leg held at 0, the other swings: its angle only.
    Held,
    /// Both legs as one.
    Together,
    /// Both legs and the stance toe: inner, outer, toe x and y in m (x along the ground, y normal to it).
    Floating,
}

/// The compass gait in SI, coordinates named by leg; which leg stands is a switch.
#[derive(Clone, Debug)]
pub struct Legs<S> {
    /// Inner leg standing, outer leg standing.
    normalised: [Normalised<S>; 2],
    /// `m_t l²`, `m_t l`, `m_t`, l, g.
    unit: S,
    moment: S,
    mass: S,
    length: S,
    gravity: S,
    /// 0 inner, 1 outer.
    stance: usize,
    freedom: Freedom,
    /// Upward force at the hip, N.
    counterweight: S,
    /// Angle of the ground, + falls towards +x.
    slope: S,
}

impl<S: Scalar> Legs<S> {
    /// From the parameters in the order of the rig.
    #[must_use]
    pub fn new(parameters: &[S], setup: Setup, floats: bool, counterweight: S, slope: S) -> Option<Self> {
        let [length, mass, gravity, c1, c2, c3, c4, c5, c6] = *parameters else { return None };
        let params = Params {
            c: [c1, c2, c3, c4, c5, c6],
            leg_length_m: length,
            total_mass_kg: mass,
            gravity_m_s2: gravity,
            viscous_nm_s_rad: S::zero(),
            coulomb_nm: S::zero(),
        };
        let stance = usize::from(matches!(setup, Setup::OuterStance | Setup::OuterFixed));
        let freedom = match setup {
            Setup::InnerFixed | Setup::OuterFixed => Freedom::Held,
            Setup::Parallel => Freedom::Together,
            _ if floats => Freedom::Floating,
            _ => Freedom::Pinned,
        };
        Some(Self {
            normalised: [params.normalised(), params.swapped().normalised()],
            unit: params.inertia_kg_m2(),
            moment: params.mass_moment_kg_m(),
            mass,
            length,
            gravity,
            stance,
            freedom,
            counterweight,
            slope,
        })
    }

    /// The standing leg, 0 inner, 1 outer.
    #[must_use]
    pub const fn stance(&self) -> usize {
        self.stance
    }
    /// Puts the robot on the other leg, or back.
    pub const fn set_stance(&mut self, leg: usize) {
        self.stance = if leg == 0 { 0 } else { 1 };
    }
    /// How it is free to move.
    #[must_use]
    pub const fn freedom(&self) -> Freedom {
        self.freedom
    }
    /// Parameters with the standing leg first.
    #[must_use]
    pub const fn standing(&self) -> &Normalised<S> {
        &self.normalised[self.stance]
    }
    /// Leg length, m.
    #[must_use]
    pub const fn length(&self) -> S {
        self.length
    }
    /// Total mass, kg.
    #[must_use]
    pub const fn mass(&self) -> S {
        self.mass
    }
    /// `m_t l²`, kg m².
    #[must_use]
    pub const fn unit(&self) -> S {
        self.unit
    }
    /// `m_t l`, kg m.
    #[must_use]
    pub const fn moment(&self) -> S {
        self.moment
    }
    /// Gravity, m/s².
    #[must_use]
    pub const fn gravity(&self) -> S {
        self.gravity
    }
    /// Angle of the ground.
    #[must_use]
    pub const fn slope(&self) -> S {
        self.slope
    }

    /// Mass matrix and -(C q̇ + G), stance leg first, with the counterweight's pull at the hip.
    fn pinned(&self, qs: S, qw: S, vs: S, vw: S) -> ([[S; 2]; 2], [S; 2], Trig<S>) {
        let p = self.standing();
        let t = Trig::new([qs, qw]);
        let (h, bias) = (mass_matrix_at(p, &t), bias_at(p, &t, [vs, vw]));
        let mass = [[h[0][0] * self.unit, h[0][1] * self.unit], [h[1][0] * self.unit, h[1][1] * self.unit]];
        // The hip is at l (-sin θs, cos θs) from the stance toe: a force upward turns the stance leg by -F l sin θs.
        let pull = -(self.counterweight * self.length * t.stance.0);
        (mass, [-(bias[0] * self.unit) + pull, -(bias[1] * self.unit)], t)
    }

    /// Rows and columns of the toe, in axes along and normal to the ground.
    fn add_toe(&self, t: &Trig<S>, v: [S; 2], out: &mut Equations<S>) {
        let p = self.standing();
        let (rows, b) = (momentum_rows(p, t), centripetal(p, t, v));
        // (x along the falling ground, y normal): unit vectors (cos α, -sin α), (sin α, cos α).
        let (sa, ca) = self.slope.sin_cos();
        let turn = |x: S, y: S| [x * ca - y * sa, x * sa + y * ca];
        let weight = self.counterweight - self.mass * self.gravity;
        let force = turn(-(b[0] * self.moment), weight - b[1] * self.moment);
        let (s, w) = (self.stance, 1 - self.stance);
        let (js, jw) = (turn(rows[0][0], rows[1][0]), turn(rows[0][1], rows[1][1]));
        for k in 0..2 {
            out.mass[s][2 + k] = js[k] * self.moment;
            out.mass[2 + k][s] = out.mass[s][2 + k];
            out.mass[w][2 + k] = jw[k] * self.moment;
            out.mass[2 + k][w] = out.mass[w][2 + k];
            out.force[2 + k] = force[k];
        }
        out.mass[2][2] = self.mass;
        out.mass[3][3] = self.mass;
        out.mass[2][3] = S::zero();
        out.mass[3][2] = S::zero();
    }
}

impl<S: Scalar> Mechanism<S> for Legs<S> {
    fn dof(&self) -> usize {
        match self.freedom {
            Freedom::Held | Freedom::Together => 1,
            Freedom::Pinned => 2,
            Freedom::Floating => 4,
        }
    }
    fn row(&self, joint: usize) -> Row {
        match (self.freedom, joint) {
            (Freedom::Together, 0 | 1) => Row::one(0, 1.0),
            (Freedom::Together, _) => Row::NONE,
            // The held leg is the "standing" one.
            (Freedom::Held, 0 | 1) if joint == self.stance => Row::NONE,
            (Freedom::Held, 0 | 1) => Row::one(0, 1.0),
            (Freedom::Held, _) => Row::one(0, if self.stance == 1 { 1.0 } else { -1.0 }),
            (_, 0 | 1) => Row::one(joint, 1.0),
            _ => Row::two(0, 1.0, 1, -1.0),
        }
    }
    fn link_inertia(&self, joint: usize) -> S {
        let c = self.normalised[0].c;
        let leg = if joint == 1 { c[1] } else { c[0] };
        (leg - c[2]) * self.unit
    }
    fn held_torque(&self, joint: usize, force: &[S; MAX]) -> S {
        match (self.freedom, joint) {
            (Freedom::Held, _) => self.row(joint).of(&{
                let mut f = [S::zero(); MAX];
                f[0] = -force[0];
                f
            }),
            (Freedom::Together, _) => S::zero(),
            // The hip holds up the swing leg.
            _ if self.stance == 0 => force[1],
            _ => -force[0],
        }
    }
    #[inline]
    fn equations(&self, q: &[S; MAX], v: &[S; MAX], out: &mut Equations<S>) {
        let (s, w) = (self.stance, 1 - self.stance);
        match self.freedom {
            Freedom::Held => {
                let (mass, force, _) = self.pinned(S::zero(), q[0], S::zero(), v[0]);
                out.mass[0][0] = mass[1][1];
                out.force[0] = force[1];
            }
            Freedom::Together => {
                let (mass, force, _) = self.pinned(q[0], q[0], v[0], v[0]);
                out.mass[0][0] = mass[0][0] + mass[0][1] * 2.0 + mass[1][1];
                out.force[0] = force[0] + force[1];
            }
            Freedom::Pinned | Freedom::Floating => {
                let (mass, force, t) = self.pinned(q[s], q[w], v[s], v[w]);
                out.mass[s][s] = mass[0][0];
                out.mass[s][w] = mass[0][1];
                out.mass[w][s] = mass[0][1];
                out.mass[w][w] = mass[1][1];
                out.force[s] = force[0];
                out.force[w] = force[1];
                if self.freedom == Freedom::Floating {
                    self.add_toe(&t, [v[s], v[w]], out);
                }
            }
        }
    }
}

/// Any of them, dispatched without allocation.
#[derive(Clone, Debug)]
pub enum Body<S> {
    /// See [`Pendulum`].
    Pendulum(Pendulum<S>),
    /// See [`Slider`].
    Slider(Slider<S>),
    /// See [`DoublePendulum`].
    DoublePendulum(DoublePendulum<S>),
    /// See [`Legs`].
    Legs(Legs<S>),
}

macro_rules! each {
    ($self:ident, $m:ident => $call:expr) => {
        match $self {
            Body::Pendulum($m) => $call,
            Body::Slider($m) => $call,
            Body::DoublePendulum($m) => $call,
            Body::Legs($m) => $call,
        }
    };
}

impl<S: Scalar> Mechanism<S> for Body<S> {
    fn dof(&self) -> usize {
        each!(self, m => m.dof())
    }
    fn row(&self, joint: usize) -> Row {
        each!(self, m => m.row(joint))
    }
    fn absolute_row(&self, joint: usize) -> Row {
        each!(self, m => m.absolute_row(joint))
    }
    fn link_inertia(&self, joint: usize) -> S {
        each!(self, m => m.link_inertia(joint))
    }
    fn holds_rotor(&self) -> bool {
        each!(self, m => m.holds_rotor())
    }
    fn held_torque(&self, joint: usize, force: &[S; MAX]) -> S {
        each!(self, m => m.held_torque(joint, force))
    }
    #[inline]
    fn equations(&self, q: &[S; MAX], v: &[S; MAX], out: &mut Equations<S>) {
        each!(self, m => m.equations(q, v, out))
    }
}
