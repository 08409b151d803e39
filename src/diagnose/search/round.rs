//! One round of the attribution: every candidate on top of what is known, screened, then the best fitted in full.
//!
//! Screened by one Gauss-Newton promise per start; the best and their lookalikes are fitted jointly with all base
//! parameters from the base solution, and ranked under the noise that the best of them leaves.
//! RT: no.

use crate::diagnose::judge::continuity::has_continuous_states;
use crate::diagnose::judge::criterion::{self, Context, detection_threshold};
use crate::diagnose::library::candidate_fit::{CandidateFit, with_effect};
use crate::diagnose::library::candidates::{Candidate, look_alike};
use crate::diagnose::robustness::state_continuity::has_more_states;
use crate::diagnose::search::budget::{MOST_EFFORT, allowance, within};
use crate::diagnose::search::screening::{Ranked, screened};
use crate::diagnose::search::subsample::{Subsample, subsampled};
use crate::identify::fit::Limits;
use crate::identify::fitted_model::FittedModel;
use crate::identify::initial_states::refit_states;
use crate::identify::likelihood::{blocks, white};
use crate::identify::noise::Colour;
use crate::model::rig::Rig;
use rayon::prelude::*;

/// Candidates that are fitted in full per round.
pub(super) const FITTED: usize = 5;

/// Lookalikes of the best that are fitted besides.
const LOOKALIKES: usize = 9;

/// Of the best, how many are polished under the noise that the best one leaves.
const POLISHED: usize = 4;

/// How far candidates are fitted before the leaders go on, and again then.
const COARSE_FIT: Limits = Limits { iterations: 4, tolerance: 3e-4 };

/// Most candidates that go on.
const LEADING: usize = 5;

/// A candidate with less than this part of the leader's gain does not go on.
const BEHIND: f64 = 0.2;

/// Splits the starts into those worth a full fit whatever it costs, and the others: the best, and every lookalike of the
/// best three at the same place or any. What has inner states promises much wherever windows are many and may be no
/// effect ([`has_continuous_states`]): the best of the others are fitted as well.
fn split<'c>(ranked: Vec<Ranked<'c>>) -> (Vec<Ranked<'c>>, Vec<Ranked<'c>>) {
    let leaders: Vec<&Candidate> = ranked.iter().take(3).map(|r| r.0).collect();
    let wanted =
        |(i, (c, ..)): &(usize, &Ranked<'_>)| *i < FITTED || leaders.iter().any(|l| look_alike(l.effect, c.effect));
    let mut out: Vec<usize> =
        ranked.iter().enumerate().filter(wanted).take(FITTED + LOOKALIKES).map(|(i, _)| i).collect();
    let plain = ranked.iter().enumerate().filter(|(_, (c, ..))| !c.has_inner_states()).take(FITTED);
    out.extend(plain.map(|(i, _)| i));
    // A foot that lands a little earlier is an edge: one step says nothing of what changes the ground.
    let mut grounds: Vec<&str> = Vec::new();
    for (i, (c, ..)) in ranked.iter().enumerate().filter(|(_, (c, ..))| c.at == "ground") {
        if !grounds.contains(&c.effect) {
            grounds.push(c.effect);
            out.push(i);
        }
    }
    let (first, rest): (Vec<_>, Vec<_>) = ranked.into_iter().enumerate().partition(|(i, _)| out.contains(i));
    let bare = |all: Vec<(usize, Ranked<'c>)>| all.into_iter().map(|(_, r)| r).collect();
    (bare(first), bare(rest))
}

/// Part of the leader's gain from which what changes the ground is fitted from its other starts too.
const GROUND_RIVAL: f64 = 0.3;

/// Starts that are fitted at a time while the round may go on.
const BATCH: usize = 8;
/// Part of what is left of [`MOST_EFFORT`] that a round may spend on fits that one step does not recommend. One step says
/// little where the law is bent: a bristle whose round promised a sixth of the leader's gain brought five times as much.
const CURIOSITY: u64 = 8;
/// Once an effect is found, the best promise that asks for that, in parts of what is worth it: little may be left.
const CURIOUS: f64 = 2.0;

/// What one step promises on top of a base.
struct Look<'c> {
    thin: Option<Subsample>,
    ranked: Vec<Ranked<'c>>,
    /// The best promise, on all samples.
    most: f64,
    /// Samples that were looked at.
    samples: usize,
    /// Starts that were too costly to look at.
    costly: usize,
}

fn look<'c>(base: &FittedModel, library: &'c [Candidate], noise: &[Colour], context: &Context) -> Look<'c> {
    let thin = subsampled(base, library, context);
    let thinner = thin.as_ref().map(|t| t.thinner(library));
    let (fewer, samples) = thinner.as_ref().map_or((base, context.samples), |t| (&t.hypothesis, t.context.samples));
    let (ranked, costly) = screened(fewer, library, noise);
    // All samples would promise as many times more as they are more.
    let most = ranked.first().map_or(0.0, |best| best.2 * context.samples as f64 / samples.max(1) as f64);
    Look { thin, ranked, most, samples, costly }
}

/// True if no candidate promises enough on top of `base` for a round: a look costs a tenth of one.
#[must_use]
pub fn promises_little(base: &FittedModel, library: &[Candidate], context: &Context) -> bool {
    criterion::promises_little(look(base, library, &white(&base.residuals, &context.floors), context).most, context)
}

/// A candidate on top of the base, fitted from where another fit stands.
pub struct Start {
    /// What is added.
    pub candidate: Candidate,
    /// The fit that it starts from, on the windows of the base.
    pub from: FittedModel,
    /// The base's rig with the candidate last.
    pub rig: Rig,
}

/// What a round asks.
#[derive(Clone, Copy)]
pub struct Asked<'c> {
    /// Candidates of which the most promising are fitted.
    pub library: &'c [Candidate],
    /// Those that are fitted whatever one step promises.
    pub near: &'c [Start],
}

/// All candidates of one round on top of `base`, best first by what they gain. `fitted`: the fit whose misfit is to be
/// explained, `base` itself or a better one of the same rig. `earlier`: trials of a round from a worse fit of that rig, which
/// stand where this round may not come to.
#[must_use]
pub fn round(
    base: &FittedModel,
    (fitted, earlier): (&FittedModel, Vec<CandidateFit>),
    Asked { library, near }: Asked<'_>,
    context: &Context,
    mut said: impl FnMut(&str),
) -> Vec<CandidateFit> {
    let noise = white(&fitted.residuals, &context.floors);
    let Look { thin, ranked, most, samples, costly } = look(base, library, &noise, context);
    if costly > 0 {
        said(&format!("   {costly} starts not tried: too costly to simulate"));
    }
    let (few, rule) = thin.as_ref().map_or((base, context), |t| (&t.hypothesis, &t.context));
    if near.is_empty() && earlier.is_empty() && criterion::promises_little(most, context) {
        said(&format!("   no candidate promises more than {most:.1}: too little"));
        return Vec::new();
    }
    said(&format!("   screened on {samples} samples"));
    for (c, start, gain) in ranked.iter().take(8) {
        said(&format!("   {:20} {:12} promises {gain:9.1} from {start:.4?}", c.effect, c.at));
    }
    let is_curious = base.rig.effects.len() == context.given || most > CURIOUS * detection_threshold(context, 1);
    let fits = near_fits(base, thin.as_ref(), near, (&noise, COARSE_FIT), rule);
    let trials = coarse_fits(base, (few, rule), (fits, ranked), &noise, is_curious);
    let mut trials = best_of_each(trials);
    trials = gone_on(base, thin.as_ref(), (trials, near), &noise, context);
    said(&format!("   fitted, effort {:.1} M", 1e-6 * base.problem.effort.spent() as f64));
    let all = trials.into_par_iter();
    // What gains nothing and has states of its own is not worth the look: a spring stiff as a rod is costly to follow.
    let kept = |trial: &CandidateFit| {
        let hypothesis = &trial.hypothesis;
        !has_more_states(base, hypothesis)
            || trial.gain > 0.0 && has_continuous_states(fitted, hypothesis, &context.floors)
    };
    trials = all.filter(kept).collect();
    trials.extend(earlier);
    rank(base, &mut trials, context);
    trials = best_of_each(trials);
    polish(base, &mut trials, context);
    trials
}

/// The starts that are fitted whatever they promise, on the windows of `thin`.
fn near_fits(
    base: &FittedModel,
    thin: Option<&Subsample>,
    near: &[Start],
    how: (&[Colour], Limits),
    rule: &Context,
) -> Vec<CandidateFit> {
    let one = |Start { candidate, from, rig }: &Start| {
        let fewer = thin.map(|thin| thin.windows_of(from));
        let (problem, point) = fewer.as_ref().unwrap_or(from).extended(rig.clone());
        let hypothesis = within(allowance(base), base, problem, point, how, rule)?;
        Some(CandidateFit { candidate: candidate.clone(), hypothesis, gain: 0.0 })
    };
    near.par_iter().filter_map(one).collect()
}

/// The best starts fitted on `few` windows beside what is fitted, and while the round may go on the others; ranked by `rule`.
fn coarse_fits(
    base: &FittedModel,
    (few, rule): (&FittedModel, &Context),
    (fits, ranked): (Vec<CandidateFit>, Vec<Ranked<'_>>),
    noise: &[Colour],
    is_curious: bool,
) -> Vec<CandidateFit> {
    let allowed = allowance(few);
    let fitted = |(candidate, start, _): &Ranked<'_>| {
        let (problem, point) = few.extended(with_effect(&few.rig, candidate, start));
        let hypothesis = within(allowed, base, problem, point, (noise, COARSE_FIT), rule)?;
        Some(CandidateFit { candidate: (*candidate).clone(), hypothesis, gain: 0.0 })
    };
    let effort = || base.problem.effort.spent();
    let share = if is_curious { MOST_EFFORT.saturating_sub(effort()) / CURIOSITY } else { 0 };
    let enough = effort() + share;
    let (first, rest) = split(ranked);
    let mut trials = fits;
    trials.par_extend(first.par_iter().filter_map(fitted));
    let mut left = &rest[..];
    while !left.is_empty() && effort() < enough {
        let (batch, others) = left.split_at(left.len().min(BATCH));
        trials.par_extend(batch.par_iter().filter_map(fitted));
        left = others;
    }
    rank(few, &mut trials, rule);
    // Between a foot that lands earlier or later are edges that no step crosses: one that is close may be closer from elsewhere.
    let most = trials.first().map_or(0.0, |t| t.gain);
    let is_close = |c: &Candidate| trials.iter().any(|t| t.candidate.is_same_as(c) && t.gain > GROUND_RIVAL * most);
    let again: Vec<&Ranked<'_>> = left.iter().filter(|(c, ..)| c.at == "ground" && is_close(c)).collect();
    if !again.is_empty() {
        trials.par_extend(again.into_par_iter().filter_map(fitted));
        rank(few, &mut trials, rule);
    }
    trials
}

/// `trial` fitted on from where it stands, under another noise.
fn further(
    most: u64,
    base: &FittedModel,
    trial: &FittedModel,
    how: (&[Colour], Limits),
    context: &Context,
) -> Option<FittedModel> {
    within(most, base, trial.problem.clone(), trial.point.clone(), how, context)
}

/// The leaders fitted on, to all windows; who is far behind after a few steps does not catch up. Where the first fits
/// were to fewer windows only the leaders stay: the others are not comparable.
fn gone_on(
    base: &FittedModel,
    thin: Option<&Subsample>,
    (trials, near): (Vec<CandidateFit>, &[Start]),
    noise: &[Colour],
    context: &Context,
) -> Vec<CandidateFit> {
    let (mut trials, leading) = leaders_first(base, trials, near);
    let most = allowance(base);
    let Some(thin) = thin else {
        trials[..leading].par_iter_mut().for_each(|trial| {
            let finer = further(most, base, &trial.hypothesis, (noise, COARSE_FIT), context);
            if let Some(finer) = finer.filter(|f| f.likelihood > trial.hypothesis.likelihood) {
                trial.hypothesis = finer;
            }
        });
        return trials;
    };
    trials.truncate(leading);
    let wide = |trial: CandidateFit| {
        let (problem, point) = thin.widened(base, &trial.hypothesis);
        let hypothesis = within(most, base, problem, point, (noise, COARSE_FIT), context)?;
        Some(CandidateFit { hypothesis, ..trial })
    };
    trials.into_par_iter().filter_map(wide).collect()
}

/// Those that go on first, best first, and how many. What has inner states may turn out to be no effect ([`has_continuous_states`]):
/// it takes no place from those that have none, nor is it their measure. Those that are `near` go on in any case.
fn leaders_first(base: &FittedModel, trials: Vec<CandidateFit>, near: &[Start]) -> (Vec<CandidateFit>, usize) {
    let has_inner = |t: &CandidateFit| has_more_states(base, &t.hypothesis);
    let leads = |all: Vec<CandidateFit>| -> (Vec<CandidateFit>, Vec<CandidateFit>) {
        let most = all.first().map_or(0.0, |t| t.gain);
        let count = all.iter().take(LEADING).filter(|t| t.gain > BEHIND * most).count();
        let mut all = all;
        let rest = all.split_off(count);
        (all, rest)
    };
    let (inner, plain): (Vec<CandidateFit>, Vec<CandidateFit>) = trials.into_iter().partition(has_inner);
    let ((first, rest), (others, behind)) = (leads(plain), leads(inner));
    let is_near = |t: &CandidateFit| near.iter().any(|start| start.candidate.is_same_as(&t.candidate));
    let (wanted, rest): (Vec<CandidateFit>, Vec<CandidateFit>) = rest.into_iter().chain(behind).partition(is_near);
    let count = first.len() + others.len() + wanted.len();
    ([first, others, wanted, rest].into_iter().flatten().collect(), count)
}

/// Orders trials by their likelihood under the noise that the best of them leaves, and notes what each gains there.
///
/// The noise of a wrong model swallows the mismatch, so each model judged under its own noise would look much the same.
/// Under the noise of the right one the others show what they leave; with nothing to find, that noise is as coloured
/// as the data and nobody gains.
fn rank(base: &FittedModel, trials: &mut [CandidateFit], context: &Context) {
    let plain = |t: &CandidateFit| -> f64 {
        blocks(&t.hypothesis.residuals, &white(&t.hypothesis.residuals, &context.floors)).iter().sum()
    };
    let Some(noise) = trials
        .iter()
        .map(|t| (plain(t), t))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, t)| t.hypothesis.noise.clone())
    else {
        return;
    };
    let before: f64 = base.blocks(&noise).iter().sum();
    for trial in &mut *trials {
        trial.gain = trial.hypothesis.blocks(&noise).iter().sum::<f64>() - before;
    }
    trials.sort_by(|a, b| b.gain.total_cmp(&a.gain));
}

/// The trials of two rounds from different places, as gains over `base`: of each candidate the better, best first.
#[must_use]
pub fn merged(
    base: &FittedModel,
    first: Vec<CandidateFit>,
    second: Vec<CandidateFit>,
    context: &Context,
) -> Vec<CandidateFit> {
    let mut all = [first, second].concat();
    rank(base, &mut all, context);
    let mut out = best_of_each(all);
    polish(base, &mut out, context);
    out
}

/// Of each candidate the first.
fn best_of_each(all: Vec<CandidateFit>) -> Vec<CandidateFit> {
    let mut out: Vec<CandidateFit> = Vec::with_capacity(all.len());
    for trial in all {
        if !out.iter().any(|t| t.candidate.is_same_as(&trial.candidate)) {
            out.push(trial);
        }
    }
    out
}

/// Fits the leaders again under the noise that the best of them leaves, twice, as the leader may change.
pub fn polish(base: &FittedModel, trials: &mut [CandidateFit], context: &Context) {
    let limits = Limits { iterations: 5, tolerance: 1e-4 };
    let most = allowance(base);
    for _ in 0..2 {
        rank(base, trials, context);
        let Some(noise) = trials.first().map(|t| t.hypothesis.noise.clone()) else { return };
        let count = trials.iter().take(POLISHED).filter(|t| t.gain > 0.5 * trials[0].gain).count();
        trials[..count].par_iter_mut().for_each(|trial| {
            let total = |h: &FittedModel| -> f64 { h.blocks(&noise).iter().sum() };
            let finer = further(most, base, &trial.hypothesis, (&noise, limits), context);
            if let Some(finer) = finer.filter(|f| total(f) >= total(&trial.hypothesis)) {
                trial.hypothesis = finer;
            }
        });
    }
    if trials.first().is_none_or(|leader| leader.gain < 0.5 * detection_threshold(context, 1)) {
        return;
    }
    let count = trials.iter().take(POLISHED).filter(|t| t.gain > 0.5 * trials[0].gain).count();
    trials[..count].par_iter_mut().for_each(|trial| {
        if let Some(better) = refit_states(&trial.hypothesis, &context.floors) {
            trial.hypothesis = better;
        }
    });
    rank(base, trials, context);
}

/// Says how the candidates of a round did.
pub(super) fn tell(trials: &[CandidateFit], context: &Context, said: &mut dyn FnMut(&str)) {
    for t in trials.iter().take(6) {
        let effect = t.hypothesis.rig.effects.last();
        let values: Vec<f64> = effect.map(|e| e.values.iter().map(|v| v.value).collect()).unwrap_or_default();
        let (effect, at) = (t.candidate.effect, &t.candidate.at);
        said(&format!("   {effect:20} {at:12} gain {:9.1} of {} {values:.4?}", t.gain, context.samples));
    }
}
