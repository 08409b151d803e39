//! A pure delay between a drive's torque command and its current loop. RT: no.
//!
//! The plant stops its integration at [`TorqueDelay::next`], so the delay is exact to its grain. A drive without power
//! makes no torque, at once: what was on its way is lost.

use crate::base::time::{Span, Stamp};
use std::collections::VecDeque;

/// Commands on their way.
#[derive(Clone, Debug)]
pub(super) struct TorqueDelay {
    delay: Span,
    on_its_way: VecDeque<(Stamp, f64)>,
    newest: f64,
    present: f64,
}

impl TorqueDelay {
    pub(super) const fn new(delay: Span) -> Self {
        Self { delay, on_its_way: VecDeque::new(), newest: 0.0, present: 0.0 }
    }

    /// The drive's target from now on; `None` without power.
    pub(super) fn note(&mut self, now: Stamp, target: Option<f64>) {
        if self.delay <= Span::ZERO {
            return;
        }
        let Some(target) = target else {
            self.on_its_way.clear();
            (self.newest, self.present) = (0.0, 0.0);
            return;
        };
        if target.to_bits() != self.newest.to_bits() {
            self.newest = target;
            self.on_its_way.push_back((now + self.delay, target));
        }
    }

    /// When the next one arrives.
    pub(super) fn next(&self) -> Option<Stamp> {
        self.on_its_way.front().map(|(at, _)| *at)
    }

    /// Takes over what has arrived.
    pub(super) fn arrive(&mut self, now: Stamp) {
        while let Some((_, target)) = self.on_its_way.pop_front_if(|(at, _)| *at <= now) {
            self.present = target;
        }
    }

    /// What the current loop follows, `undelayed` being the command now.
    pub(super) const fn present(&self, undelayed: f64) -> f64 {
        if self.delay.0 <= 0 { undelayed } else { self.present }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_arrives_after_the_delay_and_not_before() {
        let mut d = TorqueDelay::new(Span::from_ms(5));
        d.note(Stamp(1_000), Some(7.0));
        assert_eq!(d.next(), Some(Stamp(5_001_000)));
        d.arrive(Stamp(5_000_999));
        assert!(d.present(7.0).abs() < 1e-12);
        d.arrive(Stamp(5_001_000));
        assert!((d.present(0.0) - 7.0).abs() < 1e-12 && d.next().is_none());
    }

    #[test]
    fn a_drive_that_loses_its_power_makes_no_torque_at_once() {
        let mut d = TorqueDelay::new(Span::from_ms(5));
        d.note(Stamp(0), Some(7.0));
        d.arrive(Stamp(5_000_000));
        d.note(Stamp(6_000_000), Some(9.0));
        d.note(Stamp(7_000_000), None);
        assert!(d.present(9.0).abs() < 1e-12 && d.next().is_none());
    }

    #[test]
    fn no_delay_changes_nothing() {
        let mut d = TorqueDelay::new(Span::ZERO);
        d.note(Stamp(0), Some(7.0));
        assert!((d.present(7.0) - 7.0).abs() < 1e-12 && d.next().is_none());
    }
}
