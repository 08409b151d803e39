//! Instants and spans in nanoseconds, and where the time comes from.
//!
//! No room reads a clock: `now` is an argument, so that tests, the simulator and replay decide the time.
//! RT: yes.

use iceoryx2::prelude::ZeroCopySend;
use std::ops::{Add, AddAssign, Sub};

/// An instant, ns since the clock's own zero (CLOCK_MONOTONIC on the robot, 0 in simulation).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, ZeroCopySend)]
#[repr(C)]
pub struct Stamp(pub i64);

/// A length of time, ns; may be negative.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, ZeroCopySend)]
#[repr(C)]
pub struct Span(pub i64);

impl Stamp {
    /// The time before which nothing happened: "never" for a message that has not come yet.
    pub const NEVER: Self = Self(i64::MIN);

    /// Time from `earlier` to `self`; saturates, so that the age of [`Stamp::NEVER`] is huge, not an overflow.
    #[must_use]
    pub const fn since(self, earlier: Self) -> Span {
        Span(self.0.saturating_sub(earlier.0))
    }

    /// Seconds since the clock's zero.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "104 days are exact to 1 ns")]
    pub const fn as_s(self) -> f64 {
        self.0 as f64 * 1e-9
    }
}

impl Span {
    /// No time at all.
    pub const ZERO: Self = Self(0);

    /// From whole microseconds.
    #[must_use]
    pub const fn from_us(us: i64) -> Self {
        Self(us * 1_000)
    }

    /// From whole milliseconds.
    #[must_use]
    pub const fn from_ms(ms: i64) -> Self {
        Self(ms * 1_000_000)
    }

    /// From seconds, rounded to the nearest nanosecond.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "saturates, as a span should")]
    pub fn from_s(s: f64) -> Self {
        Self(libm::round(s * 1e9) as i64)
    }

    /// Length in seconds.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "104 days are exact to 1 ns")]
    pub const fn as_s(self) -> f64 {
        self.0 as f64 * 1e-9
    }

    /// Length in microseconds.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "104 days are exact to 1 ns")]
    pub const fn as_us(self) -> f64 {
        self.0 as f64 * 1e-3
    }
}

impl Add<Span> for Stamp {
    type Output = Self;
    fn add(self, rhs: Span) -> Self {
        Self(self.0.saturating_add(rhs.0))
    }
}

impl AddAssign<Span> for Stamp {
    fn add_assign(&mut self, rhs: Span) {
        *self = *self + rhs;
    }
}

impl Sub<Span> for Stamp {
    type Output = Self;
    fn sub(self, rhs: Span) -> Self {
        Self(self.0.saturating_sub(rhs.0))
    }
}

/// Where the corridor gets its time from: the system, the simulation or a recording.
pub trait Clock {
    /// The present instant. Never goes back.
    fn now(&mut self) -> Stamp;
}

/// A clock that stands where it is set: lockstep simulation, replay and tests.
#[derive(Clone, Copy, Debug, Default)]
pub struct ManualClock(pub Stamp);

impl Clock for ManualClock {
    fn now(&mut self) -> Stamp {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn age_of_never_saturates_instead_of_overflowing() {
        assert!(Stamp(5).since(Stamp::NEVER) > Span::from_s(1e9));
    }

    #[test]
    fn span_from_seconds_rounds_to_nanoseconds() {
        assert_eq!(Span::from_s(0.001), Span::from_ms(1));
        assert_eq!(Span::from_s(-1.5e-9), Span(-2));
    }
}
