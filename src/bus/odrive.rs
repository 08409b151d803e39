//! ODrive CANSimple: frames of 11-bit identifiers, node << 5 | command, little endian. Both ends. RT: yes.
//!
//! Any message to the node feeds its watchdog, remote requests too: so nothing is sent to it but by the control thread.

use crate::base::bytes::padded;
use crate::config::checked::OdriveFirmware;
use crate::msg::CanFrame;

/// Version; asked for by a remote request.
pub const VERSION: u32 = 0x00;
/// State and errors, by itself.
pub const HEARTBEAT: u32 = 0x01;
/// Emergency stop.
pub const STOP: u32 = 0x02;
/// Firmware 0.6: active errors and disarm reason.
pub const ERRORS: u32 = 0x03;
/// Axis state wanted.
pub const SET_STATE: u32 = 0x07;
/// Position and velocity, by itself.
pub const ENCODER: u32 = 0x09;
/// Control and input mode.
pub const MODE: u32 = 0x0B;
/// Position wanted.
pub const INPUT_POSITION: u32 = 0x0C;
/// Torque wanted.
pub const INPUT_TORQUE: u32 = 0x0E;
/// Velocity and current limits.
pub const LIMITS: u32 = 0x0F;
/// Currents wanted and measured, by itself.
pub const CURRENT: u32 = 0x14;
/// Errors be forgotten.
pub const CLEAR: u32 = 0x18;
/// Torques wanted and estimated, by itself (firmware 0.6).
pub const TORQUE: u32 = 0x1C;

/// Axis state: no power.
pub const IDLE: u8 = 1;
/// Axis state: follows commands.
pub const CLOSED_LOOP: u8 = 8;
/// Control mode: torque.
pub const CONTROL_TORQUE: u32 = 1;
/// Control mode: position.
pub const CONTROL_POSITION: u32 = 3;
/// Input mode: commands act at once.
pub const PASS_THROUGH: u32 = 1;
/// Error of firmware 0.5 when the watchdog expires; 0.6: disarm reason.
pub const WATCHDOG_V5: u32 = 0x800;
/// Disarm reason of firmware 0.6 when the watchdog expires.
pub const WATCHDOG_V6: u32 = 0x0100_0000;

/// Identifier of a command.
#[must_use]
pub const fn id(node: u8, command: u32) -> u32 {
    (node as u32) << 5 | command
}

/// A frame with up to 8 bytes.
#[must_use]
pub fn frame(node: u8, command: u32, payload: &[u8]) -> CanFrame {
    CanFrame::classic(id(node, command), payload)
}

/// A frame with two numbers of four bytes.
#[must_use]
pub fn pair(node: u8, command: u32, first: [u8; 4], second: [u8; 4]) -> CanFrame {
    let ([a, b, c, d], [e, f, g, h]) = (first, second);
    frame(node, command, &[a, b, c, d, e, f, g, h])
}

/// The question for a value: a remote request.
#[must_use]
pub const fn question(node: u8, command: u32) -> CanFrame {
    CanFrame::empty(id(node, command) | CanFrame::REMOTE)
}

/// The two floats of an 8-byte message.
#[must_use]
pub fn floats(payload: &[u8]) -> Option<[f32; 2]> {
    let [a, b, c, d, e, f, g, h]: [u8; 8] = payload.try_into().ok()?;
    Some([f32::from_le_bytes([a, b, c, d]), f32::from_le_bytes([e, f, g, h])])
}

/// A whole number in the first four bytes of a message with at least those.
#[must_use]
pub fn number(payload: &[u8]) -> Option<u32> {
    (payload.len() >= 4).then(|| u32::from_le_bytes(padded(payload)))
}

/// Heartbeat.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Heartbeat {
    /// Axis error bits.
    pub error: u32,
    /// Axis state.
    pub state: u8,
    /// 0.5: flags that motor, encoder or controller have errors. 0.6: result of the last procedure, trajectory done.
    pub rest: [u8; 3],
}

impl Heartbeat {
    /// Reads it; `None` at any other length than 8.
    #[must_use]
    pub fn parse(payload: &[u8]) -> Option<Self> {
        let [a, b, c, d, state, e, f, g]: [u8; 8] = payload.try_into().ok()?;
        Some(Self { error: u32::from_le_bytes([a, b, c, d]), state, rest: [e, f, g] })
    }

    /// Its bytes.
    #[must_use]
    pub fn emit(&self) -> [u8; 8] {
        let ([a, b, c, d], [e, f, g]) = (self.error.to_le_bytes(), self.rest);
        [a, b, c, d, self.state, e, f, g]
    }

    /// Number of the lowest error: 0 = none, k + 1 = bit k; 33, 34, 35: firmware 0.5 flags motor, encoder, controller.
    #[must_use]
    pub fn fault(&self, firmware: OdriveFirmware) -> u16 {
        let [motor, encoder, controller] = self.rest;
        // Bit 7 of the controller's flags says that the trajectory is done.
        let flags = [motor != 0, encoder != 0, controller & 0x7F != 0];
        match (lowest_bit(self.error), firmware) {
            (0, OdriveFirmware::V5) => (33..).zip(flags).find(|(_, flag)| *flag).map_or(0, |(number, _)| number),
            (number, _) => number,
        }
    }
}

/// Number of the lowest bit set, from 1; 0 = none.
#[must_use]
pub fn lowest_bit(bits: u32) -> u16 {
    if bits == 0 { 0 } else { u16::try_from(bits.trailing_zeros()).unwrap_or(0) + 1 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn frames_are_those_of_the_reference() {
        let torque = frame(3, INPUT_TORQUE, &1.5_f32.to_le_bytes());
        assert_eq!(torque, CanFrame::new(0x06E, &[0x00, 0x00, 0xC0, 0x3F]));
        let encoder = pair(3, ENCODER, 0.25_f32.to_le_bytes(), (-1.0_f32).to_le_bytes());
        assert_eq!(encoder, CanFrame::new(0x069, &[0x00, 0x00, 0x80, 0x3E, 0x00, 0x00, 0x80, 0xBF]));
        assert_eq!(floats(encoder.payload()), Some([0.25, -1.0]));
        assert_eq!(question(3, VERSION).id, 0x4000_0060);
    }

    #[test]
    fn errors_are_told_by_their_lowest_bit_and_the_flags_of_old_firmware() {
        let watchdog = Heartbeat { error: WATCHDOG_V5, state: IDLE, rest: [0; 3] };
        assert_eq!(watchdog.fault(OdriveFirmware::V5), 12);
        let encoder = Heartbeat { error: 0, state: IDLE, rest: [0, 1, 0x80] };
        assert_eq!((encoder.fault(OdriveFirmware::V5), encoder.fault(OdriveFirmware::V6)), (34, 0));
        let done = Heartbeat { error: 0, state: CLOSED_LOOP, rest: [0, 0, 0x80] };
        assert_eq!(done.fault(OdriveFirmware::V5), 0);
    }

    proptest! {
        #[test]
        fn heartbeats_survive_the_round_trip_and_random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..=64)) {
            prop_assert_eq!(floats(&bytes).is_some(), bytes.len() == 8);
            prop_assert_eq!(number(&bytes).is_some(), bytes.len() >= 4);
            match Heartbeat::parse(&bytes) {
                Some(heartbeat) => prop_assert_eq!(&heartbeat.emit()[..], &bytes[..]),
                None => prop_assert!(bytes.len() != 8),
            }
        }
    }
}
