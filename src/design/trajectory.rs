//! A planned motion as functions of time. RT: no.
//!
//! Between knots the state is the cubic and the torque the parabola that Hermite-Simpson collocation means.

use super::collocation::Program;
use super::problem::State;
use crate::model::compass_gait::dynamics::acceleration_without_friction;
use crate::model::compass_gait::params::Normalised;
use crate::msg::Leg;

/// One phase of a motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Arc {
    /// The leg that stands.
    pub stance: Leg,
    /// Its duration, s.
    pub duration_s: f64,
    /// States at equally spaced knots.
    pub states: Vec<State>,
    /// Net torque at the knots, normalised.
    pub torques: Vec<f64>,
    /// Net torque at the midpoints, normalised.
    pub mid_torques: Vec<f64>,
    /// Frictionless equations of this phase.
    pub model: Normalised<f64>,
}

/// Phases in order of time; impact and exchange of legs between them.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    /// The phases.
    pub arcs: Vec<Arc>,
}

impl Trajectory {
    /// From the unknowns of a program.
    #[must_use]
    pub fn new(program: &Program, w: &[f64]) -> Self {
        let problem = program.problem();
        let durations = program.durations(w);
        let mut arcs = Vec::new();
        for (p, phase) in problem.phases.iter().enumerate() {
            let points = program.knots(p, w);
            arcs.push(Arc {
                stance: phase.stance,
                duration_s: durations[p],
                states: points.iter().map(|x| [x[0], x[1], x[2], x[3]]).collect(),
                torques: points.iter().map(|x| x[4]).collect(),
                mid_torques: program.mid_torques(p, w),
                model: problem.params(phase).normalised().frictionless(),
            });
        }
        Self { arcs }
    }

    /// Unknowns of another program of the same phases that start from this motion.
    #[must_use]
    pub fn unknowns(&self, program: &Program) -> Vec<f64> {
        program.unknowns(|phase, share| {
            let arc = &self.arcs[phase];
            let t = share * arc.duration_s;
            (arc.state(t), arc.torque(t), arc.duration_s)
        })
    }

    /// Duration of all phases, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.arcs.iter().map(|arc| arc.duration_s).sum()
    }
}

impl Arc {
    fn place(&self, t: f64) -> (usize, f64, f64) {
        let intervals = self.states.len() - 1;
        #[expect(clippy::cast_precision_loss, reason = "a few hundred knots")]
        let h = self.duration_s / intervals as f64;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let k = ((t / h).floor().max(0.0) as usize).min(intervals - 1);
        #[expect(clippy::cast_precision_loss, reason = "a few hundred knots")]
        let s = (t / h - k as f64).clamp(0.0, 1.0);
        (k, s, h)
    }

    /// Derivative of the state under a torque.
    #[must_use]
    pub fn flow(&self, x: &State, torque: f64) -> State {
        let a = acceleration_without_friction(&self.model, [x[0], x[1]], [x[2], x[3]], torque);
        [x[2], x[3], a[0], a[1]]
    }

    /// Net torque at time `t` of the phase, normalised.
    #[must_use]
    pub fn torque(&self, t: f64) -> f64 {
        let (k, s, _) = self.place(t);
        let (a, m, b) = (self.torques[k], self.mid_torques[k], self.torques[k + 1]);
        a * (1.0 - s) * (1.0 - 2.0 * s) + 4.0 * m * s * (1.0 - s) + b * s * (2.0 * s - 1.0)
    }

    /// State at time `t` of the phase.
    #[must_use]
    pub fn state(&self, t: f64) -> State {
        let (k, s, h) = self.place(t);
        let (x0, x1) = (&self.states[k], &self.states[k + 1]);
        let (f0, f1) = (self.flow(x0, self.torques[k]), self.flow(x1, self.torques[k + 1]));
        let (s2, s3) = (s * s, s * s * s);
        let [a, b, c, d] = [2.0 * s3 - 3.0 * s2 + 1.0, s3 - 2.0 * s2 + s, 3.0 * s2 - 2.0 * s3, s3 - s2];
        std::array::from_fn(|i| a * x0[i] + b * h * f0[i] + c * x1[i] + d * h * f1[i])
    }

    /// Its part up to the time `end_s`, at `knots` knots.
    #[must_use]
    pub fn until(&self, end_s: f64, knots: usize) -> Self {
        #[expect(clippy::cast_precision_loss, reason = "a few hundred knots")]
        let time = |k: f64| end_s * k / (knots - 1) as f64;
        #[expect(clippy::cast_precision_loss, reason = "a few hundred knots")]
        let at = |k: usize, add: f64| time(k as f64 + add);
        Self {
            duration_s: end_s,
            states: (0..knots).map(|k| self.state(at(k, 0.0))).collect(),
            torques: (0..knots).map(|k| self.torque(at(k, 0.0))).collect(),
            mid_torques: (1..knots).map(|k| self.torque(at(k, -0.5))).collect(),
            ..self.clone()
        }
    }

    /// Largest difference between the planned states and an integration from knot to knot with `steps` steps each.
    #[must_use]
    pub fn defect(&self, steps: u32) -> f64 {
        let intervals = self.states.len() - 1;
        #[expect(clippy::cast_precision_loss, reason = "a few hundred knots")]
        let h = self.duration_s / intervals as f64;
        let mut worst = 0.0_f64;
        for k in 0..intervals {
            #[expect(clippy::cast_precision_loss, reason = "a few hundred knots")]
            let from = k as f64 * h;
            let x = self.integrate(self.states[k], from, from + h, steps);
            worst = (0..4).map(|i| (x[i] - self.states[k + 1][i]).abs()).fold(worst, f64::max);
        }
        worst
    }

    /// The state that the planned torque leads to, from `x` at `from` to the time `to` of the phase.
    #[must_use]
    pub fn integrate(&self, mut x: State, from: f64, to: f64, steps: u32) -> State {
        let h = (to - from) / f64::from(steps);
        for k in 0..steps {
            let t = from + f64::from(k) * h;
            let u = [self.torque(t + 1e-12), self.torque(t + 0.5 * h), self.torque(t + h - 1e-12)];
            let add = |d: &State, s: f64| std::array::from_fn(|i| x[i] + s * d[i]);
            let k1 = self.flow(&x, u[0]);
            let k2 = self.flow(&add(&k1, h / 2.0), u[1]);
            let k3 = self.flow(&add(&k2, h / 2.0), u[1]);
            let k4 = self.flow(&add(&k3, h), u[2]);
            for i in 0..4 {
                x[i] += h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
            }
        }
        x
    }
}
