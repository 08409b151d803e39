//! Laws of the fit on small closed forms.

use super::*;

/// `y = x0 exp(-a t) + b t`, one window per start value.
pub(super) struct Decay {
    measured: Vec<Vec<f64>>,
}

fn model(a: f64, b: f64, x0: f64, t: f64) -> f64 {
    x0 * libm::exp(-a * t) + b * t
}

impl Decay {
    pub(super) fn new(a: f64, b: f64) -> Self {
        let window = |x0: f64| (0..50).map(|k| model(a, b, x0, f64::from(k) * 0.1)).collect();
        Self { measured: vec![window(1.0), window(-2.0), window(0.3)] }
    }
}

impl FreeRuns for Decay {
    fn windows(&self) -> usize {
        self.measured.len()
    }
    fn run(&self, w: usize, p: &[f64], x: &[f64], _: bool) -> Option<Vec<Series>> {
        let t: Vec<f64> = (0..50).map(|k| f64::from(k) * 0.1).collect();
        let e: Vec<f64> = t.iter().map(|t| libm::exp(-p[0] * t)).collect();
        let residual = (0..50).map(|k| x[0] * e[k] + p[1] * t[k] - self.measured[w][k]).collect();
        let slopes = vec![(0..50).map(|k| -t[k] * x[0] * e[k]).collect(), t.clone(), e];
        Some(vec![Series { residual, slopes }])
    }
}

const WIDE: [Bound; 2] = [Bound { min: 0.0, max: 10.0 }, Bound { min: -10.0, max: 10.0 }];

pub(super) fn start() -> Point {
    Point { parameters: vec![0.2, 0.0], states: vec![vec![0.5]; 3] }
}

#[test]
fn parameters_and_initial_states_are_found_together() {
    let found = fit(&Decay::new(0.7, 0.05), start(), &WIDE, &[Colour::white(0.01)], Limits::default());
    assert_eq!(found.outcome, Outcome::Converged);
    assert!((found.point.parameters[0] - 0.7).abs() < 1e-4 && (found.point.parameters[1] - 0.05).abs() < 1e-4);
    assert!((found.point.states[1][0] + 2.0).abs() < 1e-3);
}

/// [`Decay`] that counts how far from 0.2 its first parameter was ever tried, and may move it by 0.1 a step.
struct Short(Decay, std::sync::Mutex<f64>);

impl FreeRuns for Short {
    fn windows(&self) -> usize {
        self.0.windows()
    }
    fn run(&self, w: usize, p: &[f64], x: &[f64], slopes: bool) -> Option<Vec<Series>> {
        let mut farthest = self.1.lock().unwrap();
        *farthest = farthest.max(p[0]);
        self.0.run(w, p, x, slopes)
    }
    fn reach(&self, index: usize) -> f64 {
        if index == 0 { 0.1 } else { f64::INFINITY }
    }
}

#[test]
fn a_step_goes_no_farther_than_its_reach_and_arrives_all_the_same() {
    let runs = Short(Decay::new(0.7, 0.05), std::sync::Mutex::new(0.0));
    let one = Limits { iterations: 1, tolerance: 1e-3 };
    let found = fit(&runs, start(), &WIDE, &[Colour::white(0.01)], one);
    let steps = STEPS as f64;
    assert!(*runs.1.lock().unwrap() <= 0.2 + 0.1 * steps + 1e-12 && found.cost.is_finite());
    let found = fit(&runs, start(), &WIDE, &[Colour::white(0.01)], Limits::default());
    assert!((found.point.parameters[0] - 0.7).abs() < 1e-4, "{:?}", found.point);
}

/// `y = x0 + 0.05 sin(40 x0)` against 0 in each of two windows: the second is a maze, the first is plain.
struct Maze;

impl FreeRuns for Maze {
    fn windows(&self) -> usize {
        2
    }
    fn run(&self, w: usize, _: &[f64], x: &[f64], _: bool) -> Option<Vec<Series>> {
        let bend = if w == 1 { 0.05 } else { 0.0 };
        let y = x[0] + bend * libm::sin(40.0 * x[0]);
        let slope = 1.0 + 40.0 * bend * libm::cos(40.0 * x[0]);
        Some(vec![Series { residual: vec![y; 20], slopes: vec![vec![slope; 20]] }])
    }
}

#[test]
fn states_of_a_plain_window_arrive_whatever_its_neighbour_does() {
    let limits = Limits { iterations: 2, tolerance: 1e-6 };
    let states = fit_states(&Maze, vec![vec![1.0], vec![1.0]], &[Colour::white(0.01)], limits);
    assert!(states[0][0].abs() < 1e-3, "{states:?}");
}

#[test]
fn a_bound_is_kept_and_the_rest_makes_up_for_it() {
    let bounds = [Bound { min: 0.0, max: 0.5 }, WIDE[1]];
    let found = fit(&Decay::new(0.7, 0.05), start(), &bounds, &[Colour::white(0.01)], Limits::default());
    assert!((found.point.parameters[0] - 0.5).abs() < 1e-9, "{:?}", found.point);
    assert_ne!(found.outcome, Outcome::Infeasible);
}

/// Linearisations that Gauss and Newton's steps need when each has derivatives of its own.
fn plain(runs: &Decay, bounds: &[Bound], noise: &[Colour]) -> usize {
    let mut walk = Walk { runs, bounds, noise, tolerance: 1e-9, at: start(), best: f64::INFINITY, damping: 1e-4 };
    for count in 1..100 {
        let system = linearise(runs, &walk.at, noise).unwrap();
        walk.best = system.cost;
        match walk.step(&system, TRIES) {
            Taken::Fell { to, cost, .. } => (walk.at, walk.best) = (to, cost),
            Taken::Arrived | Taken::Stalled => return count,
        }
    }
    100
}

#[test]
fn derivatives_that_serve_for_several_steps_are_needed_less_often() {
    let (runs, noise) = (Decay::new(0.7, 0.05), [Colour::white(0.01)]);
    let found = fit(&runs, start(), &WIDE, &noise, Limits { tolerance: 1e-9, ..Limits::default() });
    let alone = plain(&runs, &WIDE, &noise);
    println!("{} linearisations, {alone} with one step each", found.iterations);
    assert!(found.outcome == Outcome::Converged && found.iterations < alone);
    assert!((found.point.parameters[0] - 0.7).abs() < 1e-6);
}

/// [`Decay`] whose runs have cost all that they may.
struct Spent(Decay);

impl FreeRuns for Spent {
    fn windows(&self) -> usize {
        self.0.windows()
    }
    fn run(&self, w: usize, p: &[f64], x: &[f64], slopes: bool) -> Option<Vec<Series>> {
        self.0.run(w, p, x, slopes)
    }
    fn is_exhausted(&self) -> bool {
        true
    }
}

#[test]
fn a_fit_that_may_cost_no_more_stands_where_its_first_step_led() {
    let found = fit(&Spent(Decay::new(0.7, 0.05)), start(), &WIDE, &[Colour::white(0.01)], Limits::default());
    assert!(found.iterations == 1 && found.cost.is_finite());
}
