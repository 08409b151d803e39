//! What a candidate's fit may cost: one that runs off to a rod or chatters in a play must not take the time of all others.
//!
//! RT: no.

use crate::diagnose::judge::accept::has_slack_spring;
use crate::diagnose::judge::criterion::Context;
use crate::diagnose::library::limited_fit::{LINEARISATIONS, fitted_within};
use crate::identify::fit::{Limits, Point};
use crate::identify::fitted_model::FittedModel;
use crate::identify::noise::Colour;
use crate::identify::problem::Problem;
use std::sync::Arc;

/// A search should end within this effort: some 30 s on two cores. Counted effort gives the same answer on any computer.
pub(super) const MOST_EFFORT: u64 = 800_000_000;

/// The work of a whole diagnosis: twice that of the search for effects, for exchanges and last fits.
const ALL_EFFORT: u64 = 2 * MOST_EFFORT;

/// [`LINEARISATIONS`] when the search has gone on for long; less, down to a look, as all work nears its end.
const LEAST_LINEARISATIONS: u64 = 40;

/// Part of what is left of [`MOST_EFFORT`] that one fit may take: of the dozens of a round, few need their allowance.
const SHARE: u64 = 8;

/// What a candidate's fit on the windows of `base` may cost.
#[must_use]
pub(in crate::diagnose) fn allowance(base: &FittedModel) -> u64 {
    let linearisation = base.cost_of_linearisation();
    let spent = base.problem.effort.spent();
    let share = |all: u64| all.saturating_sub(spent) / SHARE;
    let least = share(ALL_EFFORT).clamp(FIRST_ALLOWANCE * linearisation, LEAST_LINEARISATIONS * linearisation);
    share(MOST_EFFORT).clamp(least, LINEARISATIONS * linearisation)
}

/// What a look at one start of a candidate may cost, by the linearisations of a fit that the answer itself may need: ten times the
/// steps, once. A start that makes a joint chatter cost hundreds (a motor's recording of 33 s without windows: over 200 s).
const FIRST_ALLOWANCE: u64 = LEAST_LINEARISATIONS / 4;

/// What one step from a start on the windows of `base` may cost.
#[must_use]
pub(in crate::diagnose) fn allowance_of_a_look(base: &FittedModel) -> u64 {
    FIRST_ALLOWANCE * base.cost_of_linearisation()
}

/// True once the work of a whole diagnosis is spent: what stands is answered, and what was not tried is said.
#[must_use]
pub(in crate::diagnose) fn is_spent(of: &FittedModel) -> bool {
    of.problem.effort.spent() > ALL_EFFORT
}

/// A fit that may cost `most`; what it costs is counted by `base`.
#[must_use]
pub(in crate::diagnose) fn within(
    most: u64,
    base: &FittedModel,
    problem: Problem,
    point: Point,
    (noise, limits): (&[Colour], Limits),
    context: &Context,
) -> Option<FittedModel> {
    let problem = Problem { effort: Arc::clone(&base.problem.effort), ..problem };
    let hypothesis = fitted_within(most, problem, point, (noise, limits), &context.floors);
    hypothesis.filter(|h| !has_slack_spring(&h.rig, context.given, h.problem.longest_s()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::worked::{Shown, shown};

    const FREE_LAG: &str =
        "[[effect]]\neffect = \"actuator_lag\"\nat = \"u\"\ntime_constant = { value = 0.002, min = 0.0, max = 0.2 }\n";

    /// A drive that lags by 20 ms; the fit begins after one step from 2 ms.
    #[test]
    fn a_fit_ends_with_its_allowance_and_its_cost_is_counted() {
        let Shown { context, problem } =
            shown("[[effect]]\neffect = \"actuator_lag\"\nat = \"u\"\ntime_constant = 0.02\n");
        let start = problem.fitted(FREE_LAG, 1);
        let limits = Limits { iterations: 25, tolerance: 1e-7 };
        let fit = |most: u64| {
            let before = start.problem.effort.spent();
            let (from, noise) = (start.point.clone(), start.noise.clone());
            let out = within(most, &start, start.problem.clone(), from, (&noise, limits), &context);
            (out, start.problem.effort.spent() - before)
        };
        let lag = |h: &FittedModel| h.rig.effects[context.given].values[0].value;
        let (whole, cost) = fit(allowance(&start));
        assert!((lag(&whole.unwrap()) / 0.02 - 1.0).abs() < 0.05);
        let (cut, less) = fit(start.cost_of_linearisation() / 2);
        assert!(less < cost, "{less} of {cost}");
        assert!(cut.is_none_or(|h| (lag(&h) / 0.02 - 1.0).abs() > 0.05), "half a linearisation is not enough");
    }
}
