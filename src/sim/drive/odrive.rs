//! The face of a simulated ODrive, firmware 0.5 and 0.6. RT: no.

use super::direct::{Bench, Face, Motor, Target};
use crate::base::time::{Span, Stamp};
use crate::bus::cia402::State;
use crate::bus::odrive::{self, Heartbeat};
use crate::config::checked::{DriveConfig, Odrive, OdriveFirmware};
use crate::msg::CanFrame;

/// Error when closed loop is asked for while another error stands.
const INVALID_STATE: u32 = 0x1;

/// One ODrive.
#[derive(Clone, Debug)]
pub(super) struct OdriveFace {
    odrive: Odrive,
    node: u8,
    heartbeat: Span,
    watchdog: Span,
    state: u8,
    error: u32,
    control: u32,
    wanted: Target,
    fed: Option<Stamp>,
    heartbeat_due: Stamp,
    feedback_due: Stamp,
}

impl OdriveFace {
    pub(super) fn new(odrive: Odrive, config: &DriveConfig) -> Self {
        Self {
            odrive,
            node: config.node,
            heartbeat: config.heartbeat,
            watchdog: config.watchdog,
            state: odrive::IDLE,
            error: 0,
            control: odrive::CONTROL_POSITION,
            wanted: Target::Off,
            fed: None,
            heartbeat_due: Stamp::default(),
            feedback_due: Stamp::default(),
        }
    }

    fn act(&self, motor: &mut Motor) {
        motor.target = match (self.state, self.wanted) {
            (odrive::CLOSED_LOOP, Target::Torque(_)) if self.control == odrive::CONTROL_TORQUE => self.wanted,
            (odrive::CLOSED_LOOP, _) if self.control == odrive::CONTROL_TORQUE => Target::Torque(0.0),
            // Position control without a command drives to zero: that is the trap.
            (odrive::CLOSED_LOOP, _) => Target::Position(0.0, None),
            _ => Target::Off,
        };
    }

    fn disarm(&mut self, error: u32) {
        self.error |= error;
        self.state = odrive::IDLE;
    }

    fn obey(&mut self, command: u32, payload: &[u8]) -> Option<()> {
        let float = |bytes: &[u8]| Some(f64::from(f32::from_bits(odrive::number(bytes)?)));
        match command {
            odrive::SET_STATE => match odrive::number(payload)? {
                8 if self.error == 0 => self.state = odrive::CLOSED_LOOP,
                8 => self.error |= INVALID_STATE,
                _ => self.state = odrive::IDLE,
            },
            odrive::STOP => self.disarm(0x0200_0000),
            odrive::CLEAR => self.error = 0,
            odrive::MODE if payload.len() == 8 => self.control = odrive::number(payload)?,
            odrive::INPUT_TORQUE => self.wanted = Target::Torque(float(payload)?),
            _ => {}
        }
        Some(())
    }

    /// The firmware that it speaks like.
    fn firmware(&self, bench: &Bench<'_>) -> OdriveFirmware {
        match (self.odrive.firmware, bench.defects.other_dialect) {
            (OdriveFirmware::V5, false) | (OdriveFirmware::V6, true) => OdriveFirmware::V5,
            (OdriveFirmware::V6, false) | (OdriveFirmware::V5, true) => OdriveFirmware::V6,
        }
    }

    fn version(&self, bench: &Bench<'_>) -> CanFrame {
        let minor = if self.firmware(bench) == OdriveFirmware::V6 { 6 } else { 5 };
        odrive::frame(self.node, odrive::VERSION, &[2, 4, 4, 58, 0, minor, 8, 0])
    }

    #[expect(clippy::cast_possible_truncation, reason = "the protocol has floats")]
    fn feedback(&self, motor: &Motor, bench: &mut Bench<'_>) {
        if !bench.defects.no_encoder {
            let (turns, velocity) = (motor.turns() as f32, motor.velocity_turns_s() as f32);
            bench.say(odrive::pair(self.node, odrive::ENCODER, turns.to_le_bytes(), velocity.to_le_bytes()));
        }
        let torque_nm = motor.torque_nm();
        let (message, value) = match self.firmware(bench) {
            OdriveFirmware::V5 => (odrive::CURRENT, torque_nm / self.odrive.torque_constant_nm_a),
            OdriveFirmware::V6 => (odrive::TORQUE, torque_nm),
        };
        let value = (value as f32).to_le_bytes();
        bench.say(odrive::pair(self.node, message, value, value));
        if bench.defects.twice {
            // The other one stands a turn away.
            let (turns, still) = (motor.turns() as f32 + 1.0, 0.0_f32);
            bench.say(odrive::pair(self.node, odrive::ENCODER, turns.to_le_bytes(), still.to_le_bytes()));
        }
    }
}

impl Face for OdriveFace {
    fn hear(&mut self, now: Stamp, frame: &CanFrame, motor: &mut Motor, bench: &mut Bench<'_>) -> bool {
        if (frame.id & !CanFrame::REMOTE) >> 5 != u32::from(self.node) || frame.is_fd() {
            return false;
        }
        // Any message feeds the watchdog, questions too.
        self.fed = Some(now);
        let command = frame.id & 0x1F;
        if frame.id & CanFrame::REMOTE != 0 {
            if command == odrive::VERSION {
                let version = self.version(bench);
                bench.answer(version);
            }
            return false;
        }
        if self.obey(command, frame.payload()).is_some() {
            self.act(motor);
        }
        matches!(command, odrive::SET_STATE | odrive::STOP | odrive::INPUT_TORQUE)
    }

    fn set_power(&mut self, on: bool) {
        (self.state, self.error) = (if on { odrive::CLOSED_LOOP } else { odrive::IDLE }, 0);
        (self.control, self.wanted) = (odrive::CONTROL_TORQUE, Target::Off);
    }

    fn tick(&mut self, now: Stamp, motor: &mut Motor, bench: &mut Bench<'_>) {
        let starved = self.fed.is_some_and(|at| now.since(at) > self.watchdog);
        if self.state == odrive::CLOSED_LOOP && starved {
            self.time_out();
            self.act(motor);
        }
        if now >= self.heartbeat_due && !bench.defects.no_heartbeat {
            self.heartbeat_due = now + self.heartbeat;
            let heartbeat = Heartbeat { error: self.error, state: self.state, rest: [0; 3] };
            bench.say(odrive::frame(self.node, odrive::HEARTBEAT, &heartbeat.emit()));
        }
        if now >= self.feedback_due {
            self.feedback_due = now + self.odrive.feedback;
            self.feedback(motor, bench);
        }
    }

    fn reset(&mut self) {
        (self.state, self.error, self.control) = (odrive::IDLE, 0, odrive::CONTROL_POSITION);
        (self.wanted, self.fed) = (Target::Off, None);
    }

    fn time_out(&mut self) {
        let watchdog = match self.odrive.firmware {
            OdriveFirmware::V5 => odrive::WATCHDOG_V5,
            OdriveFirmware::V6 => odrive::WATCHDOG_V6,
        };
        self.disarm(watchdog);
    }

    fn fail(&mut self, code: u8) {
        self.disarm(1 << (code & 0x1F));
    }

    fn state(&self) -> State {
        match (self.error, self.state) {
            (0, odrive::CLOSED_LOOP) => State::Enabled,
            (0, _) => State::SwitchOnDisabled,
            _ => State::Fault,
        }
    }
}
