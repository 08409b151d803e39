//! A bus in memory: two ends, each hears the other, and its own frames as echoes. RT: yes, lock-free.
//!
//! [`pair`] is a whole bus for tests. [`mock`] is what the simulated robot sits on: there the plant models the wire and
//! sends the echoes itself, when the frame has left, so the ends do not echo; and the plant keeps its own time, so its
//! end is not woken for each frame.

use super::link::{self, Signal};
use super::{Duplex, Receive, SendError, Transmit};
use crate::base::listening::Pulse;
use crate::base::time::Stamp;
use crate::channel::ring::Ring;
use crate::msg::{BusFrame, BusHealth, CanFrame};
use std::os::fd::RawFd;
use std::sync::Arc;

/// Frames that wait at one end: 12 ms of a full bus.
const CAPACITY: usize = 256;

/// Frames on their way to one end.
#[derive(Debug)]
struct Inbox {
    frames: Ring<BusFrame>,
    signal: Option<Signal>,
}

impl Inbox {
    fn new(woken: bool) -> std::io::Result<Arc<Self>> {
        let signal = if woken { Some(Signal::new()?) } else { None };
        Ok(Arc::new(Self { frames: Ring::new(CAPACITY), signal }))
    }

    fn put(&self, frame: BusFrame) -> Result<(), SendError> {
        if !self.frames.push(&frame) {
            return Err(SendError::Full);
        }
        if let Some(signal) = &self.signal {
            signal.raise();
        }
        Ok(())
    }
}

/// Sending half of an end.
#[derive(Clone, Debug)]
pub struct LoopbackTx {
    peer: Arc<Inbox>,
    echo: Option<Arc<Inbox>>,
}

/// Receiving half of an end.
#[derive(Debug)]
pub struct LoopbackRx {
    inbox: Arc<Inbox>,
    /// Of the simulated robot at the other end.
    peer: Option<Arc<Pulse>>,
}

/// One end of a bus in memory.
pub type Loopback = Duplex<LoopbackTx, LoopbackRx>;

/// Two ends that echo.
///
/// # Errors
/// No descriptor left.
pub fn pair() -> std::io::Result<(Loopback, Loopback)> {
    let (a, b) = (Inbox::new(true)?, Inbox::new(true)?);
    Ok((end(&a, &b, true, None), end(&b, &a, true, None)))
}

/// The controller's end, woken by frames, and the simulated robot's, which is not; neither echoes. `pulse` is the
/// robot's.
///
/// # Errors
/// No descriptor left.
pub fn mock(pulse: &Arc<Pulse>) -> std::io::Result<(Loopback, Loopback)> {
    let (host, robot) = (Inbox::new(true)?, Inbox::new(false)?);
    Ok((end(&host, &robot, false, Some(pulse)), end(&robot, &host, false, None)))
}

fn end(own: &Arc<Inbox>, peer: &Arc<Inbox>, echoes: bool, pulse: Option<&Arc<Pulse>>) -> Loopback {
    let echo = echoes.then(|| Arc::clone(own));
    let rx = LoopbackRx { inbox: Arc::clone(own), peer: pulse.cloned() };
    Duplex { tx: LoopbackTx { peer: Arc::clone(peer), echo }, rx }
}

impl LoopbackTx {
    /// Sends as it is: the simulated wire knows when the frame was on it, and whose it is.
    ///
    /// # Errors
    /// [`SendError::Full`] when the other end does not read.
    pub fn send_stamped(&mut self, frame: BusFrame) -> Result<(), SendError> {
        self.peer.put(frame)
    }
}

impl Transmit for LoopbackTx {
    fn send(&mut self, frame: &CanFrame) -> Result<(), SendError> {
        let stamp = link::monotonic_now();
        self.peer.put(BusFrame::theirs(stamp, *frame))?;
        self.echo.as_ref().map_or(Ok(()), |own| own.put(BusFrame::ours(stamp, *frame)))
    }
}

impl Receive for LoopbackRx {
    fn receive(&mut self) -> Option<BusFrame> {
        self.inbox.frames.pop().or_else(|| {
            // Lower first, look again after: a frame put in between raises the signal anew or is found here.
            self.inbox.signal.as_ref()?.lower();
            self.inbox.frames.pop()
        })
    }

    fn health(&self) -> BusHealth {
        BusHealth::Active
    }

    fn readable_fd(&self) -> RawFd {
        self.inbox.signal.as_ref().map_or(-1, Signal::fd)
    }

    fn complete_until(&self, now: Stamp) -> Stamp {
        self.peer.as_ref().map_or(now, |pulse| pulse.last().min(now))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::laws;

    #[test]
    fn loopback_keeps_the_laws_of_a_bus() {
        laws::bus_laws(|| pair().unwrap());
    }

    #[test]
    fn an_end_that_does_not_read_refuses_at_last() {
        let (mut a, _b) = mock(&Arc::default()).unwrap();
        let frame = CanFrame::new(1, &[]);
        let refused = (0..=CAPACITY).find_map(|_| a.send(&frame).err());
        assert_eq!(refused, Some(SendError::Full));
    }
}
