//! The tables of a diagnosis: parameters before and after, the ranking, the headline.
//!
//! RT: no.

use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::judge::criterion::{Context, explained_part};
use crate::diagnose::judge::verdict::{Diagnosis, Estimate, ParameterLine, Ranked, Verdict};
use crate::diagnose::tried::{Added, Trial};
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

/// Standard deviations of all free numbers, in the coordinates of the fit.
///
/// That a number lies within its bounds is known beforehand (as a uniform density: variance of width² / 12). And a number
/// that the data hold at a bound is no freedom of the others: with it they would seem unknown where they are not.
fn spreads(of: &Hypothesis) -> Vec<f64> {
    let (bounds, scales) = (of.problem.bounds(), scaled(of));
    let mut known = of.information.clone();
    for (i, b) in bounds.iter().enumerate() {
        known[(i, i)] += 12.0 / (b.max - b.min).powi(2);
    }
    let mut out = deviations(&known, &scales);
    let at = |i: usize| {
        let (b, x) = (&bounds[i], of.point.parameters[i]);
        let near = |bound: f64| bound != 0.0 && (x - bound).abs() <= 1e-6 * (b.max - b.min);
        near(b.min) || near(b.max)
    };
    let free: Vec<usize> = (0..bounds.len()).filter(|i| !at(*i)).collect();
    if !free.is_empty() && free.len() < bounds.len() {
        let part: Vec<Scaled> = free.iter().map(|i| scales[*i].clone()).collect();
        for (i, std) in free.iter().zip(deviations(&known.select_rows(&free).select_columns(&free), &part)) {
            out[*i] = std;
        }
    }
    out
}

/// Value and standard deviation of every free number, by name.
#[must_use]
pub fn estimates(of: &Hypothesis) -> Vec<(String, Estimate)> {
    let values = of.problem.values(&of.point.parameters);
    let spread = spreads(of);
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
            at: first.candidate.place(),
            explained: first.removed,
            gain: first.gain,
            chosen: true,
        });
    }
    let chosen = |t: &Trial| added.iter().any(|a| a.candidate.is_same_as(&t.candidate));
    out.extend(trials.iter().take(11).map(|t| Ranked {
        effect: t.candidate.effect.into(),
        at: t.candidate.place(),
        explained: explained_part(base, &t.hypothesis, context),
        gain: t.gain,
        chosen: chosen(t),
    }));
    out
}

/// One or two sentences for the head of the page.
#[must_use]
pub fn headline(diagnosis: &Diagnosis) -> String {
    let said = match diagnosis.verdict {
        Verdict::Consistent => {
            vec!["The simulation as given explains the recordings to within their noise. Nothing is missing."]
        }
        Verdict::Parameters => {
            vec![
                "With its parameters fitted again the simulation explains the recordings to within their noise. No physics is missing.",
            ]
        }
        _ => diagnosis.missing.iter().map(|m| m.sentence.as_str()).collect(),
    };
    let seen = diagnosis.seen.iter().map(|s| s.sentence.as_str());
    said.into_iter().chain(seen).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::fit::Point;
    use crate::identify::problem::Problem;
    use nalgebra::dmatrix;

    const RIG: &str = "schema = 1\nmechanism = \"pendulum\"\n[parameters]\n\
        inertia_kg_m2 = { value = 0.01, min = 0.008, max = 0.012 }\ngravity_nm = 0.4\n\
        [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = { value = 0.3, min = 0.0, max = 10.0 }\n\
        [[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\n";

    /// Deviations with an inertia and a gain of which the data know the ratio alone, to a thousandth.
    fn deviations_at(inertia: f64) -> [f64; 2] {
        let problem = Problem::shaken(RIG, None, vec![0.0; 200]);
        let states = problem.start().states;
        // Of gain / 0.3 - inertia / 0.01.
        let information = dmatrix![1e10, -1e10 / 30.0; -1e10 / 30.0, 1e10 / 900.0];
        let of =
            Hypothesis::at(problem, Point { parameters: vec![inertia, 0.3], states }, information, &[1e-3]).unwrap();
        let known = estimates(&of);
        [known[0].1.std, known[1].1.std]
    }

    #[test]
    fn what_is_known_beforehand_limits_an_interval_and_a_number_at_its_bound_widens_none() {
        let flat = 0.004 / libm::sqrt(12.0);
        let [inertia, gain] = deviations_at(0.01);
        assert!((inertia / flat - 1.0).abs() < 0.01 && (gain / (30.0 * flat) - 1.0).abs() < 0.01, "{inertia} {gain}");
        let [inertia, gain] = deviations_at(0.012);
        assert!((inertia / flat - 1.0).abs() < 0.01 && (gain / 3e-4 - 1.0).abs() < 0.01, "{inertia} {gain}");
    }
}
