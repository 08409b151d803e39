//! Walks over the records of an MCAP file, also of one that was torn by a kill or a power cut. RT: no.
//!
//! Our chunks are not compressed, so their content is a run of records like any other: the walk goes into a chunk
//! after its head and needs no special case for a chunk whose end is missing. The sum of a chunk that is there as a whole
//! is checked before anything of it is believed, and the sum of all data at the end of the file; a torn chunk is read
//! without. `mcap`'s own readers give a torn chunk up as a whole.

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

/// The bytes of a file; those of a chunk that was looked at as a whole come from memory.
struct Bytewise<R> {
    source: R,
    chunk: Vec<u8>,
    taken: usize,
    /// Of all that was read from the source.
    sum: crc32fast::Hasher,
}

impl<R: Read> Bytewise<R> {
    /// Reads so many bytes of a chunk ahead. Their sum, if all of them are there.
    fn look_ahead(&mut self, length: u64) -> io::Result<Option<u32>> {
        self.chunk.clear();
        self.taken = 0;
        let count = (&mut self.source).take(length).read_to_end(&mut self.chunk)?;
        self.sum.update(&self.chunk);
        Ok((count as u64 == length).then(|| crc32fast::hash(&self.chunk)))
    }
}

impl<R: Read> Read for Bytewise<R> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let ahead = &self.chunk[self.taken..];
        if !ahead.is_empty() {
            let count = ahead.len().min(bytes.len());
            bytes[..count].copy_from_slice(&ahead[..count]);
            self.taken += count;
            return Ok(count);
        }
        let count = self.source.read(bytes)?;
        self.sum.update(&bytes[..count]);
        Ok(count)
    }
}

/// The walk.
pub struct Scan<R> {
    source: Bytewise<R>,
    at: u64,
    body: Vec<u8>,
    ending: Option<Ending>,
}

impl<R: Read> Scan<R> {
    /// Begins behind the magic. `None` if the file has none: it is no MCAP file, or empty.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn new(source: R) -> io::Result<Option<Self>> {
        let mut source = Bytewise { source, chunk: Vec::new(), taken: 0, sum: crc32fast::Hasher::new() };
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
        let before = self.source.sum.clone().finalize();
        let Some(op) = self.read_body(start)? else { return Ok(None) };
        if op == op::DATA_END {
            let whole = sum_agrees(self.body.first_chunk(), before);
            self.ending = Some(if whole { self.read_summary()? } else { Ending::Damaged { at: start } });
            return Ok(None);
        }
        match parse(op, &self.body) {
            Some(record) => Ok(Some(record)),
            None => {
                self.ending = Some(Ending::Damaged { at: start });
                Ok(None)
            }
        }
    }

    /// Behind the data: a summary that nobody needs, its sum, and the magic that tells that the file was closed.
    fn read_summary(&mut self) -> io::Result<Ending> {
        let mut rest = Vec::new();
        (&mut self.source).take(LONGEST).read_to_end(&mut rest)?;
        let Some((summary, sum)) = rest.strip_suffix(&MAGIC).and_then(|rest| rest.split_last_chunk::<4>()) else {
            return Ok(Ending::Torn { at: self.at });
        };
        let whole = sum_agrees(Some(sum), crc32fast::hash(summary));
        Ok(if whole { Ending::Whole } else { Ending::Damaged { at: self.at } })
    }

    /// Reads one record's bytes. Of a chunk only the head, so that its records come next.
    fn read_body(&mut self, start: u64) -> io::Result<Option<u8>> {
        let Some([op, length @ ..]) = self.read::<9>()? else { return self.end(Ending::Torn { at: start }) };
        let length = u64::from_le_bytes(length);
        if op == 0 {
            return self.end(Ending::Damaged { at: start });
        }
        if op == op::CHUNK {
            return match self.read_chunk_head(length)? {
                true => Ok(Some(op::CHUNK)),
                false => Ok(None),
            };
        }
        if length > LONGEST {
            return self.end(Ending::Damaged { at: start });
        }
        self.body.clear();
        // As many as there are: a length that is made up takes no memory.
        let count = (&mut self.source).take(length).read_to_end(&mut self.body)?;
        if (count as u64) < length {
            return self.end(Ending::Torn { at: start });
        }
        self.at += length;
        Ok(Some(op))
    }

    /// Times, size, sum; compression, which must be none; size.
    fn read_chunk_head(&mut self, length: u64) -> io::Result<bool> {
        let start = self.at;
        self.body.clear();
        let Some(fixed) = self.read::<32>()? else { return self.end(Ending::Torn { at: start }).map(|_| false) };
        if fixed[28..] != [0; 4] {
            // A compressed chunk: not one of our recordings.
            return self.end(Ending::Damaged { at: start }).map(|_| false);
        }
        let Some(size) = self.read::<8>()?.map(u64::from_le_bytes) else {
            return self.end(Ending::Torn { at: start }).map(|_| false);
        };
        if size > LONGEST || size.saturating_add(CHUNK_HEAD) != length {
            return self.end(Ending::Damaged { at: start }).map(|_| false);
        }
        let sum = self.source.look_ahead(size)?;
        if sum.is_some_and(|sum| !sum_agrees(fixed.get(24..).and_then(|f| f.first_chunk()), sum)) {
            return self.end(Ending::Damaged { at: start }).map(|_| false);
        }
        Ok(true)
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

/// Bytes of a chunk before its records: times, size, sum, compression, size.
const CHUNK_HEAD: u64 = 40;

/// A sum as it stands in the file; 0 = there is none.
fn sum_agrees(stored: Option<&[u8; 4]>, sum: u32) -> bool {
    stored.is_some_and(|stored| matches!(u32::from_le_bytes(*stored), 0) || u32::from_le_bytes(*stored) == sum)
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

    /// 60 MB were taken and filled with zeros for a file of 20 bytes.
    #[test]
    fn a_length_that_is_made_up_takes_no_memory() {
        let file = [&MAGIC[..], &[op::SCHEMA], &60_000_000_u64.to_le_bytes(), &[1; 3]].concat();
        let mut scan = Scan::new(&file[..]).unwrap().unwrap();
        assert!(scan.next_record().unwrap().is_none());
        assert_eq!(scan.ending(), Some(Ending::Torn { at: 8 }));
        assert!(scan.body.capacity() < 1 << 20, "{}", scan.body.capacity());
    }

    #[test]
    fn zeros_after_a_power_cut_are_damage_not_records() {
        let file = [&MAGIC[..], &[0; 100]].concat();
        let mut scan = Scan::new(file.as_slice()).unwrap().unwrap();
        assert_eq!(scan.next_record().unwrap(), None);
        assert_eq!(scan.ending(), Some(Ending::Damaged { at: 8 }));
    }
}
