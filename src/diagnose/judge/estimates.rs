//! How sure each fitted number is: its deviation, its interval, and what the data does not determine.
//!
//! RT: no.

use super::evidence::coarsening;
use crate::identify::fitted_model::FittedModel;
use crate::identify::identifiability::{Scaled, deviations, undetermined};
use crate::model::rig::{Bounds, Effect, Scope, Slot};
use crate::report::findings::Estimate;

/// Free numbers of a hypothesis with their names and scales; numbers over decades are relative already.
fn scaled(of: &FittedModel) -> Vec<Scaled> {
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
fn spreads(of: &FittedModel) -> Vec<f64> {
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
pub fn estimates(of: &FittedModel) -> Vec<(String, Estimate)> {
    let values = of.problem.values(&of.point.parameters);
    let spread = spreads(of);
    let one = |(i, (value, std)): (usize, (&f64, &f64))| {
        let entry = &of.problem.theta.entries[i];
        let told = estimate(of, i, *value, *std);
        let told = if is_instant(of, i) { told } else { told.within(entry.bounds.min, entry.bounds.max) };
        (entry.name.clone(), told.in_unit(of.problem.rig.unit(entry.slot)))
    };
    values.iter().zip(&spread).enumerate().map(one).collect()
}

/// Effect `e` of `of`, each of its fitted numbers bounded by its 95 % interval.
#[must_use]
pub fn within_its_intervals(of: &FittedModel, e: usize) -> Option<Effect> {
    let known = estimates(of);
    let mut effect = of.rig.effects.get(e)?.clone();
    for (k, value) in effect.values.iter_mut().enumerate() {
        let fitted = of.problem.theta.index_of_slot(Slot::Effect(Scope::Rig, e, k)).map(|i| &known[i].1);
        value.bounds = fitted.filter(|x| x.low < x.high).map(|x| Bounds { min: x.low, max: x.high });
    }
    Some(effect)
}

/// True if number `i` is the instant of an event: its bounds are where it was sought, and say nothing of where it may be.
fn is_instant(of: &FittedModel, i: usize) -> bool {
    let Slot::Effect(Scope::Rig, e, k) = of.problem.theta.entries[i].slot else { return false };
    of.problem.rig.effects.get(e).and_then(|effect| effect.kind.keys().get(k)).is_some_and(|key| key.name == "time")
}

/// Number `i` of a fit at `value`, of this deviation in the coordinate of the fit.
///
/// Its deviation is what the residual shows. Its interval holds besides what no residual shows:
/// - No form is exact. Beyond some thousands more samples do not make it truer: the likelihood is coarsened
///   ([`coarsening`], Miller and Dunson 2019), as it is in the threshold from which a mismatch counts.
/// - A recording tells when only to a sample. That commands act, or a sensor reads, somewhere within a row has the variance
///   of an even density, a twelfth of what a whole row does.
fn estimate(of: &FittedModel, i: usize, value: f64, std: f64) -> Estimate {
    let log = of.problem.logarithmic[i];
    let form = 1.0 / coarsening(of.samples());
    let within_a_row = of.row_shifts.iter().map(|shift| shift[i] * shift[i]).sum::<f64>() / 12.0;
    let whole = libm::sqrt(form * std * std + within_a_row);
    // Of what the data does not see, the value itself is the scale.
    let told = |deviation: f64| match (log, deviation.is_finite()) {
        (true, true) => deviation * value,
        (false, true) => deviation,
        (_, false) => value.abs(),
    };
    let (spread, whole) = (told(std), told(whole));
    let wide =
        if log && value > 0.0 { Estimate::log_normal(value, whole / value) } else { Estimate::normal(value, whole) };
    Estimate { std: spread, ..wide }
}

/// Combinations that the data does not determine, in words.
#[must_use]
pub fn undetermined_combinations(of: &FittedModel) -> Vec<String> {
    if of.information.nrows() == 0 || of.information.amax() == 0.0 {
        return Vec::new();
    }
    undetermined(&of.information, &scaled(of)).iter().map(|c| c.sentence()).collect()
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
            FittedModel::at(problem, Point { parameters: vec![inertia, 0.3], states }, information, &[1e-3]).unwrap();
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
