//! Walks over the records of an MCAP file, also of one that was torn by a kill or a power cut. RT: no.
//!
//! Our chunks are not compressed, so their content is a run of records like any other: the walk goes into a chunk
//! after its head and needs no special case for a chunk whose end is missing. Chunk sums are not checked, because a
//! torn chunk has none. `mcap`'s own readers give a torn chunk up as a whole.

use std::io::{self, ErrorKind, Read};

/// MCAP's magic, at start and end.
pub const MAGIC: [u8; 8] = [0x89, b'M', b'C', b'A', b'P', b'0', 0x0D, 0x0A];

/// Longest record that we believe; a longer one is damage. A configuration has some kB, a message less than 4 kB.
const LONGEST: u64 = 64 << 20;

/// A record that matters to us.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Record<'a> {
    /// What messages are made of.
    Schema {
        /// Number in this file.
        id: u16,
        /// Name, encoding, definition.
        name: &'a str,
        /// Definition.
        text: &'a [u8],
    },
    /// A stream of messages.
    Channel {
        /// Number in this file.
        id: u16,
        /// Its schema.
        schema: u16,
        /// Its topic.
        topic: &'a str,
        /// How messages are encoded.
        encoding: &'a str,
    },
    /// A message.
    Message {
        /// Its channel.
        channel: u16,
        /// Low bits of the tick's number.
        sequence: u32,
        /// Time of validity, ns.
        log_time: u64,
        /// The bytes.
        data: &'a [u8],
    },
    /// A file inside.
    Attachment {
        /// Its name.
        name: &'a str,
        /// Its bytes.
        data: &'a [u8],
    },
    /// Names and values.
    Metadata {
        /// Name of the set.
        name: &'a str,
        /// Names and values in it.
        entries: Vec<(&'a str, &'a str)>,
    },
    /// Everything after this is summary.
    DataEnd,
    /// Nothing for us.
    Other,
}

/// How a file ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// Properly closed.
    Whole,
    /// Stops in the middle: its writer was killed, or lost power.
    Torn {
        /// Where, byte.
        at: u64,
    },
    /// Bytes that are no record.
    Damaged {
        /// Where, byte.
        at: u64,
    },
}

/// The walk.
pub struct Scan<R> {
    source: R,
    at: u64,
    body: Vec<u8>,
    ending: Option<Ending>,
}

impl<R: Read> Scan<R> {
    /// Begins behind the magic. `None` if the file has none: it is no MCAP file, or empty.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn new(mut source: R) -> io::Result<Option<Self>> {
        let mut magic = [0; MAGIC.len()];
        match source.read_exact(&mut magic) {
            Ok(()) if magic == MAGIC => {}
            Ok(()) => return Ok(None),
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Ok(None),
            Err(error) => return Err(error),
        }
        Ok(Some(Self { source, at: MAGIC.len() as u64, body: Vec::new(), ending: None }))
    }

    /// How the file ends, once [`Self::next_record`] has said `None`.
    #[must_use]
    pub const fn ending(&self) -> Option<Ending> {
        self.ending
    }

    /// The next record; `None` at the end of the data, whatever kind of end that is.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn next_record(&mut self) -> io::Result<Option<Record<'_>>> {
        if self.ending.is_some() {
            return Ok(None);
        }
        let start = self.at;
        let Some(op) = self.read_body(start)? else { return Ok(None) };
        match parse(op, &self.body) {
            Some(Record::DataEnd) => {
                self.ending = Some(Ending::Whole);
                Ok(None)
            }
            Some(record) => Ok(Some(record)),
            None => {
                self.ending = Some(Ending::Damaged { at: start });
                Ok(None)
            }
        }
    }

    /// Reads one record's bytes. Of a chunk only the head, so that its records come next.
    fn read_body(&mut self, start: u64) -> io::Result<Option<u8>> {
        let Some([op, length @ ..]) = self.read::<9>()? else { return self.end(Ending::Torn { at: start }) };
        let length = u64::from_le_bytes(length);
        if op == 0 {
            return self.end(Ending::Damaged { at: start });
        }
        if op == op::CHUNK {
            return match self.read_chunk_head()? {
                true => Ok(Some(op::CHUNK)),
                false => Ok(None),
            };
        }
        if length > LONGEST {
            return self.end(Ending::Damaged { at: start });
        }
        self.body.resize(length as usize, 0);
        match self.source.read_exact(&mut self.body) {
            Ok(()) => self.at += length,
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => return self.end(Ending::Torn { at: start }),
            Err(error) => return Err(error),
        }
        Ok(Some(op))
    }

    /// Times, size, sum; compression, which must be none; size.
    fn read_chunk_head(&mut self) -> io::Result<bool> {
        let start = self.at;
        self.body.clear();
        let Some(fixed) = self.read::<32>()? else { return self.end(Ending::Torn { at: start }).map(|_| false) };
        if fixed[28..] != [0; 4] {
            // A compressed chunk: not one of our recordings.
            return self.end(Ending::Damaged { at: start }).map(|_| false);
        }
        match self.read::<8>()? {
            Some(_) => Ok(true),
            None => self.end(Ending::Torn { at: start }).map(|_| false),
        }
    }

    fn read<const N: usize>(&mut self) -> io::Result<Option<[u8; N]>> {
        let mut bytes = [0; N];
        match self.source.read_exact(&mut bytes) {
            Ok(()) => {
                self.at += N as u64;
                Ok(Some(bytes))
            }
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => Ok(None),
            Err(error) => Err(error),
        }
    }

    fn end(&mut self, ending: Ending) -> io::Result<Option<u8>> {
        self.ending = Some(ending);
        Ok(None)
    }
}

/// Numbers of the records (MCAP specification, "Records").
mod op {
    pub(super) const SCHEMA: u8 = 0x03;
    pub(super) const CHANNEL: u8 = 0x04;
    pub(super) const MESSAGE: u8 = 0x05;
    pub(super) const CHUNK: u8 = 0x06;
    pub(super) const ATTACHMENT: u8 = 0x09;
    pub(super) const METADATA: u8 = 0x0C;
    pub(super) const DATA_END: u8 = 0x0F;
}

/// A record from its bytes. `None` if they are not what they claim to be.
fn parse(op: u8, body: &[u8]) -> Option<Record<'_>> {
    let mut bytes = Bytes(body);
    Some(match op {
        op::SCHEMA => {
            let (id, name, _encoding) = (bytes.u16()?, bytes.text()?, bytes.text()?);
            Record::Schema { id, name, text: bytes.blob()? }
        }
        op::CHANNEL => {
            let (id, schema) = (bytes.u16()?, bytes.u16()?);
            Record::Channel { id, schema, topic: bytes.text()?, encoding: bytes.text()? }
        }
        op::MESSAGE => {
            let (channel, sequence, log_time, _publish) = (bytes.u16()?, bytes.u32()?, bytes.u64()?, bytes.u64()?);
            Record::Message { channel, sequence, log_time, data: bytes.0 }
        }
        op::ATTACHMENT => {
            let (_log, _created, name, _type) = (bytes.u64()?, bytes.u64()?, bytes.text()?, bytes.text()?);
            let length = usize::try_from(bytes.u64()?).ok()?;
            Record::Attachment { name, data: bytes.take(length)? }
        }
        op::METADATA => Record::Metadata { name: bytes.text()?, entries: Bytes(bytes.blob()?).entries()? },
        op::DATA_END => Record::DataEnd,
        _ => Record::Other,
    })
}

/// Takes values off the front of a byte slice.
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (front, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(front)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    fn blob(&mut self) -> Option<&'a [u8]> {
        let length = usize::try_from(self.u32()?).ok()?;
        self.take(length)
    }

    fn text(&mut self) -> Option<&'a str> {
        std::str::from_utf8(self.blob()?).ok()
    }

    fn entries(mut self) -> Option<Vec<(&'a str, &'a str)>> {
        let mut entries = Vec::new();
        while !self.0.is_empty() {
            entries.push((self.text()?, self.text()?));
        }
        Some(entries)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn random_bytes_never_panic(mut bytes in proptest::collection::vec(any::<u8>(), 0..400), op in 0u8..0x10) {
            let mut file = MAGIC.to_vec();
            file.push(op);
            file.extend_from_slice(&(bytes.len() as u64 / 2).to_le_bytes());
            file.append(&mut bytes);
            let mut scan = Scan::new(file.as_slice()).unwrap().unwrap();
            while scan.next_record().unwrap().is_some() {}
            prop_assert!(scan.ending().is_some());
        }
    }

    #[test]
    fn foreign_and_empty_files_are_none() {
        assert!(Scan::new(&b"not an mcap file"[..]).unwrap().is_none());
        assert!(Scan::new(&b""[..]).unwrap().is_none());
    }

    #[test]
    fn zeros_after_a_power_cut_are_damage_not_records() {
        let file = [&MAGIC[..], &[0; 100]].concat();
        let mut scan = Scan::new(file.as_slice()).unwrap().unwrap();
        assert_eq!(scan.next_record().unwrap(), None);
        assert_eq!(scan.ending(), Some(Ending::Damaged { at: 8 }));
    }
}
