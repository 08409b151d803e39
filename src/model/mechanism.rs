//! Bare mechanisms behind one trait: mass matrix and bias force, in SI, without friction, motors or effects.
//!
//! RT: yes, no allocation.

mod legs;

use crate::base::scalar::Scalar;

pub use legs::{Freedom, Legs};

/// Most generalised coordinates of any machine: two legs, toe x and y, one rotor, three structural modes.
pub const MAX: usize = 8;

/// `M q̈ = force`, without inputs. Only the first `dof` rows and columns mean something.
#[derive(Clone, Debug)]
pub struct Equations<S> {
    /// Mass matrix M.
    pub mass: [[S; MAX]; MAX],
    /// -C q̇ - G.
    pub force: [S; MAX],
    /// Sine and cosine of the stance leg's angle to the ground's normal; of [`Freedom::Floating`] legs only.
    pub stance: (S, S),
}

impl<S: Scalar> Default for Equations<S> {
    fn default() -> Self {
        Self { mass: [[S::zero(); MAX]; MAX], force: [S::zero(); MAX], stance: (S::zero(), S::one()) }
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
    #[inline]
    #[must_use]
    pub const fn one(i: usize, factor: f64) -> Self {
        Self { terms: [(i, factor), (0, 0.0)], len: 1 }
    }
    /// `q[i] - q[j]`, or with other factors.
    #[inline]
    #[must_use]
    pub const fn two(i: usize, fi: f64, j: usize, fj: f64) -> Self {
        Self { terms: [(i, fi), (j, fj)], len: 2 }
    }
    /// True if it cannot move.
    #[inline]
    #[must_use]
    pub const fn is_none(&self) -> bool {
        self.len == 0
    }
    /// Its terms.
    #[inline]
    #[must_use]
    pub fn terms(&self) -> &[(usize, f64)] {
        self.terms.get(..self.len).unwrap_or_default()
    }
    /// Its value for generalised coordinates (or rates) `x`.
    #[inline(always)]
    #[must_use]
    pub fn of<S: Scalar>(&self, x: &[S; MAX]) -> S {
        match self.len {
            0 => S::zero(),
            1 => times(x[self.terms[0].0], self.terms[0].1),
            _ => match self.terms[1].1 {
                // Differences are the rule, and cheaper than sums of products.
                -1.0 => times(x[self.terms[0].0], self.terms[0].1) - x[self.terms[1].0],
                factor => times(x[self.terms[0].0], self.terms[0].1) + x[self.terms[1].0] * factor,
            },
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
            match self.terms[k].1 {
                -1.0 => force[self.terms[k].0] -= torque,
                factor => force[self.terms[k].0] += times(torque, factor),
            }
        }
    }
}

/// `x` times a factor that is 1 as a rule.
#[inline]
fn times<S: Scalar>(x: S, factor: f64) -> S {
    match factor {
        1.0 => x,
        -1.0 => -x,
        _ => x * factor,
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
    #[inline]
    fn dof(&self) -> usize {
        1
    }
    #[inline]
    fn row(&self, _joint: usize) -> Row {
        Row::one(0, 1.0)
    }
    #[inline]
    fn link_inertia(&self, _joint: usize) -> S {
        self.inertia
    }
    #[inline]
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
    #[inline]
    fn dof(&self) -> usize {
        1
    }
    #[inline]
    fn row(&self, _joint: usize) -> Row {
        Row::one(0, 1.0)
    }
    #[inline]
    fn link_inertia(&self, _joint: usize) -> S {
        self.mass
    }
    #[inline]
    fn held_torque(&self, _joint: usize, force: &[S; MAX]) -> S {
        -force[0]
    }
    #[inline]
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
    #[inline]
    fn dof(&self) -> usize {
        2
    }
    #[inline]
    fn row(&self, joint: usize) -> Row {
        Row::one(joint, 1.0)
    }
    fn absolute_row(&self, joint: usize) -> Row {
        if joint == 0 { Row::one(0, 1.0) } else { Row::two(0, 1.0, 1, 1.0) }
    }
    #[inline]
    fn link_inertia(&self, joint: usize) -> S {
        if joint == 0 { self.inertia1 } else { self.inertia2 }
    }
    fn holds_rotor(&self) -> bool {
        false
    }
    #[inline]
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
    #[inline]
    fn dof(&self) -> usize {
        each!(self, m => m.dof())
    }
    #[inline]
    fn row(&self, joint: usize) -> Row {
        each!(self, m => m.row(joint))
    }
    fn absolute_row(&self, joint: usize) -> Row {
        each!(self, m => m.absolute_row(joint))
    }
    #[inline]
    fn link_inertia(&self, joint: usize) -> S {
        each!(self, m => m.link_inertia(joint))
    }
    fn holds_rotor(&self) -> bool {
        each!(self, m => m.holds_rotor())
    }
    #[inline]
    fn held_torque(&self, joint: usize, force: &[S; MAX]) -> S {
        each!(self, m => m.held_torque(joint, force))
    }
    #[inline]
    fn equations(&self, q: &[S; MAX], v: &[S; MAX], out: &mut Equations<S>) {
        each!(self, m => m.equations(q, v, out))
    }
}
