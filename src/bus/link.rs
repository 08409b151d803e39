//! The few calls to the system that loopback and socket share. RT: yes, none of them waits.
#![expect(unsafe_code, reason = "eventfd and the monotonic clock have no safe wrapper in our dependencies")]

use crate::base::time::Stamp;
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd, RawFd};

/// CLOCK_MONOTONIC: links stamp frames that no kernel has stamped.
pub(super) fn monotonic_now() -> Stamp {
    Stamp(clock_ns(libc::CLOCK_MONOTONIC))
}

/// Present reading of a clock, ns.
pub(super) fn clock_ns(clock: libc::clockid_t) -> i64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `time` is a valid timespec for the call to fill; both clocks exist on every Linux.
    let result = unsafe { libc::clock_gettime(clock, &raw mut time) };
    if result == 0 { time.tv_sec * 1_000_000_000 + time.tv_nsec } else { 0 }
}

/// A counter in the kernel that polls readable while it is not zero.
#[derive(Debug)]
pub(super) struct Signal(OwnedFd);

impl Signal {
    /// A new one, at zero.
    pub(super) fn new() -> std::io::Result<Self> {
        // SAFETY: no pointers involved.
        let fd = unsafe { libc::eventfd(0, libc::EFD_NONBLOCK | libc::EFD_CLOEXEC) };
        if fd < 0 {
            return Err(std::io::Error::last_os_error());
        }
        // SAFETY: the descriptor is fresh and ours alone.
        Ok(Self(unsafe { OwnedFd::from_raw_fd(fd) }))
    }

    /// Makes it readable.
    pub(super) fn raise(&self) {
        let one = 1_u64;
        // SAFETY: eight readable bytes. It fails only when the counter is full, and then it is readable anyway.
        unsafe { libc::write(self.0.as_raw_fd(), (&raw const one).cast(), 8) };
    }

    /// Makes it unreadable.
    pub(super) fn lower(&self) {
        let mut count = 0_u64;
        // SAFETY: eight writable bytes. It fails only when the counter is zero already.
        unsafe { libc::read(self.0.as_raw_fd(), (&raw mut count).cast(), 8) };
    }

    /// The descriptor to poll.
    pub(super) fn fd(&self) -> RawFd {
        self.0.as_raw_fd()
    }
}
