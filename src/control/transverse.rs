//! Transverse stabilisation of a planned periodic gait. Thesis 4.7. RT: yes.
//!
//! Each tick finds the instant of the plan whose surface goes through the state (`PhaseTable::project`), and corrects
//! what is left, which lies in that surface: nothing is regulated in time. The surfaces are the guard at both ends of a
//! phase, so a touchdown that is early or late is the end of the phase all the same. A touchdown begins the other leg's
//! phase. The hip torque alone stabilises the orbit; the stance toe's push-off makes up for energy that is missing, which
//! the hip cannot give fast enough.

use super::ControllerError;
use super::foot_placement::Wish;
use super::friction::Compensation;
use super::pendulum::{KAPPA2, energy};
use super::planned::{cost, leg_of, read, state_of, torque_nm};
use super::stance_toe::{StanceToe, by_stance, in_order};
use super::tables::{Node, PhaseTable};
use crate::base::linalg::add_scaled;
use crate::base::time::Stamp;
use crate::config::checked::{Config, Transverse as Numbers};
use crate::msg::{Estimate, Leg, Snapshot};

/// The law, and where it is in its step.
#[derive(Clone, Debug)]
pub(super) struct Transverse {
    inner: PhaseTable,
    outer: PhaseTable,
    numbers: Numbers,
    toe_rate_m_s: f64,
    toe_bandwidth_rad_s: f64,
    torque_unit_nm: f64,
    friction: Compensation,
    step: Option<Step>,
}

/// A step: where on the orbit.
#[derive(Clone, Copy, Debug)]
struct Step {
    stance: Leg,
    since: Stamp,
    /// Instant of the plan's phase, s.
    t_s: f64,
    last: Stamp,
    stance_toe: StanceToe,
    swing_toe_out: bool,
}

impl Transverse {
    /// Before arming only.
    ///
    /// # Errors
    /// The plan is no gait with transverse gains for both legs, or another model's.
    pub(super) fn new(config: &Config) -> Result<Self, ControllerError> {
        let mut plan = read(config, "gait")?;
        let cause =
            || ControllerError::Plan { cause: "a gait needs one phase on each leg, with transverse gains".into() };
        let (Some(second), Some(first), true) = (plan.phases.pop(), plan.phases.pop(), plan.periodic) else {
            return Err(cause());
        };
        if leg_of(&first) == leg_of(&second) || !(first.transverse && second.transverse) {
            return Err(cause());
        }
        let (inner, outer) = if first.inner_stands { (first, second) } else { (second, first) };
        let control = &config.control;
        Ok(Self {
            inner,
            outer,
            numbers: control.transverse,
            toe_rate_m_s: config.robot.toe.rate_limit_m_s,
            toe_bandwidth_rad_s: control.foot_placement.toe_bandwidth_rad_s,
            torque_unit_nm: config.robot.model.params().inertia_kg_m2(),
            friction: Compensation::new(&config.robot.model, control.friction_compensation),
            step: None,
        })
    }

    /// The next tick begins a step after one of another law.
    pub(super) const fn reset(&mut self) {
        self.step = None;
    }

    /// At a touchdown: is the state near enough to the orbit? A state on it stays on it up to a larger cost.
    pub(super) fn holds(&self, e: &Estimate, walks: bool) -> bool {
        let phase = self.phase_of(e.stance);
        let node = phase.at(phase.project(&state_of(e), 0.0, FIRST_STEPS));
        let away = cost(&node.transverse_cost, &add_scaled(&state_of(e), -1.0, &node.state));
        away < if walks { self.numbers.leave_cost } else { self.numbers.join_cost }
    }

    /// Torque and toes for this state.
    pub(super) fn step(&mut self, now: Stamp, e: &Estimate, seen: &Snapshot) -> Wish {
        let mut step = match self.step {
            Some(step) if step.stance == e.stance => step,
            _ => self.begin(now, e, seen),
        };
        let phase = self.phase_of(e.stance);
        let near_s = step.t_s + now.since(step.last).as_s();
        step.t_s = phase.project(&state_of(e), near_s, STEPS);
        step.last = now;
        let node = phase.at(step.t_s);
        let hip_rate = e.theta_stance_rad_s - e.theta_swing_rad_s;
        let friction_nm = if seen.late { 0.0 } else { self.torque_unit_nm * self.friction.torque(hip_rate) };
        // Just after the touchdown the observer still settles.
        let share = (now.since(step.since).as_s() / self.numbers.fade_s).min(1.0);
        let hip_torque_nm = torque_nm(e, &node, &node.transverse_gain_nm, share, friction_nm);
        let goal = phase.at(phase.duration_s).state;
        let duration_s = phase.duration_s;
        let (stance_m, swing_m) = self.toes(now, e, &mut step, duration_s, &node);
        self.step = Some(step);
        let [_, swing_goal_rad, ..] = goal;
        Wish {
            hip_torque_nm,
            toe_position_m: in_order(e.stance, stance_m, swing_m),
            phase: step.t_s / duration_s,
            swing_goal_rad,
        }
    }

    const fn phase_of(&self, stance: Leg) -> &PhaseTable {
        match stance {
            Leg::Inner => &self.inner,
            Leg::Outer => &self.outer,
        }
    }

    fn begin(&self, now: Stamp, e: &Estimate, seen: &Snapshot) -> Step {
        let (stance_m, _) = by_stance(&seen.toe_position_m, e.stance);
        let phase = self.phase_of(e.stance);
        Step {
            stance: e.stance,
            since: now,
            t_s: phase.project(&state_of(e), 0.0, FIRST_STEPS),
            last: now,
            stance_toe: StanceToe::new(now, stance_m, self.toe_rate_m_s),
            swing_toe_out: false,
        }
    }

    /// Lengths of stance and swing toe, m.
    fn toes(&self, now: Stamp, e: &Estimate, step: &mut Step, duration_s: f64, node: &Node) -> (f64, f64) {
        let n = &self.numbers;
        step.swing_toe_out |= duration_s - step.t_s < n.toe_out_s && -e.theta_stance_rad > n.toe_out_rad;
        let swing_m = if step.swing_toe_out { n.toe_reach_m } else { 0.0 };
        let [angle, _, rate, _] = node.state;
        let planned = rate * rate - KAPPA2 * angle * angle;
        let lacks = planned - energy(e);
        let push_m =
            if -e.theta_stance_rad > n.push_rad { n.push_m + n.push_per_energy_m_s2_rad2 * lacks } else { 0.0 };
        let kept_m = n.toe_kept * (step.stance_toe.landed_m - n.toe_nominal_m);
        let target_m = n.toe_nominal_m + kept_m + push_m.clamp(0.0, n.push_most_m);
        (step.stance_toe.toward(now, target_m, self.toe_bandwidth_rad_s), swing_m)
    }
}

/// Newton steps to the instant of the plan: each tick from the last one, and from a touchdown.
const STEPS: u32 = 2;
const FIRST_STEPS: u32 = 8;
