//! What a drive speaks, with the figures that each protocol needs; which identifiers and how much of its bus it takes.
//! RT: read only.

use super::checked::{DriveConfig, DriveMode};
use crate::base::can_time::FrameKind;
use crate::base::time::Span;
use std::ops::RangeInclusive;

/// What a drive speaks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DriveProtocol {
    /// CANopen with the drive profile CiA 402.
    Cia402(Cia402),
    /// The 8-byte frames of the MIT mini-cheetah and its descendants.
    Mit(Mit),
    /// ODrive CANSimple.
    Odrive(Odrive),
    /// moteus registers over CAN-FD.
    Moteus(Moteus),
}

/// What differs between CiA 402 drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cia402 {
    /// Torque by profile torque (mode 4), for drives that have no cyclic synchronous torque (mode 10).
    pub profile_torque: bool,
}

/// Whose descendant speaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MitDialect {
    /// Mini-cheetah firmware: answers of 6 bytes.
    MiniCheetah,
    /// CubeMars and T-Motor AK: 6 bytes, or 8 with temperature and error.
    CubeMars,
    /// Damiao: 8 bytes with a status; registers.
    Damiao,
    /// MyActuator RMD, motion mode: identifiers 0x400 and 0x500.
    MyActuator,
}

/// An MIT drive. Its ranges are not on the wire (but Damiao's): a wrong one scales torque silently.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mit {
    /// Whose descendant.
    pub dialect: MitDialect,
    /// Identifier of its answers ("master id").
    pub reply_id: u16,
    /// Position is coded from minus to plus so much, rad at its output.
    pub position_range_rad: f64,
    /// Velocity likewise, rad/s.
    pub velocity_range_rad_s: f64,
    /// Torque likewise, Nm.
    pub torque_range_nm: f64,
    /// Stiffness is coded from 0 to so much, Nm/rad.
    pub stiffness_range_nm_rad: f64,
    /// Damping from 0 to so much, Nm s/rad.
    pub damping_range_nm_s_rad: f64,
    /// Counts that a turn of its output is.
    pub counts_per_turn: f64,
    /// Stiffness and damping with which it follows a position, Nm/rad and Nm s/rad; 0 for a torque drive.
    pub gains: [f64; 2],
}

/// Generation of an ODrive's firmware: their heartbeats differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OdriveFirmware {
    /// 0.5: axis error, state and flags; torque by the current.
    V5,
    /// 0.6: error, state and result; torque by its estimate.
    V6,
}

/// An ODrive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Odrive {
    /// Generation.
    pub firmware: OdriveFirmware,
    /// Nm per A, for the torque that firmware 0.5 tells as a current.
    pub torque_constant_nm_a: f64,
    /// Its velocity limit, turns/s.
    pub velocity_limit_turns_s: f64,
    /// Its current limit, A.
    pub current_limit_a: f64,
    /// Interval of its encoder and torque messages, as set in the drive.
    pub feedback: Span,
    /// Counts that a turn of its encoder is.
    pub counts_per_turn: f64,
}

/// A moteus.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moteus {
    /// Counts that a turn of its output is.
    pub counts_per_turn: f64,
}

/// Identifiers that a drive speaks with. Shared: others of its kind may use them too, told apart by the data.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Claim {
    /// SocketCAN's identifier, flag of 29 bits included.
    pub ids: RangeInclusive<u32>,
    /// Whether others of its kind may use them too.
    pub shared: bool,
}

impl Claim {
    /// True if two drives cannot live with both.
    #[must_use]
    pub const fn collides(&self, other: &Self) -> bool {
        let overlap = *self.ids.start() <= *other.ids.end() && *other.ids.start() <= *self.ids.end();
        overlap && !(self.shared && other.shared)
    }
}

/// Frames of a drive in each cycle in which it is served.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Traffic {
    /// What we send.
    pub command: FrameKind,
    /// What comes back.
    pub answer: FrameKind,
    /// So many of those.
    pub answers: u32,
    /// What it says now and then by itself.
    pub heartbeat: Option<FrameKind>,
}

/// SocketCAN's flag of a 29-bit identifier.
const EXTENDED: u32 = 0x8000_0000;

impl DriveConfig {
    /// True if the bus needs SYNC, heartbeats and network management for it.
    #[must_use]
    pub const fn is_canopen(&self) -> bool {
        matches!(self.protocol, DriveProtocol::Cia402(_))
    }

    /// Frames of each cycle in which it is served.
    #[must_use]
    pub fn traffic(&self) -> Traffic {
        let eight = FrameKind::classic(8);
        match &self.protocol {
            DriveProtocol::Cia402(_) => Traffic {
                command: FrameKind::classic(if self.mode == DriveMode::CyclicTorque { 4 } else { 6 }),
                answer: eight,
                answers: 1,
                heartbeat: Some(FrameKind::classic(1)),
            },
            DriveProtocol::Mit(_) => Traffic { command: eight, answer: eight, answers: 1, heartbeat: None },
            DriveProtocol::Odrive(_) => {
                Traffic { command: FrameKind::classic(4), answer: eight, answers: 2, heartbeat: Some(eight) }
            }
            DriveProtocol::Moteus(_) => Traffic {
                command: FrameKind { bytes: 48, extended: true, fd: true },
                answer: FrameKind { bytes: 24, extended: self.node > 7, fd: true },
                answers: 1,
                heartbeat: None,
            },
        }
    }

    /// Identifiers that it and we to it speak with.
    #[must_use]
    pub fn claims(&self) -> Vec<Claim> {
        let n = u32::from(self.node);
        let own = |id: u32| Claim { ids: id..=id, shared: false };
        let common = |id: u32| Claim { ids: id..=id, shared: true };
        match &self.protocol {
            DriveProtocol::Cia402(_) => {
                let functions = [0x080, 0x180, 0x200, 0x280, 0x300, 0x380, 0x400, 0x480, 0x500, 0x580, 0x600, 0x700];
                // Network management, SYNC and our heartbeat are everybody's.
                functions.map(|f| own(f + n)).into_iter().chain([0x000, 0x080, 0x77F].map(common)).collect()
            }
            DriveProtocol::Mit(mit) => match mit.dialect {
                MitDialect::MyActuator => [0x140, 0x240, 0x400, 0x500].map(|f| own(f + n)).to_vec(),
                MitDialect::Damiao => vec![own(n), common(u32::from(mit.reply_id)), common(0x7FF)],
                MitDialect::MiniCheetah | MitDialect::CubeMars => vec![own(n), common(u32::from(mit.reply_id))],
            },
            DriveProtocol::Odrive(_) => vec![Claim { ids: n << 5..=(n << 5 | 0x1F), shared: false }],
            DriveProtocol::Moteus(_) => {
                let reply = if n > 7 { EXTENDED | n << 8 } else { n << 8 };
                vec![own(EXTENDED | 0x8000 | n), own(reply)]
            }
        }
    }
}
