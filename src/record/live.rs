//! Reading along over a UNIX socket, for those whom shared memory shuts out: other users of the group. RT: no.
//!
//! The server ([`Window`]) speaks first and listens to nothing. All numbers are little endian:
//!
//! | block | bytes |
//! |---|---|
//! | greeting, once | `COMPASS1`, u64 hash of a tick's shape, u32 length, the configuration's canonical text |
//! | tick | u32 length of what follows, then messages of what stands beside the ticks, then its own |
//! | message | u8 stream (index in [`Stream::ALL`]), i64 time of validity in ns, u32 length, bytes as in a recording |
//!
//! A reader that is slower than the robot loses whole ticks, never parts; the ticks' numbers tell how many.

mod reader;
mod window;

use super::stream::{Assembled, Assembly, Stream};
use crate::base::bytes;
use crate::base::time::Stamp;
use crate::channel::topic::schema_hash;
use crate::msg::{Element, TickRecord};

pub use reader::{LiveError, LiveReader};
pub use window::Window;

/// First bytes of a greeting.
const MAGIC: &[u8; 8] = b"COMPASS1";
/// Greeting up to its text.
const GREETING_HEAD: usize = 20;
/// Message up to its bytes.
const MESSAGE_HEAD: usize = 13;
/// Longest tick, bytes: some 4 kB, and what stands beside it. Whoever says more speaks another language.
const LONGEST_TICK: usize = 1 << 20;
/// Longest configuration, bytes. It holds the text of the LQR-tree: 40 000 nodes, the most that `plan tree` takes, of at
/// most 22 numbers of 15 characters are 13.2 MB.
const LONGEST_CONFIG: usize = 16 << 20;

/// The hash of what a tick is made of in this build.
fn shape_hash() -> u64 {
    schema_hash(&TickRecord::KIND)
}

/// The first block.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Greeting {
    /// What a tick is made of there.
    pub shape_hash: u64,
    /// Canonical text of the configuration that runs.
    pub config_text: String,
}

impl Greeting {
    fn to_bytes(&self) -> Vec<u8> {
        let text = self.config_text.as_bytes();
        [&MAGIC[..], &self.shape_hash.to_le_bytes(), &length(text).to_le_bytes(), text].concat()
    }
}

/// Blocks are far below 4 GB.
fn length(block: &[u8]) -> u32 {
    u32::try_from(block.len()).unwrap_or(u32::MAX)
}

/// What is in a stream of bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Block {
    /// The first.
    Greeting(Greeting),
    /// Messages of one tick.
    Tick(Vec<u8>),
}

/// These bytes are of no such stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("what listens there is no `compass run`, or its bytes are broken")]
pub struct Foreign;

/// Finds blocks in bytes that come in pieces of any size.
#[derive(Debug, Default)]
pub struct Parser {
    waiting: Vec<u8>,
    greeted: bool,
}

impl Parser {
    /// More bytes.
    pub fn push(&mut self, bytes: &[u8]) {
        self.waiting.extend_from_slice(bytes);
    }

    /// The next whole block; `None` if it has not come yet.
    ///
    /// # Errors
    /// When the bytes cannot be such a stream. Then nothing more comes out of it.
    pub fn take(&mut self) -> Result<Option<Block>, Foreign> {
        if self.greeted { self.take_tick() } else { self.take_greeting() }
    }

    fn take_greeting(&mut self) -> Result<Option<Block>, Foreign> {
        let known = self.waiting.len().min(MAGIC.len());
        if self.waiting[..known] != MAGIC[..known] {
            return Err(Foreign);
        }
        let Some(head) = self.waiting.get(..GREETING_HEAD) else { return Ok(None) };
        let shape_hash = u64::from_le_bytes(bytes::padded(&head[8..16]));
        let length = u32::from_le_bytes(bytes::padded(&head[16..]));
        let Some(text) = self.cut(GREETING_HEAD, length, LONGEST_CONFIG)? else { return Ok(None) };
        let config_text = String::from_utf8(text).map_err(|_| Foreign)?;
        self.greeted = true;
        Ok(Some(Block::Greeting(Greeting { shape_hash, config_text })))
    }

    fn take_tick(&mut self) -> Result<Option<Block>, Foreign> {
        let Some(head) = self.waiting.get(..4) else { return Ok(None) };
        Ok(self.cut(4, u32::from_le_bytes(bytes::padded(head)), LONGEST_TICK)?.map(Block::Tick))
    }

    /// Takes a block of this length, and the head before it. Foreign if it is longer than `longest`.
    fn cut(&mut self, head: usize, length: u32, longest: usize) -> Result<Option<Vec<u8>>, Foreign> {
        let length = usize::try_from(length).ok().filter(|length| *length <= longest).ok_or(Foreign)?;
        if self.waiting.len() < head + length {
            return Ok(None);
        }
        let block = self.waiting[head..head + length].to_vec();
        self.waiting.drain(..head + length);
        Ok(Some(block))
    }
}

/// A message of a block: stream, time of validity, bytes.
pub type Message<'a> = (Stream, Stamp, &'a [u8]);

/// The next message of a block, and the rest; `None` at its end.
fn next_message(block: &[u8]) -> Result<Option<(Message<'_>, &[u8])>, Foreign> {
    let Some((head, rest)) = block.split_at_checked(MESSAGE_HEAD) else {
        return if block.is_empty() { Ok(None) } else { Err(Foreign) };
    };
    let stream = *Stream::ALL.get(usize::from(head[0])).ok_or(Foreign)?;
    let valid_at = Stamp(i64::from_le_bytes(bytes::padded(&head[1..9])));
    let length = usize::try_from(u32::from_le_bytes(bytes::padded(&head[9..]))).map_err(|_| Foreign)?;
    let (message, rest) = rest.split_at_checked(length).ok_or(Foreign)?;
    Ok(Some(((stream, valid_at, message), rest)))
}

/// The tick of a block; `beside` gets what does not travel with ticks.
///
/// # Errors
/// When its messages do not make a whole tick of this build.
pub fn tick_of(mut block: &[u8], mut beside: impl FnMut(Message<'_>)) -> Result<Box<TickRecord>, Foreign> {
    let mut assembly = Assembly::default();
    while let Some((message, rest)) = next_message(block)? {
        block = rest;
        let (stream, _, bytes) = message;
        match assembly.take(stream, bytes) {
            Assembled::Pending if stream.is_beside() => beside(message),
            Assembled::Pending => {}
            Assembled::Tick(tick) if block.is_empty() => return Ok(tick),
            Assembled::Tick(_) | Assembled::Broken => return Err(Foreign),
        }
    }
    Err(Foreign)
}

/// Adds a message to a block.
fn put_message(block: &mut Vec<u8>, stream: Stream, valid_at: Stamp, message: &[u8]) {
    block.push(stream as u8);
    block.extend_from_slice(&valid_at.0.to_le_bytes());
    block.extend_from_slice(&length(message).to_le_bytes());
    block.extend_from_slice(message);
}

#[cfg(test)]
mod tests;
