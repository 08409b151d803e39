//! What goes wrong outside the robot: with the operator's device, and with the punctuality of the host. RT: no.

use super::{Edge, Schedule};
use crate::base::time::{Span, Stamp};
use crate::config::checked::Heartbeat;
use crate::config::fault::{Device, FaultName, Injection};
use crate::msg::{OperatorSample, TickInput};
use crate::sensor::operator::device::{Look, Watch};

/// Late steps come so often.
const LATE_EVERY: Span = Span::from_ms(100);

/// The device is looked at so often.
const LOOK_EVERY: Span = Span::from_ms(10);
/// The radio counts as dead when its axis has been still for so long.
const HEARTBEAT: Heartbeat = Heartbeat { axis: 1, within: Span::from_ms(50) };

/// A wireless pad in the operator's hand: what it shows, and the reader of the robot that judges it.
#[derive(Clone, Debug)]
struct Pad {
    watch: Watch,
    next: Stamp,
    /// What it showed last.
    look: Look,
    sample: OperatorSample,
    unplugged: bool,
    /// The key is held whatever the operator does.
    key_held: bool,
    /// The operator has let go; the event of it was lost, or the radio died with it.
    let_go: bool,
    axis_stuck: bool,
    radio_dead: bool,
}

impl Pad {
    fn new() -> Self {
        Self {
            watch: Watch::new(Some(HEARTBEAT)),
            next: Stamp::default(),
            look: Look::default(),
            sample: OperatorSample { stamp: Stamp::NEVER, ..OperatorSample::default() },
            unplugged: false,
            key_held: false,
            let_go: false,
            axis_stuck: false,
            radio_dead: false,
        }
    }

    /// What the robot's reader says of it, 100 times a second.
    fn read(&mut self, hand: &OperatorSample) -> OperatorSample {
        // Who has let go is still open-handed until he means to press again.
        self.let_go &= hand.dead_man;
        if hand.stamp >= self.next {
            self.next = hand.stamp + LOOK_EVERY;
            self.show(hand);
            self.sample = self.watch.take(hand.stamp, (!self.unplugged).then_some(self.look));
        }
        // The zero is confirmed by another way: the key means aligned legs.
        OperatorSample { zeroings: hand.zeroings, zero_angle_rad: hand.zero_angle_rad, ..self.sample }
    }

    fn show(&mut self, hand: &OperatorSample) {
        if self.radio_dead {
            return;
        }
        let held = (hand.dead_man && !self.let_go) || self.key_held;
        // It trembles.
        let axis = self.look.axis.map_or(0, |axis| if self.axis_stuck { axis } else { 1 - axis });
        self.look = Look { held, zero: false, axis: Some(axis), speed_m_s: hand.speed_m_s };
    }
}

/// The operator's and the host's faults.
#[derive(Clone, Debug)]
pub(in crate::sim) struct Outside {
    schedule: Schedule,
    /// There if something is to go wrong with it.
    pad: Option<Pad>,
    /// Steps come late by so much, from then on.
    late: Option<(Stamp, Span)>,
    /// The step before came late by our doing.
    was_late: bool,
}

impl Outside {
    /// Those among these faults.
    pub(in crate::sim) fn new(faults: &[Injection]) -> Self {
        let pad = faults.iter().any(|fault| fault.entry.device == Device::Joystick).then(Pad::new);
        Self { schedule: Schedule::of(faults, true), pad, late: None, was_late: false }
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
        match (fault.entry.fault, &mut self.pad) {
            (FaultName::JoystickUnplugged, Some(pad)) => pad.unplugged = on,
            (FaultName::JoystickHeldAtStart, Some(pad)) => pad.key_held = on,
            // The reader asks for the state of the keys: what happens to events does not reach it.
            (FaultName::JoystickDropped, Some(pad)) => pad.let_go |= on,
            (FaultName::JoystickAxisStuck, Some(pad)) => pad.axis_stuck = on,
            (FaultName::JoystickWirelessHold, Some(pad)) => (pad.radio_dead, pad.let_go) = (on, pad.let_go || on),
            (FaultName::StepOverrun, _) if fault.kind == "many" => self.late = on.then_some((input.now, fault.late)),
            (FaultName::StepOverrun, _) if on => self.delay(input, fault.late, period),
            _ => {}
        }
    }

    /// What arrives of the hand.
    pub(in crate::sim) fn hand(&mut self, hand: OperatorSample) -> OperatorSample {
        match &mut self.pad {
            Some(pad) => pad.read(&hand),
            None => hand,
        }
    }
}
