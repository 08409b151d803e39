//! What the device says: parsed by us, emitted by the simulated device. RT: yes.

use super::{Kind, MAX_REPLY, Sampling};
use crate::base::bytes::{BigEndian, Short};

/// The bytes of a reply.
pub type ReplyBytes = Short<MAX_REPLY>;

/// What the device says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reply {
    /// Acceleration in g and rate in rad/s.
    AccelRate {
        /// Specific force, g.
        accel_g: [f32; 3],
        /// Rate, rad/s.
        rate_rad_s: [f32; 3],
        /// Timer.
        ticks: u32,
    },
    /// Acceleration, rate and orientation matrix by rows.
    AccelRateMatrix {
        /// Specific force, g.
        accel_g: [f32; 3],
        /// Rate, rad/s.
        rate_rad_s: [f32; 3],
        /// Rows of the orientation matrix.
        matrix: [f32; 9],
        /// Timer.
        ticks: u32,
    },
    /// Euler angles.
    Euler {
        /// Roll, pitch, yaw, rad.
        euler_rad: [f32; 3],
        /// Timer.
        ticks: u32,
    },
    /// Euler angles and rates.
    EulerRate {
        /// Roll, pitch, yaw, rad.
        euler_rad: [f32; 3],
        /// Rate, rad/s.
        rate_rad_s: [f32; 3],
        /// Timer.
        ticks: u32,
    },
    /// Continuous mode was set to this message.
    SetContinuous {
        /// First byte of the streamed message.
        kind: u8,
        /// Timer.
        ticks: u32,
    },
    /// Mode of the device.
    Mode(u8),
    /// Sampling settings in force.
    Sampling(Sampling),
    /// Identity string number so and so.
    Identity {
        /// Which.
        selector: u8,
        /// Its characters.
        text: [u8; 16],
    },
}

fn put_floats(out: &mut ReplyBytes, values: &[f32]) {
    for value in values {
        out.put(&value.to_be_bytes());
    }
}

/// Sum of all bytes modulo 65536.
#[must_use]
pub fn checksum(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0_u16, |sum, byte| sum.wrapping_add(u16::from(*byte)))
}

impl Reply {
    /// What it is.
    #[must_use]
    pub const fn kind(&self) -> Kind {
        match self {
            Self::AccelRate { .. } => Kind::AccelRate,
            Self::AccelRateMatrix { .. } => Kind::AccelRateMatrix,
            Self::Euler { .. } => Kind::Euler,
            Self::EulerRate { .. } => Kind::EulerRate,
            Self::SetContinuous { .. } => Kind::SetContinuous,
            Self::Mode(_) => Kind::Mode,
            Self::Sampling(_) => Kind::Sampling,
            Self::Identity { .. } => Kind::Identity,
        }
    }

    /// Reads exactly one reply; `None` if length, first byte or checksum is wrong.
    #[must_use]
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        let kind = Kind::from_u8(*bytes.first()?)?;
        let (body, sum) = bytes.split_last_chunk::<2>()?;
        if bytes.len() != kind.reply_bytes() || checksum(body) != u16::from_be_bytes(*sum) {
            return None;
        }
        let mut r = BigEndian(body.get(1..)?);
        Some(match kind {
            Kind::AccelRate => Self::AccelRate { accel_g: r.floats(), rate_rad_s: r.floats(), ticks: r.u32() },
            Kind::AccelRateMatrix => Self::AccelRateMatrix {
                accel_g: r.floats(),
                rate_rad_s: r.floats(),
                matrix: r.floats(),
                ticks: r.u32(),
            },
            Kind::Euler => Self::Euler { euler_rad: r.floats(), ticks: r.u32() },
            Kind::EulerRate => Self::EulerRate { euler_rad: r.floats(), rate_rad_s: r.floats(), ticks: r.u32() },
            Kind::SetContinuous => {
                let [kind] = r.bytes();
                Self::SetContinuous { kind, ticks: r.u32() }
            }
            Kind::Mode => {
                let [mode] = r.bytes();
                Self::Mode(mode)
            }
            Kind::Sampling => Self::Sampling(Sampling::from_bytes(&r.bytes::<16>())),
            Kind::Identity => {
                let [selector] = r.bytes();
                Self::Identity { selector, text: r.bytes() }
            }
        })
    }

    /// Its bytes.
    #[must_use]
    pub fn emit(&self) -> ReplyBytes {
        let mut out = ReplyBytes::new(&[self.kind() as u8]);
        match self {
            Self::AccelRate { accel_g, rate_rad_s, ticks } => {
                put_floats(&mut out, accel_g);
                put_floats(&mut out, rate_rad_s);
                out.put(&ticks.to_be_bytes());
            }
            Self::AccelRateMatrix { accel_g, rate_rad_s, matrix, ticks } => {
                put_floats(&mut out, accel_g);
                put_floats(&mut out, rate_rad_s);
                put_floats(&mut out, matrix);
                out.put(&ticks.to_be_bytes());
            }
            Self::Euler { euler_rad, ticks } => {
                put_floats(&mut out, euler_rad);
                out.put(&ticks.to_be_bytes());
            }
            Self::EulerRate { euler_rad, rate_rad_s, ticks } => {
                put_floats(&mut out, euler_rad);
                put_floats(&mut out, rate_rad_s);
                out.put(&ticks.to_be_bytes());
            }
            Self::SetContinuous { kind, ticks } => {
                out.put(&[*kind]);
                out.put(&ticks.to_be_bytes());
            }
            Self::Mode(mode) => out.put(&[*mode]),
            Self::Sampling(sampling) => out.put(&sampling.to_bytes()),
            Self::Identity { selector, text } => {
                out.put(&[*selector]);
                out.put(text);
            }
        }
        let sum = checksum(out.as_slice());
        out.put(&sum.to_be_bytes());
        out
    }
}
