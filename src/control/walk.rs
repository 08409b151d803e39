//! The supervisor: stand, step in, walk at a commanded speed, stop, rest. RT: yes.
//!
//! ```text
//!       asked for, settled, leg back   second touchdown            speed 0 asked for          both feet down, slow
//!   Stand ───────────────────> StepIn ─────────────────> Walk ───────────────────────> Stop ─────────────────────> Rest
//!   (LQR)                      (foot placement)            (the walking law)           (long steps)    (no torque)
//!                                                         ^                                                        │ ^
//!                                                         │ will pass the vertical         asked for, still        │ │ does not get over,
//!                                                         └────────────────────── Lean <───────────────────────────┘ │ or not asked for
//!                                                                  (toes push, no torque) ───────────────────────────┘
//! ```
//! A speed that is asked for while it stops: Stop, Walk.
//! Standing out of the basin of balance, it recovers along the LQR-tree if it has one, and stands again:
//! Stand, Recover (up to two steps), Stand. If it moves as in a walk and a speed is asked for, it walks on instead: Stand, Walk.
//! With a one-step rebalance (TVLQR) in the place of a walking law: Stand, StepIn, Stand on the other leg.

use super::asked_speed::AskedSpeed;
use super::balance::{Balance, Pose};
use super::foot_placement::Wish;
use super::gait::Gait;
use super::hold::Hold;
use super::lean::{Lean, STILL_RAD_S};
use super::lqr_tree::LqrTree;
use super::pendulum::energy;
use super::ramp::{Ticks, toward};
use super::{ControllerError, ToeLengths};
use crate::base::time::{Span, Stamp};
use crate::config::checked::Config;
use crate::msg::{ControlState, Estimate, LawName, Motion, Snapshot};

/// Laws and mode.
#[derive(Clone, Debug)]
pub(super) struct Walk {
    balance: Balance,
    gait: Gait,
    asked_speed: AskedSpeed,
    toes: ToeLengths,
    motion: Motion,
    first_step: u32,
    /// Steps when the last touchdown of a stop was awaited.
    stop_step: u32,
    /// Speed last asked for, m/s: a step is finished as it was begun.
    walked_m_s: f64,
    hold: Hold,
    /// Steps in the last tick, and when that number last changed: both feet were on the ground.
    steps: u32,
    landed: Stamp,
    lean: Lean,
    /// When the torque begins to fade at rest.
    lets_go: Stamp,
    /// How often it has leant in vain for the speed that is asked for.
    failures: u32,
    /// Where balance holds the swing leg, rad: it goes back before the first step, to swing forward from there.
    swing_rad: f64,
    first_swing_rad: f64,
    ticks: Ticks,
    /// When the legs were last seen to move.
    moved: Stamp,
    recovery: Option<LqrTree>,
    /// Since when it is to step in.
    asked: Stamp,
}

impl Walk {
    /// Before arming only.
    ///
    /// # Errors
    /// No gain for balance, or no plan for the law.
    pub(super) fn new(config: &Config) -> Result<Self, ControllerError> {
        Ok(Self {
            balance: Balance::new(config)?,
            gait: Gait::new(config)?,
            asked_speed: AskedSpeed::new(config),
            toes: ToeLengths::new(&config.robot.toe),
            motion: Motion::Stand,
            first_step: 0,
            stop_step: 0,
            walked_m_s: 0.0,
            hold: Hold::spring(&config.control),
            steps: 0,
            landed: Stamp::NEVER,
            lean: Lean::new(config),
            lets_go: Stamp::NEVER,
            failures: 0,
            swing_rad: 0.0,
            first_swing_rad: -config.control.foot_placement.first_back_rad,
            ticks: Ticks::new(config),
            moved: Stamp::NEVER,
            recovery: if config.control.walk.recover { Some(LqrTree::new(config)?) } else { None },
            asked: Stamp::NEVER,
        })
    }

    /// On arming.
    pub(super) fn reset(&mut self, now: Stamp, e: &Estimate) {
        if let Some(recovery) = &mut self.recovery {
            recovery.reset(now, e);
        }
        self.motion = Motion::Stand;
        self.asked_speed.reset(now);
        self.ticks.reset(now);
        self.moved = now;
        self.asked = now;
        self.landed = Stamp::NEVER;
        self.swing_rad = 0.0;
        self.failures = 0;
        self.gait.reset();
    }

    /// Torque and toes, and what it is about.
    pub(super) fn step(&mut self, now: Stamp, e: &Estimate, seen: &Snapshot) -> (Wish, ControlState) {
        let speed_m_s = self.asked_speed.m_s(now, seen);
        if e.steps != self.steps {
            self.steps = e.steps;
            self.landed = now;
        }
        self.draw_back(now, speed_m_s);
        if speed_m_s > 0.0 {
            self.walked_m_s = speed_m_s;
        } else {
            self.asked = now;
            self.failures = 0;
            self.lean.stop_pushing(now);
        }
        let is_quiet = if self.motion == Motion::Rest { is_still(e) } else { self.is_settled(now, e, speed_m_s) };
        if !is_quiet {
            self.moved = now;
        }
        self.change(now, e, seen, speed_m_s);
        if let Some(answer) = self.recover(now, e, seen) {
            return answer;
        }
        let (wish, law) = match self.motion {
            Motion::Rest => (self.rest(now, e), LawName::Hold),
            Motion::Lean => {
                let toe_position_m = self.lean.push(now, e.stance);
                (Wish { toe_position_m, ..Wish::default() }, LawName::Hold)
            }
            Motion::Stand => {
                self.first_step = e.steps;
                let hip_torque_nm = self.balance.torque_nm(e, seen.late, self.swing_rad);
                let toe_position_m = self.toes.for_stance(e.stance);
                (Wish { hip_torque_nm, toe_position_m, ..Wish::default() }, LawName::Balance)
            }
            motion => {
                let stops_later = motion == Motion::Stop && e.steps == self.stop_step;
                let speed_m_s = if stops_later { self.walked_m_s } else { speed_m_s };
                self.gait.step(now, e, seen, speed_m_s, motion)
            }
        };
        let state = ControlState {
            stamp: now,
            law,
            motion: self.motion,
            phase: wish.phase,
            steps: e.steps.wrapping_sub(self.first_step),
            speed_m_s,
            swing_goal_rad: wish.swing_goal_rad,
        };
        (wish, state)
    }

    /// What the tree says where balance does not recover; `None` where it does, and while it walks.
    fn recover(&mut self, now: Stamp, e: &Estimate, seen: &Snapshot) -> Option<(Wish, ControlState)> {
        let recovers = self.motion == Motion::Recover;
        if !recovers && self.motion != Motion::Stand {
            return None;
        }
        let pose = self.balance.pose(e.stance, self.swing_rad);
        let recovery = self.recovery.as_mut()?;
        if !recovers {
            if !recovery.is_needed(e, [pose.stance_rad, self.swing_rad]) {
                return None;
            }
            recovery.reset(now, e);
        }
        let (wish, state) = recovery.step(now, e, seen);
        self.motion = state.motion;
        // It stands about upright; the swing leg goes back from there.
        self.swing_rad = 0.0;
        self.moved = now;
        Some((wish, state))
    }

    fn change(&mut self, now: Stamp, e: &Estimate, seen: &Snapshot, speed_m_s: f64) {
        let next = self.next(now, e, speed_m_s);
        if next == self.motion {
            return;
        }
        match (self.motion, next) {
            (_, Motion::Stop) => self.stop_step = e.steps,
            (Motion::Lean, Motion::Rest) => {
                self.failures += 1;
                self.moved = now;
            }
            (_, Motion::Rest) => {
                self.hold.reset(e);
                self.lean.reset(now);
                self.lets_go = now + ROCKS;
                self.moved = now;
            }
            (_, Motion::Lean) => self.lean.begin(),
            (Motion::Lean | Motion::Stand, Motion::Walk) => self.gait.step_off(now, e, seen),
            _ => {}
        }
        self.motion = next;
    }

    fn next(&self, now: Stamp, e: &Estimate, speed_m_s: f64) -> Motion {
        let asked = speed_m_s > 0.0;
        match self.motion {
            Motion::Stand if asked && self.walks(e, speed_m_s) => Motion::Walk,
            Motion::Stand if asked && now.since(self.moved) > QUIET && !self.gait.is_over(now) => Motion::StepIn,
            Motion::StepIn if self.gait.is_rebalance() => {
                if self.gait.is_over(now) {
                    Motion::Stand
                } else {
                    Motion::StepIn
                }
            }
            Motion::StepIn if e.steps.wrapping_sub(self.first_step) >= 1 => Motion::Walk,
            Motion::Walk if !asked => Motion::Stop,
            Motion::Stop if asked => Motion::Walk,
            Motion::Stop if self.may_rest(now, e) => Motion::Rest,
            Motion::Rest if asked && self.may_lean(now) => Motion::Lean,
            // Asked for no more, it may be on its way over already: then the step that catches it is made.
            Motion::Lean if self.passes(e, speed_m_s) => Motion::Walk,
            Motion::Lean if self.lean.failed(now, e, &self.front_pose(e)) => Motion::Rest,
            motion => motion,
        }
    }

    /// It moves as in a walk: on its way over the vertical, or beyond it, with what the speed that is asked for needs. Only a
    /// robot that is to recover: without, whoever pushes one that stands does not make it walk.
    fn walks(&self, e: &Estimate, speed_m_s: f64) -> bool {
        let goes_on = e.theta_stance_rad_s < 0.0 && energy(e) > self.gait.slow_energy(speed_m_s);
        goes_on && self.recovery.is_some() && !self.gait.is_rebalance()
    }

    /// It stands still without torque, and has not tried too often.
    fn may_lean(&self, now: Stamp) -> bool {
        self.held_share(now) <= 0.0 && now.since(self.moved) > QUIET && self.failures < MOST_FAILURES
    }

    /// Leaning, it will pass the vertical.
    fn passes(&self, e: &Estimate, speed_m_s: f64) -> bool {
        self.lean.passes(e, &self.front_pose(e), self.gait.slow_energy(speed_m_s.max(SLOWEST_M_S)))
    }

    /// At rest over the front foot, the other leg where it is.
    fn front_pose(&self, e: &Estimate) -> Pose {
        self.balance.pose(e.stance, e.theta_swing_rad)
    }

    /// Astride, both feet just down, and too slow to pass the new stance leg. In the middle of a step the legs may be side by
    /// side: held so, they are no stance to rock on, and the robot falls.
    fn may_rest(&self, now: Stamp, e: &Estimate) -> bool {
        let stops = e.steps != self.stop_step && energy(e) < 0.0;
        stops && now.since(self.landed) < BOTH_DOWN && e.theta_stance_rad * e.theta_swing_rad < 0.0
    }

    /// The swing leg goes back before a first step, and forward again if none is asked for.
    fn draw_back(&mut self, now: Stamp, speed_m_s: f64) {
        let goal_rad = self.goal_rad(speed_m_s);
        let most_rad = BACK_RAD_S * self.ticks.since_last_s(now);
        self.swing_rad = toward(self.swing_rad, goal_rad, most_rad);
    }

    const fn goal_rad(&self, speed_m_s: f64) -> f64 {
        if speed_m_s > 0.0 && !self.gait.is_rebalance() { self.first_swing_rad } else { 0.0 }
    }

    /// The swing leg is back and the legs have settled: out of a balance that still recovers, a step would go wrong.
    /// A robot whose model is wrong sways; the longer it waits, the more of that is taken.
    fn is_settled(&self, now: Stamp, e: &Estimate, speed_m_s: f64) -> bool {
        let patience = 1.0 + now.since(self.asked).as_s() / PATIENCE_S;
        let has_settled = |angle_rad: f64, rate_rad_s: f64, [most_rad, most_rad_s]: [f64; 2]| {
            angle_rad.abs() < patience * most_rad && rate_rad_s.abs() < patience * most_rad_s
        };
        let stance_rad = self.balance.pose(e.stance, self.swing_rad).stance_rad;
        (self.swing_rad - self.goal_rad(speed_m_s)).abs() < f64::EPSILON
            && has_settled(e.theta_stance_rad - stance_rad, e.theta_stance_rad_s, SETTLED_STANCE)
            && has_settled(e.theta_swing_rad - self.swing_rad, e.theta_swing_rad_s, SETTLED_SWING)
    }

    /// Holds the legs apart until they are still, then lets the torque go: two legs apart stand by friction.
    fn rest(&mut self, now: Stamp, e: &Estimate) -> Wish {
        if now.since(self.moved) > STILL && now < self.lets_go {
            self.lets_go = now;
        }
        let hip_torque_nm = self.held_share(now) * self.hold.torque_nm(e);
        Wish { hip_torque_nm, toe_position_m: self.lean.rest(now), ..Wish::default() }
    }

    /// Share of the torque at rest that is left.
    fn held_share(&self, now: Stamp) -> f64 {
        (1.0 - now.since(self.lets_go).as_s() / FADE_S).clamp(0.0, 1.0)
    }
}

/// Neither leg turns; both feet are down, and the rates are those of gyro and encoder.
const fn is_still(e: &Estimate) -> bool {
    e.theta_stance_rad_s.abs() < STILL_RAD_S && e.theta_swing_rad_s.abs() < STILL_RAD_S
}

/// Speed at which the swing leg is drawn back, rad/s.
const BACK_RAD_S: f64 = 0.3;
/// Angle, rad, and rate, rad/s, within which the legs have settled: just above the limit cycle that stiction leaves.
const SETTLED_STANCE: [f64; 2] = [0.012, 0.04];
const SETTLED_SWING: [f64; 2] = [0.1, 0.3];
/// Twice as much is taken after so long, s.
const PATIENCE_S: f64 = 4.0;
/// A step begins after the legs have settled for so long.
const QUIET: Span = Span::from_ms(200);
/// So long after a touchdown the foot that leaves is still near the ground: its toe goes in by 12 mm in this time.
const BOTH_DOWN: Span = Span::from_ms(50);
/// It rocks from foot to foot for less than this (every landing takes a quarter of the energy); then the torque fades.
const ROCKS: Span = Span::from_ms(6000);
const FADE_S: f64 = 0.5;
/// Still for so long it rocks no more: on one foot it would fall by .4 rad/s² or more.
const STILL: Span = Span::from_ms(500);
/// Out of rest it steps off as for this speed at least, m/s: a stick asks for more and more while it leans.
const SLOWEST_M_S: f64 = 0.3;
/// So often it leans in vain; then it rests until it is asked anew.
const MOST_FAILURES: u32 = 6;
