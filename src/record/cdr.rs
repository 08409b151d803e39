//! Messages as bytes: plain CDR, little endian, as ROS 2, Foxglove and PlotJuggler read it (OMG DDSI-RTPS 10.2.1.2).
//!
//! Every leaf is aligned to its own size, counted from the end of the four-byte header. Structures and fixed arrays
//! add nothing, so the walk over leaves is the whole format. RT: no.

use crate::msg::{Element, Kind, Value};

/// Encapsulation: CDR_LE, no options.
const HEADER: [u8; 4] = [0, 1, 0, 0];

/// Writes a message, replacing what `out` held.
pub fn encode(message: &impl Element, out: &mut Vec<u8>) {
    out.clear();
    out.extend_from_slice(&HEADER);
    message.put(&mut |value| match value {
        Value::Bool(v) => put(out, [u8::from(v)]),
        Value::U8(v) => put(out, [v]),
        Value::U16(v) => put(out, v.to_le_bytes()),
        Value::U32(v) => put(out, v.to_le_bytes()),
        Value::U64(v) => put(out, v.to_le_bytes()),
        Value::I16(v) => put(out, v.to_le_bytes()),
        Value::I32(v) => put(out, v.to_le_bytes()),
        Value::I64(v) => put(out, v.to_le_bytes()),
        Value::F64(v) => put(out, v.to_le_bytes()),
    });
}

fn put<const N: usize>(out: &mut Vec<u8>, bytes: [u8; N]) {
    let body = out.len() - HEADER.len();
    out.resize(HEADER.len() + body.next_multiple_of(N), 0);
    out.extend_from_slice(&bytes);
}

/// Reads a message. `None` if the bytes are too few, too many, or no such message.
#[must_use]
pub fn decode<T: Element>(bytes: &[u8]) -> Option<T> {
    let mut leaves = Leaves::new(bytes)?;
    let message = T::take(&mut |kind| leaves.take(kind))?;
    leaves.is_empty().then_some(message)
}

/// Leaves of an encoded message, in order.
pub struct Leaves<'a> {
    body: &'a [u8],
    at: usize,
}

impl<'a> Leaves<'a> {
    /// Opens an encoded message. `None` without the header that we write.
    #[must_use]
    pub fn new(bytes: &'a [u8]) -> Option<Self> {
        Some(Self { body: bytes.strip_prefix(&HEADER)?, at: 0 })
    }

    /// True when nothing is left.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.at == self.body.len()
    }

    /// The next leaf, which must be of this kind. `None` at the end, or for a kind that is no leaf.
    pub fn take(&mut self, kind: Kind) -> Option<Value> {
        Some(match kind {
            Kind::Bool => match self.bytes()? {
                [0] => Value::Bool(false),
                [1] => Value::Bool(true),
                _ => return None,
            },
            Kind::U8 | Kind::Enum(_) => Value::U8(u8::from_le_bytes(self.bytes()?)),
            Kind::U16 => Value::U16(u16::from_le_bytes(self.bytes()?)),
            Kind::U32 => Value::U32(u32::from_le_bytes(self.bytes()?)),
            Kind::U64 => Value::U64(u64::from_le_bytes(self.bytes()?)),
            Kind::I16 => Value::I16(i16::from_le_bytes(self.bytes()?)),
            Kind::I32 => Value::I32(i32::from_le_bytes(self.bytes()?)),
            Kind::I64 => Value::I64(i64::from_le_bytes(self.bytes()?)),
            Kind::F64 => Value::F64(f64::from_le_bytes(self.bytes()?)),
            Kind::Bytes(_) | Kind::Array(..) | Kind::Struct(_) => return None,
        })
    }

    fn bytes<const N: usize>(&mut self) -> Option<[u8; N]> {
        let from = self.at.next_multiple_of(N);
        let bytes = self.body.get(from..from + N)?.try_into().ok()?;
        self.at = from + N;
        Some(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::time::Stamp;
    use crate::msg::{BusFrame, CanFrame};

    #[test]
    fn leaves_are_aligned_to_their_size_from_the_end_of_the_header() {
        let frame = BusFrame::ours(Stamp(0x0102), CanFrame::new(0x7FF, &[0xAA, 0xBB]));
        let mut bytes = Vec::new();
        encode(&frame, &mut bytes);
        let stamp = [2, 1, 0, 0, 0, 0, 0, 0];
        let expected =
            [&HEADER[..], &stamp, &[0xFF, 7, 0, 0], &[0, 0, 0, 0], &[2, 0, 0, 0], &[0xAA, 0xBB], &[1]].concat();
        assert_eq!(bytes, expected);
        assert_eq!(decode::<BusFrame>(&bytes), Some(frame));
    }

    #[test]
    fn every_truncation_and_any_excess_is_refused() {
        let mut bytes = Vec::new();
        encode(&BusFrame::default(), &mut bytes);
        for length in 0..bytes.len() {
            assert_eq!(decode::<BusFrame>(&bytes[..length]), None, "{length} bytes");
        }
        bytes.push(0);
        assert_eq!(decode::<BusFrame>(&bytes), None);
    }
}
