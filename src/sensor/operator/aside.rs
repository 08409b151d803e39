//! A hand that a thread of its own looks after: the control thread only takes the newest of what it found. RT:
//! [`AsideHand::poll`] yes; the thread is an ordinary one, and if it is held up the hand grows old, which is the safe side.
#![expect(unsafe_code, reason = "the monotonic clock")]

use crate::base::time::{Span, Stamp};
use crate::channel::ring::Ring;
use crate::msg::{OperatorSample, Status};
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Samples that wait at most: far more than come in a tick.
const WAITING: usize = 32;
/// The thread learns so often how the robot is.
const TELL_EVERY: Span = Span::from_ms(50);
/// Enough for any of these threads; all memory is locked.
const STACK_BYTES: usize = 256 * 1024;

/// What the thread works with.
#[derive(Debug)]
pub(super) struct Desk {
    samples: Arc<Ring<OperatorSample>>,
    robot: Arc<Ring<Status>>,
    over: Arc<AtomicBool>,
}

impl Desk {
    /// Hands a sample to the control thread.
    pub(super) fn put(&self, sample: &OperatorSample) {
        self.samples.push_newest(sample);
    }

    /// How the robot is, if there is news.
    pub(super) fn robot(&self) -> Option<Status> {
        (0..WAITING).map_while(|_| self.robot.pop()).last()
    }

    /// True when nobody needs the thread any more.
    pub(super) fn is_over(&self) -> bool {
        self.over.load(Ordering::Acquire)
    }
}

/// The control thread's end.
#[derive(Debug)]
pub struct AsideHand {
    samples: Arc<Ring<OperatorSample>>,
    robot: Arc<Ring<Status>>,
    over: Arc<AtomicBool>,
    newest: OperatorSample,
    next_tell: Stamp,
}

impl AsideHand {
    /// Starts the thread, which ends with the hand: `body` must come back soon after its desk is over.
    pub(super) fn start(body: impl FnOnce(&Desk) + Send + 'static) -> io::Result<Self> {
        let (samples, robot, over) = (Arc::new(Ring::new(WAITING)), Arc::new(Ring::new(4)), Arc::default());
        let desk = Desk { samples: Arc::clone(&samples), robot: Arc::clone(&robot), over: Arc::clone(&over) };
        let builder = std::thread::Builder::new().name("operator".into()).stack_size(STACK_BYTES);
        builder.spawn(move || body(&desk))?;
        let newest = OperatorSample { stamp: Stamp::NEVER, ..OperatorSample::default() };
        Ok(Self { samples, robot, over, newest, next_tell: Stamp::NEVER })
    }

    /// How the hand is; `seen` is what the operator sees of the robot.
    pub fn poll(&mut self, now: Stamp, seen: &Status) -> OperatorSample {
        for _ in 0..WAITING {
            let Some(sample) = self.samples.pop() else { break };
            self.newest = sample;
        }
        if now >= self.next_tell {
            self.robot.push_newest(seen);
            self.next_tell = now + TELL_EVERY;
        }
        self.newest
    }
}

impl Drop for AsideHand {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Release);
    }
}

/// The present instant on the clock of the ticks.
pub(super) fn now() -> Stamp {
    let mut at = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: writes one timespec. It cannot fail: the clock exists on every Linux.
    unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &raw mut at) };
    Stamp(at.tv_sec * 1_000_000_000 + at.tv_nsec)
}

/// Sleeps until then.
#[expect(clippy::disallowed_methods, reason = "in an ordinary thread")]
pub(super) fn sleep_until(at: Stamp) {
    let ns = u64::try_from(at.since(now()).0).unwrap_or(0);
    std::thread::sleep(std::time::Duration::from_nanos(ns));
}
