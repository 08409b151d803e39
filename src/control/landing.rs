//! From touchdown to touchdown: the foothold for the next step, and what is learnt of floor and losses. RT: yes.
//!
//! The impact map (4.11) gives the rates after a touchdown, hence the next ξ; a longer step loses more. The swing angle is
//! solved for the ξ that is wanted. What the map leaves out (push-off, toes, slope, a wrong model) is learnt per leg as a
//! gain of ξ² in a step; the heights of footholds are learnt from the geometry while both feet are on the ground.

use super::floor::Floor;
use super::pendulum::{KAPPA2, energy, passing_rad_s};
use super::stance_toe::toward_share;
use crate::config::checked::{Config, FootPlacement as Numbers, VirtualConstraint};
use crate::model::compass_gait::impact;
use crate::model::compass_gait::params::Normalised;
use crate::msg::{Estimate, Leg};

/// Models of both stances, numbers, and what has been learnt.
#[derive(Clone, Debug)]
pub(super) struct Landing {
    models: [Normalised<f64>; 2],
    leg_m: f64,
    numbers: Numbers,
    steady: Steady,
    /// What the stance toe has made of a braking when the swing foot lands.
    braked_share: f64,
    /// Gain of ξ² in a step that ends on each leg beyond the impact map's, rad²/s².
    gain: [f64; 2],
    /// What is aimed at beyond what the steady walk's numbers say, m/s.
    faster_m_s: f64,
    floor: Floor,
    /// It catches a robot that falls: its toes do not brake.
    catches: bool,
}

/// Steady walking: which speed is aimed at for one that is asked for, and its swing angle at touchdown.
#[derive(Clone, Copy, Debug)]
pub(super) struct Steady {
    speed_m_s: f64,
    aimed_m_s: f64,
    aimed_per_speed: f64,
    angle_rad: f64,
    angle_per_speed_s_m: f64,
}

impl Steady {
    const fn of_placement(n: &Numbers) -> Self {
        Self {
            speed_m_s: n.speed_m_s,
            aimed_m_s: n.aimed_m_s,
            aimed_per_speed: n.aimed_per_speed,
            angle_rad: n.angle_rad,
            angle_per_speed_s_m: n.angle_per_speed_s_m,
        }
    }

    /// Of a law that walks at the speed that is aimed at.
    pub(super) const fn of_virtual_constraint(n: &VirtualConstraint) -> Self {
        Self {
            speed_m_s: n.speed_m_s,
            aimed_m_s: n.speed_m_s,
            aimed_per_speed: 1.0,
            angle_rad: n.angle_rad,
            angle_per_speed_s_m: n.angle_per_speed_s_m,
        }
    }

    /// Speed to aim at for one that is asked for, before anything is learnt, m/s: a foothold makes up for a share of an error
    /// only, so the robot walks slower than aimed at.
    fn aimed_for(&self, asked_m_s: f64) -> f64 {
        self.aimed_m_s + self.aimed_per_speed * (asked_m_s - self.speed_m_s)
    }

    /// Swing angle at touchdown on level floor for a speed that is asked for, rad.
    fn angle_for(&self, asked_m_s: f64) -> f64 {
        self.angle_rad + self.angle_per_speed_s_m * (self.aimed_for(asked_m_s) - self.aimed_m_s)
    }

    /// Of a planned orbit: at its speed its swing angle; a change of speed is left to the steps' number.
    pub(super) const fn of_orbit(speed_m_s: f64, angle_rad: f64) -> Self {
        Self { speed_m_s, aimed_m_s: speed_m_s, aimed_per_speed: 1.0, angle_rad, angle_per_speed_s_m: 0.0 }
    }
}

/// Where to step, and how far to push the stance toe.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Foothold {
    pub(super) angle_rad: f64,
    pub(super) push_m: f64,
    /// ξ² that the push-off is expected to give beyond that of a steady one, rad²/s².
    pub(super) gain: f64,
}

impl Landing {
    /// Before arming only.
    pub(super) fn new(config: &Config) -> Self {
        let params = config.robot.model.params();
        Self {
            models: [params.normalised(), params.swapped().normalised()],
            leg_m: params.leg_length_m,
            numbers: config.control.foot_placement,
            steady: Steady::of_placement(&config.control.foot_placement),
            braked_share: braked_share(&config.control.foot_placement),
            gain: [0.0; 2],
            faster_m_s: 0.0,
            floor: Floor::new(),
            catches: false,
        }
    }

    /// Forgets.
    pub(super) const fn reset(&mut self) {
        self.gain = [self.numbers.first_gain; 2];
        self.faster_m_s = 0.0;
        self.floor = Floor::new();
        self.catches = false;
    }

    /// Forgets, the push-off too: a step that catches has none.
    pub(super) const fn begin_to_catch(&mut self) {
        self.reset();
        self.gain = [0.0; 2];
        self.catches = true;
    }

    /// Height of the present foothold over the mean floor, m.
    pub(super) fn height_m(&self) -> f64 {
        self.floor.over_m()
    }

    /// At a touchdown, the new stance toe being so much longer than the other.
    pub(super) fn learn_floor(&mut self, e: &Estimate, longer_m: f64) {
        self.floor.step(self.stride_m(e), self.rise_m(e, longer_m), self.numbers.floor_memory);
    }

    /// ξ² that was expected of this step without what is learnt, and its estimate.
    pub(super) fn learn_gain(&mut self, e: &Estimate, expected: f64) {
        let gained = (energy(e) - expected).clamp(-MOST_GAIN, MOST_GAIN);
        let learnt = self.gain_of(e.stance);
        self.set_gain(e.stance, learnt + self.numbers.learning * (gained - learnt));
    }

    /// At a touchdown after a step that took `took_s`: what is aimed at beyond grows with the way that it lacked.
    ///
    /// The way, not the speed: of two steps of different times the mean of the speeds is more than the speed of both.
    pub(super) fn learn_speed(&mut self, e: &Estimate, took_s: f64, asked_m_s: f64) {
        let lacks_m = (asked_m_s * took_s - self.stride_m(e)).clamp(-MOST_LACKING_M, MOST_LACKING_M);
        // A robot that is too fast although the slowest passing is aimed at would only be told so for ever.
        if lacks_m < 0.0 && self.aimed_energy(asked_m_s) <= self.slow_energy(asked_m_s) {
            return;
        }
        let faster_m_s = self.faster_m_s + self.numbers.faster_per_way_1_s * lacks_m;
        self.faster_m_s = faster_m_s.clamp(-MOST_FASTER_M_S, MOST_FASTER_M_S);
    }

    /// Swing angle at touchdown in steady walking at a speed that is asked for, rad.
    ///
    /// What is learnt of the speed changes the passing rate, not this: shorter steps of a robot that is too fast would lose less,
    /// and it would be faster still, until its swing leg comes too late.
    pub(super) fn steady_rad(&self, asked_m_s: f64) -> f64 {
        let level_rad = self.steady.angle_for(asked_m_s);
        (level_rad + self.numbers.angle_per_slope * self.downhill_rad()).clamp(LEAST_RAD, MOST_RAD)
    }

    /// How steeply the floor goes down, as learnt, rad.
    fn downhill_rad(&self) -> f64 {
        (-self.floor.slope_rad()).clamp(-MOST_SLOPE_RAD, MOST_SLOPE_RAD)
    }

    /// Speed to aim at for one that is asked for, m/s.
    fn aimed_m_s(&self, speed_m_s: f64) -> f64 {
        (self.steady.aimed_for(speed_m_s) + self.faster_m_s).max(SLOWEST_M_S)
    }

    /// ξ² of steady walking at the speed that is aimed at, rad²/s².
    fn aimed_energy(&self, asked_m_s: f64) -> f64 {
        let passing = passing_rad_s(self.steady_rad(asked_m_s), self.aimed_m_s(asked_m_s) / self.leg_m);
        passing * passing
    }

    /// ξ² below which a step is too slow, rad²/s²: a share of what level walking at exactly the speed that is asked for has. A
    /// slow walk passes the vertical slowly by itself.
    pub(super) fn slow_energy(&self, asked_m_s: f64) -> f64 {
        let angle_rad = self.steady.angle_for(asked_m_s).clamp(LEAST_RAD, MOST_RAD);
        let passing = passing_rad_s(angle_rad, asked_m_s / self.leg_m);
        self.numbers.slow_share * passing * passing
    }

    /// Length of the legs, m.
    pub(super) const fn leg_m(&self) -> f64 {
        self.leg_m
    }

    /// Another law walks: its steady walking counts, in the steps of foot placement around it too.
    pub(super) const fn walk_as(&mut self, steady: Steady) {
        self.steady = steady;
    }

    /// That law brakes from the beginning of its steps on.
    pub(super) const fn brakes_at_once(&mut self) {
        self.braked_share = 1.0;
    }

    /// Foothold and push-off for a speed; a speed of zero asks for a foothold that the robot does not pass.
    pub(super) fn aim(&self, e: &Estimate, speed_m_s: f64) -> Foothold {
        let n = &self.numbers;
        let stops = speed_m_s <= 0.0;
        if stops {
            return self.aim_to_stop(e);
        }
        let (aimed_m_s, wanted_rad) = (self.aimed_m_s(speed_m_s), self.steady_rad(speed_m_s));
        // What counts as too slow is never aimed at.
        let wanted = self.aimed_energy(speed_m_s).max(self.slow_energy(speed_m_s));
        let steady_m = n.push_m + n.push_per_speed_s * (aimed_m_s - self.steady.aimed_m_s);
        let (push_m, gain) = self.push(e, wanted, wanted_rad, steady_m);
        Foothold { angle_rad: self.foothold(e, wanted, wanted_rad, gain), push_m, gain }
    }

    /// The foothold that the robot does not pass. What the longest step leaves the toe brakes: without that some robots pass again
    /// and again. It is not counted on for a shorter one, which would lose less.
    fn aim_to_stop(&self, e: &Estimate) -> Foothold {
        let angle_rad = self.passable(e, STOPPING, 0.0);
        if self.catches {
            return Foothold { angle_rad, ..Foothold::default() };
        }
        let left = self.next_energy(e, angle_rad) + self.gain_of(e.stance.other()) - STOPPING;
        let push_m = (-left / (PUSH_GAIN * self.braked_share)).clamp(self.numbers.push_least_m, 0.0);
        Foothold { angle_rad, push_m, gain: self.push_worth(push_m) }
    }

    /// The first step, out of balance: what is lacking is pushed, and the step is no longer than it can be passed.
    pub(super) fn aim_first(&self, e: &Estimate, speed_m_s: f64) -> Foothold {
        let n = &self.numbers;
        let wanted = self.slow_energy(speed_m_s);
        let (push_m, gain) = self.push(e, wanted, n.first_angle_rad, n.first_push_m);
        let angle_rad = self.passable(e, wanted, gain).clamp(n.least_angle_rad, n.first_angle_rad);
        Foothold { angle_rad, push_m, gain }
    }

    /// Push-off that makes up for all the energy that the next step would lack, and the ξ² that it is worth beyond the steady one.
    fn push(&self, e: &Estimate, wanted: f64, angle_rad: f64, steady_m: f64) -> (f64, f64) {
        let n = &self.numbers;
        let lacks = wanted - self.next_energy(e, angle_rad) - self.gain_of(e.stance.other());
        let steady = self.push_worth(steady_m);
        let wanted_m = (steady + lacks) / PUSH_GAIN;
        let wanted_m = if wanted_m < 0.0 { wanted_m / self.braked_share } else { wanted_m };
        let push_m = wanted_m.clamp(n.push_least_m, n.push_most_m);
        (push_m, self.push_worth(push_m) - steady)
    }

    /// ξ² that a push-off of so many m is worth, rad²/s². Below zero the toe brakes, and begins late: what it will not have made
    /// when the foot lands is not promised. It would be learnt as a gain of the robot, and answered by braking that comes as
    /// little.
    fn push_worth(&self, push_m: f64) -> f64 {
        PUSH_GAIN * if push_m < 0.0 { self.braked_share * push_m } else { push_m }
    }

    /// How far ahead of the last foothold the new one is, m.
    fn stride_m(&self, e: &Estimate) -> f64 {
        self.leg_m * (libm::sin(e.theta_stance_rad) - libm::sin(e.theta_swing_rad))
    }

    /// How much higher the new foothold is than the last one, m: both feet are on the ground.
    fn rise_m(&self, e: &Estimate, toe_m: f64) -> f64 {
        self.leg_m * (libm::cos(e.theta_swing_rad) - libm::cos(e.theta_stance_rad)) - toe_m
    }

    /// Gain of ξ² in a step that ends on this leg, as learnt, rad²/s².
    pub(super) const fn gain_of(&self, stance: Leg) -> f64 {
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

    /// Model with this leg standing.
    pub(super) const fn model(&self, stance: Leg) -> &Normalised<f64> {
        let [inner, outer] = &self.models;
        match stance {
            Leg::Inner => inner,
            Leg::Outer => outer,
        }
    }

    /// A share of the way from the steady swing angle to the one after which the next step begins with ξ² `wanted`.
    fn foothold(&self, e: &Estimate, wanted: f64, steady_rad: f64, pushed: f64) -> f64 {
        steady_rad + self.numbers.placement_share * (self.passable(e, wanted, pushed) - steady_rad)
    }

    /// Swing angle after which the next step begins with ξ² `wanted`, `pushed` being given by the push-off.
    fn passable(&self, e: &Estimate, wanted: f64, pushed: f64) -> f64 {
        let n = &self.numbers;
        let gained = self.gain_of(e.stance.other()) + pushed;
        let (mut low, mut high) = (n.least_angle_rad, n.most_angle_rad);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if self.next_energy(e, middle) + gained > wanted { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }

    /// ξ² after a touchdown at swing angle `angle_rad` on level ground.
    pub(super) fn next_energy(&self, e: &Estimate, angle_rad: f64) -> f64 {
        let rate = -libm::sqrt((energy(e) + KAPPA2 * angle_rad * angle_rad).max(LEAST_RATE * LEAST_RATE));
        let before = [-angle_rad, angle_rad, rate, -self.numbers.retraction_rad_s];
        let after = impact::step(self.model(e.stance), &before);
        after.map_or(0.0, |[angle, _, rate, _]| rate * rate - KAPPA2 * angle * angle)
    }
}

/// Foot placement's stance toe brakes while the swing toe goes out, not before.
fn braked_share(n: &Numbers) -> f64 {
    toward_share(n.toe_bandwidth_rad_s, n.toe_out_s)
}

/// ξ² that a m of push-off is worth, rad²/s²: the hip's fall by it from one step to the next, 2 κ² over the height of the
/// centre of mass (.79 m).
const PUSH_GAIN: f64 = 25.0;
/// Bounds of a steady swing angle, rad.
const LEAST_RAD: f64 = 0.03;
const MOST_RAD: f64 = 0.4;
/// Steepest floor that is believed, rad.
const MOST_SLOPE_RAD: f64 = 0.06;
/// Slowest touchdown that is reckoned with, rad/s.
const LEAST_RATE: f64 = 0.05;
/// Most that is aimed at beyond the steady walk's numbers, m/s: half of a slow walk.
const MOST_FASTER_M_S: f64 = 0.15;
/// Longest way that a step is said to lack, m: a whole step.
const MOST_LACKING_M: f64 = 0.3;
/// Shortest time of a step, s.
pub(super) const SHORTEST_S: f64 = 0.2;
/// Slowest speed that is aimed at, m/s.
const SLOWEST_M_S: f64 = 0.1;
/// Halvings of the foothold's range: .4 rad to .1 mrad.
const HALVINGS: usize = 12;
/// ξ² that a step to stop with shall begin with, rad²/s²: short of passing by .07 rad.
const STOPPING: f64 = -0.05;
/// Largest gain of ξ² in a step that is believed, rad²/s².
const MOST_GAIN: f64 = 0.3;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_that_lead_downhill_are_longer_and_uphill_shorter() {
        let walked = |slope_rad: f64| {
            let mut landing = landing();
            let angle = landing.steady_rad(0.4);
            // Both feet on a slope: the legs' bisector is normal to it.
            let [stance, swing] = [angle - slope_rad, -angle - slope_rad];
            let e = Estimate { theta_stance_rad: stance, theta_swing_rad: swing, ..Estimate::default() };
            (0..100).for_each(|_| landing.learn_floor(&e, 0.0));
            assert!(landing.height_m().abs() < 1e-3);
            (landing.downhill_rad(), landing.steady_rad(0.4) - angle)
        };
        let per_slope = landing().numbers.angle_per_slope;
        for slope_rad in [-0.03, 0.0, 0.03] {
            let (learnt, longer) = walked(slope_rad);
            assert!((learnt - slope_rad).abs() < 1e-3, "{slope_rad}: {learnt}");
            assert!((longer - per_slope * slope_rad).abs() < 1e-3, "{slope_rad}: {longer}");
        }
        assert!(per_slope > 0.0);
    }

    #[test]
    fn a_robot_that_nothing_slows_down_is_not_told_to_crawl() {
        let mut landing = landing();
        // Downhill, steps of twice the length that is planned, for long.
        let e = Estimate { theta_stance_rad: 0.215, theta_swing_rad: -0.285, ..Estimate::default() };
        (0..40).for_each(|_| landing.learn_floor(&e, 0.0));
        (0..200).for_each(|_| landing.learn_speed(&e, 0.9, 0.4));
        let slow = landing.slow_energy(0.4);
        assert!(landing.aimed_energy(0.4) < slow + 0.01 && landing.faster_m_s > -MOST_FASTER_M_S, "{landing:?}");
        let passing = libm::sqrt(slow);
        let e = Estimate { theta_stance_rad_s: -passing, ..Estimate::default() };
        let next = |goal: &Foothold| {
            landing.next_energy(&e, landing.steady_rad(0.4)) + landing.gain_of(e.stance.other()) + goal.gain
        };
        assert!(next(&landing.aim(&e, 0.4)) > slow - 1e-9);
        // One step that comes too late, and it is told to be faster again.
        let before_m_s = landing.faster_m_s;
        landing.learn_speed(&e, 1.5, 0.4);
        assert!(landing.faster_m_s > before_m_s);
    }

    fn landing() -> Landing {
        let mut landing = Landing::new(&crate::config::load(None, &[]).unwrap().config);
        landing.reset();
        landing
    }

    #[test]
    fn a_walk_at_the_speed_that_is_asked_for_is_never_too_slow() {
        let landing = landing();
        let share = landing.numbers.slow_share;
        let mut last = 0.0;
        for asked_m_s in [0.2, 0.3, 0.4, 0.5, 0.6] {
            let passing = passing_rad_s(landing.steady_rad(asked_m_s), asked_m_s / landing.leg_m);
            let slow = landing.slow_energy(asked_m_s);
            assert!(
                (slow - share * passing * passing).abs() < 1e-12 && slow > last && share < 1.0,
                "{asked_m_s}: {slow}"
            );
            last = slow;
        }
    }

    #[test]
    fn a_limp_that_makes_the_way_in_time_is_at_the_speed_that_is_asked_for() {
        let mut landing = landing();
        let e = Estimate { theta_stance_rad: 0.15, theta_swing_rad: -0.15, ..Estimate::default() };
        let stride_m = 2.0 * landing.leg_m * libm::sin(0.15);
        // Two equal strides, one in half of the other's time.
        let asked_m_s = 2.0 * stride_m / 1.5;
        for took_s in [0.5, 1.0].repeat(20) {
            landing.learn_speed(&e, took_s, asked_m_s);
        }
        assert!(landing.faster_m_s.abs() < 1e-12, "{}", landing.faster_m_s);
        landing.learn_speed(&e, 1.0, asked_m_s);
        let lacks_m = asked_m_s - stride_m;
        assert!((landing.faster_m_s - landing.numbers.faster_per_way_1_s * lacks_m).abs() < 1e-12 && lacks_m > 0.0);
    }

    #[test]
    fn a_robot_that_is_too_fast_aims_at_slower_steps_not_at_shorter_ones() {
        let mut landing = landing();
        let e = Estimate { theta_stance_rad: 0.15, theta_swing_rad: -0.15, ..Estimate::default() };
        let (angle_rad, aimed_m_s) = (landing.steady_rad(0.4), landing.aimed_m_s(0.4));
        (0..20).for_each(|_| landing.learn_speed(&e, 0.5, 0.4));
        assert!(landing.aimed_m_s(0.4) < aimed_m_s - 0.1);
        assert!((landing.steady_rad(0.4) - angle_rad).abs() < 1e-12);
    }

    #[test]
    fn braking_is_promised_for_what_the_toe_makes_of_it_and_the_foothold_makes_up_for_the_rest() {
        let landing = landing();
        let [steady_m, share] = [0.0, landing.braked_share];
        let e = Estimate { theta_stance_rad_s: -0.2, ..Estimate::default() };
        let as_it_is = landing.next_energy(&e, 0.15) + landing.gain_of(e.stance.other());
        for lacks in [-0.03, 0.03] {
            let (push_m, gain) = landing.push(&e, as_it_is + lacks, 0.15, steady_m);
            let made_m = if lacks < 0.0 { share * push_m } else { push_m };
            assert!((gain - lacks).abs() < 1e-12 && (gain - PUSH_GAIN * made_m).abs() < 1e-12, "{lacks}: {push_m}");
        }
        // Much too fast: the toe cannot make it, and nobody is told that it can.
        let (push_m, gain) = landing.push(&e, as_it_is - 0.5, 0.15, steady_m);
        assert!(push_m <= landing.numbers.push_least_m && (gain - share * PUSH_GAIN * push_m).abs() < 1e-12);
    }

    #[test]
    fn all_that_the_next_step_would_lack_is_pushed_where_the_toe_has_the_length() {
        let mut landing = landing();
        let (wanted_rad, speed_m_s) = (landing.steady_rad(0.4), landing.aimed_m_s(0.4));
        let passing = passing_rad_s(wanted_rad, speed_m_s / landing.leg_m);
        let e = Estimate { theta_stance_rad_s: -passing, ..Estimate::default() };
        let goal = landing.aim(&e, 0.4);
        let next = landing.next_energy(&e, wanted_rad) + landing.gain_of(e.stance.other()) + goal.gain;
        assert!((next - passing * passing).abs() < 1e-12, "{next} {passing}");
        assert!(goal.push_m > landing.numbers.push_least_m && goal.push_m < landing.numbers.push_most_m);
        // And no more than it has.
        landing.gain = [-1.0; 2];
        assert!((landing.aim(&e, 0.4).push_m - landing.numbers.push_most_m).abs() < 1e-12);
    }
}
