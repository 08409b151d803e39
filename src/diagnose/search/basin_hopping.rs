//! Out of the false minima of a rough valley.
//!
//! With stick and slip over a long window the misfit is a valley with a floor full of steps: each time the number of
//! swings before a stop changes, it jumps. Gauss-Newton, which knows the slope between two steps only, ends where it
//! comes in (measured on a leg swinging for 28 s: friction a quarter too small, misfit a fifth too large, from whatever
//! start and with growing horizons), and what comes next then seems to be missing. So the fit is tried again from afar:
//! each number is moved both ways as far as the misfit is large, the others following as the linear model has it.
//! RT: no.

use crate::diagnose::search::budget::{MOST_EFFORT, allowance};
use crate::identify::fit::{Bound, FreeRuns, Limits, Point, cost, fit, present};
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::{is_misfit, squares};
use crate::identify::noise::Colour;
use crate::identify::problem::Problem;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Most numbers, initial states included: beyond, windows are short and many, and their valley is smooth.
const MOST_NUMBERS: usize = 60;

/// How far a number is moved: 1 is so far that the linear model would have the misfit double.
const DISTANCES: [f64; 4] = [0.5, 1.0, 2.0, 4.0];

/// Starts that are fitted from, of all that are looked at, and how far.
const TAKEN_UP: usize = 6;
const SHORT_FIT: Limits = Limits { iterations: 4, tolerance: 1e-4 };

/// Most rounds, and the part of the misfit by which one must fall to be followed by another.
const MOST_ROUNDS: usize = 4;
const FALLS: f64 = 0.005;

/// Effort for valleys when a search has used up all of its own.
const FOR_VALLEYS: u64 = 100_000_000;

/// The fit from the best place found.
const FINAL_FIT: Limits = Limits { iterations: 10, tolerance: 1e-6 };

/// `now` fitted again from the best place within reach. `None` where the valley is no such one, or nothing is better.
#[must_use]
pub fn escape_local_minimum(now: &FittedModel, floors: &[f64]) -> Option<FittedModel> {
    let noise = squares(&now.residuals, floors);
    let size = now.point.parameters.len() + now.point.states.iter().map(Vec::len).sum::<usize>();
    if size > MOST_NUMBERS {
        return None;
    }
    let first = cost(&now.problem, &now.point, &noise);
    let (mut best, mut least) = (now.point.clone(), first);
    let (linearisation, most) = (now.cost_of_linearisation(), allowance(now));
    // What a part of the way would cost, by the linearisations in it; what is left for all.
    let in_time = |linearisations: usize| {
        now.problem.effort.spent() + linearisation * linearisations as u64 <= MOST_EFFORT + FOR_VALLEYS
    };
    for _ in 0..MOST_ROUNDS {
        let falls = |(cost, _): &(f64, Point)| *cost <= (1.0 - FALLS) * least;
        if !in_time(TAKEN_UP * SHORT_FIT.iterations) {
            break;
        }
        let afar = from_afar(&now.problem, &best, (least, size), &noise, most).filter(falls);
        let held = || {
            let fits = HELD.len() * now.point.parameters.len();
            in_time(2 * fits * SHORT_FIT.iterations)
                .then(|| from_held(&now.problem, &best, &noise, most).filter(falls))?
        };
        let Some((found, point)) = afar.or_else(held) else { break };
        (least, best) = (found, point);
    }
    if least >= first {
        return None;
    }
    FittedModel::fitted(now.problem.clone(), best, &noise, floors, FINAL_FIT)
}

/// `of`, where it leaves misfit led out of the false minimum that it may stand in, if that is likelier under `noise`.
#[must_use]
pub fn led_out(of: FittedModel, noise: &[Colour], floors: &[f64]) -> FittedModel {
    let total = |h: &FittedModel| -> f64 { h.blocks(noise).iter().sum() };
    let other = if is_misfit(&of.residuals, floors) { escape_local_minimum(&of, floors) } else { None };
    other.filter(|other| total(other) > total(&of)).unwrap_or(of)
}

/// The best of the fits from places around `at`, where the misfit is `least`.
fn from_afar(
    problem: &Problem,
    at: &Point,
    (least, size): (f64, usize),
    noise: &[Colour],
    most: u64,
) -> Option<(f64, Point)> {
    let metric = metric(problem, at, noise, size)?;
    let steps = (0..at.parameters.len()).flat_map(|i| {
        let row = metric.row(i).transpose();
        let along = &metric * &row / row.norm().max(1e-300);
        [along.clone(), -along].into_iter().flat_map(|step| DISTANCES.map(|far| &step * (far * libm::sqrt(least))))
    });
    let places: Vec<Point> = steps.map(|step| moved(problem, at, &step)).collect();
    let price = |at: Point| (problem.at_most(most, |limited| cost(limited, &at, noise)), at);
    let mut starts: Vec<(f64, Point)> = places.into_par_iter().map(price).collect();
    starts.sort_by(|a, b| a.0.total_cmp(&b.0));
    starts.truncate(TAKEN_UP);
    let bounds = problem.bounds();
    let one = |(_, start)| short_fit(problem, start, &bounds, noise, most);
    let fits: Vec<(f64, Point)> = starts.into_par_iter().map(one).collect();
    fits.into_iter().filter(|(cost, _)| cost.is_finite()).min_by(|a, b| a.0.total_cmp(&b.0))
}

/// Factors by which a number is moved and held there while the others follow.
const HELD: [f64; 4] = [0.75, 0.87, 1.15, 1.33];

/// The best of the fits in which one positive number at a time was held at another value first: along a valley that bends,
/// the others do not follow as the linear model has it.
fn from_held(problem: &Problem, at: &Point, noise: &[Colour], most: u64) -> Option<(f64, Point)> {
    let bounds = problem.bounds();
    let is_free = |i: &usize| !problem.logarithmic[*i] && bounds[*i].min >= 0.0 && at.parameters[*i] > 0.0;
    let places: Vec<(usize, f64)> =
        (0..bounds.len()).filter(is_free).flat_map(|i| HELD.map(|f| (i, f * at.parameters[i]))).collect();
    let one = |(i, value): (usize, f64)| {
        let mut start = at.clone();
        start.parameters[i] = value.clamp(bounds[i].min, bounds[i].max);
        let mut held = bounds.clone();
        held[i] = Bound { min: start.parameters[i], max: start.parameters[i] };
        let (_, along) = short_fit(problem, start, &held, noise, most);
        short_fit(problem, along, &bounds, noise, most)
    };
    let fits: Vec<(f64, Point)> = places.into_par_iter().map(one).collect();
    fits.into_iter().filter(|(cost, _)| cost.is_finite()).min_by(|a, b| a.0.total_cmp(&b.0))
}

/// A few steps from `start`, at the price of `most` at most: from afar a play may chatter for minutes.
fn short_fit(problem: &Problem, start: Point, bounds: &[Bound], noise: &[Colour], most: u64) -> (f64, Point) {
    let done = problem.at_most(most, |limited| fit(limited, start, bounds, noise, SHORT_FIT));
    (done.cost, done.point)
}

/// Steps of one unit of misfit each in every direction: the inverse root of the normal matrix of all numbers.
fn metric(problem: &Problem, at: &Point, noise: &[Colour], size: usize) -> Option<DMatrix<f64>> {
    let shared = at.parameters.len();
    let mut normal = DMatrix::<f64>::zeros(size, size);
    let mut first = shared;
    for (w, state) in at.states.iter().enumerate() {
        let index = |j: usize| if j < shared { j } else { first + j - shared };
        let weights = noise.iter().map(|c| if c.sigma.is_finite() { 1.0 / (c.sigma * c.sigma) } else { 0.0 });
        for (series, weight) in problem.run(w, &at.parameters, state, true)?.iter().zip(weights) {
            let rows = present(series);
            for (a, x) in series.slopes.iter().enumerate() {
                for (b, y) in series.slopes.iter().enumerate() {
                    normal[(index(a), index(b))] += weight * rows.iter().map(|k| x[*k] * y[*k]).sum::<f64>();
                }
            }
        }
        first += state.len();
    }
    let scale: Vec<f64> = normal.diagonal().iter().map(|d| if *d > 0.0 { 1.0 / libm::sqrt(*d) } else { 0.0 }).collect();
    // A direction that hardly shows is not walked for miles.
    let unit = |r: usize, c: usize| normal[(r, c)] * scale[r] * scale[c];
    let eigen = DMatrix::from_fn(size, size, unit).symmetric_eigen();
    let roots = eigen.eigenvalues.map(|x| 1.0 / libm::sqrt(x.max(1e-6)));
    let inverse = &eigen.eigenvectors * DMatrix::from_diagonal(&roots);
    Some(DMatrix::from_fn(size, size, |r, c| scale[r] * inverse[(r, c)]))
}

/// `from` moved by `step` (parameters, then the states of each window), within the bounds. A number that cannot be negative
/// moves by factors: what hangs on a ratio (a frequency on gravity over inertia) then stays put however far both go.
fn moved(problem: &Problem, from: &Point, step: &DVector<f64>) -> Point {
    let mut next = from.clone();
    let mut by = step.iter();
    let numbers = problem.bounds().into_iter().zip(&problem.logarithmic);
    for ((x, (bound, log)), d) in next.parameters.iter_mut().zip(numbers).zip(&mut by) {
        let by_factor = !log && bound.min >= 0.0 && *x > 0.0;
        *x = if by_factor { *x * libm::exp((d / *x).clamp(-1.0, 1.0)) } else { *x + d };
        *x = x.clamp(bound.min, bound.max);
    }
    for (x, d) in next.states.iter_mut().flatten().zip(by) {
        *x += d;
    }
    next
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::criterion::Context;
    use crate::diagnose::judge::evidence::Ledger;
    use crate::identify::experiment::Recording;
    use crate::identify::synthesis::record;
    use crate::model::rig::Rig;

    fn leg(viscous: f64, coulomb: f64) -> Rig {
        let text = format!(
            "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = {{ value = 0.0043, min = 0.003, max = \
             0.006 }}\ngravity_nm = 0.307\n[[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\nnoise_std = 0.002\n[[effect]]\neffect = \
             \"viscous_friction\"\nat = \"q1\"\nviscous = {{ value = {viscous}, min = 0.0, max = 0.02 }}\n[[effect]]\neffect = \
             \"coulomb_friction\"\nat = \"q1\"\ncoulomb = {{ value = {coulomb}, min = 0.0, max = 0.3 }}\n"
        );
        Rig::parse(&text, "leg").unwrap()
    }

    /// A leg swings until friction stops it. The fit comes into the valley with too little Coulomb friction and sticks.
    #[test]
    fn a_fit_that_sticks_beside_the_truth_wanders_there() {
        let times: Vec<f64> = (0..1500).map(|k| f64::from(k) * 0.01).collect();
        let blank = Recording::new("free.csv", times, Vec::new(), vec![vec![0.0; 1500]]);
        let measured = record(&leg(0.0012, 0.0061), &blank, &[0.9, 0.0], Some(3)).unwrap().measured;
        let recording = Recording { measured, ..blank };
        let context = Context {
            floors: vec![0.002],
            samples: 1500,
            given: 1,
            is_trapped: false,
            seed: 1,
            ledger: Ledger::default(),
            held_out: None,
        };
        let mut stuck = 0;
        for (viscous, coulomb) in [(0.0021, 0.0040), (0.0004, 0.0090), (0.0030, 0.0020)] {
            let problem = Problem::new(leg(viscous, coulomb), vec![recording.clone()]);
            let noise = [Colour::white(0.1)];
            let limits = Limits { iterations: 25, tolerance: 1e-7 };
            let start = Point { states: vec![vec![0.9, 0.0]], ..problem.start() };
            let fitted = FittedModel::fitted(problem, start, &noise, &context.floors, limits).unwrap();
            let found = escape_local_minimum(&fitted, &context.floors);
            let friction = |h: &FittedModel| h.rig.effects[1].values[0].value;
            let rms = |h: &FittedModel| (h.residuals[0][0].iter().map(|x| x * x).sum::<f64>() / 1500.0).sqrt();
            println!("{coulomb}: fit {:.5} {:.4}", friction(&fitted), rms(&fitted));
            let end = found.as_ref().unwrap_or(&fitted);
            println!("    wandered {:.5} {:.4}", friction(end), rms(end));
            stuck += usize::from(rms(&fitted) > 0.004);
            assert!(rms(end) < 0.0025 && (friction(end) / 0.0061 - 1.0).abs() < 0.02, "{coulomb}");
        }
        assert!(stuck > 0, "a test that no fit sticks in shows nothing");
    }
}
