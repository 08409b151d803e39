//! The 8-byte frames of the MIT mini-cheetah and its descendants, both ends of them. RT: yes.
//!
//! A command packs position, velocity, stiffness, damping and torque, most significant bit first; the motor makes
//! `kp (p - p_is) + kd (v - v_is) + t`. Every command is answered with position, velocity and torque. The ranges are
//! not on the wire. Zero cannot be coded: half a step below it is the nearest.

use crate::config::checked::{Mit, MitDialect};

/// What follows seven 0xFF in a special command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Special {
    /// Damiao: forget the error.
    ClearErrors = 0xFB,
    /// Enter motor mode: power on.
    Enter = 0xFC,
    /// Leave it: power off.
    Leave = 0xFD,
    /// The present position is zero.
    SetZero = 0xFE,
}

impl Special {
    const ALL: [Self; 4] = [Self::ClearErrors, Self::Enter, Self::Leave, Self::SetZero];

    /// Its bytes.
    #[must_use]
    pub const fn emit(self) -> [u8; 8] {
        [0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, self as u8]
    }

    /// The special command that these bytes are.
    #[must_use]
    pub fn parse(bytes: [u8; 8]) -> Option<Self> {
        Self::ALL.into_iter().find(|special| special.emit() == bytes)
    }
}

/// What a motor is asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Setpoint {
    /// Position at the output, rad.
    pub position_rad: f64,
    /// Velocity, rad/s.
    pub velocity_rad_s: f64,
    /// Stiffness about the position, Nm/rad.
    pub stiffness_nm_rad: f64,
    /// Damping about the velocity, Nm s/rad.
    pub damping_nm_s_rad: f64,
    /// Torque on top, Nm.
    pub torque_nm: f64,
}

/// `x` in `[low, high]` as a whole number of `bits` bits. What is not a number becomes the middle.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the range of the code")]
fn encode(x: f64, [low, high]: [f64; 2], bits: u32) -> u32 {
    let x = if x.is_nan() { 0.5 * (low + high) } else { x.clamp(low, high) };
    let steps = f64::from((1_u32 << bits) - 1);
    // A float just below a whole number is that number: what was decoded encodes to the same code.
    libm::trunc((x - low) * steps / (high - low) + 1e-9) as u32
}

fn decode(code: u32, [low, high]: [f64; 2], bits: u32) -> f64 {
    f64::from(code) * (high - low) / f64::from((1_u32 << bits) - 1) + low
}

const fn about_zero(range: f64) -> [f64; 2] {
    [-range, range]
}

impl Setpoint {
    /// Its bytes. The bytes of a special command never come out: such a setpoint loses one step of its torque.
    #[must_use]
    pub fn emit(&self, mit: &Mit) -> [u8; 8] {
        let bytes = self.pack(mit);
        let [head @ .., last] = bytes;
        if head == [0xFF; 7] && last >= Special::ClearErrors as u8 {
            return [0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, Special::ClearErrors as u8 - 1];
        }
        bytes
    }

    fn pack(&self, mit: &Mit) -> [u8; 8] {
        let p = encode(self.position_rad, about_zero(mit.position_range_rad), 16);
        let v = encode(self.velocity_rad_s, about_zero(mit.velocity_range_rad_s), 12);
        let kp = encode(self.stiffness_nm_rad, [0.0, mit.stiffness_range_nm_rad], 12);
        let kd = encode(self.damping_nm_s_rad, [0.0, mit.damping_range_nm_s_rad], 12);
        let t = encode(self.torque_nm, about_zero(mit.torque_range_nm), 12);
        let [p, v, kp, kd, t] = [p, v, kp, kd, t].map(u64::from);
        (p << 48 | v << 36 | kp << 24 | kd << 12 | t).to_be_bytes()
    }

    /// Reads a command that is no special one.
    #[must_use]
    pub fn parse(bytes: [u8; 8], mit: &Mit) -> Self {
        let all = u64::from_be_bytes(bytes);
        let field = |shift: u32, mask: u64| u32::try_from((all >> shift) & mask).unwrap_or(0);
        Self {
            position_rad: decode(field(48, 0xFFFF), about_zero(mit.position_range_rad), 16),
            velocity_rad_s: decode(field(36, 0xFFF), about_zero(mit.velocity_range_rad_s), 12),
            stiffness_nm_rad: decode(field(24, 0xFFF), [0.0, mit.stiffness_range_nm_rad], 12),
            damping_nm_s_rad: decode(field(12, 0xFFF), [0.0, mit.damping_range_nm_s_rad], 12),
            torque_nm: decode(field(0, 0xFFF), about_zero(mit.torque_range_nm), 12),
        }
    }
}

/// What a motor answers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reply {
    /// First byte: motor id; Damiao: status in its upper half.
    pub head: u8,
    /// Position at the output, rad.
    pub position_rad: f64,
    /// Velocity, rad/s.
    pub velocity_rad_s: f64,
    /// Measured torque, Nm.
    pub torque_nm: f64,
    /// Two bytes more, where there are: temperature, and error (CubeMars) or another temperature.
    pub tail: Option<[u8; 2]>,
}

impl Reply {
    /// Reads it; `None` at any other length than 6 or 8.
    #[must_use]
    pub fn parse(payload: &[u8], mit: &Mit) -> Option<Self> {
        let (first, tail) = match payload {
            [first @ .., a, b] if payload.len() == 8 => (first, Some([*a, *b])),
            all => (all, None),
        };
        let [head, p1, p0, v1, vt, t0] = *first else { return None };
        let position = u32::from(p1) << 8 | u32::from(p0);
        let velocity = u32::from(v1) << 4 | u32::from(vt) >> 4;
        let torque = (u32::from(vt) & 0xF) << 8 | u32::from(t0);
        Some(Self {
            head,
            position_rad: decode(position, about_zero(mit.position_range_rad), 16),
            velocity_rad_s: decode(velocity, about_zero(mit.velocity_range_rad_s), 12),
            torque_nm: decode(torque, about_zero(mit.torque_range_nm), 12),
            tail,
        })
    }

    /// Its bytes: the first six, or all eight.
    #[must_use]
    pub fn emit(&self, mit: &Mit) -> ([u8; 8], usize) {
        let [_, _, p1, p0] = encode(self.position_rad, about_zero(mit.position_range_rad), 16).to_be_bytes();
        let velocity = encode(self.velocity_rad_s, about_zero(mit.velocity_range_rad_s), 12);
        let torque = encode(self.torque_nm, about_zero(mit.torque_range_nm), 12);
        let [_, v1, vt, t0] = (velocity << 12 | torque).to_be_bytes();
        let [a, b] = self.tail.unwrap_or_default();
        ([self.head, p1, p0, v1, vt, t0, a, b], if self.tail.is_some() { 8 } else { 6 })
    }
}

/// Offsets of MyActuator's identifiers from the motor's number.
pub mod rmd {
    /// Ordinary command, and its answer.
    pub const COMMAND: u32 = 0x140;
    /// Answer to an ordinary command.
    pub const ANSWER: u32 = 0x240;
    /// Motion mode command.
    pub const MOTION: u32 = 0x400;
    /// Answer to a motion mode command.
    pub const MOTION_ANSWER: u32 = 0x500;
    /// Ordinary command: restart the device (about 1.1 s).
    pub const RESET: u8 = 0x76;
    /// Ordinary command: release the brake.
    pub const RELEASE_BRAKE: u8 = 0x77;
    /// Ordinary command: power off.
    pub const SHUT_DOWN: u8 = 0x80;
    /// Ordinary command: angle over several turns, 0.01 degrees in bytes 4 to 7.
    pub const ANGLE: u8 = 0x92;
    /// Ordinary command: errors in bytes 6 and 7.
    pub const STATUS: u8 = 0x9A;
    /// Ordinary command: date of the firmware, as a decimal number in bytes 4 to 7.
    pub const FIRMWARE_DATE: u8 = 0xB2;
    /// From this firmware on positions are coded over 12.566 rad.
    pub const WIDER_SINCE: u32 = 20_260_424;
}

/// Damiao's registers: identifier, and what is read at the start.
pub mod register {
    /// All motors hear it.
    pub const ID: u32 = 0x7FF;
    /// Third byte of a request and its answer.
    pub const READ: u8 = 0x33;
    /// Control mode: 1 = MIT.
    pub const CONTROL_MODE: u8 = 10;
    /// Position range, rad (float).
    pub const POSITION_RANGE: u8 = 21;
    /// Velocity range, rad/s.
    pub const VELOCITY_RANGE: u8 = 22;
    /// Torque range, Nm.
    pub const TORQUE_RANGE: u8 = 23;
    /// In the order of asking.
    pub const ALL: [u8; 4] = [CONTROL_MODE, POSITION_RANGE, VELOCITY_RANGE, TORQUE_RANGE];
}

impl Mit {
    /// Identifier of our commands.
    #[must_use]
    pub const fn command_id(&self, node: u8) -> u32 {
        match self.dialect {
            MitDialect::MyActuator => rmd::MOTION + node as u32,
            _ => node as u32,
        }
    }

    /// Identifier of its answers to them.
    #[must_use]
    pub const fn answer_id(&self, node: u8) -> u32 {
        match self.dialect {
            MitDialect::MyActuator => rmd::MOTION_ANSWER + node as u32,
            _ => self.reply_id as u32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn mit(velocity_range_rad_s: f64) -> Mit {
        Mit {
            dialect: MitDialect::MiniCheetah,
            reply_id: 0,
            position_range_rad: 12.5,
            velocity_range_rad_s,
            torque_range_nm: 18.0,
            stiffness_range_nm_rad: 500.0,
            damping_range_nm_s_rad: 5.0,
            counts_per_turn: 20_000.0,
            gains: [0.0; 2],
        }
    }

    /// Published by drivers of others, and recomputed.
    #[test]
    fn commands_are_those_of_the_reference() {
        let zero = Setpoint::default();
        assert_eq!(zero.emit(&mit(65.0)), [0x7F, 0xFF, 0x7F, 0xF0, 0x00, 0x00, 0x07, 0xFF]);
        let some = Setpoint {
            position_rad: 1.0,
            velocity_rad_s: 2.0,
            stiffness_nm_rad: 100.0,
            damping_nm_s_rad: 1.0,
            torque_nm: 3.0,
        };
        assert_eq!(some.emit(&mit(65.0)), [0x8A, 0x3C, 0x83, 0xE3, 0x33, 0x33, 0x39, 0x54]);
        let published = Setpoint {
            position_rad: 1.2345,
            velocity_rad_s: -0.5,
            stiffness_nm_rad: 130.0,
            damping_nm_s_rad: 3.0,
            torque_nm: 2.75,
        };
        assert_eq!(published.emit(&mit(45.0)), [0x8C, 0xA3, 0x7E, 0x84, 0x28, 0x99, 0x99, 0x38]);
        let torque = Setpoint { torque_nm: 5.0, ..zero };
        assert_eq!(torque.emit(&mit(50.0)), [0x7F, 0xFF, 0x7F, 0xF0, 0x00, 0x00, 0x0A, 0x38]);
        let damping = Setpoint { damping_nm_s_rad: 2.0, ..zero };
        assert_eq!(damping.emit(&mit(50.0)), [0x7F, 0xFF, 0x7F, 0xF0, 0x00, 0x66, 0x67, 0xFF]);
    }

    #[test]
    fn no_setpoint_is_a_special_command() {
        let (m, most) = (mit(65.0), f64::INFINITY);
        for torque_nm in [18.0, 17.999, 17.99, 17.98, 17.97, 17.96, 17.95] {
            let all = Setpoint {
                position_rad: most,
                velocity_rad_s: most,
                stiffness_nm_rad: most,
                damping_nm_s_rad: most,
                torque_nm,
            };
            assert_eq!(Special::parse(all.emit(&m)), None, "{torque_nm}");
        }
    }

    #[test]
    fn what_is_not_a_number_becomes_no_torque() {
        let wrong = Setpoint { torque_nm: f64::NAN, ..Setpoint::default() };
        assert_eq!(wrong.emit(&mit(65.0)), Setpoint::default().emit(&mit(65.0)));
    }

    proptest! {
        #[test]
        fn torque_and_position_survive_within_a_step(position_rad in -12.5..12.5, torque_nm in -18.0..18.0) {
            let m = mit(65.0);
            let back = Setpoint::parse(Setpoint { position_rad, torque_nm, ..Setpoint::default() }.emit(&m), &m);
            prop_assert!((back.torque_nm - torque_nm).abs() <= 36.0 / 4095.0);
            prop_assert!((back.position_rad - position_rad).abs() <= 25.0 / 65535.0);
        }

        #[test]
        fn answers_survive_the_round_trip_and_random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..=64)) {
            let m = mit(65.0);
            if let Some(reply) = Reply::parse(&bytes, &m) {
                let (emitted, len) = reply.emit(&m);
                prop_assert_eq!(&emitted[..len], &bytes[..]);
            } else {
                prop_assert!(bytes.len() != 6 && bytes.len() != 8);
            }
        }
    }
}
