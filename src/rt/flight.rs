//! The flight recorder: the last ticks before a fault or an overrun ("which component spiked?"). RT: no.
//!
//! The relay keeps the ring, so it costs the loop nothing. After an event it goes on for [`AFTER`] ticks, so that the
//! reaction is there too; events within that time belong to the same dump.

use crate::msg::{Fault, FaultCode, Mode, TickRecord};
use std::collections::VecDeque;

/// Ticks kept after the event.
const AFTER: u32 = 100;
/// Dumps of faults in one run, and of overruns: a machine that is late all the time must not fill the disk, nor leave
/// the fault that comes of it without its ticks.
const MOST_FAULTS: u32 = 10;
const MOST_OVERRUNS: u32 = 5;

/// The last ticks, and whether something happened.
#[derive(Debug)]
pub struct FlightRecorder {
    ticks: VecDeque<TickRecord>,
    capacity: usize,
    faults: u32,
    event: Option<Fault>,
    left: u32,
    fault_dumps: u32,
    overrun_dumps: u32,
}

impl FlightRecorder {
    /// Keeps so many ticks.
    #[must_use]
    pub fn new(capacity: usize) -> Self {
        Self {
            ticks: VecDeque::with_capacity(capacity),
            capacity,
            faults: 0,
            event: None,
            left: 0,
            fault_dumps: 0,
            overrun_dumps: 0,
        }
    }

    /// Takes a tick. Returns the event when its ticks are complete and should be dumped now.
    pub fn observe(&mut self, record: &TickRecord) -> Option<Fault> {
        if self.ticks.len() >= self.capacity {
            self.ticks.pop_front();
        }
        self.ticks.push_back(*record);
        let event = self.event_in(record).filter(|event| self.has_budget(event));
        // A fault takes the place of an overrun that still waits for its ticks: it is what a person looks for.
        if let Some(event) = event.filter(|event| self.event.is_none_or(|e| is_overrun(&e) && !is_overrun(event))) {
            self.event = Some(event);
            self.left = AFTER;
        }
        self.faults = record.status.faults;
        self.event?;
        self.left = self.left.saturating_sub(1);
        if self.left == 0 { self.take_event() } else { None }
    }

    /// The event that is still waiting for its last ticks: for the end of the run.
    pub fn take_event(&mut self) -> Option<Fault> {
        let event = self.event.take()?;
        let dumps = if is_overrun(&event) { &mut self.overrun_dumps } else { &mut self.fault_dumps };
        *dumps += 1;
        Some(event)
    }

    fn has_budget(&self, event: &Fault) -> bool {
        if is_overrun(event) { self.overrun_dumps < MOST_OVERRUNS } else { self.fault_dumps < MOST_FAULTS }
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

/// An overrun that was no fault.
fn is_overrun(event: &Fault) -> bool {
    event.code == FaultCode::Overrun
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
        assert_eq!(dumps.len(), 5);
        assert!(dumps.iter().all(|event| event.code == FaultCode::Overrun));
    }

    #[test]
    fn a_fault_after_many_overruns_has_its_ticks() {
        let mut recorder = FlightRecorder::new(10);
        assert_eq!((0..10_000).filter_map(|i| recorder.observe(&tick(i, 0, 1))).count(), 5);
        let dumped: Vec<_> = (10_000..10_200).filter_map(|i| recorder.observe(&tick(i, 1, 1))).collect();
        assert_eq!(dumped.iter().map(|event| event.code).collect::<Vec<_>>(), [FaultCode::ImuStale]);
        // And one that comes while an overrun waits for its last ticks takes its place.
        let mut recorder = FlightRecorder::new(10);
        recorder.observe(&tick(0, 0, 1));
        let dumped: Vec<_> = (1..200).filter_map(|i| recorder.observe(&tick(i, 1, 0))).collect();
        assert_eq!(dumped.iter().map(|event| event.code).collect::<Vec<_>>(), [FaultCode::ImuStale]);
    }
}
