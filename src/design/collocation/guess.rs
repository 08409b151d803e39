//! A first guess: straight lines between the postures at the ends. RT: no.

use super::layout::Layout;
use crate::design::problem::{End, Phase, Problem, Start, State};

/// Unknowns of a motion that changes posture at a steady rate, without torque.
#[must_use]
pub fn guess(problem: &Problem) -> Vec<f64> {
    let layout = Layout::new(problem);
    let mut w = vec![0.0; layout.n];
    let durations = durations(problem);
    let postures = postures(problem);
    for stage in &layout.stages {
        let phase = &problem.phases[stage.phase];
        #[expect(clippy::cast_precision_loss, reason = "a few hundred knots")]
        let share = stage.knot as f64 / (phase.knots - 1) as f64;
        let (from, to) = postures[stage.phase];
        for i in 0..2 {
            w[stage.w0 + stage.xo + i] = from[i] + share * (to[i] - from[i]);
            w[stage.w0 + stage.xo + 2 + i] = (to[i] - from[i]) / durations[stage.phase];
        }
    }
    w[layout.durations..layout.durations + durations.len()].copy_from_slice(&durations);
    if let Some(orbit) = layout.orbit {
        let first = layout.stages[0].state(&w);
        w[orbit..orbit + 4].copy_from_slice(&first[..4]);
    }
    w
}

/// The prescribed time in equal parts, or a second each, within bounds.
fn durations(problem: &Problem) -> Vec<f64> {
    #[expect(clippy::cast_precision_loss, reason = "a handful of phases")]
    let each = problem.total_time_s.map_or(1.0, |total| total / problem.phases.len() as f64);
    problem.phases.iter().map(|phase| each.clamp(phase.duration_s[0], phase.duration_s[1])).collect()
}

/// Angles at start and end of every phase.
fn postures(problem: &Problem) -> Vec<([f64; 2], [f64; 2])> {
    let mut out = Vec::new();
    let mut from = match problem.start {
        Start::State(x) => [x[0], x[1]],
        // A periodic motion starts as its last step ends, the legs exchanged.
        Start::Periodic => problem.phases.last().map_or([0.0; 2], |phase| swapped(end_posture(problem, phase))),
    };
    for phase in &problem.phases {
        let to = end_posture(problem, phase);
        out.push((from, to));
        from = swapped(to);
    }
    out
}

const fn swapped(q: [f64; 2]) -> [f64; 2] {
    [q[1], q[0]]
}

fn end_posture(problem: &Problem, phase: &Phase) -> [f64; 2] {
    match phase.end {
        End::State(x) => angles(&x),
        End::Basin { centre, .. } => angles(&centre),
        End::Touchdown(landing) | End::Rest(landing) => {
            let length = 0.5 * (landing.step_m[0] + landing.step_m[1]);
            let half = libm::asin(0.5 * length / problem.robot.leg_length_m);
            [-half, half]
        }
    }
}

const fn angles(x: &State) -> [f64; 2] {
    [x[0], x[1]]
}
