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

use super::motor_sign;
use super::swing::{Point, quintic, torque};
use crate::base::time::Stamp;
use crate::config::checked::{Config, FootPlacement as Numbers};
use crate::model::compass_gait::impact;
use crate::model::compass_gait::params::Normalised;
use crate::msg::{Estimate, Leg, Snapshot, TOES};

/// The law, where it is in its step, and what it has learnt.
#[derive(Clone, Debug)]
pub(super) struct FootPlacement {
    models: [Normalised<f64>; 2],
    torque_unit_nm: f64,
    leg_m: f64,
    toe_rate_m_s: f64,
    numbers: Numbers,
    compensation: f64,
    step: Option<Step>,
    /// Gain of ξ² in a step that ends on each leg beyond the impact map's, rad²/s².
    gain: [f64; 2],
    floor: Floor,
}

/// Height of the foothold over the mean floor, from step to step.
#[derive(Clone, Copy, Debug, Default)]
struct Floor {
    height_m: f64,
    /// Mean rise of a step, m: the floor's slope or the attitude's error.
    rise_m: f64,
}

/// A step: since when, from where, and how it shall end.
#[derive(Clone, Copy, Debug)]
struct Step {
    stance: Leg,
    since: Stamp,
    from: [f64; 2],
    /// Length of the stance toe at its touchdown, m.
    landed_m: f64,
    /// Length and rate that are asked of the stance toe, m and m/s.
    stance_toe: [f64; 2],
    last: Stamp,
    goal_rad: f64,
    duration_s: f64,
    /// Time from its beginning to its touchdown as now expected, s.
    lands_s: f64,
    /// ξ² that the next step is expected to begin with, without what is learnt.
    next: f64,
    push_m: f64,
    swing_toe_out: bool,
    is_first: bool,
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
        let params = config.robot.model.params();
        Self {
            models: [params.normalised(), params.swapped().normalised()],
            torque_unit_nm: params.inertia_kg_m2(),
            leg_m: params.leg_length_m,
            toe_rate_m_s: config.robot.toe.rate_limit_m_s,
            numbers: config.control.foot_placement,
            compensation: config.control.friction_compensation,
            step: None,
            gain: [0.0; 2],
            floor: Floor::default(),
        }
    }

    /// The next tick begins a first step, out of balance.
    pub(super) fn reset(&mut self) {
        self.step = None;
        self.gain = [self.numbers.first_gain; 2];
        self.floor = Floor::default();
    }

    /// Torque and toes for this state.
    /// A speed of zero asks for a foothold that the robot does not pass.
    pub(super) fn step(&mut self, now: Stamp, e: &Estimate, seen: &Snapshot, speed_m_s: f64) -> Wish {
        let mut step = match self.step {
            Some(step) if step.stance == e.stance => step,
            before => self.begin(now, e, seen, before.as_ref()),
        };
        let since_s = now.since(step.since).as_s();
        self.aim(&mut step, e, since_s, speed_m_s);
        let end = [step.goal_rad, -self.numbers.retraction_rad_s];
        let path = quintic(step.from, end, step.duration_s, since_s.min(step.duration_s + LONGEST_DRIFT_S));
        let hip_torque_nm = self.track(e, &path, seen.late);
        let toe_position_m = self.toes(&mut step, e, now, since_s);
        self.step = Some(step);
        let phase = (since_s / step.lands_s.max(SHORTEST_S)).clamp(0.0, 1.0);
        Wish { hip_torque_nm, toe_position_m, phase, swing_goal_rad: step.goal_rad }
    }

    /// A new step; what the last one promised is compared with what came.
    fn begin(&mut self, now: Stamp, e: &Estimate, seen: &Snapshot, before: Option<&Step>) -> Step {
        let (stance_m, swing_m) = by_stance(&seen.toe_position_m, e.stance);
        if let Some(last) = before {
            let rise_m = self.rise_m(e, stance_m - swing_m);
            let n = &self.numbers;
            let over = rise_m - self.floor.rise_m;
            self.floor.rise_m += n.slope_share * over;
            self.floor.height_m = n.floor_memory * (self.floor.height_m + over);
            if !last.is_first {
                let gained = (energy(e) - last.next).clamp(-MOST_GAIN, MOST_GAIN);
                let learnt = self.gain_of(e.stance);
                self.set_gain(e.stance, learnt + n.learning * (gained - learnt));
            }
        }
        Step {
            stance: e.stance,
            since: now,
            from: [e.theta_swing_rad, e.theta_swing_rad_s],
            landed_m: stance_m,
            stance_toe: [stance_m, if before.is_some() { self.toe_rate_m_s } else { 0.0 }],
            last: now,
            goal_rad: self.numbers.first_angle_rad,
            duration_s: LONGEST_S,
            lands_s: LONGEST_S,
            next: 0.0,
            push_m: 0.0,
            swing_toe_out: false,
            is_first: before.is_none(),
        }
    }

    /// How much higher the new foothold is than the last one, m: both feet are on the ground.
    fn rise_m(&self, e: &Estimate, toe_m: f64) -> f64 {
        self.leg_m * (libm::cos(e.theta_swing_rad) - libm::cos(e.theta_stance_rad)) - toe_m
    }

    const fn gain_of(&self, stance: Leg) -> f64 {
        let [inner, outer] = self.gain;
        match stance {
            Leg::Inner => inner,
            Leg::Outer => outer,
        }
    }

    const fn set_gain(&mut self, stance: Leg, gain: f64) {
        let [inner, outer] = &mut self.gain;
        match stance {
            Leg::Inner => *inner = gain,
            Leg::Outer => *outer = gain,
        }
    }

    const fn model(&self, stance: Leg) -> &Normalised<f64> {
        let [inner, outer] = &self.models;
        match stance {
            Leg::Inner => inner,
            Leg::Outer => outer,
        }
    }

    /// Foothold, time of touchdown and push-off, decided anew until shortly before the touchdown.
    fn aim(&self, step: &mut Step, e: &Estimate, since_s: f64, speed_m_s: f64) {
        let n = &self.numbers;
        if since_s > step.lands_s - n.frozen_s && since_s > n.frozen_s {
            return;
        }
        let wanted_rad = (n.angle_rad + n.angle_per_speed_s_m * (speed_m_s - n.speed_m_s)).clamp(LEAST_RAD, MOST_RAD);
        if step.is_first {
            step.goal_rad = n.first_angle_rad;
            step.push_m = n.first_push_m;
        } else {
            let stops = speed_m_s <= 0.0;
            let passing = passing_rad_s(wanted_rad, speed_m_s / self.leg_m);
            let wanted = if stops { STOPPING } else { passing * passing };
            step.goal_rad = self.foothold(e, wanted, wanted_rad);
            // A foothold shorter than wanted lacks energy: push more.
            let push_m = n.push_m + n.push_per_angle_m_rad * (wanted_rad - step.goal_rad);
            step.push_m = if stops { 0.0 } else { push_m.clamp(0.0, n.push_most_m) };
        }
        step.next = self.next_energy(e, step.goal_rad);
        step.lands_s = (since_s + time_to(e, -step.goal_rad)).min(LONGEST_S);
        step.duration_s = (step.lands_s - n.lead_s).clamp(n.shortest_swing_s, LONGEST_S);
    }

    /// Swing angle after which the next step begins with ξ² `wanted`; a share of the way from the steady one.
    fn foothold(&self, e: &Estimate, wanted: f64, steady_rad: f64) -> f64 {
        let n = &self.numbers;
        let learnt = self.gain_of(e.stance.other());
        let (mut low, mut high) = (n.least_angle_rad, n.most_angle_rad);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if self.next_energy(e, middle) + learnt > wanted { low = middle } else { high = middle }
        }
        steady_rad + n.placement_share * (0.5 * (low + high) - steady_rad)
    }

    /// ξ² after a touchdown at swing angle `angle_rad` on level ground.
    fn next_energy(&self, e: &Estimate, angle_rad: f64) -> f64 {
        let rate = -libm::sqrt((energy(e) + KAPPA2 * angle_rad * angle_rad).max(LEAST_RATE * LEAST_RATE));
        let before = [-angle_rad, angle_rad, rate, -self.numbers.retraction_rad_s];
        let after = impact::step(self.model(e.stance), &before);
        after.map_or(0.0, |[angle, _, rate, _]| rate * rate - KAPPA2 * angle * angle)
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
        motor_sign(e.stance) * self.torque_unit_nm * torque(self.model(e.stance), q, v, acceleration, share)
    }

    fn toes(&self, step: &mut Step, e: &Estimate, now: Stamp, since_s: f64) -> [f64; TOES] {
        let n = &self.numbers;
        let passed_rad = -e.theta_stance_rad;
        step.swing_toe_out |= since_s > step.lands_s - n.toe_out_s && passed_rad > n.toe_out_rad;
        let swing_m = if step.swing_toe_out { n.toe_reach_m } else { 0.0 };
        let level_m = n.toe_nominal_m - n.floor_share * self.floor.height_m;
        let pushes = passed_rad > if step.is_first { FIRST_PUSH_RAD } else { n.push_rad };
        let push_m = if pushes { step.push_m } else { 0.0 };
        let kept_m = n.toe_kept * (step.landed_m - level_m);
        let target_m = (level_m + kept_m + push_m).clamp(n.toe_least_m, n.toe_reach_m);
        // A toe under load moves gently: what it accelerates is the robot, and friction holds by what is left of the weight.
        let [at_m, rate_m_s] = step.stance_toe;
        let (w, dt_s) = (n.toe_bandwidth_rad_s, now.since(step.last).as_s());
        let rate_m_s = rate_m_s + dt_s * (w * w * (target_m - at_m) - 2.0 * w * rate_m_s);
        let stance_m = at_m + dt_s * rate_m_s;
        step.stance_toe = [stance_m, rate_m_s];
        step.last = now;
        match e.stance {
            Leg::Inner => [stance_m, stance_m, swing_m, swing_m],
            Leg::Outer => [swing_m, swing_m, stance_m, stance_m],
        }
    }
}

/// ξ²: above zero the stance leg passes (or has passed) the vertical, rad²/s².
pub(super) fn energy(e: &Estimate) -> f64 {
    e.theta_stance_rad_s * e.theta_stance_rad_s - KAPPA2 * e.theta_stance_rad * e.theta_stance_rad
}

/// Time until the stance leg comes to `angle_rad` (below zero) as an inverted pendulum, s.
fn time_to(e: &Estimate, angle_rad: f64) -> f64 {
    let kappa = libm::sqrt(KAPPA2);
    let (grows, decays) = (
        0.5 * (e.theta_stance_rad + e.theta_stance_rad_s / kappa),
        0.5 * (e.theta_stance_rad - e.theta_stance_rad_s / kappa),
    );
    // grows u + decays / u = angle, u = exp(κ t) >= 1.
    let root = angle_rad * angle_rad - 4.0 * grows * decays;
    if grows >= -LEAST_GROWTH || root < 0.0 {
        return LONGEST_S;
    }
    let u = (angle_rad - libm::sqrt(root)) / (2.0 * grows);
    (libm::log(u.max(1.0)) / kappa).min(LONGEST_S)
}

/// Passing rate ξ of steady walking with steps of swing angle `angle_rad` at `speed_1_s` leg lengths a second.
fn passing_rad_s(angle_rad: f64, speed_1_s: f64) -> f64 {
    let kappa = libm::sqrt(KAPPA2);
    let half_s = libm::sin(angle_rad) / speed_1_s.max(SLOWEST_1_S);
    kappa * angle_rad / libm::sinh((kappa * half_s).min(LONGEST_HALF))
}

/// Toe length of the leg that stands and of the other, m.
const fn by_stance(toes_m: &[f64; TOES], stance: Leg) -> (f64, f64) {
    let [inner_a, inner_b, outer_a, outer_b] = *toes_m;
    let (inner, outer) = (inner_a.max(inner_b), outer_a.max(outer_b));
    match stance {
        Leg::Inner => (inner, outer),
        Leg::Outer => (outer, inner),
    }
}

/// Square of the rate with which the robot falls about a foot, 1/s² (section 8 of our notes: 3.18² and 3.13²).
const KAPPA2: f64 = 10.0;
/// Bounds of a swing's time, s, and of its end, rad.
const SHORTEST_S: f64 = 0.2;
const LONGEST_S: f64 = 1.5;
const LEAST_RAD: f64 = 0.03;
const MOST_RAD: f64 = 0.4;
/// So long after its planned end the swing leg goes on backwards, s.
const LONGEST_DRIFT_S: f64 = 0.4;
/// The first push waits until the robot leans so far forward, rad.
const FIRST_PUSH_RAD: f64 = 0.02;
/// Halvings of the foothold's range: .4 rad to .1 mrad.
const HALVINGS: usize = 12;
/// Slowest touchdown that is reckoned with, rad/s; slowest growth of a fall, rad; slowest walk, 1/s; κ times the longest half step.
const LEAST_RATE: f64 = 0.05;
const LEAST_GROWTH: f64 = 1e-4;
const SLOWEST_1_S: f64 = 0.05;
const LONGEST_HALF: f64 = 4.0;
/// ξ² that a step to stop with shall begin with, rad²/s²: short of passing by .07 rad.
const STOPPING: f64 = -0.05;
/// Largest gain of ξ² in a step that is believed, rad²/s².
const MOST_GAIN: f64 = 0.3;

#[cfg(test)]
mod tests {
    use super::*;

    fn state(angle: f64, rate: f64) -> Estimate {
        Estimate { theta_stance_rad: angle, theta_stance_rad_s: rate, ..Estimate::default() }
    }

    #[test]
    fn time_to_an_angle_is_that_of_the_inverted_pendulum() {
        let (kappa, e) = (KAPPA2.sqrt(), state(0.16, -0.65));
        let t = time_to(&e, -0.16);
        let angle = 0.16 * (kappa * t).cosh() - 0.65 / kappa * (kappa * t).sinh();
        assert!((angle + 0.16).abs() < 1e-12 && t > 0.3, "{t} {angle}");
        assert!((time_to(&state(0.16, -0.2), -0.16) - LONGEST_S).abs() < 1e-12, "falls back");
    }

    #[test]
    fn a_steady_walk_has_the_speed_that_its_passing_rate_was_chosen_for() {
        for (angle, speed) in [(0.16, 0.5), (0.1, 0.3)] {
            let passing = passing_rad_s(angle, speed);
            let rate = -(passing * passing + KAPPA2 * angle * angle).sqrt();
            let t = time_to(&state(angle, rate), -angle);
            assert!((2.0 * angle.sin() / t - speed).abs() < 1e-9);
        }
    }
}
