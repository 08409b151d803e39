//! Who may use the bus when, and whether it all fits. RT: before arming only.
//!
//! A round is as many SYNCs as the largest divisor. Slow drives answer in phase 0. The commands of both toes of a leg go out
//! in one phase, so that they take effect at the same SYNC: one toe that goes ahead would carry the leg alone. Set-up frames
//! keep out of these phases and of phase 0; our heartbeat goes out in the last phase.
#![expect(clippy::disallowed_types, reason = "before arming")]

use super::line::LineError;
use super::line::Slot;
use crate::base::can_time::{BitRates, FrameKind};
use crate::config::checked::{BusConfig, DriveConfig, DriveProtocol, Robot};
use crate::msg::DRIVES;

/// The timetable of one bus.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// SYNCs per round.
    pub round: u32,
    /// Some drive is CANopen: SYNC, heartbeats, emergencies.
    canopen: bool,
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
        let mut pairs = Pairs::default();
        for (index, config) in on_bus() {
            let divisor = config.sync_divisor;
            if divisor != 1 && divisor != largest {
                return Err(LineError::Divisor { drive: index, divisor, largest });
            }
            let divisor = u32::from(divisor);
            // Phase 1 is for NMT start, phases 2, 3, ... for a leg each, as far as the round has them.
            let command = match divisor {
                1 => 0,
                2 => 1,
                _ => 2 + pairs.number(index) % (divisor - 2),
            };
            // A drive that counts from its start command answers at the divisor-th SYNC: start in phase 1.
            let start = 1 % divisor;
            if let Some(slot) = slots.get_mut(index) {
                *slot = Some(Slot { divisor, command, start });
            }
        }
        let canopen = on_bus().any(|(_, d)| d.is_canopen());
        Ok(Self { round: u32::from(largest), canopen, slots })
    }

    /// When the drive with this index is served, if it is on this bus.
    pub(super) fn slot(&self, index: usize) -> Option<Slot> {
        self.slots.get(index).copied().flatten()
    }

    /// Whether a frame of the set-up may go out in this phase: not with the answers of the slow drives, nor with the
    /// commands of two of them, unless the round is too short for anything else.
    pub(super) fn allows_setup(&self, phase: u32) -> bool {
        let slow = |slot: &&Slot| slot.divisor > 1 && slot.command == phase;
        let commands = self.slots.iter().flatten().filter(slow).count();
        self.round == 1 || (phase != 0 && (self.round == 2 || commands < 2))
    }

    /// Worst case of each phase of the round: every frame that may fall into it, all with the most stuffing.
    /// Commands and answers of the phase, a set-up exchange, all drives' heartbeats; with CANopen drives SYNC, our
    /// heartbeat and an emergency. An ODrive answers once a millisecond by its own clock: in every phase.
    #[must_use]
    pub fn worst_case_us(&self, robot: &Robot, bus: usize) -> Vec<f64> {
        let rates = robot.buses.get(bus).map_or(BitRates { nominal: 1_000_000, data: None }, BusConfig::rates);
        (0..self.round).map(|phase| self.worst_phase_ns(robot, rates, phase) * 1e-3).collect()
    }

    #[expect(clippy::cast_precision_loss, reason = "nanoseconds of one cycle")]
    fn worst_phase_ns(&self, robot: &Robot, rates: BitRates, phase: u32) -> f64 {
        let time = |kind: FrameKind| kind.worst().time_ns(rates) as f64;
        let eight = FrameKind::classic(8);
        let mut sum = 0.0;
        // A question of the set-up and its answer; every protocol has them of this length or shorter.
        if self.allows_setup(phase) {
            sum += 2.0 * time(eight);
        }
        if self.canopen {
            // SYNC and an emergency.
            sum += time(FrameKind::classic(0)) + time(eight);
            if phase + 1 == self.round {
                sum += time(FrameKind::classic(1));
            }
        }
        for (slot, config) in self.slots.iter().zip(&robot.drives) {
            let Some(slot) = slot else { continue };
            let traffic = config.traffic();
            sum += traffic.heartbeat.map_or(0.0, time);
            let commanded = phase % slot.divisor == slot.command;
            if commanded {
                sum += time(traffic.command);
            }
            let answers = match config.protocol {
                DriveProtocol::Cia402(_) => phase.is_multiple_of(slot.divisor),
                DriveProtocol::Odrive(_) => true,
                DriveProtocol::Mit(_) | DriveProtocol::Moteus(_) => commanded,
            };
            if answers {
                sum += f64::from(traffic.answers) * time(traffic.answer);
            }
        }
        sum
    }
}

/// Numbers the legs, and the hip, in the order in which their slow drives come.
#[derive(Default)]
struct Pairs(Vec<usize>);

impl Pairs {
    fn number(&mut self, drive: usize) -> u32 {
        let pair = drive.div_ceil(2);
        let at = self.0.iter().position(|p| *p == pair).unwrap_or_else(|| {
            self.0.push(pair);
            self.0.len() - 1
        });
        u32::try_from(at).unwrap_or(0)
    }
}

fn check_nodes(robot: &Robot, bus: usize) -> Result<(), LineError> {
    for (drive, config) in robot.drives.iter().enumerate().filter(|(_, d)| d.bus == bus) {
        if config.is_canopen() && !(1..=126).contains(&config.node) {
            return Err(LineError::Node { drive, node: config.node });
        }
        let alike = |d: &DriveConfig| std::mem::discriminant(&d.protocol) == std::mem::discriminant(&config.protocol);
        if robot.drives.iter().take(drive).any(|d| d.bus == bus && d.node == config.node && alike(d)) {
            return Err(LineError::Twice { bus, node: config.node });
        }
    }
    Ok(())
}
