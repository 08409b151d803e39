//! The face of a simulated MIT motor: four dialects. RT: no.

use super::direct::{Bench, Face, Motor, Target};
use crate::base::time::{Span, Stamp};
use crate::bus::cia402::State;
use crate::bus::mit::{Reply, Setpoint, Special, register, rmd};
use crate::config::checked::{DriveConfig, Mit, MitDialect};
use crate::msg::CanFrame;
use std::f64::consts::TAU;

/// Damiao's error when no command comes.
const DAMIAO_SILENCE: u8 = 0x0D;

/// One motor. As the real ones do, on entering it acts on the last command that it holds.
#[derive(Clone, Debug)]
pub(super) struct MitFace {
    mit: Mit,
    node: u8,
    watchdog: Span,
    on: bool,
    fault: u8,
    held: Setpoint,
    heard: Option<Stamp>,
}

impl MitFace {
    pub(super) fn new(mit: Mit, config: &DriveConfig) -> Self {
        let (node, watchdog) = (config.node, config.watchdog);
        Self { mit, node, watchdog, on: false, fault: 0, held: Setpoint::default(), heard: None }
    }

    /// The ranges that it works with.
    fn ranges(&self, bench: &Bench<'_>) -> Mit {
        let mut mit = self.mit;
        if bench.defects.has_wrong_ranges() {
            mit.torque_range_nm *= 2.0;
        }
        if bench.defects.wrong_ranges == "motor" {
            // About an AK80-64 in the place of an AK10-9.
            mit.velocity_range_rad_s /= 6.0;
        }
        mit
    }

    /// The law of the motor: stiffness, damping and torque. With stiffness its position loop is the plant's.
    fn act(&self, motor: &mut Motor) {
        let held = &self.held;
        motor.target = if !self.on || self.fault != 0 {
            Target::Off
        } else if held.stiffness_nm_rad > 0.5 * self.mit.stiffness_range_nm_rad / 4095.0 {
            Target::Position(held.position_rad / TAU, None)
        } else {
            let damping = held.damping_nm_s_rad * (held.velocity_rad_s - motor.velocity_turns_s() * TAU);
            Target::Torque(held.torque_nm + damping)
        };
    }

    fn reply(&self, motor: &Motor, bench: &mut Bench<'_>) {
        let number = self.node ^ u8::from(bench.defects.wrong_number);
        let on = u8::from(self.on);
        let (head, tail) = match self.mit.dialect {
            MitDialect::MiniCheetah => (number, None),
            MitDialect::CubeMars => (number, Some([40, self.fault])),
            MitDialect::Damiao => (if self.fault == 0 { on } else { self.fault } << 4 | number & 0x0F, Some([40, 40])),
            MitDialect::MyActuator => (number, Some([0, 0])),
        };
        let range = self.mit.position_range_rad;
        let position_rad = motor.turns() * TAU;
        // As if the shaft stood half a range further.
        let wrapped = || (position_rad + 2.0 * range).rem_euclid(2.0 * range) - range;
        let reply = Reply {
            head,
            position_rad: if bench.defects.wraps { wrapped() } else { position_rad },
            velocity_rad_s: motor.velocity_turns_s() * TAU,
            torque_nm: motor.torque_nm(),
            tail,
        };
        let (bytes, len) = reply.emit(&self.ranges(bench));
        bench.answer(CanFrame::classic(self.mit.answer_id(self.node), &bytes[..len]));
    }

    /// Goes off with a command of full torque in its memory.
    pub(super) fn hold_full_torque(&mut self) {
        self.on = false;
        self.held = Setpoint { torque_nm: self.mit.torque_range_nm, ..Setpoint::default() };
    }

    fn on_special(&mut self, special: Special) {
        match special {
            Special::Enter => self.on = self.fault == 0,
            Special::Leave => {
                self.on = false;
                // Only Damiao has a command of its own for it.
                if self.mit.dialect != MitDialect::Damiao {
                    self.fault = 0;
                }
            }
            Special::ClearErrors if self.mit.dialect == MitDialect::Damiao => self.fault = 0,
            Special::ClearErrors | Special::SetZero => {}
        }
    }

    /// True if it is a command, not a question.
    fn on_ordinary(&mut self, data: [u8; 8], motor: &mut Motor, bench: &mut Bench<'_>) -> bool {
        let mut answer = [data[0], 0, 0, 0, 0, 0, 0, 0];
        match data[0] {
            rmd::ANGLE => {
                #[expect(clippy::cast_possible_truncation, reason = "some turns")]
                let hundredths = libm::round(motor.turns() * 36_000.0) as i32;
                answer[4..].copy_from_slice(&hundredths.to_le_bytes());
            }
            rmd::STATUS if self.fault != 0 => {
                let bits: u16 = 1 << (self.fault - 1).min(15);
                answer[6..].copy_from_slice(&bits.to_le_bytes());
            }
            rmd::FIRMWARE_DATE => {
                let wide = (self.mit.position_range_rad > 12.55) != bench.defects.has_wrong_ranges();
                let date: u32 = if wide { 20_260_501 } else { 20_240_101 };
                answer[4..].copy_from_slice(&date.to_le_bytes());
            }
            rmd::SHUT_DOWN => self.on = false,
            rmd::RELEASE_BRAKE => self.on = self.fault == 0,
            rmd::RESET => self.reset(),
            rmd::STATUS => {}
            _ => return false,
        }
        self.act(motor);
        bench.answer(CanFrame::classic(rmd::ANSWER + u32::from(self.node), &answer));
        matches!(data[0], rmd::SHUT_DOWN | rmd::RELEASE_BRAKE | rmd::RESET)
    }

    fn on_register(&self, data: [u8; 8], bench: &mut Bench<'_>) {
        let [low, high, verb, number, ..] = data;
        if (low, high, verb) != (self.node, 0, register::READ) {
            return;
        }
        let mit = self.ranges(bench);
        #[expect(clippy::cast_possible_truncation, reason = "registers are floats")]
        let float = |x: f64| (x as f32).to_le_bytes();
        let value = match number {
            register::CONTROL_MODE => 1_u32.to_le_bytes(),
            register::POSITION_RANGE => float(mit.position_range_rad),
            register::VELOCITY_RANGE => float(mit.velocity_range_rad_s),
            register::TORQUE_RANGE => float(mit.torque_range_nm),
            _ => return,
        };
        let [a, b, c, d] = value;
        let answer = [self.node, 0, register::READ, number, a, b, c, d];
        bench.answer(CanFrame::classic(u32::from(self.mit.reply_id), &answer));
    }
}

impl Face for MitFace {
    fn hear(&mut self, now: Stamp, frame: &CanFrame, motor: &mut Motor, bench: &mut Bench<'_>) -> bool {
        if frame.len != 8 || frame.is_fd() {
            return false;
        }
        let data = frame.first_eight();
        if frame.id == self.mit.command_id(self.node) {
            self.heard = Some(now);
            match Special::parse(data) {
                Some(special) if self.mit.dialect != MitDialect::MyActuator => self.on_special(special),
                _ => self.held = Setpoint::parse(data, &self.ranges(bench)),
            }
            self.act(motor);
            self.reply(motor, bench);
            return true;
        }
        if self.mit.dialect == MitDialect::MyActuator && frame.id == rmd::COMMAND + u32::from(self.node) {
            self.heard = Some(now);
            return self.on_ordinary(data, motor, bench);
        }
        if self.mit.dialect == MitDialect::Damiao && frame.id == register::ID {
            self.on_register(data, bench);
        }
        false
    }

    fn set_power(&mut self, on: bool) {
        (self.on, self.fault, self.held) = (on, 0, Setpoint::default());
    }

    /// Without commands: a Damiao reports an error and goes off, the others act on a command of zeros.
    fn tick(&mut self, now: Stamp, motor: &mut Motor, _bench: &mut Bench<'_>) {
        if self.on && self.heard.is_some_and(|at| now.since(at) > self.watchdog) {
            self.held = Setpoint::default();
            if self.mit.dialect == MitDialect::Damiao {
                self.fault = DAMIAO_SILENCE;
                self.on = false;
            }
            self.act(motor);
        }
    }

    fn reset(&mut self) {
        (self.on, self.fault, self.held, self.heard) = (false, 0, Setpoint::default(), None);
    }

    fn time_out(&mut self) {
        self.on = false;
        if self.mit.dialect == MitDialect::Damiao {
            self.fault = DAMIAO_SILENCE;
        }
    }

    fn fail(&mut self, code: u8) {
        self.fault = match self.mit.dialect {
            // Four bits, 8 and above.
            MitDialect::Damiao => 0x08 | code & 0x07,
            MitDialect::CubeMars => (code & 0x07).max(1),
            _ => code.max(1),
        };
        self.on = false;
    }

    fn state(&self) -> State {
        match (self.fault, self.on) {
            (0, true) => State::Enabled,
            (0, false) => State::SwitchOnDisabled,
            _ => State::Fault,
        }
    }
}
