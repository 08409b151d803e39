//! The other end: ticks from a socket. RT: no.

use super::{Block, Foreign, Greeting, Message, Parser, shape_hash, tick_of};
use crate::msg::TickRecord;
use std::io::{self, ErrorKind, Read};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::{Duration, Instant};

/// The greeting comes with the next admission, after 32 ms; a robot that stands still for so long is none.
const PATIENCE: Duration = Duration::from_secs(3);
/// Bytes read at once.
const CHUNK: usize = 1 << 16;

/// Why there is nothing to read along.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The socket.
    #[error("cannot be read")]
    Io(#[from] io::Error),
    /// No such stream.
    #[error(transparent)]
    Foreign(#[from] Foreign),
    /// Ticks there are made of other fields.
    #[error("the robot runs another build of compass, whose ticks have other fields: use that build to watch it")]
    OtherBuild,
    /// It closed before its greeting.
    #[error("turned away: as many read along already as can")]
    Full,
    /// It did not greet.
    #[error("no greeting within {PATIENCE:?}: does the robot stand still?")]
    Silent,
}

/// Reads along.
#[derive(Debug)]
pub struct LiveReader {
    stream: UnixStream,
    parser: Parser,
    config_text: String,
}

impl LiveReader {
    /// Connects and waits for the greeting.
    ///
    /// # Errors
    /// [`LiveError`].
    pub fn connect(path: &Path) -> Result<Self, LiveError> {
        let stream = UnixStream::connect(path)?;
        stream.set_nonblocking(true)?;
        let mut reader = Self { stream, parser: Parser::default(), config_text: String::new() };
        let end = Instant::now() + PATIENCE;
        while Instant::now() < end {
            let more = reader.read_some()?;
            if let Some(Block::Greeting(Greeting { shape_hash: theirs, config_text })) = reader.parser.take()? {
                reader.config_text = config_text;
                return if theirs == shape_hash() { Ok(reader) } else { Err(LiveError::OtherBuild) };
            }
            if !more {
                return Err(LiveError::Full);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        Err(LiveError::Silent)
    }

    /// Canonical text of the configuration that runs there.
    #[must_use]
    pub fn config_text(&self) -> &str {
        &self.config_text
    }

    /// Hands over the ticks that came, and what stands beside them, without waiting. False at the end of the run.
    ///
    /// # Errors
    /// [`LiveError`].
    pub fn poll(
        &mut self,
        mut each: impl FnMut(&TickRecord),
        mut beside: impl FnMut(Message<'_>),
    ) -> Result<bool, LiveError> {
        let more = self.read_some()?;
        while let Some(block) = self.parser.take()? {
            match block {
                Block::Tick(bytes) => each(&*tick_of(&bytes, &mut beside)?),
                Block::Greeting(_) => return Err(Foreign.into()),
            }
        }
        Ok(more)
    }

    /// Takes what is there, a chunk or two at a time so that a view stays fluent. False at the end.
    fn read_some(&mut self) -> Result<bool, LiveError> {
        let mut chunk = vec![0; CHUNK];
        for _ in 0..16 {
            match self.stream.read(&mut chunk) {
                Ok(0) => return Ok(false),
                Ok(count) => self.parser.push(&chunk[..count]),
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(true),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::ConnectionReset => return Ok(false),
                Err(error) => return Err(error.into()),
            }
        }
        Ok(true)
    }
}
