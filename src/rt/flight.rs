//! The flight recorder: the last ticks before a fault or an overrun ("which component spiked?"). RT: no.
//!
//! The relay keeps the ring, so it costs the loop nothing. After an event it goes on for [`AFTER`] ticks, so that the
//! reaction is there too; events within that time belong to the same dump.

use crate::msg::{Fault, FaultCode, Mode, TickRecord};
use std::collections::VecDeque;

/// Ticks kept after the event.
const AFTER: u32 = 100;
/// Dumps of one run: a machine that is late all the time must not fill the disk.
const MOST_DUMPS: u32 = 10;

/// The last ticks, and whether something happened.
#[derive(Debug)]
pub struct FlightRecorder {
    ticks: VecDeque<TickRecord>,
    capacity: usize,
    faults: u32,
    event: Option<Fault>,
    left: u32,
    dumps: u32,
}

impl FlightRecorder {
    /// Keeps so many ticks.
    #[must_use]
    pub fn new(capacity: usize) -> Self {
        Self { ticks: VecDeque::with_capacity(capacity), capacity, faults: 0, event: None, left: 0, dumps: 0 }
    }

    /// Takes a tick. Returns the event when its ticks are complete and should be dumped now.
    pub fn observe(&mut self, record: &TickRecord) -> Option<Fault> {
        if self.ticks.len() >= self.capacity {
            self.ticks.pop_front();
        }
        self.ticks.push_back(*record);
        if self.event.is_none() && self.dumps < MOST_DUMPS {
            self.event = self.event_in(record);
            self.left = AFTER;
        }
        self.faults = record.status.faults;
        self.event?;
        self.left = self.left.saturating_sub(1);
        if self.left == 0 { self.take_event() } else { None }
    }

    /// The event that is still waiting for its last ticks: for the end of the run.
    pub fn take_event(&mut self) -> Option<Fault> {
        self.dumps += u32::from(self.event.is_some());
        self.event.take()
    }

    /// The ticks, oldest first.
    #[must_use]
    pub const fn ticks(&self) -> &VecDeque<TickRecord> {
        &self.ticks
    }

    /// A new fault, or an overrun while torque was on.
    fn event_in(&self, record: &TickRecord) -> Option<Fault> {
        let (status, input) = (&record.status, &record.input);
        if status.faults > self.faults {
            return Some(status.first_fault);
        }
        let overrun = Fault { code: FaultCode::Overrun, index: 0, stamp: input.now, value: f64::from(input.skipped) };
        (status.mode == Mode::Armed && input.skipped > 0).then_some(overrun)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tick(index: u64, faults: u32, skipped: u32) -> TickRecord {
        let mut record = TickRecord::default();
        record.input.index = index;
        record.input.skipped = skipped;
        record.status.mode = Mode::Armed;
        record.status.faults = faults;
        record.status.first_fault.code = FaultCode::ImuStale;
        record
    }

    #[test]
    fn a_fault_is_dumped_with_what_came_before_and_after() {
        let mut recorder = FlightRecorder::new(500);
        assert!((0..1_000).all(|i| recorder.observe(&tick(i, 0, 0)).is_none()));
        let dumped: Vec<u64> = (1_000..2_000).filter(|i| recorder.observe(&tick(*i, 1, 0)).is_some()).collect();
        assert_eq!(dumped, [1_099], "once, a hundred ticks later");
        assert_eq!(recorder.ticks().len(), 500);
    }

    #[test]
    fn an_overrun_is_an_event_and_dumps_are_limited() {
        let mut recorder = FlightRecorder::new(10);
        let dumps = (0..10_000).filter_map(|i| recorder.observe(&tick(i, 0, 1))).collect::<Vec<_>>();
        assert_eq!(dumps.len(), 10);
        assert!(dumps.iter().all(|event| event.code == FaultCode::Overrun));
    }
}
