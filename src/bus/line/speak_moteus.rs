//! How a moteus is spoken to: every frame asks for mode, position, torque and fault. RT: yes.
//!
//! Power off is mode 0 in every turn, not "position mode without torque": in mode 0 it neither holds nor times out, and
//! a latched time-out (mode 11) ends by it. A fault is looked at without writing the mode, which would forget it.

use super::direct::{Heard, Power, Question, Setpoint, Speak, Word};
use crate::base::time::Stamp;
use crate::bus::moteus::{self, Command, Item};
use crate::config::checked::DriveConfig;
use crate::msg::CanFrame;

/// Fault codes from here on say what limits the torque; they are no faults.
const FIRST_LIMIT: u8 = 96;

/// One moteus.
#[derive(Debug)]
pub(super) struct MoteusSpeaker {
    node: u8,
    max_torque_nm: f32,
    watchdog_s: f32,
}

/// What a reply says.
#[derive(Clone, Copy, Debug, Default)]
struct Reply {
    mode: Option<u8>,
    fault: u8,
    word: Word,
}

impl MoteusSpeaker {
    #[expect(clippy::cast_possible_truncation, reason = "the protocol has floats")]
    pub(super) fn new(drive: &DriveConfig) -> Self {
        let max_torque_nm = (drive.rated_torque_nm * f64::from(drive.max_torque_permille) * 1e-3) as f32;
        Self { node: drive.node, max_torque_nm, watchdog_s: drive.watchdog.as_s() as f32 }
    }

    fn command(&self, position: f32, torque_nm: f32, gain: f32, max_torque_nm: f32) -> CanFrame {
        let watchdog_s = self.watchdog_s;
        moteus::command(self.node, &Command { position, torque_nm, gain, max_torque_nm, watchdog_s })
    }

    /// `None` if the bytes make no sense.
    fn read(payload: &[u8], asked: Option<usize>) -> Option<Word> {
        let mut reply = Reply::default();
        let mut items = moteus::items(payload);
        let mut count = 0;
        for item in items.by_ref() {
            count += 1;
            reply.note(item, asked);
        }
        if items.broken || count == 0 {
            return None;
        }
        if let Some(mode) = reply.mode {
            reply.word.answers_command = true;
            reply.word.status = Some(u16::from(mode));
            reply.word.power = Some(power(mode, reply.fault));
        }
        Some(reply.word)
    }
}

impl Reply {
    fn note(&mut self, item: Item, asked: Option<usize>) {
        match item {
            Item::Reply(moteus::MODE, value) => self.mode = value.small(),
            Item::Reply(moteus::POSITION, value) => self.word.position_turns = value.scaled(moteus::POSITION_UNITS),
            Item::Reply(moteus::TORQUE, value) => self.word.torque_nm = value.scaled(moteus::TORQUE_UNITS),
            Item::Reply(moteus::FAULT, value) => self.fault = value.small().unwrap_or(0),
            Item::Reply(moteus::MAP_VERSION, _) => self.word.answers_question = asked.map(|_| Ok(())),
            Item::Error(_, moteus::MAP_VERSION) => {
                self.word.answers_question = asked.map(|_| Err(super::setup::SetupFault::Refused));
            }
            Item::Reply(..) | Item::Write(..) | Item::Read(..) | Item::Error(..) => {}
        }
    }
}

fn power(mode: u8, fault: u8) -> Power {
    match mode {
        moteus::STOPPED => Power::Off,
        moteus::POSITION_MODE => Power::On,
        moteus::FAULTED if fault != 0 && fault < FIRST_LIMIT => Power::Fault(fault),
        moteus::FAULTED | moteus::TIMED_OUT => Power::Fault(mode),
        _ => Power::Starting,
    }
}

impl Speak for MoteusSpeaker {
    fn hear(&mut self, frame: &CanFrame, _stamp: Stamp, asked: Option<usize>) -> Heard {
        if moteus::is_to(self.node, frame.id) {
            let version = moteus::ask_version(self.node);
            return if frame.data == version.data { Heard::OwnQuestion } else { Heard::Echo };
        }
        if frame.id != moteus::reply_id(self.node) {
            return Heard::Foreign;
        }
        Self::read(frame.payload(), asked).map_or(Heard::Garbled, Heard::Word)
    }

    fn question(&self, step: usize) -> Option<Question> {
        (step == 0).then(|| Question { frame: moteus::ask_version(self.node), answered: true })
    }

    fn off(&mut self) -> CanFrame {
        moteus::stop(self.node)
    }

    fn look(&mut self) -> CanFrame {
        moteus::query(self.node)
    }

    fn enter(&mut self, _step: u8) -> Option<CanFrame> {
        Some(self.command(f32::NAN, 0.0, 0.0, self.max_torque_nm))
    }

    #[expect(clippy::cast_possible_truncation, reason = "the protocol has floats")]
    fn follow(&mut self, setpoint: Setpoint) -> CanFrame {
        match setpoint {
            Setpoint::Torque(torque_nm) => self.command(f32::NAN, torque_nm as f32, 0.0, self.max_torque_nm),
            Setpoint::Position(turns, most_nm) => {
                self.command(turns as f32, 0.0, 1.0, self.max_torque_nm.min(most_nm as f32))
            }
        }
    }

    fn clear(&mut self) -> CanFrame {
        moteus::stop(self.node)
    }

    fn stop(&self) -> [Option<CanFrame>; 2] {
        [Some(moteus::stop(self.node)), None]
    }

    fn forget(&mut self) {}
}
