//! Overrun policy: late → degrade, late again and again → fault. RT: yes.
//!
//! One late tick must not drop the robot (it did elsewhere), so lateness only switches off what needs the right phase,
//! until [`CLEAN_TICKS`] punctual ticks have passed. Skipped periods are counted over the last second; too many of them
//! are a fault.

use crate::base::time::{Span, Stamp};
use crate::msg::TickInput;

/// Punctual ticks until phase-sensitive terms come back.
const CLEAN_TICKS: u32 = 32;
/// The last second, in so many buckets.
const BUCKETS: usize = 10;
/// Length of a bucket, ns.
const BUCKET_NS: i64 = 100_000_000;

/// How punctual the ticks are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lateness {
    late_after: Span,
    unheard_after: Span,
    clean: u32,
    bucket: i64,
    skipped: [u32; BUCKETS],
    total: u64,
}

impl Lateness {
    /// A wake-up later than half a period counts as late, and so does input that nobody has looked for in three: a
    /// thread that brings it looks once in a period.
    pub(super) const fn new(period: Span) -> Self {
        let (late_after, unheard_after) = (Span(period.0 / 2), Span(period.0.saturating_mul(3)));
        Self { late_after, unheard_after, clean: CLEAN_TICKS, bucket: 0, skipped: [0; BUCKETS], total: 0 }
    }

    /// Takes note of a tick; true while phase-sensitive terms shall be off.
    pub(super) fn observe(&mut self, input: &TickInput) -> bool {
        self.forget_before(input.now);
        if let Some(bucket) = self.skipped.first_mut() {
            *bucket = bucket.saturating_add(input.skipped);
        }
        self.total = self.total.saturating_add(u64::from(input.skipped));
        let listened = input.heard_until.iter().chain([&input.imu_heard_until]).min().copied().unwrap_or(input.now);
        let heard = input.now.since(listened) <= self.unheard_after;
        let punctual = input.skipped == 0 && input.wake_latency <= self.late_after && heard;
        self.clean = if punctual { self.clean.saturating_add(1) } else { 0 };
        self.is_late()
    }

    /// Moves the buckets on; the newest is the first.
    fn forget_before(&mut self, now: Stamp) {
        let bucket = now.0.div_euclid(BUCKET_NS);
        let passed = bucket.saturating_sub(self.bucket).clamp(0, 10);
        for _ in 0..passed {
            self.skipped.rotate_right(1);
            if let Some(newest) = self.skipped.first_mut() {
                *newest = 0;
            }
        }
        self.bucket = bucket;
    }

    /// Fewer than [`CLEAN_TICKS`] punctual ticks since the last late one.
    pub(super) const fn is_late(&self) -> bool {
        self.clean < CLEAN_TICKS
    }

    /// Periods skipped within the last second.
    pub(super) fn skipped(&self) -> u32 {
        self.skipped.iter().fold(0, |sum, n| sum.saturating_add(*n))
    }

    /// Periods skipped since start.
    pub(super) const fn total(&self) -> u64 {
        self.total
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::msg::BUSES;

    fn tick(ms: i64, skipped: u32) -> TickInput {
        let now = Stamp(ms * 1_000_000);
        TickInput { now, skipped, heard_until: [now; BUSES], imu_heard_until: now, ..TickInput::default() }
    }

    #[test]
    fn a_late_tick_degrades_for_32_clean_ticks() {
        let mut lateness = Lateness::new(Span::from_ms(1));
        assert!(!lateness.observe(&tick(0, 0)));
        assert!(lateness.observe(&tick(2, 1)));
        let late = (3..100).filter(|ms| lateness.observe(&tick(*ms, 0))).count();
        assert_eq!(late, 31, "the 32nd clean tick is back to normal");
    }

    #[test]
    fn a_late_wake_up_degrades_without_a_skipped_period() {
        let mut lateness = Lateness::new(Span::from_ms(1));
        assert!(lateness.observe(&TickInput { wake_latency: Span::from_us(501), ..tick(0, 0) }));
    }

    #[test]
    fn input_that_nobody_looks_for_degrades() {
        let mut lateness = Lateness::new(Span::from_ms(1));
        let heard_until = |ms: i64| [Stamp(100_000_000), Stamp(ms * 1_000_000)];
        assert!(!lateness.observe(&TickInput { heard_until: heard_until(97), ..tick(100, 0) }));
        assert!(lateness.observe(&TickInput { heard_until: heard_until(97), ..tick(101, 0) }));
    }

    #[test]
    fn skipped_periods_are_forgotten_after_a_second() {
        let mut lateness = Lateness::new(Span::from_ms(1));
        lateness.observe(&tick(50, 3));
        lateness.observe(&tick(900, 2));
        assert_eq!(lateness.skipped(), 5);
        lateness.observe(&tick(1100, 0));
        assert_eq!(lateness.skipped(), 2);
        lateness.observe(&tick(60_000, 0));
        assert_eq!((lateness.skipped(), lateness.total()), (0, 5));
    }
}
