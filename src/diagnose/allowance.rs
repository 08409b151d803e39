//! What a candidate's fit may cost: one that runs off to a rod or chatters in a play must not take the time of all others.
//!
//! RT: no.

use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::tried::{Context, MOST_EFFORT};
use crate::identify::fit::{Limits, Point, fit};
use crate::identify::noise::Colour;
use crate::identify::problem::Problem;
use crate::model::resonance::resonance_hz;
use std::sync::Arc;

/// A candidate's fit may cost so many linearisations of the model that it is added to. A stiff spring that is the answer
/// takes up to 40 (ten times the steps, four linearisations); a play that chatters or a spring that runs off to a rod
/// would take thousands. Who is cut off stands with what it has reached.
const LINEARISATIONS: u64 = 100;
/// The same when the search has gone on for long.
const LEAST_LINEARISATIONS: u64 = 40;

/// Part of what is left of [`MOST_EFFORT`] that one fit may take: of the dozens of a round, few need their allowance.
const SHARE: u64 = 8;

/// What a candidate's fit on the windows of `base` may cost.
#[must_use]
pub(super) fn allowance(base: &Hypothesis) -> u64 {
    let linearisation = base.cost_of_linearisation();
    let share = MOST_EFFORT.saturating_sub(base.problem.effort.spent()) / SHARE;
    share.clamp(LEAST_LINEARISATIONS * linearisation, LINEARISATIONS * linearisation)
}

/// A fit that may cost `most`; what it costs is counted by `base`.
#[must_use]
pub(super) fn within(
    most: u64,
    base: &Hypothesis,
    problem: Problem,
    point: Point,
    (noise, limits): (&[Colour], Limits),
    context: &Context,
) -> Option<Hypothesis> {
    let limited = problem.clone().with_allowance(most);
    let fit = fit(&limited, point, &problem.bounds(), noise, limits);
    // How far the windows were when they gave up is chance; the effort that is told is not.
    base.problem.effort.add(limited.effort.spent().min(limited.effort.patience()));
    let problem = Problem { effort: Arc::clone(&base.problem.effort), ..problem };
    let hypothesis =
        fit.cost.is_finite().then(|| Hypothesis::at(problem, fit.point, fit.information, &context.floors))?;
    hypothesis.filter(|h| !is_slack(h))
}

/// Fewer swings than this within a window are no resonance that the window shows.
const LEAST_SWINGS: f64 = 0.5;

/// True for a spring so soft that within a window it moves nothing: the link then coasts from its fitted start, which
/// explains any slow motion and no force.
fn is_slack(of: &Hypothesis) -> bool {
    let hz = of.rig.effects.last().and_then(|effect| resonance_hz(&of.rig, effect));
    hz.is_some_and(|hz| hz * of.problem.longest_s() < LEAST_SWINGS)
}
