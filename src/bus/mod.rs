//! Room 6: frames on wires.
//!
//! | file | what |
//! |---|---|
//! | `frame` | how long a frame takes on the wire, exact and worst case |
//! | [`canopen`], [`sdo`], [`pdo`] | CiA 301 as pure parse and emit |
//! | [`cia402`] | the drive profile's state machine, both ends of it |
//! | [`mit`], [`odrive`], [`moteus`] | other drives' frames, both ends of them |
//! | [`budget`] | who may use the bus when, and whether it all fits |
//! | [`mod@line`] | the master of one bus |
//! | [`socketcan`] | the real wire |
//! | [`loopback`] | a bus in memory; the simulated robot sits on it |
//! | [`faulty`] | loses, doubles, delays, flips frames of any bus |
//!
//! A bus never waits: a frame is taken or refused at once, and a frame is there or not. A frame that was sent comes
//! back as an *echo* from the wire itself, which is the only proof that it left; every implementation does this.
//! RT: yes.
#![cfg_attr(
    not(test),
    deny(
        clippy::disallowed_methods,
        clippy::disallowed_types,
        clippy::disallowed_macros,
        clippy::expect_used,
        clippy::indexing_slicing
    )
)]

pub mod budget;
pub mod canopen;
pub mod cia402;
pub mod faulty;
pub mod frame;
pub mod line;
mod link;
pub mod loopback;
pub mod mit;
pub mod moteus;
pub mod odrive;
pub mod pdo;
pub mod sdo;
pub mod socketcan;

#[cfg(test)]
mod laws;

use crate::base::time::Stamp;
use crate::msg::{BusFrame, BusHealth, CanFrame};
use std::os::fd::RawFd;

/// Why a frame was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SendError {
    /// No room in the queue before the wire: busy for a moment, or dead; the age of the last echo tells which.
    #[error("no room in the bus queue")]
    Full,
    /// The link is down, or the controller took itself off the bus.
    #[error("the bus is down")]
    Down,
}

/// The sending half of a bus.
pub trait Transmit {
    /// Hands a frame to the wire, without waiting.
    ///
    /// # Errors
    /// [`SendError`]: the frame will not be sent.
    fn send(&mut self, frame: &CanFrame) -> Result<(), SendError>;
}

/// The receiving half of a bus.
pub trait Receive {
    /// The next frame, if one is there; echoes of own frames and error frames among them. Does not wait.
    fn receive(&mut self) -> Option<BusFrame>;
    /// How the wire is.
    fn health(&self) -> BusHealth;
    /// A descriptor that polls readable when a frame may be there.
    fn readable_fd(&self) -> RawFd;
    /// Frames that were lost before they could be received.
    fn lost(&self) -> u32 {
        0
    }
    /// What was said on the wire before this time can be received at `now`: earlier than `now` only where the other
    /// end is simulated and stalls with us.
    fn complete_until(&self, now: Stamp) -> Stamp {
        now
    }
}

/// A whole bus. `receive` and `send` come from its halves, so that a socket can be split between threads.
pub trait Bus: Transmit + Receive {}
impl<T: Transmit + Receive> Bus for T {}

/// Two halves as one bus.
#[derive(Debug)]
pub struct Duplex<T, R> {
    tx: T,
    rx: R,
}

impl<T, R> Duplex<T, R> {
    /// Its halves, for two threads.
    #[must_use]
    pub fn split(self) -> (T, R) {
        (self.tx, self.rx)
    }
}

impl<T: Transmit, R> Transmit for Duplex<T, R> {
    fn send(&mut self, frame: &CanFrame) -> Result<(), SendError> {
        self.tx.send(frame)
    }
}

impl<T, R: Receive> Receive for Duplex<T, R> {
    fn receive(&mut self) -> Option<BusFrame> {
        self.rx.receive()
    }
    fn health(&self) -> BusHealth {
        self.rx.health()
    }
    fn readable_fd(&self) -> RawFd {
        self.rx.readable_fd()
    }
    fn lost(&self) -> u32 {
        self.rx.lost()
    }
    fn complete_until(&self, now: Stamp) -> Stamp {
        self.rx.complete_until(now)
    }
}
