//! How long frames of CAN and CAN-FD occupy the wire at the most, from their lengths alone (ISO 11898-1). RT: yes.
//!
//! A CAN-FD frame with bit-rate switch goes at the nominal rate up to the switch bit and again from the acknowledge on;
//! between them, from the error state indicator to the CRC delimiter, at the data rate.

/// Kind and length of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameKind {
    /// Data bytes.
    pub bytes: u8,
    /// 29-bit identifier.
    pub extended: bool,
    /// CAN-FD with bit-rate switch.
    pub fd: bool,
}

/// Bit rates of a bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BitRates {
    /// Of classic frames and of arbitration, bit/s.
    pub nominal: u32,
    /// Of the data of CAN-FD frames, bit/s; `None` on a classic bus.
    pub data: Option<u32>,
}

/// Bits at each of the two rates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Bits {
    /// At the nominal rate.
    pub nominal: u32,
    /// At the data rate.
    pub data: u32,
}

/// Acknowledge slot and delimiter, end of frame (7), interframe space (3).
pub const FD_TAIL_BITS: u32 = 12;

impl FrameKind {
    /// A classic frame with an 11-bit identifier.
    #[must_use]
    pub const fn classic(bytes: u8) -> Self {
        Self { bytes, extended: false, fd: false }
    }

    /// Longest it can be: with the most stuffing.
    #[must_use]
    pub const fn worst(self) -> Bits {
        let data = 8 * self.bytes as u32;
        if !self.fd {
            let part = if self.extended { 54 } else { 34 } + data;
            // CRC delimiter and the same tail as of CAN-FD.
            return Bits { nominal: part + (part - 1) / 4 + 1 + FD_TAIL_BITS, data: 0 };
        }
        let head = fd_head_bits(self.extended);
        let body = 5 + data;
        Bits { nominal: head + (head - 1) / 4 + FD_TAIL_BITS, data: body + body / 4 + fd_crc_bits(self.bytes) }
    }
}

/// From the start of a CAN-FD frame to the bit-rate switch.
#[must_use]
pub const fn fd_head_bits(extended: bool) -> u32 {
    if extended { 36 } else { 17 }
}

/// Stuff count, CRC and its delimiter, with their fixed stuff bits.
#[must_use]
pub const fn fd_crc_bits(bytes: u8) -> u32 {
    if bytes <= 16 { 4 + 17 + 6 + 1 } else { 4 + 21 + 7 + 1 }
}

impl Bits {
    /// Nanoseconds that they take. On a bus without a data rate all go at the nominal one.
    #[must_use]
    pub fn time_ns(self, rates: BitRates) -> i64 {
        let time = |bits: u32, rate: u32| i64::from(bits) * 1_000_000_000 / i64::from(rate.max(1));
        time(self.nominal, rates.nominal) + time(self.data, rates.data.unwrap_or(rates.nominal))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classic_times_are_those_of_the_protocol_notes() {
        let bits = |bytes, extended| FrameKind { bytes, extended, fd: false }.worst().nominal;
        assert_eq!([0, 1, 2, 4, 5, 6, 8].map(|n| bits(n, false)), [55, 65, 75, 95, 105, 115, 135]);
        assert_eq!([0, 1, 2, 4, 5, 6, 8].map(|n| bits(n, true)), [67 + 13, 90, 100, 120, 130, 140, 160]);
    }

    #[test]
    fn an_fd_frame_of_24_bytes_takes_what_the_protocol_notes_say() {
        // "about 95-115 us for a 24-byte FD frame at 1/5 Mbit/s", 29-bit identifier.
        let rates = BitRates { nominal: 1_000_000, data: Some(5_000_000) };
        let worst = FrameKind { bytes: 24, extended: true, fd: true }.worst();
        assert_eq!(worst, Bits { nominal: 36 + 8 + 12, data: 197 + 49 + 33 });
        assert_eq!(worst.time_ns(rates), 56_000 + 55_800);
        let slow = BitRates { data: None, ..rates };
        assert_eq!(worst.time_ns(slow), 335_000, "without the switch");
    }
}
