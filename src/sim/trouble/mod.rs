//! Faults that are injected on purpose: when they begin and end (here), what they do to the wires ([`wires`]) and to the
//! devices ([`devices`]), to the operator and to the host's punctuality ([`outside`]). RT: no.

mod devices;
pub mod invariants;
pub(super) mod outside;
pub mod reaction;
pub mod soak;
pub mod table;
pub(super) mod wires;

use crate::base::time::{Span, Stamp};
use crate::config::fault::{Device, Injection};

/// A fault begins, or is over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Edge {
    Begin(Injection),
    End(Injection),
}

/// What happens when, in the order of time.
#[derive(Clone, Debug, Default)]
pub(super) struct Schedule {
    start: Stamp,
    /// The next one is the last.
    edges: Vec<(Span, Edge)>,
}

impl Schedule {
    /// Begins and ends of these faults.
    pub(super) fn new(faults: impl Iterator<Item = Injection>) -> Self {
        let mut edges = Vec::new();
        for fault in faults {
            edges.push((fault.at, Edge::Begin(fault)));
            edges.extend(fault.lasts.map(|lasts| (Span(fault.at.0 + lasts.0), Edge::End(fault))));
        }
        // Stable: what was named first comes first.
        edges.sort_by_key(|(at, _)| *at);
        edges.reverse();
        Self { start: Stamp::default(), edges }
    }

    /// Those of the plant, or those of whoever steps it: the operator's and the host's.
    pub(super) fn of(faults: &[Injection], outside: bool) -> Self {
        Self::new(faults.iter().copied().filter(|fault| is_outside(fault.entry.device) == outside))
    }

    /// Times count from here.
    pub(super) fn start_at(&mut self, start: Stamp) {
        self.start = start;
    }

    /// When the next one is due.
    pub(super) fn next_time(&self) -> Option<Stamp> {
        self.edges.last().map(|(at, _)| self.start + *at)
    }

    /// The next one that is due by now.
    pub(super) fn take(&mut self, now: Stamp) -> Option<Edge> {
        self.next_time().filter(|at| *at <= now)?;
        self.edges.pop().map(|(_, edge)| edge)
    }
}

const fn is_outside(device: Device) -> bool {
    matches!(device, Device::Joystick | Device::Host)
}

#[cfg(test)]
mod tick_tests;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_begin_and_end_in_the_order_of_time() {
        let read = |text| Injection::parse(text).unwrap();
        let all = [read("bus_off@2:for=1s"), read("imu_nan@1:for=5s"), read("boot_up@2")];
        let mut schedule = Schedule::of(&all, false);
        schedule.start_at(Stamp(1_000_000_000));
        let mut seen = Vec::new();
        while let Some(at) = schedule.next_time() {
            assert_eq!(schedule.take(at - Span(1)), None);
            seen.push((at.as_s(), schedule.take(at).unwrap()));
        }
        let [off, nan, boot] = all;
        let begun = [(2.0, Edge::Begin(nan)), (3.0, Edge::Begin(off)), (3.0, Edge::Begin(boot))];
        assert_eq!(seen[..3], begun);
        assert_eq!(seen[3..], [(4.0, Edge::End(off)), (7.0, Edge::End(nan))]);
    }

    #[test]
    fn the_operator_and_the_host_are_not_the_plants() {
        let all = ["joystick_unplugged@1", "bus_off@1", "step_overrun@1"].map(|text| Injection::parse(text).unwrap());
        let count = |outside| Schedule::of(&all, outside).edges.len();
        assert_eq!((count(true), count(false)), (4, 2));
    }
}
