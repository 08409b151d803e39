//! What others may know of the running loop, and what its threads allocated. RT: yes.

use crate::msg::{Mode, TickRecord};
use crate::rt::{allocation, memory};
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};

/// What others may know while the loop runs.
#[derive(Debug, Default)]
pub struct Progress {
    /// Ticks done; the watchdog is fed only while this moves.
    pub ticks: AtomicU64,
    /// Frames that a wire refused.
    pub refused_frames: AtomicU64,
    mode: AtomicU8,
    pub(super) was_armed: AtomicBool,
    pub(super) allocations: AtomicU64,
    pub(super) page_faults: AtomicU64,
    pub(super) ended: AtomicBool,
}

impl Progress {
    /// Mode after the last tick.
    #[must_use]
    pub fn mode(&self) -> Mode {
        Mode::from_u8(self.mode.load(Ordering::Relaxed)).unwrap_or_default()
    }

    /// The loop has ended.
    #[must_use]
    pub fn has_ended(&self) -> bool {
        self.ended.load(Ordering::Acquire)
    }

    pub(in crate::rt) fn note(&self, record: &TickRecord) {
        self.ticks.store(record.input.index + 1, Ordering::Release);
        self.mode.store(record.status.mode as u8, Ordering::Relaxed);
        if record.status.mode == Mode::Armed {
            self.was_armed.store(true, Ordering::Relaxed);
        }
    }
}

/// Counts what a real-time thread allocates and faults after the first arming.
pub(super) struct Vigil<'a> {
    progress: &'a Progress,
    baseline: Option<(u64, u64)>,
}

impl<'a> Vigil<'a> {
    pub(super) const fn new(progress: &'a Progress) -> Self {
        Self { progress, baseline: None }
    }

    /// Begins to count at the first call after arming.
    pub(super) fn look(&mut self) {
        if self.baseline.is_none() && self.progress.was_armed.load(Ordering::Relaxed) {
            self.baseline = Some((allocation::on_this_thread(), memory::faults_of_this_thread()));
        }
    }
}

impl Drop for Vigil<'_> {
    fn drop(&mut self) {
        let now = (allocation::on_this_thread(), memory::faults_of_this_thread());
        let since = self.baseline.unwrap_or(now);
        self.progress.allocations.fetch_add(now.0 - since.0, Ordering::Relaxed);
        self.progress.page_faults.fetch_add(now.1 - since.1, Ordering::Relaxed);
    }
}
