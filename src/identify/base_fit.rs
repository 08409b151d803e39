//! The base fit: parameters as given and fitted again, on horizons that grow, with samples that cannot be true left out.
//!
//! RT: no.

use crate::identify::experiment::{Experiment, Recording};
use crate::identify::fit::{Limits, Point, fit, fit_states};
use crate::identify::fitted_model::FittedModel;
use crate::identify::initial_states::{refit_states, restart_states};
use crate::identify::likelihood::{is_misfit, memory, white};
use crate::identify::noise::{Colour, median_abs};
use crate::identify::problem::Problem;
use crate::identify::rollout::Pooled;
use crate::model::rig::{Rig, Sensor, Slot, Use};
use nalgebra::DMatrix;
use rayon::prelude::*;
use std::sync::Arc;

/// Horizons of the first stages, s (model notes §9).
const HORIZONS_S: [f64; 4] = [0.5, 1.0, 2.0, 4.0];

/// Smallest residual that each channel can have: rounding, and a millionth of its spread for exact simulations;
/// infinite where a channel carries no signal.
#[must_use]
pub fn floors(rig: &Rig, pooled: &Pooled, recordings: &[Recording]) -> Vec<f64> {
    let one = |(c, (sensor, std)): (usize, (&Sensor, &f64))| {
        if !std.is_finite() || *std <= ONLY_NOISE * roughness(recordings, c) {
            return f64::INFINITY;
        }
        (sensor.quantum / libm::sqrt(12.0)).max(1e-6 * std)
    };
    rig.sensors.iter().zip(&pooled.std).enumerate().map(one).collect()
}

/// A channel whose spread is below this many times its sample-to-sample noise carries no signal (an IMU on a held leg).
const ONLY_NOISE: f64 = 1.5;

/// Noise of a channel by its second differences, robustly.
fn roughness(recordings: &[Recording], channel: usize) -> f64 {
    let bends = recordings.iter().flat_map(|r| r.measured[channel].windows(3).map(|y| y[0] - 2.0 * y[1] + y[2]));
    median_abs(&bends.collect::<Vec<_>>()) / (0.6745 * libm::sqrt(6.0))
}

/// The fit recordings of an experiment; those without windows in pieces of [`PIECE_S`].
#[must_use]
pub fn fit_recordings(experiment: &Experiment) -> Vec<Recording> {
    let in_pieces = |r: &Recording| Recording { window_s: Some(r.window_s.unwrap_or(PIECE_S)), ..r.clone() };
    experiment.of_use(Use::Fit).map(in_pieces).collect()
}

/// Length of the free runs that are fitted where a recording has no windows, s: multiple shooting (Bock and Plitt 1984). Over a longer
/// run that sticks and slips the misfit has an edge for every swing more or less before a stop, and fits end at one of them (a leg that
/// swings for 28 s: a quarter of its friction, and an elasticity in its place). Predictions go over the whole recording.
const PIECE_S: f64 = 4.0;

/// Fits all free numbers of `rig`: horizons grow, then white noise of the size of the residual, twice.
#[must_use]
pub fn fitted(rig: &Rig, recordings: &[Recording], pooled: &Pooled, floors: &[f64]) -> Option<FittedModel> {
    let rough = rough(pooled, floors);
    let full = Problem::new(rig.clone(), recordings.to_vec());
    let direct = settled(&full, &rough, floors);
    // A false minimum leaves a misfit that anyone would see; only then the horizon has to grow.
    let grown = match &direct {
        Some(h) if follows(h, pooled, floors) => None,
        _ => grown(&full, &rough).and_then(|rig| settled(&full.with_rig(rig), &rough, floors)),
    };
    // One that is smaller than that leaves slow errors. Where feet land and joints stick, the start decides.
    let best = better(grown, direct);
    let is_slow = best.as_ref().is_none_or(|h| h.noise.iter().any(|colour| memory(colour) > SLOW));
    let starts = if is_slow { &ELSEWHERE[..] } else { &[] };
    let best_of = |best, starts: Vec<Rig>| {
        let fits = starts.into_par_iter().map(|rig| settled(&full.with_rig(rig), &rough, floors));
        fits.collect::<Vec<_>>().into_iter().fold(best, |best, other| better(other, best))
    };
    let best = best_of(best, starts.iter().map(|factor| moved(rig, *factor, |_| true)).collect());
    if best.is_some() {
        return best;
    }
    // No run survives: perhaps no rigid body has the numbers as given (two links whose mass matrix is not positive definite). Then one of
    // them is moved at a time.
    let one_moved = |slot: Slot| ELSEWHERE.map(|factor| moved(rig, factor, |other| other == slot));
    best_of(None, rig.slots().into_iter().flat_map(one_moved).collect())
}

/// The likelier of two, if there are two; the second where they are alike.
fn better(a: Option<FittedModel>, b: Option<FittedModel>) -> Option<FittedModel> {
    match (a, b) {
        (Some(a), Some(b)) => Some(if a.likelihood > b.likelihood { a } else { b }),
        (a, b) => a.or(b),
    }
}

/// Memory of a residual, in samples, that no healthy machine's has: filtered noise (a pole of .8) comes to 5.
const SLOW: f64 = 8.0;

/// Factors on all free positive numbers of the rig as given, from which the fit is tried again. A guess is 20 % off.
const ELSEWHERE: [f64; 3] = [0.8, 1.1, 1.25];

/// `rig` with those of its free positive numbers that are `wanted` times `factor`, within their bounds.
fn moved(rig: &Rig, factor: f64, wanted: impl Fn(Slot) -> bool) -> Rig {
    let mut out = rig.clone();
    for slot in rig.slots().into_iter().filter(|slot| wanted(*slot)) {
        if let Some(value) = out.value_mut(slot)
            && let Some(bounds) = value.bounds
            && value.value > 0.0
        {
            value.value = (value.value * factor).clamp(bounds.min, bounds.max);
        }
    }
    out
}

/// Largest misfit, in parts of a channel's spread, that is taken for the true minimum without a second start.
const GOOD: f64 = 0.05;

/// True if `of` leaves so little that it is taken for the true minimum.
#[must_use]
pub fn follows(of: &FittedModel, pooled: &Pooled, floors: &[f64]) -> bool {
    let relative =
        |(colour, (std, floor)): (&Colour, (&f64, &f64))| if floor.is_finite() { colour.sigma / std } else { 0.0 };
    white(&of.residuals, floors).iter().zip(pooled.std.iter().zip(floors)).map(relative).fold(0.0, f64::max) < GOOD
}

/// True if feet land in recordings that `of` does not follow. A touchdown that comes a row earlier or later is an edge that no step of a
/// fit crosses, so what is missing may be found beside other numbers only.
#[must_use]
pub fn lands_elsewhere(of: &FittedModel, floors: &[f64]) -> bool {
    of.problem.recordings.iter().any(Recording::has_steps) && is_misfit(&of.residuals, floors)
}

/// A twentieth of each channel's spread as its noise, before anything is known.
fn rough(pooled: &Pooled, floors: &[f64]) -> Vec<Colour> {
    let one = |(std, floor): (&f64, &f64)| Colour::white(if floor.is_finite() { 0.05 * std } else { f64::INFINITY });
    pooled.std.iter().zip(floors).map(one).collect()
}

/// The rig after fits on horizons that grow; `None` where the windows are shorter than any of them.
fn grown(full: &Problem, rough: &[Colour]) -> Option<Rig> {
    let horizons: Vec<f64> = HORIZONS_S.into_iter().filter(|h| *h < 0.8 * full.longest_s()).collect();
    let mut start = full.rig.clone();
    for horizon_s in &horizons {
        let problem = full.with_rig(start.clone()).with_horizon(*horizon_s);
        let stage = fit(&problem, problem.start(), &problem.bounds(), rough, Limits { iterations: 6, tolerance: 1e-3 });
        if stage.cost.is_finite() {
            start = problem.rig_at(&stage.point.parameters);
        }
    }
    (!horizons.is_empty()).then_some(start)
}

/// Full-horizon fit: initial states first, then everything; the noise follows the residual.
fn settled(problem: &Problem, rough: &[Colour], floors: &[f64]) -> Option<FittedModel> {
    let mut now = states_only(problem, problem.start(), rough, floors)?;
    for round in 0..3 {
        let noise = if round == 0 { rough.to_vec() } else { white(&now.residuals, floors) };
        let limits = Limits { iterations: if round == 0 { 15 } else { 6 }, tolerance: 1e-4 };
        now = FittedModel::fitted(problem.clone(), now.point.clone(), &noise, floors, limits)?;
    }
    // What stood wrong beside wrong numbers may be found beside the right ones.
    let noise = white(&now.residuals, floors);
    let rescued = restart_states(problem, now.point.clone(), &noise);
    if rescued != now.point {
        let limits = Limits { iterations: 6, tolerance: 1e-4 };
        now = better(FittedModel::fitted(problem.clone(), rescued, &noise, floors, limits), Some(now))?;
    }
    Some(refit_states(&now, floors).unwrap_or(now))
}

/// `rig` fitted from its own numbers to the recordings of `of`, from the first look on; the work is counted there.
#[must_use]
pub fn anew(of: &Problem, rig: &Rig, floors: &[f64]) -> Option<FittedModel> {
    let pooled = Pooled::of(rig, of.recordings.iter());
    let fresh = fitted(rig, &of.recordings, &pooled, floors)?;
    of.effort.add(fresh.problem.effort.spent());
    let problem = Problem { effort: Arc::clone(&of.effort), longest_memory: of.longest_memory, ..fresh.problem };
    FittedModel::at(problem, fresh.point, fresh.information, floors)
}

/// The rig as it is: only the initial states are fitted.
#[must_use]
pub fn as_given(rig: &Rig, recordings: &[Recording], pooled: &Pooled, floors: &[f64]) -> Option<FittedModel> {
    let rough = rough(pooled, floors);
    let problem = Problem::new(rig.clone(), recordings.to_vec());
    let start = problem.start();
    let first = states_only(&problem, start, &rough, floors)?;
    let noise = white(&first.residuals, floors);
    states_only(&problem, first.point, &noise, floors)
}

/// Fits initial states with all shared numbers held.
fn states_only(problem: &Problem, start: Point, noise: &[Colour], floors: &[f64]) -> Option<FittedModel> {
    let held = problem.with_rig(known(&problem.rig));
    let states = fit_states(&held, start.states, noise, Limits { iterations: 12, tolerance: 1e-4 });
    let n = start.parameters.len();
    let point = restart_states(problem, Point { parameters: start.parameters, states }, noise);
    FittedModel::at(problem.clone(), point, DMatrix::zeros(n, n), floors)
}

/// `rig` with no number left free.
#[must_use]
pub fn known(rig: &Rig) -> Rig {
    let mut out = rig.clone();
    for slot in rig.slots() {
        if let Some(value) = out.value_mut(slot) {
            value.bounds = None;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::rig::Setup;

    const RIG: &str = "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = 0.01\ngravity_nm = 0.4\n\
        [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.3\n[[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\n\
        [[effect]]\neffect = \"coulomb_friction\"\nat = \"q1\"\ncoulomb = 0.02\n";

    #[test]
    fn another_start_moves_all_that_is_free_and_leaves_the_bounds() {
        let text = RIG.replace("coulomb = 0.02", "coulomb = { value = 0.02, min = 0.01, max = 0.022 }");
        let rig = Rig::parse(&text, "rig.toml").unwrap();
        let coulomb = |rig: &Rig| rig.effects[0].values[0].value;
        assert!((coulomb(&moved(&rig, 0.8, |_| true)) - 0.016).abs() < 1e-12);
        assert!((coulomb(&moved(&rig, 1.25, |_| true)) - 0.022).abs() < 1e-12);
        assert_eq!(moved(&rig, 0.8, |_| true).to_toml().matches("0.016").count(), 1, "what is known stays");
    }

    /// A robot that falls forwards onto its other leg at row 300, or not, by its own account; its readings stand still.
    fn walk(touchdown: usize) -> FittedModel {
        let text = "schema = 1\nmechanism = \"compass_gait\"\n[parameters]\nleg_length_m = 1.045\ntotal_mass_kg = 15.2\n\
            gravity_m_s2 = 9.81\nc1 = 0.1007\nc2 = { value = 0.1434, min = 0.07, max = 0.3 }\nc3 = 0.000596\nc4 = 0.1151\nc5 = 0.1264\nc6 = 0.0026\n\
            [[actuator]]\njoint = \"hip\"\ncolumn = \"u\"\ngain = 1.0\n\
            [[sensor]]\nmeasures = \"inner\"\ncolumn = \"inner_rad\"\n[[sensor]]\nmeasures = \"hip\"\ncolumn = \"hip_rad\"\n";
        let times: Vec<f64> = (0..600).map(|k| f64::from(k) * 0.0004).collect();
        let still = vec![vec![0.0; 600]];
        let recording = Recording {
            stance: (0..600).map(|row| u8::from(row >= touchdown)).collect(),
            setup: Some(Setup::Walk),
            ..Recording::new("a.csv", times, still, vec![vec![0.0; 600]; 2])
        };
        let problem = Problem::new(Rig::parse(text, "rig.toml").unwrap(), vec![recording]);
        let mut point = problem.start();
        point.states[0] = vec![-0.12, 0.12, -0.6, 0.3];
        FittedModel::at(problem, point, DMatrix::zeros(1, 1), &[1e-3; 2]).unwrap()
    }

    #[test]
    fn feet_land_elsewhere_where_they_land_and_the_simulation_does_not_follow() {
        assert!(lands_elsewhere(&walk(300), &[1e-3; 2]));
        assert!(!lands_elsewhere(&walk(600), &[1e-3; 2]), "no foot lands");
        assert!(!lands_elsewhere(&walk(300), &[1e3; 2]), "what is left is within the floors");
    }
}
