//! What follows the selection, stage by stage: exchanges, last fits, and what of it stands in the answer.
//!
//! RT: no.

use super::found::Found;
use super::start::{RUNS_AWAY, Start};
use crate::diagnose::explain::interest::{Kept, split_by_interest, undetermined, within_its_row};
use crate::diagnose::judge::criterion::{Context, compare, detection_threshold, leaves_slow_noise};
use crate::diagnose::judge::numbers::LONGEST_MEMORY;
use crate::diagnose::judge::verdict::refit_is_needed;
use crate::diagnose::library::candidate_fit::{CandidateFit, SelectedEffect};
use crate::diagnose::library::candidates::Candidate;
use crate::diagnose::nameless::pooling_test::{no_common_machine, unfollowed};
use crate::diagnose::nameless::residual_force::unexplained;
use crate::diagnose::search::basin_hopping::escape_local_minimum;
use crate::diagnose::search::budget::is_spent;
use crate::diagnose::search::converge_rivals::converge_rivals;
use crate::diagnose::search::exchange::exchange_and_eliminate;
use crate::diagnose::search::pairwise_exchange::exchange_pairs;
use crate::diagnose::search::ridge_restarts::restart_along_ridges;
use crate::diagnose::search::stepwise::{Selection, forward_on};
use crate::identify::base_fit::anew;
use crate::identify::fit::Limits;
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::{is_misfit, squares};
use crate::identify::problem::Problem;

/// What was selected, exchanged, fitted to the last digit, and judged beside a force without a name.
pub(super) fn finished(start: &Start, selection: Selection, least_share: f64, said: &mut dyn FnMut(&str)) -> Found {
    let (given, context) = (start.given.as_ref(), &start.context);
    let Selection { base, found, added, last, .. } = selection;
    let refit = given.map(|given| compare(&base, given, context));
    let refit_needed = refit.is_none_or(|refit| refit_is_needed(refit, base.point.parameters.len(), context));
    said(&refit.map_or_else(
        || RUNS_AWAY.to_owned(),
        |refit| format!("re-fitting the parameters gains {:.0} (twice the log-likelihood)", refit.total),
    ));
    let (found, added) = settled_selection(found, added, &last, context, said);
    let kept = Kept::all(found, added).without_undetermined(&base, context);
    let kept = gone_on(start, &base, kept, said);
    let undetermined_only = kept.seen.len();
    // Before what is left is asked: a name that is refuted does not answer for what it stood for.
    let kept =
        kept.without_refuted(&base, context).exchanged_by_kept_back(&base, &|now| start.library(now), context, said);
    stage("asking what is left, and whether a force without a name explains it", &kept.found, said);
    let strict =
        without_slow_noise(&base, &last, context).or_else(|| as_leader_hears(&base, &kept.added, &last, context));
    let rest = unexplained(&kept.found, strict.as_ref().unwrap_or(&base), context, said);
    let replaced = rest.as_ref().is_some_and(|(_, instead)| *instead);
    let kept = if replaced { kept.nothing(&base) } else { kept };
    let rest = rest.map(|(unlisted, _)| unlisted);
    let (kept, rest) = match no_common_machine(&base, &kept.found, &context.floors) {
        Some(unlisted) => (kept.nothing(&base), Some(unlisted)),
        None => {
            let nothing_fits = || if kept.added.is_empty() { unfollowed(&base, &context.floors) } else { None };
            let rest = rest.or_else(nothing_fits);
            (kept, rest)
        }
    };
    let Kept { found, added, mut seen, is_astray, .. } = kept.of_interest(least_share, &base, context);
    // What recordings kept back refute is nothing, unless the base leaves what is no noise.
    let told = if is_misfit(&base.residuals, &context.floors) { seen.len() } else { undetermined_only };
    let rest = rest.or_else(|| undetermined(&added, &seen[..told], least_share));
    let (rest, small) = split_by_interest(rest, least_share);
    seen.extend(small);
    if added.is_empty() && rest.is_none() && seen.is_empty() {
        seen.extend(within_its_row(&base, &last, context));
    }
    seen.iter().for_each(|one| said(&one.sentence));
    Found { base: base.with_intervals(), found: found.with_intervals(), added, seen, is_astray, rest, refit_needed }
}

/// The search on top of what stays, if anything does, when something was taken out again: what comes after a wrong effect was sought
/// beside it.
fn gone_on(start: &Start, base: &FittedModel, kept: Kept, said: &mut dyn FnMut(&str)) -> Kept {
    let context = &start.context;
    if kept.added.is_empty() || kept.seen.is_empty() || is_spent(&kept.found) {
        return kept;
    }
    said("part of what was found is not told from nothing: the search goes on from the rest");
    let is_out = |c: &Candidate| kept.seen.iter().any(|s| (s.effect.as_str(), &s.at) == (c.effect, &c.at));
    let library = |now: &FittedModel| start.library(now).into_iter().filter(|c| !is_out(c)).collect::<Vec<_>>();
    let (found, added) = (kept.found.clone(), kept.added.clone());
    let stands = Selection { base: base.clone(), found, added, last: Vec::new(), cut_short: false };
    let Selection { found, added, last, .. } = forward_on(stands, library, context, &mut *said);
    if added.len() <= kept.added.len() {
        return kept;
    }
    let (found, added) = settled_selection(found, added, &last, context, said);
    let more = Kept::all(found, added).without_undetermined(base, context);
    let is_astray = kept.is_astray || more.is_astray;
    let mut all = more.after(kept.seen);
    all.is_astray = is_astray;
    all
}

/// The selection with each effect exchanged for a better one, or left out, and fitted to the last digit with its rivals.
fn settled_selection(
    found: FittedModel,
    mut added: Vec<SelectedEffect>,
    last: &[CandidateFit],
    context: &Context,
    said: &mut dyn FnMut(&str),
) -> (FittedModel, Vec<SelectedEffect>) {
    stage("trying other pairs of effects in the place of those that were found", &found, said);
    let found = exchange_pairs(found, &mut added, last, context, said);
    stage("trying each effect's rivals in its place, and the model without it", &found, said);
    let (found, added) = exchange_and_eliminate(found, added, context);
    stage("last fit of what was found", &found, said);
    let found = settled(restart_along_ridges(found, context), context);
    stage("last fit of the rivals", &found, said);
    converge_rivals(found, added, context)
}

/// Says that a stage begins, and what the diagnosis has cost so far.
fn stage(text: &str, of: &FittedModel, said: &mut dyn FnMut(&str)) {
    said(text);
    said(&format!("   effort {:.0} M", 1e-6 * of.problem.effort.spent() as f64));
}

/// `base` with slow noise taken for mismatch, if it or a trial of the last round has any. A slow mismatch with white noise on
/// top passes for noise of a long memory, and that swallows whatever would explain it (seen: nine times the noise called
/// consistent). A round is judged under the noise that its best trial leaves: of two effects that are missing the one passes for
/// such noise beside the other, and none gains.
pub(super) fn without_slow_noise(base: &FittedModel, last: &[CandidateFit], context: &Context) -> Option<FittedModel> {
    if !leaves_slow_noise(base) && !last.iter().any(|trial| leaves_slow_noise(&trial.hypothesis)) {
        return None;
    }
    slow_noise_as_misfit(base, context)
}

/// `of` with slow noise taken for mismatch.
pub(super) fn slow_noise_as_misfit(of: &FittedModel, context: &Context) -> Option<FittedModel> {
    let problem = Problem { longest_memory: LONGEST_MEMORY, ..of.problem.clone() };
    FittedModel::at(problem, of.point.clone(), of.information.clone(), &context.floors)
}

/// `base` with the noise that the best candidate left, where none was believed though that one gained more than chance: what
/// it took away passed for coloured noise (a shaken base for a ringing link without damping).
fn as_leader_hears(
    base: &FittedModel,
    added: &[SelectedEffect],
    last: &[CandidateFit],
    context: &Context,
) -> Option<FittedModel> {
    let heard = |t: &&CandidateFit| t.gain > detection_threshold(context, t.candidate.keys.len());
    let leader = last.first().filter(heard).filter(|_| added.is_empty())?;
    Some(FittedModel { noise: leader.hypothesis.noise.clone(), ..base.clone() })
}

/// The last fit of the answer, to the last digit that counts: under the noise that it leaves, or by squares where that is
/// misfit, then out of a false minimum too: of the numbers by steps from afar, of the windows' states by a fit from the first look on.
fn settled(found: FittedModel, context: &Context) -> FittedModel {
    let misfit = is_misfit(&found.residuals, &context.floors);
    let noise = if misfit { squares(&found.residuals, &context.floors) } else { found.noise.clone() };
    let total = |h: &FittedModel| -> f64 { h.blocks(&noise).iter().sum() };
    let polished = |h: &FittedModel| h.polished(&noise, &context.floors, Limits { iterations: 25, tolerance: 1e-7 });
    let finer = polished(&found).filter(|f| total(f) >= total(&found)).unwrap_or(found);
    if !misfit {
        return finer;
    }
    let escaped = escape_local_minimum(&finer, &context.floors);
    let afresh = if is_spent(&finer) { None } else { anew(&finer.problem, &finer.rig, &context.floors) };
    let afresh = afresh.map(|fit| polished(&fit).filter(|f| total(f) >= total(&fit)).unwrap_or(fit));
    let best = escaped.into_iter().chain(afresh).max_by(|a, b| total(a).total_cmp(&total(b)));
    best.filter(|best| total(best) > total(&finer)).unwrap_or(finer)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::verdict::Seen;
    use crate::diagnose::judge::worked::{Shown, shown};
    use crate::identify::rollout::Pooled;
    use std::collections::BTreeMap;

    #[test]
    fn a_search_goes_on_where_something_was_taken_out_and_not_to_that_again() {
        let drag = "[[effect]]\neffect = \"quadratic_drag\"\nat = \"q1\"\nquadratic = ";
        let Shown { context, problem } =
            shown(&format!("{drag}0.004\n[[effect]]\neffect = \"torque_offset\"\nat = \"q1\"\ntorque = 0.05\n"));
        let base = problem.fitted("", 20);
        let found = problem.fitted(&format!("{drag}{{ value = 0.001, min = 0.0, max = 0.1 }}\n"), 20);
        let pooled = Pooled::of(&base.rig, base.problem.recordings.iter());
        let start = Start { pooled, dropped: 0, given: None, base: base.clone(), own: None, context };
        let stays = || Kept::all(found.clone(), vec![problem.added("quadratic_drag", "q1", 100.0, Vec::new())]);
        let taken_out = |effect: &str| Seen {
            effect: effect.into(),
            at: "q1".into(),
            share: 0.5,
            parameters: BTreeMap::new(),
            sentence: String::new(),
        };
        let names = |kept: Kept| kept.added.iter().map(|a| a.candidate.effect).collect::<Vec<_>>();
        let after = |effect: &str| names(gone_on(&start, &base, stays().after(vec![taken_out(effect)]), &mut |_| {}));
        assert_eq!(after("parallel_spring"), ["quadratic_drag", "torque_offset"]);
        assert!(!after("torque_offset").contains(&"torque_offset"));
        assert_eq!(names(gone_on(&start, &base, stays(), &mut |_| {})), ["quadratic_drag"], "nothing was taken out");
    }
}
