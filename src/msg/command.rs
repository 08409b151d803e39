//! What goes out: joint torque, then five drive commands. RT: yes.

use super::reflect::{message, wire_enum};
use super::{DRIVES, TOES};
use crate::base::time::Stamp;
use iceoryx2::prelude::ZeroCopySend;

message! {
    /// What a controller wants, or what safety let through, at the joints.
    pub struct JointCommand {
        /// The tick that chose it.
        pub stamp: Stamp,
        /// Hip torque at the joint, + on inner, - on outer, Nm.
        pub hip_torque_nm: f64,
        /// Toe lengths, m, 0 = retracted; inner A, inner B, outer A, outer B.
        pub toe_position_m: [f64; TOES],
    }
}

wire_enum! {
    /// What a drive shall be.
    pub enum DriveGoal {
        /// Voltage off: CiA 402 switch-on disabled.
        Disabled = 0,
        /// Set up and waiting, no torque: CiA 402 ready or switched on.
        Ready = 1,
        /// Following commands: CiA 402 operation enabled.
        Enabled = 2,
    }
}

message! {
    /// Command of one drive, in drive units.
    pub struct DriveCommand {
        /// What it shall be.
        pub goal: DriveGoal,
        /// Torque, 1/1000 of the rated torque (torque drives).
        pub torque_permille: i16,
        /// Torque that it may use at most, 1/1000 of rated (position drives; a torque drive's limit is set up once).
        pub torque_limit_permille: i16,
        /// Target position, encoder counts from the joint's zero (position drives).
        pub position_counts: i32,
        /// Hold the position where the drive is instead of `position_counts`.
        pub hold: bool,
    }
}

message! {
    /// Commands of all drives, in the order of [`super::Drive`].
    pub struct DriveCommands {
        /// The tick that chose them.
        pub stamp: Stamp,
        /// One per drive.
        pub drives: [DriveCommand; DRIVES],
    }
}
