//! A whole tick: what went in, what came out. The tick is a pure function of [`TickInput`] and its own state, so a log
//! of these replays to the bit. RT: yes.

use super::reflect::message;
use super::{
    BUSES, BusHealth, ControlState, DriveCommands, DriveFeedbacks, Estimate, FrameBatch, ImuBatch, JointCommand,
    LidarSample, OperatorSample, Snapshot, Status, Terrain,
};
use crate::base::time::{Span, Stamp};
use iceoryx2::prelude::ZeroCopySend;

message! {
    /// Everything that a tick may look at.
    pub struct TickInput {
        /// Number of the tick since start.
        pub index: u64,
        /// Its time: the planned wake-up, so that it is a multiple of the period even when late.
        pub now: Stamp,
        /// How late the thread woke up.
        pub wake_latency: Span,
        /// How long the previous step took.
        pub step_time: Span,
        /// Periods skipped just before this tick.
        pub skipped: u32,
        /// What real time needs and was not granted, as bits; 0 = granted, or the bus is simulated.
        pub real_time_missing: u32,
        /// Shut-down was asked for: zero torque, disable.
        pub stop_requested: bool,
        /// The frames of the tick before were not sent to this bus: they would have been old when they got there.
        pub unsent: [bool; BUSES],
        /// Health of each bus as its I/O thread sees it.
        pub bus_health: [BusHealth; BUSES],
        /// What came over each bus before this time has been received: until then somebody has listened.
        pub heard_until: [Stamp; BUSES],
        /// The same of the IMU's line.
        pub imu_heard_until: Stamp,
        /// Frames received since the last tick.
        pub received: [FrameBatch; BUSES],
        /// IMU samples since the last tick.
        pub imu: ImuBatch,
        /// The lidar's newest word since the last tick; its state is `Nothing` if there is none.
        pub lidar: LidarSample,
        /// The operator's hand, as last seen.
        pub operator: OperatorSample,
    }
}

message! {
    /// A tick's head in a recording: [`TickInput`] without its batches, which travel frame by frame, and their counts.
    pub struct TickHead {
        /// Number of the tick since start.
        pub index: u64,
        /// Its time: the planned wake-up.
        pub now: Stamp,
        /// How late the thread woke up.
        pub wake_latency: Span,
        /// How long the previous step took.
        pub step_time: Span,
        /// Periods skipped just before this tick.
        pub skipped: u32,
        /// What real time needs and was not granted, as bits.
        pub real_time_missing: u32,
        /// Shut-down was asked for.
        pub stop_requested: bool,
        /// The frames of the tick before were not sent, by bus.
        pub unsent: [bool; BUSES],
        /// Health of each bus.
        pub bus_health: [BusHealth; BUSES],
        /// Until when somebody has listened to each bus.
        pub heard_until: [Stamp; BUSES],
        /// Until when somebody has listened to the IMU.
        pub imu_heard_until: Stamp,
        /// Frames received, by bus.
        pub received: [u8; BUSES],
        /// Received frames lost since start, by bus.
        pub received_dropped: [u32; BUSES],
        /// Frames to send, by bus.
        pub sent: [u8; BUSES],
        /// Frames to send that had no room, since start, by bus.
        pub sent_dropped: [u32; BUSES],
        /// IMU samples.
        pub imu: u8,
        /// IMU messages lost since start.
        pub imu_dropped: u32,
    }
}

message! {
    /// What a tick does to the world.
    pub struct TickOutput {
        /// Frames to send, in order.
        pub send: [FrameBatch; BUSES],
    }
}

message! {
    /// A tick with all that the rooms said: what the recorder and the terminal see.
    pub struct TickRecord {
        /// What went in.
        pub input: TickInput,
        /// What the drives said.
        pub feedback: DriveFeedbacks,
        /// The newest of each sensor.
        pub snapshot: Snapshot,
        /// What the floor says of the attitude.
        pub terrain: Terrain,
        /// State of the robot.
        pub estimate: Estimate,
        /// What the controller is doing.
        pub control: ControlState,
        /// What the controller wanted.
        pub wanted: JointCommand,
        /// What safety let through.
        pub allowed: JointCommand,
        /// The drives' commands.
        pub drives: DriveCommands,
        /// State of safety and loop.
        pub status: Status,
        /// What went out.
        pub output: TickOutput,
    }
}
