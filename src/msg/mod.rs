//! The doors between rooms: plain messages of fixed size, `Copy`, `repr(C)`, stamped with their time of validity.
//!
//! One declaration by `message!` gives the struct, its description ([`Shape`]) and its walk over leaf values. From
//! these come the shared-memory type, the MCAP schema, the encoder, the decoder, the schema hash of a channel and the
//! name of the first field in which a replay differs. Same word through all rooms: field names are log columns.
//! RT: yes, no allocation.

use iceoryx2::prelude::ZeroCopySend;

mod command;
mod control;
mod estimate;
mod fault;
mod frame;
mod lidar;
mod reflect;
mod sensor;
mod status;
mod tick;

pub use command::{DriveCommand, DriveCommands, DriveGoal, JointCommand};
pub use control::{ControlState, LawName, Motion};
pub use estimate::{Estimate, Snapshot};
pub use fault::{Fault, FaultCode};
pub use frame::{BusFrame, CanFrame, FrameBatch, Frames, MAX_DATA, MAX_FRAMES};
pub use lidar::{FloorVerdict, LidarSample, LidarState, Terrain, TerrainState};
pub use reflect::{Element, FieldShape, Kind, Shape, Value};
pub use sensor::{
    BusHealth, DriveFeedback, DriveFeedbacks, DriveState, ImuBatch, ImuSample, MAX_IMU, MocapSample, OperatorSample,
    ZeroState,
};
pub use status::{Mode, RecorderState, RecorderStatus, Status};
pub use tick::{TickHead, TickInput, TickOutput, TickRecord};

/// Number of CAN buses of the robot.
pub const BUSES: usize = 2;
/// Number of drives: the hip and four toes, in the order of [`Drive`].
pub const DRIVES: usize = 5;
/// Number of toes, in the order inner A, inner B, outer A, outer B.
pub const TOES: usize = 4;

reflect::wire_enum! {
    /// One of the two leg pairs. Leg 1 of the thesis is the inner one.
    pub enum Leg {
        /// The middle pair.
        Inner = 0,
        /// The outside pair.
        Outer = 1,
    }
}

impl Leg {
    /// The other leg.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::Inner => Self::Outer,
            Self::Outer => Self::Inner,
        }
    }
}

reflect::wire_enum! {
    /// The five drives; the number is the index in arrays of length [`DRIVES`].
    pub enum Drive {
        /// The hip motor behind its 30:1 harmonic drive.
        Hip = 0,
        /// First toe of the inner leg pair.
        InnerToeA = 1,
        /// Second toe of the inner leg pair.
        InnerToeB = 2,
        /// First toe of the outer leg pair.
        OuterToeA = 3,
        /// Second toe of the outer leg pair.
        OuterToeB = 4,
    }
}

impl Drive {
    /// Its name for people.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Hip => "hip",
            Self::InnerToeA => "inner A",
            Self::InnerToeB => "inner B",
            Self::OuterToeA => "outer A",
            Self::OuterToeB => "outer B",
        }
    }
}
