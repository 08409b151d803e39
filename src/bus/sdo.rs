//! Service data objects of CiA 301, expedited transfers: reading and writing up to four bytes of a device's objects.
//! Segmented transfers are not needed for any object that we use; their frames read as `None`. RT: yes.

/// An entry of a device's object dictionary.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Address {
    /// Index.
    pub index: u16,
    /// Sub-index.
    pub sub: u8,
}

impl Address {
    /// Index and sub-index.
    #[must_use]
    pub const fn new(index: u16, sub: u8) -> Self {
        Self { index, sub }
    }
}

/// One to four bytes, little endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SdoValue {
    bytes: u8,
    raw: u32,
}

impl SdoValue {
    /// One byte.
    #[must_use]
    pub const fn u8(v: u8) -> Self {
        Self { bytes: 1, raw: v as u32 }
    }
    /// One byte, signed.
    #[must_use]
    pub const fn i8(v: i8) -> Self {
        Self::u8(v.cast_unsigned())
    }
    /// Two bytes.
    #[must_use]
    pub const fn u16(v: u16) -> Self {
        Self { bytes: 2, raw: v as u32 }
    }
    /// Two bytes, signed.
    #[must_use]
    pub const fn i16(v: i16) -> Self {
        Self::u16(v.cast_unsigned())
    }
    /// Four bytes.
    #[must_use]
    pub const fn u32(v: u32) -> Self {
        Self { bytes: 4, raw: v }
    }
    /// Four bytes, signed.
    #[must_use]
    pub const fn i32(v: i32) -> Self {
        Self::u32(v.cast_unsigned())
    }
    /// Number of bytes, 1 to 4.
    #[must_use]
    pub const fn len(self) -> u8 {
        self.bytes
    }
    /// Never: a value has at least one byte.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        false
    }
    /// The bytes as an unsigned number.
    #[must_use]
    pub const fn raw(self) -> u32 {
        self.raw
    }

    /// So many low bytes of `data`.
    fn from_bytes(data: [u8; 4], bytes: u8) -> Self {
        let mask = u32::MAX >> (8 * (4 - u32::from(bytes.clamp(1, 4))));
        Self { bytes, raw: u32::from_le_bytes(data) & mask }
    }
}

/// Why a transfer was refused (CiA 301, table of abort codes).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AbortCode(pub u32);

impl AbortCode {
    /// Protocol timed out.
    pub const TIMEOUT: Self = Self(0x0504_0000);
    /// Command byte unknown.
    pub const UNKNOWN_COMMAND: Self = Self(0x0504_0001);
    /// The object can only be written.
    pub const WRITE_ONLY: Self = Self(0x0601_0001);
    /// The object can only be read.
    pub const READ_ONLY: Self = Self(0x0601_0002);
    /// There is no such object.
    pub const NO_SUCH_OBJECT: Self = Self(0x0602_0000);
    /// The object cannot be mapped into process data.
    pub const NOT_MAPPABLE: Self = Self(0x0604_0041);
    /// More than eight bytes of process data.
    pub const MAPPING_TOO_LONG: Self = Self(0x0604_0042);
    /// Number of bytes does not fit the object.
    pub const WRONG_LENGTH: Self = Self(0x0607_0010);
    /// There is no such sub-index.
    pub const NO_SUCH_SUB: Self = Self(0x0609_0011);
    /// Value out of its range.
    pub const VALUE_RANGE: Self = Self(0x0609_0030);
    /// Not in this state of the device.
    pub const WRONG_STATE: Self = Self(0x0800_0022);

    /// True if the device just does not have what was asked for.
    #[must_use]
    pub const fn is_missing_object(self) -> bool {
        self.0 == Self::NO_SUCH_OBJECT.0 || self.0 == Self::NO_SUCH_SUB.0
    }
}

/// Question to an object server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SdoRequest {
    /// Read an object.
    Read(Address),
    /// Write an object.
    Write(Address, SdoValue),
    /// Give up.
    Abort(Address, AbortCode),
}

/// Answer of an object server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SdoReply {
    /// The object's value.
    Value(Address, SdoValue),
    /// The write was accepted.
    Written(Address),
    /// The transfer was refused.
    Abort(Address, AbortCode),
}

const READ: u8 = 0x40;
const WRITTEN: u8 = 0x60;
const ABORT: u8 = 0x80;
/// Expedited write or value: bit 1 expedited, bit 0 size told, bits 2 and 3 number of unused bytes.
const WRITE: u8 = 0x20;
const VALUE: u8 = 0x40;

impl SdoRequest {
    /// Reads the eight bytes of a request.
    #[must_use]
    pub fn parse(b: [u8; 8]) -> Option<Self> {
        let (address, data) = split(b);
        match b[0] {
            READ => Some(Self::Read(address)),
            ABORT => Some(Self::Abort(address, AbortCode(u32::from_le_bytes(data)))),
            command => Some(Self::Write(address, expedited(command, WRITE, data)?)),
        }
    }

    /// Its eight bytes.
    #[must_use]
    pub fn emit(&self) -> [u8; 8] {
        match *self {
            Self::Read(address) => join(READ, address, 0),
            Self::Write(address, value) => join(expedited_command(WRITE, value), address, value.raw),
            Self::Abort(address, code) => join(ABORT, address, code.0),
        }
    }
}

impl SdoReply {
    /// Reads the eight bytes of an answer.
    #[must_use]
    pub fn parse(b: [u8; 8]) -> Option<Self> {
        let (address, data) = split(b);
        match b[0] {
            WRITTEN => Some(Self::Written(address)),
            ABORT => Some(Self::Abort(address, AbortCode(u32::from_le_bytes(data)))),
            command => Some(Self::Value(address, expedited(command, VALUE, data)?)),
        }
    }

    /// Its eight bytes.
    #[must_use]
    pub fn emit(&self) -> [u8; 8] {
        match *self {
            Self::Value(address, value) => join(expedited_command(VALUE, value), address, value.raw),
            Self::Written(address) => join(WRITTEN, address, 0),
            Self::Abort(address, code) => join(ABORT, address, code.0),
        }
    }

    /// The object it speaks of.
    #[must_use]
    pub const fn address(&self) -> Address {
        match self {
            Self::Value(address, _) | Self::Written(address) | Self::Abort(address, _) => *address,
        }
    }
}

fn split(b: [u8; 8]) -> (Address, [u8; 4]) {
    (Address::new(u16::from_le_bytes([b[1], b[2]]), b[3]), [b[4], b[5], b[6], b[7]])
}

fn join(command: u8, address: Address, data: u32) -> [u8; 8] {
    let [low, high] = address.index.to_le_bytes();
    let [a, b, c, d] = data.to_le_bytes();
    [command, low, high, address.sub, a, b, c, d]
}

/// The value of an expedited command of `kind`; one that does not tell its size has four bytes.
fn expedited(command: u8, kind: u8, data: [u8; 4]) -> Option<SdoValue> {
    if command & 0xF0 != kind || command & 0x02 == 0 {
        return None;
    }
    let unused = if command & 0x01 != 0 { (command >> 2) & 3 } else { 0 };
    Some(SdoValue::from_bytes(data, 4 - unused))
}

fn expedited_command(kind: u8, value: SdoValue) -> u8 {
    kind | 0x03 | ((4 - value.bytes.clamp(1, 4)) << 2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn command_bytes_tell_the_number_of_bytes() {
        let at = Address::new(0x6060, 0);
        let writes = [(1, 0x2F), (2, 0x2B), (3, 0x27), (4, 0x23)];
        let values = [(1, 0x4F), (2, 0x4B), (3, 0x47), (4, 0x43)];
        for ((bytes, write), (_, value)) in writes.into_iter().zip(values) {
            let v = SdoValue { bytes, raw: 1 };
            assert_eq!(SdoRequest::Write(at, v).emit()[0], write);
            assert_eq!(SdoReply::Value(at, v).emit()[0], value);
        }
    }

    #[test]
    fn reading_the_mode_matches_the_reference() {
        let ask = SdoRequest::Read(Address::new(0x6061, 0));
        assert_eq!(ask.emit(), [0x40, 0x61, 0x60, 0, 0, 0, 0, 0]);
        let answer = SdoReply::parse([0x4F, 0x61, 0x60, 0, 0x0A, 0, 0, 0]);
        assert_eq!(answer, Some(SdoReply::Value(Address::new(0x6061, 0), SdoValue::i8(10))));
    }

    #[test]
    fn bytes_beyond_the_told_size_do_not_count() {
        let answer = SdoReply::parse([0x4B, 0x41, 0x60, 0, 0x37, 0x16, 0xDE, 0xAD]);
        assert_eq!(answer, Some(SdoReply::Value(Address::new(0x6041, 0), SdoValue::u16(0x1637))));
    }

    #[test]
    fn segmented_transfers_are_not_mistaken_for_values() {
        assert_eq!(SdoReply::parse([0x41, 0x08, 0x10, 0, 9, 0, 0, 0]), None);
        assert_eq!(SdoRequest::parse([0x21, 0x08, 0x10, 0, 9, 0, 0, 0]), None);
    }

    proptest! {
        #[test]
        fn requests_and_replies_survive_the_round_trip(index: u16, sub: u8, raw: u32, bytes in 1u8..=4) {
            let at = Address::new(index, sub);
            let value = SdoValue::from_bytes(raw.to_le_bytes(), bytes);
            for request in [SdoRequest::Read(at), SdoRequest::Write(at, value), SdoRequest::Abort(at, AbortCode(raw))] {
                prop_assert_eq!(SdoRequest::parse(request.emit()), Some(request));
            }
            for reply in [SdoReply::Value(at, value), SdoReply::Written(at), SdoReply::Abort(at, AbortCode(raw))] {
                prop_assert_eq!(SdoReply::parse(reply.emit()), Some(reply));
            }
        }
    }
}
