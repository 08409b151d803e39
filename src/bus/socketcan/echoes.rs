//! Frames that are out, and their echoes. RT: yes, lock-free.

use crate::base::time::{Span, Stamp};
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};

/// Counts frames and echoes; never more echoes than frames, whatever was dropped or comes late.
#[derive(Debug, Default)]
pub(super) struct Echoes {
    sent: AtomicU64,
    echoed: AtomicU64,
    /// Since when the oldest frame without echo waits, ns.
    waiting_since: AtomicI64,
}

impl Echoes {
    /// A frame is about to go: before it is written, because its echo may be read before `write` returns.
    pub(super) fn note_sent(&self, now: Stamp) {
        if self.echoed.load(Ordering::Acquire) >= self.sent.load(Ordering::Acquire) {
            self.waiting_since.store(now.0, Ordering::Relaxed);
        }
        self.sent.fetch_add(1, Ordering::AcqRel);
    }

    /// The frame was not taken.
    pub(super) fn take_back(&self) {
        self.sent.fetch_sub(1, Ordering::AcqRel);
    }

    /// An echo. One that comes after [`Self::forget`] belongs to no frame that is still counted: without the bound it
    /// would stand for a later one, and a stall would be seen late for ever.
    pub(super) fn note_echo(&self, now: Stamp) {
        self.waiting_since.store(now.0, Ordering::Relaxed);
        let sent = self.sent.load(Ordering::Acquire);
        let more = |echoed: u64| (echoed < sent).then_some(echoed + 1);
        // Refused: nothing is out.
        self.echoed.fetch_update(Ordering::AcqRel, Ordering::Acquire, more).ok();
    }

    /// Frames that are out will not be echoed: the queue was emptied, or the echoes were dropped.
    pub(super) fn forget(&self) {
        self.echoed.store(self.sent.load(Ordering::Acquire), Ordering::Release);
    }

    /// Something is out, and nothing has come back for longer than `limit`.
    pub(super) fn are_overdue(&self, now: Stamp, limit: Span) -> bool {
        let waits = self.echoed.load(Ordering::Acquire) < self.sent.load(Ordering::Acquire);
        waits && now.0 - self.waiting_since.load(Ordering::Relaxed) > limit.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: Span = Span::from_ms(20);

    fn at(ms: i64) -> Stamp {
        Stamp(ms * 1_000_000)
    }

    #[test]
    fn echoes_that_come_after_a_drop_do_not_hide_a_later_stall() {
        let echoes = Echoes::default();
        (0..10).for_each(|_| echoes.note_sent(at(0)));
        // The kernel tells that it dropped something: which echoes are lost is not known. Seven still wait to be read.
        echoes.forget();
        (0..7).for_each(|_| echoes.note_echo(at(1)));
        echoes.note_sent(at(2));
        assert!(!echoes.are_overdue(at(22), LIMIT));
        assert!(echoes.are_overdue(at(23), LIMIT), "the frame of 2 ms never came back");
        echoes.note_echo(at(24));
        assert!(!echoes.are_overdue(at(100), LIMIT));
    }

    #[test]
    fn a_frame_that_was_not_taken_is_not_waited_for() {
        let echoes = Echoes::default();
        echoes.note_sent(at(0));
        echoes.take_back();
        assert!(!echoes.are_overdue(at(100), LIMIT));
    }
}
