//! How much simulation a piece of work has cost: counted, so that a limit on it gives the same answer on any computer.
//!
//! RT: no.

use std::sync::atomic::{AtomicU64, Ordering};

/// Steps of free runs, each weighted by what it carries, and how many there may be.
#[derive(Debug)]
pub struct Effort {
    spent: AtomicU64,
    most: u64,
}

impl Default for Effort {
    fn default() -> Self {
        Self::of_at_most(u64::MAX)
    }
}

impl Effort {
    /// Nothing spent, `most` allowed.
    #[must_use]
    pub const fn of_at_most(most: u64) -> Self {
        Self { spent: AtomicU64::new(0), most }
    }

    /// Counts a run of so many steps of a machine of `coordinates` with `directions` of derivatives.
    pub fn add_run(&self, steps: u64, coordinates: usize, directions: usize) {
        self.add(Self::of_run(steps, coordinates, directions));
    }

    /// Counts what was counted elsewhere.
    pub fn add(&self, spent: u64) {
        self.spent.fetch_add(spent, Ordering::Relaxed);
    }

    /// What was counted up to now: the same in every run where no other thread is at work.
    #[must_use]
    pub fn spent(&self) -> u64 {
        self.spent.load(Ordering::Relaxed)
    }

    /// True if nothing more is allowed.
    #[must_use]
    pub fn is_exhausted(&self) -> bool {
        self.spent() >= self.most
    }

    /// True if `more` would be beyond any patience: what has begun may end, but no single run may cost far more than all
    /// of them should. Windows that run side by side give it up together, so that the answer depends on none of them.
    #[must_use]
    pub fn is_beyond(&self, more: u64) -> bool {
        self.spent().saturating_add(more) >= self.patience()
    }

    /// What is spent at most.
    #[must_use]
    pub const fn patience(&self) -> u64 {
        self.most.saturating_mul(2)
    }

    /// Weight of so many steps.
    #[must_use]
    pub const fn of_run(steps: u64, coordinates: usize, directions: usize) -> u64 {
        steps.saturating_mul(((coordinates + 1) * (directions + 2)) as u64)
    }
}
