//! Out of rest: the toes lean the robot onto its front foot, and push until it will pass the vertical. RT: yes.
//!
//! Two legs apart and the floor are a triangle. The hip needs no torque: the toes' lengths alone say where it is,
//! `θ ≈ D/2l - (r - f)/D` for the front leg, D the distance of the feet, r and f how far the rear and the front toe are out.
//! From astride at D = .36 m the vertical is a barrier of ξ² = -.3 rad²/s²; a front toe that is in and a rear one that is out
//! take .1 of the .17 rad. The rest is motion: the rear toe gets so much faster while it goes out.
//!
//! Alternative that failed: balance does not stand up from astride, 30 Nm carry the robot over from .11 rad at most.
//! Limits: the push is by the clock, what came of it is seen (`passes`); a floor that rises by more than a toe's stroke is
//! not got over.

use super::balance::Pose;
use super::pendulum::KAPPA2;
use super::ramp::{Ticks, toward};
use super::stance_toe::{by_stance, in_order};
use crate::base::time::Stamp;
use crate::config::checked::{Config, Toe};
use crate::msg::{Estimate, Leg, TOES};

/// Toe lengths on the way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lean {
    middle_m: f64,
    least_m: f64,
    reach_m: f64,
    rate_limit_m_s: f64,
    /// As asked for, m: inner, outer.
    toes_m: [f64; TOES],
    push_m_s: f64,
    ticks: Ticks,
    /// Since when nothing is left to push with.
    spent: Option<Stamp>,
}

impl Lean {
    /// Before arming only.
    pub(super) fn new(config: &Config) -> Self {
        let Toe { extended_m, retracted_m, rate_limit_m_s, .. } = config.robot.toe;
        let middle_m = 0.5 * (extended_m + retracted_m);
        Self {
            middle_m,
            least_m: config.control.foot_placement.toe_least_m,
            reach_m: config.control.foot_placement.toe_reach_m,
            rate_limit_m_s,
            toes_m: [middle_m; TOES],
            push_m_s: 0.0,
            ticks: Ticks::new(config),
            spent: None,
        }
    }

    /// Both feet have just come down: every toe goes half out, as fast as it can.
    pub(super) const fn reset(&mut self, now: Stamp) {
        self.toes_m = [self.middle_m; TOES];
        self.ticks.reset(now);
    }

    /// A push begins with the next tick.
    pub(super) const fn begin(&mut self) {
        self.push_m_s = 0.0;
        self.spent = None;
    }

    /// Nothing more is pushed: what is on its way goes on.
    pub(super) fn stop_pushing(&mut self, now: Stamp) {
        self.spent.get_or_insert(now);
    }

    /// At rest: back to half out, gently.
    pub(super) fn rest(&mut self, now: Stamp) -> [f64; TOES] {
        let most_m = GENTLY_M_S * self.ticks.since_last_s(now);
        for toe_m in &mut self.toes_m {
            *toe_m = toward(*toe_m, self.middle_m, most_m);
        }
        self.toes_m
    }

    /// All toes go in, then the rear one pushes.
    pub(super) fn push(&mut self, now: Stamp, front: Leg) -> [f64; TOES] {
        let dt_s = self.ticks.since_last_s(now);
        if self.spent.is_some() {
            return self.toes_m;
        }
        let (mut front_m, mut rear_m) = by_stance(&self.toes_m, front);
        if front_m > self.least_m {
            // Both: the rear toe needs its way to get fast.
            let most_m = GENTLY_M_S * dt_s;
            (front_m, rear_m) = (toward(front_m, self.least_m, most_m), toward(rear_m, self.least_m, most_m));
        } else if rear_m < self.reach_m {
            self.push_m_s = (self.push_m_s + PUSH_M_S2 * dt_s).min(self.rate_limit_m_s);
            rear_m = toward(rear_m, self.reach_m, self.push_m_s * dt_s);
        } else {
            self.spent.get_or_insert(now);
        }
        self.toes_m = in_order(front, front_m, rear_m);
        self.toes_m
    }

    /// The robot will pass the vertical over its front foot with this ξ²; with any, once there is nothing left to push with.
    /// `pose`: at rest over that foot, the other leg where it is.
    pub(super) fn passes(&self, e: &Estimate, pose: &Pose, wanted: f64) -> bool {
        let (lean_rad, rate) = (leans_back_rad(e, pose), e.theta_stance_rad_s);
        let energy = rate * rate - KAPPA2 * lean_rad * lean_rad.abs();
        let wanted = if self.spent.is_some() { 0.0 } else { wanted };
        rate < 0.0 && energy > wanted
    }

    /// It has not got over: it is on its way back, or was never near the vertical. Near it a robot may hang for a second.
    pub(super) fn failed(&self, now: Stamp, e: &Estimate, pose: &Pose) -> bool {
        let goes_on = leans_back_rad(e, pose) < HANGS_RAD || e.theta_stance_rad_s < -STILL_RAD_S;
        let most_s = if goes_on { HANGS_S } else { TURNS_S };
        self.spent.is_some_and(|since| now.since(since).as_s() > most_s)
    }
}

/// How far the front leg leans back from where the robot balances on it, rad.
const fn leans_back_rad(e: &Estimate, pose: &Pose) -> f64 {
    e.theta_stance_rad - pose.stance_rad
}

/// Speed of a toe that leans the robot without swing, m/s: 20 mm in .4 s.
const GENTLY_M_S: f64 = 0.05;
/// How fast the rear toe gets faster, m/s². More lifts the front foot: the rear leg would bear all of the weight.
const PUSH_M_S2: f64 = 0.8;
/// The toe follows what it is asked by some ms, and the robot goes on for a while after it: then it has turned back, s.
const TURNS_S: f64 = 0.3;
/// Farther from the vertical, on one foot, a robot falls by .4 rad/s² or more, rad.
const HANGS_RAD: f64 = 0.04;
/// Nearer to it, it has fallen one way or the other after so long, s.
const HANGS_S: f64 = 2.0;
/// Rate below which a leg is still, rad/s: ten times the gyro's noise, some counts of the encoder.
pub(super) const STILL_RAD_S: f64 = 0.05;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::time::Span;
    use crate::config::load;

    #[test]
    fn all_toes_go_in_the_rear_one_pushes_and_then_it_gives_up() {
        let mut lean = Lean::new(&load(None, &[]).unwrap().config);
        let mut now = Stamp(0);
        lean.reset(now);
        lean.begin();
        let mut fastest_m_s: f64 = 0.0;
        let mut before = lean.toes_m;
        let back = Estimate { theta_stance_rad: 0.15, ..Estimate::default() };
        let pose = pose();
        while !lean.failed(now, &back, &pose) {
            now += Span::from_ms(1);
            let toes_m = lean.push(now, Leg::Outer);
            let [inner_m, _, outer_m, _] = toes_m;
            assert!((lean.least_m..=lean.reach_m).contains(&inner_m) && outer_m >= lean.least_m, "{toes_m:?}");
            assert!(outer_m <= before[2], "the front one never pushes");
            fastest_m_s = fastest_m_s.max((inner_m - before[0]) / 1e-3);
            before = toes_m;
        }
        assert!(now < Stamp(2_000_000_000) && (before[0] - lean.reach_m).abs() < 1e-12, "{now:?} {before:?}");
        assert!(fastest_m_s > 0.2 && fastest_m_s <= lean.rate_limit_m_s + 1e-9, "{fastest_m_s}");
        // Back at rest, gently.
        for _ in 0..2000 {
            now += Span::from_ms(1);
            let toes_m = lean.rest(now);
            assert!(toes_m.iter().zip(before).all(|(a, b)| (a - b).abs() <= 1e-3 * GENTLY_M_S + 1e-12));
            before = toes_m;
        }
        assert!(before.iter().all(|m| (m - lean.middle_m).abs() < 1e-12));
    }

    fn pose() -> Pose {
        Pose::new(&load(None, &[]).unwrap().config.robot.model.params().normalised(), -0.3)
    }

    #[test]
    fn it_gives_up_on_its_way_back_and_not_where_it_may_still_go_over() {
        let mut lean = Lean::new(&load(None, &[]).unwrap().config);
        let pose = pose();
        lean.stop_pushing(Stamp(0));
        let failed = |lean_rad: f64, rate: f64, ms: i64| {
            let e = Estimate {
                theta_stance_rad: pose.stance_rad + lean_rad,
                theta_stance_rad_s: rate,
                ..Estimate::default()
            };
            lean.failed(Stamp(0) + Span::from_ms(ms), &e, &pose)
        };
        assert!(failed(0.1, 0.0, 400) && failed(0.1, 0.3, 400) && !failed(0.1, 0.0, 200));
        assert!(!failed(0.1, -0.2, 400) && !failed(0.03, 0.0, 400), "it still goes on, or hangs");
        assert!(failed(0.03, 0.0, 2_100), "no longer than that");
    }

    #[test]
    fn it_passes_with_the_rate_that_the_lean_asks_for_or_leaning_forward() {
        let mut lean = Lean::new(&load(None, &[]).unwrap().config);
        let pose = pose();
        let passes = |lean: &Lean, lean_rad: f64, rate: f64| {
            let e = Estimate {
                theta_stance_rad: pose.stance_rad + lean_rad,
                theta_stance_rad_s: rate,
                ..Estimate::default()
            };
            lean.passes(&e, &pose, 0.05)
        };
        // .1 rad before the vertical: .32 rad/s are just not enough to get there.
        assert!(!passes(&lean, 0.1, -0.31) && !passes(&lean, 0.1, -0.36) && passes(&lean, 0.1, -0.4));
        assert!(passes(&lean, -0.1, -0.05) && !passes(&lean, -0.1, 0.05), "it falls forward, or comes back");
        lean.spent = Some(Stamp(0));
        assert!(passes(&lean, 0.1, -0.36) && !passes(&lean, 0.1, -0.31));
    }
}
