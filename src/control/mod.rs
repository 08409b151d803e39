//! L3, room 4: state in, joint torque out.
//!
//! ```text
//!              configuration                 safety (another room) decides when any of this reaches a motor:
//!    ┌──────────────┼──────────────┐         Starting → Disarmed → Arming → Armed → Faulted
//!    v              v              v                                  │
//!  idle           hold          balance                             reset(): a controller begins here
//!  zero torque    spring and    LQR on the leg that stands,         step():  every tick, armed or not, so that the
//!                 damper at     friction compensated                         first armed torque is already right
//!                 the hip
//! ```
//! All controllers are one enumeration (no virtual calls), take an [`Estimate`] stance leg first and answer in the
//! motor's sense: + on the inner leg. The sign by stance leg is applied here and nowhere else.
//! What a controller asks for is not limited: `safety` does that, and tells.
//! RT: yes, no allocation; [`Controller::new`] before arming only.

#![cfg_attr(
    not(test),
    deny(
        clippy::disallowed_methods,
        clippy::disallowed_types,
        clippy::disallowed_macros,
        clippy::expect_used,
        clippy::indexing_slicing
    )
)]

mod asked_speed;
mod balance;
mod catch;
mod compliance;
mod floor;
mod foot_placement;
mod friction;
mod gains;
mod gait;
mod hold;
mod landing;
mod lean;
mod lqr_tree;
mod pendulum;
mod planned;
mod ramp;
mod stance_toe;
mod swing;
pub mod tables;
mod transverse;
pub mod tree;
mod tvlqr;
mod virtual_constraint;
mod walk;

use crate::base::riccati::RiccatiError;
use crate::base::time::Stamp;
use crate::config::checked::{Config, ControllerKind, Toe};
use crate::msg::{ControlState, Estimate, JointCommand, LawName, Leg, Snapshot, TOES};
use balance::Balance;
use foot_placement::Wish;
use gait::Gait;
use hold::Hold;
use lqr_tree::LqrTree;
use walk::Walk;

pub use gains::{Gain, balance_gain};

/// Why there is no controller for a configuration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ControllerError {
    /// No LQR gain.
    #[error("no balance gain for the {leg} leg from control.lqr_q and control.lqr_r: {cause}", leg = leg.name())]
    NoGain {
        /// The leg that should stand.
        leg: Leg,
        /// What the solver says.
        cause: RiccatiError,
    },
    /// The plan of the configuration does not serve the law.
    #[error("control.plan: {cause}")]
    Plan {
        /// Why.
        cause: PlanRefused,
    },
    /// The tree of the configuration does not serve.
    #[error("control.tree: {cause}")]
    Tree {
        /// Why.
        cause: PlanRefused,
    },
}

impl ControllerError {
    /// The key of the configuration that it is about.
    #[must_use]
    pub const fn key(&self) -> &'static str {
        match self {
            Self::NoGain { .. } => "control.lqr_q",
            Self::Plan { .. } => "control.plan",
            Self::Tree { .. } => "control.tree",
        }
    }
}

/// Everything for which there is no controller, not only the first. Before arming only.
#[must_use]
#[expect(clippy::disallowed_types, clippy::disallowed_macros, reason = "before arming")]
pub fn refusals(config: &Config) -> Vec<ControllerError> {
    let (kind, recover) = (config.control.controller, config.control.walk.recover);
    let mut all = vec![];
    if kind == ControllerKind::Balance || kind.walks() {
        all.extend(Balance::new(config).err());
    }
    if kind.walks() {
        all.extend(Gait::new(config).err());
    }
    if kind == ControllerKind::LqrTree || kind.walks() && recover {
        // It balances too: a gain that is missing was said already.
        all.extend(LqrTree::new(config).err().filter(|error| !all.contains(error)));
    }
    all
}

/// Why a plan is refused, in words. Before arming only.
#[expect(clippy::disallowed_types, reason = "before arming")]
pub type PlanRefused = String;

/// The controller of a run.
#[derive(Clone, Debug)]
pub struct Controller {
    law: Law,
    toes: ToeLengths,
    state: ControlState,
}

#[derive(Clone, Debug)]
enum Law {
    Idle,
    Hold(Hold),
    Balance(Box<Balance>),
    Walk(Box<Walk>),
    Tree(Box<LqrTree>),
}

impl Controller {
    /// The configured one, gains computed from the model. Before arming only.
    ///
    /// # Errors
    /// [`ControllerError`] when the model and the weights give no gain.
    pub fn new(config: &Config) -> Result<Self, ControllerError> {
        let law = match config.control.controller {
            ControllerKind::Idle => Law::Idle,
            ControllerKind::Hold => Law::Hold(Hold::new(&config.control)),
            ControllerKind::Balance => Law::Balance(new_balance(config)?),
            ControllerKind::LqrTree => Law::Tree(new_tree(config)?),
            ControllerKind::Walk
            | ControllerKind::VirtualConstraint
            | ControllerKind::Transverse
            | ControllerKind::Tvlqr => Law::Walk(new_walk(config)?),
        };
        Ok(Self { law, toes: ToeLengths::new(&config.robot.toe), state: ControlState::default() })
    }

    /// What it has been doing in the last step.
    #[must_use]
    pub const fn state(&self) -> &ControlState {
        &self.state
    }

    /// Begins anew: on arming.
    pub fn reset(&mut self, now: Stamp, estimate: &Estimate) {
        match &mut self.law {
            Law::Hold(hold) => hold.reset(estimate),
            Law::Walk(walk) => walk.reset(now, estimate),
            Law::Tree(tree) => tree.reset(now, estimate),
            Law::Idle | Law::Balance(_) => {}
        }
    }

    /// Torque and toe lengths for this state. Finite for any finite state; not finite for a state that is not.
    pub fn step(&mut self, now: Stamp, estimate: &Estimate, snapshot: &Snapshot) -> JointCommand {
        let (hip_torque_nm, law) = match &mut self.law {
            Law::Idle => (0.0, LawName::Idle),
            Law::Hold(hold) => (hold.torque_nm(estimate), LawName::Hold),
            Law::Balance(balance) => (balance.torque_nm(estimate, snapshot.late, 0.0), LawName::Balance),
            Law::Walk(walk) => {
                let answer = walk.step(now, estimate, snapshot);
                return self.answered(now, answer);
            }
            Law::Tree(tree) => {
                let answer = tree.step(now, estimate, snapshot);
                return self.answered(now, answer);
            }
        };
        self.state = ControlState { stamp: now, law, ..ControlState::default() };
        JointCommand { stamp: now, hip_torque_nm, toe_position_m: self.toes.for_stance(estimate.stance) }
    }

    /// Of a law that says itself what it is about.
    const fn answered(&mut self, now: Stamp, (wish, state): (Wish, ControlState)) -> JointCommand {
        self.state = state;
        let Wish { hip_torque_nm, toe_position_m, .. } = wish;
        JointCommand { stamp: now, hip_torque_nm, toe_position_m }
    }
}

#[expect(clippy::disallowed_methods, reason = "before arming")]
fn new_balance(config: &Config) -> Result<Box<Balance>, ControllerError> {
    Ok(Box::new(Balance::new(config)?))
}

#[expect(clippy::disallowed_methods, reason = "before arming")]
fn new_tree(config: &Config) -> Result<Box<LqrTree>, ControllerError> {
    Ok(Box::new(LqrTree::new(config)?))
}

#[expect(clippy::disallowed_methods, reason = "before arming")]
fn new_walk(config: &Config) -> Result<Box<Walk>, ControllerError> {
    Ok(Box::new(Walk::new(config)?))
}

/// Toe lengths of the leg that stands and of the one that swings.
#[derive(Clone, Copy, Debug)]
struct ToeLengths {
    stance_m: f64,
    swing_m: f64,
}

impl ToeLengths {
    const fn new(toe: &Toe) -> Self {
        Self { stance_m: toe.extended_m, swing_m: toe.retracted_m }
    }

    const fn for_stance(self, stance: Leg) -> [f64; TOES] {
        let (out, back) = (self.stance_m, self.swing_m);
        match stance {
            Leg::Inner => [out, out, back, back],
            Leg::Outer => [back, back, out, out],
        }
    }
}

/// Sign from a torque + on the stance row to the motor's + on inner.
const fn motor_sign(stance: Leg) -> f64 {
    match stance {
        Leg::Inner => 1.0,
        Leg::Outer => -1.0,
    }
}

#[cfg(test)]
mod tests;
