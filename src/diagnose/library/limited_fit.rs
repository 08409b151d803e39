//! Fits of a model with an effect more or less, none of which may cost as much as it likes: a play chatters without the friction that was
//! taken out.
//!
//! RT: no.

use crate::diagnose::library::candidate_fit::REFIT;
use crate::identify::fit::{Limits, Point, fit};
use crate::identify::fitted_model::FittedModel;
use crate::identify::noise::Colour;
use crate::identify::problem::Problem;

/// A candidate's fit may cost so many linearisations of the model that it is added to. A stiff spring that is the answer
/// takes up to 40 (ten times the steps, four linearisations); a play that chatters or a spring that runs off to a rod
/// would take thousands. Who is cut off stands with what it has reached.
pub(in crate::diagnose) const LINEARISATIONS: u64 = 100;

/// `problem` fitted from `start` at the price of `most`, or as far as that leads. `None` if the runs leave the finite numbers.
pub(in crate::diagnose) fn fitted_within(
    most: u64,
    problem: Problem,
    start: Point,
    (noise, limits): (&[Colour], Limits),
    floors: &[f64],
) -> Option<FittedModel> {
    let fit = problem.at_most(most, |limited| fit(limited, start, &problem.bounds(), noise, limits));
    fit.cost.is_finite().then(|| FittedModel::at(problem, fit.point, fit.information, floors))?
}

/// `problem`, which has an effect less than `found`, fitted from `start`. A play chatters without the friction that was taken out.
#[must_use]
pub(in crate::diagnose) fn refitted(
    found: &FittedModel,
    (problem, start): (Problem, Point),
    noise: &[Colour],
    floors: &[f64],
) -> Option<FittedModel> {
    let most = LINEARISATIONS * found.cost_of_linearisation();
    fitted_within(most, problem, start, (noise, REFIT), floors)
}

/// `found` without its effect number `e`, everything else fitted again.
#[must_use]
pub(in crate::diagnose) fn refit_without(found: &FittedModel, e: usize, floors: &[f64]) -> Option<FittedModel> {
    let mut rig = found.rig.clone();
    rig.effects.remove(e);
    refitted(found, found.extended(rig), &found.noise, floors)
}
