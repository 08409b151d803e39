//! A planning problem as data: a list of phases, what holds at their ends, limits, cost. RT: no.
//!
//! Torque means the net torque on the legs, friction already taken off: the motor gives it plus what cancels friction,
//! and [`Limits::hip_torque_nm`] bounds the motor.

use crate::model::compass_gait::params::Params;
use crate::msg::Leg;

/// A state `[θs, θw, θ̇s, θ̇w]`, stance leg first.
pub type State = [f64; 4];

/// What is asked.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    /// The robot, inner leg standing.
    pub robot: Params<f64>,
    /// Phases in order of time. After a touchdown comes the impact, and the other leg stands.
    pub phases: Vec<Phase>,
    /// Where it starts.
    pub start: Start,
    /// What holds after the last phase.
    pub finish: Finish,
    /// Sum of all durations, s, if it is prescribed.
    pub total_time_s: Option<f64>,
    /// What must not be exceeded.
    pub limits: Limits,
    /// What is minimised.
    pub cost: Cost,
}

/// One leg stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Phase {
    /// Which.
    pub stance: Leg,
    /// Knots, both ends included, at least 2.
    pub knots: usize,
    /// Shortest and longest duration, s.
    pub duration_s: [f64; 2],
    /// What holds at its end.
    pub end: End,
}

/// Start of the first phase.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Start {
    /// This state.
    State(State),
    /// Whatever state the last phase's impact leads to: a periodic motion.
    Periodic,
}

/// End of a phase.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum End {
    /// This state, such as upright at rest.
    State(State),
    /// Within `(x - centre)ᵀ form (x - centre) ≤ level`: the basin of a feedback law.
    Basin {
        /// Centre of the ellipsoid.
        centre: State,
        /// Its symmetric matrix.
        form: [[f64; 4]; 4],
        /// Its size.
        level: f64,
    },
    /// The swing foot lands and the robot goes on over it.
    Touchdown(Landing),
    /// The swing foot lands and both feet stay: the robot stops dead, and stands at zero torque.
    Rest(Landing),
}

/// Where and how the swing foot lands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Landing {
    /// Shortest and longest step, m; equal for a given step.
    pub step_m: [f64; 2],
    /// Height of the floor there above the stance foot, m.
    pub floor_m: f64,
    /// Slowest fall of the swing toe at touchdown, m/s. A floor that is h higher or lower than planned is met h over
    /// this speed earlier or later: this bound is what makes a plan robust to the floor (docs/planning.md).
    pub descent_m_s: f64,
}

impl Landing {
    /// A step of this length on level floor, at any falling speed.
    #[must_use]
    pub const fn step(step_m: f64) -> Self {
        Self { step_m: [step_m, step_m], floor_m: 0.0, descent_m_s: 0.0 }
    }
}

/// After the last phase.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Finish {
    /// Nothing more than the last phase's end.
    Free,
    /// Impact and exchange of legs lead back to the start.
    Periodic,
    /// Impact and exchange of legs lead to this state: the entry of another motion.
    Reach(State),
}

/// Bounds along the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Motor torque at the joint, friction compensation included, Nm.
    pub hip_torque_nm: f64,
    /// Share of the hip's friction that the motor compensates.
    pub compensation: f64,
    /// Friction of foot on floor, |Fx| ≤ μ Fy.
    pub friction: f64,
    /// Least normal force of the stance foot, N.
    pub normal_force_n: f64,
    /// Clearance of the swing foot; `None`: it may pass through the floor.
    pub clearance: Option<Clearance>,
    /// Largest swing angle at the knots, rad; `None`: any.
    pub swing_rad: Option<f64>,
    /// Impacts must stay within the friction cone too, and the old stance foot must leave the floor.
    pub impact: bool,
}

/// Swing foot above the floor, its toe retracted as fast as it can.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clearance {
    /// Height that the foot keeps between retraction and [`Clearance::until_s`], m.
    pub height_m: f64,
    /// Travel of the toe, m.
    pub retract_m: f64,
    /// Its speed, m/s.
    pub rate_m_s: f64,
    /// Its acceleration, m/s².
    pub acceleration_m_s2: f64,
    /// Time before touchdown at which the foot may come down, s.
    pub until_s: f64,
    /// So long before the first phase its toe has begun to go in, s; 0: it begins with the phase.
    pub begun_s: f64,
}

/// Cost `∫ torque τ² + motor τ_m² + power (τ_m r)⁺ + time dt`, torques and power divided by `m_t l²`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cost {
    /// Weight of the net torque squared.
    pub torque: f64,
    /// Weight of the motor's torque squared, friction compensation included.
    pub motor: f64,
    /// Weight of the motor's positive mechanical power (smoothed near zero).
    pub power: f64,
    /// Weight of time.
    pub time: f64,
}

impl Cost {
    /// `∫ τ² dt`.
    pub const TORQUE: Self = Self { torque: 1.0, motor: 0.0, power: 0.0, time: 0.0 };
}

impl Problem {
    /// The robot as it stands in a phase.
    #[must_use]
    pub fn params(&self, phase: &Phase) -> Params<f64> {
        match phase.stance {
            Leg::Inner => self.robot,
            Leg::Outer => self.robot.swapped(),
        }
    }

    /// The same problem with another number of knots in every phase.
    #[must_use]
    pub fn with_knots(&self, knots: usize) -> Self {
        let mut out = self.clone();
        out.phases.iter_mut().for_each(|phase| phase.knots = knots);
        out
    }
}
