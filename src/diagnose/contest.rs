//! The contest of effects that were added: each is exchanged for its close rivals in the company of the others; after the
//! selection it is left out as well.
//!
//! RT: no.

use crate::diagnose::belief::{ENOUGH, LIMITS_OF, is_cut_off, is_piece, is_sure};
use crate::diagnose::carry::goes_on;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::likelihood::is_misfit;
use crate::diagnose::stragglers::reseated;
use crate::diagnose::tried::{Added, Context, MOST_EFFORT, Trial, compare, left_out, worth};
use crate::identify::fit::Limits;
use crate::model::rig::{Effect, Rig};
use rayon::prelude::*;

/// Swap and backward: every effect of `found` is exchanged for its close rivals in the company of the others, and
/// left out; what is better stays.
#[must_use]
pub fn contested(found: Hypothesis, mut added: Vec<Added>, context: &Context) -> (Hypothesis, Vec<Added>) {
    let first = context.given;
    let mut found = found;
    if added.len() < 2 {
        return (found, added);
    }
    let mut i = 0;
    while i < added.len() {
        let Some(without) = left_out(&found, first + i, context) else { break };
        let kept = compare(&found, &without, context);
        let (total, candidate) = (kept.total, &added[i].candidate);
        if total < worth(context, candidate.keys.len()) || !is_sure(candidate, total, kept, context) {
            found = without;
            added.remove(i);
            continue;
        }
        added[i].gain = kept.total;
        let rivals = exchanged(&found, &added[i], first + i, context, CLOSE * leading(&added[i]));
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

/// The near rivals of every effect brought to rest as `found` was: a fit that was stopped early is behind for that alone, and
/// what this data cannot tell apart would pass for told. Who then stands better takes the place. Not where misfit stays: there
/// no form is the true one, and who bends to it best (a ripple of some order) is not who is missing.
#[must_use]
pub fn at_rest(mut found: Hypothesis, mut added: Vec<Added>, context: &Context) -> (Hypothesis, Vec<Added>) {
    if is_misfit(&found.residuals, &context.floors) {
        return (found, added);
    }
    for (i, a) in added.iter_mut().enumerate() {
        let total = |h: &Hypothesis| -> f64 { h.blocks(&found.noise).iter().sum() };
        let comparable = |t: &&mut Trial| t.hypothesis.rig.effects.len() == found.rig.effects.len();
        let near = |t: &&mut Trial| t.gain > NEARBY * a.gain && !t.candidate.is_same_as(&a.candidate);
        let mut rivals: Vec<&mut Trial> = a.others.iter_mut().filter(comparable).filter(near).take(SETTLED).collect();
        rivals.par_iter_mut().for_each(|trial| {
            // From where it stands, and from where the answer does: a rival may have stopped in a false minimum.
            let there = in_its_place(&found.rig, trial, context.given + i).map(|rig| found.extended(rig));
            let here = (trial.hypothesis.problem.clone(), trial.hypothesis.point.clone());
            for (problem, start) in there.into_iter().chain([here]) {
                let finer = Hypothesis::fitted(problem, start, &found.noise, &context.floors, LAST);
                let finer = finer.map(|f| reseated(&f, &context.floors).unwrap_or(f));
                if let Some(finer) = finer.filter(|f| total(f) > total(&trial.hypothesis)) {
                    trial.gain += total(&finer) - total(&trial.hypothesis);
                    trial.hypothesis = finer;
                }
            }
        });
        let takes_it = |t: &Trial| {
            let same_company = t.hypothesis.rig.effects.len() == found.rig.effects.len();
            same_company
                && is_better(&found, t, a, a.gain, context)
                && is_admitted(&found, t, context.given + i, context)
        };
        let better = (0..a.others.len()).filter(|k| takes_it(&a.others[*k]));
        let best = better.max_by(|j, k| total(&a.others[*j].hypothesis).total_cmp(&total(&a.others[*k].hypothesis)));
        let Some(best) = best else { continue };
        let winner = a.others.remove(best);
        let candidate = std::mem::replace(&mut a.candidate, winner.candidate);
        let loser = std::mem::replace(&mut found, winner.hypothesis);
        a.others.insert(0, Trial { candidate, hypothesis: loser, gain: a.gain });
        a.gain = winner.gain;
    }
    (found, added)
}

/// True if `trial` may stand in the place of effect `e`: no piece of a misfit, no number at the edge of its range, and what is
/// inside goes on from window to window.
fn is_admitted(found: &Hypothesis, trial: &Trial, e: usize, context: &Context) -> bool {
    let goes_on = || {
        !trial.candidate.has_inner_states()
            || left_out(found, e, context).is_none_or(|without| goes_on(&without, &trial.hypothesis, &context.floors))
    };
    !is_piece(found, trial, context) && !trial.hypothesis.rig.effects.get(e).is_some_and(is_cut_off) && goes_on()
}

/// `rig` with the effect of `trial` in the place of effect `e`.
fn in_its_place(rig: &Rig, trial: &Trial, e: usize) -> Option<Rig> {
    let mut rig = rig.clone();
    let is_its = |effect: &&Effect| effect.kind.id() == trial.candidate.effect && effect.at == trial.candidate.at;
    *rig.effects.get_mut(e)? = trial.hypothesis.rig.effects.iter().rev().find(is_its)?.clone();
    if trial.candidate.motor_sensor.is_some() {
        rig.sensors.clone_from(&trial.hypothesis.rig.sensors);
    }
    Some(rig)
}

/// Part of an effect's gain from which a rival is brought to rest, how many are, and how.
const NEARBY: f64 = 0.6;
const SETTLED: usize = 4;
const LAST: Limits = Limits { iterations: 25, tolerance: 1e-7 };

/// True if `rival` should stand in the place of `added`, whose gain is `kept`.
fn is_better(found: &Hypothesis, rival: &Trial, added: &Added, kept: f64, context: &Context) -> bool {
    let richer = LIMITS_OF.contains(&(added.candidate.effect, rival.candidate.effect));
    let least = if richer { (1.0 - ENOUGH) * kept } else { 0.0 };
    compare(found, &rival.hypothesis, context).total < -least.max(CLEARLY)
}

/// Part of the best rival's gain from which a rival is close.
const CLOSE: f64 = 0.4;

/// Part of an effect's own gain from which a rival is so near that company may turn the order round.
const NEAR: f64 = 0.75;

/// Gain of the best rival.
fn leading(added: &Added) -> f64 {
    added.others.first().map_or(0.0, |other| other.gain)
}

/// Swap alone, with the near rivals of each effect before the last: one that was chosen while another was missing may
/// have been the wrong one of two, and a third effect would be called to make up for it.
#[must_use]
pub fn reconsidered(
    mut found: Hypothesis,
    added: &mut [Added],
    context: &Context,
    said: &mut impl FnMut(&str),
) -> Hypothesis {
    let first = context.given;
    for i in 0..added.len().saturating_sub(1) {
        let own = added[i].gain;
        let rivals = exchanged(&found, &added[i], first + i, context, NEAR * own);
        let Some(better) = rivals.into_iter().next().filter(|r| is_better(&found, r, &added[i], own, context)) else {
            continue;
        };
        let (before, after) = (&added[i].candidate, &better.candidate);
        said(&format!("   {}@{} in the place of {}@{}", after.effect, after.at, before.effect, before.at));
        let old = Trial { candidate: before.clone(), hypothesis: found, gain: own };
        added[i].others.retain(|t| t.candidate != better.candidate);
        added[i].others.insert(0, old);
        (found, added[i].candidate) = (better.hypothesis, better.candidate);
    }
    found
}

/// Two effects exchanged at once where the last round left more than chance: of two wrong effects that make up for each other,
/// neither can be exchanged alone (two ripples for a spring and a ripple of order 12), and what is then found too late (a
/// push, after two that stand for a limit of the torque) has no place.
#[must_use]
pub fn paired(
    mut found: Hypothesis,
    added: &mut [Added],
    last: &[Trial],
    context: &Context,
    said: &mut impl FnMut(&str),
) -> Hypothesis {
    let counts = |t: &&Trial| t.gain > worth(context, t.candidate.keys.len());
    let late: Vec<&Trial> = last.iter().filter(counts).take(LATE).collect();
    if late.is_empty() || found.problem.effort.spent() > MOST_EFFORT / 5 * 4 {
        return found;
    }
    for j in 1..added.len() {
        for i in 0..j {
            let stays =
                |k: usize| Trial { candidate: added[k].candidate.clone(), hypothesis: found.clone(), gain: 0.0 };
            let (first, second) = (rivals(&added[i]), rivals(&added[j]));
            let firsts: Vec<Trial> = [vec![stays(i)], first].concat();
            let seconds: Vec<Trial> = [vec![stays(j)], second, late.iter().copied().cloned().collect()].concat();
            let pairs = firsts.iter().flat_map(|a| seconds.iter().map(move |b| [a, b])).skip(1);
            let different = |[a, b]: &[&Trial; 2]| !a.candidate.is_same_as(&b.candidate);
            let pairs: Vec<[&Trial; 2]> = pairs.filter(different).collect();
            let fitted = |[a, b]: [&Trial; 2]| {
                let rig = in_its_place(&found.rig, a, context.given + i)?;
                let (problem, start) = found.extended(in_its_place(&rig, b, context.given + j)?);
                let limits = Limits { iterations: 10, tolerance: 1e-5 };
                let fit = Hypothesis::fitted(problem, start, &found.noise, &context.floors, limits)?;
                let cut_off = [i, j].map(|k| fit.rig.effects.get(context.given + k).is_some_and(is_cut_off));
                let ahead = compare(&fit, &found, context).total;
                // Where misfit stays no form is the true one, and a swap tells nothing.
                let exact = !is_misfit(&fit.residuals, &context.floors);
                (exact && cut_off == [false; 2]).then(|| (ahead, fit, [a.candidate.clone(), b.candidate.clone()]))
            };
            let fits: Vec<_> = pairs.into_par_iter().filter_map(fitted).collect();
            let best = fits.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(ahead, ..)| *ahead > CLEARLY);
            let Some((ahead, better, candidates)) = best else { continue };
            let names = candidates.each_ref().map(|c| c.effect);
            said(&format!("   {} and {} instead of two: {ahead:.0} better", names[0], names[1]));
            let old = std::mem::replace(&mut found, better);
            for (k, candidate) in [i, j].into_iter().zip(candidates) {
                if candidate.is_same_as(&added[k].candidate) {
                    continue;
                }
                let before = std::mem::replace(&mut added[k].candidate, candidate);
                added[k]
                    .others
                    .insert(0, Trial { candidate: before, hypothesis: old.clone(), gain: added[k].gain - ahead });
            }
        }
    }
    found
}

/// The rivals of `added` that are tried in pairs, one for each effect and place.
fn rivals(added: &Added) -> Vec<Trial> {
    let richer = |t: &Trial| LIMITS_OF.contains(&(added.candidate.effect, t.candidate.effect));
    let close = |t: &&Trial| t.gain > HALF * added.gain && !t.candidate.is_same_as(&added.candidate) && !richer(t);
    let mut out: Vec<Trial> = Vec::new();
    for trial in added.others.iter().filter(close) {
        let alike = |t: &Trial| t.candidate.effect == trial.candidate.effect && t.candidate.at == trial.candidate.at;
        if out.len() < IN_PAIRS && (trial.gain > NEAR * added.gain || !out.iter().any(alike)) {
            out.push(trial.clone());
        }
    }
    out
}

/// Part of an effect's gain from which a rival is tried in a pair.
const HALF: f64 = 0.5;

/// Rivals of each of two effects that are tried together, and what the last round adds to those of the second.
const IN_PAIRS: usize = 4;
const LATE: usize = 3;

/// Twice the log-likelihood from which a swap is better.
const CLEARLY: f64 = 10.0;

/// The rivals of effect `e` that gained more than `least`, fitted in its place, as far as they are believable; best first,
/// gains relative to leaving it out.
fn exchanged(found: &Hypothesis, added: &Added, e: usize, context: &Context, least: f64) -> Vec<Trial> {
    let admitted = added.others.iter().filter(|t| !is_piece(found, t, context));
    let close = admitted.filter(|t| t.gain > least).take(4);
    let one = |trial: &Trial| {
        let (problem, point) = found.extended(in_its_place(&found.rig, trial, e)?);
        let limits = Limits { iterations: 10, tolerance: 1e-5 };
        let hypothesis = Hypothesis::fitted(problem, point, &found.noise, &context.floors, limits)?;
        let behind = compare(found, &hypothesis, context).total;
        Some(Trial { candidate: trial.candidate.clone(), hypothesis, gain: added.gain - behind })
    };
    let mut out: Vec<Trial> = close.filter_map(one).collect();
    out.retain(|trial| !is_cut_off(&trial.hypothesis.rig.effects[e]));
    if out.iter().any(|trial| trial.candidate.has_inner_states()) {
        let without = left_out(found, e, context);
        let goes_on = |t: &Trial| without.as_ref().is_none_or(|w| goes_on(w, &t.hypothesis, &context.floors));
        out.retain(goes_on);
    }
    out.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    out
}
