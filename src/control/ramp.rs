//! What is asked for changes no faster than so much in a second. RT: yes.

use crate::base::time::{Span, Stamp};
use crate::config::checked::Config;

/// The time that ramps count.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ticks {
    last: Stamp,
    longest: Span,
}

impl Ticks {
    /// Before arming only.
    pub(super) const fn new(config: &Config) -> Self {
        Self { last: Stamp::NEVER, longest: Span(MOST_PERIODS * config.real_time.period.0) }
    }

    pub(super) const fn reset(&mut self, now: Stamp) {
        self.last = now;
    }

    /// Since the tick before, s. Of a stall it counts the longest tick only: it is made up for by no jump.
    pub(super) fn since_last_s(&mut self, now: Stamp) -> f64 {
        let passed = now.since(self.last).clamp(Span::ZERO, self.longest);
        self.last = now;
        passed.as_s()
    }
}

/// By `most` nearer to where it goes.
pub(super) const fn toward(from: f64, to: f64, most: f64) -> f64 {
    from + (to - from).clamp(-most, most)
}

/// Periods that a tick is long at most.
const MOST_PERIODS: i64 = 5;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::load;

    #[test]
    fn a_stall_counts_as_five_periods_whatever_the_period() {
        for period_us in [1000.0, 5000.0] {
            let config = load(None, &[format!("rt.period_us={period_us}")]).unwrap().config;
            let mut ticks = Ticks::new(&config);
            let at = |periods: i64| Stamp(7) + Span(periods * config.real_time.period.0);
            ticks.reset(at(0));
            let passed = [1, 3, 43, 42].map(|periods| ticks.since_last_s(at(periods)) / (1e-6 * period_us));
            assert!(passed.iter().zip([1.0, 2.0, 5.0, 0.0]).all(|(a, b)| (a - b).abs() < 1e-9), "{passed:?}");
        }
        assert!((toward(1.0, 3.0, 0.5) - 1.5).abs() < 1e-12 && (toward(1.0, 0.9, 0.5) - 0.9).abs() < 1e-12);
    }
}
