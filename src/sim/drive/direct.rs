//! Simulated drives that are commanded frame by frame: a motor, and a face for each protocol. RT: no.

use super::mit::MitFace;
use super::moteus::MoteusFace;
use super::odrive::OdriveFace;
use super::{Asked, Defects, Electrics, Motion};
use crate::base::time::{Span, Stamp};
use crate::bus::cia402::State;
use crate::config::checked::{DriveConfig, DriveMode, DriveProtocol};
use crate::msg::CanFrame;
use crate::sim::torque_delay::TorqueDelay;

/// From power to the first word.
const BOOT_TIME: Span = Span::from_ms(40);

/// What the motor is driven to.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) enum Target {
    /// Nothing: no power.
    #[default]
    Off,
    /// A torque, Nm.
    Torque(f64),
    /// A position, turns, with at most this torque, Nm, if the command says so.
    Position(f64, Option<f64>),
}

/// Motor, encoder and current loop.
#[derive(Clone, Debug)]
pub(super) struct Motor {
    electrics: Electrics,
    rated_nm: f64,
    limit_permille: f64,
    counts_per_turn: f64,
    pub(super) target: Target,
    torque_permille: f64,
    delay: TorqueDelay,
    /// Where the shaft is, counts from an origin of the world's, and where the drive began to count.
    shaft_counts: i32,
    count_zero: i32,
    before: Option<(Stamp, i32)>,
    velocity_turns_s: f64,
}

impl Motor {
    /// Position, turns.
    pub(super) fn turns(&self) -> f64 {
        f64::from(self.shaft_counts - self.count_zero) / self.counts_per_turn
    }

    /// Velocity over the last ms or more, turns/s.
    pub(super) const fn velocity_turns_s(&self) -> f64 {
        self.velocity_turns_s
    }

    /// Torque that it makes, Nm.
    pub(super) fn torque_nm(&self) -> f64 {
        1e-3 * self.torque_permille * self.rated_nm
    }

    fn observe(&mut self, now: Stamp) {
        let (at, counts) = *self.before.get_or_insert((now, self.shaft_counts));
        let dt_s = now.since(at).as_s();
        if dt_s >= 1e-3 {
            self.velocity_turns_s = f64::from(self.shaft_counts - counts) / self.counts_per_turn / dt_s;
            self.before = Some((now, self.shaft_counts));
        }
    }

    fn torque_target_permille(&self) -> f64 {
        match self.target {
            Target::Torque(nm) if nm.is_finite() => {
                let limit = self.limit_permille.min(self.electrics.limit_permille);
                (1e3 * nm / self.rated_nm).clamp(-limit, limit)
            }
            Target::Off | Target::Torque(_) | Target::Position(..) => 0.0,
        }
    }
}

/// What a protocol's face must do.
pub(super) trait Face {
    /// A frame on the bus. True if it was a command to this drive.
    fn hear(&mut self, now: Stamp, frame: &CanFrame, motor: &mut Motor, bench: &mut Bench<'_>) -> bool;
    /// Has power, or not, without a fault and with no command in its memory.
    fn set_power(&mut self, on: bool);
    /// Once a ms: watchdog, words of its own.
    fn tick(&mut self, now: Stamp, motor: &mut Motor, bench: &mut Bench<'_>);
    /// Power was lost: all is forgotten.
    fn reset(&mut self);
    /// A fault of its own, with the low byte of the code.
    fn fail(&mut self, code: u8);
    /// Its watchdog bites.
    fn time_out(&mut self);
    /// Its power state in the words of CiA 402.
    fn state(&self) -> State;
}

/// What surrounds a face: what is broken, where answers go.
pub(super) struct Bench<'a> {
    /// What is broken.
    pub(super) defects: Defects,
    out: &'a mut Vec<CanFrame>,
}

impl Bench<'_> {
    /// Says something of its own.
    pub(super) fn say(&mut self, frame: CanFrame) {
        if !self.defects.unplugged {
            self.out.push(frame);
        }
    }

    /// Answers a command.
    pub(super) fn answer(&mut self, mut frame: CanFrame) {
        if self.defects.no_answer {
            return;
        }
        if self.defects.short_answers {
            frame.len = if frame.len > 6 { 6 } else { 8 };
        }
        self.say(frame);
        if self.defects.twice {
            self.say(frame);
        }
    }
}

#[derive(Clone, Debug)]
enum Faces {
    Mit(MitFace),
    Odrive(OdriveFace),
    Moteus(MoteusFace),
}

impl Faces {
    fn get(&mut self) -> &mut dyn Face {
        match self {
            Self::Mit(face) => face,
            Self::Odrive(face) => face,
            Self::Moteus(face) => face,
        }
    }
}

/// A drive.
#[derive(Clone, Debug)]
pub struct DirectDrive {
    /// What is broken.
    pub defects: Defects,
    motor: Motor,
    face: Faces,
    booting_until: Option<Stamp>,
    mode: DriveMode,
}

impl DirectDrive {
    pub(super) fn new(config: &DriveConfig, electrics: Electrics) -> Self {
        let (face, counts_per_turn) = match config.protocol {
            DriveProtocol::Mit(mit) => (Faces::Mit(MitFace::new(mit, config)), mit.counts_per_turn),
            DriveProtocol::Moteus(moteus) => (Faces::Moteus(MoteusFace::new(config.node)), moteus.counts_per_turn),
            DriveProtocol::Odrive(odrive) => (Faces::Odrive(OdriveFace::new(odrive, config)), odrive.counts_per_turn),
            DriveProtocol::Cia402(_) => unreachable!("made by the other kind"),
        };
        let motor = Motor {
            electrics,
            rated_nm: config.rated_torque_nm,
            limit_permille: f64::from(config.max_torque_permille),
            counts_per_turn,
            target: Target::Off,
            torque_permille: 0.0,
            delay: TorqueDelay::new(electrics.delay),
            shaft_counts: 0,
            count_zero: 0,
            before: None,
            velocity_turns_s: 0.0,
        };
        let booting_until = Some(Stamp::default() + BOOT_TIME);
        Self { defects: Defects::default(), motor, face, booting_until, mode: config.mode }
    }

    /// Its power state in the words of CiA 402.
    #[must_use]
    pub fn state(&self) -> State {
        if self.booting_until.is_some() {
            return State::NotReady;
        }
        match &self.face {
            Faces::Mit(face) => face.state(),
            Faces::Odrive(face) => face.state(),
            Faces::Moteus(face) => face.state(),
        }
    }

    /// Torque that the motor makes, 1/1000 of rated.
    #[must_use]
    pub const fn torque_permille(&self) -> f64 {
        self.motor.torque_permille
    }

    /// Position that its loop drives to, counts from the world's origin.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "a stroke of some turns")]
    pub fn target_counts(&self) -> Option<i32> {
        match self.motor.target {
            Target::Position(turns, _) if self.mode == DriveMode::CyclicPosition => {
                Some((libm::round(turns * self.motor.counts_per_turn) as i32).saturating_add(self.motor.count_zero))
            }
            _ => None,
        }
    }

    /// Lets the current loop run for `dt` and gives the mean torque of that time, 1/1000 of rated.
    pub fn run_current_loop(&mut self, dt: Span) -> f64 {
        let target = self.motor.delay.present(self.motor.torque_target_permille());
        let target = if self.defects.no_torque { 0.0 } else { target };
        self.motor.electrics.run(&mut self.motor.torque_permille, target, dt)
    }

    /// To be called after whatever may have changed its command.
    pub(super) fn note_command(&mut self, now: Stamp) {
        let target = (self.motor.target != Target::Off).then(|| self.motor.torque_target_permille());
        self.motor.delay.note(now, target);
    }

    /// When a delayed command takes effect, if one is on its way.
    pub(super) fn next_torque(&self) -> Option<Stamp> {
        self.motor.delay.next()
    }

    /// The delayed commands due by now take effect.
    pub(super) fn take_torque(&mut self, now: Stamp) {
        self.motor.delay.arrive(now);
    }

    /// The encoder's count.
    pub const fn set_position(&mut self, counts: i32) {
        self.motor.shaft_counts = counts;
    }

    /// A frame on its bus. True if it was a command to this drive.
    pub fn hear(&mut self, now: Stamp, frame: &CanFrame, out: &mut Vec<CanFrame>) -> bool {
        if self.defects.unplugged || self.booting_until.is_some() {
            return false;
        }
        self.motor.observe(now);
        let mut bench = Bench { defects: self.defects, out };
        self.face.get().hear(now, frame, &mut self.motor, &mut bench)
    }

    fn hear_with_power(&mut self, on: bool, frame: &CanFrame) -> bool {
        self.face.get().set_power(on);
        self.motor.target = Target::Off;
        self.hear(Stamp::default(), frame, &mut Vec::new())
    }

    /// What this frame asks of the drive at rest; see [`super::SimDrive::asked`].
    pub(super) fn asked(&mut self, frame: &CanFrame) -> Option<Asked> {
        self.booting_until = None;
        self.hear_with_power(false, frame);
        let powers = self.state() == State::Enabled;
        if !self.hear_with_power(true, frame) {
            return None;
        }
        let permille = |nm: f64| 1e3 * nm / self.motor.rated_nm;
        let motion = match self.motor.target {
            Target::Off => Motion::Off,
            Target::Torque(nm) => Motion::Torque(permille(nm)),
            Target::Position(turns, most_nm) => {
                let counts = turns * self.motor.counts_per_turn;
                Motion::Position { counts, most_permille: most_nm.map(permille) }
            }
        };
        Some(Asked { powers, motion })
    }

    /// What it does by itself, once per millisecond.
    pub fn tick(&mut self, now: Stamp, out: &mut Vec<CanFrame>) {
        if let Some(until) = self.booting_until {
            if now >= until {
                self.booting_until = None;
            }
            return;
        }
        self.motor.observe(now);
        let mut bench = Bench { defects: self.defects, out };
        self.face.get().tick(now, &mut self.motor, &mut bench);
    }

    /// Cold start, as after a loss of power: it counts from where the shaft happens to be.
    pub fn reboot(&mut self, now: Stamp) {
        self.face.get().reset();
        self.motor.target = Target::Off;
        self.motor.count_zero = self.motor.shaft_counts;
        self.booting_until = Some(now + BOOT_TIME);
    }

    /// Its watchdog bites, whatever it heard.
    pub fn time_out(&mut self) {
        self.face.get().time_out();
        self.motor.target = Target::Off;
    }

    /// Goes off, and holds a command of full torque for when it is on again. Only MIT motors do that.
    pub fn hold_full_torque(&mut self) {
        if let Faces::Mit(face) = &mut self.face {
            face.hold_full_torque();
            self.motor.target = Target::Off;
        }
    }

    /// A fault of its own.
    pub fn fail(&mut self, code: u16, _out: &mut Vec<CanFrame>) {
        let [low, _] = code.to_le_bytes();
        self.face.get().fail(low);
        self.motor.target = Target::Off;
    }
}
