//! The face of a simulated moteus. RT: no.

use super::direct::{Bench, Face, Motor, Target};
use crate::base::time::{Span, Stamp};
use crate::bus::cia402::State;
use crate::bus::moteus::{self, Item, Status};
use crate::msg::CanFrame;

/// Command registers 0x20 to 0x27; what a frame does not name goes to its default.
#[derive(Clone, Copy, Debug)]
struct Registers([f64; 8]);

impl Default for Registers {
    fn default() -> Self {
        // Position, velocity, torque, kp and kd scale, most torque, stop position, watchdog (default 0.1 s).
        Self([f64::NAN, 0.0, 0.0, 1.0, 1.0, f64::NAN, f64::NAN, 0.1])
    }
}

/// One moteus.
#[derive(Clone, Debug)]
pub(super) struct MoteusFace {
    node: u8,
    mode: u8,
    fault: u8,
    registers: Registers,
    heard: Option<Stamp>,
}

impl MoteusFace {
    pub(super) fn new(node: u8) -> Self {
        Self { node, mode: moteus::STOPPED, fault: 0, registers: Registers::default(), heard: None }
    }

    /// Only mode 0 leads out of a fault or a time-out.
    fn write_mode(&mut self, mode: u8) {
        self.registers = Registers::default();
        match (self.mode, mode) {
            (_, moteus::STOPPED) => (self.mode, self.fault) = (moteus::STOPPED, 0),
            (moteus::FAULTED | moteus::TIMED_OUT, _) => {}
            (_, mode) => self.mode = mode,
        }
    }

    fn act(&self, motor: &mut Motor) {
        let Registers([position, _, torque_nm, kp, _, max_torque_nm, ..]) = self.registers;
        let most = if max_torque_nm.is_nan() { f64::INFINITY } else { max_torque_nm.abs() };
        motor.target = match self.mode {
            moteus::POSITION_MODE if position.is_finite() && kp > 0.0 => Target::Position(position, Some(most)),
            moteus::POSITION_MODE => Target::Torque(torque_nm.clamp(-most, most)),
            _ => Target::Off,
        };
    }

    #[expect(clippy::cast_possible_truncation, reason = "the protocol has floats")]
    fn status(&self, motor: &Motor, bench: &Bench<'_>) -> Status {
        let position = if bench.defects.no_position { f32::NAN } else { motor.turns() as f32 };
        let velocity = motor.velocity_turns_s() as f32;
        Status { mode: self.mode, position, velocity, torque_nm: motor.torque_nm() as f32, fault: self.fault }
    }

    fn answer_reads(&self, asked: &[u16], motor: &Motor, bench: &mut Bench<'_>) {
        if bench.defects.read_errors && !asked.is_empty() {
            let bytes = &[0x31, 0x00, 0x02, 0x01];
            bench.answer(CanFrame::fd(moteus::reply_id(self.node), bytes, moteus::FILLER));
        } else if asked.contains(&moteus::MODE) {
            let status = self.status(motor, bench);
            bench.answer(moteus::reply(self.node, &status));
        } else if asked.contains(&moteus::MAP_VERSION) {
            let bytes = if bench.defects.refuses {
                &[0x31, 0x82, 0x02, 0x01][..]
            } else {
                &[0x29, 0x82, 0x02, 0x05, 0x00, 0x00, 0x00]
            };
            bench.answer(CanFrame::fd(moteus::reply_id(self.node), bytes, moteus::FILLER));
        }
    }
}

impl Face for MoteusFace {
    fn hear(&mut self, now: Stamp, frame: &CanFrame, motor: &mut Motor, bench: &mut Bench<'_>) -> bool {
        if !moteus::is_to(self.node, frame.id) {
            return false;
        }
        let (mut asked, mut command) = (Vec::new(), false);
        for item in moteus::items(frame.payload()) {
            match item {
                Item::Write(moteus::MODE, value) => {
                    (self.heard, command) = (Some(now), true);
                    self.write_mode(value.small().unwrap_or(moteus::STOPPED));
                }
                Item::Write(register, value) => {
                    let index = usize::from(register.wrapping_sub(moteus::COMMAND_POSITION));
                    if let Some(slot) = self.registers.0.get_mut(index) {
                        *slot = if value.unset { f64::NAN } else { value.number };
                    }
                }
                Item::Read(register, _) => asked.push(register),
                Item::Reply(..) | Item::Error(..) => {}
            }
        }
        self.act(motor);
        if frame.id & CanFrame::EXTENDED != 0 {
            self.answer_reads(&asked, motor, bench);
        }
        command
    }

    fn set_power(&mut self, on: bool) {
        self.mode = if on { moteus::POSITION_MODE } else { moteus::STOPPED };
        (self.fault, self.registers) = (0, Registers::default());
    }

    /// Without a command in time: latched, no torque (its `timeout_mode` set to 0).
    fn tick(&mut self, now: Stamp, motor: &mut Motor, _bench: &mut Bench<'_>) {
        let Registers([.., watchdog_s]) = self.registers;
        let limit = Span::from_s(if watchdog_s.is_nan() { f64::from(i32::MAX) } else { watchdog_s });
        if self.mode == moteus::POSITION_MODE && self.heard.is_some_and(|at| now.since(at) > limit) {
            self.mode = moteus::TIMED_OUT;
            self.act(motor);
        }
    }

    fn reset(&mut self) {
        (self.mode, self.fault, self.registers, self.heard) = (moteus::STOPPED, 0, Registers::default(), None);
    }

    fn time_out(&mut self) {
        self.mode = moteus::TIMED_OUT;
    }

    fn fail(&mut self, code: u8) {
        (self.mode, self.fault) = (moteus::FAULTED, code);
    }

    fn state(&self) -> State {
        match self.mode {
            moteus::POSITION_MODE => State::Enabled,
            moteus::FAULTED | moteus::TIMED_OUT => State::Fault,
            _ => State::SwitchOnDisabled,
        }
    }
}
