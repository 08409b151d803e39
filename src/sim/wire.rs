//! The wire of one bus: one frame at a time, each as long as its bits, the lowest identifier first.
//!
//! Every sender has a queue of its own and sends in order; whoever has the lowest identifier at the head of a queue
//! when the wire falls free wins (arbitration). An overloaded bus therefore shows as it does on the robot: delays grow,
//! then queues refuse. RT: no.

use crate::base::can_time::BitRates;
use crate::base::time::{Span, Stamp};
use crate::bus::frame::exact_time_ns;
use crate::msg::CanFrame;
use std::collections::VecDeque;

/// Frames that a sender's queue holds (a controller's mailboxes with the kernel's queue of ten behind them).
const QUEUE: usize = 64;

/// A frame that has left the wire.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Delivered {
    /// When it was queued.
    pub queued: Stamp,
    /// End of the frame.
    pub at: Stamp,
    /// Who sent it.
    pub sender: usize,
    /// The frame.
    pub frame: CanFrame,
}

/// A wire with its senders' queues.
#[derive(Clone, Debug)]
pub struct Wire {
    rates: BitRates,
    timed: bool,
    queues: Vec<VecDeque<(Stamp, CanFrame)>>,
    /// Frames in all queues.
    waiting: usize,
    /// The frame on the wire.
    current: Option<Delivered>,
    free_since: Stamp,
    silent: bool,
    busy: Span,
    refused: u32,
}

impl Wire {
    /// A wire with so many senders. Untimed, a frame takes a nanosecond.
    #[must_use]
    pub fn new(rates: BitRates, timed: bool, senders: usize) -> Self {
        Self {
            rates,
            timed,
            queues: vec![VecDeque::new(); senders],
            waiting: 0,
            current: None,
            free_since: Stamp::default(),
            silent: false,
            busy: Span::ZERO,
            refused: 0,
        }
    }

    /// Queues a frame. False if the sender's queue is full.
    pub fn put(&mut self, now: Stamp, sender: usize, frame: CanFrame) -> bool {
        match self.queues.get_mut(sender) {
            Some(queue) if queue.len() < QUEUE => {
                queue.push_back((now, frame));
                self.waiting += 1;
                true
            }
            _ => {
                self.refused += 1;
                false
            }
        }
    }

    /// When the next frame will have left, if nothing else is queued before.
    #[must_use]
    pub fn next_end(&mut self) -> Option<Stamp> {
        self.start();
        self.current.map(|d| d.at)
    }

    /// The next frame that has left the wire by `until`.
    pub fn take(&mut self, until: Stamp) -> Option<Delivered> {
        self.start();
        let done = self.current.take_if(|d| d.at <= until)?;
        self.free_since = done.at;
        Some(done)
    }

    /// Nobody acknowledges (drives without power): frames stay where they are until it is over.
    pub fn set_silent(&mut self, now: Stamp, silent: bool) {
        self.silent = silent;
        self.free_since = self.free_since.max(now);
        if let Some(broken) = self.current.take() {
            // Repeated from the start when somebody listens again.
            if let Some(queue) = self.queues.get_mut(broken.sender) {
                queue.push_front((broken.queued, broken.frame));
                self.waiting += 1;
            }
        }
    }

    /// A sender forgets what it has queued (link down and up, or a device that restarts).
    pub fn flush(&mut self, sender: usize) {
        if let Some(queue) = self.queues.get_mut(sender) {
            self.waiting -= queue.len();
            queue.clear();
        }
    }

    /// Frames that a sender has waiting.
    #[must_use]
    pub fn waiting_of(&self, sender: usize) -> usize {
        self.queues.get(sender).map_or(0, VecDeque::len)
    }

    /// Time that the wire was busy since the start.
    #[must_use]
    pub const fn busy(&self) -> Span {
        self.busy
    }

    /// Frames refused by full queues.
    #[must_use]
    pub const fn refused(&self) -> u32 {
        self.refused
    }

    /// Puts the winner of the arbitration on a free wire.
    fn start(&mut self) {
        if self.silent || self.waiting == 0 || self.current.is_some() {
            return;
        }
        let Some(earliest) = self.queues.iter().filter_map(|q| q.front()).map(|(at, _)| *at).min() else { return };
        let start = earliest.max(self.free_since);
        let waiting = self.queues.iter().enumerate().filter_map(|(s, q)| q.front().map(|(at, f)| (s, *at, f)));
        let Some((sender, ..)) = waiting.filter(|(_, at, _)| *at <= start).min_by_key(|(_, _, f)| arbitration(f))
        else {
            return;
        };
        if let Some((queued, frame)) = self.queues[sender].pop_front() {
            self.waiting -= 1;
            let took = Span(if self.timed { exact_time_ns(&frame, self.rates) } else { 1 });
            self.busy = Span(self.busy.0 + took.0);
            self.current = Some(Delivered { queued, at: start + took, sender, frame });
        }
    }
}

/// Lowest wins. An 11-bit identifier is compared with the first 11 of 29 and wins against its equal.
const fn arbitration(frame: &CanFrame) -> u32 {
    if frame.id & CanFrame::EXTENDED == 0 { (frame.id & 0x7FF) << 19 } else { (frame.id & 0x1FFF_FFFF) << 1 | 1 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::frame::worst_bits;

    const RATES: BitRates = BitRates { nominal: 1_000_000, data: None };

    fn all(wire: &mut Wire) -> Vec<Delivered> {
        std::iter::from_fn(|| wire.take(Stamp(i64::MAX))).collect()
    }

    #[test]
    fn lowest_identifier_wins_but_a_sender_keeps_its_order() {
        let mut wire = Wire::new(RATES, true, 2);
        for (sender, id) in [(0, 0x300), (0, 0x100), (1, 0x200)] {
            assert!(wire.put(Stamp(0), sender, CanFrame::new(id, &[])));
        }
        assert_eq!(all(&mut wire).iter().map(|d| d.frame.id).collect::<Vec<_>>(), [0x200, 0x300, 0x100]);
    }

    #[test]
    fn a_frame_that_comes_later_does_not_stop_the_one_on_the_wire() {
        let mut wire = Wire::new(RATES, true, 2);
        wire.put(Stamp(0), 0, CanFrame::new(0x7FF, &[0; 8]));
        assert_eq!(wire.take(Stamp(1_000)), None);
        wire.put(Stamp(1_000), 1, CanFrame::new(0x001, &[]));
        assert_eq!(all(&mut wire).iter().map(|d| d.frame.id).collect::<Vec<_>>(), [0x7FF, 0x001]);
    }

    #[test]
    fn frames_follow_one_another_without_overlap() {
        let mut wire = Wire::new(RATES, true, 1);
        for k in 0..10 {
            wire.put(Stamp(0), 0, CanFrame::new(0x200, &[k; 8]));
        }
        let ends: Vec<i64> = all(&mut wire).iter().map(|d| d.at.0).collect();
        assert!(ends.windows(2).all(|w| w[1] - w[0] >= 111_000 && w[1] - w[0] <= 135_000), "{ends:?}");
        assert_eq!(wire.busy().0, *ends.last().unwrap());
    }

    #[test]
    fn an_overloaded_bus_grows_late_and_then_refuses() {
        let mut wire = Wire::new(RATES, true, 1);
        let mut delays = Vec::new();
        for ms in 0..200_i64 {
            for k in 0..10 {
                // 0x55 has no run of five: no stuffing, 1110 us per ms.
                wire.put(Stamp(ms * 1_000_000), 0, CanFrame::new(0x200 + k, &[0x55; 8]));
            }
            while let Some(d) = wire.take(Stamp((ms + 1) * 1_000_000)) {
                delays.push(d.at.0 - ms * 1_000_000);
            }
        }
        assert!(wire.refused() > 0);
        assert!(delays.len() < 200 * 1000 / usize::from(u8::try_from(worst_bits(8, false) - 28).unwrap()));
    }

    #[test]
    fn on_a_silent_wire_nothing_leaves_and_all_leaves_afterwards() {
        let mut wire = Wire::new(RATES, true, 1);
        wire.put(Stamp(0), 0, CanFrame::new(0x201, &[1]));
        assert!(wire.next_end().is_some());
        wire.set_silent(Stamp(10), true);
        wire.put(Stamp(20), 0, CanFrame::new(0x080, &[]));
        assert!(all(&mut wire).is_empty());
        wire.set_silent(Stamp(5_000_000), false);
        let ids: Vec<u32> = all(&mut wire).iter().map(|d| d.frame.id).collect();
        assert_eq!(ids, [0x201, 0x080]);
    }
}
