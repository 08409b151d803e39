//! Attribution: which effects of the library, alone and together, explain what the base cannot.
//!
//! Every candidate is nested in the simulator and fitted jointly with all base parameters from the base solution.
//! Forward: screen all starts by one Gauss-Newton promise each, fit the best and their lookalikes, keep the winner if
//! it is worth it. Then swap and backward. Members that the data cannot tell from the winner join its set.
//! RT: no.

use crate::diagnose::candidates::{Candidate, look_alike};
use crate::diagnose::folds::kept_when_left_out;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::likelihood::{Difference, blocks, difference, is_misfit, white};
use crate::diagnose::screen::{Column, Screen};
use crate::diagnose::unlisted::{PATCHES, is_patch};
use crate::identify::fit::{FreeRuns, Limits, Series};
use crate::identify::noise::Colour;
use crate::model::effect::EffectKind;
use crate::model::rig::{Effect, Rig, Scope, Sensor, Side, Slot, Value};
use rayon::prelude::*;

/// Candidates that are fitted in full per round.
const FITTED: usize = 5;

/// Of those, how many are polished under the noise that the best one leaves.
const POLISHED: usize = 4;

/// How far candidates are fitted before the leaders go on, and again then.
const COARSE: Limits = Limits { iterations: 4, tolerance: 3e-4 };

/// Most candidates that go on.
const LEADING: usize = 5;

/// A candidate with less than this part of the leader's gain does not go on.
const BEHIND: f64 = 0.2;

/// Most effects that are added.
pub const MOST: usize = 4;

/// What every round needs.
#[derive(Clone, Debug)]
pub struct Context {
    /// Smallest standard deviation of each channel's residual; infinite: the channel has no weight.
    pub floors: Vec<f64>,
    /// Samples that carry weight.
    pub samples: usize,
    /// Seed of the bootstraps.
    pub seed: u64,
}

/// A candidate, fitted.
#[derive(Clone, Debug)]
pub struct Trial {
    /// What was added.
    pub candidate: Candidate,
    /// Where that led.
    pub hypothesis: Hypothesis,
    /// Gain of twice the log-likelihood over what it was added to, under the noise that the best of its round leaves.
    pub gain: f64,
}

/// An effect that was added, with the other candidates of its round.
#[derive(Clone, Debug)]
pub struct Added {
    /// What was added.
    pub candidate: Candidate,
    /// The others that were fitted in its round, best first.
    pub others: Vec<Trial>,
    /// Gain over the model before it.
    pub gain: f64,
    /// Part of the misfit energy that it removed.
    pub removed: f64,
}

/// What is worth calling a mismatch.
///
/// Twice the log-likelihood must rise by more than a search over a library of some 200 starts brings on healthy data
/// (below 30 in trials with exact noise), with a margin for rounding and solvers of other simulators (up to 2.5 % of
/// the number of samples on healthy cases of other simulators), and more for each number that it adds.
#[must_use]
pub fn worth(context: &Context, numbers: usize) -> f64 {
    let samples = context.samples as f64;
    (0.02 * samples).max(60.0) + numbers as f64 * libm::log(samples.max(2.0))
}

/// `rig` with `candidate` added at `values`.
#[must_use]
pub fn with_effect(rig: &Rig, candidate: &Candidate, values: &[f64]) -> Rig {
    let mut out = rig.clone();
    let Some(kind) = EffectKind::from_id(candidate.effect) else { return out };
    let value =
        |name: &str| {
            let found = candidate.keys.iter().zip(values).find(|(k, _)| k.name == name);
            found.map_or(Value::known(0.0), |(k, v)| {
                if k.max > k.min { Value::free(*v, k.min, k.max) } else { Value::known(*v) }
            })
        };
    let values = kind.keys().iter().map(|k| value(k.name)).collect();
    let mut effect = Effect::new(kind, &candidate.at, values);
    effect.recordings = candidate.only.iter().cloned().collect();
    effect.side = candidate.side;
    out.effects.push(effect);
    for sensor in out.sensors.iter_mut().filter(|s| candidate.motor_sensor.as_ref() == Some(&s.column)) {
        sensor.side = Side::Motor;
    }
    out
}

/// A candidate, its best start and the fall of twice the log-likelihood that it promises.
type Ranked<'c> = (&'c Candidate, Vec<f64>, f64);

/// Gives each candidate its best start by the gain that one step promises; best candidates first.
///
/// Base parameters and initial states are followed along the base solution's own tangent: a start then costs one run
/// with its few own directions instead of a full linearisation.
fn screened<'c>(base: &Hypothesis, library: &'c [Candidate], noise: &[Colour]) -> Vec<Ranked<'c>> {
    let Some(screen) = Screen::new(&base.problem, &base.point, noise) else { return Vec::new() };
    let plain: Option<Vec<Vec<Series>>> = (0..base.problem.windows())
        .into_par_iter()
        .map(|w| base.problem.run(w, &base.point.parameters, &base.point.states[w], false))
        .collect();
    let Some(plain) = plain else { return Vec::new() };
    let starts: Vec<(&Candidate, &Vec<f64>)> =
        library.iter().flat_map(|c| c.starts.iter().map(move |s| (c, s))).collect();
    let gains: Vec<f64> = starts
        .par_iter()
        .map(|(candidate, start)| promised(base, &screen, &plain, candidate, start).unwrap_or(f64::NEG_INFINITY))
        .collect();
    let mut best: Vec<Ranked<'_>> = Vec::new();
    for ((candidate, start), gain) in starts.into_iter().zip(gains) {
        match best.iter_mut().find(|(c, ..)| std::ptr::eq(*c, candidate)) {
            Some(entry) if gain > entry.2 => (entry.1, entry.2) = (start.clone(), gain),
            Some(_) => {}
            None => best.push((candidate, start.clone(), gain)),
        }
    }
    best.retain(|b| b.2.is_finite());
    best.sort_by(|a, b| b.2.total_cmp(&a.2));
    best
}

/// Gain that `candidate` promises from `start`: the move that the start itself makes, and one step from there.
fn promised(
    base: &Hypothesis,
    screen: &Screen,
    plain: &[Vec<Series>],
    candidate: &Candidate,
    start: &[f64],
) -> Option<f64> {
    let (problem, point) = base.extended(with_effect(&base.rig, candidate, start));
    let e = base.rig.effects.len();
    let own = |slot: Slot| matches!(slot, Slot::Effect(Scope::Rig, i, _) if i == e);
    // Where inner states differ, those of the base are directions once more, which the projection allows for.
    let held = |w: usize| {
        let (new, old) = (point.states[w].len(), base.point.states[w].len());
        if new == old { new } else { 2 * problem.degrees() }
    };
    let runs: Vec<Vec<Series>> =
        (0..problem.windows()).map(|w| problem.run_along(w, &point, own, held(w))).collect::<Option<_>>()?;
    let of_problem = problem.bounds();
    let mine = problem.theta.entries.iter().enumerate().filter(|(_, entry)| own(entry.slot));
    let mut bounds: Vec<(f64, f64)> =
        mine.map(|(i, _)| (of_problem[i].min - point.parameters[i], of_problem[i].max - point.parameters[i])).collect();
    let mut columns: Vec<Column> = vec![moved(&runs, plain)];
    columns.extend((0..bounds.len()).map(|j| slopes(&runs, j)));
    columns.extend(inner_states(&runs, bounds.len()));
    bounds.resize(columns.len() - 1, (f64::NEG_INFINITY, f64::INFINITY));
    Some(screen.promise(&columns, &bounds))
}

/// One column per inner state and window: every window has its own.
fn inner_states(runs: &[Vec<Series>], shared: usize) -> Vec<Column> {
    let mut out = Vec::new();
    for (w, run) in runs.iter().enumerate() {
        for j in shared..run.first().map_or(0, |s| s.slopes.len()) {
            let mut column: Column = vec![Vec::new(); runs.len()];
            column[w] = run.iter().map(|s| s.slopes[j].clone()).collect();
            out.push(column);
        }
    }
    out
}

/// By how much the start moves the simulation.
fn moved(runs: &[Vec<Series>], plain: &[Vec<Series>]) -> Column {
    let one = |(a, b): (&Series, &Series)| a.residual.iter().zip(&b.residual).map(|(x, y)| x - y).collect();
    runs.iter().zip(plain).map(|(a, b)| a.iter().zip(b).map(one).collect()).collect()
}

fn slopes(runs: &[Vec<Series>], j: usize) -> Column {
    runs.iter().map(|window| window.iter().map(|s| s.slopes[j].clone()).collect()).collect()
}

/// The candidates worth a full fit: the best, and every lookalike of the best three at the same place or any.
fn chosen<'c>(ranked: &[Ranked<'c>]) -> Vec<(&'c Candidate, Vec<f64>)> {
    let leaders: Vec<&Candidate> = ranked.iter().take(3).map(|r| r.0).collect();
    let wanted =
        |(i, (c, ..)): &(usize, &Ranked<'_>)| *i < FITTED || leaders.iter().any(|l| look_alike(l.effect, c.effect));
    ranked.iter().enumerate().filter(wanted).take(FITTED + 5).map(|(_, (c, s, _))| (*c, s.clone())).collect()
}

/// All candidates of one round on top of `base`, best first by what they gain.
#[must_use]
pub fn round(base: &Hypothesis, library: &[Candidate], context: &Context, mut said: impl FnMut(&str)) -> Vec<Trial> {
    let noise = white(&base.residuals, &context.floors);
    let ranked = screened(base, library, &noise);
    // Nothing promises two fifths of what would count: a healthy machine is not worth a dozen fits.
    if ranked.first().is_none_or(|best| best.2 < 0.4 * worth(context, 1)) {
        return Vec::new();
    }
    said("screened");
    for (c, start, gain) in ranked.iter().take(8) {
        said(&format!("   {:20} {:12} promises {gain:9.1} from {start:.4?}", c.effect, c.at));
    }
    let fitted = |(candidate, start): (&Candidate, Vec<f64>)| {
        let (problem, point) = base.extended(with_effect(&base.rig, candidate, &start));
        let hypothesis = Hypothesis::fitted(problem, point, &noise, &context.floors, COARSE)?;
        Some(Trial { candidate: candidate.clone(), hypothesis, gain: 0.0 })
    };
    let mut trials: Vec<Trial> = chosen(&ranked).into_par_iter().filter_map(fitted).collect();
    rank(base, &mut trials, context);
    // The leaders go on; who is far behind after a few steps does not catch up.
    let leading = trials.iter().take(LEADING).filter(|t| t.gain > BEHIND * trials[0].gain).count();
    trials[..leading].par_iter_mut().for_each(|trial| {
        let finer = trial.hypothesis.polished(&noise, &context.floors, COARSE);
        if let Some(finer) = finer.filter(|f| f.likelihood > trial.hypothesis.likelihood) {
            trial.hypothesis = finer;
        }
    });
    said("fitted");
    polish(base, &mut trials, context);
    trials
}

/// Orders trials by their likelihood under the noise that the best of them leaves, and notes what each gains there.
///
/// The noise of a wrong model swallows the mismatch, so each model judged under its own noise would look much the same.
/// Under the noise of the right one the others show what they leave; with nothing to find, that noise is as coloured
/// as the data and nobody gains.
fn rank(base: &Hypothesis, trials: &mut [Trial], context: &Context) {
    let plain = |t: &Trial| -> f64 {
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

/// Fits the leaders again under the noise that the best of them leaves, twice, as the leader may change.
pub fn polish(base: &Hypothesis, trials: &mut [Trial], context: &Context) {
    let limits = Limits { iterations: 5, tolerance: 1e-4 };
    for _ in 0..2 {
        rank(base, trials, context);
        let Some(noise) = trials.first().map(|t| t.hypothesis.noise.clone()) else { return };
        let count = trials.iter().take(POLISHED).filter(|t| t.gain > 0.5 * trials[0].gain).count();
        trials[..count].par_iter_mut().for_each(|trial| {
            let total = |h: &Hypothesis| -> f64 { h.blocks(&noise).iter().sum() };
            let finer = trial.hypothesis.polished(&noise, &context.floors, limits);
            if let Some(finer) = finer.filter(|f| total(f) >= total(&trial.hypothesis)) {
                trial.hypothesis = finer;
            }
        });
    }
    rank(base, trials, context);
}

/// How much better `a` is than `b` under the noise that `a` leaves.
#[must_use]
pub fn compare(a: &Hypothesis, b: &Hypothesis, context: &Context) -> Difference {
    difference(&a.blocks(&a.noise), &b.blocks(&a.noise), context.seed)
}

/// Part of the misfit energy above the noise that `after` removes.
#[must_use]
pub fn removed(before: &Hypothesis, after: &Hypothesis, context: &Context) -> f64 {
    let energy = |h: &Hypothesis| -> f64 {
        let runs = h.residuals.iter().zip(&after.noise).zip(&context.floors).filter(|(_, f)| f.is_finite());
        runs.map(|((r, c), _)| r.iter().flatten().map(|x| (x / c.sigma).powi(2)).sum::<f64>()).sum()
    };
    let (had, has) = (energy(before), energy(after));
    if had > 0.0 { (1.0 - has / had).clamp(0.0, 1.0) } else { 0.0 }
}

/// Least gain of a further effect, in parts of what those before it gained.
const SHARE: f64 = 0.04;

/// The same where smooth misfit stays: no form fits hardware to the noise. Tuned on a pendulum with gears, where a ripple
/// (.14) and a play (.06) came after the Coulomb friction that explains it.
const SHARE_OF_MISFIT: f64 = 0.15;

/// True if `trial` explains enough to be believed.
#[must_use]
pub fn is_worth(base: &Hypothesis, trial: &Trial, explained_before: f64, context: &Context) -> bool {
    let sure = compare(&trial.hypothesis, base, context);
    // A second effect must not live off the first one's imperfect form.
    let misfit = is_misfit(&trial.hypothesis.residuals, &context.floors);
    let share = trial.gain >= if misfit { SHARE_OF_MISFIT } else { SHARE } * explained_before;
    // Against smooth misfit chance has no measure: a tenth of the squares is the least that a user would notice.
    let noticed = !misfit || trial.gain > 0.1 * context.samples as f64;
    let admitted = noticed && !is_piece(base, trial, context);
    trial.gain > worth(context, trial.candidate.keys.len()) && sure.low > 0.0 && share && admitted && !at_zero(trial)
}

/// True for a push, a jump or a few waves of a ripple where more than noise stays: they fit a piece of any smooth misfit.
fn is_piece(base: &Hypothesis, trial: &Trial, context: &Context) -> bool {
    let misfit = is_misfit(&trial.hypothesis.residuals, &context.floors);
    periods(base, trial) < if misfit { PERIODS } else { 0.5 * PERIODS } || misfit && is_patched(base, &trial.candidate)
}

/// Fewer periods than this within the travel are no ripple that anyone could tell from another law of position.
const PERIODS: f64 = 3.0;

/// Periods of a trial's ripple within the travel; infinite for other effects.
fn periods(base: &Hypothesis, trial: &Trial) -> f64 {
    let ripple = trial.hypothesis.rig.effects.last().filter(|e| e.kind == EffectKind::TorqueRipple);
    let Some(order) = ripple.and_then(|e| e.get("order")) else { return f64::INFINITY };
    let joint = base.rig.mechanism.coordinate_index(&trial.candidate.at);
    let travel = |(c, sensor): (usize, &Sensor)| {
        let all = base.problem.recordings.iter().flat_map(|r| &r.measured[c]).filter(|x| x.is_finite());
        let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
        if Some(sensor.joint) == joint && !sensor.is_rate { high - low } else { 0.0 }
    };
    let range = base.rig.sensors.iter().enumerate().map(travel).fold(0.0, f64::max);
    // No sensor on this coordinate alone: nothing is known of its travel.
    if range > 0.0 { order.value * range / (2.0 * std::f64::consts::PI) } else { f64::INFINITY }
}

/// Swap and backward: every effect of `found` is exchanged for its close rivals in the company of the others, and
/// left out; what is better stays. `first` is the index of the first added effect in the rig.
#[must_use]
pub fn contested(
    found: Hypothesis,
    mut added: Vec<Added>,
    first: usize,
    context: &Context,
) -> (Hypothesis, Vec<Added>) {
    let mut found = found;
    if added.len() < 2 {
        return (found, added);
    }
    let mut i = 0;
    while i < added.len() {
        let Some(without) = left_out(&found, first + i, context) else { break };
        let kept = compare(&found, &without, context);
        if kept.total < worth(context, added[i].candidate.keys.len()) || kept.low <= 0.0 {
            found = without;
            added.remove(i);
            continue;
        }
        added[i].gain = kept.total;
        let rivals = exchanged(&found, &added[i], first + i, context);
        if let Some(better) = rivals.first().filter(|r| is_better(&found, r, &added[i], kept.total, context)) {
            let old = Trial { candidate: added[i].candidate.clone(), hypothesis: found, gain: kept.total };
            (found, added[i].candidate) = (better.hypothesis.clone(), better.candidate.clone());
            added[i].others = [vec![old], rivals[1..].to_vec()].concat();
        } else {
            added[i].others = rivals;
        }
        i += 1;
    }
    (found, added)
}

/// True if `rival` should stand in the place of `added`, whose gain is `kept`.
fn is_better(found: &Hypothesis, rival: &Trial, added: &Added, kept: f64, context: &Context) -> bool {
    let richer = LIMITS_OF.contains(&(added.candidate.effect, rival.candidate.effect));
    let least = if richer { (1.0 - ENOUGH) * kept } else { 0.0 };
    compare(found, &rival.hypothesis, context).total < -least.max(10.0)
}

fn left_out(found: &Hypothesis, e: usize, context: &Context) -> Option<Hypothesis> {
    let mut rig = found.rig.clone();
    rig.effects.remove(e);
    let (problem, point) = found.extended(rig);
    Hypothesis::fitted(problem, point, &found.noise, &context.floors, Limits { iterations: 10, tolerance: 1e-5 })
}

/// The close rivals of effect `e`, fitted in its place; best first, gains relative to leaving it out.
fn exchanged(found: &Hypothesis, added: &Added, e: usize, context: &Context) -> Vec<Trial> {
    let admitted = added.others.iter().filter(|t| !is_piece(found, t, context));
    let close = admitted.filter(|t| t.gain > 0.4 * added.others.first().map_or(0.0, |o| o.gain)).take(4);
    let one = |trial: &Trial| {
        let mut rig = found.rig.clone();
        rig.effects[e] = trial.hypothesis.rig.effects.last()?.clone();
        if trial.candidate.motor_sensor.is_some() {
            rig.sensors.clone_from(&trial.hypothesis.rig.sensors);
        }
        let (problem, point) = found.extended(rig);
        let limits = Limits { iterations: 10, tolerance: 1e-5 };
        let hypothesis = Hypothesis::fitted(problem, point, &found.noise, &context.floors, limits)?;
        let behind = compare(found, &hypothesis, context).total;
        Some(Trial { candidate: trial.candidate.clone(), hypothesis, gain: added.gain - behind })
    };
    let mut out: Vec<Trial> = close.filter_map(one).collect();
    out.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    out
}

/// True if the fit left the candidate's strength at nothing.
fn at_zero(trial: &Trial) -> bool {
    let Some(effect) = trial.hypothesis.rig.effects.last() else { return true };
    effect.values.iter().all(|v| v.value == 0.0)
}

fn is_patched(now: &Hypothesis, candidate: &Candidate) -> bool {
    EffectKind::from_id(candidate.effect).is_some_and(|kind| is_patch(&now.rig, kind))
}

/// Candidates of a round, best first, that are asked whether they are believed.
const TRIED: usize = 3;

/// True if `trial` is worth it and holds on recordings that it was not fitted to.
fn believed(now: &Hypothesis, trial: &Trial, explained: f64, context: &Context, said: &mut impl FnMut(&str)) -> bool {
    if !is_worth(now, trial, explained, context) {
        return false;
    }
    let Some(kept) = kept_when_left_out(now, &trial.hypothesis, &context.floors) else { return true };
    said(&format!("   {} keeps {:.2} of its gain on recordings left out", trial.candidate.effect, kept));
    kept >= LEAST_KEPT || trial.candidate.only.is_some()
}

/// Smallest part of its gain that an effect must keep on recordings that it was not fitted to.
const LEAST_KEPT: f64 = 0.25;

/// An effect that is the limit of another: the other, with one number more, must gain clearly more to be believed.
const LIMITS_OF: &[(&str, &str)] = &[("torque_offset", "parallel_spring"), ("coulomb_friction", "stribeck_friction")];

/// Part of the richer effect's gain that is enough for the simpler one.
const ENOUGH: f64 = 0.95;

/// Where a simpler limit of the leader gains nearly as much, the leader goes: what is left may still be added.
fn simplest_first(trials: &mut Vec<Trial>) {
    let Some(leader) = trials.first() else { return };
    let simple = LIMITS_OF.iter().filter(|(_, rich)| *rich == leader.candidate.effect).find_map(|(simple, _)| {
        let close = |t: &Trial| {
            t.candidate.effect == *simple && t.candidate.at == leader.candidate.at && t.gain >= ENOUGH * leader.gain
        };
        trials.iter().position(close)
    });
    if let Some(i) = simple {
        let simple = trials.remove(i);
        trials[0] = simple;
    }
}

/// What a forward selection comes to.
pub struct Selection {
    /// The base, better than it was if a candidate led it out of a false minimum.
    pub base: Hypothesis,
    /// With everything that was added.
    pub found: Hypothesis,
    /// What was added, in order.
    pub added: Vec<Added>,
    /// The last round, which brought nothing.
    pub last: Vec<Trial>,
}

/// How often a selection may start again from a better base.
const RESTARTS: usize = 3;

/// Part of a candidate's gain that stays when it is taken out again, from which the gain was not its own.
const NOT_ITS_OWN: f64 = 0.5;

/// `now` fitted again from where `trial` stands, its effect taken out; `None` if the effect is what brings the gain.
///
/// A fit that ended in a false minimum is improved by anything that shakes it (a touchdown one row off, a stick that
/// should slip): without this check such a candidate would be named on a healthy machine.
fn shaken_free(now: &Hypothesis, trial: &Trial, context: &Context) -> Option<Hypothesis> {
    let without = left_out(&trial.hypothesis, now.rig.effects.len(), context)?;
    let total = |h: &Hypothesis| -> f64 { h.blocks(&trial.hypothesis.noise).iter().sum() };
    let (before, after, with) = (total(now), total(&without), total(&trial.hypothesis));
    (after - before > NOT_ITS_OWN * (with - before)).then_some(without)
}

/// Forward selection from `base`.
pub fn forward(
    base: &Hypothesis,
    mut library: impl FnMut(&Hypothesis) -> Vec<Candidate>,
    context: &Context,
    mut said: impl FnMut(&str),
) -> Selection {
    let mut all = Selection { base: base.clone(), found: base.clone(), added: Vec::new(), last: Vec::new() };
    let (mut explained, mut restarts) = (0.0, 0);
    loop {
        let candidates = library(&all.found);
        said(&format!("{} candidates", candidates.len()));
        all.last = round(&all.found, &candidates, context, &mut said);
        tell(&all.last, context, &mut said);
        let patches = all.added.iter().filter(|a| is_patched(&all.found, &a.candidate)).count();
        if all.added.len() >= MOST || patches >= PATCHES {
            return all;
        }
        simplest_first(&mut all.last);
        let asked = 0..all.last.len().min(TRIED);
        let Some(i) = asked.into_iter().find(|i| believed(&all.found, &all.last[*i], explained, context, &mut said))
        else {
            return all;
        };
        if restarts < RESTARTS
            && let Some(better) = shaken_free(&all.found, &all.last[i], context)
        {
            said(&format!("   {} only shook the fit free: again from there", all.last[i].candidate.effect));
            restarts += 1;
            if all.added.is_empty() {
                all.base = better.clone();
            }
            all.found = better;
            continue;
        }
        let best = all.last.remove(i);
        explained += best.gain;
        let share = removed(&all.found, &best.hypothesis, context);
        let others = std::mem::take(&mut all.last);
        all.added.push(Added { candidate: best.candidate, others, gain: best.gain, removed: share });
        all.found = best.hypothesis;
    }
}

/// Says how the candidates of a round did.
fn tell(trials: &[Trial], context: &Context, said: &mut impl FnMut(&str)) {
    for t in trials.iter().take(6) {
        let effect = t.hypothesis.rig.effects.last();
        let values: Vec<f64> = effect.map(|e| e.values.iter().map(|v| v.value).collect()).unwrap_or_default();
        let (effect, at) = (t.candidate.effect, &t.candidate.at);
        said(&format!("   {effect:20} {at:12} gain {:9.1} of {} {values:.4?}", t.gain, context.samples));
    }
}
