//! The tables of a diagnosis: parameters before and after, the ranking.
//!
//! RT: no.

use crate::diagnose::judge::criterion::{Context, explained_part};
use crate::diagnose::judge::estimates::estimates;
use crate::diagnose::judge::verdict::{Estimate, ParameterLine, Ranked};
use crate::diagnose::library::candidate_fit::{CandidateFit, SelectedEffect};
use crate::identify::fitted_model::FittedModel;
use crate::identify::noise::median_abs;
use crate::identify::problem::Problem;

/// Median time between two rows of the recordings that were fitted, s.
#[must_use]
pub fn step_s(of: &FittedModel) -> f64 {
    let steps = of.problem.recordings.iter().flat_map(|r| r.times.windows(2).map(|t| t[1] - t[0]));
    median_abs(&steps.collect::<Vec<_>>())
}

/// Parameters before and after.
#[must_use]
pub fn parameter_lines(given: &Problem, base: &FittedModel, explained: &FittedModel) -> Vec<ParameterLine> {
    let (given_at, base_at) = (given.start().parameters, &base.point.parameters);
    let value = |of: &Problem, at: &[f64], name: &str| of.theta.index_of(name).map_or(f64::NAN, |i| of.values(at)[i]);
    let line = |(i, (name, explained_by)): (usize, (String, Estimate))| {
        let bounds = explained.problem.theta.entries[i].bounds;
        let reach = 1e-6 * (bounds.max - bounds.min);
        let at_bound = explained_by.value <= bounds.min + reach || explained_by.value >= bounds.max - reach;
        ParameterLine {
            given: value(given, &given_at, &name),
            refitted: value(&base.problem, base_at, &name),
            explained: explained_by,
            at_bound,
            name,
        }
    };
    estimates(explained).into_iter().enumerate().map(line).collect()
}

/// The candidates of the first round (or of the last, if nothing was added), best first.
#[must_use]
pub fn ranking(base: &FittedModel, added: &[SelectedEffect], last: &[CandidateFit], context: &Context) -> Vec<Ranked> {
    let mut out = Vec::new();
    let trials = added.first().map_or(last, |a| &a.others);
    if let Some(first) = added.first() {
        out.push(Ranked {
            effect: first.candidate.effect.into(),
            at: first.candidate.place(),
            explained: first.removed,
            gain: first.gain,
            chosen: true,
        });
    }
    let chosen = |t: &CandidateFit| added.iter().any(|a| a.candidate.is_same_as(&t.candidate));
    out.extend(trials.iter().take(11).map(|t| Ranked {
        effect: t.candidate.effect.into(),
        at: t.candidate.place(),
        explained: explained_part(base, &t.hypothesis, context),
        gain: t.gain,
        chosen: chosen(t),
    }));
    out
}
