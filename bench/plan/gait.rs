//! Solves the benchmark's gait whenever a line asks for it: `12` answers with one line of JSON for 12 knots a phase.
//!
//! `bench/plan/compare` drives it beside CasADi and IPOPT. The time is the whole one, from the problem's description to
//! the solution.

use compass::design::collocation::{Program, guess};
use compass::design::nlp::{Options, Outcome, solve};
use compass::design::solve::{Effort, plan};
use compass::design::tasks::Terms;
use compass::design::trajectory::Trajectory;
use compass::model::compass_gait::params::Params;
use std::io::{BufRead, Write};
use std::time::Instant;

/// Time, cost, largest defect after re-integration (200 steps an interval), iterations.
type Answer = (f64, f64, f64, usize);

/// From the straight-line guess with these knots alone.
fn cold(knots: usize) -> Option<Answer> {
    let begin = Instant::now();
    let problem = Terms::plain(Params::sysid()).gait(0.4, 0.4).with_knots(knots);
    let mut program = Program::new(&problem);
    let solved = solve(&mut program, guess(&problem), &Options::COLD);
    let took = begin.elapsed().as_secs_f64();
    let motion = Trajectory::new(&program, &solved.at.w);
    (solved.outcome == Outcome::Converged).then(|| (took, solved.cost, defect(&motion), solved.iterations))
}

/// Through 12 knots, as `compass plan` does it.
fn staged(knots: usize) -> Option<Answer> {
    let begin = Instant::now();
    let problem = Terms::plain(Params::sysid()).gait(0.4, 0.4);
    let solution = plan(&problem, Effort { coarse: 12, fine: Some(knots) }).ok()?;
    let took = begin.elapsed().as_secs_f64();
    Some((took, solution.cost, defect(&solution.trajectory), solution.iterations))
}

fn defect(motion: &Trajectory) -> f64 {
    motion.arcs.iter().map(|arc| arc.defect(200)).fold(0.0, f64::max)
}

fn main() {
    for line in std::io::stdin().lock().lines().map_while(Result::ok) {
        let (staging, number) = line.strip_prefix("staged ").map_or((false, line.as_str()), |rest| (true, rest));
        let Ok(knots) = number.trim().parse() else { continue };
        let answer = if staging { staged(knots) } else { cold(knots) };
        let text = answer.map_or("{}".to_owned(), |(s, cost, defect, iterations)| {
            format!("{{\"seconds\": {s}, \"cost\": {cost:.17}, \"defect\": {defect:e}, \"iterations\": {iterations}}}")
        });
        let mut out = std::io::stdout().lock();
        if writeln!(out, "{text}").and_then(|()| out.flush()).is_err() {
            return;
        }
    }
}
