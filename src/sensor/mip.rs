//! MicroStrain MIP, big endian: packets both ways, and a parser that finds its feet again.
//!
//! A packet is `75 65`, descriptor set, length of the payload, payload, two check bytes. The payload is a row of fields:
//! length (with this head of two bytes), descriptor, data. The check is a running pair of sums over everything before it.
//! RT: yes, no allocation.

use crate::base::bytes::{BigEndian, Short};

/// First bytes of every packet.
const SYNC: [u8; 2] = [0x75, 0x65];
/// Bytes before the payload.
const HEAD: usize = 4;
/// Longest packet: 255 bytes of payload.
pub const MAX_PACKET: usize = HEAD + 255 + 2;

/// Descriptor sets.
pub mod set {
    /// Commands of every device.
    pub const BASE: u8 = 0x01;
    /// Commands of the sensors.
    pub const SENSOR: u8 = 0x0C;
    /// Data of the sensors.
    pub const DATA: u8 = 0x80;
}

/// Field: acknowledge, of any command set: command's descriptor, code.
pub const ACKNOWLEDGE: u8 = 0xF1;

/// A packet that we send: all of ours are short.
pub type Request = Short<32>;

/// Commands, as the device's documents name them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Nothing but an answer.
    Ping,
    /// Stop streaming.
    Idle,
    /// Who are you?
    Info,
    /// How many samples a second at most?
    BaseRate,
    /// What a data packet holds: descriptors, each at every so many-th sample.
    Format {
        /// Descriptors of the data set.
        fields: [u8; 3],
        /// Base rate over rate.
        decimation: u16,
    },
    /// Begin to stream.
    Stream,
}

impl Command {
    /// Descriptor set and descriptor: what its acknowledge names.
    #[must_use]
    pub const fn descriptors(self) -> (u8, u8) {
        match self {
            Self::Ping => (set::BASE, 0x01),
            Self::Idle => (set::BASE, 0x02),
            Self::Info => (set::BASE, 0x03),
            Self::BaseRate => (set::SENSOR, 0x06),
            Self::Format { .. } => (set::SENSOR, 0x08),
            Self::Stream => (set::SENSOR, 0x11),
        }
    }

    /// Its packet.
    #[must_use]
    pub fn packet(self) -> Request {
        let mut data = Short::<16>::new(&[]);
        match self {
            Self::Ping | Self::Idle | Self::Info | Self::BaseRate => {}
            Self::Format { fields, decimation } => {
                data.put(&[1, 3]);
                for field in fields {
                    data.put(&[field]);
                    data.put(&decimation.to_be_bytes());
                }
            }
            // Apply; the sensors' data; on.
            Self::Stream => data.put(&[1, 1, 1]),
        }
        let (set, field) = self.descriptors();
        packet(set, &[(field, data.as_slice())])
    }
}

/// A packet of these fields. What does not fit is cut off, so `N` is chosen for the longest.
#[must_use]
pub fn packet<const N: usize>(set: u8, fields: &[(u8, &[u8])]) -> Short<N> {
    let length: usize = fields.iter().map(|(_, data)| data.len() + 2).sum();
    let [s0, s1] = SYNC;
    let mut out = Short::new(&[s0, s1, set, u8::try_from(length).unwrap_or(u8::MAX)]);
    for (descriptor, data) in fields {
        out.put(&[u8::try_from(data.len() + 2).unwrap_or(u8::MAX), *descriptor]);
        out.put(data);
    }
    let check = check(out.as_slice());
    out.put(&check);
    out
}

/// The running pair of sums.
#[must_use]
pub fn check(bytes: &[u8]) -> [u8; 2] {
    bytes.iter().fold([0, 0], |[a, b]: [u8; 2], byte| {
        let a = a.wrapping_add(*byte);
        [a, b.wrapping_add(a)]
    })
}

/// A packet whose check is right.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet<'a> {
    /// Its descriptor set.
    pub set: u8,
    payload: &'a [u8],
}

impl<'a> Packet<'a> {
    /// Reads exactly one packet; `None` if sync, length or check is wrong.
    #[must_use]
    pub fn parse(bytes: &'a [u8]) -> Option<Self> {
        let (body, sums) = bytes.split_last_chunk::<2>()?;
        let (&[a, b, set, length], payload) = body.split_first_chunk::<HEAD>()?;
        let right = [a, b] == SYNC && usize::from(length) == payload.len() && check(body) == *sums;
        right.then_some(Self { set, payload })
    }

    /// Descriptor and data of each field. Ends at a length that cannot be.
    pub fn fields(self) -> impl Iterator<Item = (u8, &'a [u8])> {
        let mut rest = self.payload;
        std::iter::from_fn(move || {
            let [length, descriptor, ..] = *rest else { return None };
            let field = rest.get(..usize::from(length))?;
            rest = rest.get(usize::from(length)..)?;
            Some((descriptor, field.get(2..)?))
        })
    }

    /// The code with which this packet acknowledges a command: 0 is yes. `None`: it does not.
    #[must_use]
    pub fn acknowledges(self, command: Command) -> Option<u8> {
        let (set, descriptor) = command.descriptors();
        if self.set != set {
            return None;
        }
        self.fields().find_map(|(field, data)| match (field, data) {
            (ACKNOWLEDGE, [echo, code]) if *echo == descriptor => Some(*code),
            _ => None,
        })
    }

    /// What the sensors measured, if this is their data.
    #[must_use]
    pub fn measurement(self) -> Option<Measurement> {
        if self.set != set::DATA {
            return None;
        }
        let mut measured = Measurement::default();
        for (descriptor, data) in self.fields() {
            let mut r = BigEndian(data);
            match (descriptor, data.len()) {
                (field::ACCEL, 12) => measured.accel_g = Some(r.floats()),
                (field::RATE, 12) => measured.rate_rad_s = Some(r.floats()),
                (field::EULER, 12) => measured.euler_rad = Some(r.floats()),
                (field::TIME_OF_WEEK | field::SHARED_TIME_OF_WEEK, 12) => {
                    measured.time_s = Some(f64::from_be_bytes(r.bytes()));
                }
                _ => {}
            }
        }
        Some(measured)
    }
}

/// Fields of the sensors' data.
pub mod field {
    /// Specific force, g.
    pub const ACCEL: u8 = 0x04;
    /// Rate, rad/s.
    pub const RATE: u8 = 0x05;
    /// Roll, pitch, yaw, rad.
    pub const EULER: u8 = 0x0C;
    /// Time of week (f64, s), week, flags.
    pub const TIME_OF_WEEK: u8 = 0x12;
    /// The same of newer devices.
    pub const SHARED_TIME_OF_WEEK: u8 = 0xD3;
}

/// What a data packet holds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Measurement {
    /// Specific force, g.
    pub accel_g: Option<[f32; 3]>,
    /// Rate, rad/s.
    pub rate_rad_s: Option<[f32; 3]>,
    /// Roll, pitch, yaw, rad.
    pub euler_rad: Option<[f32; 3]>,
    /// The device's clock, s in the week.
    pub time_s: Option<f64>,
}

/// Finds packets in a stream of bytes. A wrong check costs one byte, not a packet: the search goes on behind it.
#[derive(Clone, Debug)]
pub struct Parser {
    held: [u8; MAX_PACKET],
    count: usize,
    /// Candidates whose check was wrong.
    pub failures: u32,
    /// Bytes that belonged to no packet.
    pub skipped: u64,
}

impl Default for Parser {
    fn default() -> Self {
        Self { held: [0; MAX_PACKET], count: 0, failures: 0, skipped: 0 }
    }
}

impl Parser {
    /// Takes one byte; hands over the packets that are whole now: more than one only after a damaged head.
    pub fn push(&mut self, byte: u8, mut each: impl FnMut(Packet<'_>)) {
        if let Some(slot) = self.held.get_mut(self.count) {
            *slot = byte;
            self.count += 1;
        }
        // Each round waits for more, or drops at least one byte: at most MAX_PACKET rounds.
        while self.count > 0 {
            let held = self.held.get(..self.count).unwrap_or(&self.held);
            let gone = match expected_bytes(held) {
                Expected::More => return,
                Expected::Nothing => {
                    self.skipped = self.skipped.saturating_add(1);
                    1
                }
                Expected::Bytes(expected) if held.len() < expected => return,
                Expected::Bytes(expected) => match held.get(..expected).and_then(Packet::parse) {
                    Some(packet) => {
                        each(packet);
                        expected
                    }
                    None => {
                        self.failures = self.failures.saturating_add(1);
                        self.skipped = self.skipped.saturating_add(1);
                        1
                    }
                },
            };
            self.held.copy_within(gone..self.count, 0);
            self.count -= gone;
        }
    }

    /// Bytes that wait for the rest of their packet.
    #[must_use]
    pub const fn waiting(&self) -> usize {
        self.count
    }
}

/// What may start here.
enum Expected {
    /// A packet, but its length is not here yet.
    More,
    /// A packet of so many bytes.
    Bytes(usize),
    /// No packet.
    Nothing,
}

fn expected_bytes(held: &[u8]) -> Expected {
    match held {
        [0x75] | [0x75, 0x65] | [0x75, 0x65, _] => Expected::More,
        [0x75, 0x65, _, length, ..] => Expected::Bytes(HEAD + usize::from(*length) + 2),
        _ => Expected::Nothing,
    }
}

#[cfg(test)]
mod tests;
