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

#[cfg(test)]
mod tests {
    use crate::identify::fit::FreeRuns;
    use crate::identify::problem::Problem;

    const RIG: &str = "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = 0.01\ngravity_nm = 0.4\n\
        [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.3\n[[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\n";

    #[test]
    fn a_run_goes_on_until_the_patience_ends_and_says_what_it_took() {
        let problem = Problem::shaken(RIG, None, vec![0.0; 200]);
        let run = |problem: &Problem| problem.run(0, &[], &[0.1, 0.0], false).is_some();
        assert!(run(&problem));
        let cost = problem.effort.spent();
        assert!(cost > 200, "{cost}");
        // Twice what is allowed may be spent by what has begun.
        let enough = problem.clone().with_allowance(cost / 2 + 1);
        assert!(run(&enough) && enough.effort.spent() == cost && !run(&enough));
        assert!(!run(&problem.with_allowance(cost / 4)));
    }
}
