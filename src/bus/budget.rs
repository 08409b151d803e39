//! Who may use the bus when, and whether it all fits. RT: before arming only.
//!
//! A round is as many SYNCs as the largest divisor. Slow drives answer in phase 0; their commands are spread over the
//! other phases; set-up frames keep out of phase 0; our heartbeat goes out in the last phase.
#![expect(clippy::disallowed_types, reason = "before arming")]

use super::frame::{wire_time_ns, worst_bits};
use super::line::LineError;
use super::line::Slot;
use super::pdo;
use crate::config::checked::{DriveConfig, DriveMode, Robot};
use crate::msg::DRIVES;

/// The timetable of one bus.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// SYNCs per round.
    pub round: u32,
    slots: [Option<Slot>; DRIVES],
}

impl Plan {
    /// Distributes the drives of a bus over the round.
    ///
    /// # Errors
    /// [`LineError`] if nodes or divisors do not go together.
    pub fn new(robot: &Robot, bus: usize) -> Result<Self, LineError> {
        check_nodes(robot, bus)?;
        let on_bus = || robot.drives.iter().enumerate().filter(move |(_, d)| d.bus == bus);
        let largest = on_bus().map(|(_, d)| d.sync_divisor).max().unwrap_or(1).max(1);
        let mut slots = [None; DRIVES];
        let mut next_command = 0;
        for (index, config) in on_bus() {
            let divisor = config.sync_divisor;
            if divisor != 1 && divisor != largest {
                return Err(LineError::Divisor { drive: index, divisor, largest });
            }
            let divisor = u32::from(divisor);
            // Slow commands take phases 1, 2, ... and come back to 1 when the round is short.
            let command = if divisor == 1 { 0 } else { 1 + next_command % (divisor - 1) };
            next_command += u32::from(divisor != 1);
            // A drive that counts from its start command answers at the divisor-th SYNC: start in phase 1.
            let start = 1 % divisor;
            if let Some(slot) = slots.get_mut(index) {
                *slot = Some(Slot { divisor, command, start });
            }
        }
        Ok(Self { round: u32::from(largest), slots })
    }

    /// When the drive with this index is served, if it is on this bus.
    pub(super) fn slot(&self, index: usize) -> Option<Slot> {
        self.slots.get(index).copied().flatten()
    }

    /// Worst case of each phase of the round: every frame that may fall into it, all with the most stuffing.
    /// SYNC, commands and answers of the phase, our heartbeat or a set-up exchange, all drives' heartbeats, an emergency.
    #[must_use]
    pub fn worst_case_us(&self, robot: &Robot, bus: usize) -> Vec<f64> {
        let bitrate = robot.buses.get(bus).map_or(1_000_000, |b| b.bitrate);
        (0..self.round).map(|phase| self.worst_phase_ns(robot, bitrate, phase) * 1e-3).collect()
    }

    #[expect(clippy::cast_precision_loss, reason = "nanoseconds of one cycle")]
    fn worst_phase_ns(&self, robot: &Robot, bitrate: u32, phase: u32) -> f64 {
        let time = |len: u8| wire_time_ns(worst_bits(len, false), bitrate) as f64;
        let (sync, heartbeat, emergency, set_up) = (time(0), time(1), time(8), 2.0 * time(8));
        let mut sum = sync + emergency;
        if self.round == 1 || phase != 0 {
            sum += set_up;
        }
        if phase + 1 == self.round {
            sum += heartbeat;
        }
        for (slot, config) in self.slots.iter().zip(&robot.drives) {
            let Some(slot) = slot else { continue };
            let (command, answer) = lengths(config);
            sum += heartbeat;
            if phase % slot.divisor == slot.command {
                sum += time(command);
            }
            if phase.is_multiple_of(slot.divisor) {
                sum += time(answer);
            }
        }
        sum
    }
}

/// Bytes of command and answer.
fn lengths(config: &DriveConfig) -> (u8, u8) {
    match config.mode {
        DriveMode::CyclicTorque => (pdo::mapped_bytes(pdo::TORQUE_COMMAND), pdo::mapped_bytes(pdo::TORQUE_ANSWER)),
        DriveMode::CyclicPosition => {
            (pdo::mapped_bytes(pdo::POSITION_COMMAND), pdo::mapped_bytes(pdo::POSITION_ANSWER))
        }
    }
}

fn check_nodes(robot: &Robot, bus: usize) -> Result<(), LineError> {
    for (drive, config) in robot.drives.iter().enumerate().filter(|(_, d)| d.bus == bus) {
        if !(1..=126).contains(&config.node) {
            return Err(LineError::Node { drive, node: config.node });
        }
        if robot.drives.iter().take(drive).any(|d| d.bus == bus && d.node == config.node) {
            return Err(LineError::Twice { bus, node: config.node });
        }
    }
    Ok(())
}
