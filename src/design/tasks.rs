//! The problems that walking needs, as data. RT: no.

use super::problem::{Clearance, Cost, End, Finish, Landing, Limits, Phase, Problem, Start, State};
use crate::model::compass_gait::params::Params;
use crate::msg::Leg;

/// Robot, limits and cost: what all problems share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Terms {
    /// The robot, inner leg standing.
    pub robot: Params<f64>,
    /// Bounds along the way.
    pub limits: Limits,
    /// What is minimised.
    pub cost: Cost,
    /// Slowest fall of the swing toe at a touchdown, m/s.
    pub descent_m_s: f64,
    /// Weight of time where the duration is free (not in a gait, whose speed is given).
    pub time: f64,
    /// Longest duration of a phase, s.
    pub longest_s: f64,
}

/// Shortest duration of a phase, s: a swing of the leg at 30 Nm takes longer.
const SHORTEST_S: f64 = 0.1;

impl Limits {
    /// 30 Nm with friction compensated in full, μ = .6, impacts within the cone; nothing asked of the swing foot.
    pub const PLAIN: Self = Self {
        hip_torque_nm: 30.0,
        compensation: 1.0,
        friction: 0.6,
        normal_force_n: 0.0,
        clearance: None,
        swing_rad: None,
        impact: true,
    };
}

impl Clearance {
    /// 20 mm with the toe drawn in by 30 mm at .25 m/s and 5 m/s², until .1 s before touchdown.
    ///
    /// With as much retraction as clearance no step exists but a singular one: legs of equal length pass each other with
    /// the foot exactly the retraction above the floor, and before and after it may only be higher.
    pub const TOES: Self =
        Self { height_m: 0.02, retract_m: 0.03, rate_m_s: 0.25, acceleration_m_s2: 5.0, until_s: 0.1, begun_s: 0.0 };
}

impl Clearance {
    /// The same with a toe of this travel, speed and acceleration.
    #[must_use]
    pub const fn with_toe(self, retract_m: f64, rate_m_s: f64, acceleration_m_s2: f64) -> Self {
        Self { retract_m, rate_m_s, acceleration_m_s2, ..self }
    }
}

impl Terms {
    /// Reference conditions of the model notes: [`Limits::PLAIN`], `∫ τ²`, for transfers `∫ τ² + 0.2`.
    #[must_use]
    pub const fn plain(robot: Params<f64>) -> Self {
        Self { robot, limits: Limits::PLAIN, cost: Cost::TORQUE, descent_m_s: 0.0, time: 0.2, longest_s: 3.0 }
    }

    /// What the robot walks with: clearance, a falling toe, 10 N of normal force.
    #[must_use]
    pub const fn careful(robot: Params<f64>) -> Self {
        let limits = Limits { clearance: Some(Clearance::TOES), normal_force_n: 10.0, ..Limits::PLAIN };
        Self { robot, limits, cost: Cost::TORQUE, descent_m_s: 0.15, time: 0.2, longest_s: 3.0 }
    }

    fn phase(&self, stance: Leg, end: End) -> Phase {
        Phase { stance, knots: 12, duration_s: [SHORTEST_S, self.longest_s], end }
    }

    fn landing(&self, step_m: [f64; 2]) -> Landing {
        Landing { step_m, floor_m: 0.0, descent_m_s: self.descent_m_s }
    }

    fn problem(&self, phases: Vec<Phase>, start: Start, finish: Finish) -> Problem {
        // Without a price of time a transfer pumps itself up slowly, to 5 s for a rebalance, where noise takes over.
        let cost = if finish == Finish::Periodic { self.cost } else { Cost { time: self.time, ..self.cost } };
        Problem { robot: self.robot, phases, start, finish, total_time_s: None, limits: self.limits, cost }
    }

    /// Steps of the same range, alternating from `first`.
    fn steps(&self, first: Leg, count: usize, step_m: [f64; 2]) -> Vec<Phase> {
        let leg = |k: usize| if k.is_multiple_of(2) { first } else { first.other() };
        (0..count).map(|k| self.phase(leg(k), End::Touchdown(self.landing(step_m)))).collect()
    }

    /// Periodic walking in two steps at a speed.
    #[must_use]
    pub fn gait(&self, step_m: f64, speed_m_s: f64) -> Problem {
        let phases = self.steps(Leg::Inner, 2, [step_m, step_m]);
        let total_time_s = Some(2.0 * step_m / speed_m_s);
        let mut problem = self.problem(phases, Start::Periodic, Finish::Periodic);
        problem.total_time_s = total_time_s;
        problem.phases.iter_mut().for_each(|phase| phase.duration_s[1] = 3.0);
        problem
    }

    /// From a state on `stance`, one step, upright at rest on the other leg.
    #[must_use]
    pub fn rebalance(&self, stance: Leg, from: State, step_m: [f64; 2]) -> Problem {
        let mut phases = self.steps(stance, 1, step_m);
        phases.push(self.phase(stance.other(), End::State([0.0; 4])));
        self.problem(phases, Start::State(from), Finish::Free)
    }

    /// From a state to another one on the same leg, without a step.
    #[must_use]
    pub fn reach(&self, stance: Leg, from: State, end: End) -> Problem {
        self.problem(vec![self.phase(stance, end)], Start::State(from), Finish::Free)
    }

    /// From a state on `stance` by `count` steps into another motion, which begins with `entry` after the last impact:
    /// a step-in from standing, or a change of speed.
    #[must_use]
    pub fn join(&self, stance: Leg, from: State, count: usize, step_m: [f64; 2], entry: State) -> Problem {
        self.problem(self.steps(stance, count, step_m), Start::State(from), Finish::Reach(entry))
    }

    /// From a state on `stance` by `count` steps to rest on both feet.
    #[must_use]
    pub fn stop(&self, stance: Leg, from: State, count: usize, step_m: [f64; 2]) -> Problem {
        let mut phases = self.steps(stance, count, step_m);
        if let Some(last) = phases.last_mut() {
            // A foot that falls fast pushes the other one off the floor: no least falling speed here.
            last.end = End::Rest(Landing { descent_m_s: 0.0, ..self.landing(step_m) });
        }
        self.problem(phases, Start::State(from), Finish::Free)
    }
}
