//! What the laser scanner says of the floor, and what the estimator makes of it. RT: yes.

use super::reflect::{message, wire_enum};
use crate::base::time::{Span, Stamp};
use iceoryx2::prelude::ZeroCopySend;

wire_enum! {
    /// How the lidar is.
    pub enum LidarState {
        /// It has said nothing new.
        Nothing = 0,
        /// It is being asked for its parameters and its clock.
        Connecting = 1,
        /// Scans come.
        Streaming = 2,
        /// Nothing came for too long: the connection is dead or half open, and is made anew.
        Silent = 3,
        /// Only damaged replies come.
        Damaged = 4,
        /// Status 0E: it is in another mode.
        NotReady = 5,
        /// Status 10: its laser is off.
        LaserOff = 6,
        /// Status 50 to 97: it reports a failure of its own.
        Hardware = 7,
        /// It refused with another status, or its parameters cannot be used.
        Refused = 8,
        /// There is no such device, or nobody answers at its address.
        Gone = 9,
    }
}

impl LidarState {
    /// Somebody should look at it.
    #[must_use]
    pub const fn is_trouble(self) -> bool {
        !matches!(self, Self::Nothing | Self::Connecting | Self::Streaming)
    }
}

wire_enum! {
    /// Whether a scan shows the floor.
    pub enum FloorVerdict {
        /// There is no scan.
        None = 0,
        /// A straight line.
        Found = 1,
        /// Too few points on one line.
        TooFew = 2,
        /// Too rough for one line.
        TooRough = 3,
    }
}

message! {
    /// The lidar's newest word: a scan, already fitted, or another state.
    pub struct LidarSample {
        /// When the floor was scanned: the device's clock mapped to ours; for a state, when it began.
        pub stamp: Stamp,
        /// When its last byte arrived.
        pub arrived: Stamp,
        /// How the device is.
        pub state: LidarState,
        /// Its last status, two characters as on the wire, the first in the upper byte; 0 before any.
        pub status: u16,
        /// Whether the scan shows the floor. The numbers below hold only if it does.
        pub verdict: FloorVerdict,
        /// Inclination of the part that carries the lidar against the floor's normal, rad, + leaning back.
        pub lean_rad: f64,
        /// Its standard deviation.
        pub lean_sigma_rad: f64,
        /// Distance of the lidar from the floor's line, m.
        pub height_m: f64,
        /// Its standard deviation.
        pub height_sigma_m: f64,
        /// Robust standard deviation of the points about the line, m.
        pub roughness_m: f64,
        /// Points in the floor's sector.
        pub points: u16,
        /// Those on the line.
        pub used: u16,
        /// Scans since the start.
        pub scans: u32,
        /// Replies with a wrong check or length since the start.
        pub damaged: u32,
        /// Scans missing by the device's clock since the start.
        pub missing: u32,
        /// Times that the dialogue began anew.
        pub starts: u32,
    }
}

wire_enum! {
    /// What the terrain zeroing filter does.
    pub enum TerrainState {
        /// No lidar is configured.
        Off = 0,
        /// No line of the floor yet.
        Waiting = 1,
        /// Lines come.
        Following = 2,
        /// No line for a while: the last correction is held, and its uncertainty grows.
        Holding = 3,
    }
}

message! {
    /// What the terrain says of the attitude: the slow part of its error. The rest is `Estimate::attitude_bias_rad`.
    pub struct Terrain {
        /// Time that it holds for.
        pub stamp: Stamp,
        /// What the filter does.
        pub state: TerrainState,
        /// What the lidar last said of itself.
        pub lidar: LidarState,
        /// Its status then.
        pub status: u16,
        /// A word of the lidar came in this tick.
        pub heard: bool,
        /// What the IMU's attitude is believed to read too much, by the floor: seconds and slower, rad.
        pub zero_rad: f64,
        /// Its standard deviation; grows while no line comes.
        pub zero_sigma_rad: f64,
        /// Height of the lidar over the floor by the newest line, m.
        pub height_m: f64,
        /// Age of the newest line that was used; [`Span`]'s maximum before the first.
        pub line_age: Span,
        /// Lines used.
        pub lines: u32,
        /// Lines that were not: of another floor, or of a time that is no longer remembered.
        pub refused: u32,
    }
}
