//! From a problem to a motion: coarse for feasibility, fine seeded from it; and what blocks when there is none. RT: no.

use super::collocation::rows::Name;
use super::collocation::{Program, guess};
use super::nlp::{Iterate, Nlp, Options, Outcome, Solved, solve};
use super::problem::{Problem, State};
use super::trajectory::Trajectory;
use std::fmt;

/// Knots of the two stages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Effort {
    /// Knots per phase of the first stage, which decides whether there is a solution.
    pub coarse: usize,
    /// Knots per phase of the second; `None` stops after the first.
    pub fine: Option<usize>,
}

impl Effort {
    /// What plans are made with.
    pub const FULL: Self = Self { coarse: 12, fine: Some(60) };
    /// Feasibility only.
    pub const COARSE: Self = Self { coarse: 12, fine: None };
}

/// A solved problem.
#[derive(Clone, Debug)]
pub struct Solution {
    /// The motion.
    pub trajectory: Trajectory,
    /// The problem with the knots of the last stage.
    pub problem: Problem,
    /// Cost.
    pub cost: f64,
    /// Iterations of all stages.
    pub iterations: usize,
    /// Scaled error of optimality.
    pub error: f64,
    /// Unknowns and multipliers of the last stage.
    pub at: Iterate,
}

/// A constraint that cannot be met together with the others.
#[derive(Clone, Debug, PartialEq)]
pub struct Violation {
    /// What and where.
    pub what: String,
    /// Phase, from 0.
    pub phase: usize,
    /// Value at the point that breaks the constraints least.
    pub value: f64,
    /// The bound it breaks.
    pub bound: f64,
    /// Unit of both.
    pub unit: &'static str,
    /// How far it is broken, in the program's own normalised units: the order of the list.
    pub normalised: f64,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {:.4} {u}, bound {:.4} {u}", self.what, self.value, self.bound, u = self.unit)
    }
}

/// Why there is no motion.
#[derive(Clone, Debug, thiserror::Error)]
pub enum Failure {
    /// Constraints that exclude one another (locally: the program is not convex).
    #[error("infeasible; least broken, this remains:{}", list(.0))]
    Infeasible(Vec<Violation>),
    /// The iterations ended without an answer.
    #[error("no solution found, and none excluded: {iterations} iterations, error {error:.1e}; still broken:{}", list(.broken))]
    NotConverged {
        /// Iterations used.
        iterations: usize,
        /// Scaled error of optimality.
        error: f64,
        /// What is broken at the last point.
        broken: Vec<Violation>,
    },
}

fn list(violations: &[Violation]) -> String {
    if violations.is_empty() {
        return " nothing".to_owned();
    }
    violations.iter().take(6).map(|v| format!("\n  {v}")).collect()
}

/// Feasible to this much counts as feasible.
const FEASIBLE: f64 = 1e-5;

/// Solves a problem from the straight-line guess.
///
/// # Errors
/// [`Failure`] names the constraints that block.
pub fn plan(problem: &Problem, effort: Effort) -> Result<Solution, Failure> {
    let coarse = problem.with_knots(effort.coarse);
    let start = guess(&coarse);
    refine(problem, first_stage(&coarse, start)?, effort)
}

/// Solves a problem from a neighbouring motion with the same phases.
///
/// # Errors
/// [`Failure`] names the constraints that block.
pub fn plan_from(problem: &Problem, near: &Trajectory, effort: Effort) -> Result<Solution, Failure> {
    let coarse = problem.with_knots(effort.coarse);
    let start = near.unknowns(&Program::new(&coarse));
    refine(problem, first_stage(&coarse, start)?, effort)
}

/// Solves a problem from a first guess: state, torque and duration at a share of a phase.
///
/// # Errors
/// [`Failure`] names the constraints that block.
pub fn plan_guessed(
    problem: &Problem,
    at: impl Fn(usize, f64) -> (State, f64, f64),
    effort: Effort,
) -> Result<Solution, Failure> {
    let coarse = problem.with_knots(effort.coarse);
    let start = Program::new(&coarse).unknowns(at);
    refine(problem, first_stage(&coarse, start)?, effort)
}

fn refine(problem: &Problem, coarse: Solution, effort: Effort) -> Result<Solution, Failure> {
    let Some(knots) = effort.fine else { return Ok(coarse) };
    let problem = problem.with_knots(knots);
    let mut program = Program::new(&problem);
    let start = coarse.trajectory.unknowns(&program);
    let mut solved = solve(&mut program, start.clone(), &Options::SEEDED);
    let mut iterations = coarse.iterations + solved.iterations;
    if solved.outcome != Outcome::Converged {
        solved = solve(&mut program, start, &Options::COLD);
        iterations += solved.iterations;
    }
    finish(&mut program, solved, iterations)
}

/// The first stage: as it is; then softened, which finds a feasible point or what blocks; then again from there.
fn first_stage(problem: &Problem, start: Vec<f64>) -> Result<Solution, Failure> {
    let mut program = Program::new(problem);
    let first = solve(&mut program, start.clone(), &Options::QUICK);
    let mut iterations = first.iterations;
    if first.outcome == Outcome::Converged {
        return finish(&mut program, first, iterations);
    }
    let soft = solve(&mut program, start, &Options::ELASTIC);
    iterations += soft.iterations;
    if soft.outcome == Outcome::Converged && soft.infeasibility > FEASIBLE {
        return Err(Failure::Infeasible(violations(&mut program, &soft.at.w)));
    }
    let again = solve(&mut program, soft.at.w, &Options::SEEDED);
    iterations += again.iterations;
    finish(&mut program, again, iterations)
}

fn finish(program: &mut Program, solved: Solved, iterations: usize) -> Result<Solution, Failure> {
    if solved.outcome != Outcome::Converged {
        let broken = violations(program, &solved.at.w);
        return Err(Failure::NotConverged { iterations, error: solved.error, broken });
    }
    Ok(Solution {
        trajectory: Trajectory::new(program, &solved.at.w),
        problem: program.problem().clone(),
        cost: solved.cost,
        iterations,
        error: solved.error,
        at: solved.at,
    })
}

/// What is broken at a point: the worst place of every constraint, worst first.
#[must_use]
pub fn violations(program: &mut Program, w: &[f64]) -> Vec<Violation> {
    let size = program.size();
    let (mut c, mut g) = (vec![0.0; size.m], vec![0.0; size.p]);
    program.values(w, &mut c, &mut g);
    let durations = program.durations(w).to_vec();
    let robot = program.problem().robot;
    let mut found: Vec<(Name, Violation)> = Vec::new();
    let mut note = |name: Name, value: f64, bound: f64| {
        let normalised = (value - bound).abs();
        let (factor, unit) = name.quantity.unit(&robot);
        let t = name.place * durations[name.phase];
        let what = format!("{}, phase {} at {t:.3} s", name.quantity.words(), name.phase + 1);
        let new = Violation { what, phase: name.phase, value: value * factor, bound: bound * factor, unit, normalised };
        match found.iter_mut().find(|(n, _)| n.quantity == name.quantity && n.phase == name.phase) {
            Some((_, old)) if old.normalised >= normalised => {}
            Some((_, old)) => *old = new,
            None => found.push((name, new)),
        }
    };
    for (name, value) in program.equations().iter().zip(&c).filter(|(_, value)| value.abs() > FEASIBLE) {
        note(*name, *value, 0.0);
    }
    let (low, high) = program.bounds();
    for (i, name) in program.bound_names().iter().enumerate() {
        if g[i] < low[i] - FEASIBLE {
            note(*name, g[i], low[i]);
        } else if g[i] > high[i] + FEASIBLE {
            note(*name, g[i], high[i]);
        }
    }
    let mut out: Vec<Violation> = found.into_iter().map(|(_, violation)| violation).collect();
    out.sort_by(|a, b| b.normalised.total_cmp(&a.normalised));
    out
}
