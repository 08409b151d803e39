//! Process data: what is mapped into which frame, and the bytes of it. RT: yes.
//!
//! | frame | of a torque drive (hip) | bytes | of a position drive (toes) | bytes |
//! |---|---|---|---|---|
//! | RPDO1 | controlword, target torque | 4 | controlword, target position | 6 |
//! | TPDO1 | statusword, position, torque | 8 | statusword, position, analogue input | 8 |
//!
//! A toe's analogue input is the potentiometer on its spring (object 0x6401 of CiA 401, which drives with an input offer
//! too); its torque nobody needs. Whether it all fits: `bus::budget`.

use super::canopen::PdoData;

/// One mapped object: index, sub-index, bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Index.
    pub index: u16,
    /// Sub-index.
    pub sub: u8,
    /// Length in bits.
    pub bits: u8,
}

impl Entry {
    /// As written into a mapping object.
    #[must_use]
    pub const fn raw(self) -> u32 {
        (self.index as u32) << 16 | (self.sub as u32) << 8 | self.bits as u32
    }

    /// As read from a mapping object.
    #[must_use]
    pub const fn from_raw(raw: u32) -> Self {
        let [bits, sub, low, high] = raw.to_le_bytes();
        Self { index: u16::from_le_bytes([low, high]), sub, bits }
    }
}

const CONTROLWORD: Entry = Entry { index: 0x6040, sub: 0, bits: 16 };
const STATUSWORD: Entry = Entry { index: 0x6041, sub: 0, bits: 16 };
const POSITION: Entry = Entry { index: 0x6064, sub: 0, bits: 32 };
const TORQUE: Entry = Entry { index: 0x6077, sub: 0, bits: 16 };
const ANALOG_INPUT: Entry = Entry { index: 0x6401, sub: 1, bits: 16 };
const TARGET_TORQUE: Entry = Entry { index: 0x6071, sub: 0, bits: 16 };
const TARGET_POSITION: Entry = Entry { index: 0x607A, sub: 0, bits: 32 };

/// Mapping of RPDO1 of a torque drive.
pub const TORQUE_COMMAND: &[Entry] = &[CONTROLWORD, TARGET_TORQUE];
/// Mapping of TPDO1 of a torque drive.
pub const TORQUE_ANSWER: &[Entry] = &[STATUSWORD, POSITION, TORQUE];
/// Mapping of RPDO1 of a position drive.
pub const POSITION_COMMAND: &[Entry] = &[CONTROLWORD, TARGET_POSITION];
/// Mapping of TPDO1 of a position drive.
pub const POSITION_ANSWER: &[Entry] = &[STATUSWORD, POSITION, ANALOG_INPUT];

/// Bytes of a mapping.
#[must_use]
pub fn mapped_bytes(entries: &[Entry]) -> u8 {
    entries.iter().map(|e| e.bits / 8).sum()
}

/// RPDO1 with a torque.
#[must_use]
pub fn torque_command(controlword: u16, torque_permille: i16) -> PdoData {
    let [c0, c1] = controlword.to_le_bytes();
    let [t0, t1] = torque_permille.to_le_bytes();
    PdoData { len: 4, data: [c0, c1, t0, t1, 0, 0, 0, 0] }
}

/// RPDO1 with a position.
#[must_use]
pub fn position_command(controlword: u16, position_counts: i32) -> PdoData {
    let [c0, c1] = controlword.to_le_bytes();
    let [p0, p1, p2, p3] = position_counts.to_le_bytes();
    PdoData { len: 6, data: [c0, c1, p0, p1, p2, p3, 0, 0] }
}

/// What TPDO1 tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Answer {
    /// Statusword.
    pub statusword: u16,
    /// Position, counts.
    pub position_counts: i32,
    /// Torque drive: torque, 1/1000 of rated. Position drive: analogue input, counts.
    pub third: i16,
}

impl Answer {
    /// Reads TPDO1 of either kind of drive; `None` at any other length.
    #[must_use]
    pub fn parse(pdo: &PdoData) -> Option<Self> {
        let [s0, s1, p0, p1, p2, p3, t0, t1] = pdo.data;
        (pdo.len == 8).then_some(Self {
            statusword: u16::from_le_bytes([s0, s1]),
            position_counts: i32::from_le_bytes([p0, p1, p2, p3]),
            third: i16::from_le_bytes([t0, t1]),
        })
    }

    /// Its process data.
    #[must_use]
    pub fn emit(&self) -> PdoData {
        let [s0, s1] = self.statusword.to_le_bytes();
        let [p0, p1, p2, p3] = self.position_counts.to_le_bytes();
        let [t0, t1] = self.third.to_le_bytes();
        PdoData { len: 8, data: [s0, s1, p0, p1, p2, p3, t0, t1] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn mappings_are_those_of_the_reference() {
        assert_eq!(TORQUE_COMMAND.iter().map(|e| e.raw()).collect::<Vec<_>>(), [0x6040_0010, 0x6071_0010]);
        assert_eq!(TORQUE_ANSWER.iter().map(|e| e.raw()).collect::<Vec<_>>(), [0x6041_0010, 0x6064_0020, 0x6077_0010]);
        assert_eq!(mapped_bytes(TORQUE_COMMAND), 4);
        assert_eq!(mapped_bytes(TORQUE_ANSWER), 8);
        assert_eq!(mapped_bytes(POSITION_COMMAND), 6);
        assert_eq!(mapped_bytes(POSITION_ANSWER), 8);
    }

    #[test]
    fn process_data_match_the_reference() {
        assert_eq!(torque_command(0x000F, 250).bytes(), [0x0F, 0x00, 0xFA, 0x00]);
        let answer = PdoData { len: 8, data: [0x37, 0x16, 0xA0, 0x86, 0x01, 0x00, 0xF8, 0x00] };
        let expected = Answer { statusword: 0x1637, position_counts: 100_000, third: 248 };
        assert_eq!(Answer::parse(&answer), Some(expected));
    }

    #[test]
    fn answers_are_refused_at_every_wrong_length() {
        for len in (0..=8).filter(|len| *len != 8) {
            assert_eq!(Answer::parse(&PdoData { len, data: [0; 8] }), None);
        }
    }

    proptest! {
        #[test]
        fn answers_and_entries_survive_the_round_trip(statusword: u16, position_counts: i32, third: i16, raw: u32) {
            let answer = Answer { statusword, position_counts, third };
            prop_assert_eq!(Answer::parse(&answer.emit()), Some(answer));
            prop_assert_eq!(Entry::from_raw(raw).raw(), raw);
        }
    }
}
