//! Waits until a descriptor is readable, or until a time. RT: yes; it waits, so outside the tick only.
#![expect(unsafe_code, reason = "ppoll")]

use super::clock;
use super::clock::timespec;
use crate::base::time::Stamp;
use std::os::fd::RawFd;
use std::ptr;

/// Sleeps until one of the descriptors is readable (or broken) or the clock shows `until`. Negative ones are ignored.
pub fn readable<const N: usize>(fds: [RawFd; N], until: Stamp) {
    let left = until.since(clock::now());
    let timeout = timespec(Stamp(left.0));
    let mut polled = fds.map(|fd| libc::pollfd { fd, events: libc::POLLIN, revents: 0 });
    // SAFETY: `polled` holds N valid entries, `timeout` is a valid timespec, no signal mask is given.
    unsafe { libc::ppoll(polled.as_mut_ptr(), N as libc::nfds_t, &raw const timeout, ptr::null()) };
}
