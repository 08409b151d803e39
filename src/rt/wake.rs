//! One futex that wakes the control thread when its input is complete: one system call for each side. RT: yes.
//!
//! Not an iceoryx2 event: those were seen to spin and to lose wake-ups.
#![expect(unsafe_code, reason = "futex")]

use super::clock::timespec;
use crate::base::time::Stamp;
use std::ptr;
use std::sync::atomic::{AtomicU32, Ordering};

/// Counts rings; a waiter sleeps as long as the count is the one it last saw.
#[derive(Debug, Default)]
pub struct Bell(AtomicU32);

impl Bell {
    /// Wakes whoever waits.
    pub fn ring(&self) {
        self.0.fetch_add(1, Ordering::Release);
        // SAFETY: the address is that of a live, aligned u32; FUTEX_WAKE reads no other argument.
        unsafe { libc::syscall(libc::SYS_futex, self.0.as_ptr(), libc::FUTEX_WAKE | libc::FUTEX_PRIVATE_FLAG, 1) };
    }

    /// Rings so far.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.0.load(Ordering::Acquire)
    }

    /// Sleeps until the count is no longer `seen` or the clock shows `until`. False when time was up.
    pub fn wait(&self, seen: u32, until: Stamp) -> bool {
        let at = timespec(until);
        let operation = libc::FUTEX_WAIT_BITSET | libc::FUTEX_PRIVATE_FLAG;
        while self.count() == seen {
            // SAFETY: the address is that of a live, aligned u32, `at` a valid timespec; WAIT_BITSET takes it as absolute
            // CLOCK_MONOTONIC and does not use the second address.
            let result = unsafe {
                libc::syscall(
                    libc::SYS_futex,
                    self.0.as_ptr(),
                    operation,
                    seen,
                    &raw const at,
                    ptr::null::<u32>(),
                    libc::FUTEX_BITSET_MATCH_ANY,
                )
            };
            if result != 0 && last_error() == libc::ETIMEDOUT {
                return self.count() != seen;
            }
        }
        true
    }
}

fn last_error() -> i32 {
    std::io::Error::last_os_error().raw_os_error().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::time::Span;
    use crate::rt::clock;
    use std::sync::Arc;

    #[test]
    fn a_ring_before_the_wait_is_not_lost() {
        let bell = Bell::default();
        let seen = bell.count();
        bell.ring();
        assert!(bell.wait(seen, Stamp(i64::MAX)));
    }

    #[test]
    fn time_is_up_without_a_ring() {
        let bell = Bell::default();
        let until = clock::now() + Span::from_ms(3);
        assert!(!bell.wait(bell.count(), until));
        assert!(clock::now() >= until);
    }

    #[test]
    fn a_ring_from_another_thread_wakes() {
        let bell = Arc::new(Bell::default());
        let seen = bell.count();
        let ringer = bell.clone();
        let thread = std::thread::spawn(move || ringer.ring());
        assert!(bell.wait(seen, Stamp(i64::MAX)));
        thread.join().unwrap();
    }
}
