//! L3: the guard at the door between controller and motors. RT: yes, no allocation, bounded.
//!
//! Each tick it first looks (`health`: what is wrong? no side effects), then decides the mode (`mode`), then lets
//! torque through (`limits`). What it promises, for any input whatever:
//! - the torque is finite and within its limit, and zero unless the mode is `Armed`;
//! - a fault, a stale source, a number that is not finite or the released dead-man gives zero torque in the same tick;
//! - a stall of our own, of this thread or of one that brings input, gives zero torque until all have spoken again, and
//!   is no fault while it is shorter than the drives' watchdogs;
//! - the toes look for their zero only while the switch is held, and the hip has no power then;
//! - it arms only on a press that follows a release, both seen fresh, with nothing in the way;
//! - the first fault is kept until a fresh press: the robot is armed, or its toes look for their zero.

#![cfg_attr(
    not(test),
    deny(
        clippy::disallowed_methods,
        clippy::disallowed_types,
        clippy::disallowed_macros,
        clippy::expect_used,
        clippy::indexing_slicing
    )
)]

mod astray;
mod deadman;
mod health;
mod held_back;
mod latch;
mod lateness;
mod limits;
mod mode;
mod silence;

use crate::base::time::{Span, Stamp};
use crate::config::checked::{Config, DriveConfig, DriveMode, Limits, Toe};
use crate::msg::{
    DRIVES, Drive, DriveFeedback, DriveFeedbacks, DriveGoal, DriveState, Estimate, Fault, FaultCode, JointCommand,
    Mode, Snapshot, Status, TickInput, ZeroState,
};
use astray::Astray;
use deadman::{DeadMan, Hand};
use latch::Latch;
use lateness::Lateness;
use limits::{ToeSlew, TorqueGate};
use mode::Events;
use silence::Silence;

pub use held_back::HeldBack;

/// After a fault the drives stay disabled at least this long, so that every drive has seen it (four toe periods).
const DISABLED_AFTER_FAULT: Span = Span::from_ms(100);

/// Everything that the guard looks at in a tick.
#[derive(Clone, Copy, Debug)]
pub struct Facts<'a> {
    /// What went into the tick.
    pub input: &'a TickInput,
    /// What the drives say.
    pub feedback: &'a DriveFeedbacks,
    /// The newest of each sensor.
    pub snapshot: &'a Snapshot,
    /// State of the robot.
    pub estimate: &'a Estimate,
    /// What the controller wants.
    pub wanted: &'a JointCommand,
}

/// What the guard lets through.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Decision {
    /// Torque and toes that may reach the drives.
    pub allowed: JointCommand,
    /// What the drives shall be.
    pub goal: DriveGoal,
    /// Mode, faults and counters after this tick.
    pub status: Status,
}

/// Answers of a toe that may be lost in a row. It holds its place by itself, and a landing is believed by readings of up to 20 ms;
/// of the hip, whose angle is what the torque follows, the limit is an age.
const TOE_ANSWERS_LOST: i64 = 2;

/// Limits and timing, constant while running.
#[derive(Clone, Copy, Debug)]
struct Rules {
    limits: Limits,
    drive_age: [Span; DRIVES],
    /// After this the drives' own watchdogs act: a longer stall of ours is a fault like any silence.
    longest_stall: Span,
    toe_stroke_m: f64,
    toe_rate_m_s: f64,
    period: Span,
}

impl Rules {
    fn new(config: &Config) -> Self {
        let limits = config.robot.limits;
        let period = config.real_time.period;
        let drives = &config.robot.drives;
        let age = |drive: &DriveConfig| {
            let periods = match drive.mode {
                DriveMode::CyclicTorque => 1,
                DriveMode::CyclicPosition => TOE_ANSWERS_LOST,
            };
            let waits = period.0.saturating_mul(i64::from(drive.sync_divisor) * periods);
            Span(limits.drive_age.0.saturating_add(waits))
        };
        Self {
            limits,
            drive_age: drives.each_ref().map(age),
            longest_stall: drives.iter().map(|drive| drive.watchdog).min().unwrap_or(Span::ZERO),
            toe_stroke_m: config.robot.toe.stroke_m,
            toe_rate_m_s: config.robot.toe.rate_limit_m_s,
            period,
        }
    }
}

/// Mode machine, latch and limits.
#[derive(Clone, Debug)]
pub struct Guard {
    rules: Rules,
    mode: Mode,
    mode_since: Stamp,
    dead_man: DeadMan,
    lateness: Lateness,
    silence: Silence,
    latch: Latch,
    torque: TorqueGate,
    toes: ToeSlew,
    astray: Astray,
    heard: bool,
    may_get_ready: bool,
}

impl Guard {
    /// Boots disarmed.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let buses = config.robot.drives.each_ref().map(|drive| drive.bus);
        Self::with(Rules::new(config), buses, &config.robot.toe)
    }

    fn with(rules: Rules, buses: [usize; DRIVES], toe: &Toe) -> Self {
        Self {
            rules,
            mode: Mode::Starting,
            mode_since: Stamp::NEVER,
            dead_man: DeadMan::default(),
            lateness: Lateness::new(rules.period),
            silence: Silence::new(rules.period, buses),
            latch: Latch::default(),
            torque: TorqueGate::new(&rules.limits, rules.period),
            toes: ToeSlew::new(rules.toe_stroke_m, rules.toe_rate_m_s, rules.period),
            astray: Astray::new(toe),
            heard: false,
            may_get_ready: true,
        }
    }

    /// Mode after the last tick.
    #[must_use]
    pub const fn mode(&self) -> Mode {
        self.mode
    }

    /// Takes note of how punctual this tick is; true while phase-sensitive terms shall be off.
    pub fn late(&mut self, input: &TickInput) -> bool {
        self.lateness.observe(input)
    }

    /// Looks, decides, limits. Call [`Guard::late`] first.
    pub fn step(&mut self, facts: &Facts<'_>) -> Decision {
        let now = facts.input.now;
        let fresh = health::fresh(facts.snapshot.operator_age, self.rules.limits.operator_age);
        let hand = self.dead_man.update(facts.snapshot.dead_man, fresh);
        self.silence.observe(facts.input, facts.feedback, facts.snapshot);
        let findings = health::examine(&self.rules, facts, &self.memory());
        self.heard |= !findings.has(FaultCode::ImuStale) && !findings.has(FaultCode::DriveStale) && fresh;
        self.change_mode(now, hand, &findings, facts.feedback);
        let allowed = self.let_through(facts);
        self.note_limits(now);
        self.note_toes(facts, &allowed);
        Decision { allowed, goal: self.goal(facts.input, hand), status: self.status(facts.input, &findings) }
    }

    fn memory(&self) -> health::Memory {
        health::Memory {
            mode: self.mode,
            mode_since: self.mode_since,
            skipped: self.lateness.skipped(),
            silent: self.silence.ages(),
        }
    }

    fn change_mode(&mut self, now: Stamp, hand: Hand, findings: &health::Findings, feedback: &DriveFeedbacks) {
        // Whoever lets go while the toes look for their zero ends that, and no more.
        let homing = self.mode == Mode::Homing;
        let fault = findings.first().or_else(|| if homing { None } else { released(now, hand) });
        let events = Events {
            heard: self.heard,
            edge: hand.edge,
            healthy: findings.first().is_none(),
            fault: fault.is_some(),
            enabled: feedback.drives.iter().all(|drive| drive.state == DriveState::Enabled),
            homable: findings.leaves_homing() && !toes(feedback).all(has_zero),
            held: hand.held,
            homed: toes(feedback).all(has_zero),
        };
        let next = mode::next(self.mode, events);
        if next != self.mode {
            self.enter(now, next, fault);
        }
    }

    fn enter(&mut self, now: Stamp, next: Mode, fault: Option<Fault>) {
        match (next, fault) {
            (Mode::Arming | Mode::Homing, _) => self.latch.clear(),
            (Mode::Faulted, Some(fault)) => self.latch.set(fault),
            _ => {}
        }
        self.may_get_ready = next != Mode::Faulted;
        self.mode = next;
        self.mode_since = now;
    }

    /// Armed, and nothing to act on that is older than its limit: after a stall of ours that takes a tick or two.
    fn let_through(&mut self, facts: &Facts<'_>) -> JointCommand {
        let measured = &facts.snapshot.toe_position_m;
        let (hip_torque_nm, toe_position_m) = match self.mode {
            Mode::Armed if health::outdated(&self.rules, facts) => (self.torque.close(), self.toes.stay(measured)),
            Mode::Armed => {
                // While it is not known which leg stands, torque may have the wrong sign: positive feedback (thesis 2.1.4).
                let ramp = self.ramp(facts.input.now) * sure(facts.estimate.stance_doubt);
                (self.torque.pass(facts.wanted.hip_torque_nm, ramp), self.toes.follow(&facts.wanted.toe_position_m))
            }
            _ => (self.torque.close(), self.toes.stay(measured)),
        };
        JointCommand { stamp: facts.input.now, hip_torque_nm, toe_position_m }
    }

    /// Share of the torque limit that is open, from 0 at arming to 1.
    fn ramp(&self, now: Stamp) -> f64 {
        let ramp_s = self.rules.limits.ramp.as_s();
        if ramp_s > 0.0 { (now.since(self.mode_since).as_s() / ramp_s).clamp(0.0, 1.0) } else { 1.0 }
    }

    fn note_limits(&mut self, now: Stamp) {
        let late = self.lateness.is_late().then_some((FaultCode::Late, f64::from(self.lateness.skipped())));
        for (code, value) in [late, self.torque.active()].into_iter().flatten() {
            self.latch.tell(Fault { code, index: 0, stamp: now, value });
        }
    }

    fn note_toes(&mut self, facts: &Facts<'_>, allowed: &JointCommand) {
        if self.mode != Mode::Armed {
            return self.astray.rest();
        }
        let (now, measured) = (facts.input.now, &facts.snapshot.toe_position_m);
        if let Some((toe, off_m)) = self.astray.observe(now, &allowed.toe_position_m, measured, facts.estimate) {
            let index = u8::try_from(Drive::InnerToeA as usize + toe).unwrap_or(u8::MAX);
            self.latch.tell(Fault { code: FaultCode::ToeAstray, index, stamp: now, value: off_m });
        }
    }

    fn goal(&mut self, input: &TickInput, hand: Hand) -> DriveGoal {
        let waited = input.now.since(self.mode_since) >= DISABLED_AFTER_FAULT;
        self.may_get_ready |= hand.open && waited;
        match self.mode {
            _ if input.stop_requested => DriveGoal::Disabled,
            Mode::Arming | Mode::Armed => DriveGoal::Enabled,
            Mode::Faulted if !self.may_get_ready => DriveGoal::Disabled,
            Mode::Starting | Mode::Disarmed | Mode::Faulted | Mode::Homing => DriveGoal::Ready,
        }
    }

    fn status(&self, input: &TickInput, findings: &health::Findings) -> Status {
        Status {
            mode: self.mode,
            first_fault: self.latch.first(),
            last_fault: self.latch.last(),
            faults: self.latch.count(),
            arm_blockers: findings.bits(),
            arm_blocker: findings.blocker(),
            ticks: input.index.saturating_add(1),
            overruns: self.lateness.total(),
            wake_latency: input.wake_latency,
            step_time: input.step_time,
        }
    }
}

fn toes(feedback: &DriveFeedbacks) -> impl Iterator<Item = &DriveFeedback> {
    feedback.drives.iter().skip(Drive::InnerToeA as usize)
}

fn has_zero(drive: &DriveFeedback) -> bool {
    drive.zero == ZeroState::Known
}

/// Share of the torque limit that is open at this doubt; none if it is not a number.
const fn sure(doubt: f64) -> f64 {
    if doubt >= 0.0 { 1.0 - doubt.min(1.0) } else { 0.0 }
}

/// The fault of an open hand, told only if nothing else is wrong.
fn released(now: Stamp, hand: Hand) -> Option<Fault> {
    (!hand.held).then_some(Fault { code: FaultCode::DeadManReleased, index: 0, stamp: now, value: 0.0 })
}

#[cfg(test)]
mod tests;
