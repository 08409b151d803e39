//! The operator's hand on the dead-man switch.
//!
//! A hand says how it is whenever it is asked, with the time at which it was last heard of. The reader judges the age:
//! silence is neither "held" nor "released". RT: [`Hand::poll`] never waits and does not allocate.

use crate::base::time::{Span, Stamp};
use crate::config::checked::{Config, Operator};
use crate::msg::{Mode, OperatorSample};
use std::fs;
use std::io;
use std::os::unix::net::UnixDatagram;
use std::path::Path;

/// Datagrams taken in one poll: more than fifty hands at 20 Hz send in a tick.
const MAX_DATAGRAMS: usize = 8;
/// A simulated person who sees that the robot did not arm lets go and tries again after this.
const TRY_AGAIN: Span = Span::from_ms(1_000);
/// So long the switch is open then.
const LET_GO: Span = Span::from_ms(200);

/// A dead-man switch.
#[derive(Debug)]
pub enum Hand {
    /// Nobody: a program presses by a plan.
    Simulated(SimulatedHand),
    /// Somebody at the other end of a socket.
    Socket(SocketHand),
}

impl Hand {
    /// The hand of this configuration.
    ///
    /// # Errors
    /// When the socket cannot be made.
    pub fn open(config: &Config) -> io::Result<Self> {
        Ok(match &config.robot.operator {
            Operator::Simulated => Self::Simulated(SimulatedHand::new(
                config.simulation.operator_press_s,
                config.simulation.operator_release_s,
            )),
            Operator::Socket(path) => Self::Socket(SocketHand::bind(Path::new(path))?),
        })
    }

    /// How the hand is at `now`; `mode` is what the operator sees of the robot.
    pub fn poll(&mut self, now: Stamp, mode: Mode) -> OperatorSample {
        match self {
            Self::Simulated(hand) => hand.poll(now, mode),
            Self::Socket(hand) => hand.poll(now),
        }
    }
}

/// Presses after a moment, holds until the release if there is one. As a person would, it tries again when the robot
/// did not arm; after a fault it lets the robot lie.
#[derive(Clone, Copy, Debug)]
pub struct SimulatedHand {
    press: Span,
    release: Option<Span>,
    start: Option<Stamp>,
    next_press: Stamp,
    sequence: u32,
}

impl SimulatedHand {
    /// Times in seconds after the first poll.
    #[must_use]
    pub fn new(press_s: f64, release_s: Option<f64>) -> Self {
        let release = release_s.map(Span::from_s);
        Self { press: Span::from_s(press_s), release, start: None, next_press: Stamp::NEVER, sequence: 0 }
    }

    /// How it is at `now`.
    pub fn poll(&mut self, now: Stamp, mode: Mode) -> OperatorSample {
        let start = *self.start.get_or_insert(now);
        if self.next_press == Stamp::NEVER {
            self.next_press = start + self.press;
        }
        let waiting = matches!(mode, Mode::Starting | Mode::Disarmed);
        if waiting && now.since(self.next_press) >= TRY_AGAIN {
            self.next_press = now + LET_GO;
        }
        let gone = self.release.is_some_and(|release| now.since(start) >= release);
        self.sequence = self.sequence.wrapping_add(1);
        OperatorSample { stamp: now, dead_man: now >= self.next_press && !gone, sequence: self.sequence }
    }
}

/// Listens on a UNIX datagram socket: byte 1 = held, byte 0 = released, anything else is nothing.
#[derive(Debug)]
pub struct SocketHand {
    socket: UnixDatagram,
    newest: OperatorSample,
}

impl SocketHand {
    /// Makes the socket; one that a dead process left behind is replaced.
    ///
    /// # Errors
    /// When the path cannot be bound.
    pub fn bind(path: &Path) -> io::Result<Self> {
        match fs::remove_file(path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        let socket = UnixDatagram::bind(path)?;
        socket.set_nonblocking(true)?;
        Ok(Self { socket, newest: OperatorSample { stamp: Stamp::NEVER, dead_man: false, sequence: 0 } })
    }

    fn poll(&mut self, now: Stamp) -> OperatorSample {
        for _ in 0..MAX_DATAGRAMS {
            let mut byte = [0xFF];
            match self.socket.recv(&mut byte) {
                Ok(1) if byte[0] <= 1 => self.hear(now, byte[0] == 1),
                Ok(_) => {}
                Err(_) => break,
            }
        }
        self.newest
    }

    fn hear(&mut self, now: Stamp, dead_man: bool) {
        self.newest = OperatorSample { stamp: now, dead_man, sequence: self.newest.sequence.wrapping_add(1) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: i64) -> Stamp {
        Stamp(5_000_000_000) + Span::from_ms(ms)
    }

    #[test]
    fn the_simulated_hand_presses_holds_and_releases() {
        let mut hand = SimulatedHand::new(0.5, Some(2.0));
        let held: Vec<i64> = (0..3_000).filter(|ms| hand.poll(at(*ms), Mode::Armed).dead_man).collect();
        assert_eq!((held.first(), held.last()), (Some(&500), Some(&1_999)));
    }

    #[test]
    fn the_simulated_hand_tries_again_when_the_robot_does_not_arm() {
        let mut hand = SimulatedHand::new(0.5, None);
        let held: Vec<bool> = (0..3_000).map(|ms| hand.poll(at(ms), Mode::Disarmed).dead_man).collect();
        let presses = held.windows(2).filter(|pair| pair[1] && !pair[0]).count();
        assert_eq!(presses, 3, "at 500, 1700 and 2900 ms");
    }

    #[test]
    fn after_a_fault_the_simulated_hand_does_not_press_again() {
        let mut hand = SimulatedHand::new(0.0, None);
        assert!((0..3_000).all(|ms| hand.poll(at(ms), Mode::Faulted).dead_man));
    }

    #[test]
    fn the_socket_hears_the_newest_byte_and_keeps_its_time() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hand");
        drop(SocketHand::bind(&path).unwrap());
        let mut hand = SocketHand::bind(&path).unwrap();
        assert_eq!(hand.poll(at(0)).stamp, Stamp::NEVER);
        let sender = UnixDatagram::unbound().unwrap();
        for bytes in [&[0][..], &[1], &[7], &[]] {
            sender.send_to(bytes, &path).unwrap();
        }
        let first = hand.poll(at(1));
        assert_eq!(first, OperatorSample { stamp: at(1), dead_man: true, sequence: 2 });
        assert_eq!(hand.poll(at(90)), first, "silence changes nothing but the age");
    }
}
