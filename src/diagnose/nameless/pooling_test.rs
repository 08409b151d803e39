//! Answers where no effect is the matter: a channel that follows nothing, recordings of different machines.
//!
//! RT: no.

use crate::diagnose::judge::pooling::{asks_for_separate_fits, disagrees, is_explained, is_unfollowed};
use crate::diagnose::nameless::residual_force::Unlisted;
use crate::identify::fit::{Limits, Point};
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::white;
use crate::identify::noise::{Colour, median_abs};
use crate::identify::problem::Problem;
use crate::identify::rollout::Pooled;
use crate::report::table::number;

/// The answer where nothing was found and a channel does not follow all the same: its sign, its column, its place.
#[must_use]
pub fn unfollowed(of: &FittedModel, floors: &[f64]) -> Option<Unlisted> {
    let worst = |c: usize| {
        let residual: Vec<f64> = of.residuals[c].iter().flatten().copied().collect();
        let rms = libm::sqrt(residual.iter().map(|x| x * x).sum::<f64>() / residual.len().max(1) as f64);
        let pooled = Pooled::of(&of.rig, of.problem.recordings.iter());
        let part = rms / pooled.std[c];
        let is_lost = |r: usize| is_unfollowed(over_noise(of, r, c, floors), part);
        (0..of.problem.recordings.len()).any(is_lost).then_some((c, part))
    };
    let channels = (0..of.rig.sensors.len()).filter(|c| floors[*c].is_finite());
    let (c, part) = channels.filter_map(worst).max_by(|a, b| a.1.total_cmp(&b.1))?;
    let column = &of.rig.sensors[c].column;
    Some(Unlisted::at(
        column,
        format!(
            "The simulation does not follow {column}: it is off by {part:.2} of its spread, and no effect and no force of the \
             library mends that. Check the column's sign, its unit and what rig.toml says that it measures."
        ),
    ))
}

/// The answer where every recording agrees with the model by itself, but not with the others, and `found` does not bring
/// them together: they are of different machines.
#[must_use]
pub fn no_common_machine(base: &FittedModel, found: &FittedModel, floors: &[f64]) -> Option<Unlisted> {
    let count = found.problem.recordings.len();
    if (0..count).all(|r| is_explained(excess(found, r, floors))) {
        return None;
    }
    let text = disagreement(base, floors)?;
    let at = base.rig.mechanism.coordinates()[0];
    Some(Unlisted::at(at, format!("{}{}.", text[..1].to_uppercase(), &text[1..])))
}

/// Says so if every recording agrees with the model by itself, but not with the others.
pub(in crate::diagnose) fn disagreement(of: &FittedModel, floors: &[f64]) -> Option<String> {
    let count = of.problem.recordings.len();
    if count < 2 || of.point.parameters.is_empty() {
        return None;
    }
    let noise = white(&of.residuals, floors);
    // Cheap first: nothing to ask for where the common fit explains everything.
    let together: Vec<f64> = (0..count).map(|r| excess(of, r, floors)).collect();
    if !together.iter().any(|x| asks_for_separate_fits(*x)) {
        return None;
    }
    // The first that is not explained even by itself ends the search: physics is missing there, not a parameter.
    let explained = |r: usize| alone(of, r, &noise, floors).filter(|a| is_explained(excess(a, 0, floors)));
    let alone: Vec<FittedModel> = (0..count).map(explained).collect::<Option<_>>()?;
    if !alone.iter().zip(&together).any(|(a, before)| disagrees(*before, excess(a, 0, floors))) {
        return None;
    }
    let values: Vec<Vec<f64>> = alone.iter().map(|a| a.problem.values(&a.point.parameters)).collect();
    let spread = |i: usize| {
        let (low, high) = values.iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v[i]), h.max(v[i])));
        (high - low) / low.abs().max(high.abs()).max(1e-300)
    };
    let most = (0..values[0].len()).max_by(|a, b| spread(*a).total_cmp(&spread(*b)))?;
    let each = of.problem.recordings.iter().zip(&values).map(|(r, v)| format!("{} in {}", number(v[most]), r.name));
    Some(format!(
        "each recording agrees with the model by itself, but not with the others: {} is {}; are they all of the same rig? \
         What differs on purpose belongs into `parameters` of its recording in rig.toml",
        of.problem.theta.entries[most].name,
        each.collect::<Vec<_>>().join(", ")
    ))
}

/// The same rig fitted to one recording only.
fn alone(of: &FittedModel, recording: usize, noise: &[Colour], floors: &[f64]) -> Option<FittedModel> {
    let problem = Problem::new(of.rig.clone(), vec![of.problem.recordings[recording].clone()]);
    let mine = of.problem.windows.iter().zip(&of.point.states).filter(|((r, _), _)| *r == recording);
    let start = Point { parameters: problem.vector(), states: mine.map(|(_, state)| state.clone()).collect() };
    FittedModel::fitted(problem, start, noise, floors, Limits { iterations: 10, tolerance: 1e-4 })
}

/// Residual of one recording over its sample-to-sample noise, the worst channel.
fn excess(of: &FittedModel, recording: usize, floors: &[f64]) -> f64 {
    let channels = (0..of.rig.sensors.len()).filter(|c| floors[*c].is_finite());
    channels.map(|c| over_noise(of, recording, c, floors)).fold(0.0, f64::max)
}

/// Residual of one channel of a recording over its sample-to-sample noise.
fn over_noise(of: &FittedModel, recording: usize, c: usize, floors: &[f64]) -> f64 {
    let windows = (0..of.problem.windows.len()).filter(|w| of.problem.windows[*w].0 == recording);
    let samples = &of.problem.recordings[recording].measured[c];
    let bends: Vec<f64> = samples.windows(3).map(|y| y[0] - 2.0 * y[1] + y[2]).collect();
    let noise = (median_abs(&bends) / (0.6745 * libm::sqrt(6.0))).max(floors[c]);
    let residual: Vec<f64> = windows.flat_map(|w| of.residuals[c][w].iter().copied()).collect();
    let rms = libm::sqrt(residual.iter().map(|x| x * x).sum::<f64>() / residual.len().max(1) as f64);
    if noise.is_finite() && noise > 0.0 { rms / noise } else { 0.0 }
}
