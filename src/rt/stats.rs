//! Histograms of what the loop took, filled by the relay from finished ticks. RT: no.

use crate::base::time::Span;
use crate::msg::TickRecord;
use hdrhistogram::Histogram;

/// Longest time that is told apart, ns: 10 s.
const LONGEST_NS: u64 = 10_000_000_000;

/// A histogram of durations with three digits.
#[derive(Clone, Debug)]
pub struct Durations(Option<Histogram<u64>>);

/// Percentiles of a histogram.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Percentiles {
    /// Half are shorter.
    pub p50: Span,
    /// Nine of ten are shorter.
    pub p90: Span,
    /// 99 of 100 are shorter.
    pub p99: Span,
    /// 999 of 1000 are shorter.
    pub p999: Span,
    /// The longest.
    pub max: Span,
    /// How many.
    pub count: u64,
}

impl Default for Durations {
    fn default() -> Self {
        // The bounds are valid, so this is always there; an empty one would only say nothing.
        Self(Histogram::new_with_bounds(1, LONGEST_NS, 3).ok())
    }
}

impl Durations {
    /// Counts one.
    pub fn record(&mut self, span: Span) {
        if let Some(histogram) = &mut self.0 {
            histogram.saturating_record(u64::try_from(span.0).unwrap_or(0));
        }
    }

    /// Where the bulk and the tail are.
    #[must_use]
    pub fn percentiles(&self) -> Percentiles {
        let Some(histogram) = &self.0 else { return Percentiles::default() };
        let at = |q: f64| Span(i64::try_from(histogram.value_at_quantile(q)).unwrap_or(i64::MAX));
        Percentiles {
            p50: at(0.5),
            p90: at(0.9),
            p99: at(0.99),
            p999: at(0.999),
            max: Span(i64::try_from(histogram.max()).unwrap_or(i64::MAX)),
            count: histogram.len(),
        }
    }
}

/// What the loop took since it started.
#[derive(Clone, Debug, Default)]
pub struct LoopStats {
    /// Wake-up of the control thread.
    pub wake: Durations,
    /// The step: from the end of input to the last frame handed to the wire.
    pub step: Durations,
}

impl LoopStats {
    /// Counts a tick. A tick carries the step time of the one before, so the first has none.
    pub fn observe(&mut self, record: &TickRecord) {
        self.wake.record(record.input.wake_latency);
        if record.input.index > 0 {
            self.step.record(record.input.step_time);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_within_a_thousandth() {
        let mut durations = Durations::default();
        (1..=1000).for_each(|us| durations.record(Span::from_us(us)));
        let p = durations.percentiles();
        let close = |span: Span, us: f64| (span.as_us() - us).abs() <= us * 1e-3 + 1e-3;
        assert!(close(p.p50, 500.0) && close(p.p99, 990.0) && close(p.max, 1000.0), "{p:?}");
        assert_eq!(p.count, 1000);
    }
}
