//! CLOCK_MONOTONIC: read it, sleep until. RT: yes.
#![expect(unsafe_code, reason = "system calls")]

use crate::base::time::{Clock, Stamp};
use std::ptr;

const NS_PER_S: i64 = 1_000_000_000;

/// A clock that one can sleep on.
pub trait Timer: Clock {
    /// Returns at `until` or soon after; at once if that is past.
    fn sleep_until(&mut self, until: Stamp);
}

/// The system's monotonic clock.
#[derive(Clone, Copy, Debug, Default)]
pub struct Monotonic;

impl Clock for Monotonic {
    fn now(&mut self) -> Stamp {
        now()
    }
}

impl Timer for Monotonic {
    fn sleep_until(&mut self, until: Stamp) {
        let at = timespec(until);
        // SAFETY: `at` is a valid timespec, the remainder is not asked for.
        while unsafe {
            libc::clock_nanosleep(libc::CLOCK_MONOTONIC, libc::TIMER_ABSTIME, &raw const at, ptr::null_mut())
        } == libc::EINTR
        {}
    }
}

/// The present instant.
#[must_use]
pub fn now() -> Stamp {
    let mut at = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: writes one timespec. It cannot fail: the clock exists on every Linux.
    unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &raw mut at) };
    Stamp(at.tv_sec * NS_PER_S + at.tv_nsec)
}

/// The kernel's form of an instant; the clock's zero for what lies before it.
pub(super) fn timespec(at: Stamp) -> libc::timespec {
    let ns = at.0.max(0);
    libc::timespec { tv_sec: ns / NS_PER_S, tv_nsec: ns % NS_PER_S }
}
