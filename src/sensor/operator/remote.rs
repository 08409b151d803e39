//! A hand at the other end of a network: UDP with a secret that both ends know. RT: no; see [`super::aside`].
//!
//! | file | what |
//! |---|---|
//! | [`packet`] | the datagrams as pure functions on bytes |
//! | [`receiver`] | the robot's end: who holds the switch, what is new, how old it is |
//! | [`sender`] | the person's end |
//! | `link` | the socket and its thread |
//!
//! The person's end greets with a number of its own and is told one of the robot's; the key of their session is made of both and
//! the secret. Then it says 100 times a second how the switch is, and each of these states is sent twice, [`REPEAT_AFTER`]
//! apart. What is not authentic is counted and never answered.
//!
//! | danger | answer |
//! |---|---|
//! | a datagram changed or made up | HMAC-SHA256 over all of it, 128 bits |
//! | an old datagram sent again | numbers only rise within a session; a session's key holds for one session |
//! | a whole session sent again | the robot's number is used once, and only for [`receiver::WELCOME_HOLDS`] |
//! | datagrams held back and delivered later | a state is as old as the least delayed ones say; a press counts only while the round trip is known and short |
//! | two hands | one session; another only after a second of silence |
//! | loss | ten states and twenty datagrams fit into the 100 ms after which silence is a fault |

mod link;
pub mod packet;
pub mod receiver;
pub mod sender;

pub(super) use link::open;
pub use link::{chance, read_secret};

use crate::base::time::Span;
use std::sync::atomic::{AtomicU32, Ordering};

/// Between two states.
pub const STATE_EVERY: Span = Span::from_ms(10);
/// Between a state and its second sending: a burst of loss shorter than this takes one of the two.
pub const REPEAT_AFTER: Span = Span::from_ms(5);
/// Between two views of the robot.
pub const VIEW_EVERY: Span = Span::from_ms(100);

/// What was not taken, by reason, since start.
#[derive(Debug, Default)]
pub struct Refused {
    malformed: AtomicU32,
    not_authentic: AtomicU32,
    second_hand: AtomicU32,
    unwanted_stick: AtomicU32,
}

impl Refused {
    /// Datagrams of another making, datagrams that were not authentic, those of a second hand, and those of a stick that the
    /// robot does not want.
    #[must_use]
    pub fn counts(&self) -> [u32; 4] {
        [&self.malformed, &self.not_authentic, &self.second_hand, &self.unwanted_stick]
            .map(|count| count.load(Ordering::Relaxed))
    }
}

#[cfg(test)]
mod tests;
