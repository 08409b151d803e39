//! A planned one-step rebalance followed in time by TVLQR. Thesis 4.5: a baseline that shows where a clock fails. RT: yes.
//!
//! From balance on one leg a step to balance on the other. The feedback is faded around the expected touchdown, where the
//! leg that the gain is for may not be the one that stands. The plan is extended beyond its touchdown on both sides, and
//! the touchdown that happens decides which side is followed (Saccon 2014): early or late, the reference is the one of the
//! leg that stands, at the plan's time.

use super::ControllerError;
use super::foot_placement::Wish;
use super::friction::Compensation;
use super::planned::{leg_of, read, torque_nm};
use super::stance_toe::{StanceToe, by_stance, in_order};
use super::tables::{PhaseEnd, PhaseTable};
use crate::base::linalg::add_scaled;
use crate::base::time::Stamp;
use crate::config::checked::{Config, Tvlqr as Numbers};
use crate::msg::{Estimate, Leg, Snapshot};

/// The law, and where it is in its plan.
#[derive(Clone, Debug)]
pub(super) struct Tvlqr {
    before: PhaseTable,
    after: PhaseTable,
    numbers: Numbers,
    toe_bandwidth_rad_s: f64,
    torque_unit_nm: f64,
    friction: Compensation,
    since: Option<Stamp>,
    toe: StanceToe,
    stance: Leg,
}

impl Tvlqr {
    /// Before arming only.
    ///
    /// # Errors
    /// The plan is no one-step rebalance from the leg that stands at the start, or another model's.
    pub(super) fn new(config: &Config) -> Result<Self, ControllerError> {
        let mut plan = read(config, "rebalance")?;
        let stance = config.control.stance;
        let (Some(after), Some(before), true) = (plan.phases.pop(), plan.phases.pop(), plan.phases.is_empty()) else {
            return Err(ControllerError::Plan { cause: "a rebalance has two phases".into() });
        };
        if leg_of(&before) != stance || leg_of(&after) == stance || before.end != PhaseEnd::Touchdown {
            let cause = "the rebalance must begin on the leg of control.stance and end on the other".into();
            return Err(ControllerError::Plan { cause });
        }
        Ok(Self {
            before,
            after,
            numbers: config.control.tvlqr,
            toe_bandwidth_rad_s: config.control.foot_placement.toe_bandwidth_rad_s,
            torque_unit_nm: config.robot.model.params().inertia_kg_m2(),
            friction: Compensation::new(&config.robot.model, config.control.friction_compensation),
            since: None,
            toe: StanceToe::new(Stamp(0), 0.0, 0.0),
            stance,
        })
    }

    /// Before the plan begins.
    pub(super) const fn reset(&mut self) {
        self.since = None;
    }

    /// The plan's time is up, and balance may take over.
    pub(super) fn is_over(&self, now: Stamp) -> bool {
        self.since.is_some_and(|since| now.since(since).as_s() >= self.before.duration_s + self.after.duration_s)
    }

    /// Torque and toes for this state.
    pub(super) fn step(&mut self, now: Stamp, e: &Estimate, seen: &Snapshot) -> Wish {
        if self.since.is_none() || self.stance != e.stance {
            let (stance_m, _) = by_stance(&seen.toe_position_m, e.stance);
            self.toe = StanceToe::new(now, stance_m, 0.0);
            self.stance = e.stance;
        }
        let since = *self.since.get_or_insert(now);
        let (t_s, lands_s) = (now.since(since).as_s(), self.before.duration_s);
        let landed = e.stance == leg_of(&self.after);
        let (phase, at_s) = if landed { (&self.after, t_s - lands_s) } else { (&self.before, t_s) };
        let mut node = phase.at(at_s);
        // Beyond the ends of its phase the plan goes on as it began or ended.
        let beyond_s = at_s - at_s.clamp(0.0, phase.duration_s);
        node.state = add_scaled(&node.state, beyond_s.clamp(-LONGEST_S, LONGEST_S), &node.rate);
        let n = &self.numbers;
        let share = ((t_s - lands_s).abs() / n.fade_s).min(1.0);
        let hip_rate = e.theta_stance_rad_s - e.theta_swing_rad_s;
        let friction_nm = if seen.late { 0.0 } else { self.torque_unit_nm * self.friction.torque(hip_rate) };
        let hip_torque_nm = torque_nm(e, &node, &node.time_gain_nm, share, friction_nm);
        let reaches = !landed && t_s > lands_s - n.toe_out_s;
        let swing_m = if reaches { n.toe_reach_m } else { 0.0 };
        let stance_m = self.toe.toward(now, n.toe_nominal_m, self.toe_bandwidth_rad_s);
        let [_, swing_goal_rad, ..] = self.before.at(lands_s).state;
        Wish {
            hip_torque_nm,
            toe_position_m: in_order(e.stance, stance_m, swing_m),
            phase: (t_s / (lands_s + self.after.duration_s)).clamp(0.0, 1.0),
            swing_goal_rad,
        }
    }
}

/// The plan is extended by so much at most, s.
const LONGEST_S: f64 = 0.2;
