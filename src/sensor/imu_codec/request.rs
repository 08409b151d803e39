//! What the device is asked: emitted by us, parsed by the simulated device. RT: yes.

use super::{Kind, MAX_REQUEST, Sampling};
use crate::base::bytes::Short;

/// The bytes of a request.
pub type RequestBytes = Short<MAX_REQUEST>;

/// What the device is asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Stop streaming; no reply.
    StopContinuous,
    /// Identity string number so and so.
    Identity(u8),
    /// Set the sampling.
    SetSampling(Sampling),
    /// Stream this.
    SetContinuous(Kind),
    /// Set or (0) ask the mode.
    Mode(u8),
    /// One measurement.
    Poll(Kind),
}

/// What a request parser found at the start of the bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Found {
    /// A request of so many bytes.
    Request(Request, usize),
    /// The start of one.
    Incomplete,
    /// Nothing that makes sense: skip a byte.
    Nothing,
}

impl Request {
    /// Its bytes.
    #[must_use]
    pub fn emit(&self) -> RequestBytes {
        match *self {
            Self::StopContinuous => RequestBytes::new(&[0xFA, 0x75, 0xB4]),
            Self::Identity(selector) => RequestBytes::new(&[0xEA, selector]),
            Self::SetContinuous(kind) => RequestBytes::new(&[0xC4, 0xC1, 0x29, kind as u8]),
            Self::Mode(mode) => RequestBytes::new(&[0xD4, 0xA3, 0x47, mode]),
            Self::Poll(kind) => RequestBytes::new(&[kind as u8]),
            Self::SetSampling(sampling) => {
                let mut bytes = RequestBytes::new(&[0xDB, 0xA8, 0xB9, 1]);
                bytes.put(&sampling.to_bytes());
                bytes
            }
        }
    }

    /// The device's end: the request at the start of `bytes`.
    #[must_use]
    pub fn parse(bytes: &[u8]) -> Found {
        match *bytes {
            [] | [0xFA] | [0xFA, 0x75] | [0xEA] => Found::Incomplete,
            [0xFA, 0x75, 0xB4, ..] => Found::Request(Self::StopContinuous, 3),
            [0xEA, selector, ..] => Found::Request(Self::Identity(selector), 2),
            [0xC4, 0xC1, 0x29, kind, ..] => match Kind::from_u8(kind).filter(|k| k.is_measurement()) {
                Some(kind) => Found::Request(Self::SetContinuous(kind), 4),
                None => Found::Nothing,
            },
            [0xD4, 0xA3, 0x47, mode, ..] => Found::Request(Self::Mode(mode), 4),
            [0xDB, 0xA8, 0xB9, 1, ..] => match bytes.get(4..MAX_REQUEST) {
                Some(settings) => Found::Request(Self::SetSampling(Sampling::from_bytes(settings)), MAX_REQUEST),
                None => Found::Incomplete,
            },
            [0xC4 | 0xD4 | 0xDB] | [0xC4, 0xC1] | [0xD4, 0xA3] | [0xDB, 0xA8] => Found::Incomplete,
            [0xC4, 0xC1, 0x29] | [0xD4, 0xA3, 0x47] | [0xDB, 0xA8, 0xB9] => Found::Incomplete,
            [first, ..] => match Kind::from_u8(first).filter(|k| k.is_measurement()) {
                Some(kind) => Found::Request(Self::Poll(kind), 1),
                None => Found::Nothing,
            },
        }
    }
}
