//! Left-out recordings: does an effect help where it was not fitted?
//!
//! Every fit recording (or group of them; of a single recording every stretch of windows) is left out in turn, base and extended
//! model are fitted to the others from where they stand, and both run free on the one left out, its initial states fitted. An
//! effect that mimics something else gains where it was tuned and fails there.
//! RT: no.

use crate::diagnose::screen::subsample::few;
use crate::identify::base_fit::known;
use crate::identify::fit::{Limits, Point, fit, fit_states};
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::{blocks, samples, white};
use crate::identify::noise::Colour;
use crate::identify::problem::Problem;
use rayon::prelude::*;

/// Most folds: more recordings are left out in groups. Few at a time: a third of the data (two of five recordings of a double
/// pendulum) may be all that tells one parameter from another, and what is left then speaks against any effect.
const FOLDS: usize = 6;

/// The fit to the rest starts at the fit to all: a few steps tell.
const REST_FIT: Limits = Limits { iterations: 4, tolerance: 1e-4 };

/// A model whose recordings are left out in turn: what any richer one is measured against.
pub struct CrossValidation {
    plain: FittedModel,
    /// Windows that are looked at, if not all.
    kept: Option<Vec<usize>>,
    noise: Vec<Colour>,
    /// Which windows are left out, and the likelihood of `plain` there.
    folds: Vec<(Vec<bool>, Option<f64>)>,
}

impl CrossValidation {
    /// `None` with one window.
    #[must_use]
    pub fn of(plain: &FittedModel, floors: &[f64]) -> Option<Self> {
        let kept = few(&plain.problem, samples(&plain.residuals, floors));
        let plain = kept.as_ref().map_or_else(|| plain.clone(), |kept| plain.on_windows(kept));
        let noise = white(&plain.residuals, floors);
        let (fold_of, count) = folds(&plain.problem);
        let one = |fold: usize| {
            let out: Vec<bool> = fold_of.iter().map(|of| *of == fold).collect();
            let there = predicted(&plain, &out, &noise, floors);
            (out, there)
        };
        let folds = (0..count).into_par_iter().map(one).collect();
        (count > 1).then_some(Self { plain, kept, noise, folds })
    }

    /// Part of the gain of `richer` over the plain model that is left when each recording is predicted from the others.
    /// Measured in squares of free-run errors (robust): that is what a user sees. `None` if there is nothing to gain.
    #[must_use]
    pub fn cross_validated_gain_ratio(&self, richer: &FittedModel, floors: &[f64]) -> Option<f64> {
        let richer = self.kept.as_ref().map_or_else(|| richer.clone(), |kept| richer.on_windows(kept));
        let total = |h: &FittedModel| -> f64 { h.blocks(&self.noise).iter().sum() };
        let fitted = total(&richer) - total(&self.plain);
        let gain =
            |(out, plain): &(Vec<bool>, Option<f64>)| Some(predicted(&richer, out, &self.noise, floors)? - (*plain)?);
        let gains: Vec<Option<f64>> = self.folds.par_iter().map(gain).collect();
        // A model that cannot run on what was left out does not hold there.
        let sum: f64 = gains.into_iter().map(|g| g.unwrap_or(-fitted.abs())).sum();
        (fitted > 0.0).then(|| sum / fitted)
    }
}

/// The fold of each window, and how many there are.
fn folds(problem: &Problem) -> (Vec<usize>, usize) {
    let (recordings, windows) = (problem.recordings.len(), problem.windows.len());
    if recordings > 1 {
        let count = recordings.min(FOLDS);
        return (problem.windows.iter().map(|(r, _)| r % count).collect(), count);
    }
    let count = windows.min(FOLDS);
    ((0..windows).map(|w| w * count / windows).collect(), count)
}

/// Twice the log-likelihood of the windows in `out` under a model that was fitted to the others.
fn predicted(of: &FittedModel, out: &[bool], noise: &[Colour], floors: &[f64]) -> Option<f64> {
    let (rest, at) = part(of, |w| !out[w]);
    let bounds = rest.bounds();
    // The loss must suit the model's own misfit, or a rich model would be fitted to nothing but its best stretches.
    let own = white(&of.residuals, floors);
    let shared = fit(&rest, at, &bounds, &own, REST_FIT).point.parameters;
    let (left, at) = part(of, |w| out[w]);
    let rig = left.rig_at(&shared);
    let held = left.with_rig(known(&rig));
    let states = fit_states(&held, at.states, &own, REST_FIT);
    let residuals = held.residuals(&Point { parameters: Vec::new(), states })?;
    Some(blocks(&residuals, noise).iter().sum())
}

/// The problem on some of the windows, and where it stands.
fn part(of: &FittedModel, wanted: impl Fn(usize) -> bool) -> (Problem, Point) {
    let kept: Vec<usize> = (0..of.problem.windows.len()).filter(|w| wanted(*w)).collect();
    let states = kept.iter().map(|w| of.point.states[*w].clone()).collect();
    (of.problem.on_windows(&kept), Point { parameters: of.point.parameters.clone(), states })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::library::worked::{FLOORS, hiding};

    const DRAG: &str = "[[effect]]\neffect = \"quadratic_drag\"\nat = \"q1\"\nquadratic = ";

    /// `of` in windows of half a second.
    fn in_windows(of: &FittedModel) -> FittedModel {
        let problem = of.problem.with_horizon(0.5);
        let noise = vec![Colour::white(0.001)];
        let start = problem.start();
        FittedModel::fitted(problem, start, &noise, &FLOORS, Limits::default()).unwrap()
    }

    #[test]
    fn of_a_single_recording_windows_are_left_out_and_what_is_there_holds_in_them() {
        let truth = hiding(&format!("{DRAG}0.004\n"));
        let free = format!("{DRAG}{{ value = 0.001, min = 0.0, max = 0.1 }}\n");
        let [plain, drag] = [truth.fitted("", 10), truth.fitted(&free, 10)].map(|whole| in_windows(&whole));
        assert!(CrossValidation::of(&truth.fitted("", 10), &FLOORS).is_none(), "one window");
        let left_out = CrossValidation::of(&plain, &FLOORS).unwrap();
        assert_eq!(left_out.folds.len(), plain.problem.windows.len());
        assert!(left_out.folds.iter().all(|(out, _)| out.iter().filter(|out| **out).count() == 1));
        let kept = left_out.cross_validated_gain_ratio(&drag, &FLOORS).unwrap();
        assert!(kept > 0.7, "{kept}");
    }
}
