//! A drive that is commanded frame by frame, without SYNC: MIT, ODrive, moteus. RT: yes.
//!
//! ```text
//!  Reset ─off, until it says so→ SetUp ─all questions→ Idle ─goal enabled→ Entering ─it says on→ Following
//!    ↑                             │ refused, silent     ↑ ↑──── goal drops, or it fell ────┴────────┘
//!    │                           Failed                  └── cleared ── Faulted ←── it tells a fault
//!    ├──────────── 1 s ────────────┘
//!    └──────────── silent for three heartbeats, bus stalled (from any)
//! ```
//! In every turn one frame goes out: power off, or the present command. So the drive's watchdog is fed, its position is
//! known before it is enabled, and a drive that restarted is put off before anything else. What differs between the
//! protocols is behind [`Speak`].

use super::agreement::Agreement;
use super::drive::Slot;
use super::in_flight::InFlight;
use super::setup::SetupFault;
use super::speak_mit::MitSpeaker;
use super::speak_moteus::MoteusSpeaker;
use super::speak_odrive::OdriveSpeaker;
use crate::base::time::{Span, Stamp};
use crate::config::checked::{DriveConfig, DriveMode, DriveProtocol};
use crate::msg::{BusFrame, CanFrame, DriveCommand, DriveFeedback, DriveGoal, DriveState, FrameBatch};

/// A question that has not been answered in this time is asked again.
const ANSWER_TIMEOUT: Span = Span::from_ms(100);
/// So often before the drive counts as silent.
const TRIES: u8 = 3;
/// A drive that refused its set-up is tried again after this.
const RETRY: Span = Span::from_ms(1000);
/// Heartbeats that may be missing.
const HEARTBEATS_MISSED: i64 = 3;
/// A drive that never spoke is told to be silent after this.
const FIRST_WORD: Span = Span::from_ms(2000);
/// Commands without torque after the drive was first seen on.
const ZERO_COMMANDS: u8 = 2;
/// More answers are never owed: the command in flight, a lowered one, a torque of zero, the goal's drop.
const MOST_OWED: u8 = 4;
/// Answers that nobody asked for count two, the others take one back: at this count two drives have one number.
const EXTRA_ANSWERS: u8 = 20;
/// Shortest time from sending a command to its answer: two frames of 47 bits at 1 Mbit/s.
const FASTEST_ANSWER: Span = Span::from_us(94);
/// Error codes of drives begin here; those below are [`SetupFault`]s.
const FIRST_CODE_OF_DRIVES: u16 = 0xFF00;

/// Whether a drive has power, as it says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Power {
    /// No power.
    Off,
    /// On its way.
    Starting,
    /// Follows commands.
    On,
    /// A fault with the protocol's number, 1 to 255.
    Fault(u8),
}

/// What a frame of a drive tells.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Word {
    /// Position, turns.
    pub(super) position_turns: Option<f64>,
    /// Torque, Nm.
    pub(super) torque_nm: Option<f64>,
    /// Power.
    pub(super) power: Option<Power>,
    /// Its state as it writes it.
    pub(super) status: Option<u16>,
    /// It answers a command of ours.
    pub(super) answers_command: bool,
    /// It answers the question of the set-up that was asked: fine, or not.
    pub(super) answers_question: Option<Result<(), SetupFault>>,
    /// It cannot be right.
    pub(super) wrong: Option<SetupFault>,
}

/// What a frame is to a drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Heard {
    /// Nothing of it.
    Foreign,
    /// Its identifier, but no sense.
    Garbled,
    /// A command of ours.
    Echo,
    /// Another frame of ours: a question.
    OwnQuestion,
    /// It says something.
    Word(Word),
}

/// A question of the set-up.
#[derive(Clone, Copy, Debug)]
pub(super) struct Question {
    /// What goes out.
    pub(super) frame: CanFrame,
    /// An answer must come.
    pub(super) answered: bool,
}

/// What a drive shall do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Setpoint {
    /// Make this torque, Nm.
    Torque(f64),
    /// Go to this position, turns, with at most this torque, Nm.
    Position(f64, f64),
}

/// What differs between the protocols: pure forming and reading of frames, with what little must be remembered.
pub(super) trait Speak {
    /// Reads a frame of the bus; `asked` is the question of the set-up that is open.
    fn hear(&mut self, frame: &CanFrame, stamp: Stamp, asked: Option<usize>) -> Heard;
    /// Question number `step` of the set-up; `None` after the last.
    fn question(&self, step: usize) -> Option<Question>;
    /// Power off, or stays off; makes it speak if it does not by itself.
    fn off(&mut self) -> CanFrame;
    /// Makes a drive in fault speak, and leaves the fault.
    fn look(&mut self) -> CanFrame;
    /// Frame number `step` on the way from off to on, none of which carries torque; `None` = wait with zero torque.
    fn enter(&mut self, step: u8) -> Option<CanFrame>;
    /// A command.
    fn follow(&mut self, setpoint: Setpoint) -> CanFrame;
    /// Forgets the fault.
    fn clear(&mut self) -> CanFrame;
    /// The way out: zero torque, power off.
    fn stop(&self) -> [Option<CanFrame>; 2];
    /// All that was remembered is void.
    fn forget(&mut self);
}

/// The protocols.
#[derive(Debug)]
enum Speaker {
    Mit(MitSpeaker),
    Odrive(OdriveSpeaker),
    Moteus(MoteusSpeaker),
}

macro_rules! of_speaker {
    ($self:expr, $speaker:ident => $what:expr) => {
        match $self {
            Speaker::Mit($speaker) => $what,
            Speaker::Odrive($speaker) => $what,
            Speaker::Moteus($speaker) => $what,
        }
    };
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Reset,
    SetUp { step: usize, asked: Option<Stamp>, tries: u8 },
    Idle,
    Entering { step: u8 },
    Following { commands: u8 },
    Faulted,
    Failed { until: Stamp },
}

/// One drive.
#[derive(Debug)]
pub(super) struct Direct {
    /// Its index in [`crate::msg::Drive`].
    pub(super) index: usize,
    /// What it says.
    pub(super) feedback: DriveFeedback,
    /// Its commands, while nothing proves that they left the wire.
    pub(super) in_flight: InFlight,
    speaker: Speaker,
    slot: Slot,
    mode: DriveMode,
    rated_nm: f64,
    max_permille: i16,
    /// Torque that a position drive may use, as commanded; it goes with every command.
    limit_permille: i16,
    counts_per_turn: f64,
    silence_limit: Span,
    phase: Phase,
    /// How long we have listened since it last said how it is: a stall of our own is not its silence.
    silent: Span,
    spoke: bool,
    began: Option<Stamp>,
    /// When the newest command left the wire.
    left: Stamp,
    /// Limit that went with it.
    sent_limit_permille: i16,
    /// Answers owed to us, and those that came although none was owed.
    owed: u8,
    extra: u8,
    agreement: Agreement,
    /// The goal must drop below enabled before the drive is cleared or enabled again.
    held_back: bool,
    pub(super) goal: DriveGoal,
    /// Torque of the command that was sent last.
    pub(super) torque_permille: i16,
    /// The drive says that it has power.
    on: bool,
    hold_counts: Option<i32>,
}

impl Direct {
    /// The drive of this configuration; `None` if it is CANopen.
    pub(super) fn new(index: usize, drive: &DriveConfig, slot: Slot) -> Option<Self> {
        let (speaker, counts_per_turn) = match drive.protocol {
            DriveProtocol::Cia402(_) => return None,
            DriveProtocol::Mit(mit) => (Speaker::Mit(MitSpeaker::new(mit, drive.node)), mit.counts_per_turn),
            DriveProtocol::Odrive(odrive) => {
                let speaker = OdriveSpeaker::new(odrive, drive.node);
                (Speaker::Odrive(speaker), odrive.counts_per_turn)
            }
            DriveProtocol::Moteus(moteus) => (Speaker::Moteus(MoteusSpeaker::new(drive)), moteus.counts_per_turn),
        };
        Some(Self {
            index,
            feedback: DriveFeedback { stamp: Stamp::NEVER, ..DriveFeedback::default() },
            in_flight: InFlight::default(),
            speaker,
            slot,
            mode: drive.mode,
            rated_nm: drive.rated_torque_nm,
            max_permille: i16::try_from(drive.max_torque_permille).unwrap_or(i16::MAX),
            limit_permille: 0,
            counts_per_turn,
            silence_limit: Span(drive.heartbeat.0.saturating_mul(HEARTBEATS_MISSED)),
            phase: Phase::Reset,
            silent: Span::ZERO,
            spoke: false,
            began: None,
            left: Stamp::NEVER,
            sent_limit_permille: 0,
            owed: 0,
            extra: 0,
            agreement: Agreement::default(),
            held_back: true,
            goal: DriveGoal::Disabled,
            torque_permille: 0,
            on: false,
            hold_counts: None,
        })
    }

    /// A frame of the bus. Tells what it was.
    pub(super) fn hear(&mut self, frame: &BusFrame) -> Heard {
        let asked = match self.phase {
            Phase::SetUp { step, asked: Some(_), .. } => Some(step),
            _ => None,
        };
        let heard = of_speaker!(&mut self.speaker, s => s.hear(&frame.frame, frame.stamp, asked));
        match heard {
            // Another master's is no proof that ours has left.
            Heard::Echo if frame.own => {
                self.left = frame.stamp;
                self.in_flight.hear_echo(&frame.frame);
            }
            Heard::Word(word) => self.on_word(&word, frame.stamp),
            Heard::Echo | Heard::OwnQuestion | Heard::Garbled | Heard::Foreign => {}
        }
        heard
    }

    fn on_word(&mut self, word: &Word, stamp: Stamp) {
        if word.power.is_some() {
            (self.silent, self.spoke) = (Span::ZERO, true);
        }
        if word.answers_command {
            self.on_answer(stamp);
            self.feedback.torque_limit_permille = self.sent_limit_permille;
        }
        if let Some(status) = word.status {
            self.feedback.statusword = status;
        }
        if let Some(turns) = word.position_turns {
            self.feedback.position_counts = counts(turns * self.counts_per_turn);
            // An answer was sampled when the command came; what comes by itself just before it was sent.
            let prompted = word.answers_command && self.left <= stamp && self.left != Stamp::NEVER;
            self.feedback.stamp = if prompted { self.left } else { stamp };
        }
        if let Some(torque_nm) = word.torque_nm {
            self.feedback.torque_permille = permille(torque_nm / self.rated_nm);
            self.compare(stamp);
        }
        if let Some(fault) = word.wrong {
            self.fail(stamp, fault);
        }
        if let Some(result) = word.answers_question {
            self.on_reply(result, stamp);
        }
        if let Some(power) = word.power {
            self.on_power(power);
        }
        self.show();
    }

    fn on_answer(&mut self, stamp: Stamp) {
        self.in_flight.hear_answer(stamp - FASTEST_ANSWER);
        if self.owed > 0 {
            self.owed -= 1;
            self.extra = self.extra.saturating_sub(1);
        } else {
            self.extra = self.extra.saturating_add(2);
            if self.extra >= EXTRA_ANSWERS {
                self.extra = 0;
                self.fail(stamp, SetupFault::TwoNodes);
            }
        }
    }

    fn compare(&mut self, stamp: Stamp) {
        let following = matches!(self.phase, Phase::Following { .. }) && self.mode == DriveMode::CyclicTorque;
        if following && self.agreement.is_broken_by(self.feedback.torque_permille) {
            self.fail(stamp, SetupFault::TorqueAstray);
        }
    }

    fn on_reply(&mut self, result: Result<(), SetupFault>, stamp: Stamp) {
        let Phase::SetUp { step, asked: Some(_), .. } = self.phase else { return };
        match result {
            Ok(()) => self.phase = Phase::SetUp { step: step + 1, asked: None, tries: 0 },
            Err(fault) => self.fail(stamp, fault),
        }
    }

    fn on_power(&mut self, power: Power) {
        self.on = power == Power::On;
        match (self.phase, power) {
            (Phase::Reset, Power::Off | Power::Fault(_)) => {
                self.phase = Phase::SetUp { step: 0, asked: None, tries: 0 };
            }
            (Phase::Reset | Phase::SetUp { .. } | Phase::Failed { .. }, _) => {}
            (Phase::Faulted, Power::Fault(code)) => self.feedback.error_code = FIRST_CODE_OF_DRIVES | u16::from(code),
            (_, Power::Fault(code)) => {
                self.held_back = true;
                self.phase = Phase::Faulted;
                self.feedback.error_code = FIRST_CODE_OF_DRIVES | u16::from(code);
            }
            (Phase::Faulted, _) => {
                self.feedback.error_code = 0;
                self.phase = Phase::Idle;
            }
            // The first frame on the way is still without power: it says nothing about those after it.
            (Phase::Entering { step }, Power::On) if step >= 2 => {
                self.agreement = Agreement::default();
                self.phase = Phase::Following { commands: 0 };
            }
            (Phase::Following { .. }, Power::Off | Power::Starting) => {
                // It let go by itself: its watchdog, or it restarted.
                self.held_back = true;
                self.phase = Phase::Idle;
            }
            _ => {}
        }
    }

    /// The bus is dead: everything known of the drive is void.
    pub(super) fn on_stall(&mut self) {
        self.give_up(SetupFault::BusStalled);
    }

    /// Deadlines.
    pub(super) fn supervise(&mut self, now: Stamp, listened: Span) {
        self.silent = Span(self.silent.0.saturating_add(listened.0));
        let began = *self.began.get_or_insert(now);
        match self.phase {
            Phase::SetUp { step, asked: Some(at), tries } if now.since(at) > ANSWER_TIMEOUT => {
                if tries + 1 >= TRIES {
                    self.fail(now, SetupFault::NoAnswer);
                } else {
                    self.phase = Phase::SetUp { step, asked: None, tries: tries + 1 };
                }
            }
            Phase::Failed { until } if now > until => self.begin_anew(),
            Phase::Failed { .. } => {}
            Phase::Reset if !self.spoke && now.since(began) > FIRST_WORD => {
                self.feedback.error_code = SetupFault::NoAnswer as u16;
                self.feedback.state = DriveState::Lost;
            }
            Phase::Reset => {}
            _ if self.silent > self.silence_limit => self.give_up(SetupFault::HeartbeatLost),
            _ => {}
        }
        self.show();
    }

    /// The next question of its set-up.
    pub(super) fn setup_frame(&mut self, now: Stamp) -> Option<CanFrame> {
        let Phase::SetUp { step, asked: None, tries } = self.phase else { return None };
        let Some(question) = of_speaker!(&self.speaker, s => s.question(step)) else {
            self.phase = Phase::Idle;
            if self.feedback.error_code < FIRST_CODE_OF_DRIVES {
                self.feedback.error_code = 0;
            }
            return None;
        };
        self.phase = if question.answered {
            Phase::SetUp { step, asked: Some(now), tries }
        } else {
            Phase::SetUp { step: step + 1, asked: None, tries: 0 }
        };
        Some(question.frame)
    }

    /// What this cycle wants, whether or not a command goes out in it.
    pub(super) fn note_command(&mut self, command: &DriveCommand) {
        if command.goal != DriveGoal::Enabled {
            self.held_back = false;
        }
        self.limit_permille = command.torque_limit_permille.clamp(0, self.max_permille.max(0));
    }

    /// True if a command should go out in this phase of the round: its turn, or the goal drops.
    pub(super) fn wants_command(&self, phase: u32, command: &DriveCommand) -> bool {
        phase % self.slot.divisor == self.slot.command || command.goal < self.goal
    }

    /// The command takes goal or torque away from what was sent last.
    pub(super) fn is_lowered_by(&self, command: &DriveCommand) -> bool {
        command.goal < self.goal || self.in_flight.is_lowered_by(command.torque_permille)
    }

    /// The frame of this turn, one step towards the goal.
    pub(super) fn command(&mut self, command: &DriveCommand) -> CanFrame {
        self.goal = command.goal;
        self.torque_permille = 0;
        self.owed = self.owed.saturating_add(1).min(MOST_OWED);
        self.sent_limit_permille = match self.mode {
            DriveMode::CyclicTorque => self.max_permille,
            DriveMode::CyclicPosition => self.limit_permille,
        };
        let enabled = self.goal == DriveGoal::Enabled && !self.held_back;
        let frame = match self.phase {
            Phase::Faulted if self.goal == DriveGoal::Disabled || self.held_back => {
                of_speaker!(&mut self.speaker, s => s.look())
            }
            Phase::Faulted => of_speaker!(&mut self.speaker, s => s.clear()),
            Phase::Idle if enabled => self.enter(0),
            Phase::Entering { step } if enabled => self.enter(step),
            Phase::Following { commands } if enabled => self.follow(commands, command),
            Phase::Entering { .. } | Phase::Following { .. } => {
                self.phase = Phase::Idle;
                of_speaker!(&mut self.speaker, s => s.off())
            }
            Phase::Reset | Phase::SetUp { .. } | Phase::Idle | Phase::Failed { .. } => {
                of_speaker!(&mut self.speaker, s => s.off())
            }
        };
        self.show();
        frame
    }

    fn enter(&mut self, step: u8) -> CanFrame {
        self.phase = Phase::Entering { step: step.saturating_add(1) };
        let zero = self.standing_still();
        of_speaker!(&mut self.speaker, s => s.enter(step).unwrap_or_else(|| s.follow(zero)))
    }

    /// The first commands after the drive was seen on carry no torque.
    fn follow(&mut self, commands: u8, command: &DriveCommand) -> CanFrame {
        self.phase = Phase::Following { commands: commands.saturating_add(1) };
        let (setpoint, torque) = match self.mode {
            _ if commands < ZERO_COMMANDS => (self.standing_still(), 0),
            DriveMode::CyclicTorque => {
                let limit = self.max_permille.max(0);
                let torque = command.torque_permille.clamp(-limit, limit);
                (Setpoint::Torque(f64::from(torque) * 1e-3 * self.rated_nm), torque)
            }
            DriveMode::CyclicPosition => (self.position(command), 0),
        };
        self.torque_permille = torque;
        self.agreement.note(torque);
        of_speaker!(&mut self.speaker, s => s.follow(setpoint))
    }

    /// No torque; a position drive holds where it is.
    fn standing_still(&mut self) -> Setpoint {
        match self.mode {
            DriveMode::CyclicTorque => Setpoint::Torque(0.0),
            DriveMode::CyclicPosition => {
                self.hold_counts = Some(self.feedback.position_counts);
                self.to_position(self.feedback.position_counts)
            }
        }
    }

    fn position(&mut self, command: &DriveCommand) -> Setpoint {
        let target = if command.hold {
            *self.hold_counts.get_or_insert(self.feedback.position_counts)
        } else {
            self.hold_counts = None;
            command.position_counts
        };
        self.to_position(target)
    }

    fn to_position(&self, counts: i32) -> Setpoint {
        let most_nm = 1e-3 * f64::from(self.limit_permille) * self.rated_nm;
        Setpoint::Position(f64::from(counts) / self.counts_per_turn, most_nm)
    }

    /// Zero torque and no power, whatever the state.
    pub(super) fn stop_frames(&self, out: &mut FrameBatch) {
        for frame in of_speaker!(&self.speaker, s => s.stop()).into_iter().flatten() {
            out.push(BusFrame::ours(Stamp::default(), frame));
        }
    }

    /// A frame that does no harm whenever it is delivered: power off.
    pub(super) fn probe(&self) -> Option<CanFrame> {
        let [first, second] = of_speaker!(&self.speaker, s => s.stop());
        second.or(first)
    }

    fn fail(&mut self, now: Stamp, fault: SetupFault) {
        self.give_up(fault);
        self.phase = Phase::Failed { until: now + RETRY };
    }

    fn give_up(&mut self, fault: SetupFault) {
        self.begin_anew();
        self.held_back = true;
        self.feedback.state = DriveState::Lost;
        self.feedback.error_code = fault as u16;
    }

    fn begin_anew(&mut self) {
        of_speaker!(&mut self.speaker, s => s.forget());
        self.phase = Phase::Reset;
        self.in_flight.clear();
        self.owed = 0;
        self.on = false;
    }

    /// Its state in the words of CiA 402.
    fn show(&mut self) {
        self.feedback.state = match self.phase {
            Phase::Reset | Phase::Failed { .. } => return,
            Phase::SetUp { .. } => DriveState::Configuring,
            Phase::Faulted => DriveState::Fault,
            Phase::Entering { .. } => DriveState::SwitchedOn,
            Phase::Following { .. } => DriveState::Enabled,
            // A drive that has power without our wanting it.
            Phase::Idle if self.on => DriveState::NotReady,
            Phase::Idle if self.goal == DriveGoal::Ready => DriveState::Ready,
            Phase::Idle => DriveState::SwitchOnDisabled,
        };
    }
}

#[expect(clippy::cast_possible_truncation, reason = "saturates")]
fn counts(x: f64) -> i32 {
    libm::round(x) as i32
}

#[expect(clippy::cast_possible_truncation, reason = "saturates")]
fn permille(share: f64) -> i16 {
    libm::round(share * 1e3) as i16
}
