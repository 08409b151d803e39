//! What comes in: frames, IMU samples, the operator's hand, and what the bus room reads from them. RT: yes.

use super::reflect::{batch, message, wire_enum};
use super::{BUSES, DRIVES};
use crate::base::time::Stamp;
use iceoryx2::prelude::ZeroCopySend;

/// Most IMU samples in one tick (a USB adapter may deliver in bursts).
pub const MAX_IMU: usize = 8;

wire_enum! {
    /// How a bus is, as its controller says.
    pub enum BusHealth {
        /// Sends and receives.
        Active = 0,
        /// Many errors: warning or passive.
        Passive = 1,
        /// Took itself off the bus.
        Off = 2,
        /// No echo of our own frames for too long: nobody acknowledges, or the link is down.
        Stalled = 3,
        /// Down, or not yet opened.
        Down = 4,
        /// Another master speaks on it.
        Contested = 5,
    }
}

message! {
    /// One reading of the IMU, in its own frame as mounted: pitch is the angle of the leg that carries it.
    pub struct ImuSample {
        /// When it was measured: the device's clock mapped to ours.
        pub stamp: Stamp,
        /// The device's own timer, 16 us ticks, as on the wire.
        pub device_ticks: u32,
        /// True if `euler_rad` was in the message.
        pub has_attitude: bool,
        /// Roll, pitch, yaw by the device's filter, rad.
        pub euler_rad: [f64; 3],
        /// Angular rate, rad/s.
        pub rate_rad_s: [f64; 3],
        /// Specific force in g, if in the message.
        pub accel_g: [f64; 3],
    }
}

message! {
    /// IMU samples that arrived since the last tick, in order.
    pub struct ImuBatch {
        /// How many of `samples` are there.
        pub count: u8,
        /// Messages lost: bad checksum, gap in the device's timer, no room; since start.
        pub dropped: u32,
        /// The samples.
        pub samples: [ImuSample; MAX_IMU],
    }
}

batch!(ImuBatch { samples: ImuSample });

message! {
    /// The operator's hand, as last seen. Freshness is judged by the receiver from `stamp`.
    pub struct OperatorSample {
        /// When the device was last heard of (a heartbeat, not only a change).
        pub stamp: Stamp,
        /// The dead-man switch is held.
        pub dead_man: bool,
        /// Counts the samples of this source.
        pub sequence: u32,
        /// Counts the times that a person confirmed the hip's zero.
        pub zeroings: u32,
        /// Hip angle at the newest confirmation, inner minus outer, rad; 0 with the legs aligned.
        pub zero_angle_rad: f64,
        /// Walking speed that a stick in this hand asks for, m/s; 0 at rest, and without a stick.
        pub speed_m_s: f64,
    }
}

message! {
    /// The robot's body as cameras see it: ground truth for recordings. No tick looks at it.
    pub struct MocapSample {
        /// When the cameras saw it: the server's clock mapped to ours, or the arrival if it tells none.
        pub stamp: Stamp,
        /// When it arrived.
        pub arrived: Stamp,
        /// The server's count of frames.
        pub frame: u32,
        /// Number of the body at the server; 0 where bodies have names only.
        pub body: u32,
        /// The cameras see it; false for a pose that is an old one.
        pub tracked: bool,
        /// Position in the room, m.
        pub position_m: [f64; 3],
        /// Attitude in the room, x, y, z, w.
        pub quaternion: [f64; 4],
        /// Frames missing since the start.
        pub missing: u32,
    }
}

wire_enum! {
    /// Whether it is known where a drive's count zero is. Lost at each boot-up of the drive.
    pub enum ZeroState {
        /// No: positions mean nothing.
        Unknown = 0,
        /// Being looked for.
        Homing = 1,
        /// Yes.
        Known = 2,
        /// Looked for and not found.
        Failed = 3,
    }
}

wire_enum! {
    /// State of a drive: those of CiA 402, and what goes before them.
    pub enum DriveState {
        /// Not heard of since start.
        Unknown = 0,
        /// Being set up by SDO.
        Configuring = 1,
        /// CiA 402 not ready to switch on.
        NotReady = 2,
        /// CiA 402 switch-on disabled.
        SwitchOnDisabled = 3,
        /// CiA 402 ready to switch on: set up, no voltage at the motor.
        Ready = 4,
        /// CiA 402 switched on.
        SwitchedOn = 5,
        /// CiA 402 operation enabled: follows commands.
        Enabled = 6,
        /// CiA 402 quick stop active.
        QuickStop = 7,
        /// CiA 402 fault reaction active, or fault.
        Fault = 8,
        /// Stopped answering, or refused its set-up.
        Lost = 9,
    }
}

message! {
    /// What a drive says of itself, in motor units.
    pub struct DriveFeedback {
        /// When the position was sampled (the SYNC it answers); [`Stamp::NEVER`] before the first.
        pub stamp: Stamp,
        /// Its state.
        pub state: DriveState,
        /// CiA 402 statusword as received.
        pub statusword: u16,
        /// Position, encoder counts; from the joint's zero once that is known, from anywhere before.
        pub position_counts: i32,
        /// Torque, 1/1000 of the rated torque.
        pub torque_permille: i16,
        /// Analogue input, counts: at a toe the potentiometer on its spring.
        pub analog_counts: i16,
        /// Last error code (EMCY or 0x603F), 0 if none.
        pub error_code: u16,
        /// Torque that the drive has confirmed it may use at most, 1/1000 of rated.
        pub torque_limit_permille: i16,
        /// Whether its zero is known.
        pub zero: ZeroState,
    }
}

message! {
    /// All drives, in the order of [`super::Drive`], and the health of the buses.
    pub struct DriveFeedbacks {
        /// One per drive.
        pub drives: [DriveFeedback; DRIVES],
        /// One per bus.
        pub health: [BusHealth; BUSES],
    }
}
