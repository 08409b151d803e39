//! Left-out recordings: does an effect help where it was not fitted?
//!
//! Every fit recording (or group of them) is left out in turn, base and extended model are fitted to the others from
//! where they stand, and both run free on the one left out, its initial states fitted. An effect that mimics something
//! else gains where it was tuned and fails there.
//! RT: no.

use crate::diagnose::base::known;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::likelihood::{blocks, white};
use crate::identify::fit::{Limits, Point, fit};
use crate::identify::noise::Colour;
use crate::identify::problem::Problem;
use rayon::prelude::*;

/// Most folds: more recordings are left out in groups.
const FOLDS: usize = 3;

/// The fit to the rest starts at the fit to all: a few steps tell.
const STEPS: Limits = Limits { iterations: 4, tolerance: 1e-4 };

/// Part of the gain of `richer` over `plain` that is left when each recording is predicted from the others. Measured in
/// squares of free-run errors (robust): that is what a user sees. `None` with one recording, or nothing to gain.
#[must_use]
pub fn kept_when_left_out(plain: &Hypothesis, richer: &Hypothesis, floors: &[f64]) -> Option<f64> {
    let recordings = plain.problem.recordings.len();
    if recordings < 2 {
        return None;
    }
    let noise = white(&plain.residuals, floors);
    let total = |h: &Hypothesis| -> f64 { h.blocks(&noise).iter().sum() };
    let fitted = total(richer) - total(plain);
    let folds = recordings.min(FOLDS);
    let both = |fold: usize| {
        let out: Vec<bool> = (0..recordings).map(|r| r % folds == fold).collect();
        Some(predicted(richer, &out, &noise, floors)? - predicted(plain, &out, &noise, floors)?)
    };
    let gains: Vec<Option<f64>> = (0..folds).into_par_iter().map(both).collect();
    // A model that cannot run on what was left out does not hold there.
    let sum: f64 = gains.into_iter().map(|g| g.unwrap_or(-fitted.abs())).sum();
    (fitted > 0.0).then(|| sum / fitted)
}

/// Twice the log-likelihood of the recordings in `out` under a model that was fitted to the others.
fn predicted(of: &Hypothesis, out: &[bool], noise: &[Colour], floors: &[f64]) -> Option<f64> {
    let (rest, at) = part(of, |r| !out[r]);
    let bounds = rest.bounds();
    // The loss must suit the model's own misfit, or a rich model would be fitted to nothing but its best stretches.
    let own = white(&of.residuals, floors);
    let shared = fit(&rest, at, &bounds, &own, STEPS).point.parameters;
    let (left, at) = part(of, |r| out[r]);
    let rig = left.rig_at(&shared);
    let held = Problem { fidelity: left.fidelity, ..Problem::new(known(&rig), left.recordings.clone()) };
    let start = Point { parameters: Vec::new(), states: at.states };
    let done = fit(&held, start, &[], &own, STEPS);
    let residuals = held.residuals(&done.point)?;
    Some(blocks(&residuals, noise).iter().sum())
}

/// The problem on some of the recordings, and where it stands.
fn part(of: &Hypothesis, wanted: impl Fn(usize) -> bool) -> (Problem, Point) {
    let all = &of.problem;
    let recordings = all.recordings.iter().enumerate().filter(|(r, _)| wanted(*r)).map(|(_, x)| x.clone()).collect();
    let problem = Problem { fidelity: all.fidelity, ..Problem::new(all.rig.clone(), recordings) };
    let states = all.windows.iter().zip(&of.point.states).filter(|((r, _), _)| wanted(*r));
    let states = states.map(|(_, s)| s.clone()).collect();
    (problem, Point { parameters: of.point.parameters.clone(), states })
}
