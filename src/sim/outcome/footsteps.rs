//! True changes of stance, and how far they brought the robot. RT: no.

use crate::config::checked::Config;
use crate::msg::{Leg, TOES};
use crate::sim::Reading;

/// A stride that nobody has made yet, m: what counts as usual at the first steps.
const FIRST_STRIDE_M: f64 = 0.1;
/// Weight of the newest stride in the usual one.
const NEWEST: f64 = 0.2;
/// Toes of a leg.
const PAIR: usize = TOES / 2;

/// One true change of stance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// When, s.
    pub at_s: f64,
    /// The new foothold ahead of the old one, m horizontally, + forwards.
    pub stride_m: f64,
}

/// Counts them.
#[derive(Clone, Debug)]
pub struct Footsteps {
    /// A leg with its toes at 0, m.
    bare_leg_m: f64,
    stance: Option<Leg>,
    steps: u32,
    distance_m: f64,
    first: Option<(f64, f64)>,
    last: Option<(f64, f64)>,
    usual_m: Option<f64>,
}

impl Footsteps {
    /// None yet.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        Self {
            bare_leg_m: config.body().leg_length_m.value - config.robot.toe.extended_m,
            stance: None,
            steps: 0,
            distance_m: 0.0,
            first: None,
            last: None,
            usual_m: None,
        }
    }

    /// A change of stance, if there was one since the last look. A robot that rests rocks from foot to foot: no steps.
    pub fn look(&mut self, now_s: f64, reading: &Reading, rests: bool) -> Option<Step> {
        let before = self.stance.replace(reading.stance)?;
        if before == reading.stance || rests {
            return None;
        }
        let foot = |leg: Leg| {
            let k = leg as usize;
            self.leg_m(k, reading) * libm::sin(reading.leg_angle_rad[k])
        };
        let stride_m = foot(reading.stance) - foot(before);
        self.steps += 1;
        self.distance_m += stride_m;
        self.first.get_or_insert((now_s, self.distance_m));
        self.last = Some((now_s, self.distance_m));
        self.usual_m = Some(self.usual_m.map_or(stride_m, |usual| usual + NEWEST * (stride_m - usual)));
        Some(Step { at_s: now_s, stride_m })
    }

    fn leg_m(&self, leg: usize, reading: &Reading) -> f64 {
        let out = |k: usize| reading.toe_position_m[PAIR * leg + k] - reading.toe_spring_m[PAIR * leg + k];
        self.bare_leg_m + (0..PAIR).map(out).fold(0.0, f64::max)
    }

    /// How many.
    #[must_use]
    pub const fn steps(&self) -> u32 {
        self.steps
    }

    /// From the first foothold to the last, m.
    #[must_use]
    pub const fn distance_m(&self) -> f64 {
        self.distance_m
    }

    /// From the first change of stance to the last, s and m: what speed and cost are measured on.
    #[must_use]
    pub fn stretch(&self) -> Option<(f64, f64)> {
        let ((from_s, from_m), (to_s, to_m)) = (self.first?, self.last?);
        (to_s > from_s).then_some((to_s - from_s, to_m - from_m))
    }

    /// Mean speed over that stretch, m/s.
    #[must_use]
    pub fn mean_speed_m_s(&self) -> Option<f64> {
        self.stretch().map(|(s, m)| m / s)
    }

    /// When the last one was, s.
    #[must_use]
    pub fn last_s(&self) -> Option<f64> {
        self.last.map(|(at_s, _)| at_s)
    }

    /// Usual length of a stride, m.
    #[must_use]
    pub fn usual_stride_m(&self) -> f64 {
        self.usual_m.map_or(FIRST_STRIDE_M, f64::abs)
    }

    /// +1 if it walks forwards (or nowhere yet), -1 if backwards.
    #[must_use]
    pub const fn direction(&self) -> f64 {
        if self.distance_m < 0.0 { -1.0 } else { 1.0 }
    }
}
