//! The robot's end: serves whoever connects, waits for nobody. RT: no, in the relay's thread.

use super::super::cdr::encode;
use super::super::stream::{Stream, explode};
use super::{Greeting, LONGEST_CONFIG, length, put_message, shape_hash};
use crate::base::time::Stamp;
use crate::channel::socket_file;
use crate::msg::{Element, TickRecord};
use std::convert::Infallible;
use std::io::{self, ErrorKind, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

/// Readers at a time; more are turned away.
const MOST_READERS: usize = 8;
/// Bytes that wait for one reader beside the kernel's: half a second of ticks.
const MOST_WAITING: usize = 1 << 20;
/// Ticks between two looks at who wants in.
const ADMISSION_TICKS: u64 = 32;

/// A socket at which others of the group read along.
#[derive(Debug)]
pub struct Window {
    listener: UnixListener,
    path: PathBuf,
    greeting: Vec<u8>,
    readers: Vec<Reader>,
    message: Vec<u8>,
    block: Vec<u8>,
    /// Messages that go before those of the next tick.
    beside: Vec<u8>,
}

/// Somebody who reads along.
#[derive(Debug)]
struct Reader {
    stream: UnixStream,
    waiting: Vec<u8>,
}

impl Window {
    /// Makes the socket, for user and group; one that a dead process left behind is replaced, anything else is not.
    ///
    /// # Errors
    /// When the path cannot be bound, holds something else than a socket, or somebody listens there; when the
    /// configuration is longer than any reader takes.
    pub fn open(path: &Path, config_text: &str) -> io::Result<Self> {
        if config_text.len() > LONGEST_CONFIG {
            let what = format!(
                "the configuration has {} bytes, its LQR-tree included; those who watch take {LONGEST_CONFIG} at most",
                config_text.len()
            );
            return Err(io::Error::new(ErrorKind::InvalidInput, what));
        }
        socket_file::clear_the_way(path, |path| Ok(UnixStream::connect(path).is_ok()))?;
        let listener = UnixListener::bind(path)?;
        socket_file::open_to_the_group(path)?;
        listener.set_nonblocking(true)?;
        let greeting = Greeting { shape_hash: shape_hash(), config_text: config_text.to_owned() }.to_bytes();
        let (message, block, beside) = Default::default();
        Ok(Self { listener, path: path.to_owned(), greeting, readers: Vec::new(), message, block, beside })
    }

    /// Adds what does not travel with ticks: it goes out with the next one.
    pub fn put_beside(&mut self, stream: Stream, valid_at: Stamp, message: &impl Element) {
        if !self.readers.is_empty() {
            encode(message, &mut self.message);
            put_message(&mut self.beside, stream, valid_at, &self.message);
        }
    }

    /// Hands the tick to all readers that have room for it. Never waits.
    pub fn serve(&mut self, tick: &TickRecord) {
        if tick.input.index.is_multiple_of(ADMISSION_TICKS) {
            self.admit();
        }
        if self.readers.is_empty() {
            return;
        }
        self.block.clear();
        self.block.extend_from_slice(&[0; 4]);
        self.block.append(&mut self.beside);
        let block = &mut self.block;
        let Ok(()) = explode(tick, &mut self.message, |stream, valid_at, message| {
            put_message(block, stream, valid_at, message);
            Ok::<(), Infallible>(())
        });
        let length = length(&self.block[4..]);
        self.block[..4].copy_from_slice(&length.to_le_bytes());
        self.readers.retain_mut(|reader| reader.offer(&self.block).is_ok());
    }

    fn admit(&mut self) {
        while let Ok((stream, _)) = self.listener.accept() {
            // Who is one too many sees the end of the stream before any greeting.
            if self.readers.len() < MOST_READERS && stream.set_nonblocking(true).is_ok() {
                self.readers.push(Reader { stream, waiting: self.greeting.clone() });
            }
        }
    }
}

impl Drop for Window {
    fn drop(&mut self) {
        // It may have been removed already.
        drop(std::fs::remove_file(&self.path));
    }
}

impl Reader {
    /// Sends what waits, and this block behind it if there is room. An error: the reader is gone.
    fn offer(&mut self, block: &[u8]) -> io::Result<()> {
        if self.waiting.len() + block.len() <= MOST_WAITING {
            self.waiting.extend_from_slice(block);
        }
        let mut sent = 0;
        let result = loop {
            match self.stream.write(&self.waiting[sent..]) {
                Ok(0) => break Ok(()),
                Ok(count) => sent += count,
                Err(error) if error.kind() == ErrorKind::WouldBlock => break Ok(()),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => break Err(error),
            }
        };
        self.waiting.drain(..sent);
        result
    }
}
