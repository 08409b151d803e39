//! The simulated drives: each speaks its protocol's bytes and knows nothing but frames and its shaft. RT: no.

pub mod cia402;
pub mod direct;
mod mit;
mod moteus;
mod odrive;

use crate::base::time::{Span, Stamp};
use crate::bus::cia402::State;
use crate::config::checked::{DriveConfig, DriveProtocol};
use crate::msg::CanFrame;
use cia402::Cia402Drive;
use direct::DirectDrive;

/// What can be broken on purpose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// Says nothing at all, as with its cable pulled; hears nothing either.
    pub unplugged: bool,
    /// Its object server does not answer.
    pub mute_server: bool,
    /// Does not know the torque mode.
    pub no_torque_mode: bool,
    /// Sends no heartbeat.
    pub no_heartbeat: bool,
    /// Makes no torque although it says that it is enabled.
    pub no_torque: bool,
    /// Answers every second time twice, as two drives with one number would.
    pub twice: bool,
    /// Answers nothing, but hears and acts.
    pub no_answer: bool,
    /// MIT: answers with another motor's number.
    pub wrong_number: bool,
    /// MIT: its ranges are not those of the configuration: of `torque` alone, or of another `motor`; empty = they are.
    pub wrong_ranges: &'static str,
    /// ODrive: its encoder message stops while its heartbeat goes on.
    pub no_encoder: bool,
    /// moteus: its position is not set.
    pub no_position: bool,
    /// moteus: refuses to be read.
    pub refuses: bool,
    /// moteus: answers every read with an error sub-frame.
    pub read_errors: bool,
    /// What its object server does instead of answering: `silent`, `abort`, `wrong_index`; empty = it answers.
    pub server: &'static str,
    /// Fell back to the default mapping of its `answer` or of the `command`; empty = neither.
    pub mapping_lost: &'static str,
    /// Its answers are not as long as they should be.
    pub short_answers: bool,
    /// MIT: stands near the end of its range, beyond which its position wraps round.
    pub wraps: bool,
    /// ODrive: speaks as the other firmware does.
    pub other_dialect: bool,
}

impl Defects {
    /// MIT: its ranges are not those of the configuration.
    const fn has_wrong_ranges(&self) -> bool {
        !self.wrong_ranges.is_empty()
    }
}

/// What a frame asks of the drive that it is for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Asked {
    /// A drive that has none gets power by it.
    pub powers: bool,
    /// What a drive that has power does about it.
    pub motion: Motion,
}

/// What a drive is asked to do, before any limit of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// Be without power.
    Off,
    /// Make this torque, 1/1000 of rated.
    Torque(f64),
    /// Go to this place.
    Position {
        /// Where, in the drive's own counts.
        counts: f64,
        /// With at most this torque, 1/1000 of rated; `None` = the protocol says it elsewhere or not at all.
        most_permille: Option<f64>,
    },
}

/// The electrical side of a drive, in 1/1000 of rated torque.
#[derive(Clone, Copy, Debug)]
pub(super) struct Electrics {
    /// First-order lag of the current loop, s; 0 = none.
    pub(super) lag_s: f64,
    /// The current loop takes a new target so late.
    pub(super) delay: Span,
    /// What the current limit allows.
    pub(super) limit_permille: f64,
}

impl Electrics {
    /// Lets the current loop run for `dt` towards `target` and gives the mean torque of that time.
    fn run(&self, torque: &mut f64, target: f64, dt: Span) -> f64 {
        let (start, lag_s, dt_s) = (*torque, self.lag_s, dt.as_s());
        if lag_s <= 0.0 || dt_s <= 0.0 {
            *torque = target;
            return target;
        }
        // Exact for a constant target: i(t) = target + (start - target) exp(-t / lag), and its mean.
        let left = libm::exp(-dt_s / lag_s);
        *torque = target + (start - target) * left;
        target + (start - target) * (1.0 - left) * lag_s / dt_s
    }
}

/// A drive, whatever it speaks.
#[derive(Clone, Debug)]
pub enum SimDrive {
    /// CANopen, CiA 402.
    Cia402(Box<Cia402Drive>),
    /// MIT, ODrive, moteus.
    Direct(Box<DirectDrive>),
}

impl SimDrive {
    pub(super) fn new(config: &DriveConfig, electrics: Electrics) -> Self {
        match config.protocol {
            DriveProtocol::Cia402(_) => Self::Cia402(Box::new(Cia402Drive::new(config, electrics))),
            _ => Self::Direct(Box::new(DirectDrive::new(config, electrics))),
        }
    }

    /// True if it reads its encoder whenever it likes, not at SYNC.
    #[must_use]
    pub const fn samples_by_itself(&self) -> bool {
        matches!(self, Self::Direct(_))
    }

    /// What can be broken on purpose.
    pub fn defects_mut(&mut self) -> &mut Defects {
        match self {
            Self::Cia402(drive) => &mut drive.defects,
            Self::Direct(drive) => &mut drive.defects,
        }
    }

    /// Its power state in the words of CiA 402.
    #[must_use]
    pub fn state(&self) -> State {
        match self {
            Self::Cia402(drive) => drive.state(),
            Self::Direct(drive) => drive.state(),
        }
    }

    /// Torque that the motor makes, 1/1000 of rated.
    #[must_use]
    pub fn torque_permille(&self) -> f64 {
        match self {
            Self::Cia402(drive) => drive.torque_permille(),
            Self::Direct(drive) => drive.torque_permille(),
        }
    }

    /// Position that its loop drives to, counts; `None` while it has no power or no such mode.
    #[must_use]
    pub fn target_counts(&self) -> Option<i32> {
        match self {
            Self::Cia402(drive) => drive.target_counts(),
            Self::Direct(drive) => drive.target_counts(),
        }
    }

    /// Lets the current loop run for `dt` and gives the mean torque of that time, 1/1000 of rated.
    pub fn run_current_loop(&mut self, dt: Span) -> f64 {
        match self {
            Self::Cia402(drive) => drive.run_current_loop(dt),
            Self::Direct(drive) => drive.run_current_loop(dt),
        }
    }

    /// To be called after whatever may have changed its command.
    pub(super) fn note_command(&mut self, now: Stamp) {
        match self {
            Self::Cia402(drive) => drive.note_command(now),
            Self::Direct(drive) => drive.note_command(now),
        }
    }

    /// When a delayed command takes effect, if one is on its way.
    pub(super) fn next_torque(&self) -> Option<Stamp> {
        match self {
            Self::Cia402(drive) => drive.next_torque(),
            Self::Direct(drive) => drive.next_torque(),
        }
    }

    /// The delayed commands due by now take effect.
    pub(super) fn take_torque(&mut self, now: Stamp) {
        match self {
            Self::Cia402(drive) => drive.take_torque(now),
            Self::Direct(drive) => drive.take_torque(now),
        }
    }

    /// The encoder's count.
    pub fn set_position(&mut self, counts: i32) {
        match self {
            Self::Cia402(drive) => drive.set_position(counts),
            Self::Direct(drive) => drive.set_position(counts),
        }
    }

    /// The analogue input's count.
    pub fn set_analog(&mut self, counts: i16) {
        match self {
            Self::Cia402(drive) => drive.set_analog(counts),
            // It has no such input.
            Self::Direct(_) => {}
        }
    }

    /// A frame on its bus; what it answers goes to `out`. True if it was a command to this drive.
    pub fn hear(&mut self, now: Stamp, frame: &CanFrame, out: &mut Vec<CanFrame>) -> bool {
        match self {
            Self::Cia402(drive) => drive.hear(now, frame, out),
            Self::Direct(drive) => drive.hear(now, frame, out),
        }
    }

    /// A drive on no bus, in which frames are read: [`Self::asked`].
    #[must_use]
    pub fn reader(config: &DriveConfig) -> Self {
        Self::new(config, Electrics { lag_s: 0.0, delay: Span::ZERO, limit_permille: f64::INFINITY })
    }

    /// What this frame asks of the drive, read as the drive itself reads it; `None` if it is no command to it.
    pub fn asked(&mut self, frame: &CanFrame) -> Option<Asked> {
        match self {
            Self::Cia402(drive) => drive.asked(frame),
            Self::Direct(drive) => drive.asked(frame),
        }
    }

    /// What it does by itself. To be called once per millisecond.
    pub fn tick(&mut self, now: Stamp, out: &mut Vec<CanFrame>) {
        match self {
            Self::Cia402(drive) => drive.tick(now, out),
            Self::Direct(drive) => drive.tick(now, out),
        }
    }

    /// Cold start, as after a loss of power.
    pub fn reboot(&mut self, now: Stamp) {
        match self {
            Self::Cia402(drive) => drive.reboot(now),
            Self::Direct(drive) => drive.reboot(now),
        }
    }

    /// Its statusword stays as it is, whatever it does; `no_power`: it switches itself off behind that.
    pub fn stick(&mut self, stuck: bool, no_power: bool) {
        match self {
            Self::Cia402(drive) => drive.stick(stuck, no_power),
            // They have no statusword.
            Self::Direct(_) => {}
        }
    }

    /// Its watchdog bites, whatever it heard.
    pub fn time_out(&mut self) {
        match self {
            // Their watchdogs are timers on what they hear.
            Self::Cia402(_) => {}
            Self::Direct(drive) => drive.time_out(),
        }
    }

    /// Goes off, and holds a command of full torque for when it is on again.
    pub fn hold_full_torque(&mut self) {
        match self {
            Self::Cia402(_) => {}
            Self::Direct(drive) => drive.hold_full_torque(),
        }
    }

    /// A fault of its own: it shouts, stops, and stays faulted until reset.
    pub fn fail(&mut self, code: u16, out: &mut Vec<CanFrame>) {
        match self {
            Self::Cia402(drive) => drive.fail(code, out),
            Self::Direct(drive) => drive.fail(code, out),
        }
    }
}
