//! Torques at one side of a joint that depend on its own angle and rate: damping, springs, ripple, and dry friction.
//!
//! Dry friction is set-valued: the machine keeps a [`Grip`] per axis and locates its changes exactly, so at zero rate it
//! truly holds. With `presliding` it is a bristle (LuGre: an elastic displacement that yields) and has no modes.
//! RT: yes, no allocation.

use crate::base::scalar::Scalar;
use crate::model::mechanism::Row;

/// Mode of dry friction at one axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Grip {
    /// Holds.
    #[default]
    Stuck,
    /// Slides forwards.
    Forward,
    /// Slides backwards.
    Backward,
}

impl Grip {
    /// Direction of sliding: 1, -1, or 0 when stuck.
    #[inline]
    #[must_use]
    pub const fn direction(self) -> f64 {
        match self {
            Self::Stuck => 0.0,
            Self::Forward => 1.0,
            Self::Backward => -1.0,
        }
    }
    /// Sliding in the direction of `rate`; stuck at exactly zero.
    #[must_use]
    pub fn along(rate: f64) -> Self {
        if rate > 0.0 {
            Self::Forward
        } else if rate < 0.0 {
            Self::Backward
        } else {
            Self::Stuck
        }
    }
}

/// Dry friction.
#[derive(Clone, Debug)]
pub struct DryFriction<S> {
    /// Coulomb level, Nm.
    pub coulomb: S,
    /// Stribeck: extra level at rest, Nm, and the rate at which it is down to 1/e, rad/s.
    pub stribeck: Option<(S, S)>,
    /// Level per transmitted torque, if any effect names it.
    pub load: Option<S>,
    /// Level per torque of the motors, if any effect names it: friction on the motor's side of what is transmitted.
    pub motor_load: Option<S>,
    /// Relative growth of the Coulomb level, 1/s, from t = 0 of the recording's clock, if any effect names it.
    pub drift: Option<S>,
    /// Bristle stiffness, Nm/rad; none = rigid sticking.
    pub bristle: Option<S>,
    /// Rate within which its sign changes smoothly, rad/s; none = at zero, where it sticks.
    pub smooth_rate: Option<f64>,
    /// Friction is a soft constraint that stops the joint at this rate, 1/s ([`soft_rate_1_s`]); none = it is not.
    pub soft_1_s: Option<f64>,
}

/// Rate at which MuJoCo's soft constraint with time constant `time_constant_s` stops a joint, 1/s: its damping is `2 / (dmax
/// timeconst)`, with `dmax` as it is by default (MuJoCo documentation, Computation, Reference; `solimp` .9 .95).
#[must_use]
pub fn soft_rate_1_s(time_constant_s: f64) -> f64 {
    2.0 / (0.95 * time_constant_s)
}

/// Part of the force that would hold a joint exactly which MuJoCo's soft constraint gives: `d0` of `solimp`, by default.
pub const SOFT_PART: f64 = 0.9;

impl<S: Scalar> DryFriction<S> {
    /// Level at rate `r` and time `t`, while `through` passes through the joint. Never negative.
    #[inline]
    #[must_use]
    pub fn level(&self, r: S, t: S, through: Load<S>) -> S {
        let mut level = self.coulomb;
        if let Some(drift) = self.drift {
            level *= drift * t + 1.0;
        }
        if let Some((extra, velocity)) = self.stribeck {
            level += extra * (-(r / velocity).square()).exp();
        }
        if let Some(load) = self.load {
            level += load * through.transmitted().abs();
        }
        if let Some(load) = self.motor_load {
            level += load * through.motors.abs();
        }
        if level.value() < 0.0 { S::zero() } else { level }
    }

    /// True if it holds at rest; a bristle, a smooth sign and a soft constraint yield instead.
    #[inline]
    #[must_use]
    pub const fn sticks(&self) -> bool {
        self.bristle.is_none() && self.smooth_rate.is_none() && self.soft_1_s.is_none()
    }

    /// True if the level depends on what the joint transmits.
    #[inline]
    #[must_use]
    pub fn needs_load(&self) -> bool {
        self.load.is_some() || self.motor_load.is_some()
    }
}

/// What passes through a joint, Nm.
///
/// Between motor and link a joint carries the motors' torque less what speeds up the rotor: the motors' whole torque if
/// all inertia sits beyond it, what they hold up if all sits on the rotor. The contract takes the mean, which fits a
/// geared servo (`bam_xl330`: held-out error .085 against .43 and .23 with either alone, reference parameters); a
/// simulated joint without rotor carries the motors' torque (its recordings fit to the noise, 2.1 times it with the mean).
/// On the motor's side (`side = "motor"`) the load is that torque.
#[derive(Clone, Copy, Debug, Default)]
pub struct Load<S> {
    /// Torque of the motors on the joint.
    pub motors: S,
    /// Torque of gravity and coupling that they hold up at rest.
    pub held: S,
}

impl<S: Scalar> Load<S> {
    /// Mean of both.
    #[inline]
    #[must_use]
    pub fn transmitted(&self) -> S {
        (self.motors + self.held) * 0.5
    }
}

/// Damping ratio of a bristle against the inertia it holds. LuGre needs some, or breakaway rings; the contract gives no
/// number. 0.3 is what published LuGre fits of small drives have (0.2 to 0.5).
pub const BRISTLE_RATIO: f64 = 0.3;

/// Rate at which that damping is down to 1/e, rad/s or m/s: damped at every rate, a bristle is not passive and kicks at each
/// reversal (Olsson 1996). The contract gives no number either; the one simulated bristle of another hand runs at its true
/// parameters with a cost of 7400 (noise alone) at .28, 10200 at .2, 17500 without.
pub const BRISTLE_CREEP: f64 = 0.28;

/// A spring beside the joint.
#[derive(Clone, Copy, Debug)]
pub struct Spring<S> {
    /// Nm/rad.
    pub stiffness: S,
    /// Where it is slack, rad.
    pub rest: S,
}

/// Cogging and the like: amplitude · sin(order · q + phase).
#[derive(Clone, Copy, Debug)]
pub struct Ripple<S> {
    /// Nm.
    pub amplitude: S,
    /// Periods per turn.
    pub order: S,
    /// rad.
    pub phase: S,
}

/// All laws at one side of one joint.
#[derive(Clone, Debug)]
pub struct Axis<S> {
    /// The coordinate in generalised ones.
    pub row: Row,
    /// Index of the mechanism's coordinate.
    pub joint: usize,
    /// It is the motor's side of an elastic or loose joint.
    pub is_motor: bool,
    /// Nm s/rad.
    pub viscous: S,
    /// Nm s²/rad², if any effect names it.
    pub quadratic: Option<S>,
    /// Constant torque, Nm; `friction_asymmetry` is exactly minus its difference here, sticking included.
    pub offset: S,
    /// Springs.
    pub springs: Vec<Spring<S>>,
    /// Ripples, one per order.
    pub ripples: Vec<Ripple<S>>,
    /// Dry friction, if any effect names it.
    pub dry: Option<DryFriction<S>>,
}

impl<S: Scalar> Axis<S> {
    /// No law yet.
    #[must_use]
    pub fn new(row: Row, joint: usize, is_motor: bool) -> Self {
        Self {
            row,
            joint,
            is_motor,
            viscous: S::zero(),
            quadratic: None,
            offset: S::zero(),
            springs: Vec::new(),
            ripples: Vec::new(),
            dry: None,
        }
    }

    /// Torque of the smooth laws at angle `q` and rate `r`.
    #[inline]
    #[must_use]
    pub fn smooth_torque(&self, q: S, r: S) -> S {
        let mut torque = self.offset - self.viscous * r;
        if let Some(quadratic) = self.quadratic {
            torque -= quadratic * r * r.abs();
        }
        for spring in &self.springs {
            torque -= spring.stiffness * (q - spring.rest);
        }
        for ripple in &self.ripples {
            torque += ripple.amplitude * (ripple.order * q + ripple.phase).sin();
        }
        torque
    }

    /// False if dry friction holds it in this mode: nothing but a force, unless it is stuck.
    #[inline]
    #[must_use]
    pub fn slides(&self, grip: Grip) -> bool {
        grip != Grip::Stuck || self.dry.as_ref().is_none_or(|dry| !dry.sticks())
    }

    /// True if its dry friction is a soft constraint.
    #[inline]
    #[must_use]
    pub fn is_soft(&self) -> bool {
        self.dry.as_ref().is_some_and(|dry| dry.bristle.is_none() && dry.soft_1_s.is_some())
    }

    /// The dry friction of this axis, made on first use.
    pub fn dry_mut(&mut self) -> &mut DryFriction<S> {
        self.dry.get_or_insert_with(|| DryFriction {
            coulomb: S::zero(),
            stribeck: None,
            load: None,
            motor_load: None,
            drift: None,
            bristle: None,
            smooth_rate: None,
            soft_1_s: None,
        })
    }
}
