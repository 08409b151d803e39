//! The simulated scanner's end of its line: a TCP port or a pseudo-terminal where the controller looks for it, or one half of a
//! pair within a process. RT: no.
#![expect(clippy::disallowed_types, reason = "not in the controller's threads")]

use super::{Link, ServeError};
use crate::base::time::Stamp;
use crate::config::checked::LidarLink;
use crate::sensor::lidar::link::read;
use crate::sensor::serial::PseudoTerminal;
use crate::sim::lidar::SimLidar;
use std::io::{ErrorKind, Write};
use std::net::{TcpListener, TcpStream};
use std::os::fd::{AsRawFd, RawFd};
use std::os::unix::net::UnixStream;

/// A host that leaves so much lying is gone: ten scans.
const MOST_UNSENT: usize = 35_000;
/// Longer than any request.
const REQUEST: usize = 256;

/// Its end of the line.
#[derive(Debug)]
pub struct LidarPort {
    line: Line,
    /// What the line has not taken yet.
    unsent: Vec<u8>,
}

#[derive(Debug)]
enum Line {
    Tcp { listener: TcpListener, host: Option<TcpStream> },
    Serial { terminal: PseudoTerminal, _link: Link },
    Pair(UnixStream),
}

impl LidarPort {
    /// `None` if the configuration names no place for it.
    pub(in crate::sim) fn open(link: &LidarLink) -> Result<Option<Self>, ServeError> {
        let line = match link {
            LidarLink::Mock => return Ok(None),
            LidarLink::Tcp(address) => {
                let error = |cause| ServeError::Lidar { address: *address, cause };
                let listener = TcpListener::bind(address).map_err(error)?;
                listener.set_nonblocking(true).map_err(error)?;
                Line::Tcp { listener, host: None }
            }
            LidarLink::Serial(path) => {
                let terminal = PseudoTerminal::new()?;
                let link = Link::new(path, terminal.path().unwrap_or_default())?;
                Line::Serial { terminal, _link: link }
            }
        };
        Ok(Some(Self { line, unsent: Vec::new() }))
    }

    /// One half of a pair that does not wait.
    #[must_use]
    pub const fn on_pair(stream: UnixStream) -> Self {
        Self { line: Line::Pair(stream), unsent: Vec::new() }
    }

    /// Descriptors that poll readable when there is something to do; negative if there are none.
    pub(in crate::sim) fn readable_fds(&self) -> [RawFd; 2] {
        match &self.line {
            Line::Tcp { listener, host } => [listener.as_raw_fd(), host.as_ref().map_or(-1, AsRawFd::as_raw_fd)],
            Line::Serial { terminal, .. } => [terminal.far.readable_fd(), -1],
            Line::Pair(stream) => [stream.as_raw_fd(), -1],
        }
    }

    /// Takes connections and requests, hands over what is due.
    pub fn turn(&mut self, device: &mut SimLidar, now: Stamp) {
        self.accept(device);
        let mut buffer = [0; REQUEST];
        let heard = match &mut self.line {
            Line::Tcp { host: Some(host), .. } => read(host, &mut buffer),
            Line::Tcp { host: None, .. } => Some(0),
            Line::Serial { terminal, .. } => Some(terminal.far.read(&mut buffer).unwrap_or(0)),
            Line::Pair(stream) => read(stream, &mut buffer),
        };
        match heard {
            Some(count) => device.hear(now, &buffer[..count]),
            None => self.hang_up(),
        }
        device.take(now, &mut self.unsent);
        self.send();
    }

    /// One host at a time, the newest: the one before may be half open.
    fn accept(&mut self, device: &mut SimLidar) {
        let Line::Tcp { listener, host } = &mut self.line else {
            // A line without connections is one as soon as the device listens.
            if !device.is_connected() {
                device.connect();
            }
            return;
        };
        let Ok((stream, _)) = listener.accept() else { return };
        // A device that does not know of a connection leaves it to the host to notice.
        device.connect();
        *host = stream.set_nonblocking(true).and_then(|()| stream.set_nodelay(true)).is_ok().then_some(stream);
        self.unsent.clear();
    }

    fn send(&mut self) {
        if self.unsent.is_empty() {
            return;
        }
        let taken = match &mut self.line {
            Line::Tcp { host: Some(host), .. } => written(host.write(&self.unsent)),
            Line::Tcp { host: None, .. } => Some(self.unsent.len()),
            Line::Pair(stream) => written(stream.write(&self.unsent)),
            // A terminal takes all or, while nobody reads, nothing.
            Line::Serial { terminal, .. } => {
                terminal.far.write(&self.unsent);
                Some(self.unsent.len())
            }
        };
        match taken {
            Some(count) => drop(self.unsent.drain(..count)),
            None => self.hang_up(),
        }
        if self.unsent.len() > MOST_UNSENT {
            self.hang_up();
        }
    }

    fn hang_up(&mut self) {
        if let Line::Tcp { host, .. } = &mut self.line {
            *host = None;
        }
        self.unsent.clear();
    }
}

/// Bytes that were taken. `None`: the line has ended.
fn written(result: std::io::Result<usize>) -> Option<usize> {
    let waits = |e: std::io::Error| matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted).then_some(0);
    result.map_or_else(waits, Some)
}
