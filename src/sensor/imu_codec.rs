//! MicroStrain 3DM-GX3-25, single-byte protocol, big endian: requests, replies, and a parser that finds its feet again.
//!
//! A reply is the command's byte, data, and a checksum: the sum of all bytes before it modulo 65536. Streamed messages
//! carry the device's timer (62 500 Hz, 16 us) before the checksum.
//!
//! | file | what |
//! |---|---|
//! | [`request`] | what the device is asked, both ends |
//! | [`reply`] | what it says, both ends |
//! | [`parser`] | replies in a stream of bytes, damaged ones among them |
//!
//! RT: yes, no allocation.

mod parser;
mod reply;
mod request;
#[cfg(test)]
mod tests;

use crate::base::bytes::BigEndian;

pub use parser::Parser;
pub use reply::{Reply, ReplyBytes, checksum};
pub use request::{Found, Request, RequestBytes};

/// Ticks of the device's timer per second.
pub const TICKS_PER_S: u32 = 62_500;
/// Longest reply that is known here.
pub const MAX_REPLY: usize = 67;
/// Longest request.
pub const MAX_REQUEST: usize = 20;
/// Standard gravity, m/s^2: one g of the device.
pub const STANDARD_GRAVITY_M_S2: f64 = 9.80665;

/// Orientation quantities come at most so often, Hz (decimation 2).
pub const MAX_ORIENTATION_HZ: u32 = 500;
/// Anything comes at most so often, Hz (decimation 1).
pub const MAX_RATE_HZ: u32 = 1000;
/// Sampling flags after power-up: orientation, coning and sculling.
pub const DEFAULT_FLAGS: u16 = 0x0003;
/// Sampling flag: compute orientation.
pub const FLAG_ORIENTATION: u16 = 0x0001;

/// What a reply is, by its first byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// Acceleration and rate.
    AccelRate = 0xC2,
    /// Continuous mode was set.
    SetContinuous = 0xC4,
    /// Acceleration, rate and orientation matrix.
    AccelRateMatrix = 0xC8,
    /// Euler angles.
    Euler = 0xCE,
    /// Euler angles and rates.
    EulerRate = 0xCF,
    /// Device mode.
    Mode = 0xD4,
    /// Sampling settings.
    Sampling = 0xDB,
    /// Identity string.
    Identity = 0xEA,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::AccelRate,
        Self::SetContinuous,
        Self::AccelRateMatrix,
        Self::Euler,
        Self::EulerRate,
        Self::Mode,
        Self::Sampling,
        Self::Identity,
    ];

    /// The kind of a reply that starts with this byte.
    #[must_use]
    pub fn from_u8(byte: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|k| *k as u8 == byte)
    }

    /// Bytes of such a reply.
    #[must_use]
    pub const fn reply_bytes(self) -> usize {
        match self {
            Self::Mode => 4,
            Self::SetContinuous => 8,
            Self::Euler | Self::Sampling => 19,
            Self::Identity => 20,
            Self::AccelRate | Self::EulerRate => 31,
            Self::AccelRateMatrix => 67,
        }
    }

    /// True for what can be streamed.
    #[must_use]
    pub const fn is_measurement(self) -> bool {
        matches!(self, Self::AccelRate | Self::AccelRateMatrix | Self::Euler | Self::EulerRate)
    }

    /// True if the device must compute its orientation for it.
    #[must_use]
    pub const fn needs_orientation(self) -> bool {
        matches!(self, Self::AccelRateMatrix | Self::Euler | Self::EulerRate)
    }
}

/// Sampling settings (request and reply DB).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sampling {
    /// 1000 Hz over this is the rate.
    pub decimation: u16,
    /// Bit 0 orientation, 1 coning and sculling, ...
    pub flags: u16,
    /// Window of the gyro and accelerometer filter, samples.
    pub window: u8,
    /// Window of the magnetometer filter, samples.
    pub mag_window: u8,
    /// Time constant of the up compensation, s.
    pub up_s: u16,
    /// Time constant of the north compensation, s.
    pub north_s: u16,
    /// Magnetometer power.
    pub mag_power: u8,
}

impl Default for Sampling {
    /// As the device leaves the factory, at 100 Hz.
    fn default() -> Self {
        Self { decimation: 10, flags: DEFAULT_FLAGS, window: 15, mag_window: 17, up_s: 10, north_s: 10, mag_power: 0 }
    }
}

impl Sampling {
    /// Decimation, flags, windows, times, power and five zero bytes.
    fn to_bytes(self) -> [u8; 16] {
        let [d0, d1] = self.decimation.to_be_bytes();
        let [f0, f1] = self.flags.to_be_bytes();
        let [u0, u1] = self.up_s.to_be_bytes();
        let [n0, n1] = self.north_s.to_be_bytes();
        [d0, d1, f0, f1, self.window, self.mag_window, u0, u1, n0, n1, self.mag_power, 0, 0, 0, 0, 0]
    }

    fn from_bytes(bytes: &[u8]) -> Self {
        let mut r = BigEndian(bytes);
        let (decimation, flags, [window, mag_window]) = (r.u16(), r.u16(), r.bytes());
        let (up_s, north_s, [mag_power]) = (r.u16(), r.u16(), r.bytes());
        Self { decimation, flags, window, mag_window, up_s, north_s, mag_power }
    }
}
