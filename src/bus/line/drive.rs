//! One drive as its master sees it: set-up, power state, command and answer. RT: yes.
//!
//! ```text
//!  Reset ─NMT reset→ AwaitBoot ─boot-up→ Configure ─all steps→ Start ─NMT start→ AwaitAnswer ─TPDO→ Operating
//!    ↑                   │ 2 s               │ refused, silent              0.5 s │                │ heartbeat lost
//!    └──── 1 s ─────── Failed ←──────────────┴────────────────────────────────────┴────────────────┘
//!  A boot-up message in any state but Reset leads to Configure: the drive has lost its mapping.
//! ```

use super::agreement::Agreement;
use super::in_flight::InFlight;
use super::setup::{self, SetupFault, Step, TORQUE_LIMIT};
use crate::base::time::{Span, Stamp};
use crate::bus::canopen::{Emergency, Message, NmtCommand, NmtState, Node, PdoData};
use crate::bus::cia402::{self, State};
use crate::bus::pdo::{self, Answer};
use crate::bus::sdo::{SdoReply, SdoRequest, SdoValue};
use crate::config::checked::{DriveConfig, DriveMode, RealTime};
use crate::msg::{CanFrame, DriveCommand, DriveFeedback, DriveGoal, DriveState};

/// After a reset a drive boots in less (CiA 301 sets no limit; 2 s is what drivers of common makes wait).
const BOOT_TIMEOUT: Span = Span::from_ms(2000);
/// An object server that has not answered in this time is asked again.
const SDO_TIMEOUT: Span = Span::from_ms(100);
/// So often before it counts as silent.
const SDO_TRIES: u8 = 3;
/// From NMT start to the first process data.
const ANSWER_TIMEOUT: Span = Span::from_ms(500);
/// A failed drive is tried again after this.
const RETRY: Span = Span::from_ms(1000);
/// So many heartbeats may be missing.
const HEARTBEATS_MISSED: i64 = 3;
/// Commands with zero torque (or the measured position) after the drive was first seen enabled.
const ZERO_COMMANDS: u8 = 2;
/// At this count two drives have one number.
const DOUBLED_ANSWERS: u8 = 20;
/// So many answers may show it enabled after it was told to be off.
const ASTRAY_ANSWERS: u8 = 50;
/// Commands of zero torque and no power to a drive that is given up while it may follow the last one.
const FAREWELLS: u8 = 2;
/// Commands that the reset bit stays low, then high.
const RESET_HOLD: u8 = 4;

/// An emergency whose end is not told is over after this, if the drive shows no fault.
const EMERGENCY_FADES: Span = Span::from_ms(2000);

/// Error codes below are [`SetupFault`]s.
const FIRST_CODE_OF_DRIVES: u16 = 0x0100;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Reset,
    AwaitBoot { deadline: Stamp },
    Configure { step: usize, asked: Option<Stamp>, tries: u8 },
    Start,
    AwaitAnswer { deadline: Stamp },
    Operating,
    Failed { until: Stamp },
}

const CONFIGURE: Phase = Phase::Configure { step: 0, asked: None, tries: 0 };

/// When in the round of SYNCs a drive is served.
#[derive(Clone, Copy, Debug)]
pub(in crate::bus) struct Slot {
    /// Every so many SYNCs.
    pub(in crate::bus) divisor: u32,
    /// Commands go out in this phase of the round.
    pub(in crate::bus) command: u32,
    /// NMT start goes out in this phase, so that the answers come in phase 0.
    pub(in crate::bus) start: u32,
}

/// The torque limit of a position drive, changed in operation: none after set-up, then as commanded.
#[derive(Clone, Copy, Debug, Default)]
struct TorqueLimit {
    wanted: i16,
    confirmed: i16,
    asked: Option<(Stamp, i16)>,
    tries: u8,
}

/// One drive.
#[derive(Debug)]
pub(super) struct DriveLine {
    /// Its index in [`crate::msg::Drive`].
    pub(super) index: usize,
    /// Its node.
    pub(super) node: Node,
    /// What it says.
    pub(super) feedback: DriveFeedback,
    /// Its commands, while nothing proves that they left the wire.
    pub(super) in_flight: InFlight,
    mode: DriveMode,
    slot: Slot,
    max_torque_permille: i16,
    steps: Box<[Step]>,
    silence_limit: Span,
    phase: Phase,
    state: State,
    /// Time spent listening since its last heartbeat: a stall of ours is not its silence.
    silent: Span,
    /// When its last emergency came.
    emergency: Option<Stamp>,
    /// The goal must drop below enabled before the drive is reset or enabled again.
    held_back: bool,
    pub(super) goal: DriveGoal,
    enabled_commands: u8,
    reset_commands: u8,
    hold_counts: Option<i32>,
    limit: TorqueLimit,
    agreement: Agreement,
    /// Answers in a row that show it enabled although it was told to be off.
    astray: u8,
    /// Second answers to one SYNC count two, the others take one back.
    doubled: u8,
    /// Torque in the last command.
    pub(super) torque_permille: i16,
    /// Commands still due to a drive that was given up.
    farewells: u8,
}

impl DriveLine {
    /// Allocates its list of steps.
    pub(super) fn new(index: usize, node: Node, drive: &DriveConfig, slot: Slot, real_time: &RealTime) -> Self {
        Self {
            index,
            node,
            feedback: DriveFeedback { stamp: Stamp::NEVER, ..DriveFeedback::default() },
            in_flight: InFlight::default(),
            mode: drive.mode,
            slot,
            max_torque_permille: i16::try_from(drive.max_torque_permille).unwrap_or(i16::MAX),
            steps: setup::steps(drive, node, real_time.period, real_time.trigger),
            silence_limit: Span(drive.heartbeat.0.saturating_mul(HEARTBEATS_MISSED)),
            phase: Phase::Reset,
            state: State::NotReady,
            silent: Span::ZERO,
            emergency: None,
            held_back: true,
            goal: DriveGoal::Disabled,
            enabled_commands: 0,
            reset_commands: 0,
            hold_counts: None,
            limit: TorqueLimit::default(),
            agreement: Agreement::default(),
            astray: 0,
            doubled: 0,
            torque_permille: 0,
            farewells: 0,
        }
    }

    /// The command takes goal or torque away from what was sent last.
    pub(super) fn is_lowered_by(&self, command: &DriveCommand) -> bool {
        self.farewells > 0 || command.goal < self.goal || self.in_flight.is_lowered_by(command.torque_permille)
    }

    /// True while its process data flow.
    pub(super) fn is_operating(&self) -> bool {
        self.phase == Phase::Operating
    }

    /// A heartbeat or boot-up. True if the drive restarted by itself.
    pub(super) fn on_heartbeat(&mut self, nmt: NmtState, stamp: Stamp) -> bool {
        self.silent = Span::ZERO;
        match (self.phase, nmt) {
            (Phase::Reset, _) => {}
            (Phase::AwaitBoot { .. }, NmtState::BootUp) => self.configure(),
            (Phase::Configure { step: 0, .. }, NmtState::BootUp) => {}
            (_, NmtState::BootUp) => {
                self.configure();
                self.feedback.error_code = SetupFault::Rebooted as u16;
                return true;
            }
            (Phase::Operating, NmtState::Stopped | NmtState::PreOperational) => {
                self.fail(stamp, SetupFault::LeftOperational);
            }
            _ => {}
        }
        false
    }

    /// An answer of its object server.
    pub(super) fn on_sdo(&mut self, reply: &SdoReply, stamp: Stamp) {
        if self.phase == Phase::Operating && reply.address() == TORQUE_LIMIT {
            return self.on_limit(reply, stamp);
        }
        let Phase::Configure { step, asked: Some(_), .. } = self.phase else { return };
        let Some(current) = self.steps.get(step) else { return };
        if current.address() != reply.address() {
            return;
        }
        match current.judge(reply) {
            Ok(()) if step + 1 == self.steps.len() => self.phase = Phase::Start,
            Ok(()) => self.phase = Phase::Configure { step: step + 1, asked: None, tries: 0 },
            Err(fault) => self.fail(stamp, fault),
        }
    }

    fn on_limit(&mut self, reply: &SdoReply, stamp: Stamp) {
        let Some((_, value)) = self.limit.asked.take() else { return };
        if matches!(reply, SdoReply::Written(_)) {
            self.limit.confirmed = value;
            self.limit.tries = 0;
        } else {
            self.fail(stamp, SetupFault::Refused);
        }
    }

    /// Process data; `sampled` is when the drive read its encoder.
    pub(super) fn on_answer(&mut self, answer: &Answer, sampled: Stamp) {
        if matches!(self.phase, Phase::AwaitAnswer { .. }) {
            self.phase = Phase::Operating;
            if self.feedback.error_code < FIRST_CODE_OF_DRIVES {
                self.feedback.error_code = 0;
            }
        }
        if self.phase != Phase::Operating {
            return;
        }
        let before = self.state;
        self.state = State::from_statusword(answer.statusword).unwrap_or(State::NotReady);
        let fell = before == State::Enabled && self.state != State::Enabled && self.goal == DriveGoal::Enabled;
        if fell || (is_fault(self.state) && !is_fault(before)) {
            self.held_back = true;
        } else if is_fault(before) && !is_fault(self.state) {
            self.feedback.error_code = 0;
        }
        self.compare(answer, sampled);
        if self.phase != Phase::Operating {
            return;
        }
        self.feedback.stamp = sampled;
        self.feedback.state = self.state.as_message();
        self.feedback.statusword = answer.statusword;
        self.feedback.position_counts = answer.position_counts;
        self.feedback.torque_limit_permille = match self.mode {
            DriveMode::CyclicTorque => self.max_torque_permille,
            DriveMode::CyclicPosition => self.limit.confirmed,
        };
        match self.mode {
            DriveMode::CyclicTorque => self.feedback.torque_permille = answer.third,
            DriveMode::CyclicPosition => self.feedback.analog_counts = answer.third,
        }
    }

    /// What it shows against what it was told.
    fn compare(&mut self, answer: &Answer, sampled: Stamp) {
        let follows = self.state == State::Enabled && self.goal == DriveGoal::Enabled && !self.held_back;
        let torque = follows && self.mode == DriveMode::CyclicTorque;
        let disobeys = self.state == State::Enabled && self.goal != DriveGoal::Enabled;
        self.astray = if disobeys { self.astray.saturating_add(1) } else { 0 };
        let again = sampled == self.feedback.stamp;
        self.doubled = if again { self.doubled.saturating_add(2) } else { self.doubled.saturating_sub(1) };
        if self.doubled >= DOUBLED_ANSWERS {
            self.doubled = 0;
            self.fail(sampled, SetupFault::TwoNodes);
        } else if self.astray >= ASTRAY_ANSWERS {
            self.fail(sampled, SetupFault::StateAstray);
        } else if torque && self.agreement.is_broken_by(answer.third) {
            self.fail(sampled, SetupFault::TorqueAstray);
        }
    }

    /// An emergency, or its end.
    pub(super) fn on_emergency(&mut self, emergency: &Emergency, stamp: Stamp) {
        self.feedback.error_code = emergency.code;
        self.emergency = Some(stamp);
        if emergency.code != 0 {
            self.held_back = true;
        }
    }

    /// The bus is dead: everything known of the drive is void.
    pub(super) fn on_stall(&mut self) {
        self.phase = Phase::Reset;
        self.farewells = 0;
        self.give_up(SetupFault::BusStalled);
    }

    /// Deadlines; `listened`: for how long we have listened since the last time.
    pub(super) fn supervise(&mut self, now: Stamp, listened: Span) {
        self.silent = Span(self.silent.0.saturating_add(listened.0));
        match self.phase {
            Phase::AwaitBoot { deadline } if now > deadline => self.fail(now, SetupFault::NoBootUp),
            Phase::Configure { step, asked: Some(at), tries } if now.since(at) > SDO_TIMEOUT => {
                if tries + 1 >= SDO_TRIES {
                    self.fail(now, SetupFault::NoAnswer);
                } else {
                    self.phase = Phase::Configure { step, asked: None, tries: tries + 1 };
                }
            }
            Phase::AwaitAnswer { deadline } if now > deadline => self.fail(now, SetupFault::NotOperational),
            Phase::Operating if self.silent > self.silence_limit => {
                self.fail(now, SetupFault::HeartbeatLost);
            }
            Phase::Operating => {
                self.supervise_limit(now);
                self.let_emergency_fade(now);
            }
            Phase::Failed { until } if now > until => self.phase = Phase::Reset,
            _ => {}
        }
    }

    /// Some drives never tell the end of an emergency. One that shows no fault for a while, without being asked for
    /// torque, has none: otherwise it could not be armed again before a restart.
    fn let_emergency_fade(&mut self, now: Stamp) {
        let over = self.emergency.is_some_and(|at| now.since(at) > EMERGENCY_FADES);
        let at_rest = self.goal != DriveGoal::Enabled && !is_fault(self.state);
        if over && at_rest && self.feedback.error_code >= FIRST_CODE_OF_DRIVES {
            self.feedback.error_code = 0;
            self.emergency = None;
        }
    }

    fn supervise_limit(&mut self, now: Stamp) {
        if self.limit.asked.is_some_and(|(at, _)| now.since(at) > SDO_TIMEOUT) {
            self.limit.asked = None;
            self.limit.tries = self.limit.tries.saturating_add(1);
            if self.limit.tries >= SDO_TRIES {
                self.fail(now, SetupFault::NoAnswer);
            }
        }
    }

    /// The next frame of its set-up, if one is due in this phase of the round.
    pub(super) fn setup_frame(&mut self, now: Stamp, phase: u32) -> Option<CanFrame> {
        match self.phase {
            Phase::Reset => {
                self.phase = Phase::AwaitBoot { deadline: now + BOOT_TIMEOUT };
                Some(Message::Nmt(NmtCommand::ResetNode, Some(self.node)).emit())
            }
            Phase::Configure { step, asked: None, tries } => {
                let request = match *self.steps.get(step)? {
                    Step::Read(address, _) => SdoRequest::Read(address),
                    Step::Write(address, value) | Step::WriteIfPresent(address, value) => {
                        SdoRequest::Write(address, value)
                    }
                };
                self.phase = Phase::Configure { step, asked: Some(now), tries };
                Some(Message::SdoRequest(self.node, request).emit())
            }
            Phase::Start if phase % self.slot.divisor == self.slot.start => {
                self.phase = Phase::AwaitAnswer { deadline: now + ANSWER_TIMEOUT };
                self.state = State::NotReady;
                self.in_flight.clear();
                Some(Message::Nmt(NmtCommand::Start, Some(self.node)).emit())
            }
            Phase::Operating => self.limit_frame(now),
            _ => None,
        }
    }

    /// Writes the torque limit that is wanted, unless the drive has it.
    fn limit_frame(&mut self, now: Stamp) -> Option<CanFrame> {
        let TorqueLimit { wanted, confirmed, asked, .. } = self.limit;
        if self.mode != DriveMode::CyclicPosition || asked.is_some() || wanted == confirmed {
            return None;
        }
        self.limit.asked = Some((now, wanted));
        let request = SdoRequest::Write(TORQUE_LIMIT, SdoValue::u16(wanted.unsigned_abs()));
        Some(Message::SdoRequest(self.node, request).emit())
    }

    /// What this cycle wants, whether or not a command goes out in it.
    pub(super) fn note_command(&mut self, command: &DriveCommand) {
        if command.goal != DriveGoal::Enabled {
            self.held_back = false;
        }
        self.limit.wanted = command.torque_limit_permille.clamp(0, self.max_torque_permille.max(0));
    }

    /// True if a command should go out in this phase of the round: its turn, or the goal drops.
    pub(super) fn wants_command(&self, phase: u32, command: &DriveCommand) -> bool {
        let turn = phase % self.slot.divisor == self.slot.command;
        self.farewells > 0 || (self.is_operating() && (turn || command.goal < self.goal))
    }

    /// The command, one step of the power state machine at a time.
    pub(super) fn command(&mut self, command: &DriveCommand) -> PdoData {
        if self.farewells > 0 {
            self.farewells -= 1;
            (self.goal, self.torque_permille) = (DriveGoal::Disabled, 0);
            return self.stop_command();
        }
        self.goal = command.goal;
        let controlword = self.controlword();
        let follows = self.follows_commands();
        match self.mode {
            DriveMode::CyclicTorque => {
                let limit = self.max_torque_permille.max(0);
                let torque = if follows { command.torque_permille.clamp(-limit, limit) } else { 0 };
                self.agreement.note(torque);
                self.torque_permille = torque;
                pdo::torque_command(controlword, torque)
            }
            DriveMode::CyclicPosition => pdo::position_command(controlword, self.target_position(follows, command)),
        }
    }

    /// Zero torque and voltage off, whatever the state.
    pub(super) fn stop_command(&self) -> PdoData {
        match self.mode {
            DriveMode::CyclicTorque => pdo::torque_command(cia402::DISABLE_VOLTAGE, 0),
            DriveMode::CyclicPosition => pdo::position_command(cia402::DISABLE_VOLTAGE, 0),
        }
    }

    fn controlword(&mut self) -> u16 {
        if self.held_back {
            return cia402::DISABLE_VOLTAGE;
        }
        if self.state != State::Fault || self.goal == DriveGoal::Disabled {
            self.reset_commands = 0;
            return self.state.controlword_towards(self.goal);
        }
        let high = (self.reset_commands / RESET_HOLD) % 2 == 1;
        self.reset_commands = self.reset_commands.wrapping_add(1);
        if high { cia402::FAULT_RESET } else { cia402::DISABLE_VOLTAGE }
    }

    /// Counts the commands since it is enabled; the first ones carry no torque.
    fn follows_commands(&mut self) -> bool {
        if self.state != State::Enabled || self.goal != DriveGoal::Enabled || self.held_back {
            self.enabled_commands = 0;
            self.agreement = Agreement::default();
            return false;
        }
        let follows = self.enabled_commands >= ZERO_COMMANDS;
        self.enabled_commands = self.enabled_commands.saturating_add(1);
        follows
    }

    /// Where it is while it does not follow; where it was when the hold began; else as told.
    fn target_position(&mut self, follows: bool, command: &DriveCommand) -> i32 {
        let here = self.feedback.position_counts;
        if !follows {
            self.hold_counts = Some(here);
            here
        } else if command.hold {
            *self.hold_counts.get_or_insert(here)
        } else {
            self.hold_counts = None;
            command.position_counts
        }
    }

    fn configure(&mut self) {
        self.held_back = true;
        self.phase = CONFIGURE;
        self.state = State::NotReady;
        self.in_flight.clear();
        self.limit = TorqueLimit { wanted: self.limit.wanted, ..TorqueLimit::default() };
        self.feedback.state = DriveState::Configuring;
        self.feedback.error_code = 0;
    }

    /// A drive that followed commands would follow the last one until its own watchdog bites.
    fn fail(&mut self, now: Stamp, fault: SetupFault) {
        self.farewells = if self.is_operating() { FAREWELLS } else { 0 };
        self.phase = Phase::Failed { until: now + RETRY };
        self.give_up(fault);
    }

    fn give_up(&mut self, fault: SetupFault) {
        self.held_back = true;
        self.state = State::NotReady;
        self.in_flight.clear();
        self.feedback.state = DriveState::Lost;
        self.feedback.error_code = fault as u16;
    }
}

const fn is_fault(state: State) -> bool {
    matches!(state, State::Fault | State::FaultReaction)
}
