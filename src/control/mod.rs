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

mod balance;
mod friction;
mod gains;
mod hold;
pub mod tables;

use crate::base::riccati::RiccatiError;
use crate::base::time::Stamp;
use crate::config::checked::{Config, ControllerKind, Toe};
use crate::msg::{Estimate, JointCommand, Leg, Snapshot, TOES};
use balance::Balance;
use hold::Hold;

pub use gains::{Gain, balance_gain};

/// Why there is no controller for a configuration.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ControllerError {
    /// No LQR gain.
    #[error("no balance gain for the {leg} leg from control.lqr_q and control.lqr_r: {cause}", leg = leg.name())]
    NoGain {
        /// The leg that should stand.
        leg: Leg,
        /// What the solver says.
        cause: RiccatiError,
    },
}

/// The controller of a run.
#[derive(Clone, Debug)]
pub struct Controller {
    law: Law,
    toes: ToeLengths,
}

#[derive(Clone, Debug)]
enum Law {
    Idle,
    Hold(Hold),
    Balance(Balance),
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
            ControllerKind::Balance => Law::Balance(Balance::new(config)?),
        };
        Ok(Self { law, toes: ToeLengths::new(&config.robot.toe) })
    }

    /// Begins anew: on arming.
    pub const fn reset(&mut self, estimate: &Estimate, _snapshot: &Snapshot) {
        if let Law::Hold(hold) = &mut self.law {
            hold.reset(estimate);
        }
    }

    /// Torque and toe lengths for this state. Finite for any finite state; not finite for a state that is not.
    pub fn step(&mut self, now: Stamp, estimate: &Estimate, snapshot: &Snapshot) -> JointCommand {
        let hip_torque_nm = match &self.law {
            Law::Idle => 0.0,
            Law::Hold(hold) => hold.torque_nm(estimate),
            Law::Balance(balance) => balance.torque_nm(estimate, snapshot.late),
        };
        JointCommand { stamp: now, hip_torque_nm, toe_position_m: self.toes.for_stance(estimate.stance) }
    }
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
