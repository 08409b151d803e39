//! Which unknown, equation and bound stands where. RT: no.

use super::point::ROWS;
use super::rows::{Name, Quantity};
use super::terminal::conditions;
use crate::design::problem::{End, Finish, Problem, Start};

/// Unknowns of a knot: its state, its torque, and the torque of the midpoint before it (not at a first knot).
#[derive(Clone, Debug)]
pub(super) struct Stage {
    pub(super) phase: usize,
    pub(super) knot: usize,
    /// Last knot of its phase.
    pub(super) last: bool,
    /// First unknown in w, and how many.
    pub(super) w0: usize,
    pub(super) nv: usize,
    /// Place of the state within the stage's unknowns; the torque follows.
    pub(super) xo: usize,
    /// First equation, and how many: four of dynamics or start, then those of the end.
    pub(super) e0: usize,
    pub(super) ne: usize,
    /// First bound, and how many: midpoint, knot, clearance, swing angle, end.
    pub(super) g0: usize,
    pub(super) ng: usize,
    pub(super) clear: bool,
    pub(super) swing: bool,
}

impl Stage {
    /// First bound of the knot itself.
    pub(super) const fn knot_rows(&self) -> usize {
        if self.knot == 0 { self.g0 } else { self.g0 + ROWS }
    }
    /// The clearance bound, if there is one.
    pub(super) const fn clearance_row(&self) -> usize {
        self.knot_rows() + ROWS
    }
    /// The bound of the swing angle, if there is one.
    pub(super) const fn swing_row(&self) -> usize {
        self.clearance_row() + self.clear as usize
    }
    /// First bound of the end.
    pub(super) const fn end_rows(&self) -> usize {
        self.swing_row() + self.swing as usize
    }
    /// First equation of the end.
    pub(super) const fn end_equations(&self) -> usize {
        self.e0 + 4
    }
    pub(super) fn state(&self, w: &[f64]) -> [f64; 5] {
        std::array::from_fn(|i| w[self.w0 + self.xo + i])
    }
    pub(super) fn mid_torque(&self, w: &[f64]) -> f64 {
        w[self.w0]
    }
}

/// The whole program's layout.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    pub(super) stages: Vec<Stage>,
    /// First of the durations in w; the orbit's state follows if the motion is periodic.
    pub(super) durations: usize,
    pub(super) orbit: Option<usize>,
    /// Unknowns and equations of the border.
    pub(super) border_w: usize,
    pub(super) border_e: usize,
    pub(super) n: usize,
    pub(super) m: usize,
    pub(super) equations: Vec<Name>,
    pub(super) bounds: Vec<Name>,
    pub(super) low: Vec<f64>,
    pub(super) high: Vec<f64>,
}

impl Layout {
    pub(super) fn new(problem: &Problem) -> Self {
        let mut out = Self {
            stages: Vec::new(),
            durations: 0,
            orbit: None,
            border_w: 0,
            border_e: 0,
            n: 0,
            m: 0,
            equations: Vec::new(),
            bounds: Vec::new(),
            low: Vec::new(),
            high: Vec::new(),
        };
        for phase in 0..problem.phases.len() {
            for knot in 0..problem.phases[phase].knots {
                out.add_stage(problem, phase, knot);
            }
        }
        out.add_border(problem);
        out
    }

    fn add_stage(&mut self, problem: &Problem, p: usize, knot: usize) {
        let phase = &problem.phases[p];
        let last = knot + 1 == phase.knots;
        #[expect(clippy::cast_precision_loss, reason = "a few hundred knots")]
        let place = |k: f64| (knot as f64 + k) / (phase.knots - 1) as f64;
        let at = |quantity, k| Name { quantity, phase: p, place: place(k) };
        let (w0, e0, g0) = (self.n, self.equations.len(), self.bounds.len());
        let xo = usize::from(knot > 0);
        let entry = |i| if knot == 0 { Quantity::Start(i) } else { Quantity::Dynamics };
        (0..4).for_each(|i| self.equations.push(at(entry(i), 0.0)));
        if knot > 0 {
            self.point_rows(problem, at(Quantity::Dynamics, -0.5));
        }
        self.point_rows(problem, at(Quantity::Dynamics, 0.0));
        let clear = problem.limits.clearance.is_some() && knot > 0 && !last && swings(&phase.end);
        if clear {
            self.bound(at(Quantity::Clearance, 0.0), 0.0, f64::INFINITY);
        }
        if let (true, Some(most)) = (knot > 0, problem.limits.swing_rad) {
            self.bound(at(Quantity::SwingAngle, 0.0), -most, most);
        }
        if last {
            self.end(problem, p, at(Quantity::Dynamics, 0.0));
        }
        self.n += 5 + xo;
        self.stages.push(Stage {
            phase: p,
            knot,
            last,
            w0,
            nv: 5 + xo,
            xo,
            e0,
            ne: self.equations.len() - e0,
            g0,
            ng: self.bounds.len() - g0,
            clear,
            swing: knot > 0 && problem.limits.swing_rad.is_some(),
        });
    }

    fn point_rows(&mut self, problem: &Problem, at: Name) {
        let (limits, robot) = (&problem.limits, &problem.robot);
        let torque = limits.hip_torque_nm / robot.inertia_kg_m2();
        let name = |quantity| Name { quantity, ..at };
        self.bound(name(Quantity::HipTorque), -torque, torque);
        self.bound(name(Quantity::ConeForward), 0.0, f64::INFINITY);
        self.bound(name(Quantity::ConeBackward), 0.0, f64::INFINITY);
        self.bound(name(Quantity::NormalForce), limits.normal_force_n / robot.mass_moment_kg_m(), f64::INFINITY);
    }

    fn end(&mut self, problem: &Problem, p: usize, at: Name) {
        let phase = &problem.phases[p];
        let params = problem.params(phase).normalised();
        // Any state will do: what holds does not depend on it.
        let probe = [-0.2, 0.2, -0.8, -0.5];
        let ends = conditions(&phase.end, &params, &problem.limits, problem.robot.leg_length_m, &probe);
        let arrives = p + 1 == problem.phases.len() && problem.finish != Finish::Free;
        if !arrives {
            ends.equations.iter().for_each(|(quantity, _)| self.equations.push(Name { quantity: *quantity, ..at }));
        } else {
            (0..4).for_each(|i| self.equations.push(Name { quantity: Quantity::Arrival(i), ..at }));
        }
        for (quantity, _, low, high) in ends.bounds {
            self.bound(Name { quantity, ..at }, low, high);
        }
    }

    fn add_border(&mut self, problem: &Problem) {
        self.durations = self.n;
        self.border_w = problem.phases.len();
        if problem.start == Start::Periodic {
            self.orbit = Some(self.n + self.border_w);
            self.border_w += 4;
        }
        self.n += self.border_w;
        for (p, phase) in problem.phases.iter().enumerate() {
            let [low, high] = phase.duration_s;
            self.bound(Name { quantity: Quantity::Duration, phase: p, place: 1.0 }, low, high);
        }
        let first = self.equations.len();
        let at = |quantity| Name { quantity, phase: problem.phases.len() - 1, place: 1.0 };
        if problem.finish == Finish::Periodic {
            // With the orbit's state held, as it is while the chain is eliminated, arrival fixes the last posture
            // already. So the place of the last touchdown is asked of the orbit's state, which has the same posture.
            self.equations.extend([at(Quantity::TouchdownHeight), at(Quantity::StepLength)]);
        }
        if problem.total_time_s.is_some() {
            self.equations.push(at(Quantity::TotalTime));
        }
        self.border_e = self.equations.len() - first;
        self.m = self.equations.len();
    }

    fn bound(&mut self, name: Name, low: f64, high: f64) {
        self.bounds.push(name);
        self.low.push(low);
        self.high.push(high);
    }

    /// First bound of the durations.
    pub(super) fn duration_rows(&self) -> usize {
        self.bounds.len() - self.phases()
    }

    /// First equation of the border: the orbit's posture, then the total time.
    pub(super) const fn border_equations(&self) -> usize {
        self.m - self.border_e
    }

    pub(super) fn phases(&self) -> usize {
        self.border_w - if self.orbit.is_some() { 4 } else { 0 }
    }

    /// Unknowns and equations of the border together.
    pub(super) const fn border(&self) -> usize {
        self.border_w + self.border_e
    }
}

/// The swing foot takes part: it lands in the end.
const fn swings(end: &End) -> bool {
    matches!(end, End::Touchdown(_) | End::Rest(_))
}
