//! What is written into a drive before it may run, as a list of steps (CiA 301 and 402, start-up of a CST or CSP drive).
//!
//! RT: the list is made before arming; walking it allocates nothing.
#![expect(clippy::disallowed_types, reason = "the list is made before arming")]

use crate::base::time::Span;
use crate::bus::canopen::{Node, Object};
use crate::bus::pdo::{self, Entry};
use crate::bus::sdo::{Address, SdoReply, SdoValue};
use crate::config::checked::{Cia402, DriveConfig, DriveMode, DriveProtocol, Trigger};

/// Why a drive is not in use. The number is told as the drive's error code: 0x0001 to 0x00FF are ours, since CiA 301
/// leaves all but 0x0000 of that range unused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum SetupFault {
    /// No boot-up message after the reset.
    NoBootUp = 0x01,
    /// The object server does not answer.
    NoAnswer = 0x02,
    /// It refused to read or write an object.
    Refused = 0x03,
    /// It is no CiA 402 device.
    WrongDevice = 0x04,
    /// It does not know the mode that we need.
    ModeUnsupported = 0x05,
    /// Its rated torque is not the configured one, so every torque would be scaled wrong.
    WrongRatedTorque = 0x06,
    /// It shows another mode than the one written.
    ModeRefused = 0x07,
    /// No process data after the start command.
    NotOperational = 0x08,
    /// Its heartbeat stopped.
    HeartbeatLost = 0x09,
    /// It left the operational state by itself.
    LeftOperational = 0x0A,
    /// It restarted in operation: its mapping is gone.
    Rebooted = 0x0B,
    /// The bus stalled; the drive is reset when it is back.
    BusStalled = 0x0C,
    /// It shows another torque than it was asked for.
    TorqueAstray = 0x0D,
    /// It shows that it follows commands although it was told to be off.
    StateAstray = 0x0E,
    /// It answers twice: two drives have one number.
    TwoNodes = 0x0F,
    /// Its ranges are not the configured ones, so every torque would be scaled wrong.
    WrongRange = 0x10,
    /// Its position jumps, or stands at the end of what can be coded.
    PositionAstray = 0x11,
}

/// What the value that was read must be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Check {
    /// Any value: the object is there.
    Present,
    /// Profile number 402 in the low half of the device type.
    Profile402,
    /// The bit of this mode in the supported modes.
    Supports(i8),
    /// Rated torque in mNm, within 1 %.
    RatedTorque(u32),
    /// The mode shown.
    ModeIs(i8),
}

/// One exchange with the object server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// Read and check.
    Read(Address, Check),
    /// Write; it must be accepted.
    Write(Address, SdoValue),
    /// Write, where a device without the object is fine.
    WriteIfPresent(Address, SdoValue),
}

impl Step {
    /// The object of the step.
    pub(super) const fn address(&self) -> Address {
        match self {
            Self::Read(address, _) | Self::Write(address, _) | Self::WriteIfPresent(address, _) => *address,
        }
    }

    /// Whether an answer ends the step well.
    pub(super) fn judge(&self, reply: &SdoReply) -> Result<(), SetupFault> {
        match (self, reply) {
            (Self::Read(_, check), SdoReply::Value(_, value)) => check.judge(value.raw()),
            (Self::Write(..) | Self::WriteIfPresent(..), SdoReply::Written(_)) => Ok(()),
            (Self::WriteIfPresent(..), SdoReply::Abort(_, code)) if code.is_missing_object() => Ok(()),
            _ => Err(SetupFault::Refused),
        }
    }
}

impl Check {
    fn judge(self, raw: u32) -> Result<(), SetupFault> {
        let (fine, fault) = match self {
            Self::Present => (true, SetupFault::Refused),
            Self::Profile402 => (raw & 0xFFFF == 402, SetupFault::WrongDevice),
            Self::Supports(mode) => ((raw >> (mode - 1)) & 1 == 1, SetupFault::ModeUnsupported),
            Self::RatedTorque(mnm) => (raw.abs_diff(mnm) <= mnm.div_ceil(100), SetupFault::WrongRatedTorque),
            Self::ModeIs(mode) => (raw & 0xFF == u32::from(mode.cast_unsigned()), SetupFault::ModeRefused),
        };
        if fine { Ok(()) } else { Err(fault) }
    }
}

/// CiA 402 number of a drive's mode.
pub(super) const fn mode_number(drive: &DriveConfig) -> i8 {
    match (drive.mode, &drive.protocol) {
        (DriveMode::CyclicTorque, DriveProtocol::Cia402(Cia402 { profile_torque: true })) => 4,
        (DriveMode::CyclicTorque, _) => 10,
        (DriveMode::CyclicPosition, _) => 8,
    }
}

/// Torque that the drive may use at most, 1/1000 of rated.
pub(super) const TORQUE_LIMIT: Address = Address::new(0x6072, 0);

/// All steps for one drive, in order.
pub(super) fn steps(drive: &DriveConfig, node: Node, period: Span, trigger: Trigger) -> Box<[Step]> {
    let mode = mode_number(drive);
    let mut list = identity(mode, rated_torque_mnm(drive));
    list.extend(supervision(drive));
    list.extend(process_data(drive, node, trigger));
    list.extend(operation(drive, mode, period));
    list.into_boxed_slice()
}

/// Rated torque as object 0x6076 tells it.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked configuration: positive, small")]
fn rated_torque_mnm(drive: &DriveConfig) -> u32 {
    libm::round(drive.rated_torque_nm * 1e3) as u32
}

/// Is it the device that we think it is?
fn identity(mode: i8, rated_torque_mnm: u32) -> Vec<Step> {
    vec_of([
        Step::Read(Address::new(0x1000, 0), Check::Profile402),
        Step::Read(Address::new(0x1018, 1), Check::Present),
        Step::Read(Address::new(0x6502, 0), Check::Supports(mode)),
        Step::Read(Address::new(0x6076, 0), Check::RatedTorque(rated_torque_mnm)),
    ])
}

/// We watch the drive, the drive watches us, and without us it takes the voltage off.
fn supervision(drive: &DriveConfig) -> Vec<Step> {
    const DISABLE_VOLTAGE: i16 = 2;
    let consumer = u32::from(Node::MASTER.number()) << 16 | u32::from(milliseconds(drive.watchdog));
    vec_of([
        Step::Write(Address::new(0x1017, 0), SdoValue::u16(milliseconds(drive.heartbeat))),
        Step::Write(Address::new(0x1016, 1), SdoValue::u32(consumer)),
        Step::Write(Address::new(0x6007, 0), SdoValue::i16(DISABLE_VOLTAGE)),
    ])
}

fn process_data(drive: &DriveConfig, node: Node, trigger: Trigger) -> Vec<Step> {
    let (command, answer) = match drive.mode {
        DriveMode::CyclicTorque => (pdo::TORQUE_COMMAND, pdo::TORQUE_ANSWER),
        DriveMode::CyclicPosition => (pdo::POSITION_COMMAND, pdo::POSITION_ANSWER),
    };
    // With SYNC at the end of our commands, a command acts at that SYNC; with SYNC at the timer, on arrival.
    let command_type = if trigger == Trigger::Timer { 1 } else { 255 };
    let timeout = Step::WriteIfPresent(Address::new(0x1400, 5), SdoValue::u16(milliseconds(drive.watchdog)));
    let mut list = mapping(0x1400, 0x1600, Object::Rpdo(1, node).id(), command_type, command, Some(timeout));
    list.extend(mapping(0x1800, 0x1A00, Object::Tpdo(1, node).id(), drive.sync_divisor, answer, None));
    // Makers switch further answers on by default; they would not fit the bus.
    for (k, index) in [(2, 0x1801), (3, 0x1802), (4, 0x1803)] {
        let off = PDO_OFF | u32::from(Object::Tpdo(k, node).id());
        list.push(Step::WriteIfPresent(Address::new(index, 1), SdoValue::u32(off)));
    }
    list
}

/// Bit 31 of a PDO's identifier: not in use.
const PDO_OFF: u32 = 0x8000_0000;

/// Switches one PDO off, maps it, switches it on, in the order that CiA 301 asks for.
fn mapping(comm: u16, map: u16, id: u16, kind: u8, entries: &[Entry], timeout: Option<Step>) -> Vec<Step> {
    let id = u32::from(id);
    let mut list = vec_of([
        Step::Write(Address::new(comm, 1), SdoValue::u32(PDO_OFF | id)),
        Step::Write(Address::new(comm, 2), SdoValue::u8(kind)),
    ]);
    list.extend(timeout);
    list.push(Step::Write(Address::new(map, 0), SdoValue::u8(0)));
    let mut count = 0;
    for entry in entries {
        count += 1;
        list.push(Step::Write(Address::new(map, count), SdoValue::u32(entry.raw())));
    }
    list.push(Step::Write(Address::new(map, 0), SdoValue::u8(count)));
    list.push(Step::Write(Address::new(comm, 1), SdoValue::u32(id)));
    list
}

/// Slope of profile torque, 1/1000 of rated per s: ten times rated torque in 1 ms.
const TORQUE_SLOPE: u32 = 10_000_000;

/// Interpolation time, limit and mode.
fn operation(drive: &DriveConfig, mode: i8, period: Span) -> Vec<Step> {
    let (value, exponent) = interpolation_time(Span(period.0 * i64::from(drive.sync_divisor)));
    vec_of([
        Step::WriteIfPresent(Address::new(0x60C2, 1), SdoValue::u8(value)),
        Step::WriteIfPresent(Address::new(0x60C2, 2), SdoValue::i8(exponent)),
        Step::Write(TORQUE_LIMIT, SdoValue::u16(first_torque_limit(drive))),
        // Profile torque ramps to its target; the ramps are ours, so let its own be the steepest.
        Step::WriteIfPresent(Address::new(0x6087, 0), SdoValue::u32(TORQUE_SLOPE)),
        Step::Write(Address::new(0x6060, 0), SdoValue::i8(mode)),
        Step::Read(Address::new(0x6061, 0), Check::ModeIs(mode)),
    ])
}

/// A position drive gets its torque in operation, once it is known where its zero is; before, it could run into a stop.
const fn first_torque_limit(drive: &DriveConfig) -> u16 {
    match drive.mode {
        DriveMode::CyclicTorque => drive.max_torque_permille,
        DriveMode::CyclicPosition => 0,
    }
}

/// Value and power of ten of a time in seconds that fits one byte, as exact as that allows.
fn interpolation_time(time: Span) -> (u8, i8) {
    for (unit_ns, exponent) in [(10_000, -5), (100_000, -4), (1_000_000, -3), (10_000_000, -2)] {
        if let (0, Ok(value)) = (time.0 % unit_ns, u8::try_from(time.0 / unit_ns)) {
            return (value, exponent);
        }
    }
    (u8::try_from(time.0 / 1_000_000).unwrap_or(u8::MAX), -3)
}

fn milliseconds(span: Span) -> u16 {
    u16::try_from(span.0 / 1_000_000).unwrap_or(u16::MAX)
}

/// A list that can grow.
fn vec_of<const N: usize>(steps: [Step; N]) -> Vec<Step> {
    steps.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolation_time_is_exact_for_usual_periods() {
        assert_eq!(interpolation_time(Span::from_ms(1)), (100, -5));
        assert_eq!(interpolation_time(Span::from_ms(4)), (40, -4));
        assert_eq!(interpolation_time(Span::from_us(250)), (25, -5));
        assert_eq!(interpolation_time(Span::from_ms(1000)), (100, -2));
    }

    #[test]
    fn a_rated_torque_off_by_more_than_a_percent_is_refused() {
        assert_eq!(Check::RatedTorque(500).judge(505), Ok(()));
        assert_eq!(Check::RatedTorque(500).judge(506), Err(SetupFault::WrongRatedTorque));
    }

    #[test]
    fn torque_mode_is_bit_nine_of_the_supported_modes() {
        assert_eq!(Check::Supports(10).judge(1 << 9), Ok(()));
        assert_eq!(Check::Supports(10).judge(!(1 << 9)), Err(SetupFault::ModeUnsupported));
    }

    #[test]
    fn a_pdo_is_off_while_it_is_mapped() {
        let list = mapping(0x1400, 0x1600, 0x203, 1, pdo::TORQUE_COMMAND, None);
        assert_eq!(list.first(), Some(&Step::Write(Address::new(0x1400, 1), SdoValue::u32(0x8000_0203))));
        assert_eq!(list.last(), Some(&Step::Write(Address::new(0x1400, 1), SdoValue::u32(0x203))));
        assert_eq!(list[2], Step::Write(Address::new(0x1600, 0), SdoValue::u8(0)));
        assert_eq!(list[5], Step::Write(Address::new(0x1600, 0), SdoValue::u8(2)));
    }
}
