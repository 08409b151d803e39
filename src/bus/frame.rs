//! How long a very frame of CAN or CAN-FD occupies the wire, in bits. RT: yes. The longest by length: `base::can_time`.
//!
//! Layout (ISO 11898-1): start, identifier, control and data and a 15-bit CRC are stuffed (after five equal bits one
//! of the other kind is put in); delimiters, acknowledge, end of frame and 3 bits of interframe space are not.

use crate::base::can_time::{BitRates, Bits, FD_TAIL_BITS, fd_crc_bits, fd_head_bits};
use crate::msg::CanFrame;

/// Bits after the stuffed part: CRC delimiter, acknowledge slot and delimiter, end of frame (7), interframe space (3).
const TAIL_BITS: u32 = 13;
/// Generator polynomial of the CRC, x^15 left out.
const CRC_POLYNOMIAL: u16 = 0x4599;

/// Bits of a frame without any stuffing.
#[must_use]
pub const fn plain_bits(len: u8, extended: bool) -> u32 {
    stuffed_part_bits(len, extended) + TAIL_BITS
}

/// Bits of a frame with the most stuffing that is possible.
#[must_use]
pub const fn worst_bits(len: u8, extended: bool) -> u32 {
    let part = stuffed_part_bits(len, extended);
    part + (part - 1) / 4 + TAIL_BITS
}

/// Bits that this very frame takes.
#[must_use]
pub fn exact_bits(frame: &CanFrame) -> u32 {
    let remote = frame.id & CanFrame::REMOTE != 0;
    let control = u64::from(remote) << 6 | u64::from(frame.len.min(8));
    // With as many bits before the start of frame as make whole bytes, which the tables take.
    let (mut counter, filler_bits) = if frame.id & CanFrame::EXTENDED == 0 {
        let mut counter = StuffCounter::before(0b10101, 5);
        counter.bytes(0b10101 << 19 | u64::from(frame.id & 0x7FF) << 7 | control, 3);
        (counter, 5)
    } else {
        let (high, low) = (u64::from(frame.id >> 18 & 0x7FF), u64::from(frame.id & 0x3_FFFF));
        let mut counter = StuffCounter::before(0b1, 1);
        counter.bytes(0b1 << 39 | high << 27 | 0b11 << 25 | low << 7 | control, 5);
        (counter, 1)
    };
    if !remote {
        frame.payload().iter().for_each(|byte| counter.byte(usize::from(*byte)));
    }
    // One bit behind the CRC's 15, unlike the last of them: it is never the fifth of its kind.
    let crc = u64::from(counter.crc);
    counter.bytes(crc << 1 | (crc & 1 ^ 1), 2);
    counter.bits - filler_bits - 1 + TAIL_BITS
}

/// Nanoseconds that this very frame takes.
#[must_use]
pub fn exact_time_ns(frame: &CanFrame, rates: BitRates) -> i64 {
    let bits = if frame.is_fd() { exact_fd_bits(frame) } else { Bits { nominal: exact_bits(frame), data: 0 } };
    bits.time_ns(rates)
}

/// Bits of a CAN-FD frame at each rate. Stuffing by the data ends with them; behind it stuff bits are fixed.
fn exact_fd_bits(frame: &CanFrame) -> Bits {
    let mut counter = StuffCounter::default();
    let extended = frame.id & CanFrame::EXTENDED != 0;
    counter.push(0, 1);
    if extended {
        counter.push((frame.id >> 18) & 0x7FF, 11);
        counter.push(0b11, 2);
        counter.push(frame.id & 0x3_FFFF, 18);
        // Remote request substitution 0, FD 1, reserved 0, bit-rate switch.
        counter.push(0b0100 | u32::from(frame.flags & CanFrame::BIT_RATE_SWITCH), 4);
    } else {
        counter.push(frame.id & 0x7FF, 11);
        // Remote request substitution 0, identifier extension 0, FD 1, reserved 0, bit-rate switch.
        counter.push(0b00100 | u32::from(frame.flags & CanFrame::BIT_RATE_SWITCH), 5);
    }
    debug_assert!(counter.bits >= fd_head_bits(extended));
    let head = counter.bits;
    counter.push(length_code(frame.len), 5);
    for byte in frame.payload() {
        counter.push(u32::from(*byte), 8);
    }
    let data = counter.bits - head + fd_crc_bits(frame.len);
    let nominal = head + FD_TAIL_BITS;
    // Without the switch everything goes at the nominal rate.
    if frame.flags & CanFrame::BIT_RATE_SWITCH != 0 {
        Bits { nominal, data }
    } else {
        Bits { nominal: nominal + data, data: 0 }
    }
}

/// Data length code, with the error state indicator before it as 0.
fn length_code(len: u8) -> u32 {
    match len {
        0..=8 => u32::from(len),
        9..=24 => 9 + (u32::from(len) - 9) / 4,
        25..=32 => 13,
        33..=48 => 14,
        _ => 15,
    }
}

/// Nanoseconds that so many bits take.
#[must_use]
pub fn wire_time_ns(bits: u32, bitrate: u32) -> i64 {
    i64::from(bits) * 1_000_000_000 / i64::from(bitrate.max(1))
}

/// Bits from the start of frame to the end of the CRC.
const fn stuffed_part_bits(len: u8, extended: bool) -> u32 {
    let head = if extended { 54 } else { 34 };
    head + 8 * len as u32
}

/// Counts bits with stuffing while the CRC runs along.
#[derive(Clone, Copy, Default)]
struct StuffCounter {
    bits: u32,
    run: u32,
    last: u32,
    crc: u16,
}

impl StuffCounter {
    /// The low `count` bits of `value`, highest first: whole bytes by the tables, the rest one by one.
    fn push(&mut self, value: u32, count: u32) {
        let mut left = count;
        while left >= 8 && self.run > 0 {
            left -= 8;
            self.byte(((value >> left) & 0xFF) as usize);
        }
        for k in (0..left).rev() {
            self.bit((value >> k) & 1);
        }
    }

    /// Ready for bits before a frame that change neither its stuffing nor its CRC: 1 and 0 by turns, the last one unlike
    /// the start of frame. A CRC that begins with them is zero behind them.
    const fn before(filler: u16, filler_bits: u32) -> Self {
        Self { bits: 0, run: 1, last: 0, crc: filler << (15 - filler_bits) }
    }

    /// The low `count` bytes of `value`, highest first.
    fn bytes(&mut self, value: u64, count: u32) {
        for k in (0..count).rev() {
            self.byte((value >> (8 * k) & 0xFF) as usize);
        }
    }

    #[expect(clippy::indexing_slicing, reason = "masked to 8 bits; a run is 1 to 4 long")]
    fn byte(&mut self, byte: usize) {
        self.crc = ((self.crc << 8) & 0x7FFF) ^ CRC_OF_BYTE[(usize::from(self.crc >> 7) ^ byte) & 0xFF];
        let after = STUFF_OF_BYTE[runs_index(self.run, self.last)][byte];
        self.bits += 8 + u32::from(after >> 4);
        (self.run, self.last) = (u32::from(after & 3) + 1, u32::from(after >> 2 & 1));
    }

    const fn bit(&mut self, bit: u32) {
        *self = self.after(bit);
    }

    const fn after(mut self, bit: u32) -> Self {
        let feedback = ((self.crc >> 14) as u32 ^ bit) & 1;
        self.crc = (self.crc << 1) & 0x7FFF;
        if feedback == 1 {
            self.crc ^= CRC_POLYNOMIAL;
        }
        self.bits += 1;
        if self.run > 0 && bit == self.last {
            self.run += 1;
        } else {
            self.run = 1;
            self.last = bit;
        }
        if self.run == 5 {
            // The stuffed bit is of the other kind and starts a run of its own.
            self.bits += 1;
            self.run = 1;
            self.last = bit ^ 1;
        }
        self
    }
}

/// What eight bits do to the CRC.
#[expect(clippy::indexing_slicing, reason = "at compile time")]
const CRC_OF_BYTE: [u16; 256] = {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut counter = StuffCounter { bits: 0, run: 0, last: 0, crc: (byte as u16) << 7 };
        let mut k = 0;
        while k < 8 {
            counter = counter.after(0);
            k += 1;
        }
        table[byte] = counter.crc;
        byte += 1;
    }
    table
};

/// What eight bits do to a run of equal bits: stuffed bits << 4 | last bit << 2 | length of the run - 1.
#[expect(clippy::indexing_slicing, reason = "at compile time")]
const STUFF_OF_BYTE: [[u8; 256]; 8] = {
    let mut table = [[0; 256]; 8];
    let mut state = 0;
    while state < 8 {
        let mut byte = 0;
        while byte < 256 {
            let mut counter = StuffCounter { bits: 0, run: state as u32 % 4 + 1, last: state as u32 / 4, crc: 0 };
            let mut k = 8;
            while k > 0 {
                k -= 1;
                counter = counter.after((byte as u32 >> k) & 1);
            }
            table[state][byte] = ((counter.bits - 8) << 4 | counter.last << 2 | (counter.run - 1)) as u8;
            byte += 1;
        }
        state += 1;
    }
    table
};

/// Row of [`STUFF_OF_BYTE`]: a run is 1 to 4 long, the fifth bit ends it.
const fn runs_index(run: u32, last: u32) -> usize {
    (last * 4 + run - 1) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::can_time::FrameKind;
    use proptest::prelude::*;

    #[test]
    fn frame_times_are_those_of_the_table() {
        // Table of the protocol reference, microseconds at 1 Mbit/s = bits.
        let lens = [0, 1, 2, 4, 5, 6, 8];
        let base = [(47, 55), (55, 65), (63, 75), (79, 95), (87, 105), (95, 115), (111, 135)];
        let extended = [(67, 80), (75, 90), (83, 100), (99, 120), (107, 130), (115, 140), (131, 160)];
        for (i, len) in lens.into_iter().enumerate() {
            assert_eq!((plain_bits(len, false), worst_bits(len, false)), base[i]);
            assert_eq!((plain_bits(len, true), worst_bits(len, true)), extended[i]);
        }
    }

    #[test]
    fn length_codes_of_fd_are_those_of_the_standard() {
        assert_eq!([0, 8, 12, 16, 20, 24, 32, 48, 64].map(length_code), [0, 8, 9, 10, 11, 12, 13, 14, 15]);
    }

    #[test]
    fn wire_time_scales_with_the_bit_rate() {
        assert_eq!(wire_time_ns(135, 1_000_000), 135_000);
        assert_eq!(wire_time_ns(135, 125_000), 1_080_000);
    }

    proptest! {
        #[test]
        fn exact_length_lies_between_plain_and_worst(id in 0u32..0x2000_0000, extended: bool, payload in prop::collection::vec(any::<u8>(), 0..=8)) {
            let mut frame = CanFrame::new(0, &payload);
            frame.id = if extended { id | CanFrame::EXTENDED } else { id & 0x7FF };
            let bits = exact_bits(&frame);
            prop_assert!(bits >= plain_bits(frame.len, extended));
            prop_assert!(bits <= worst_bits(frame.len, extended));
        }

        #[test]
        fn exact_fd_length_is_at_most_the_worst(id in 0u32..0x2000_0000, extended: bool, payload in prop::collection::vec(any::<u8>(), 0..=64)) {
            let id = if extended { id | CanFrame::EXTENDED } else { id & 0x7FF };
            let frame = CanFrame::fd(id, &payload, 0x50);
            let worst = FrameKind { bytes: frame.len, extended, fd: true }.worst();
            let exact = exact_fd_bits(&frame);
            // Which side of the switch a stuff bit falls on may differ by one.
            prop_assert!(exact.nominal + exact.data <= worst.nominal + worst.data + 1, "{:?} {:?}", exact, worst);
            prop_assert!(exact.nominal >= fd_head_bits(extended) + FD_TAIL_BITS);
        }
    }

    #[test]
    fn all_zero_frame_is_stuffed_by_hand_count() {
        // SYNC-like frame id 0, no data: 19 dominant bits head + CRC 0 (15 bits) = 34 equal bits.
        // First stuff after 5, then the stuff bit (1) breaks the run, so one per 5: 34 / 5 = 6.
        assert_eq!(exact_bits(&CanFrame::new(0, &[])), 47 + 6);
    }

    /// As ISO 11898-1 has it, bit after bit.
    fn bits_one_by_one(frame: &CanFrame) -> u32 {
        let mut counter = StuffCounter::default();
        let mut put = |value: u32, count: u32| (0..count).rev().for_each(|k| counter.bit(value >> k & 1));
        let remote = u32::from(frame.id & CanFrame::REMOTE != 0);
        put(0, 1);
        if frame.id & CanFrame::EXTENDED == 0 {
            put(frame.id & 0x7FF, 11);
            put(remote << 2, 3);
        } else {
            put(frame.id >> 18 & 0x7FF, 11);
            put(0b11, 2);
            put(frame.id & 0x3_FFFF, 18);
            put(remote << 2, 3);
        }
        put(u32::from(frame.len), 4);
        frame.payload().iter().filter(|_| remote == 0).for_each(|byte| put(u32::from(*byte), 8));
        let crc = counter.crc;
        (0..15).rev().for_each(|k| counter.bit(u32::from(crc) >> k & 1));
        counter.bits + TAIL_BITS
    }

    proptest! {
        #[test]
        fn whole_bytes_count_what_single_bits_count(id in 0_u32..0x2000_0000, kind in 0_u32..4, payload in prop::collection::vec(any::<u8>(), 0..=8), few: bool) {
            let (extended, remote) = (kind & 1 != 0, kind & 2 != 0);
            // Few ones, so that much is stuffed.
            let id = if few { id & 0x0041_0100 } else { id };
            let payload: Vec<u8> = payload.iter().map(|byte| if few { byte & 0x81 } else { *byte }).collect();
            let mut frame = CanFrame::new(0, &payload);
            frame.id = if extended { id | CanFrame::EXTENDED } else { id & 0x7FF };
            frame.id |= if remote { CanFrame::REMOTE } else { 0 };
            prop_assert_eq!(exact_bits(&frame), bits_one_by_one(&frame));
        }

        #[test]
        fn bytes_by_the_tables_are_bits_one_by_one(head in 0_u32..0x8_0000, bytes in proptest::collection::vec(any::<u8>(), 0..9)) {
            let (mut by_bytes, mut by_bits) = (StuffCounter::default(), StuffCounter::default());
            by_bytes.bit(0);
            by_bytes.push(head, 19);
            bytes.iter().for_each(|b| by_bytes.push(u32::from(*b), 8));
            by_bits.bit(0);
            (0..19).rev().for_each(|k| by_bits.bit(head >> k & 1));
            bytes.iter().for_each(|b| (0..8).rev().for_each(|k| by_bits.bit(u32::from(*b) >> k & 1)));
            prop_assert_eq!((by_bytes.bits, by_bytes.crc), (by_bits.bits, by_bits.crc));
            prop_assert_eq!((by_bytes.run, by_bytes.last), (by_bits.run, by_bits.last));
        }
    }
}
