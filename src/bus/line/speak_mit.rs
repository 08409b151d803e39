//! How MIT drives are spoken to: four dialects. RT: yes.
//!
//! Power on is never told by mini-cheetah, CubeMars and MyActuator: a drive counts as on when it has answered two
//! commands after the one that enters. On entering a motor acts on the last command it holds, so one without gain and
//! torque goes before and after.

use super::direct::{Heard, Power, Question, Setpoint, Speak, Word};
use super::pace::Pace;
use super::setup::SetupFault;
use crate::base::time::{Span, Stamp};
use crate::bus::mit::{self, Reply, Special, register, rmd};
use crate::config::checked::{Mit, MitDialect};
use crate::msg::CanFrame;
use std::f64::consts::TAU;

/// Answers to commands after the one that enters, before the drive counts as on.
const PROOFS: u8 = 2;
/// Answers in a row at the end of the position's range before that counts as saturated.
const AT_THE_END: u8 = 20;
/// A step of the position in one answer may be this much more than the velocity's range allows, rad.
const SLACK_RAD: f64 = 0.1;
/// Position range of MyActuator's newer firmware, rad.
const WIDER_RAD: f64 = 12.566;
/// A MyActuator that follows is asked for its errors in place of a command, after so many; of none that lowers its torque.
const STATUS_EVERY: u8 = 16;
/// Status of a Damiao from which on it is a fault.
const FIRST_FAULT: u8 = 8;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Belief {
    Off,
    Entered { proofs: u8 },
    On,
}

/// Position over several turns of the code: what wraps is unwrapped, what saturates is a fault.
#[derive(Clone, Copy, Debug, Default)]
struct Unwrapped {
    last: Option<(Stamp, f64)>,
    offset_rad: f64,
    at_the_end: u8,
}

/// One MIT drive.
#[derive(Debug)]
pub(super) struct MitSpeaker {
    mit: Mit,
    node: u8,
    belief: Belief,
    position: Unwrapped,
    pace: Option<Pace>,
    /// MyActuator: angle and errors are asked for in turns.
    asks: u8,
    /// MyActuator: its last status told an error.
    faulty: bool,
    /// MyActuator: it has not answered a power off since the last command that may have given it torque.
    may_have_power: bool,
    /// MyActuator: a power off went out since that command.
    shut_down_sent: bool,
    /// MyActuator: commands since it was asked for its errors, and the torque of the last one, Nm.
    commands: u8,
    torque_nm: f64,
}

impl MitSpeaker {
    pub(super) fn new(mit: Mit, node: u8) -> Self {
        let position = Unwrapped { last: None, offset_rad: 0.0, at_the_end: 0 };
        let pace = Pace::of(&mit);
        Self {
            mit,
            node,
            belief: Belief::Off,
            position,
            pace,
            asks: 0,
            faulty: false,
            // Whoever drove it before us may have left it on.
            may_have_power: true,
            shut_down_sent: false,
            commands: 0,
            torque_nm: 0.0,
        }
    }

    const fn is_rmd(&self) -> bool {
        matches!(self.mit.dialect, MitDialect::MyActuator)
    }

    fn special(&self, special: Special) -> CanFrame {
        CanFrame::classic(self.mit.command_id(self.node), &special.emit())
    }

    /// From here on it may have power, whatever it answered before.
    const fn owe_power_off(&mut self) {
        (self.may_have_power, self.shut_down_sent) = (true, false);
    }

    /// A command of motion.
    fn motion(&mut self, setpoint: &mit::Setpoint) -> CanFrame {
        self.owe_power_off();
        self.numeric(setpoint)
    }

    fn numeric(&self, setpoint: &mit::Setpoint) -> CanFrame {
        CanFrame::classic(self.mit.command_id(self.node), &setpoint.emit(&self.mit))
    }

    fn ordinary(&self, command: u8) -> CanFrame {
        CanFrame::classic(rmd::COMMAND + u32::from(self.node), &[command, 0, 0, 0, 0, 0, 0, 0])
    }

    fn read(&self, register: u8) -> CanFrame {
        CanFrame::classic(register::ID, &[self.node, 0, register::READ, register, 0, 0, 0, 0])
    }

    /// A motor knows no torque limit: its stiffness shall not pull with more than this.
    fn no_farther(&self, target_rad: f64, most_nm: f64) -> f64 {
        let [stiffness_nm_rad, _] = self.mit.gains;
        match self.position.last {
            Some((_, at_rad)) if stiffness_nm_rad > 0.0 => {
                let reach_rad = most_nm / stiffness_nm_rad;
                target_rad.clamp(at_rad - reach_rad, at_rad + reach_rad)
            }
            _ => target_rad,
        }
    }

    fn is_mine(&self, reply: &Reply) -> bool {
        match self.mit.dialect {
            MitDialect::Damiao => reply.head & 0x0F == self.node & 0x0F,
            _ => reply.head == self.node,
        }
    }

    /// An answer to a command.
    fn on_reply(&mut self, reply: &Reply, stamp: Stamp) -> Word {
        let power = self.power(reply);
        let (position_rad, astray) = self.position.take(reply.position_rad, stamp, &self.mit);
        let pace = self.pace.as_mut();
        let misfits = pace.is_some_and(|pace| pace.is_broken_by(stamp, position_rad, reply.velocity_rad_s));
        let wrong = astray.or(misfits.then_some(SetupFault::WrongRange));
        Word {
            position_turns: Some(position_rad / TAU),
            torque_nm: Some(reply.torque_nm),
            power: Some(power),
            status: Some(u16::from(reply.head)),
            answers_command: true,
            wrong,
            ..Word::default()
        }
    }

    fn power(&mut self, reply: &Reply) -> Power {
        match (self.mit.dialect, reply.tail) {
            (MitDialect::Damiao, _) => match reply.head >> 4 {
                0 => Power::Off,
                1 => Power::On,
                code if code >= FIRST_FAULT => Power::Fault(code),
                _ => Power::Starting,
            },
            (MitDialect::CubeMars, Some([_, error])) if error != 0 => Power::Fault(error),
            _ => self.believed(),
        }
    }

    fn believed(&mut self) -> Power {
        if let Belief::Entered { proofs } = self.belief {
            self.belief = if proofs + 1 >= PROOFS { Belief::On } else { Belief::Entered { proofs: proofs + 1 } };
        }
        match self.belief {
            Belief::Off => Power::Off,
            Belief::Entered { .. } => Power::Starting,
            Belief::On => Power::On,
        }
    }

    /// An answer of a MyActuator to an ordinary command.
    fn on_ordinary(&mut self, data: [u8; 8], stamp: Stamp, asked: Option<usize>) -> Heard {
        let [command, _, _, _, d, e, f, g] = data;
        let mut word = Word { answers_command: true, ..Word::default() };
        match command {
            rmd::ANGLE => {
                let hundredths = i32::from_le_bytes([d, e, f, g]);
                let turns = f64::from(hundredths) / 36_000.0;
                self.position.at(turns * TAU, stamp);
                word.position_turns = Some(turns);
                word.power = (self.is_off() && !self.faulty).then_some(Power::Off);
            }
            rmd::STATUS => {
                let errors = u32::from(u16::from_le_bytes([f, g]));
                self.faulty = errors != 0;
                if self.faulty {
                    let code = errors.trailing_zeros() + 1;
                    word.power = Some(Power::Fault(u8::try_from(code).unwrap_or(u8::MAX)));
                } else if self.is_off() {
                    word.power = Some(Power::Off);
                }
            }
            rmd::FIRMWARE_DATE => {
                word.answers_command = false;
                let date = u32::from_le_bytes([d, e, f, g]);
                word.answers_question = asked.map(|_| self.judge_date(date));
            }
            rmd::SHUT_DOWN => self.may_have_power &= !self.shut_down_sent,
            rmd::RELEASE_BRAKE | rmd::RESET => {}
            _ => return Heard::Garbled,
        }
        Heard::Word(word)
    }

    /// MyActuator: it is off, and has said so.
    fn is_off(&self) -> bool {
        self.belief == Belief::Off && !self.may_have_power
    }

    fn judge_date(&self, date: u32) -> Result<(), SetupFault> {
        let wider = (self.mit.position_range_rad - WIDER_RAD).abs() < 0.01;
        if wider == (date >= rmd::WIDER_SINCE) { Ok(()) } else { Err(SetupFault::WrongRange) }
    }

    /// An answer of a Damiao to the reading of a register.
    fn on_register(&self, data: [u8; 8], step: usize) -> Option<Result<(), SetupFault>> {
        let [low, high, verb, number, a, b, c, d] = data;
        let asked = *register::ALL.get(step)?;
        if (low, high, verb, number) != (self.node, 0, register::READ, asked) {
            return None;
        }
        let bytes = [a, b, c, d];
        let fits = |range: f64| (f64::from(f32::from_le_bytes(bytes)) - range).abs() <= 1e-3 * range;
        let (fine, fault) = match asked {
            register::CONTROL_MODE => (u32::from_le_bytes(bytes) == 1, SetupFault::ModeUnsupported),
            register::POSITION_RANGE => (fits(self.mit.position_range_rad), SetupFault::WrongRange),
            register::VELOCITY_RANGE => (fits(self.mit.velocity_range_rad_s), SetupFault::WrongRange),
            _ => (fits(self.mit.torque_range_nm), SetupFault::WrongRange),
        };
        Some(if fine { Ok(()) } else { Err(fault) })
    }

    fn hear_rmd(&mut self, frame: &CanFrame, stamp: Stamp, asked: Option<usize>) -> Heard {
        let n = u32::from(self.node);
        if frame.id == rmd::COMMAND + n {
            let [command, ..] = frame.first_eight();
            return if command == rmd::FIRMWARE_DATE { Heard::OwnQuestion } else { Heard::Echo };
        }
        if frame.id != rmd::ANSWER + n {
            return Heard::Foreign;
        }
        if frame.len == 8 { self.on_ordinary(frame.first_eight(), stamp, asked) } else { Heard::Garbled }
    }
}

impl Unwrapped {
    /// Position of an answer, rad, and what is wrong with it.
    fn take(&mut self, raw_rad: f64, stamp: Stamp, mit: &Mit) -> (f64, Option<SetupFault>) {
        let range = mit.position_range_rad;
        let ends = raw_rad.abs() >= range * (1.0 - 1e-9);
        self.at_the_end = if ends { self.at_the_end.saturating_add(1) } else { 0 };
        if self.at_the_end >= AT_THE_END {
            return (raw_rad + self.offset_rad, Some(SetupFault::PositionAstray));
        }
        let Some((before, last_rad)) = self.last else {
            self.at(raw_rad, stamp);
            return (raw_rad, None);
        };
        // A step of more than half the code is a wrap.
        let step = raw_rad + self.offset_rad - last_rad;
        if step.abs() > range {
            self.offset_rad -= step.signum() * 2.0 * range;
        }
        let position_rad = raw_rad + self.offset_rad;
        let possible = mit.velocity_range_rad_s * stamp.since(before).max(Span::ZERO).as_s() + SLACK_RAD;
        let jumped = (position_rad - last_rad).abs() > possible;
        self.last = Some((stamp, position_rad));
        (position_rad, jumped.then_some(SetupFault::PositionAstray))
    }

    /// The position is known to be this.
    fn at(&mut self, position_rad: f64, stamp: Stamp) {
        self.last = Some((stamp, position_rad));
    }
}

impl Speak for MitSpeaker {
    fn hear(&mut self, frame: &CanFrame, stamp: Stamp, asked: Option<usize>) -> Heard {
        if frame.is_fd() {
            return Heard::Foreign;
        }
        if frame.id == self.mit.command_id(self.node) {
            return Heard::Echo;
        }
        if frame.id == self.mit.answer_id(self.node) {
            if let Some(result) = asked.and_then(|step| self.on_register(frame.first_eight(), step))
                && self.mit.dialect == MitDialect::Damiao
            {
                return Heard::Word(Word { answers_question: Some(result), ..Word::default() });
            }
            return match Reply::parse(frame.payload(), &self.mit) {
                Some(reply) if self.is_mine(&reply) => Heard::Word(self.on_reply(&reply, stamp)),
                // Another motor of the same master id, or nobody.
                Some(_) => Heard::Foreign,
                None => Heard::Garbled,
            };
        }
        match self.mit.dialect {
            MitDialect::MyActuator => self.hear_rmd(frame, stamp, asked),
            MitDialect::Damiao if frame.id == register::ID => {
                let [low, ..] = frame.first_eight();
                if low == self.node { Heard::OwnQuestion } else { Heard::Foreign }
            }
            _ => Heard::Foreign,
        }
    }

    fn question(&self, step: usize) -> Option<Question> {
        let frame = match (self.mit.dialect, step) {
            (MitDialect::Damiao, _) => self.read(*register::ALL.get(step)?),
            (MitDialect::MyActuator, 0) => self.ordinary(rmd::FIRMWARE_DATE),
            _ => return None,
        };
        Some(Question { frame, answered: true })
    }

    fn off(&mut self) -> CanFrame {
        self.belief = Belief::Off;
        if !self.is_rmd() {
            return self.special(Special::Leave);
        }
        // A question keeps a motor's watchdog quiet: power off, until it answers that.
        if self.may_have_power {
            self.shut_down_sent = true;
            return self.ordinary(rmd::SHUT_DOWN);
        }
        self.asks = self.asks.wrapping_add(1);
        match self.asks % 4 {
            0 => self.ordinary(rmd::STATUS),
            _ => self.ordinary(rmd::ANGLE),
        }
    }

    fn look(&mut self) -> CanFrame {
        self.belief = Belief::Off;
        if self.is_rmd() { self.off() } else { self.motion(&mit::Setpoint::default()) }
    }

    fn enter(&mut self, step: u8) -> Option<CanFrame> {
        if step != 1 {
            return None;
        }
        self.belief = Belief::Entered { proofs: 0 };
        self.owe_power_off();
        Some(if self.is_rmd() { self.ordinary(rmd::RELEASE_BRAKE) } else { self.special(Special::Enter) })
    }

    fn follow(&mut self, setpoint: Setpoint) -> CanFrame {
        let [stiffness_nm_rad, damping_nm_s_rad] = self.mit.gains;
        // While it enters, no gain: only a drive that is on is held at its position.
        let holds = self.belief == Belief::On;
        let asked = match setpoint {
            Setpoint::Torque(torque_nm) => mit::Setpoint { torque_nm, ..mit::Setpoint::default() },
            Setpoint::Position(turns, most_nm) if holds => mit::Setpoint {
                position_rad: self.no_farther(turns * TAU, most_nm) - self.position.offset_rad,
                stiffness_nm_rad,
                damping_nm_s_rad,
                ..mit::Setpoint::default()
            },
            Setpoint::Position(..) => mit::Setpoint::default(),
        };
        // Its answers in motion mode tell no errors: asked for now and then, while it acts on the last command.
        self.commands = self.commands.saturating_add(1);
        let lowers = asked.torque_nm.abs() < self.torque_nm.abs();
        if self.is_rmd() && holds && self.commands >= STATUS_EVERY && !lowers {
            self.commands = 0;
            return self.ordinary(rmd::STATUS);
        }
        self.torque_nm = asked.torque_nm;
        self.motion(&asked)
    }

    fn clear(&mut self) -> CanFrame {
        match self.mit.dialect {
            MitDialect::Damiao => self.special(Special::ClearErrors),
            MitDialect::MyActuator => {
                self.asks = self.asks.wrapping_add(1);
                self.ordinary(if self.asks % 16 == 1 { rmd::RESET } else { rmd::STATUS })
            }
            MitDialect::MiniCheetah | MitDialect::CubeMars => self.special(Special::Leave),
        }
    }

    fn stop(&self) -> [Option<CanFrame>; 2] {
        let off = if self.is_rmd() { self.ordinary(rmd::SHUT_DOWN) } else { self.special(Special::Leave) };
        [Some(self.numeric(&mit::Setpoint::default())), Some(off)]
    }

    fn forget(&mut self) {
        self.belief = Belief::Off;
        self.position = Unwrapped::default();
        self.faulty = false;
        self.owe_power_off();
    }
}
