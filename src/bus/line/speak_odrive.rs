//! How an ODrive is spoken to. It speaks by itself: heartbeat, encoder, torque, each by its own clock. RT: yes.

use super::direct::{Heard, Power, Question, Setpoint, Speak, Word};
use super::setup::SetupFault;
use crate::base::time::{Span, Stamp};
use crate::bus::odrive::{self, Heartbeat};
use crate::config::checked::{Odrive, OdriveFirmware};
use crate::msg::CanFrame;

/// Its positions are counted for so long, and more than half as many again as it sends are of two drives.
const COUNTED_FOR: Span = Span::from_ms(50);

/// Positions heard: nobody asks for them, so two drives with one number show by their rate alone.
#[derive(Clone, Copy, Debug, Default)]
struct PositionRate {
    since: Option<Stamp>,
    count: i64,
}

/// One ODrive.
#[derive(Debug)]
pub(super) struct OdriveSpeaker {
    odrive: Odrive,
    node: u8,
    /// It last said that it is not idle.
    awake: bool,
    rate: PositionRate,
}

impl OdriveSpeaker {
    pub(super) const fn new(odrive: Odrive, node: u8) -> Self {
        Self { odrive, node, awake: true, rate: PositionRate { since: None, count: 0 } }
    }

    fn torque(&self, torque_nm: f32) -> CanFrame {
        odrive::frame(self.node, odrive::INPUT_TORQUE, &torque_nm.to_le_bytes())
    }

    fn state(&self, state: u8) -> CanFrame {
        odrive::frame(self.node, odrive::SET_STATE, &u32::from(state).to_le_bytes())
    }

    fn control_mode(&self) -> CanFrame {
        let (torque, at_once) = (odrive::CONTROL_TORQUE.to_le_bytes(), odrive::PASS_THROUGH.to_le_bytes());
        odrive::pair(self.node, odrive::MODE, torque, at_once)
    }

    #[expect(clippy::cast_possible_truncation, reason = "the protocol has floats")]
    fn limits(&self) -> CanFrame {
        let (velocity, current) = (self.odrive.velocity_limit_turns_s as f32, self.odrive.current_limit_a as f32);
        odrive::pair(self.node, odrive::LIMITS, velocity.to_le_bytes(), current.to_le_bytes())
    }

    fn on_heartbeat(&mut self, heartbeat: &Heartbeat) -> Word {
        self.awake = heartbeat.state != odrive::IDLE;
        let power = match (heartbeat.fault(self.odrive.firmware), heartbeat.state) {
            (0, odrive::IDLE) => Power::Off,
            (0, odrive::CLOSED_LOOP) => Power::On,
            (0, _) => Power::Starting,
            (code, _) => Power::Fault(u8::try_from(code).unwrap_or(u8::MAX)),
        };
        Word { power: Some(power), status: Some(u16::from(heartbeat.state)), ..Word::default() }
    }

    /// Firmware 0.6 only: active errors, else the reason for which it disarmed.
    fn on_errors(active: u32, reason: u32) -> Word {
        let code = odrive::lowest_bit(if active == 0 { reason } else { active });
        let power = (code != 0).then(|| Power::Fault(u8::try_from(code).unwrap_or(u8::MAX)));
        Word { power, ..Word::default() }
    }

    fn on_version(payload: &[u8]) -> Result<(), SetupFault> {
        match payload {
            // Protocol, hardware (3), firmware: major, minor, revision; unreleased.
            [_, _, _, _, 0, 6, _, _] => Ok(()),
            _ => Err(SetupFault::WrongDevice),
        }
    }

    /// True once in a while if positions come too often.
    fn comes_too_often(&mut self, stamp: Stamp) -> bool {
        let since = *self.rate.since.get_or_insert(stamp);
        self.rate.count += 1;
        if (Span::ZERO..COUNTED_FOR).contains(&stamp.since(since)) {
            return false;
        }
        let expected = COUNTED_FOR.0 / self.odrive.feedback.0.max(1);
        let count = std::mem::take(&mut self.rate.count);
        self.rate.since = Some(stamp);
        // One or two more are jitter.
        count > expected + expected / 2 + 2
    }

    fn says(&mut self, command: u32, payload: &[u8], stamp: Stamp, asked: Option<usize>) -> Option<Word> {
        let number = |x: f32| Some(f64::from(x)).filter(|x| x.is_finite());
        let v6 = self.odrive.firmware == OdriveFirmware::V6;
        Some(match command {
            odrive::HEARTBEAT => self.on_heartbeat(&Heartbeat::parse(payload)?),
            odrive::ENCODER => {
                let [position, _] = odrive::floats(payload)?;
                let wrong = self.comes_too_often(stamp).then_some(SetupFault::TwoNodes);
                Word { position_turns: Some(number(position)?), wrong, ..Word::default() }
            }
            odrive::TORQUE if v6 => {
                let [_, estimate] = odrive::floats(payload)?;
                Word { torque_nm: Some(number(estimate)?), ..Word::default() }
            }
            odrive::CURRENT if !v6 => {
                let [_, measured] = odrive::floats(payload)?;
                Word { torque_nm: Some(number(measured)? * self.odrive.torque_constant_nm_a), ..Word::default() }
            }
            odrive::ERRORS if v6 && payload.len() == 8 => {
                let [active, reason] = [odrive::number(payload)?, odrive::number(payload.get(4..)?)?];
                Self::on_errors(active, reason)
            }
            odrive::VERSION if payload.len() == 8 => {
                Word { answers_question: asked.map(|_| Self::on_version(payload)), ..Word::default() }
            }
            _ => return None,
        })
    }
}

impl Speak for OdriveSpeaker {
    fn hear(&mut self, frame: &CanFrame, stamp: Stamp, asked: Option<usize>) -> Heard {
        let bare = frame.id & !CanFrame::REMOTE;
        if frame.is_fd() || bare >> 5 != u32::from(self.node) {
            return Heard::Foreign;
        }
        if frame.id & CanFrame::REMOTE != 0 {
            return Heard::OwnQuestion;
        }
        match bare & 0x1F {
            odrive::INPUT_TORQUE | odrive::INPUT_POSITION | odrive::SET_STATE | odrive::CLEAR => Heard::Echo,
            odrive::MODE | odrive::LIMITS | odrive::STOP => Heard::OwnQuestion,
            command => self.says(command, frame.payload(), stamp, asked).map_or(Heard::Garbled, Heard::Word),
        }
    }

    fn question(&self, step: usize) -> Option<Question> {
        // The newer firmware tells its version; the older one may not.
        let first = usize::from(self.odrive.firmware == OdriveFirmware::V5);
        let (frame, answered) = match step + first {
            0 => (odrive::question(self.node, odrive::VERSION), true),
            1 => (odrive::frame(self.node, odrive::CLEAR, &[0]), false),
            2 => (self.control_mode(), false),
            3 => (self.limits(), false),
            _ => return None,
        };
        Some(Question { frame, answered })
    }

    /// Zero torque feeds its watchdog while it is idle.
    fn off(&mut self) -> CanFrame {
        if std::mem::take(&mut self.awake) { self.state(odrive::IDLE) } else { self.torque(0.0) }
    }

    fn look(&mut self) -> CanFrame {
        self.torque(0.0)
    }

    /// Torque zero first, because it acts at once on what it holds; then closed loop.
    fn enter(&mut self, step: u8) -> Option<CanFrame> {
        match step {
            1 => {
                self.awake = true;
                Some(self.state(odrive::CLOSED_LOOP))
            }
            _ => None,
        }
    }

    #[expect(clippy::cast_possible_truncation, reason = "the protocol has floats")]
    fn follow(&mut self, setpoint: Setpoint) -> CanFrame {
        // Whatever the last heartbeat said: going off begins with the idle state.
        self.awake = true;
        match setpoint {
            Setpoint::Torque(torque_nm) => self.torque(torque_nm as f32),
            // The configuration knows no such ODrive.
            Setpoint::Position(..) => self.torque(0.0),
        }
    }

    fn clear(&mut self) -> CanFrame {
        odrive::frame(self.node, odrive::CLEAR, &[0])
    }

    fn stop(&self) -> [Option<CanFrame>; 2] {
        [Some(self.torque(0.0)), Some(self.state(odrive::IDLE))]
    }

    fn forget(&mut self) {
        self.awake = true;
        self.rate = PositionRate::default();
    }
}
