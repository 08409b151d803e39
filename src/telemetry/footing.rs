//! Where the robot's joints and feet are, and where its feet stood: the floor as they found it. RT: no.

use crate::config::checked::Config;
use crate::msg::{Estimate, Leg, Mode, Snapshot, TOES, TickRecord};
use std::collections::VecDeque;

/// A place in leg lengths, stance toe at the origin; x forward, y up.
pub(super) type Place = (f64, f64);

/// Footholds that are kept: what fits on a wide screen.
const FOOTHOLDS: usize = 24;

/// Points of the robot.
#[derive(Debug, PartialEq)]
pub(super) struct Points {
    pub(super) stance_toe: Place,
    pub(super) hip: Place,
    pub(super) head: Place,
    pub(super) swing_toe: Place,
}

impl Points {
    /// As the estimator and the toes' drives have it.
    pub(super) fn of(config: &Config, estimate: &Estimate, snapshot: &Snapshot) -> Self {
        points(estimate, swing_length(config, snapshot, estimate.stance))
    }
}

/// Model notes, section 1: toe to hip is d(θ) = (-sin θ, cos θ); the body bisects the legs.
fn points(estimate: &Estimate, swing_length: f64) -> Points {
    let along = |(x, y): Place, theta: f64, length: f64| (x - length * libm::sin(theta), y + length * libm::cos(theta));
    let (stance, swing) = (estimate.theta_stance_rad, estimate.theta_swing_rad);
    let stance_toe = (0.0, 0.0);
    let hip = along(stance_toe, stance, 1.0);
    Points {
        stance_toe,
        hip,
        head: along(hip, 0.5 * (stance + swing), 0.15),
        swing_toe: along(hip, swing, -swing_length),
    }
}

/// Length of the swing leg, whose toes are retracted, in lengths of the stance leg.
fn swing_length(config: &Config, snapshot: &Snapshot, stance: Leg) -> f64 {
    let [inner, outer] = [0, TOES / 2].map(|first| snapshot.toe_position_m[first]);
    let retraction_m = match stance {
        Leg::Inner => inner - outer,
        Leg::Outer => outer - inner,
    };
    1.0 - retraction_m / config.robot.model.leg_length_m.value
}

/// Where feet stood while the robot was armed.
#[derive(Debug, Default)]
pub(super) struct Footing {
    /// From the toe that stands now, in the order in which they were left.
    left: VecDeque<Place>,
}

impl Footing {
    /// Takes the next tick. A robot that is not armed may be carried elsewhere: what its feet found counts from the arming on.
    pub(super) fn take(&mut self, config: &Config, before: &TickRecord, now: &TickRecord) {
        let is_armed = |tick: &TickRecord| tick.status.mode == Mode::Armed && tick.estimate.valid;
        if !is_armed(before) {
            self.left.clear();
        } else if is_armed(now) && before.estimate.stance != now.estimate.stance {
            let landed = Points::of(config, &before.estimate, &before.snapshot).swing_toe;
            self.left.truncate(FOOTHOLDS - 1);
            self.left.push_front((0.0, 0.0));
            for (x, y) in &mut self.left {
                (*x, *y) = (*x - landed.0, *y - landed.1);
            }
        }
    }

    /// The floor so far ahead and behind, from behind: through the footholds, level beyond them.
    pub(super) fn floor(&self, half_width: f64) -> Vec<Place> {
        let mut floor: Vec<Place> = self.left.iter().copied().chain([(0.0, 0.0)]).collect();
        floor.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (first, last) = (floor[0], floor[floor.len() - 1]);
        floor.insert(0, (first.0.min(-half_width), first.1));
        floor.push((last.0.max(half_width), last.1));
        floor
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;

    #[test]
    fn positive_angle_leans_back_and_both_feet_meet_the_ground_in_a_symmetric_stand() {
        let estimate = Estimate { theta_stance_rad: 0.2, theta_swing_rad: -0.2, ..Estimate::default() };
        let p = points(&estimate, 1.0);
        assert!(p.hip.0 < 0.0, "walking in +x the stance angle goes from + to -");
        assert!(p.swing_toe.1.abs() < 1e-12, "rounding");
        assert!((p.head.0 - p.hip.0).abs() < 1e-12, "the body bisects the legs");
    }

    #[test]
    fn footholds_stay_where_the_feet_found_them_until_the_robot_is_armed_anew() {
        let config = config::load(None, &[]).unwrap().config;
        let tick = |mode: Mode, stance: Leg| {
            let mut tick = TickRecord::default();
            tick.status.mode = mode;
            let standing =
                Estimate { theta_stance_rad: 0.2, theta_swing_rad: -0.3, valid: true, ..Estimate::default() };
            tick.estimate = Estimate { stance, ..standing };
            tick
        };
        let mut footing = Footing::default();
        let mut before = tick(Mode::Disarmed, Leg::Outer);
        let mut next = |mode, stance| {
            let now = tick(mode, stance);
            footing.take(&config, &before, &now);
            before = now;
            footing.floor(2.0)
        };
        assert_eq!(next(Mode::Armed, Leg::Inner), [(-2.0, 0.0), (0.0, 0.0), (2.0, 0.0)], "level at the arming");
        for stance in [Leg::Inner, Leg::Outer] {
            next(Mode::Armed, stance);
        }
        let (x, y) = (-libm::sin(0.2) - libm::sin(0.3), libm::cos(0.2) - libm::cos(0.3));
        // This step goes back and up: the two places that were left are ahead and below.
        let expected = [(-2.0, 0.0), (0.0, 0.0), (-x, -y), (-2.0 * x, -2.0 * y), (2.0, -2.0 * y)];
        let floor = next(Mode::Armed, Leg::Inner);
        assert_eq!(floor.len(), expected.len(), "{floor:?}");
        for (place, expected) in floor.iter().zip(expected) {
            assert!((place.0 - expected.0).hypot(place.1 - expected.1) < 1e-12, "{floor:?}");
        }
        next(Mode::Disarmed, Leg::Outer);
        assert_eq!(next(Mode::Armed, Leg::Outer).len(), 3, "it may have been carried elsewhere");
    }
}
