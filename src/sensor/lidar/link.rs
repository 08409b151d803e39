//! What carries a scanner's bytes: a TCP connection or a serial device, made anew when it is dead. RT: no, in an ordinary
//! thread.
#![expect(clippy::disallowed_types, reason = "in an ordinary thread")]

use super::LidarReader;
use crate::base::time::{Span, Stamp};
use crate::config::checked::LidarLink;
use crate::msg::LidarSample;
use crate::sensor::serial::SerialLine;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::os::fd::{AsRawFd, RawFd};
use std::os::unix::net::UnixStream;
use std::time::Duration;

/// Nobody waits longer for a scanner to accept.
const CONNECT_TIMEOUT: Duration = Duration::from_millis(500);
/// Between two attempts.
const ATTEMPT_EVERY: Span = Span::from_ms(500);
/// A USB modem does not care for its rate.
const BAUD: u32 = 115_200;

/// Chunks read in a turn: more than a scan.
const CHUNKS: usize = 8;
/// Bytes of one.
const CHUNK: usize = 2048;

/// A line to a scanner that never waits for bytes, and can be made anew.
pub trait LidarWire {
    /// Opens it if it is closed and it is time for another attempt.
    fn open(&mut self, now: Stamp) -> Opened;
    /// There is a line, as far as this end knows.
    fn is_open(&self) -> bool;
    /// Closes it, so that the next [`Self::open`] makes it anew.
    fn close(&mut self);
    /// Bytes that are there, 0 if none.
    fn read(&mut self, buffer: &mut [u8]) -> usize;
    /// Hands over a request.
    fn write(&mut self, bytes: &[u8]);
}

/// One turn: opens the line if need be, takes what came, asks what is due. To be called every few milliseconds.
pub fn serve(reader: &mut LidarReader, wire: &mut dyn LidarWire, now: Stamp, mut each: impl FnMut(&LidarSample)) {
    match wire.open(now) {
        Opened::Nothing => {}
        Opened::Anew => reader.connected(now),
        Opened::Refused => reader.gone(now, &mut each),
    }
    let mut buffer = [0; CHUNK];
    for _ in 0..CHUNKS {
        let count = wire.read(&mut buffer);
        if count == 0 {
            break;
        }
        reader.receive(now, buffer.get(..count).unwrap_or(&[]), &mut each);
    }
    if !wire.is_open() {
        return;
    }
    if let Some(request) = reader.transmit(now, &mut each) {
        wire.write(request);
    }
    if reader.takes_new_connection() {
        wire.close();
    }
}

/// How to get to a scanner.
#[derive(Debug)]
enum Way {
    Tcp(SocketAddr),
    Serial(String),
    /// The simulated one: its end of a pair.
    Pair,
}

/// An open line.
#[derive(Debug)]
enum Line {
    Tcp(TcpStream),
    Serial(SerialLine),
    Pair(UnixStream),
}

/// A line to a scanner that is opened again and again.
#[derive(Debug)]
pub struct LidarLine {
    way: Way,
    line: Option<Line>,
    next_attempt: Stamp,
}

/// What became of an attempt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Opened {
    /// It was open already, or it is not yet time for the next attempt.
    Nothing,
    /// There is a new line.
    Anew,
    /// Nobody is there.
    Refused,
}

impl LidarLine {
    /// To a real scanner; opened with the first [`Self::open`]. `None` for the simulated one, see [`Self::pair`].
    #[must_use]
    pub fn new(link: &LidarLink) -> Option<Self> {
        let way = match link {
            LidarLink::Mock => return None,
            LidarLink::Tcp(address) => Way::Tcp(*address),
            LidarLink::Serial(path) => Way::Serial(path.clone()),
        };
        Some(Self { way, line: None, next_attempt: Stamp::NEVER })
    }

    /// To the simulated scanner at the other end, and that end.
    ///
    /// # Errors
    /// No more descriptors.
    pub fn pair() -> std::io::Result<(Self, UnixStream)> {
        let (host, device) = UnixStream::pair()?;
        host.set_nonblocking(true)?;
        device.set_nonblocking(true)?;
        Ok((Self { way: Way::Pair, line: Some(Line::Pair(host)), next_attempt: Stamp::NEVER }, device))
    }

    /// A descriptor that polls readable when bytes are there; negative if there is none.
    #[must_use]
    pub fn readable_fd(&self) -> RawFd {
        match &self.line {
            Some(Line::Tcp(stream)) => stream.as_raw_fd(),
            Some(Line::Serial(line)) => line.readable_fd(),
            Some(Line::Pair(stream)) => stream.as_raw_fd(),
            None => -1,
        }
    }
}

impl LidarWire for LidarLine {
    /// Waits for a scanner to accept, up to `CONNECT_TIMEOUT`.
    fn open(&mut self, now: Stamp) -> Opened {
        if self.line.is_some() || now < self.next_attempt {
            return Opened::Nothing;
        }
        self.next_attempt = now + ATTEMPT_EVERY;
        self.line = match &self.way {
            Way::Tcp(address) => connect(*address).ok().map(Line::Tcp),
            Way::Serial(path) => SerialLine::open(path, BAUD).ok().map(Line::Serial),
            Way::Pair => None,
        };
        if self.line.is_some() { Opened::Anew } else { Opened::Refused }
    }

    fn is_open(&self) -> bool {
        self.line.is_some()
    }

    /// A pair within a process cannot be half open, and stays.
    fn close(&mut self) {
        if !matches!(self.way, Way::Pair) {
            self.line = None;
        }
    }

    /// A line that has ended is closed.
    fn read(&mut self, buffer: &mut [u8]) -> usize {
        let count = match &mut self.line {
            Some(Line::Tcp(stream)) => read(stream, buffer),
            Some(Line::Serial(line)) => line.read(buffer),
            Some(Line::Pair(stream)) => read(stream, buffer),
            None => Some(0),
        };
        if count.is_none() {
            self.line = None;
        }
        count.unwrap_or(0)
    }

    /// A request of some bytes that is not taken: the line is dead.
    fn write(&mut self, bytes: &[u8]) {
        let written = match &mut self.line {
            Some(Line::Tcp(stream)) => stream.write(bytes).is_ok_and(|count| count == bytes.len()),
            Some(Line::Serial(line)) => line.write(bytes),
            Some(Line::Pair(stream)) => stream.write(bytes).is_ok_and(|count| count == bytes.len()),
            None => true,
        };
        if !written {
            self.line = None;
        }
    }
}

fn connect(address: SocketAddr) -> std::io::Result<TcpStream> {
    let stream = TcpStream::connect_timeout(&address, CONNECT_TIMEOUT)?;
    // Requests are short, and their answers measure the clock.
    stream.set_nodelay(true)?;
    stream.set_nonblocking(true)?;
    Ok(stream)
}

/// Bytes that are there, 0 if none. `None`: the line has ended.
pub fn read(stream: &mut impl Read, buffer: &mut [u8]) -> Option<usize> {
    match stream.read(buffer) {
        Ok(0) => None,
        Ok(count) => Some(count),
        Err(error) => matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted).then_some(0),
    }
}
