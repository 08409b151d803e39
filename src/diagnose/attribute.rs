//! Attribution: which effects of the library, alone and together, explain what the base cannot.
//!
//! Every candidate is nested in the simulator and fitted jointly with all base parameters from the base solution.
//! Forward: a round of trials, the best that is believed is kept, until none is. Then the contest swaps and leaves out.
//! RT: no.

use crate::diagnose::base::anew;
use crate::diagnose::candidates::Candidate;
use crate::diagnose::contest::reconsidered;
use crate::diagnose::folds::LeftOut;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::judge::accept::{is_accepted, is_admissible, is_piece_of_vibration};
use crate::diagnose::judge::criterion::{Context, compare, detection_threshold, explained_part};
use crate::diagnose::judge::exchange::only_freed_the_fit;
use crate::diagnose::judge::flexibility::{has_unresolved_order, is_local_here};
use crate::diagnose::judge::numbers::{KEPT, LOCAL_TERMS};
use crate::diagnose::judge::simplicity::order_by_penalised_gain;
use crate::diagnose::judge::verdict::is_far_beyond_chance;
use crate::diagnose::likelihood::is_misfit;
use crate::diagnose::round::{merged, promises_little, round};
use crate::diagnose::tried::{Added, MOST_EFFORT, Trial, left_out};
use crate::diagnose::valley::wandered;
use crate::model::rig::Rig;
use rayon::prelude::*;
use std::cell::OnceCell;

/// Most effects that are added.
pub const MOST: usize = 4;

/// Candidates of a round, best first, that are asked whether they are believed.
const TRIED: usize = 3;

/// Samples of which a last look at what is promised takes less than a second.
const QUICK: usize = 20_000;

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
    /// True if there was no time for another round.
    pub cut_short: bool,
}

impl Selection {
    /// Adds `best`; the rest of the last round are its rivals.
    fn add(&mut self, best: Trial, context: &Context) {
        let removed = explained_part(&self.found, &best.hypothesis, context);
        let others = std::mem::take(&mut self.last);
        self.added.push(Added { candidate: best.candidate, others, gain: best.gain, removed });
        self.found = best.hypothesis;
    }

    /// From a better fit of the same effects.
    fn go_on_from(&mut self, better: Hypothesis) {
        if self.added.is_empty() {
            self.base = better.clone();
        }
        self.found = better;
    }
}

/// How often a selection may start again from a better base.
const RESTARTS: usize = 3;

/// `now` fitted again from where `trial` stands, its effect taken out; `None` if the effect is what brings the gain.
///
/// A fit that ended in a false minimum is improved by anything that shakes it (a touchdown one row off, a stick that
/// should slip): without this check such a candidate would be named on a healthy machine.
fn shaken_free(now: &Hypothesis, trial: &Trial, context: &Context) -> Option<Hypothesis> {
    let without = left_out(&trial.hypothesis, now.rig.effects.len(), context)?;
    let total = |h: &Hypothesis| -> f64 { h.blocks(&trial.hypothesis.noise).iter().sum() };
    let (before, after, with) = (total(now), total(&without), total(&trial.hypothesis));
    only_freed_the_fit(before, with, after).then_some(without)
}

/// [`shaken_free`] by the first of the last round, if it gains what would be worth it.
fn shaken_by_leader(all: &Selection, context: &Context) -> Option<Hypothesis> {
    let leader = all.last.first().filter(|t| t.gain > detection_threshold(context, t.candidate.keys.len()))?;
    shaken_free(&all.found, leader, context)
}

/// `trial` out of the false minimum that it may have come into, where more than noise stays; its gain over `now` follows.
fn unstuck(now: &Hypothesis, mut trial: Trial, context: &Context, said: &mut impl FnMut(&str)) -> Trial {
    if !is_misfit(&trial.hypothesis.residuals, &context.floors) {
        return trial;
    }
    let Some(other) = wandered(&trial.hypothesis, context) else { return trial };
    let better = compare(&other, &trial.hypothesis, context).total;
    said(&format!("   {} was in a false minimum: {better:.0} better", trial.candidate.effect));
    trial.gain = compare(&other, now, context).total;
    trial.hypothesis = other;
    trial
}

/// Leaders of a first round that are fitted anew, and the part of the first one's gain from which they are.
const ANEW: usize = 3;
const LEADS: f64 = 0.3;

/// The leaders of a first round that leave misfit, fitted once more from the numbers of `given`: what is missing has led the
/// base astray, windows and all, and from there not even the truth finds back (a walker whose encoder jumped). True if one
/// stands better then.
fn anew_from(given: &Rig, all: &mut Selection, context: &Context) -> bool {
    let most = all.last.first().map_or(0.0, |t| t.gain);
    let leads = |t: &&Trial| t.gain > (LEADS * most).max(detection_threshold(context, t.candidate.keys.len()));
    let leaders: Vec<&Trial> = all.last.iter().filter(leads).take(ANEW).collect();
    let one = |trial: &Trial| {
        let from = &trial.hypothesis;
        if !is_misfit(&from.residuals, &context.floors) {
            return None;
        }
        let mut rig = given.clone();
        rig.effects.push(from.rig.effects.last()?.clone());
        rig.sensors.clone_from(&from.rig.sensors);
        let hypothesis = anew(&from.problem, &rig, &context.floors)?;
        let further = hypothesis.likelihood - from.likelihood > detection_threshold(context, 0);
        further.then(|| Trial { hypothesis, ..trial.clone() })
    };
    let better: Vec<Trial> = leaders.into_par_iter().filter_map(one).collect();
    let found = !better.is_empty();
    if found {
        all.last = merged(&all.found, better, std::mem::take(&mut all.last), context);
    }
    found
}

/// Forward selection from `base`, which is `given` with its numbers fitted. `also`: another place from which the first effect
/// is sought too.
pub fn forward(
    (given, base): (&Rig, &Hypothesis),
    also: Option<&Hypothesis>,
    mut library: impl FnMut(&Hypothesis) -> Vec<Candidate>,
    context: &Context,
    mut said: impl FnMut(&str),
) -> Selection {
    let (added, last) = (Vec::new(), Vec::new());
    let mut all = Selection { base: base.clone(), found: base.clone(), added, last, cut_short: false };
    let (mut explained, mut restarts, mut last_cost) = (0.0, 0, 0);
    // What rounds cost that only freed the base from a false minimum.
    let mut in_vain = 0;
    let mut stood: Vec<Trial> = Vec::new();
    loop {
        let spent = all.found.problem.effort.spent();
        let earlier = std::mem::take(&mut stood);
        // Another round begins only if it should end in time, by what the last one took: an answer with fewer effects is
        // better than none.
        if last_cost > 0 && spent + last_cost > MOST_EFFORT + in_vain {
            if earlier.is_empty() {
                let is_quick = context.samples < QUICK;
                all.cut_short = !(is_quick && promises_little(&all.found, &library(&all.found), context));
                said(if all.cut_short {
                    "no time for another round"
                } else {
                    "nothing promises enough for another round"
                });
                all.last = Vec::new();
                return all;
            }
            said("no time for another round");
            all.cut_short = true;
            // What was fitted on top of a worse base stands all the same.
            all.last = merged(&all.found, Vec::new(), earlier, context);
        } else {
            let candidates = library(&all.found);
            said(&format!("{} candidates", candidates.len()));
            all.last = round(&all.found, (&all.found, earlier), &candidates, context, &mut said);
            last_cost = all.found.problem.effort.spent() - spent;
            if let Some(also) = also.filter(|_| all.added.is_empty()) {
                said("the same from the numbers as given");
                let more = round(also, (&all.found, Vec::new()), &library(also), context, &mut said);
                all.last = merged(&all.found, std::mem::take(&mut all.last), more, context);
            }
        }
        tell(&all.last, context, &mut said);
        let local = all.added.iter().filter(|a| is_local_here(&all.found, &a.candidate)).count();
        if all.added.len() >= MOST || local >= LOCAL_TERMS {
            return all;
        }
        order_by_penalised_gain(&mut all.last, context);
        // Before the recordings left out are asked: what they say of a false minimum is as false.
        let mut shaken = shaken_by_leader(&all, context).filter(|_| restarts < RESTARTS);
        if shaken.is_some() && all.added.is_empty() && anew_from(given, &mut all, context) {
            said("   fitted anew from the numbers as given");
            tell(&all.last, context, &mut said);
            order_by_penalised_gain(&mut all.last, context);
            shaken = shaken_by_leader(&all, context);
        }
        if let Some(better) = shaken {
            said(&format!("   {} only shook the fit free: again from there", all.last[0].candidate.effect));
            restarts += 1;
            in_vain += last_cost;
            stood = std::mem::take(&mut all.last);
            all.go_on_from(better);
            continue;
        }
        let left_out = OnceCell::new();
        let mut asked = 0..all.last.len().min(TRIED);
        let told = |i: &usize| {
            let (trial, rivals) = (&all.last[*i], &all.last[..]);
            !has_unresolved_order(&all.found, trial, rivals, context) && !is_piece_of_vibration(trial, rivals, context)
        };
        let accepted = asked.find(|i| {
            let trial = (&all.last[*i], &all.last[..]);
            let hypothesis = &trial.0.hypothesis;
            let kept = || {
                let left_out = left_out.get_or_init(|| LeftOut::of(&all.found, &context.floors)).as_ref();
                left_out.and_then(|l| l.kept_by(hypothesis, &context.floors))
            };
            told(i) && is_accepted(&all.found, trial, explained, kept, context, &mut said)
        });
        let Some(i) = accepted else {
            let time_is_left = all.found.problem.effort.spent() + last_cost <= MOST_EFFORT + in_vain;
            let left_out = left_out.get().and_then(Option::as_ref).filter(|_| all.added.is_empty() && time_is_left);
            let Some(pair) = left_out.and_then(|l| in_company(&all, &mut library, l, context, &mut said)) else {
                return all;
            };
            for trial in pair {
                all.last.retain(|t| !t.candidate.is_same_as(&trial.candidate));
                explained += trial.gain;
                all.add(trial, context);
            }
            continue;
        };
        if i > 0
            && restarts < RESTARTS
            && let Some(better) = shaken_free(&all.found, &all.last[i], context)
        {
            said(&format!("   {} only shook the fit free: again from there", all.last[i].candidate.effect));
            restarts += 1;
            in_vain += last_cost;
            stood = std::mem::take(&mut all.last);
            all.go_on_from(better);
            continue;
        }
        let best = unstuck(&all.found, all.last.remove(i), context, &mut said);
        explained += best.gain;
        all.add(best, context);
        all.found = reconsidered(all.found, &mut all.added, context, &mut said);
    }
}

/// Leaders of a first round, one of each kind, that are tried in company.
const COMPANIONS: usize = 3;

/// A leader that does not hold on recordings left out, and the effect that makes it hold: two that hide each other look, one
/// at a time, like nothing that is true (an offset beside friction that falls with speed). Both together must leave but noise.
fn in_company(
    all: &Selection,
    mut library: impl FnMut(&Hypothesis) -> Vec<Candidate>,
    left_out: &LeftOut,
    context: &Context,
    mut said: impl FnMut(&str),
) -> Option<[Trial; 2]> {
    let mut leaders: Vec<&Trial> = Vec::new();
    for trial in all.last.iter().filter(|t| is_far_beyond_chance(t.gain, t.candidate.keys.len(), context)) {
        let e = trial.hypothesis.rig.effects.len() - 1;
        let is_new = leaders.iter().all(|l| l.candidate.effect != trial.candidate.effect);
        if is_new && !is_local_here(&all.found, &trial.candidate) && is_admissible(&trial.hypothesis, e, context) {
            leaders.push(trial);
        }
    }
    let most = leaders.first().map_or(0.0, |l| l.gain);
    leaders.retain(|l| l.gain > LEADS * most);
    // Who has few numbers makes up for little of what the other does, and is soon asked.
    leaders.sort_by_key(|l| l.candidate.keys.iter().filter(|k| k.max > k.min).count());
    for leader in leaders.into_iter().take(COMPANIONS) {
        let now = &leader.hypothesis;
        if now.problem.effort.spent() > MOST_EFFORT / 3 * 2 {
            return None;
        }
        said(&format!("   with {}@{} for company", leader.candidate.effect, leader.candidate.at));
        let mut seconds = round(now, (now, Vec::new()), &library(now), context, &mut said);
        tell(&seconds, context, &mut said);
        order_by_penalised_gain(&mut seconds, context);
        let Some(second) = seconds.first().filter(|s| !is_misfit(&s.hypothesis.residuals, &context.floors)) else {
            continue;
        };
        let kept = left_out.kept_by(&second.hypothesis, &context.floors).unwrap_or(0.0);
        said(&format!("   with {} both keep {kept:.2} of their gain on recordings left out", second.candidate.effect));
        let alone = || LeftOut::of(now, &context.floors)?.kept_by(&second.hypothesis, &context.floors);
        if kept >= KEPT && is_accepted(now, (second, &seconds), leader.gain, alone, context, &mut said) {
            return Some([leader.clone(), second.clone()]);
        }
    }
    None
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
