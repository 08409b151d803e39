//! Who lived until when, and how much of that time was spent listening. RT: yes, lock-free.
//!
//! A thread that was not given its core hears nothing, and nobody whom it should have heard is to blame. So whoever
//! brings input says until when he has listened ([`Pulse`]), and silence is counted in [`Listening`] time.

use super::time::{Span, Stamp};
use std::sync::atomic::{AtomicI64, Ordering};

/// A thread's own word until when it has done its work.
#[derive(Debug)]
pub struct Pulse(AtomicI64);

impl Default for Pulse {
    fn default() -> Self {
        Self(AtomicI64::new(Stamp::NEVER.0))
    }
}

impl Pulse {
    /// All work up to `until` is done, and what came of it is where others find it.
    pub fn beat(&self, until: Stamp) {
        self.0.store(until.0, Ordering::Release);
    }

    /// Until when it was done. Read this before what came of the work.
    #[must_use]
    pub fn last(&self) -> Stamp {
        Stamp(self.0.load(Ordering::Acquire))
    }
}

/// Time spent listening: it stands while the listener stands, and a stall counts as one period.
#[derive(Clone, Copy, Debug)]
pub struct Listening {
    period: Span,
    until: Stamp,
}

impl Listening {
    /// Of a listener who should look once in a period.
    #[must_use]
    pub const fn new(period: Span) -> Self {
        Self { period, until: Stamp::NEVER }
    }

    /// The listener has come as far as `until`: how long he has listened since the call before. Never negative; more
    /// than two periods at once are a stall.
    pub fn advance(&mut self, until: Stamp) -> Span {
        if until <= self.until {
            return Span::ZERO;
        }
        let passed = until.since(self.until);
        self.until = until;
        if passed.0 < self.period.0.saturating_mul(2) { passed } else { self.period }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stall_of_the_listener_counts_as_one_period() {
        let mut listening = Listening::new(Span(10));
        let spans = [0, 10, 21, 21, 15, 21, 300, 310, 329].map(|until| listening.advance(Stamp(until)).0);
        assert_eq!(spans, [10, 10, 11, 0, 0, 0, 10, 10, 19]);
    }

    #[test]
    fn who_never_listened_has_heard_nothing_for_no_time() {
        let mut listening = Listening::new(Span(10));
        assert_eq!(listening.advance(Pulse::default().last()), Span::ZERO);
    }
}
