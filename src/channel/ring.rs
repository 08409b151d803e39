//! From one thread to another in this process: a bounded ring that neither waits nor allocates.
//!
//! The real-time threads use this among themselves, not [`super::port`]: iceoryx2 0.10 allocates for each message it
//! loans (counted: 16 calls per tick of the default robot). The relay publishes everything there, beside the loop.
//! RT: yes; [`Ring::new`] before arming only.

use crossbeam::queue::ArrayQueue;
use std::sync::atomic::{AtomicU64, Ordering};

/// Messages on their way.
#[derive(Debug)]
pub struct Ring<T> {
    queue: ArrayQueue<T>,
    lost: AtomicU64,
}

impl<T: Copy + Default> Ring<T> {
    /// Room for so many. Every slot is written once, so that its memory is there when the loop comes to it.
    #[must_use]
    pub fn new(capacity: usize) -> Self {
        let queue = ArrayQueue::new(capacity);
        while queue.push(T::default()).is_ok() {}
        while queue.pop().is_some() {}
        Self { queue, lost: AtomicU64::new(0) }
    }

    /// Hands over, or counts as lost when there is no room.
    pub fn push(&self, message: &T) {
        if self.queue.push(*message).is_err() {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// The oldest that waits.
    pub fn pop(&self) -> Option<T> {
        self.queue.pop()
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

    #[test]
    fn what_has_no_room_is_counted_and_the_rest_keeps_its_order() {
        let ring = Ring::new(3);
        (0..5).for_each(|i| ring.push(&i));
        assert_eq!(std::iter::from_fn(|| ring.pop()).collect::<Vec<i32>>(), [0, 1, 2]);
        assert_eq!(ring.lost(), 2);
    }
}
