//! Absolute wake-ups. RT: yes.
//!
//! The phase is kept: wake-ups are planned at `start + k * period` for ever. Whoever is late by whole periods skips
//! them and goes on in step; there is never a burst of steps to "catch up", which would show the controller several
//! periods within none.

use super::clock::Timer;
use crate::base::time::{Span, Stamp};

/// A wake-up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wake {
    /// The planned instant that this tick stands for; a multiple of the period after the start.
    pub planned: Stamp,
    /// How long after the first planned instant the thread runs: the timer's lateness, or the overrun of the last step.
    pub latency: Span,
    /// Periods skipped before this one.
    pub skipped: u32,
}

/// A periodic timer.
#[derive(Clone, Copy, Debug)]
pub struct Cycle<T> {
    timer: T,
    period: Span,
    next: Stamp,
}

impl<T: Timer> Cycle<T> {
    /// The first wake-up comes one period from now.
    pub fn start(mut timer: T, period: Span) -> Self {
        let next = timer.now() + period;
        Self { timer, period, next }
    }

    /// Sleeps until the next planned instant.
    pub fn wait(&mut self) -> Wake {
        let planned = self.next;
        self.timer.sleep_until(planned);
        let latency = self.timer.now().since(planned);
        let skipped = (latency.0.max(0) / self.period.0.max(1)).min(i64::from(u32::MAX));
        let standing_for = planned + Span(skipped * self.period.0);
        self.next = standing_for + self.period;
        Wake { planned: standing_for, latency, skipped: u32::try_from(skipped).unwrap_or(u32::MAX) }
    }

    /// The present instant.
    pub fn now(&mut self) -> Stamp {
        self.timer.now()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::time::Clock;

    /// A timer that wakes late as planned by the test.
    struct Late {
        now: Stamp,
        by: Vec<i64>,
    }

    impl Clock for Late {
        fn now(&mut self) -> Stamp {
            self.now
        }
    }

    impl Timer for Late {
        fn sleep_until(&mut self, until: Stamp) {
            self.now = self.now.max(until) + Span(self.by.remove(0));
        }
    }

    fn wakes(by: &[i64]) -> Vec<(i64, i64, u32)> {
        let mut cycle = Cycle::start(Late { now: Stamp(0), by: by.to_vec() }, Span(100));
        by.iter().map(|_| cycle.wait()).map(|w| (w.planned.0, w.latency.0, w.skipped)).collect()
    }

    #[test]
    fn punctual_wake_ups_are_a_period_apart() {
        assert_eq!(wakes(&[0, 3, 0]), [(100, 0, 0), (200, 3, 0), (300, 0, 0)]);
    }

    #[test]
    fn lateness_below_a_period_is_made_up_without_losing_phase() {
        assert_eq!(wakes(&[99, 0]), [(100, 99, 0), (200, 0, 0)]);
    }

    #[test]
    fn whole_periods_are_skipped_and_the_phase_is_kept() {
        assert_eq!(wakes(&[250, 0, 0]), [(300, 250, 2), (400, 0, 0), (500, 0, 0)]);
    }
}
