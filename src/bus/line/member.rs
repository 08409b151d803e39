//! A drive on the bus, whatever it speaks. RT: yes.
//!
//! | variant | protocols | file |
//! |---|---|---|
//! | [`Member::Canopen`] | CiA 301 and 402: set up by an object server, in step by SYNC | `drive`, `setup` |
//! | [`Member::Direct`] | MIT, ODrive, moteus: commanded frame by frame | `direct`, `speak_*` |

use super::direct::Direct;
use super::drive::DriveLine;
use super::in_flight::Sent;
use crate::base::time::{Span, Stamp};
use crate::bus::canopen::Message;
use crate::msg::{BusFrame, CanFrame, DriveCommand, DriveFeedback, FrameBatch};

/// A drive as its master sees it.
#[expect(clippy::large_enum_variant, reason = "one for each drive, made before arming and never moved")]
#[derive(Debug)]
pub(super) enum Member {
    /// CANopen.
    Canopen(DriveLine),
    /// Commanded frame by frame.
    Direct(Direct),
}

impl Member {
    /// Its index in [`crate::msg::Drive`].
    pub(super) const fn index(&self) -> usize {
        match self {
            Self::Canopen(drive) => drive.index,
            Self::Direct(drive) => drive.index,
        }
    }

    /// What it says.
    pub(super) const fn feedback(&self) -> &DriveFeedback {
        match self {
            Self::Canopen(drive) => &drive.feedback,
            Self::Direct(drive) => &drive.feedback,
        }
    }

    /// When its command went out, while nothing proves that it left the wire.
    pub(super) fn command_in_flight(&self) -> Option<Stamp> {
        match self {
            Self::Canopen(drive) => drive.in_flight.oldest(),
            Self::Direct(drive) => drive.in_flight.oldest(),
        }
    }

    /// What was sent until then has left.
    pub(super) fn prove_departure(&mut self, until: Stamp) {
        match self {
            Self::Canopen(drive) => drive.in_flight.prove_departure(until),
            Self::Direct(drive) => drive.in_flight.prove_departure(until),
        }
    }

    /// What was sent at this time was not sent.
    pub(super) fn take_back(&mut self, at: Stamp) {
        let (in_flight, goal) = match self {
            Self::Canopen(drive) => (&mut drive.in_flight, &mut drive.goal),
            Self::Direct(drive) => (&mut drive.in_flight, &mut drive.goal),
        };
        if let Some(before) = in_flight.take_back(at) {
            *goal = before;
        }
    }

    /// The command takes goal or torque away from what was sent last.
    pub(super) fn is_lowered_by(&self, command: &DriveCommand) -> bool {
        match self {
            Self::Canopen(drive) => drive.is_lowered_by(command),
            Self::Direct(drive) => drive.is_lowered_by(command),
        }
    }

    /// The bus is dead: everything known of the drive is void.
    pub(super) fn on_stall(&mut self) {
        match self {
            Self::Canopen(drive) => drive.on_stall(),
            Self::Direct(drive) => drive.on_stall(),
        }
    }

    /// Deadlines; `listened`: for how long we have listened since the last time.
    pub(super) fn supervise(&mut self, now: Stamp, listened: Span) {
        match self {
            Self::Canopen(drive) => drive.supervise(now, listened),
            Self::Direct(drive) => drive.supervise(now, listened),
        }
    }

    /// The next frame of its set-up, if one is due in this phase of the round.
    pub(super) fn setup_frame(&mut self, now: Stamp, phase: u32) -> Option<CanFrame> {
        match self {
            Self::Canopen(drive) => drive.setup_frame(now, phase),
            Self::Direct(drive) => drive.setup_frame(now),
        }
    }

    /// What this cycle wants, whether or not a command goes out in it.
    pub(super) fn note_command(&mut self, command: &DriveCommand) {
        match self {
            Self::Canopen(drive) => drive.note_command(command),
            Self::Direct(drive) => drive.note_command(command),
        }
    }

    /// True if a command should go out in this phase of the round: its turn, or the goal drops.
    pub(super) fn wants_command(&self, phase: u32, command: &DriveCommand) -> bool {
        match self {
            Self::Canopen(drive) => drive.wants_command(phase, command),
            Self::Direct(drive) => drive.wants_command(phase, command),
        }
    }

    /// The command.
    pub(super) fn command(&mut self, now: Stamp, command: &DriveCommand) -> CanFrame {
        match self {
            Self::Canopen(drive) => {
                let goal_before = drive.goal;
                let frame = Message::Rpdo(1, drive.node, drive.command(command)).emit();
                let torque_permille = drive.torque_permille;
                drive.in_flight.push(Sent { at: now, frame, torque_permille, goal_before });
                frame
            }
            Self::Direct(drive) => {
                let goal_before = drive.goal;
                let frame = drive.command(command);
                let torque_permille = drive.torque_permille;
                drive.in_flight.push(Sent { at: now, frame, torque_permille, goal_before });
                frame
            }
        }
    }

    /// Zero torque and no power, whatever the state.
    pub(super) fn stop_frames(&self, out: &mut FrameBatch) {
        match self {
            Self::Canopen(drive) => {
                let frame = Message::Rpdo(1, drive.node, drive.stop_command()).emit();
                out.push(BusFrame::ours(Stamp::default(), frame));
            }
            Self::Direct(drive) => drive.stop_frames(out),
        }
    }
}
