//! The moteus register protocol over CAN-FD, as far as we speak it; both ends. Little endian. RT: yes.
//!
//! A frame is a row of sub-frames: write, read or reply, each with the type of its values, their number, the first
//! register and, but for reads, the values. Bit 15 of the identifier asks for a reply. Filler is 0x50.

use crate::base::bytes::Short;
use crate::msg::{CanFrame, MAX_DATA};

/// Fills a frame up to the next length of CAN-FD.
pub const FILLER: u8 = 0x50;
/// Bit of the identifier that asks for a reply.
const REPLY: u32 = 0x8000;

/// Mode.
pub const MODE: u16 = 0x000;
/// Position, turns.
pub const POSITION: u16 = 0x001;
/// Velocity, turns/s.
pub const VELOCITY: u16 = 0x002;
/// Torque, Nm.
pub const TORQUE: u16 = 0x003;
/// Voltage; after it the temperature of the board and the fault.
pub const VOLTAGE: u16 = 0x00D;
/// Fault code.
pub const FAULT: u16 = 0x00F;
/// First register of a position command.
pub const COMMAND_POSITION: u16 = 0x020;
/// Version of the register map.
pub const MAP_VERSION: u16 = 0x102;

/// Mode: no power.
pub const STOPPED: u8 = 0;
/// Mode: a fault, or fault codes.
pub const FAULTED: u8 = 1;
/// Mode: follows commands.
pub const POSITION_MODE: u8 = 10;
/// Mode: no command came for too long; latched.
pub const TIMED_OUT: u8 = 11;

/// Type of the values of a sub-frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Type {
    /// One byte.
    I8,
    /// Two bytes.
    I16,
    /// Four bytes.
    I32,
    /// Float.
    F32,
}

impl Type {
    const fn from_bits(bits: u8) -> Self {
        match bits & 0x0C {
            0x00 => Self::I8,
            0x04 => Self::I16,
            0x08 => Self::I32,
            _ => Self::F32,
        }
    }
}

/// A value as it travels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RawValue {
    /// Its type.
    pub kind: Type,
    /// The number: an integer in units of its register, or a float.
    pub number: f64,
    /// It says that there is no value: smallest integer, or NaN.
    pub unset: bool,
}

impl RawValue {
    /// In SI or turns; `None` if unset or not finite. `units`: one of an i8, i16 and i32.
    #[must_use]
    pub fn scaled(&self, units: [f64; 3]) -> Option<f64> {
        let [i8, i16, i32] = units;
        let unit = match self.kind {
            Type::I8 => i8,
            Type::I16 => i16,
            Type::I32 => i32,
            Type::F32 => 1.0,
        };
        Some(self.number * unit).filter(|x| !self.unset && x.is_finite())
    }

    /// A small whole number, such as a mode.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in the range of a byte")]
    pub fn small(&self) -> Option<u8> {
        (!self.unset && (0.0..=255.0).contains(&self.number)).then_some(self.number as u8)
    }
}

/// Units of positions, turns.
pub const POSITION_UNITS: [f64; 3] = [0.01, 0.0001, 0.000_01];
/// Units of torques, Nm.
pub const TORQUE_UNITS: [f64; 3] = [0.5, 0.01, 0.001];

/// What a sub-frame says, value by value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Item {
    /// This register shall have this value.
    Write(u16, RawValue),
    /// This register is asked for, as this type.
    Read(u16, Type),
    /// This register has this value.
    Reply(u16, RawValue),
    /// Writing (true) or reading this register failed.
    Error(bool, u16),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Verb {
    Write,
    Read,
    Reply,
}

/// Walks over the items of a frame. Ends early, with `broken` set, at bytes that make no sense.
#[derive(Clone, Debug)]
pub struct Items<'a> {
    bytes: &'a [u8],
    row: Option<(Verb, Type, u32, u16)>,
    /// The rest could not be read.
    pub broken: bool,
}

/// The items of a payload.
#[must_use]
pub const fn items(payload: &[u8]) -> Items<'_> {
    Items { bytes: payload, row: None, broken: false }
}

impl Items<'_> {
    fn byte(&mut self) -> Option<u8> {
        let (first, rest) = self.bytes.split_first()?;
        self.bytes = rest;
        Some(*first)
    }

    fn varuint(&mut self) -> Option<u32> {
        let mut value = 0;
        for shift in [0, 7, 14] {
            let byte = self.byte()?;
            value |= u32::from(byte & 0x7F) << shift;
            if byte & 0x80 == 0 {
                return Some(value);
            }
        }
        None
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (first, rest) = self.bytes.split_first_chunk::<N>()?;
        self.bytes = rest;
        Some(*first)
    }

    fn value(&mut self, kind: Type) -> Option<RawValue> {
        let (number, unset) = match kind {
            Type::I8 => self.array().map(i8::from_le_bytes).map(|x| (f64::from(x), x == i8::MIN))?,
            Type::I16 => self.array().map(i16::from_le_bytes).map(|x| (f64::from(x), x == i16::MIN))?,
            Type::I32 => self.array().map(i32::from_le_bytes).map(|x| (f64::from(x), x == i32::MIN))?,
            Type::F32 => self.array().map(f32::from_le_bytes).map(|x| (f64::from(x), x.is_nan()))?,
        };
        Some(RawValue { kind, number, unset })
    }

    /// The next item of the row that was begun.
    fn next_of_row(&mut self) -> Option<Item> {
        let (verb, kind, left, register) = self.row?;
        self.row = (left > 1).then_some((verb, kind, left - 1, register.wrapping_add(1)));
        Some(match verb {
            Verb::Read => Item::Read(register, kind),
            Verb::Write => Item::Write(register, self.value(kind)?),
            Verb::Reply => Item::Reply(register, self.value(kind)?),
        })
    }

    /// Opens the next sub-frame. An error is an item by itself.
    fn open(&mut self, command: u8) -> Option<Option<Item>> {
        let verb = match command & 0xF0 {
            0x00 => Verb::Write,
            0x10 => Verb::Read,
            0x20 => Verb::Reply,
            0x30 if command <= 0x31 => {
                let register = u16::try_from(self.varuint()?).ok()?;
                self.varuint()?;
                return Some(Some(Item::Error(command == 0x30, register)));
            }
            _ => return None,
        };
        let count = match command & 0x03 {
            0 => self.varuint()?,
            n => u32::from(n),
        };
        let first = u16::try_from(self.varuint()?).ok()?;
        // More values than a frame has bytes are none.
        self.row = (1..=64).contains(&count).then_some((verb, Type::from_bits(command), count, first));
        self.row.map(|_| None)
    }
}

impl Iterator for Items<'_> {
    type Item = Item;
    fn next(&mut self) -> Option<Item> {
        // Each turn uses up a byte or ends.
        while !self.broken {
            let found = if self.row.is_some() {
                self.next_of_row().map(Some)
            } else {
                match self.byte() {
                    None => return None,
                    Some(FILLER) => Some(None),
                    Some(command) => self.open(command),
                }
            };
            match found {
                Some(Some(item)) => return Some(item),
                Some(None) => {}
                None => self.broken = true,
            }
        }
        None
    }
}

/// What a drive is asked for in its position mode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command {
    /// Turns; NaN = none.
    pub position: f32,
    /// Torque on top, Nm.
    pub torque_nm: f32,
    /// Share of the configured stiffness and damping.
    pub gain: f32,
    /// Most torque, Nm.
    pub max_torque_nm: f32,
    /// Without another command for so long, s, it stops.
    pub watchdog_s: f32,
}

/// Bytes under construction.
type Bytes = Short<MAX_DATA>;

/// Asks for mode (i8), position, velocity, torque (f32), voltage, temperature, fault (i8).
const QUERY: [u8; 6] = [0x11, 0x00, 0x1F, 0x01, 0x13, 0x0D];

/// A frame to a drive.
fn to_drive(node: u8, reply: bool, bytes: &Bytes) -> CanFrame {
    let id = if reply { REPLY | u32::from(node) } else { u32::from(node) };
    let flag = if id > 0x7FF { CanFrame::EXTENDED } else { 0 };
    CanFrame::fd(id | flag, bytes.as_slice(), FILLER)
}

/// Power off; asks how it is.
#[must_use]
pub fn stop(node: u8) -> CanFrame {
    let mut bytes = Bytes::new(&[0x01, 0x00, STOPPED]);
    bytes.put(&QUERY);
    to_drive(node, true, &bytes)
}

/// Asks how it is.
#[must_use]
pub fn query(node: u8) -> CanFrame {
    to_drive(node, true, &Bytes::new(&QUERY))
}

/// Asks for the version of its register map.
#[must_use]
pub fn ask_version(node: u8) -> CanFrame {
    // Register 0x102 as a varuint.
    to_drive(node, true, &Bytes::new(&[0x19, 0x82, 0x02]))
}

/// A command in position mode; asks how it is. A command register that is not named goes to its default.
#[must_use]
pub fn command(node: u8, command: &Command) -> CanFrame {
    let mut bytes = Bytes::new(&[0x01, 0x00, POSITION_MODE, 0x0C, 8, 0x20]);
    let Command { position, torque_nm, gain, max_torque_nm, watchdog_s } = *command;
    // Position, velocity, torque, kp and kd scale, most torque, stop position, watchdog: registers 0x20 to 0x27.
    for value in [position, 0.0, torque_nm, gain, gain, max_torque_nm, f32::NAN, watchdog_s] {
        bytes.put(&value.to_le_bytes());
    }
    bytes.put(&QUERY);
    to_drive(node, true, &bytes)
}

/// True for the identifier of our frames to it, whether or not they ask for a reply.
#[must_use]
pub fn is_to(node: u8, id: u32) -> bool {
    id == CanFrame::EXTENDED | REPLY | u32::from(node) || id == u32::from(node)
}

/// Identifier of its replies.
#[must_use]
pub const fn reply_id(node: u8) -> u32 {
    let id = (node as u32) << 8;
    if id > 0x7FF { id | CanFrame::EXTENDED } else { id }
}

/// How a drive is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Status {
    /// Mode.
    pub mode: u8,
    /// Position, turns; NaN = none.
    pub position: f32,
    /// Velocity, turns/s.
    pub velocity: f32,
    /// Torque, Nm.
    pub torque_nm: f32,
    /// Fault code; 96 to 103 tell what limits the torque and are none.
    pub fault: u8,
}

/// The drive's end: the answer to [`QUERY`].
#[must_use]
pub fn reply(node: u8, status: &Status) -> CanFrame {
    let mut bytes = Bytes::new(&[0x21, 0x00, status.mode, 0x2F, 0x01]);
    for value in [status.position, status.velocity, status.torque_nm] {
        bytes.put(&value.to_le_bytes());
    }
    // Volts by halves, board at 25 degrees.
    bytes.put(&[0x23, 0x0D, 48, 25, status.fault]);
    CanFrame::fd(reply_id(node), bytes.as_slice(), FILLER)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read(payload: &[u8]) -> Vec<Item> {
        items(payload).collect()
    }

    #[test]
    fn the_default_query_reads_as_the_documentation_says() {
        let types = [Type::I8, Type::F32, Type::F32, Type::F32, Type::I8, Type::I8, Type::I8];
        let registers = [MODE, POSITION, VELOCITY, TORQUE, VOLTAGE, 0x00E, FAULT];
        let expected: Vec<Item> = registers.into_iter().zip(types).map(|(r, t)| Item::Read(r, t)).collect();
        assert_eq!(read(&[0x11, 0x00, 0x1F, 0x01, 0x13, 0x0D]), expected);
    }

    #[test]
    fn the_documented_reply_reads_in_its_units() {
        let reply = [0x24, 0x04, 0x00, 0x0A, 0x00, 0x50, 0x00, 0x00, 0x01, 0x70, 0xFF, 0x23, 0x0D, 0x18, 0x14, 0x00];
        let found = read(&reply);
        let value = |register| {
            found.iter().find_map(|i| match i {
                Item::Reply(r, v) if *r == register => Some(*v),
                _ => None,
            })
        };
        assert_eq!(value(MODE).unwrap().small(), Some(10));
        let position = value(POSITION).unwrap().scaled(POSITION_UNITS).unwrap();
        let torque = value(TORQUE).unwrap().scaled(TORQUE_UNITS).unwrap();
        assert!((position - 0.0080).abs() < 1e-12 && (torque + 1.44).abs() < 1e-12, "{position} {torque}");
        assert_eq!(value(FAULT).unwrap().small(), Some(0));
    }

    #[test]
    fn a_torque_command_is_the_documented_one_with_stop_position_and_watchdog_behind_it() {
        let torque = Command { position: f32::NAN, torque_nm: 0.5, gain: 0.0, max_torque_nm: 2.0, watchdog_s: 0.05 };
        let frame = command(1, &torque);
        assert_eq!((frame.id, frame.len, frame.is_fd()), (0x8000_8001, 48, true));
        let documented =
            [0x20, 0x00, 0x00, 0xC0, 0x7F, 0, 0, 0, 0, 0, 0, 0, 0x3F, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x40];
        assert_eq!(frame.payload()[..5], [0x01, 0x00, 0x0A, 0x0C, 0x08]);
        assert_eq!(frame.payload()[5..30], documented);
        assert_eq!(frame.payload()[38..44], QUERY);
        assert_eq!(frame.payload()[44..], [0x50; 4]);
    }

    #[test]
    fn identifiers_are_those_of_the_reference() {
        assert!(is_to(1, 0x8000_8001) && is_to(1, 1) && !is_to(1, 0x8001) && !is_to(2, 1));
        assert_eq!([1, 7, 8].map(reply_id), [0x100, 0x700, 0x8000_0800]);
    }

    #[test]
    fn unset_values_are_none() {
        // The number of values in the command, and as a varuint behind it.
        for bytes in [&[0x21, 0x0F, 0x80][..], &[0x20, 0x01, 0x0F, 0x80]] {
            let Item::Reply(FAULT, value) = read(bytes)[0] else { panic!("{bytes:?}") };
            assert_eq!((value.small(), value.scaled([1.0; 3])), (None, None));
        }
    }

    #[test]
    fn read_errors_are_items() {
        assert_eq!(read(&[0x31, 0x82, 0x02, 0x01]), [Item::Error(false, 0x102)]);
    }

    proptest! {
        #[test]
        fn replies_survive_the_round_trip(mode: u8, position: f32, torque_nm: f32, fault in 0_u8..128) {
            let status = Status { mode: mode & 0x0F, position, velocity: 0.0, torque_nm, fault };
            let frame = reply(3, &status);
            for item in items(frame.payload()) {
                match item {
                    Item::Reply(MODE, v) => prop_assert_eq!(v.small(), Some(status.mode)),
                    Item::Reply(FAULT, v) => prop_assert_eq!(v.small(), Some(fault)),
                    Item::Reply(POSITION, v) if position.is_finite() =>
                        prop_assert_eq!(v.scaled(POSITION_UNITS), Some(f64::from(position))),
                    Item::Reply(TORQUE, v) if torque_nm.is_finite() =>
                        prop_assert_eq!(v.scaled(TORQUE_UNITS), Some(f64::from(torque_nm))),
                    Item::Reply(..) => {}
                    other => prop_assert!(false, "{:?}", other),
                }
            }
        }

        #[test]
        fn random_bytes_never_panic_and_end(bytes in prop::collection::vec(any::<u8>(), 0..=64)) {
            // At most 64 reads of one value each per three bytes.
            prop_assert!(items(&bytes).count() <= 64 * 64);
        }
    }
}
