//! The tables of a diagnosis: parameters before and after, the ranking, the headline.
//!
//! RT: no.

use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::tried::{Added, Context, Trial, removed};
use crate::diagnose::verdict::{Diagnosis, Estimate, ParameterLine, Ranked, Verdict};
use crate::identify::identifiability::{Scaled, deviations, undetermined};

/// Free numbers of a hypothesis with their names and scales; numbers over decades are relative already.
fn scaled(of: &Hypothesis) -> Vec<Scaled> {
    let values = of.problem.values(&of.point.parameters);
    let one = |i: usize| {
        let entry = &of.problem.theta.entries[i];
        let width = entry.bounds.max - entry.bounds.min;
        let scale = if of.problem.logarithmic[i] { 1.0 } else { values[i].abs().max(0.02 * width.min(1e12)) };
        Scaled { name: entry.name.clone(), value: values[i], scale }
    };
    (0..values.len()).map(one).collect()
}

/// Value and standard deviation of every free number, by name.
#[must_use]
pub fn estimates(of: &Hypothesis) -> Vec<(String, Estimate)> {
    let values = of.problem.values(&of.point.parameters);
    let spread = deviations(&of.information, &scaled(of));
    let one = |(i, (value, std)): (usize, (&f64, &f64))| {
        // A logarithm's deviation is relative.
        let std = if of.problem.logarithmic[i] { std * value } else { *std };
        let std = if std.is_finite() { std } else { value.abs() };
        (of.problem.theta.entries[i].name.clone(), Estimate { value: *value, std })
    };
    values.iter().zip(&spread).enumerate().map(one).collect()
}

/// Combinations that the data does not determine, in words.
#[must_use]
pub fn undetermined_combinations(of: &Hypothesis) -> Vec<String> {
    if of.information.nrows() == 0 || of.information.amax() == 0.0 {
        return Vec::new();
    }
    undetermined(&of.information, &scaled(of)).iter().map(|c| c.sentence()).collect()
}

/// Parameters before and after.
#[must_use]
pub fn parameter_lines(given: &Hypothesis, base: &Hypothesis, explained: &Hypothesis) -> Vec<ParameterLine> {
    let before = |h: &Hypothesis, name: &str| {
        h.problem.theta.index_of(name).map_or(f64::NAN, |i| h.problem.values(&h.point.parameters)[i])
    };
    let line = |(i, (name, explained_by)): (usize, (String, Estimate))| {
        let bounds = explained.problem.theta.entries[i].bounds;
        let reach = 1e-6 * (bounds.max - bounds.min);
        let at_bound = explained_by.value <= bounds.min + reach || explained_by.value >= bounds.max - reach;
        ParameterLine {
            given: before(given, &name),
            refitted: before(base, &name),
            explained: explained_by,
            at_bound,
            name,
        }
    };
    estimates(explained).into_iter().enumerate().map(line).collect()
}

/// The candidates of the first round (or of the last, if nothing was added), best first.
#[must_use]
pub fn ranking(base: &Hypothesis, added: &[Added], last: &[Trial], context: &Context) -> Vec<Ranked> {
    let mut out = Vec::new();
    let trials = added.first().map_or(last, |a| &a.others);
    if let Some(first) = added.first() {
        out.push(Ranked {
            effect: first.candidate.effect.into(),
            at: first.candidate.at.clone(),
            explained: first.removed,
            gain: first.gain,
            chosen: true,
        });
    }
    let chosen =
        |t: &Trial| added.iter().any(|a| a.candidate.effect == t.candidate.effect && a.candidate.at == t.candidate.at);
    out.extend(trials.iter().take(11).map(|t| Ranked {
        effect: t.candidate.effect.into(),
        at: t.candidate.at.clone(),
        explained: removed(base, &t.hypothesis, context),
        gain: t.gain,
        chosen: chosen(t),
    }));
    out
}

/// One or two sentences for the head of the page.
#[must_use]
pub fn headline(diagnosis: &Diagnosis) -> String {
    match diagnosis.verdict {
        Verdict::Consistent => "The simulation as given explains the recordings to within their noise. Nothing is missing.".into(),
        Verdict::Parameters => {
            "With its parameters fitted again the simulation explains the recordings to within their noise. No physics is missing.".into()
        }
        _ => diagnosis.missing.iter().map(|m| m.sentence.as_str()).collect::<Vec<_>>().join(" "),
    }
}
