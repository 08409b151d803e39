//! Transverse stabilisation of a planned periodic gait. Thesis 4.7. RT: yes.
//!
//! Each tick finds the instant of the plan whose surface goes through the state (`PhaseTable::project`), and corrects
//! what is left, which lies in that surface: nothing is regulated in time. The surfaces are the guard at both ends of a
//! phase, so a touchdown that is early or late is the end of the phase all the same. A touchdown begins the other leg's
//! phase. The hip torque alone stabilises the orbit; the stance toe's push-off makes up for energy that is missing, which
//! the hip cannot give fast enough. What the plan leaves out (toes, a wrong model) shows as energy that is missing at every
//! touchdown on a leg; it is learnt, and pushed from the step before on.

use super::ControllerError;
use super::foot_placement::Wish;
use super::friction::Compensation;
use super::landing::{Landing, Steady};
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
    floor_share: f64,
    torque_unit_nm: f64,
    friction: Compensation,
    step: Option<Step>,
    /// ξ² that is missing at the touchdown on each leg if no more is pushed, rad²/s².
    lacks: [f64; 2],
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
        passes(&config.control.plan.name, [&inner, &outer], control.transverse.least_energy)?;
        Ok(Self {
            inner,
            outer,
            numbers: control.transverse,
            toe_rate_m_s: config.robot.toe.rate_limit_m_s,
            toe_bandwidth_rad_s: control.foot_placement.toe_bandwidth_rad_s,
            floor_share: control.foot_placement.floor_share,
            torque_unit_nm: config.robot.model.params().inertia_kg_m2(),
            friction: Compensation::new(&config.robot.model, control.friction_compensation),
            step: None,
            lacks: [0.0; 2],
        })
    }

    /// On arming: the robot may be another one than before.
    pub(super) const fn reset(&mut self) {
        self.step = None;
        self.lacks = [0.0; 2];
    }

    /// The next tick begins a step after one of another law. What was learnt stays.
    pub(super) const fn join(&mut self) {
        self.step = None;
    }

    /// The orbit as steady walking of foot placement, for its steps before and between.
    pub(super) fn steady(&self, leg_m: f64) -> Steady {
        let touchdown = |phase: &PhaseTable| -phase.at(phase.duration_s).state[0];
        let angle_rad = 0.5 * (touchdown(&self.inner) + touchdown(&self.outer));
        let way_m = 4.0 * leg_m * libm::sin(angle_rad);
        Steady::of_orbit(way_m / (self.inner.duration_s + self.outer.duration_s), angle_rad)
    }

    /// At a touchdown: is the state near enough to the orbit, and does the robot pass the vertical? A state on the orbit
    /// stays on it up to a larger cost.
    pub(super) fn holds(&self, e: &Estimate, walks: bool) -> bool {
        let n = &self.numbers;
        let phase = self.phase_of(e.stance);
        let node = phase.at(phase.project(&state_of(e), 0.0, FIRST_STEPS));
        let away = cost(&node.transverse_cost, &add_scaled(&state_of(e), -1.0, &node.state));
        away < if walks { n.leave_cost } else { n.join_cost } && energy(e) > n.least_energy
    }

    /// Torque and toes for this state.
    pub(super) fn step(&mut self, now: Stamp, e: &Estimate, seen: &Snapshot, landing: &mut Landing) -> Wish {
        let mut step = match self.step {
            Some(step) if step.stance == e.stance => step,
            before => self.begin(now, e, seen, before.is_some(), landing),
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
        let (stance_m, swing_m) = self.toes(now, e, &mut step, duration_s, &node, landing.height_m());
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

    fn begin(&mut self, now: Stamp, e: &Estimate, seen: &Snapshot, walks: bool, landing: &mut Landing) -> Step {
        let (stance_m, swing_m) = by_stance(&seen.toe_position_m, e.stance);
        let phase = self.phase_of(e.stance);
        let lacks = planned_energy(&phase.at(0.0)) - energy(e);
        let t_s = phase.project(&state_of(e), 0.0, FIRST_STEPS);
        if walks {
            landing.learn_floor(e, stance_m - swing_m);
            let learnt = self.lacks_of(e.stance) + self.numbers.learning * lacks;
            self.set_lacks(e.stance, learnt.clamp(-MOST_LACKS, MOST_LACKS));
        }
        Step {
            stance: e.stance,
            since: now,
            t_s,
            last: now,
            stance_toe: StanceToe::new(now, stance_m, self.toe_rate_m_s),
            swing_toe_out: false,
        }
    }

    const fn lacks_of(&self, stance: Leg) -> f64 {
        let [inner, outer] = self.lacks;
        match stance {
            Leg::Inner => inner,
            Leg::Outer => outer,
        }
    }

    const fn set_lacks(&mut self, stance: Leg, lacks: f64) {
        let [inner, outer] = &mut self.lacks;
        match stance {
            Leg::Inner => *inner = lacks,
            Leg::Outer => *outer = lacks,
        }
    }

    /// Lengths of stance and swing toe, m, `floor_m` being the foothold's height over the mean floor.
    fn toes(
        &self,
        now: Stamp,
        e: &Estimate,
        step: &mut Step,
        duration_s: f64,
        node: &Node,
        floor_m: f64,
    ) -> (f64, f64) {
        let n = &self.numbers;
        step.swing_toe_out |= duration_s - step.t_s < n.toe_out_s && -e.theta_stance_rad > n.toe_out_rad;
        let swing_m = if step.swing_toe_out { n.toe_reach_m } else { 0.0 };
        let lacks = planned_energy(node) - energy(e) + self.lacks_of(e.stance.other());
        let wanted_m = (n.push_m + n.push_per_energy_m_s2_rad2 * lacks).clamp(n.push_least_m, n.push_most_m);
        // A toe that goes in brakes, and takes clearance from the swing leg until that has passed.
        let pushes = -e.theta_stance_rad > n.push_rad && (wanted_m > 0.0 || step.swing_toe_out);
        let push_m = if pushes { wanted_m } else { 0.0 };
        let level_m = n.toe_nominal_m - self.floor_share * floor_m;
        let kept_m = n.toe_kept * (step.stance_toe.landed_m - level_m);
        let target_m = (level_m + kept_m + push_m).clamp(0.0, n.toe_reach_m);
        (step.stance_toe.toward(now, target_m, self.toe_bandwidth_rad_s), swing_m)
    }
}

/// A touchdown on the orbit itself must not be left to foot placement.
#[expect(clippy::disallowed_macros, reason = "before arming")]
fn passes(name: &str, phases: [&PhaseTable; 2], least: f64) -> Result<(), ControllerError> {
    let begins = phases.map(|phase| planned_energy(&phase.at(0.0))).into_iter().fold(f64::INFINITY, f64::min);
    if begins > least {
        return Ok(());
    }
    let cause = format!(
        "{name}: a step begins with a squared passing rate of {begins:.3} rad²/s², and below \
         control.transverse.least_energy = {least} foot placement walks; plan a faster gait or shorter steps"
    );
    Err(ControllerError::Plan { cause })
}

/// ξ² of the orbit at an instant of the plan, rad²/s².
fn planned_energy(node: &Node) -> f64 {
    let [angle, _, rate, _] = node.state;
    rate * rate - KAPPA2 * angle * angle
}

/// Most of ξ² that is believed to be missing at every touchdown, rad²/s².
const MOST_LACKS: f64 = 0.3;
/// Newton steps to the instant of the plan: each tick from the last one, and from a touchdown.
const STEPS: u32 = 2;
const FIRST_STEPS: u32 = 8;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::load;

    fn law(keys: &[&str]) -> Result<(Transverse, Landing), ControllerError> {
        let keys: Vec<String> =
            [&["control.controller=transverse"], keys].concat().iter().map(|k| (*k).into()).collect();
        let config = load(None, &keys).unwrap().config;
        Ok((Transverse::new(&config)?, Landing::new(&config)))
    }

    /// At the touchdown on a leg, on the orbit but for the stance leg's rate.
    fn touchdown(law: &Transverse, stance: Leg, slower_rad_s: f64) -> Estimate {
        let [stance_rad, swing_rad, rate, swing_rate] = law.phase_of(stance).at(0.0).state;
        Estimate {
            valid: true,
            stance,
            theta_stance_rad: stance_rad,
            theta_swing_rad: swing_rad,
            theta_stance_rad_s: rate + slower_rad_s,
            theta_swing_rad_s: swing_rate,
            ..Estimate::default()
        }
    }

    #[test]
    fn a_touchdown_that_hardly_passes_the_vertical_is_not_its_own() {
        let (law, _) = law(&[]).unwrap();
        for stance in [Leg::Inner, Leg::Outer] {
            assert!(law.holds(&touchdown(&law, stance, 0.0), true));
            let mut e = touchdown(&law, stance, 0.0);
            e.theta_stance_rad_s = -libm::sqrt(KAPPA2 * e.theta_stance_rad * e.theta_stance_rad + 0.02);
            assert!(energy(&e) < law.numbers.least_energy && !law.holds(&e, true));
        }
    }

    #[test]
    fn a_plan_whose_own_steps_hardly_pass_is_refused_with_both_numbers() {
        let error = law(&["control.transverse.least_energy=0.9"]).unwrap_err().to_string();
        assert!(error.contains("least_energy = 0.9") && error.contains("squared passing rate of 0."), "{error}");
    }

    #[test]
    fn energy_that_is_missing_at_every_touchdown_on_a_leg_is_pushed_in_the_step_before() {
        let (mut law, mut landing) = law(&[]).unwrap();
        landing.reset();
        let seen = Snapshot { toe_position_m: [law.numbers.toe_nominal_m; 4], ..Snapshot::default() };
        let slow = touchdown(&law, Leg::Outer, 0.03);
        let missing = planned_energy(&law.outer.at(0.0)) - energy(&slow);
        for k in 0..200 {
            let stance = if k % 2 == 0 { Leg::Inner } else { Leg::Outer };
            let e = if k % 2 == 0 { touchdown(&law, stance, 0.0) } else { slow };
            law.step(Stamp(k * 500_000_000), &e, &seen, &mut landing);
        }
        let most = missing.min(MOST_LACKS);
        assert!(missing > 0.01 && law.lacks_of(Leg::Outer) >= 0.99 * most && law.lacks_of(Leg::Inner).abs() < 1e-9);
        law.join();
        assert!(law.lacks_of(Leg::Outer) >= 0.99 * most, "a step of another law changes nothing in the machine");
        law.reset();
        assert!(law.lacks_of(Leg::Outer).abs() < f64::EPSILON, "armed anew, it knows nothing");
    }
}
