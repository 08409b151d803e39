//! Hand-made walking: the next foothold makes the stance leg pass the vertical at the rate that is wanted. RT: yes.
//!
//! The baseline of every table: no plan, no optimiser. Between steps the robot falls about its foot as an inverted
//! pendulum, so `ξ² = θ̇s² - κ² θs²` is kept: ξ is the rate at which the leg passes the vertical (orbital energy: Kajita
//! 1991; capture point: Pratt 2006). Each tick:
//! 1. time and rate of the touchdown follow from ξ and the swing angle φ that is aimed at,
//! 2. the impact map (4.11) gives the rates after it, hence the next ξ; a longer step loses more,
//! 3. φ is solved for the ξ that is wanted, bounded, and frozen shortly before the touchdown.
//!
//! What the map leaves out (push-off, toes, slope, a wrong model) is learnt per leg as a gain of ξ² in a step.
//! The toes absorb the floor's height: the swing toe is in, then goes out until it meets the ground; the stance toe goes
//! back so that the hip keeps its height over the mean floor, and pushes off at the end. The push makes up for the losses
//! of a step of the length that is wanted.

use super::landing::{Landing, SHORTEST_S};
use super::motor_sign;
use super::pendulum::{LONGEST_S, energy, time_to};
use super::stance_toe::{StanceToe, by_stance, in_order};
use super::swing::{Point, quintic, torque};
use crate::base::time::Stamp;
use crate::config::checked::{Config, FootPlacement as Numbers};
use crate::msg::{Estimate, Leg, Snapshot, TOES};

/// The law, where it is in its step, and what it has learnt.
#[derive(Clone, Debug)]
pub(super) struct FootPlacement {
    pub(super) landing: Landing,
    torque_unit_nm: f64,
    toe_rate_m_s: f64,
    numbers: Numbers,
    compensation: f64,
    step: Option<Step>,
}

/// A step: since when, from where, and how it shall end.
#[derive(Clone, Copy, Debug)]
struct Step {
    stance: Leg,
    since: Stamp,
    from: [f64; 2],
    stance_toe: StanceToe,
    goal_rad: f64,
    duration_s: f64,
    /// Time from its beginning to its touchdown as now expected, s.
    lands_s: f64,
    /// ξ² that the next step is expected to begin with, without what is learnt.
    next: f64,
    /// The same for this step, as the one before expected it, until the leg has shown what came.
    expected: Option<f64>,
    push_m: f64,
    /// The swing leg reaches beyond the foothold by so much while the robot is too slow to pass the vertical, rad.
    reach_rad: f64,
    swing_toe_out: bool,
    is_first: bool,
    /// It catches a robot that falls back.
    is_back: bool,
}

/// What the law wants in a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Wish {
    pub(super) hip_torque_nm: f64,
    pub(super) toe_position_m: [f64; TOES],
    pub(super) phase: f64,
    pub(super) swing_goal_rad: f64,
}

impl FootPlacement {
    /// Models and numbers. Before arming only.
    pub(super) fn new(config: &Config) -> Self {
        Self {
            landing: Landing::new(config),
            torque_unit_nm: config.robot.model.params().inertia_kg_m2(),
            toe_rate_m_s: config.robot.toe.rate_limit_m_s,
            numbers: config.control.foot_placement,
            compensation: config.control.friction_compensation,
            step: None,
        }
    }

    /// The next tick begins a first step, out of balance.
    pub(super) fn reset(&mut self) {
        self.step = None;
        self.landing.reset();
    }

    /// The next tick begins a step in the middle of a walk, at a touchdown: another law has walked before.
    pub(super) fn join(&mut self, now: Stamp, e: &Estimate, seen: &Snapshot) {
        let (stance_m, swing_m) = by_stance(&seen.toe_position_m, e.stance);
        self.landing.learn_floor(e, stance_m - swing_m);
        self.step = Some(self.new_step(now, e, stance_m, false));
    }

    /// The next tick goes on with another law's step: one foot is in the air and says nothing of the floor.
    pub(super) fn take_over(&mut self, now: Stamp, e: &Estimate, seen: &Snapshot) {
        let (stance_m, _) = by_stance(&seen.toe_position_m, e.stance);
        let stance_toe = StanceToe::new(now, stance_m, 0.0);
        self.step = Some(Step { stance_toe, ..self.new_step(now, e, stance_m, false) });
    }

    /// The next tick goes on with a step that begins now, from wherever the legs are: the robot falls.
    pub(super) fn catch(&mut self, now: Stamp, e: &Estimate, seen: &Snapshot) {
        self.landing.begin_to_catch();
        self.take_over(now, e, seen);
    }

    /// Torque and toes for this state.
    /// A speed of zero asks for a foothold that the robot does not pass.
    pub(super) fn step(&mut self, now: Stamp, e: &Estimate, seen: &Snapshot, speed_m_s: f64) -> Wish {
        let mut step = match self.step {
            Some(step) if step.stance == e.stance => step,
            before => self.begin(now, e, seen, before.as_ref(), speed_m_s),
        };
        let since_s = now.since(step.since).as_s();
        self.learn(&mut step, e);
        self.fall_back(&mut step, now, e);
        let since_s = if step.is_back { now.since(step.since).as_s() } else { since_s };
        if !step.is_back {
            self.aim(&mut step, e, since_s, speed_m_s);
            self.reach(&mut step, e, speed_m_s);
        }
        let back = if step.is_back { -1.0 } else { 1.0 };
        let end = [step.goal_rad + step.reach_rad, -back * self.numbers.retraction_rad_s];
        let path = quintic(step.from, end, step.duration_s, since_s.min(step.duration_s + LONGEST_DRIFT_S));
        let hip_torque_nm = self.track(e, &path, seen.late);
        let toe_position_m = self.toes(&mut step, e, now, since_s);
        self.step = Some(step);
        let phase = (since_s / step.lands_s.max(SHORTEST_S)).clamp(0.0, 1.0);
        Wish { hip_torque_nm, toe_position_m, phase, swing_goal_rad: step.goal_rad }
    }

    /// A new step; what the last one promised is to be compared with what comes.
    fn begin(&mut self, now: Stamp, e: &Estimate, seen: &Snapshot, before: Option<&Step>, speed_m_s: f64) -> Step {
        let (stance_m, swing_m) = by_stance(&seen.toe_position_m, e.stance);
        let mut expected = None;
        if let Some(last) = before {
            self.landing.learn_floor(e, stance_m - swing_m);
            if !last.is_first && !last.is_back {
                expected = Some(last.next);
                if speed_m_s > 0.0 {
                    self.landing.learn_speed(e, now.since(last.since).as_s(), speed_m_s);
                }
            }
        }
        Step { expected, ..self.new_step(now, e, stance_m, before.is_none()) }
    }

    /// What the step gained shows when its leg passes the vertical, or turns back: the angle counts for nothing then, and the
    /// rate has settled. At the touchdown itself ξ² is wrong by up to .06 rad²/s², on one leg only.
    fn learn(&mut self, step: &mut Step, e: &Estimate) {
        if (e.theta_stance_rad <= 0.0 || falls_back(e))
            && let Some(expected) = step.expected.take()
        {
            self.landing.learn_gain(e, expected);
        }
    }

    fn new_step(&self, now: Stamp, e: &Estimate, stance_m: f64, is_first: bool) -> Step {
        Step {
            stance: e.stance,
            since: now,
            from: [e.theta_swing_rad, e.theta_swing_rad_s],
            stance_toe: StanceToe::new(now, stance_m, if is_first { 0.0 } else { self.toe_rate_m_s }),
            goal_rad: self.numbers.first_angle_rad,
            duration_s: LONGEST_S,
            lands_s: LONGEST_S,
            next: 0.0,
            expected: None,
            push_m: 0.0,
            reach_rad: 0.0,
            swing_toe_out: false,
            is_first,
            is_back: false,
        }
    }

    /// A robot that does not pass the vertical is caught by a step backwards, and goes on from there.
    fn fall_back(&self, step: &mut Step, now: Stamp, e: &Estimate) {
        let n = &self.numbers;
        if step.is_back || step.is_first || n.back_rad <= 0.0 || !falls_back(e) {
            return;
        }
        let mirrored =
            Estimate { theta_stance_rad: -e.theta_stance_rad, theta_stance_rad_s: -e.theta_stance_rad_s, ..*e };
        let angle_rad = n.back_rad.max(e.theta_stance_rad);
        let lands_s = time_to(&mirrored, -angle_rad);
        *step = Step {
            since: now,
            from: [e.theta_swing_rad, e.theta_swing_rad_s],
            goal_rad: -angle_rad,
            duration_s: (lands_s - n.lead_s).clamp(n.shortest_swing_s, n.longest_swing_s.max(n.shortest_swing_s)),
            lands_s,
            push_m: 0.0,
            reach_rad: 0.0,
            swing_toe_out: false,
            is_back: true,
            ..*step
        };
    }

    /// Foothold, time of touchdown and push-off, decided anew until shortly before the touchdown.
    fn aim(&self, step: &mut Step, e: &Estimate, since_s: f64, speed_m_s: f64) {
        let n = &self.numbers;
        if since_s > step.lands_s - n.frozen_s && since_s > n.frozen_s {
            return;
        }
        let foothold =
            if step.is_first { self.landing.aim_first(e, speed_m_s) } else { self.landing.aim(e, speed_m_s) };
        (step.goal_rad, step.push_m) = (foothold.angle_rad, foothold.push_m);
        step.next = self.landing.next_energy(e, step.goal_rad) + foothold.gain;
        step.lands_s = (since_s + time_to(e, -step.goal_rad)).min(LONGEST_S);
        let duration_s = if step.is_first { n.first_swing_s } else { step.lands_s - n.lead_s };
        step.duration_s = duration_s.clamp(n.shortest_swing_s, n.longest_swing_s.max(n.shortest_swing_s));
    }

    /// The weight of a leg far ahead helps a slow robot over the vertical.
    fn reach(&self, step: &mut Step, e: &Estimate, speed_m_s: f64) {
        let n = &self.numbers;
        let lacks = (self.landing.slow_energy(speed_m_s) - energy(e)).max(0.0);
        let is_behind = !step.is_first && e.theta_stance_rad > 0.0 && speed_m_s > 0.0;
        let wanted_rad = if is_behind { (n.reach_per_energy * lacks).min(n.reach_most_rad) } else { 0.0 };
        step.reach_rad += REACH_SHARE * (wanted_rad - step.reach_rad);
    }

    /// Computed torque along the path, + on inner.
    fn track(&self, e: &Estimate, path: &Point, late: bool) -> f64 {
        let n = &self.numbers;
        let (w, z) = (n.bandwidth_rad_s, n.damping_ratio);
        let acceleration = path.acceleration_rad_s2
            + 2.0 * z * w * (path.rate_rad_s - e.theta_swing_rad_s)
            + w * w * (path.angle_rad - e.theta_swing_rad);
        let share = if late { 0.0 } else { self.compensation };
        let (q, v) = ([e.theta_stance_rad, e.theta_swing_rad], [e.theta_stance_rad_s, e.theta_swing_rad_s]);
        motor_sign(e.stance) * self.torque_unit_nm * torque(self.landing.model(e.stance), q, v, acceleration, share)
    }

    fn toes(&self, step: &mut Step, e: &Estimate, now: Stamp, since_s: f64) -> [f64; TOES] {
        let n = &self.numbers;
        let passed_rad = -e.theta_stance_rad;
        step.swing_toe_out |= since_s > step.lands_s - n.toe_out_s
            && if step.is_back {
                e.theta_swing_rad < 0.0
            } else {
                passed_rad > n.toe_out_rad && e.theta_swing_rad > n.toe_out_share * step.goal_rad
            };
        let swing_m = if step.swing_toe_out { n.toe_reach_m } else { 0.0 };
        let level_m = n.toe_nominal_m - n.floor_share * self.landing.height_m();
        let pushes = passed_rad > if step.is_first { FIRST_PUSH_RAD } else { n.push_rad };
        // A toe that goes in brakes, and takes clearance from the swing leg until that has passed.
        let push_m = if pushes && (step.push_m > 0.0 || step.swing_toe_out) { step.push_m } else { 0.0 };
        let kept_m = n.toe_kept * (step.stance_toe.landed_m - level_m);
        let target_m = (level_m + kept_m + push_m).clamp(n.toe_least_m, n.toe_reach_m);
        let stance_m = step.stance_toe.toward(now, target_m, n.toe_bandwidth_rad_s);
        in_order(e.stance, stance_m, swing_m)
    }
}

/// The robot turns back before the vertical, for lack of energy.
pub(super) fn falls_back(e: &Estimate) -> bool {
    e.theta_stance_rad > BACK_FROM_RAD && e.theta_stance_rad_s > BACK_FROM_RAD_S && energy(e) < 0.0
}

/// Share of the way by which the reach follows in a tick of 1 ms: 20 ms.
const REACH_SHARE: f64 = 0.05;
/// Beyond this lean, rad, and rate, rad/s, a robot without the energy to pass the vertical falls back.
const BACK_FROM_RAD: f64 = 0.02;
const BACK_FROM_RAD_S: f64 = 0.05;
/// So long after its planned end the swing leg goes on backwards, s.
const LONGEST_DRIFT_S: f64 = 0.4;
/// The first push waits until the robot leans so far forward, rad.
const FIRST_PUSH_RAD: f64 = 0.02;

#[cfg(test)]
mod tests {
    use super::super::pendulum::KAPPA2;
    use super::*;
    use crate::config::load;

    /// A robot that will pass, or has passed, the vertical with this ξ².
    fn passing(stance: Leg, angle_rad: f64, energy: f64) -> Estimate {
        let rate = -libm::sqrt(energy + KAPPA2 * angle_rad * angle_rad);
        Estimate {
            stance,
            theta_stance_rad: angle_rad,
            theta_swing_rad: -angle_rad,
            theta_stance_rad_s: rate,
            ..Estimate::default()
        }
    }

    #[test]
    fn what_a_step_gained_is_learnt_at_the_vertical_and_not_at_the_touchdown() {
        let mut law = FootPlacement::new(&load(None, &[]).unwrap().config);
        law.reset();
        let seen = Snapshot { toe_position_m: [0.025; TOES], ..Snapshot::default() };
        let mut now = Stamp(0);
        let mut tick = |law: &mut FootPlacement, e: &Estimate| {
            law.step(now, e, &seen, 0.4);
            now = Stamp(now.0 + 1_000_000);
        };
        // The first two steps: nothing was expected of them.
        tick(&mut law, &passing(Leg::Inner, -0.05, 0.15));
        tick(&mut law, &passing(Leg::Outer, 0.15, 0.15));
        tick(&mut law, &passing(Leg::Outer, 0.0, 0.15));
        let gains = |law: &FootPlacement| [Leg::Inner, Leg::Outer].map(|leg| law.landing.gain_of(leg));
        let before = gains(&law);
        // At its touchdown the third seems to have much more energy than it shows to have.
        for angle_rad in [0.15, 0.1, 0.05] {
            tick(&mut law, &passing(Leg::Inner, angle_rad, 0.45));
        }
        assert_eq!(gains(&law).map(f64::to_bits), before.map(f64::to_bits));
        let expected = law.step.and_then(|step| step.expected).unwrap();
        tick(&mut law, &passing(Leg::Inner, 0.0, 0.1));
        let [inner, outer] = gains(&law);
        let share = law.numbers.learning;
        assert!((inner - before[0] - share * (0.1 - expected - before[0])).abs() < 1e-12, "{inner} {expected}");
        assert!((outer - before[1]).abs() < 1e-12);
        // Once a step.
        tick(&mut law, &passing(Leg::Inner, -0.01, 0.3));
        assert!((law.landing.gain_of(Leg::Inner) - inner).abs() < 1e-12);
    }
}
