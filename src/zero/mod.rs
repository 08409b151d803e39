//! L3: where each drive's zero is. Between the buses and all who think in joint units. RT: yes, no allocation.
//!
//! The encoders are incremental: a drive that boots counts from wherever it stands, and our own NMT reset may clear the
//! count too. So a zero is lost whenever a drive is set up, and nothing is armed without all of them:
//! - **toes** find theirs at the retracted stop, at limited torque, in mode `Homing`: while the switch is held. Then they
//!   go back to where they stood ([`toe`]);
//! - **the hip's** is confirmed by a person, with the legs aligned (or at an angle that is told), without torque and at
//!   rest.
//!
//! Inside the lines counts are the drive's own; [`Zeros::receive`] and [`Zeros::to_encoders`] are the only places where
//! they meet ours. Limits: a toe that jams on its way to the stop is taken for one that has arrived; the full stroke is
//! not measured.
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

mod hip;
mod toe;

use crate::base::time::Stamp;
use crate::config::checked::{Config, DriveConfig};
use crate::msg::{
    DRIVES, Drive, DriveCommand, DriveCommands, DriveFeedback, DriveFeedbacks, DriveGoal, DriveState, Mode,
    OperatorSample, TOES, ZeroState,
};
use hip::HipZero;
use toe::{ToeRules, ToeZero};

/// Index of the first toe among the drives.
const FIRST_TOE: usize = Drive::InnerToeA as usize;

/// The zeros of all drives.
#[derive(Clone, Debug)]
pub struct Zeros {
    hip: HipZero,
    toes: [ToeZero; TOES],
    full_torque_permille: [i16; DRIVES],
    homing_torque_permille: i16,
}

impl Zeros {
    /// None is known.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let robot = &config.robot;
        let full_torque_permille = robot.drives.each_ref().map(full_torque_permille);
        let homing_torque_permille = permille(robot.toe.homing_torque_permille);
        let [_hip, toes @ ..] = full_torque_permille;
        let toes = toes.map(|full| {
            ToeZero::new(ToeRules::new(&robot.toe, config.real_time.period, [homing_torque_permille, full]))
        });
        Self { hip: HipZero::new(&robot.hip), toes, full_torque_permille, homing_torque_permille }
    }

    /// Turns the drives' own counts into ours, as far as their zeros are known, and says which are. `mode` is the one
    /// after the last tick.
    pub fn receive(&mut self, now: Stamp, operator: &OperatorSample, mode: Mode, feedbacks: &mut DriveFeedbacks) {
        let (hip, toes) = feedbacks.drives.split_at_mut(FIRST_TOE);
        for feedback in hip {
            self.hip.receive(now, operator, mode, feedback);
        }
        for (toe, feedback) in self.toes.iter_mut().zip(toes) {
            toe.receive(mode, feedback);
        }
    }

    /// Adds what homing wants: while it lasts the hip has no power, and the toes follow the search.
    pub fn command(&self, mode: Mode, commands: &mut DriveCommands) {
        for (command, full) in commands.drives.iter_mut().zip(self.full_torque_permille) {
            command.torque_limit_permille = full;
        }
        for (toe, command) in self.toes.iter().zip(commands.drives.iter_mut().skip(FIRST_TOE)) {
            if !toe.wants_full_torque() {
                command.torque_limit_permille = self.homing_torque_permille;
            }
            if mode == Mode::Homing {
                let target = toe.target();
                let (hold, position_counts) = (target.is_none(), target.unwrap_or(0));
                *command = DriveCommand { goal: DriveGoal::Enabled, hold, position_counts, ..*command };
            }
        }
    }

    /// Commands as the drives count.
    #[must_use]
    pub fn to_encoders(&self, commands: &DriveCommands) -> DriveCommands {
        let mut out = *commands;
        for (toe, command) in self.toes.iter().zip(out.drives.iter_mut().skip(FIRST_TOE)) {
            match toe.offset_counts() {
                Some(offset) => command.position_counts = command.position_counts.saturating_add(offset),
                // Without a zero no place can be named: only the search itself may move, in the drive's own counts.
                None => command.hold |= toe.target().is_none(),
            }
        }
        out
    }
}

fn full_torque_permille(drive: &DriveConfig) -> i16 {
    permille(drive.max_torque_permille)
}

fn permille(value: u16) -> i16 {
    i16::try_from(value).unwrap_or(i16::MAX)
}

/// A drive that is being set up, or was lost, has begun or will begin to count anew.
fn has_forgotten(feedback: &DriveFeedback) -> bool {
    matches!(feedback.state, DriveState::Unknown | DriveState::Configuring | DriveState::Lost)
}

/// Puts the count that is ours into the feedback.
fn show(feedback: &mut DriveFeedback, offset_counts: Option<i32>, zero: ZeroState) {
    feedback.position_counts = feedback.position_counts.saturating_sub(offset_counts.unwrap_or(0));
    feedback.zero = zero;
}

#[cfg(test)]
mod tests;
