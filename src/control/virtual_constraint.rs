//! Virtual constraints: toes and swing leg as functions of the stance angle. Thesis 4.1. RT: yes.
//!
//! No clock: the stance leg falls as it falls, and everything else follows its angle θs.
//! - *Swing leg*: Bézier curve of order 5 by `s`, which runs from 0 at the touchdown to 1 a little before the next one.
//!   The curve leaves with the angle and the rate that the leg has, so nothing jumps; it ends at the foothold.
//!   Beyond s = 1 the leg goes straight on, slightly backwards. Tracked by computed torque (the thesis: gravity only).
//! - *Swing toe*: rises with the stance angle's absolute value beyond a flat middle, with its own steepness on each side,
//!   up to its reach. It goes out later for a longer step: that is when it shall land. A half sine is added at the start
//!   of the swing, the nudge.
//! - *Stance toe*: longest at the vertical, by `-k |θs|`, and pushes off.
//! - *Speed*: by foothold and push-off, from touchdown to touchdown (see `landing`).

use super::foot_placement::Wish;
use super::landing::{Foothold, Landing};
use super::motor_sign;
use super::pendulum::energy;
use super::stance_toe::{StanceToe, by_stance, in_order};
use super::swing::{bezier, coupled_torque};
use crate::base::time::Stamp;
use crate::config::checked::{Config, FootPlacement, VirtualConstraint as Numbers};
use crate::msg::{Estimate, Leg, Snapshot};
use std::f64::consts::PI;

/// The law, and where it is in its step.
#[derive(Clone, Debug)]
pub(super) struct VirtualConstraint {
    numbers: Numbers,
    shared: FootPlacement,
    torque_unit_nm: f64,
    toe_rate_m_s: f64,
    compensation: f64,
    step: Option<Step>,
}

/// A step: the leg it stands on, the curve, the end.
#[derive(Clone, Copy, Debug)]
struct Step {
    stance: Leg,
    since: Stamp,
    /// Stance angle at s = 0, and what it loses until s = 1, rad.
    begins_rad: f64,
    range_rad: f64,
    /// Swing angle at s = 0, and what it gains there by what the stance angle loses.
    from: [f64; 2],
    goal: Foothold,
    /// ξ² that the next step is expected to begin with, without what is learnt.
    next: f64,
    stance_toe: StanceToe,
}

impl VirtualConstraint {
    /// Before arming only.
    pub(super) fn new(config: &Config) -> Self {
        Self {
            numbers: config.control.virtual_constraint,
            shared: config.control.foot_placement,
            torque_unit_nm: config.robot.model.params().inertia_kg_m2(),
            toe_rate_m_s: config.robot.toe.rate_limit_m_s,
            compensation: config.control.friction_compensation,
            step: None,
        }
    }

    /// The next tick begins a step after one of another law.
    pub(super) const fn join(&mut self) {
        self.step = None;
    }

    /// At a touchdown: does the robot pass the vertical without help? Foot placement's swing leg reaches ahead where it does
    /// not, which a curve by the stance angle cannot.
    pub(super) fn holds(e: &Estimate, speed_m_s: f64, landing: &Landing) -> bool {
        energy(e) > landing.slow_energy(speed_m_s)
    }

    /// Torque and toes for this state.
    pub(super) fn step(
        &mut self,
        now: Stamp,
        e: &Estimate,
        seen: &Snapshot,
        speed_m_s: f64,
        landing: &mut Landing,
    ) -> Wish {
        // It does not stop by itself: another law takes over at the next touchdown.
        let speed_m_s = if speed_m_s > 0.0 { speed_m_s } else { self.shared.speed_m_s };
        let mut step = match self.step {
            Some(step) if step.stance == e.stance => step,
            before => self.begin(now, e, seen, before.as_ref(), speed_m_s, landing),
        };
        let s = step.phase(e);
        if s < self.numbers.frozen_phase {
            step.goal = landing.aim(e, speed_m_s);
            step.range_rad = self.range_rad(step.begins_rad, &step.goal);
            step.next = landing.next_energy(e, step.goal.angle_rad) + step.goal.gain;
        }
        let hip_torque_nm = self.track(e, &step, s, seen.late, landing);
        let swing_m = self.swing_toe_m(e.theta_stance_rad, s, step.goal.angle_rad);
        let stance_m = self.stance_toe_m(now, e, &mut step, landing.height_m());
        self.step = Some(step);
        Wish {
            hip_torque_nm,
            toe_position_m: in_order(e.stance, stance_m, swing_m),
            phase: s.clamp(0.0, 1.0),
            swing_goal_rad: step.goal.angle_rad,
        }
    }

    fn begin(
        &self,
        now: Stamp,
        e: &Estimate,
        seen: &Snapshot,
        before: Option<&Step>,
        speed_m_s: f64,
        landing: &mut Landing,
    ) -> Step {
        let (stance_m, swing_m) = by_stance(&seen.toe_position_m, e.stance);
        landing.learn_floor(e, stance_m - swing_m);
        if let Some(last) = before {
            landing.learn_gain(e, last.next);
            landing.learn_speed(e, now.since(last.since).as_s(), speed_m_s);
        }
        let begins_rad = e.theta_stance_rad;
        let goal = landing.aim(e, speed_m_s);
        // A leg that hardly falls would ask for a curve without bound.
        let slope = e.theta_swing_rad_s / (-e.theta_stance_rad_s).max(LEAST_RATE_RAD_S);
        Step {
            stance: e.stance,
            since: now,
            begins_rad,
            range_rad: self.range_rad(begins_rad, &goal),
            from: [e.theta_swing_rad, slope.clamp(-STEEPEST, STEEPEST)],
            goal,
            next: 0.0,
            stance_toe: StanceToe::new(now, stance_m, self.toe_rate_m_s),
        }
    }

    /// What the stance angle loses until the swing leg arrives, rad.
    fn range_rad(&self, begins_rad: f64, goal: &Foothold) -> f64 {
        (begins_rad + self.numbers.arrive_share * goal.angle_rad).max(LEAST_RANGE_RAD)
    }

    /// Computed torque along the curve, + on inner.
    fn track(&self, e: &Estimate, step: &Step, s: f64, late: bool, landing: &Landing) -> f64 {
        let n = &self.numbers;
        let [angle, slope, curvature] = bezier(step.curve(n), s);
        let (w, z) = (n.bandwidth_rad_s, n.damping_ratio);
        // s = (begins - θs) / range, hence ṡ = -θ̇s / range and s̈ = -θ̈s / range.
        let s_rate = -e.theta_stance_rad_s / step.range_rad;
        let free = curvature * s_rate * s_rate
            + 2.0 * z * w * (slope * s_rate - e.theta_swing_rad_s)
            + w * w * (angle - e.theta_swing_rad);
        let share = if late { 0.0 } else { self.compensation };
        let (q, v) = ([e.theta_stance_rad, e.theta_swing_rad], [e.theta_stance_rad_s, e.theta_swing_rad_s]);
        let model = landing.model(e.stance);
        motor_sign(e.stance) * self.torque_unit_nm * coupled_torque(model, q, v, [free, -slope / step.range_rad], share)
    }

    fn swing_toe_m(&self, stance_rad: f64, s: f64, goal_rad: f64) -> f64 {
        let n = &self.numbers;
        let back_m = n.toe_in_m_rad * (stance_rad - n.toe_in_rad).max(0.0);
        let out_m = n.toe_out_m_rad * (-stance_rad - n.toe_out_share * goal_rad).max(0.0);
        let nudge = s / n.nudge_phase;
        let nudge_m = if (0.0..1.0).contains(&nudge) { n.nudge_m * libm::sin(PI * nudge) } else { 0.0 };
        (back_m + out_m + nudge_m).clamp(0.0, self.shared.toe_reach_m)
    }

    fn stance_toe_m(&self, now: Stamp, e: &Estimate, step: &mut Step, floor_m: f64) -> f64 {
        let n = &self.shared;
        let level_m = n.toe_nominal_m - n.floor_share * floor_m - self.numbers.arch_m_rad * e.theta_stance_rad.abs();
        let kept_m = n.toe_kept * (step.stance_toe.landed_m - level_m);
        let push_m = if -e.theta_stance_rad > n.push_rad { step.goal.push_m } else { 0.0 };
        let target_m = (level_m + kept_m + push_m).clamp(n.toe_least_m, n.toe_reach_m);
        step.stance_toe.toward(now, target_m, n.toe_bandwidth_rad_s)
    }
}

impl Step {
    fn phase(&self, e: &Estimate) -> f64 {
        ((self.begins_rad - e.theta_stance_rad) / self.range_rad).max(EARLIEST)
    }

    /// Points of the Bézier curve: no curvature at the ends but what the bends add.
    fn curve(&self, n: &Numbers) -> [f64; 6] {
        let [start, slope] = self.from;
        let end = self.goal.angle_rad;
        let second = start + slope * self.range_rad / 5.0;
        let fifth = end + n.retraction * self.range_rad / 5.0;
        let way = end - start;
        let [bend_early, bend_late] = n.bends;
        let (third, fourth) = (2.0 * second - start + bend_early * way, 2.0 * fifth - end + bend_late * way);
        [start, second, third, fourth, fifth, end]
    }
}

/// Least change of the stance angle in a step, rad; least rate at its start, rad/s.
const LEAST_RANGE_RAD: f64 = 0.08;
const LEAST_RATE_RAD_S: f64 = 0.2;
/// Steepest start of the curve, rad/rad; a step that falls back goes on by so much of a phase.
const STEEPEST: f64 = 3.0;
const EARLIEST: f64 = -0.3;
