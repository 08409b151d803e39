//! From one thread to another in this process: a bounded ring that neither waits nor allocates.
//!
//! The real-time threads use this among themselves, not [`super::port`]: iceoryx2 0.10 allocates for each message it
//! loans (counted: 16 calls per tick of the default robot). The relay publishes everything there, beside the loop.
//!
//! It is Vyukov's bounded queue: each slot says by a number whose turn it is. A thread that is preempted between taking a
//! slot and filling it makes the ring look empty (or full) to the others for that time, and nobody spins for it. The
//! queue of crossbeam does: a consumer of higher priority on the same core then spins for ever (seen: two threads pinned to
//! one core, robot and controller standing still).
//! RT: yes; [`Ring::new`] before arming only.
#![expect(unsafe_code, reason = "slots are shared between threads, whose turn it is is told by their number")]

use std::cell::UnsafeCell;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

/// A place for one message.
#[derive(Debug)]
struct Slot<T> {
    /// `n`: free for push number `n`. `n + 1`: holds the message of push number `n`.
    turn: AtomicUsize,
    message: UnsafeCell<T>,
}

/// Counters that two threads write lie in cache lines of their own.
#[derive(Debug, Default)]
#[repr(align(128))]
struct Apart(AtomicUsize);

/// Messages on their way.
#[derive(Debug)]
pub struct Ring<T> {
    slots: Box<[Slot<T>]>,
    pushed: Apart,
    popped: Apart,
    lost: AtomicU64,
}

// SAFETY: a message is written by whom the slot's turn admits to push, and read by whom it admits to pop; the turn is
// passed on by release and acquire, so never two threads touch one message at a time.
unsafe impl<T: Send> Sync for Ring<T> {}

impl<T: Copy + Default> Ring<T> {
    /// Room for so many, rounded up to a power of two. Every slot is written once, so that its memory is there when the
    /// loop comes to it.
    #[must_use]
    pub fn new(capacity: usize) -> Self {
        // With one slot alone "filled by push 0" and "free for push 1" would be the same number.
        let room = capacity.max(2).next_power_of_two();
        let slot = |i| Slot { turn: AtomicUsize::new(i), message: UnsafeCell::new(T::default()) };
        let slots = (0..room).map(slot).collect();
        Self { slots, pushed: Apart::default(), popped: Apart::default(), lost: AtomicU64::new(0) }
    }

    /// Hands over, or counts as lost when there is no room. True if it was handed over.
    pub fn push(&self, message: &T) -> bool {
        let Some((slot, number)) = self.claim(&self.pushed, 0) else {
            self.lost.fetch_add(1, Ordering::Relaxed);
            return false;
        };
        // SAFETY: this push alone was given the slot, and nobody reads it before its turn is passed on.
        unsafe { *slot.message.get() = *message };
        slot.turn.store(number.wrapping_add(1), Ordering::Release);
        true
    }

    /// Hands over; when there is no room the oldest that waits is thrown away for it, and counted as lost. For a ring
    /// whose reader may stall: what is newest is worth more then.
    pub fn push_newest(&self, message: &T) {
        // Each round makes room for one; others at the same end may take it.
        for _ in 0..4 {
            if let Some((slot, number)) = self.claim(&self.pushed, 0) {
                // SAFETY: as in `push`.
                unsafe { *slot.message.get() = *message };
                slot.turn.store(number.wrapping_add(1), Ordering::Release);
                return;
            }
            if self.pop().is_some() {
                self.lost.fetch_add(1, Ordering::Relaxed);
            }
        }
        self.lost.fetch_add(1, Ordering::Relaxed);
    }

    /// Messages that wait: at least so many, if nobody else takes any.
    pub fn waiting(&self) -> usize {
        let (pushed, popped) = (self.pushed.0.load(Ordering::Relaxed), self.popped.0.load(Ordering::Relaxed));
        pushed.wrapping_sub(popped).min(self.slots.len())
    }

    /// The oldest that waits.
    pub fn pop(&self) -> Option<T> {
        let (slot, number) = self.claim(&self.popped, 1)?;
        // SAFETY: this pop alone was given the slot, and nobody writes it before its turn is passed on.
        let message = unsafe { *slot.message.get() };
        slot.turn.store(number.wrapping_add(self.slots.len()), Ordering::Release);
        Some(message)
    }

    /// The next slot by `counter`, if it is ready for push (`ahead` 0) or pop (1). Goes round again only if another
    /// thread at the same end got ahead.
    fn claim(&self, counter: &Apart, ahead: usize) -> Option<(&Slot<T>, usize)> {
        let mut number = counter.0.load(Ordering::Relaxed);
        loop {
            let slot = self.slots.get(number & (self.slots.len() - 1))?;
            let turn = slot.turn.load(Ordering::Acquire);
            match turn.wrapping_sub(number.wrapping_add(ahead)).cast_signed() {
                0 => match counter.0.compare_exchange_weak(
                    number,
                    number.wrapping_add(1),
                    Ordering::Relaxed,
                    Ordering::Relaxed,
                ) {
                    Ok(_) => return Some((slot, number)),
                    Err(now) => number = now,
                },
                behind if behind < 0 => return None,
                _ => number = counter.0.load(Ordering::Relaxed),
            }
        }
    }

    /// Messages lost for want of room.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::thread;

    fn drained(ring: &Ring<u64>) -> Vec<u64> {
        std::iter::from_fn(|| ring.pop()).collect()
    }

    #[test]
    fn what_has_no_room_is_counted_and_the_rest_keeps_its_order() {
        let ring = Ring::new(4);
        (0..6).for_each(|i| assert_eq!(ring.push(&i), i < 4));
        assert_eq!((drained(&ring), ring.lost()), (vec![0, 1, 2, 3], 2));
        (6..9).for_each(|i| assert!(ring.push(&i)));
        assert_eq!(drained(&ring), [6, 7, 8], "also when it goes round");
    }

    /// A thread that is preempted with a slot in its hand holds nobody up: crossbeam's queue would spin here for ever.
    #[test]
    fn who_is_preempted_in_the_middle_holds_nobody_up() {
        let ring = Ring::new(2);
        let (slot, number) = ring.claim(&ring.pushed, 0).unwrap();
        assert!(ring.push(&2));
        assert_eq!(ring.pop(), None, "the first is not there yet");
        slot.turn.store(number + 1, Ordering::Release);
        assert_eq!(drained(&ring), [0, 2]);
        assert!(ring.push(&3) && ring.push(&4));
        let (slot, number) = ring.claim(&ring.popped, 1).unwrap();
        assert!(!ring.push(&5), "the slot that would be next is still being read");
        slot.turn.store(number + 2, Ordering::Release);
        assert!(ring.push(&5));
        assert_eq!(drained(&ring), [4, 5]);
    }

    #[test]
    fn two_threads_push_and_one_pops_and_nothing_is_lost_or_torn() {
        const EACH: u64 = 100_000;
        let ring: Ring<[u64; 8]> = Ring::new(64);
        let mut next = [0; 2];
        thread::scope(|scope| {
            for who in 0..2 {
                let ring = &ring;
                scope.spawn(move || {
                    for i in 0..EACH {
                        while !ring.push(&[2 * i + who; 8]) {
                            thread::yield_now();
                        }
                    }
                });
            }
            while next != [EACH; 2] {
                let Some(message) = ring.pop() else {
                    thread::yield_now();
                    continue;
                };
                assert!(message.iter().all(|x| *x == message[0]), "torn: {message:?}");
                let who = usize::from(message[0] % 2 == 1);
                assert_eq!(message[0] / 2, next[who], "in the order of each");
                next[who] += 1;
            }
        });
    }

    #[test]
    fn of_a_ring_that_overflows_the_newest_are_left() {
        let ring = Ring::new(4);
        (0..10).for_each(|n| ring.push_newest(&n));
        assert_eq!((ring.waiting(), ring.lost()), (4, 6));
        assert_eq!(drained(&ring), [6, 7, 8, 9]);
        assert_eq!(ring.waiting(), 0);
    }
}
