//! What lies between motor and link, and beyond the link: joint elasticity, play, a structural mode.
//!
//! Each adds one generalised coordinate. The mechanism's inertia stays the total: what sits on the rotor is taken out of
//! the link (the double pendulum's inertias are the links alone, so there nothing is taken out).
//! RT: yes, no allocation.

use crate::base::scalar::Scalar;
use crate::model::mechanism::{Equations, MAX, Row};

/// A motor joined to its link by a spring, by play, or by a spring with play.
#[derive(Clone, Debug)]
pub struct Rotor<S> {
    /// Coordinate of the mechanism that it drives.
    pub joint: usize,
    /// The link's angle in generalised coordinates.
    pub link: Row,
    /// Its own generalised coordinate: rotor angle divided by the gear ratio.
    pub index: usize,
    /// kg m² at the joint.
    pub inertia: S,
    /// True if that inertia is part of the mechanism's.
    pub is_taken_out: bool,
    /// Spring and damper; none = rigid contact across the play.
    pub spring: Option<(S, S)>,
    /// Full play, rad; 0 = none.
    pub gap: S,
}

impl<S: Scalar> Rotor<S> {
    /// Twist: rotor minus link.
    #[inline]
    #[must_use]
    pub fn twist(&self, x: &[S; MAX]) -> S {
        x[self.index] - self.link.of(x)
    }

    /// [`Self::twist`] without derivatives.
    #[inline]
    #[must_use]
    pub fn twist_value(&self, x: &[S; MAX]) -> f64 {
        x[self.index].value() - self.link.value_of(x)
    }

    /// Torque from rotor to link, through the spring.
    #[inline]
    #[must_use]
    pub fn spring_torque(&self, twist: S, twist_rate: S) -> S {
        let Some((stiffness, damping)) = self.spring else { return S::zero() };
        let half = self.gap * 0.5;
        if self.gap.value() <= 0.0 {
            return stiffness * twist + damping * twist_rate;
        }
        if twist.value() > half.value() {
            stiffness * (twist - half) + damping * twist_rate
        } else if twist.value() < -half.value() {
            stiffness * (twist + half) + damping * twist_rate
        } else {
            S::zero()
        }
    }

    /// Row of the rigid contact: the twist's rate.
    #[must_use]
    pub fn contact_row(&self) -> [S; MAX] {
        let mut row = [S::zero(); MAX];
        row[self.index] = S::one();
        self.link.push(-S::one(), &mut row);
        row
    }

    /// Puts the rotor's inertia where it belongs.
    #[inline]
    pub fn add_to(&self, eq: &mut Equations<S>) {
        if self.is_taken_out {
            for &(i, a) in self.link.terms() {
                for &(j, b) in self.link.terms() {
                    eq.mass[i][j] -= self.inertia * (a * b);
                }
            }
        }
        eq.mass[self.index][self.index] = self.inertia;
    }
}

/// A share of a link that hangs on a coaxial spring.
#[derive(Clone, Debug)]
pub struct StructuralMode<S> {
    /// What turns absolutely with the link.
    pub link: Row,
    /// Its own generalised coordinate: deflection relative to the link.
    pub index: usize,
    /// Inertia that hangs on the spring, kg m².
    pub inertia: S,
    /// Nm/rad: inertia · (2π f)², f with the hub held.
    pub stiffness: S,
    /// Nm s/rad.
    pub damping: S,
}

impl<S: Scalar> StructuralMode<S> {
    /// From the keys of the effect and the link's whole inertia.
    #[must_use]
    pub fn new(link: Row, index: usize, whole: S, frequency_hz: S, ratio: S, participation: S) -> Self {
        let w = frequency_hz * std::f64::consts::TAU;
        let inertia = whole * participation;
        Self { link, index, inertia, stiffness: inertia * w * w, damping: inertia * ratio * w * 2.0 }
    }

    /// Inertia and force, `T = ½ I_f ((ω + δ̇)² - ω²)` on top of the rigid link. What hangs on the spring has no weight
    /// of its own here: with it (`V = -G_f (cos(q + δ) - cos q)`) a simulated pendulum's participation is 4 % off instead
    /// of 12 %, but a slow mode at its bounds then passes for the misfit of a geared servo (`bam_xl330`).
    #[inline]
    pub fn add_to(&self, q: &[S; MAX], v: &[S; MAX], eq: &mut Equations<S>) {
        // At zero share the mode has no inertia; a unit one with the same ratios keeps the equations solvable.
        let empty = self.inertia.value() <= 0.0;
        let i = self.index;
        for &(j, a) in self.link.terms() {
            eq.mass[i][j] = self.inertia * a;
            eq.mass[j][i] = self.inertia * a;
        }
        eq.mass[i][i] = if empty { S::one() } else { self.inertia };
        eq.force[i] = -(self.stiffness * q[i]) - self.damping * v[i];
    }
}
