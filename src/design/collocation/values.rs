//! Cost, equations and bounds as plain numbers. RT: no.

use super::layout::{Layout, Stage};
use super::point::{Point, ROWS, point};
use super::terminal::conditions;
use crate::base::scalar::Scalar;
use crate::design::problem::{End, Finish, Problem, Start};
use crate::model::compass_gait::impact;
use crate::model::compass_gait::kinematics::swing_toe;
use crate::model::compass_gait::params::Normalised;

/// State derivative at a point.
pub(super) fn flow(w: &[f64; 5], p: &Point<f64>) -> [f64; 4] {
    [w[2], w[3], p.acceleration[0], p.acceleration[1]]
}

/// State at the midpoint of an interval of length `h`.
pub(super) fn midpoint(x0: &[f64; 5], f0: &[f64; 4], x1: &[f64; 5], f1: &[f64; 4], h: f64, torque: f64) -> [f64; 5] {
    let mut out = [torque; 5];
    for i in 0..4 {
        out[i] = 0.5 * (x0[i] + x1[i]) + h / 8.0 * (f0[i] - f1[i]);
    }
    out
}

/// Evaluates a program.
pub(super) struct Values<'a> {
    pub(super) problem: &'a Problem,
    pub(super) layout: &'a Layout,
    /// Normalised parameters of each phase.
    pub(super) params: &'a [Normalised<f64>],
}

impl Values<'_> {
    pub(super) fn evaluate(&self, w: &[f64], c: &mut [f64], g: &mut [f64]) -> f64 {
        let mut cost = 0.0;
        let mut before: Option<([f64; 5], Point<f64>)> = None;
        for stage in &self.layout.stages {
            let x = stage.state(w);
            let here = self.point(stage.phase, &x);
            g[stage.knot_rows()..stage.knot_rows() + ROWS].copy_from_slice(&here.rows);
            match (stage.knot, &before) {
                (0, None) => self.start(stage, w, &x, c),
                (0, Some((from, _))) => self.link(stage, from, &x, c),
                (_, Some(before)) => cost += self.interval(stage, w, before, (&x, &here), c, g),
                (_, None) => {}
            }
            self.clearance(stage, w, &x, g);
            if stage.last {
                self.end(stage, w, &x, c, g);
            }
            before = Some((x, here));
        }
        self.border(w, c, g);
        cost
    }

    fn point(&self, phase: usize, x: &[f64; 5]) -> Point<f64> {
        point(&self.params[phase], &self.problem.limits, &self.problem.cost, x)
    }

    pub(super) fn step_s(&self, phase: usize, w: &[f64]) -> f64 {
        w[self.layout.durations + phase] / self.intervals(phase)
    }

    #[expect(clippy::cast_precision_loss, reason = "a few hundred knots")]
    pub(super) fn intervals(&self, phase: usize) -> f64 {
        (self.problem.phases[phase].knots - 1) as f64
    }

    fn interval(
        &self,
        stage: &Stage,
        w: &[f64],
        (x0, p0): &([f64; 5], Point<f64>),
        (x1, p1): (&[f64; 5], &Point<f64>),
        c: &mut [f64],
        g: &mut [f64],
    ) -> f64 {
        let h = self.step_s(stage.phase, w);
        let (f0, f1) = (flow(x0, p0), flow(x1, p1));
        let mid = midpoint(x0, &f0, x1, &f1, h, stage.mid_torque(w));
        let pm = self.point(stage.phase, &mid);
        let fm = flow(&mid, &pm);
        for i in 0..4 {
            c[stage.e0 + i] = x1[i] - x0[i] - h / 6.0 * (f0[i] + 4.0 * fm[i] + f1[i]);
        }
        g[stage.g0..stage.g0 + ROWS].copy_from_slice(&pm.rows);
        h / 6.0 * (p0.cost + 4.0 * pm.cost + p1.cost)
    }

    fn start(&self, stage: &Stage, w: &[f64], x: &[f64; 5], c: &mut [f64]) {
        for i in 0..4 {
            let from = match (self.problem.start, self.layout.orbit) {
                (Start::State(state), _) => state[i],
                (Start::Periodic, Some(orbit)) => w[orbit + i],
                (Start::Periodic, None) => x[i],
            };
            c[stage.e0 + i] = x[i] - from;
        }
    }

    fn link(&self, stage: &Stage, from: &[f64; 5], x: &[f64; 5], c: &mut [f64]) {
        let to = self.impact(stage.phase - 1, from);
        for i in 0..4 {
            c[stage.e0 + i] = x[i] - to[i];
        }
    }

    /// State after the impact that ends a phase; not a number if there is none.
    fn impact(&self, phase: usize, x: &[f64; 5]) -> [f64; 4] {
        impact::step(&self.params[phase], &[x[0], x[1], x[2], x[3]]).unwrap_or([f64::NAN; 4])
    }

    fn clearance(&self, stage: &Stage, w: &[f64], x: &[f64; 5], g: &mut [f64]) {
        if let (true, Some(clearance)) = (stage.clear, self.problem.limits.clearance) {
            let duration = w[self.layout.durations + stage.phase];
            let t = self.step_s(stage.phase, w) * knot_number(stage);
            let begun_s = clearance.begun_at(stage.phase);
            let l = self.problem.robot.leg_length_m;
            g[stage.clearance_row()] = clearance.margin([x[0], x[1]], t, duration, l, begun_s);
        }
        if stage.swing {
            g[stage.swing_row()] = x[1];
        }
    }

    fn end(&self, stage: &Stage, w: &[f64], x: &[f64; 5], c: &mut [f64], g: &mut [f64]) {
        let phase = &self.problem.phases[stage.phase];
        let (limits, l) = (&self.problem.limits, self.problem.robot.leg_length_m);
        let ends = conditions(&phase.end, &self.params[stage.phase], limits, l, &[x[0], x[1], x[2], x[3]]);
        for (i, (_, value, ..)) in ends.bounds.iter().enumerate() {
            g[stage.end_rows() + i] = *value;
        }
        let e = stage.end_equations();
        if arrives(self.problem, stage.phase) {
            let to = self.impact(stage.phase, x);
            (0..4).for_each(|i| c[e + i] = to[i] - self.arrival(w, i));
        } else {
            ends.equations.iter().enumerate().for_each(|(i, (_, value))| c[e + i] = *value);
        }
    }

    /// Component of the state that the last impact must lead to.
    fn arrival(&self, w: &[f64], i: usize) -> f64 {
        match (self.problem.finish, self.layout.orbit) {
            (Finish::Periodic, Some(orbit)) => w[orbit + i],
            (Finish::Reach(state), _) => state[i],
            _ => 0.0,
        }
    }

    fn border(&self, w: &[f64], c: &mut [f64], g: &mut [f64]) {
        let phases = self.layout.phases();
        let durations = &w[self.layout.durations..self.layout.durations + phases];
        let first = self.layout.duration_rows();
        g[first..first + phases].copy_from_slice(durations);
        if let Some(orbit) = self.layout.orbit {
            let e = self.layout.border_equations();
            let posture = orbit_posture(self.problem, &[w[orbit], w[orbit + 1]]);
            c[e..e + 2].copy_from_slice(&posture);
        }
        if let Some(total) = self.problem.total_time_s {
            c[self.layout.m - 1] = durations.iter().sum::<f64>() - total;
        }
    }
}

#[expect(clippy::cast_precision_loss, reason = "a few hundred knots")]
pub(super) const fn knot_number(stage: &Stage) -> f64 {
    stage.knot as f64
}

/// The last phase's impact has to lead somewhere.
pub(super) fn arrives(problem: &Problem, phase: usize) -> bool {
    phase + 1 == problem.phases.len() && problem.finish != Finish::Free
}

/// Equations on the posture of a periodic motion's first state: height and length of the step that leads there.
pub(super) fn orbit_posture<S: Scalar>(problem: &Problem, q: &[S; 2]) -> [S; 2] {
    let l = problem.robot.leg_length_m;
    let (floor, step) = match problem.phases.last().map(|phase| phase.end) {
        Some(End::Touchdown(landing) | End::Rest(landing)) => (landing.floor_m / l, landing.step_m[0] / l),
        _ => (0.0, 0.0),
    };
    let toe = swing_toe([q[1], q[0]]);
    [toe[1] - floor, toe[0] - step]
}
