//! Names of equations and bounds, so that a program can say what blocks it. RT: no.

use crate::model::compass_gait::params::Params;

/// What an equation or a bound is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Quantity {
    /// The motion must follow the equations of motion.
    Dynamics,
    /// Start state, or the state handed over by an impact.
    Start(usize),
    /// Torque of the hip motor.
    HipTorque,
    /// μ Fy - Fx of the stance foot.
    ConeForward,
    /// μ Fy + Fx of the stance foot.
    ConeBackward,
    /// Normal force of the stance foot.
    NormalForce,
    /// Height of the swing foot above what is asked.
    Clearance,
    /// Angle of the swing leg.
    SwingAngle,
    /// Duration of a phase.
    Duration,
    /// Sum of the durations.
    TotalTime,
    /// Length of the step.
    StepLength,
    /// Height of the swing toe at touchdown.
    TouchdownHeight,
    /// Falling speed of the swing toe at touchdown.
    Descent,
    /// Velocity at which the old stance foot leaves the floor.
    LiftOff,
    /// Impulse of a landing within the friction cone.
    ImpactCone,
    /// Force of a standing foot at rest within the friction cone.
    StandingCone,
    /// End state, component.
    EndState(usize),
    /// Ellipsoid of the end, 1 on its surface.
    Basin,
    /// State after the last impact, component.
    Arrival(usize),
}

const STATE: [&str; 4] = ["stance angle", "swing angle", "stance rate", "swing rate"];

impl Quantity {
    /// In words.
    #[must_use]
    pub fn words(self) -> String {
        let component = |what: &str, i: usize| format!("{} {what}", STATE.get(i).copied().unwrap_or("state"));
        match self {
            Self::Dynamics => "equations of motion".into(),
            Self::Start(i) => component("at the start", i),
            Self::HipTorque => "hip torque with friction compensation".into(),
            Self::ConeForward => "friction cone of the stance foot (pushed forward)".into(),
            Self::ConeBackward => "friction cone of the stance foot (pushed backward)".into(),
            Self::NormalForce => "normal force of the stance foot".into(),
            Self::Clearance => "clearance of the swing foot".into(),
            Self::SwingAngle => "angle of the swing leg".into(),
            Self::Duration => "duration of the phase".into(),
            Self::TotalTime => "total time (speed)".into(),
            Self::StepLength => "step length".into(),
            Self::TouchdownHeight => "height of the swing toe at touchdown".into(),
            Self::Descent => "falling speed of the swing toe at touchdown".into(),
            Self::LiftOff => "the old stance foot leaving the floor".into(),
            Self::ImpactCone => "friction cone of the impact".into(),
            Self::StandingCone => "friction cone of a foot at rest".into(),
            Self::EndState(i) => component("at the end", i),
            Self::Basin => "basin at the end (1 = its edge)".into(),
            Self::Arrival(i) => component("after the last impact", i),
        }
    }

    /// Factor to SI and unit.
    #[must_use]
    pub fn unit(self, robot: &Params<f64>) -> (f64, &'static str) {
        let (inertia, moment, l) = (robot.inertia_kg_m2(), robot.mass_moment_kg_m(), robot.leg_length_m);
        match self {
            Self::HipTorque => (inertia, "Nm"),
            Self::ConeForward | Self::ConeBackward | Self::NormalForce | Self::StandingCone => (moment, "N"),
            Self::ImpactCone => (moment, "Ns"),
            Self::Clearance | Self::StepLength | Self::TouchdownHeight => (l, "m"),
            Self::Descent | Self::LiftOff => (l, "m/s"),
            Self::SwingAngle => (1.0, "rad"),
            Self::Duration | Self::TotalTime => (1.0, "s"),
            Self::Basin | Self::Dynamics => (1.0, ""),
            Self::Start(i) | Self::EndState(i) | Self::Arrival(i) => (1.0, if i < 2 { "rad" } else { "rad/s" }),
        }
    }
}

/// A row of the program: what it is about and where.
#[derive(Clone, Copy, Debug)]
pub struct Name {
    /// What.
    pub quantity: Quantity,
    /// Phase.
    pub phase: usize,
    /// Place within the phase, 0 to 1.
    pub place: f64,
}
