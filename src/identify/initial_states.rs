//! Windows whose initial state stands in a false minimum.
//!
//! Where a foot lands or a joint sticks, the misfit of a window has edges in its initial state: a fit of all windows at once
//! halts at them, one window after another, and what then moves a window off its edge seems to explain something.
//! RT: no.

use crate::identify::base_fit::known;
use crate::identify::fit::{Limits, Point, cost_of_window, fit_states};
use crate::identify::fitted_model::FittedModel;
use crate::identify::noise::Colour;
use crate::identify::problem::Problem;
use rayon::prelude::*;

/// A window that costs so many times the median of all may stand in a false minimum of its initial state.
const STRAGGLER: f64 = 3.0;

/// Stragglers sought once more: where a foot lands or a joint sticks, a state that is hardly wrong at the start can miss the
/// event, and its window would look like physics that is missing.
#[must_use]
pub fn restart_states(problem: &Problem, mut at: Point, noise: &[Colour]) -> Point {
    let costs: Vec<f64> =
        (0..at.states.len()).into_par_iter().map(|w| cost_of_window(problem, w, &at, noise)).collect();
    let mut sorted = costs.clone();
    sorted.sort_by(f64::total_cmp);
    let limit = STRAGGLER * sorted.get(sorted.len() / 2).copied().unwrap_or(f64::INFINITY);
    let one = |w: usize| {
        let mut other = at.clone();
        other.states[w] = problem.sought(w, &at, noise)?;
        (cost_of_window(problem, w, &other, noise) < costs[w]).then(|| (w, other.states.swap_remove(w)))
    };
    let better: Vec<(usize, Vec<f64>)> =
        (0..at.states.len()).into_par_iter().filter(|w| costs[*w] > limit).filter_map(one).collect();
    for (w, state) in better {
        at.states[w] = state;
    }
    at
}

/// `now` fitted on from where each window stands better when its state is fitted for itself, from its first samples. `None` if
/// none does, or nothing comes of it.
#[must_use]
pub fn refit_states(now: &FittedModel, floors: &[f64]) -> Option<FittedModel> {
    let held = now.problem.with_rig(known(&now.rig));
    let start = Point { parameters: Vec::new(), states: held.start().states };
    let others = fit_states(&held, start.states, &now.noise, STATE_FIT);
    let mut to = now.point.clone();
    let cost = |w: usize, at: &Point| cost_of_window(&now.problem, w, at, &now.noise);
    let moved = Point { states: others, ..now.point.clone() };
    let gains: Vec<f64> = (0..to.states.len()).into_par_iter().map(|w| cost(w, &now.point) - cost(w, &moved)).collect();
    for ((state, other), gain) in to.states.iter_mut().zip(moved.states).zip(&gains) {
        if *gain > 0.0 {
            *state = other;
        }
    }
    let gained: f64 = gains.iter().filter(|g| **g > 0.0).sum();
    if gained < WORTH_FITTING_ON {
        return None;
    }
    let limits = Limits { iterations: 6, tolerance: 1e-4 };
    let fit = FittedModel::fitted(now.problem.clone(), to, &now.noise, floors, limits)?;
    let total = |h: &FittedModel| -> f64 { h.blocks(&now.noise).iter().sum() };
    (total(&fit) > total(now)).then_some(fit)
}

/// A state by itself, well enough to be compared.
const STATE_FIT: Limits = Limits { iterations: 8, tolerance: 1e-4 };

/// Twice the log-likelihood for which it is worth fitting on.
const WORTH_FITTING_ON: f64 = 10.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::fit::FreeRuns;

    const RIG: &str = "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = 0.01\ngravity_nm = 0.4\n\
        [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.3\n[[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\n\
        [[effect]]\neffect = \"coulomb_friction\"\nat = \"q1\"\ncoulomb = 0.02\n";

    fn problem(window_s: Option<f64>, measured: Vec<f64>) -> Problem {
        Problem::shaken(RIG, window_s, measured)
    }

    #[test]
    fn a_window_that_stands_wrong_is_sought_once_more_and_the_others_stay() {
        let swing = problem(None, vec![0.0; 200]);
        let truth = swing.run(0, &[], &[0.6, 0.2], false).unwrap()[0].residual.clone();
        let (problem, noise) = (problem(Some(0.5), truth), [Colour::white(0.01)]);
        let states = fit_states(&problem, problem.start().states, &noise, Limits::default());
        let mut wrong = Point { parameters: Vec::new(), states: states.clone() };
        // Over the top: swinging round is a minimum of its own.
        wrong.states[2] = vec![4.0, 12.0];
        let cost = |at: &Point| cost_of_window(&problem, 2, at, &noise);
        let found = restart_states(&problem, wrong.clone(), &noise);
        assert!(cost(&found) < 1e-2 && cost(&wrong) > 100.0, "{} {}", cost(&found), cost(&wrong));
        assert_eq!((&found.states[..2], &found.states[3]), (&states[..2], &states[3]));
    }

    #[test]
    fn a_window_off_its_place_is_seated_anew_and_one_that_stands_well_is_left() {
        let swing = problem(None, vec![0.0; 200]);
        let truth = swing.run(0, &[], &[0.6, 0.2], false).unwrap()[0].residual.clone();
        let noisy = truth.iter().enumerate().map(|(k, y)| y + 1e-3 * libm::sin(7.3 * (k * k) as f64)).collect();
        let (problem, floors) = (problem(Some(0.5), noisy), [1e-4]);
        let states = fit_states(&problem, problem.start().states, &[Colour::white(0.01)], Limits::default());
        let at = |states: Vec<Vec<f64>>| {
            let point = Point { parameters: Vec::new(), states };
            FittedModel::at(problem.clone(), point, nalgebra::DMatrix::zeros(0, 0), &floors).unwrap()
        };
        let mut off = states.clone();
        off[2] = vec![4.0, 12.0];
        let rms = |h: &FittedModel| {
            let e: Vec<f64> = h.residuals[0].iter().flatten().copied().collect();
            libm::sqrt(e.iter().map(|x| x * x).sum::<f64>() / e.len() as f64)
        };
        let (wrong, right) = (at(off), at(states));
        let found = refit_states(&wrong, &floors).unwrap();
        assert!(
            rms(&wrong) > 0.1 && rms(&found) < 2.0 * rms(&right),
            "{} {} {}",
            rms(&wrong),
            rms(&found),
            rms(&right)
        );
        assert!(refit_states(&right, &floors).is_none());
    }
}
