//! What is wrong in this tick: looks at everything, changes nothing. RT: yes.
//!
//! The order below is the order of blame: the first finding is the one that is latched.

use super::silence::Ages;
use super::{Facts, Rules};
use crate::base::time::{Span, Stamp};
use crate::msg::{BusHealth, DriveFeedback, DriveState, Element, Estimate, Fault, FaultCode, Mode, Value, ZeroState};
use std::f64::consts::PI;

/// Faults found in a tick: all as bits, the first with its values.
#[derive(Clone, Copy, Debug)]
pub(super) struct Findings {
    now: Stamp,
    /// Bits of what is no fault in this mode.
    tolerated: u64,
    first: Option<Fault>,
    /// The first at all, tolerated or not.
    blocker: Fault,
    bits: u64,
}

/// What does not matter while the toes look for their zero: the posture, which nobody knows before.
const HOMING_TOLERATES: u64 = 1 << FaultCode::ZeroUnknown as u8
    | 1 << FaultCode::TiltLimit as u8
    | 1 << FaultCode::FellForward as u8
    | 1 << FaultCode::FellBackward as u8
    | 1 << FaultCode::StanceLost as u8
    | 1 << FaultCode::RateLimit as u8
    | 1 << FaultCode::EstimateLost as u8
    | 1 << FaultCode::OutOfRange as u8;

impl Findings {
    fn none(now: Stamp, mode: Mode) -> Self {
        let tolerated = if matches!(mode, Mode::Homing) { HOMING_TOLERATES } else { 0 };
        Self { now, tolerated, first: None, blocker: Fault::default(), bits: 0 }
    }

    fn note(&mut self, wrong: bool, code: FaultCode, index: usize, value: f64) {
        if wrong {
            let bit = 1 << code as u8;
            let fault = Fault { code, index: u8::try_from(index).unwrap_or(u8::MAX), stamp: self.now, value };
            if self.bits == 0 {
                self.blocker = fault;
            }
            self.bits |= bit;
            if self.tolerated & bit == 0 {
                self.first.get_or_insert(fault);
            }
        }
    }

    /// Nothing was found that stands in the way of homing.
    pub(super) const fn leaves_homing(&self) -> bool {
        self.bits & !HOMING_TOLERATES == 0
    }

    /// The first in the order of blame.
    pub(super) const fn first(&self) -> Option<Fault> {
        self.first
    }

    /// The first that stands in the way of arming.
    pub(super) const fn blocker(&self) -> Fault {
        self.blocker
    }

    /// Bit i is fault code i.
    pub(super) const fn bits(&self) -> u64 {
        self.bits
    }

    /// True if this was found.
    pub(super) const fn has(&self, code: FaultCode) -> bool {
        self.bits & (1 << code as u8) != 0
    }
}

/// Young enough, and not from the future: a stamp ahead of us would never grow old.
pub(super) fn fresh(age: Span, limit: Span) -> bool {
    -limit.0 <= age.0 && age <= limit
}

/// What the guard itself keeps in mind from tick to tick, as far as it bears on health.
#[derive(Clone, Copy, Debug)]
pub(super) struct Memory {
    pub(super) mode: Mode,
    pub(super) mode_since: Stamp,
    /// Periods skipped within the last second.
    pub(super) skipped: u32,
    /// How long each source has been silent, our own stalls left out.
    pub(super) silent: Ages,
}

/// Looks at everything.
pub(super) fn examine(rules: &Rules, facts: &Facts<'_>, memory: &Memory) -> Findings {
    let (mode, skipped) = (memory.mode, memory.skipped);
    let mut found = Findings::none(facts.input.now, mode);
    found.note(facts.input.stop_requested, FaultCode::Stopping, 0, 0.0);
    numbers(&mut found, facts);
    // Before whatever looks late or dead to a loop that stood still itself: stopped for .3 s, the bus was blamed.
    found.note(skipped > rules.limits.overruns_per_s, FaultCode::Overrun, 0, f64::from(skipped));
    buses(&mut found, facts);
    drives(&mut found, rules, facts, memory);
    sensors(&mut found, rules, facts, memory);
    posture(&mut found, rules, facts, mode);
    demand(&mut found, rules, facts, mode);
    let missing = facts.input.real_time_missing;
    found.note(missing != 0, FaultCode::NotRealTime, 0, f64::from(missing));
    found
}

fn numbers(found: &mut Findings, facts: &Facts<'_>) {
    let finite = [all_finite(facts.snapshot), all_finite(facts.estimate), all_finite(facts.wanted)];
    for (index, finite) in finite.into_iter().enumerate() {
        found.note(!finite, FaultCode::NotFinite, index, 0.0);
    }
}

/// True if every number in the message is finite.
fn all_finite(message: &impl Element) -> bool {
    let mut finite = true;
    message.put(&mut |leaf| finite &= !matches!(leaf, Value::F64(x) if !x.is_finite()));
    finite
}

fn buses(found: &mut Findings, facts: &Facts<'_>) {
    for (index, (seen, told)) in facts.input.bus_health.iter().zip(&facts.feedback.health).enumerate() {
        let worst = *seen.max(told);
        let dead = !matches!(worst, BusHealth::Active | BusHealth::Passive);
        found.note(dead, FaultCode::BusUnhealthy, index, f64::from(worst as u8));
    }
}

/// Some source's word is too old to act on, be it its own fault or that of a stall of ours.
pub(super) fn outdated(rules: &Rules, facts: &Facts<'_>) -> bool {
    let mut drives = facts.feedback.drives.iter().zip(&rules.drive_age);
    !fresh(facts.snapshot.imu_age, rules.limits.imu_age)
        || drives.any(|(drive, limit)| !fresh(facts.input.now.since(drive.stamp), *limit))
}

fn drives(found: &mut Findings, rules: &Rules, facts: &Facts<'_>, memory: &Memory) {
    let timed_out = facts.input.now.since(memory.mode_since) > rules.limits.enable_timeout;
    let drives = facts.feedback.drives.iter().zip(&rules.drive_age).zip(memory.silent.drives);
    for (index, ((drive, limit), silent)) in drives.enumerate() {
        let broken = drive.state == DriveState::Fault || drive.error_code != 0;
        found.note(broken, FaultCode::DriveFault, index, f64::from(drive.error_code));
        let astray = !in_place(drive, memory.mode, timed_out);
        found.note(astray, FaultCode::DriveNotEnabled, index, f64::from(drive.state as u8));
        let silent = if drive.stamp == Stamp::NEVER { Span(i64::MAX) } else { silent };
        let silent = unless_too_old(rules, facts.input.now.since(drive.stamp), *limit, silent);
        found.note(!fresh(silent, *limit), FaultCode::DriveStale, index, silent.as_s() * 1e3);
        let failed = drive.zero == ZeroState::Failed && memory.mode == Mode::Homing;
        found.note(failed, FaultCode::HomingFailed, index, 0.0);
        found.note(drive.zero != ZeroState::Known, FaultCode::ZeroUnknown, index, f64::from(drive.zero as u8));
    }
}

/// The silence, our stalls left out; but the whole age once our stall is too long to be excused.
fn unless_too_old(rules: &Rules, age: Span, limit: Span, silent: Span) -> Span {
    if age.0 > limit.0.saturating_add(rules.longest_stall.0) { age } else { silent }
}

/// The drive is where this mode needs it.
fn in_place(drive: &DriveFeedback, mode: Mode, timed_out: bool) -> bool {
    let waiting = matches!(drive.state, DriveState::Ready | DriveState::SwitchedOn);
    let enabled = drive.state == DriveState::Enabled;
    match mode {
        Mode::Armed => enabled,
        // Toes are being enabled, the hip stays without power.
        Mode::Homing => enabled || waiting || drive.state == DriveState::SwitchOnDisabled,
        Mode::Arming => enabled || (!timed_out && (waiting || drive.state == DriveState::SwitchOnDisabled)),
        Mode::Starting | Mode::Disarmed | Mode::Faulted => waiting,
    }
}

fn sensors(found: &mut Findings, rules: &Rules, facts: &Facts<'_>, memory: &Memory) {
    let (seen, limits) = (facts.snapshot, &rules.limits);
    let silent = unless_too_old(rules, seen.imu_age, limits.imu_age, memory.silent.imu);
    found.note(!fresh(silent, limits.imu_age), FaultCode::ImuStale, 0, silent.as_s() * 1e3);
    let silent = !fresh(seen.operator_age, limits.operator_age);
    found.note(silent, FaultCode::OperatorStale, 0, seen.operator_age.as_s() * 1e3);
    for (index, angle) in [seen.leg_angle_rad, seen.hip_angle_rad].into_iter().enumerate() {
        found.note(angle.abs() > PI, FaultCode::OutOfRange, index, angle);
    }
}

fn posture(found: &mut Findings, rules: &Rules, facts: &Facts<'_>, mode: Mode) {
    let (state, limits) = (facts.estimate, &rules.limits);
    let active = matches!(mode, Mode::Arming | Mode::Armed);
    let tilt_rad = if active { limits.tilt_rad } else { limits.arm_tilt_rad };
    let (stance, swing) = (state.theta_stance_rad, state.theta_swing_rad);
    let (code, value) = fall(state);
    found.note(stance.abs() > tilt_rad, code, 0, value);
    for (leg, both) in [BOTH_OF_INNER, BOTH_OF_OUTER].into_iter().enumerate() {
        found.note(state.stuck_pots & both == both, FaultCode::ToesBlind, leg, f64::from(state.stuck_pots));
    }
    found.note(swing.abs() > limits.swing_rad, FaultCode::TiltLimit, 1, swing);
    for (index, rate) in [state.theta_stance_rad_s, state.theta_swing_rad_s].into_iter().enumerate() {
        found.note(rate.abs() > limits.rate_rad_s, FaultCode::RateLimit, index, rate);
    }
    let innovation = state.innovation_stance_rad.abs().max(state.innovation_swing_rad.abs());
    let lost = !state.valid || innovation > limits.innovation_rad;
    found.note(lost, FaultCode::EstimateLost, 0, innovation);
}

/// Both spring sensors of a leg among the stuck ones.
const BOTH_OF_INNER: u8 = 0b0011;
const BOTH_OF_OUTER: u8 = 0b1100;
/// More doubt about the stance leg than this makes it the cause of a fall.
const DOUBTFUL: f64 = 0.5;

/// What a stance leg beyond its limit is called: walking leans forwards when a foothold comes late, backwards when the leg
/// does not pass the vertical.
fn fall(state: &Estimate) -> (FaultCode, f64) {
    if state.steps == 0 {
        (FaultCode::TiltLimit, state.theta_stance_rad)
    } else if state.stance_doubt > DOUBTFUL {
        (FaultCode::StanceLost, state.weight_elsewhere)
    } else if state.theta_stance_rad < 0.0 {
        (FaultCode::FellForward, state.theta_stance_rad)
    } else {
        (FaultCode::FellBackward, state.theta_stance_rad)
    }
}

fn demand(found: &mut Findings, rules: &Rules, facts: &Facts<'_>, mode: Mode) {
    let torque_nm = facts.wanted.hip_torque_nm;
    let absurd = torque_nm.abs() > rules.limits.demand_factor * rules.limits.hip_torque_nm;
    found.note(absurd && mode == Mode::Armed, FaultCode::TorqueDemand, 0, torque_nm);
}
