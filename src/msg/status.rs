//! How the process is. RT: yes.

use super::Fault;
use super::reflect::{message, wire_enum};
use crate::base::time::{Span, Stamp};
use iceoryx2::prelude::ZeroCopySend;

wire_enum! {
    /// Mode of the robot.
    pub enum Mode {
        /// Booting: sources not all seen yet. No torque.
        Starting = 0,
        /// Everything may be healthy, torque is zero, drives are not enabled.
        Disarmed = 1,
        /// A fresh dead-man edge was seen; drives are being enabled with zero torque.
        Arming = 2,
        /// The controller's torque reaches the motors.
        Armed = 3,
        /// A fault is latched: zero torque until a fresh edge with everything healthy.
        Faulted = 4,
        /// While the switch is held, toes look for their zero at limited torque; the hip has none.
        Homing = 5,
    }
}

message! {
    /// State of the safety room and of the loop after a tick.
    pub struct Status {
        /// Mode after this tick.
        pub mode: Mode,
        /// First fault since it was last cleared, kept until re-armed.
        pub first_fault: Fault,
        /// Newest fault or active limit.
        pub last_fault: Fault,
        /// Faults latched since start.
        pub faults: u32,
        /// Why arming is not possible now: bit i is fault code i; 0 = could arm.
        pub arm_blockers: u64,
        /// The first of them in the order of blame, with its value.
        pub arm_blocker: Fault,
        /// Ticks since start.
        pub ticks: u64,
        /// Periods skipped since start.
        pub overruns: u64,
        /// How late the thread woke up for this tick.
        pub wake_latency: Span,
        /// How long the previous tick's step took.
        pub step_time: Span,
    }
}

wire_enum! {
    /// What the recorder is doing.
    pub enum RecorderState {
        /// Not asked to record.
        Off = 0,
        /// Writing.
        Recording = 1,
        /// No room on the disk: ticks are lost and counted, tried again later.
        DiskFull = 2,
        /// The disk fails otherwise: ticks are lost and counted, tried again later.
        DiskError = 3,
        /// Closed.
        Finished = 4,
    }
}

message! {
    /// How the recording is.
    pub struct RecorderStatus {
        /// Time of the newest tick that it saw.
        pub stamp: Stamp,
        /// What it is doing.
        pub state: RecorderState,
        /// Ticks that are safely on the disk.
        pub written: u64,
        /// Ticks lost: queue full, or the disk did not take them.
        pub dropped: u64,
        /// Most ticks that ever waited in the queue.
        pub queue_peak: u32,
        /// Files begun; more than one after trouble with the disk.
        pub files: u32,
        /// Bytes of the present file that are safely on the disk.
        pub bytes: u64,
        /// How long the last flush to the disk took.
        pub flush_time: Span,
    }
}
