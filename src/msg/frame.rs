//! Frames of CAN and CAN-FD, and how many of them travel in a tick. RT: yes.

use super::reflect::message;
use super::{Element, FieldShape, Kind, Shape, Value};
use crate::base::bytes::padded;
use crate::base::time::Stamp;
use iceoryx2::prelude::ZeroCopySend;

/// Most frames of one bus and direction in one tick. A 1 Mbit/s bus carries at most 21 empty frames in 1 ms.
pub const MAX_FRAMES: usize = 24;
/// Data bytes of the longest frame.
pub const MAX_DATA: usize = 64;
/// Lengths that a CAN-FD frame can have beyond 8 bytes.
const FD_LENGTHS: [u8; 7] = [12, 16, 20, 24, 32, 48, 64];

/// A CAN frame: classic with up to 8 data bytes, or CAN-FD with up to 64.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
pub struct CanFrame {
    /// Identifier with SocketCAN's flag bits: extended 0x8000_0000, remote 0x4000_0000, error 0x2000_0000.
    pub id: u32,
    /// SocketCAN's flags of a CAN-FD frame: bit-rate switch 0x01, error state 0x02, CAN-FD 0x04; a classic frame has none.
    pub flags: u8,
    /// Number of data bytes: 0 to 8, or a length of CAN-FD.
    pub len: u8,
    /// Data; bytes from `len` on are zero.
    pub data: [u8; MAX_DATA],
}

impl Default for CanFrame {
    fn default() -> Self {
        Self::empty(0)
    }
}

impl CanFrame {
    /// Flag of a 29-bit identifier.
    pub const EXTENDED: u32 = 0x8000_0000;
    /// Flag of a remote request.
    pub const REMOTE: u32 = 0x4000_0000;
    /// Flag of an error frame.
    pub const ERROR: u32 = 0x2000_0000;
    /// CAN-FD: the data go at the higher bit rate.
    pub const BIT_RATE_SWITCH: u8 = 0x01;
    /// CAN-FD frame.
    pub const FD: u8 = 0x04;
    /// What it is made of. In a recording the data are a sequence, so a short frame is short there too.
    pub const SHAPE: Shape = Shape {
        name: "CanFrame",
        fields: &[
            FieldShape {
                name: "id",
                doc: " Identifier with SocketCAN's flag bits: extended 0x8000_0000, remote 0x4000_0000, error 0x2000_0000.",
                kind: Kind::U32,
            },
            FieldShape {
                name: "flags",
                doc: " CAN-FD: bit-rate switch 0x01, error state 0x02, CAN-FD 0x04; 0 = classic.",
                kind: Kind::U8,
            },
            FieldShape { name: "data", doc: " Data bytes that are there.", kind: Kind::Bytes(MAX_DATA) },
        ],
    };

    /// A classic frame without data.
    #[must_use]
    pub const fn empty(id: u32) -> Self {
        Self { id, flags: 0, len: 0, data: [0; MAX_DATA] }
    }

    /// A classic data frame with an 11-bit identifier. At most 8 bytes are taken.
    #[must_use]
    pub fn new(id: u16, payload: &[u8]) -> Self {
        Self::classic(u32::from(id & 0x7FF), payload)
    }

    /// A classic frame with this identifier, flag bits included. At most 8 bytes are taken.
    #[must_use]
    pub fn classic(id: u32, payload: &[u8]) -> Self {
        let payload = payload.get(..8).unwrap_or(payload);
        Self { len: u8::try_from(payload.len()).unwrap_or(8), data: padded(payload), ..Self::empty(id) }
    }

    /// A CAN-FD frame with bit-rate switch, filled up with `filler` to the next length that there is.
    /// At most 64 bytes are taken.
    #[must_use]
    pub fn fd(id: u32, payload: &[u8], filler: u8) -> Self {
        let payload = payload.get(..MAX_DATA).unwrap_or(payload);
        let len = fd_length(payload.len());
        let mut data = padded(payload);
        data.iter_mut().take(usize::from(len)).skip(payload.len()).for_each(|byte| *byte = filler);
        Self { id, flags: Self::FD | Self::BIT_RATE_SWITCH, len, data }
    }

    /// The bytes that are there.
    #[must_use]
    pub fn payload(&self) -> &[u8] {
        self.data.get(..usize::from(self.len)).unwrap_or(&self.data)
    }

    /// The first eight bytes: all that a classic frame has.
    #[must_use]
    pub fn first_eight(&self) -> [u8; 8] {
        padded(&self.data)
    }

    /// True for a CAN-FD frame.
    #[must_use]
    pub const fn is_fd(&self) -> bool {
        self.flags & Self::FD != 0
    }

    /// True for an error frame of the controller (not data from a peer).
    #[must_use]
    pub const fn is_error(&self) -> bool {
        self.id & Self::ERROR != 0
    }
}

/// The shortest CAN-FD length that holds so many bytes.
fn fd_length(bytes: usize) -> u8 {
    let bytes = u8::try_from(bytes).unwrap_or(u8::MAX);
    if bytes <= 8 { bytes } else { FD_LENGTHS.into_iter().find(|len| *len >= bytes).unwrap_or(64) }
}

impl Element for CanFrame {
    const KIND: Kind = Kind::Struct(&Self::SHAPE);
    fn put(&self, sink: &mut impl FnMut(Value)) {
        sink(Value::U32(self.id));
        sink(Value::U8(self.flags));
        sink(Value::U32(u32::from(self.len)));
        self.payload().iter().for_each(|byte| sink(Value::U8(*byte)));
    }
    fn take(source: &mut impl FnMut(Kind) -> Option<Value>) -> Option<Self> {
        let (id, flags) = (u32::take(source)?, u8::take(source)?);
        let len = u8::try_from(u32::take(source)?).ok().filter(|len| usize::from(*len) <= MAX_DATA)?;
        let mut frame = Self { id, flags, len, data: [0; MAX_DATA] };
        for byte in frame.data.iter_mut().take(usize::from(len)) {
            *byte = u8::take(source)?;
        }
        Some(frame)
    }
}

message! {
    /// A frame and when it was on the bus.
    pub struct BusFrame {
        /// Received: the kernel's receive stamp if there is one. To send: the tick that chose it.
        pub stamp: Stamp,
        /// The frame.
        pub frame: CanFrame,
        /// We sent it. Received: the echo of a frame of ours, as the kernel or the simulated wire says.
        pub own: bool,
    }
}

impl BusFrame {
    /// A frame of ours.
    #[must_use]
    pub const fn ours(stamp: Stamp, frame: CanFrame) -> Self {
        Self { stamp, frame, own: true }
    }

    /// A frame of somebody else.
    #[must_use]
    pub const fn theirs(stamp: Stamp, frame: CanFrame) -> Self {
        Self { stamp, frame, own: false }
    }
}

/// Bit of a packed frame that is ours.
const OWN: u64 = 1 << 48;

/// Words of a frame before its data: its stamp; identifier, length and flags.
const HEAD_WORDS: usize = 2;
/// Words of a frame with 8 bytes.
const CLASSIC_WORDS: usize = HEAD_WORDS + 1;

message! {
    /// Frames of one bus, in order, packed: each takes two words and as many as its data need. So a CAN-FD frame has
    /// room, and a tick of a classic robot is not a byte larger for it.
    pub struct FrameBatch {
        /// How many frames there are.
        pub count: u8,
        /// Words that they take.
        pub used: u8,
        /// Frames lost for want of room, or counted as lost by the kernel, since arming of the process.
        pub dropped: u32,
        /// The frames: stamp; identifier, length << 32, flags << 40, ours << 48; data, first byte lowest.
        pub words: [[u64; CLASSIC_WORDS]; MAX_FRAMES],
    }
}

impl FrameBatch {
    /// The frames that are there.
    #[must_use]
    pub fn iter(&self) -> Frames<'_> {
        Frames { words: self.words.as_flattened(), left: self.count }
    }

    /// True if this frame would fit.
    #[must_use]
    pub fn has_room(&self, frame: &CanFrame) -> bool {
        usize::from(self.count) < MAX_FRAMES
            && usize::from(self.used) + words_of(frame) <= self.words.as_flattened().len()
    }

    /// Adds a frame, or counts it as dropped and returns false when there is no room.
    pub fn push(&mut self, item: BusFrame) -> bool {
        if !self.has_room(&item.frame) {
            self.dropped = self.dropped.saturating_add(1);
            return false;
        }
        let frame = &item.frame;
        let head = u64::from(frame.id) | u64::from(frame.len) << 32 | u64::from(frame.flags) << 40;
        let head = if item.own { head | OWN } else { head };
        let data = frame.payload().chunks(8).map(|bytes| u64::from_le_bytes(padded(bytes)));
        let words = [item.stamp.0.cast_unsigned(), head].into_iter().chain(data);
        let places = self.words.as_flattened_mut().iter_mut().skip(usize::from(self.used));
        for (place, word) in places.zip(words) {
            *place = word;
            self.used += 1;
        }
        self.count += 1;
        true
    }

    /// Forgets the frames, keeps the count of drops.
    pub fn clear(&mut self) {
        (self.count, self.used) = (0, 0);
    }
}

fn words_of(frame: &CanFrame) -> usize {
    HEAD_WORDS + frame.payload().len().div_ceil(8)
}

impl<'a> IntoIterator for &'a FrameBatch {
    type Item = BusFrame;
    type IntoIter = Frames<'a>;
    fn into_iter(self) -> Frames<'a> {
        self.iter()
    }
}

/// Walks over a batch.
#[derive(Clone, Debug)]
pub struct Frames<'a> {
    words: &'a [u64],
    left: u8,
}

impl Iterator for Frames<'_> {
    type Item = BusFrame;
    fn next(&mut self) -> Option<BusFrame> {
        self.left = self.left.checked_sub(1)?;
        let ([stamp, head], rest) = self.words.split_first_chunk::<HEAD_WORDS>()?;
        let [a, b, c, d, len, flags, ..] = head.to_le_bytes();
        let mut frame = CanFrame { flags, len, ..CanFrame::empty(u32::from_le_bytes([a, b, c, d])) };
        let data = rest.get(..frame.payload().len().div_ceil(8))?;
        for (place, word) in frame.data.as_chunks_mut().0.iter_mut().zip(data) {
            *place = word.to_le_bytes();
        }
        self.words = rest.get(data.len()..)?;
        Some(BusFrame { stamp: Stamp(stamp.cast_signed()), frame, own: head & OWN != 0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(k: i64, frame: CanFrame) -> BusFrame {
        BusFrame { stamp: Stamp(k), frame, own: k % 2 == 0 }
    }

    #[test]
    fn a_batch_holds_as_many_full_classic_frames_as_a_tick_can_bring() {
        let mut batch = FrameBatch::default();
        for k in 0..24 {
            assert!(batch.push(at(k, CanFrame::new(5, &[k as u8; 8]))));
        }
        assert!(!batch.push(at(99, CanFrame::new(5, &[]))));
        assert_eq!((batch.count, batch.dropped), (24, 1));
        assert_eq!(size_of::<FrameBatch>(), 584, "a classic tick pays nothing for CAN-FD");
    }

    #[test]
    fn a_batch_holds_commands_echoes_and_answers_of_three_fd_drives() {
        let mut batch = FrameBatch::default();
        for k in 0..3 {
            assert!(batch.push(at(k, CanFrame::fd(0x8001, &[1; 48], 0x50))));
            assert!(batch.push(at(k, CanFrame::fd(0x100, &[2; 22], 0x50))));
        }
        assert_eq!(batch.iter().count(), 6);
    }

    #[test]
    fn fd_frames_are_filled_up_to_the_next_length() {
        let frame = CanFrame::fd(1, &[7; 22], 0x50);
        assert_eq!((frame.len, frame.data[21], frame.data[22], frame.data[23], frame.data[24]), (24, 7, 0x50, 0x50, 0));
        let lengths = [0, 8, 9, 12, 13, 36, 48, 49, 64].map(|n| CanFrame::fd(1, &vec![0; n], 0).len);
        assert_eq!(lengths, [0, 8, 12, 12, 16, 48, 48, 64, 64]);
    }

    proptest! {
        #[test]
        fn what_goes_in_comes_out_in_order(
            frames in prop::collection::vec((any::<i64>(), any::<u32>(), any::<bool>(), prop::collection::vec(any::<u8>(), 0..=64)), 0..30)
        ) {
            let mut batch = FrameBatch::default();
            let mut taken = Vec::new();
            for (stamp, id, fd, payload) in frames {
                let frame = if fd { CanFrame::fd(id, &payload, 0) } else { CanFrame::classic(id, &payload) };
                if batch.push(at(stamp, frame)) {
                    taken.push(at(stamp, frame));
                }
            }
            prop_assert_eq!(batch.iter().collect::<Vec<_>>(), taken);
        }

        #[test]
        fn words_of_another_making_never_panic(count: u8, words: [[u64; 3]; 24]) {
            let batch = FrameBatch { count, used: 255, dropped: 0, words };
            prop_assert!(batch.iter().count() <= 255);
            prop_assert!(!batch.has_room(&CanFrame::empty(0)));
        }
    }
}
