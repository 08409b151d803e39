//! `compass bench identify CASE`: time of our fit against the cost it has reached. RT: no.
//!
//! Half of `bench/identify/compare`; the other half are SciPy's. The cost is the sum over all samples of the squared
//! error over the channel's pooled deviation: what the other contenders minimise too.

use crate::cli::Outcome;
use crate::identify::base_fit::fit_recordings;
use crate::identify::experiment::Experiment;
use crate::identify::fit::{FreeRuns, Limits, Point, Series, fit};
use crate::identify::noise::Colour;
use crate::identify::problem::Problem;
use crate::identify::rollout::Pooled;
use crate::model::rig::{Rig, Use};
use std::io::Write;
use std::path::Path;
use std::time::Instant;

/// Residuals are small against this many deviations, so that the robust loss of the fit is the plain square.
const WIDE: f64 = 30.0;

/// Linearisations looked at.
const MOST: usize = 25;

/// Prints lines of a word and what it says: `parameters` by name, `std` of the channels, `start` cost, then per number of
/// linearisations `at` seconds and cost, and `values` of the parameters, in the order of their names. With `only` so many
/// linearisations and nothing but names and values.
pub(super) fn run(case: &Path, horizons_s: &[f64], only: Option<usize>) -> anyhow::Result<Outcome> {
    let experiment = Experiment::load(case)?;
    let std = Pooled::of(&experiment.rig, experiment.of_use(Use::Fit)).std;
    let noise: Vec<Colour> = std.iter().map(|std| Colour::white(WIDE * std)).collect();
    let full = Problem::new(experiment.rig.clone(), fit_recordings(&experiment));
    let mut out = std::io::stdout().lock();
    let names: Vec<&str> = full.theta.entries.iter().map(|entry| entry.name.as_str()).collect();
    writeln!(out, "parameters {}", names.join(","))?;
    // A run to be timed does what a fit needs and no more: the other contenders' clocks see no further costs either.
    if only.is_none() {
        writeln!(out, "std {}\nstart {}", listed(&std), cost(&full, &full.start(), &std))?;
    }
    let began = Instant::now();
    let rig = grown(&full, horizons_s, &noise);
    let grown_s = began.elapsed().as_secs_f64();
    // One fit per number of linearisations: looking at it does not disturb it.
    for iterations in only.map_or(1..=MOST, |n| n..=n) {
        let began = Instant::now();
        let problem = full.with_rig(rig.clone());
        let done = fit(&problem, problem.start(), &problem.bounds(), &noise, Limits { iterations, tolerance: 1e-9 });
        let seconds = grown_s + began.elapsed().as_secs_f64();
        if only.is_none() {
            writeln!(out, "at {seconds} {}", cost(&problem, &done.point, &std))?;
        }
        writeln!(out, "values {}", listed(&problem.values(&done.point.parameters)))?;
        if done.iterations < iterations {
            break;
        }
    }
    Ok(Outcome::Fine)
}

/// The rig after the stages of a growing horizon, as in `compass identify`.
fn grown(full: &Problem, horizons_s: &[f64], noise: &[Colour]) -> Rig {
    let mut rig = full.rig.clone();
    for horizon_s in horizons_s {
        let stage = full.with_rig(rig).with_horizon(*horizon_s);
        let done = fit(&stage, stage.start(), &stage.bounds(), noise, Limits { iterations: 6, tolerance: 1e-3 });
        rig = stage.rig_at(&done.point.parameters);
    }
    rig
}

/// Sum of squared errors over the deviations of their channels; infinite if a run leaves the finite numbers.
fn cost(problem: &Problem, at: &Point, std: &[f64]) -> f64 {
    let channel = |(series, std): (&Series, &f64)| -> f64 {
        series.residual.iter().filter(|e| e.is_finite()).map(|e| (e / std) * (e / std)).sum()
    };
    let window = |w: usize| -> f64 {
        let run = problem.run(w, &at.parameters, &at.states[w], false);
        run.map_or(f64::INFINITY, |all| all.iter().zip(std).map(channel).sum())
    };
    (0..problem.windows.len()).map(window).sum()
}

fn listed(numbers: &[f64]) -> String {
    numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(",")
}
