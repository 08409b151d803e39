//! What goes wrong outside the robot: with the operator's device, and with the punctuality of the host. RT: no.

use super::{Edge, Schedule};
use crate::base::time::{Span, Stamp};
use crate::config::fault::{FaultName, Injection};
use crate::msg::{OperatorSample, TickInput};

/// Late steps come so often.
const LATE_EVERY: Span = Span::from_ms(100);

/// The operator's and the host's faults.
#[derive(Clone, Debug)]
pub(in crate::sim) struct Outside {
    schedule: Schedule,
    unplugged: bool,
    stuck: bool,
    /// Steps come late by so much, from then on.
    late: Option<(Stamp, Span)>,
    /// The step before came late by our doing.
    was_late: bool,
}

impl Outside {
    /// Those among these faults.
    pub(in crate::sim) fn new(faults: &[Injection]) -> Self {
        Self { schedule: Schedule::of(faults, true), unplugged: false, stuck: false, late: None, was_late: false }
    }

    /// Begins the tick, late if it shall be.
    pub(in crate::sim) fn come_late(&mut self, input: &mut TickInput, period: Span) {
        if std::mem::take(&mut self.was_late) {
            input.skipped = 0;
        }
        while let Some(edge) = self.schedule.take(input.now) {
            self.suffer(input, period, &edge);
        }
        if let Some((next, by)) = self.late.filter(|(next, _)| input.now >= *next) {
            self.late = Some((next + LATE_EVERY, by));
            self.delay(input, by, period);
        }
    }

    fn delay(&mut self, input: &mut TickInput, by: Span, period: Span) {
        let periods = by.0 / period.0.max(1);
        input.now += Span(periods * period.0);
        input.skipped = u32::try_from(periods).unwrap_or(u32::MAX);
        self.was_late = true;
    }

    fn suffer(&mut self, input: &mut TickInput, period: Span, edge: &Edge) {
        let (fault, on) = match edge {
            Edge::Begin(fault) => (fault, true),
            Edge::End(fault) => (fault, false),
        };
        match fault.entry.fault {
            FaultName::JoystickUnplugged => self.unplugged = on,
            FaultName::JoystickHeldAtStart => self.stuck = on,
            FaultName::StepOverrun if fault.kind == "many" => self.late = on.then_some((input.now, fault.late)),
            FaultName::StepOverrun if on => self.delay(input, fault.late, period),
            _ => {}
        }
    }

    /// What arrives of the hand.
    pub(in crate::sim) fn hand(&self, now: OperatorSample, before: &OperatorSample) -> OperatorSample {
        if self.unplugged {
            return *before;
        }
        OperatorSample { dead_man: now.dead_man || self.stuck, ..now }
    }
}
