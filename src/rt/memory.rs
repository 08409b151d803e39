//! Memory that is there before it is needed: locked, touched, never given back. RT: before arming only.
#![expect(unsafe_code, reason = "system calls")]

use std::hint::black_box;
use std::mem::MaybeUninit;

/// A piece of stack that is touched at a time.
const PIECE: usize = 16 * 1024;
/// Left for the thread's start.
const MARGIN: usize = 64 * 1024;
/// Left for what each piece takes beside its bytes, as a share of the stack: a sixteenth of a piece is 1 kB.
const OVERHEAD: usize = 16;

/// Locks all pages, present and future, and keeps the allocator from returning any. False: not granted
/// (RLIMIT_MEMLOCK or CAP_IPC_LOCK).
#[must_use]
pub fn lock() -> bool {
    // SAFETY: no pointers; both calls only change this process's own settings.
    unsafe {
        libc::mallopt(libc::M_TRIM_THRESHOLD, -1);
        libc::mallopt(libc::M_MMAP_MAX, 0);
        libc::mlockall(libc::MCL_CURRENT | libc::MCL_FUTURE) == 0
    }
}

/// Touches this thread's stack, but for a margin, so that no page of it is missing later. Of it counts what is left: the control
/// thread's own frame, with all that is moved into it, took more than the margin once, and it overflowed at its start.
pub fn touch_stack(stack_bytes: usize) {
    let bytes = left_of_this_stack().map_or(stack_bytes, |left| left.min(stack_bytes));
    touch(bytes.saturating_sub(MARGIN + bytes / OVERHEAD) / PIECE);
}

/// From here to the end of this thread's stack.
fn left_of_this_stack() -> Option<usize> {
    let mut attributes = MaybeUninit::<libc::pthread_attr_t>::zeroed();
    let (mut lowest, mut size) = (std::ptr::null_mut(), 0);
    // SAFETY: the library fills the attributes of this very thread, which are read only then and given back.
    unsafe {
        if libc::pthread_getattr_np(libc::pthread_self(), attributes.as_mut_ptr()) != 0 {
            return None;
        }
        let read = libc::pthread_attr_getstack(attributes.as_ptr(), &raw mut lowest, &raw mut size);
        libc::pthread_attr_destroy(attributes.as_mut_ptr());
        if read != 0 {
            return None;
        }
    }
    let here = 0_u8;
    Some((&raw const here).addr().saturating_sub(lowest.addr()))
}

#[inline(never)]
fn touch(pieces: usize) {
    let mut piece = [0_u8; PIECE];
    black_box(&mut piece);
    if pieces > 1 {
        touch(pieces - 1);
    }
    black_box(&mut piece);
}

/// Minor and major page faults of this thread so far.
#[must_use]
pub fn faults_of_this_thread() -> u64 {
    let mut usage = MaybeUninit::<libc::rusage>::zeroed();
    // SAFETY: the kernel fills one rusage; all-zero is a valid one should it refuse.
    let usage = unsafe {
        libc::getrusage(libc::RUSAGE_THREAD, usage.as_mut_ptr());
        usage.assume_init()
    };
    u64::try_from(usage.ru_minflt + usage.ru_majflt).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 32 MiB overflowed once: the margin was the same for every size.
    #[test]
    fn stacks_of_any_size_can_be_touched() {
        for stack_bytes in [64 * 1024, 512 * 1024, 32 << 20, 64 << 20] {
            let thread = std::thread::Builder::new().stack_size(stack_bytes.max(256 * 1024));
            thread.spawn(move || touch_stack(stack_bytes)).unwrap().join().unwrap();
        }
    }

    /// It ended the process.
    #[test]
    fn what_is_used_already_is_not_touched_beyond_the_end() {
        let frame = || {
            let mut used = [0_u8; 200 * 1024];
            black_box(&mut used);
            touch_stack(512 * 1024);
            black_box(&mut used);
        };
        std::thread::Builder::new().stack_size(512 * 1024).spawn(frame).unwrap().join().unwrap();
    }
}
