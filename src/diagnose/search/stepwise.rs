//! Attribution: which effects of the library, alone and together, explain what the base cannot.
//!
//! Every candidate is nested in the simulator and fitted jointly with all base parameters from the base solution.
//! Forward: a round of trials, the best that is believed is kept, until none is. Then the contest swaps and leaves out.
//! RT: no.

use crate::diagnose::judge::accept::{is_accepted, is_admissible};
use crate::diagnose::judge::criterion::{Context, compare, detection_threshold, explained_part};
use crate::diagnose::judge::exchange::only_freed_the_fit;
use crate::diagnose::judge::flexibility::{has_unresolved_order, is_local_here, is_overly_flexible};
use crate::diagnose::judge::numbers::{GREATER_PART, LOCAL_TERMS};
use crate::diagnose::judge::simplicity::order_by_penalised_gain;
use crate::diagnose::library::candidate_fit::{CandidateFit, SelectedEffect, TO_THE_END};
use crate::diagnose::library::candidates::Candidate;
use crate::diagnose::library::limited_fit::refit_without;
use crate::diagnose::robustness::cross_validation::CrossValidation;
use crate::diagnose::search::basin_hopping::escape_local_minimum;
use crate::diagnose::search::budget::{MOST_EFFORT, allowance, is_spent, within};
use crate::diagnose::search::exchange::exchange_near_rivals;
use crate::diagnose::search::joint_pair::{Pair, Sought, add_jointly, add_together};
use crate::diagnose::search::law_exchange::exchange_laws;
use crate::diagnose::search::round::{Asked, Start, merged, promises_little, round, tell};
use crate::diagnose::search::runners_up::{LEADS, runners_up};
use crate::identify::base_fit::anew;
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::is_misfit;
use crate::model::rig::Rig;
use rayon::prelude::*;
use std::cell::OnceCell;

/// Most effects that are added.
pub const MOST_EFFECTS: usize = 4;

/// Candidates of a round, best first, that are asked whether they are believed; others are if they gain nearly as much as the first, of so
/// many kinds (ripples of several orders are one), or were runners-up of the round before. What fits a piece of any misfit is not asked,
/// and takes no place.
const TRIED: usize = 3;

/// Samples of which a last look at what is promised takes less than a second.
const QUICK: usize = 20_000;

/// What a forward selection comes to.
#[derive(Clone)]
pub struct Selection {
    /// The base, better than it was if a candidate led it out of a false minimum.
    pub base: FittedModel,
    /// With everything that was added.
    pub found: FittedModel,
    /// What was added, in order.
    pub added: Vec<SelectedEffect>,
    /// The last round, which brought nothing.
    pub last: Vec<CandidateFit>,
    /// True if there was no time for another round.
    pub cut_short: bool,
}

impl Selection {
    /// Adds `best`; the rest of the last round are its rivals.
    fn add(&mut self, best: CandidateFit, context: &Context) {
        let before: f64 = self.added.iter().map(|a| a.removed).sum();
        let removed = (explained_part(&self.base, &best.hypothesis, context) - before).max(0.0);
        let others = std::mem::take(&mut self.last);
        self.added.push(SelectedEffect { candidate: best.candidate, others, gain: best.gain, removed });
        self.found = best.hypothesis;
    }

    /// To `base` without anything added.
    fn go_back_to(&mut self, base: FittedModel) {
        self.added.clear();
        self.found = base;
        self.cut_short = false;
    }

    /// From a better fit of the same effects.
    fn go_on_from(&mut self, better: FittedModel) {
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
fn improves_without_effect(now: &FittedModel, trial: &CandidateFit, context: &Context) -> Option<FittedModel> {
    let without = refit_without(&trial.hypothesis, now.rig.effects.len(), &context.floors)?;
    let total = |h: &FittedModel| -> f64 { h.blocks(&trial.hypothesis.noise).iter().sum() };
    let (before, after, with) = (total(now), total(&without), total(&trial.hypothesis));
    only_freed_the_fit(before, with, after).then_some(without)
}

/// [`improves_without_effect`] by the first of the last round, if it gains what would be worth it.
fn leader_improves_without_effect(all: &Selection, context: &Context) -> Option<FittedModel> {
    let leader = all.last.first().filter(|t| t.gain > detection_threshold(context, t.candidate.keys.len()))?;
    improves_without_effect(&all.found, leader, context)
}

/// `trial` out of the false minimum that it may have come into, where more than noise stays; its gain over `now` follows.
fn out_of_local_minimum(
    now: &FittedModel,
    mut trial: CandidateFit,
    context: &Context,
    said: &mut dyn FnMut(&str),
) -> CandidateFit {
    if !is_misfit(&trial.hypothesis.residuals, &context.floors) {
        return trial;
    }
    let Some(other) = escape_local_minimum(&trial.hypothesis, &context.floors) else { return trial };
    let better = compare(&other, &trial.hypothesis, context).total;
    said(&format!("   {} was in a false minimum: {better:.0} better", trial.candidate.effect));
    trial.gain = compare(&other, now, context).total;
    trial.hypothesis = other;
    trial
}

/// `trial` of a round on top of `now` fitted on until it stands; `None` if it is none then: a number at its bound was cut off, not
/// found.
fn fitted_to_the_end(now: &FittedModel, trial: &CandidateFit, context: &Context) -> Option<CandidateFit> {
    let from = &trial.hypothesis;
    let how = (&from.noise[..], TO_THE_END);
    let last = within(allowance(now), now, from.problem.clone(), from.point.clone(), how, context)?;
    if !is_admissible(&last, last.rig.effects.len() - 1, context) {
        return None;
    }
    let gained = compare(&last, from, context).total;
    if gained <= 0.0 {
        return Some(trial.clone());
    }
    Some(CandidateFit { hypothesis: last, gain: trial.gain + gained, ..trial.clone() })
}

/// Leaders of a first round that are fitted anew.
const ANEW: usize = 3;

/// The leaders of a first round that leave misfit, fitted once more from the numbers of `given`: what is missing has led the
/// base astray, windows and all, and from there not even the truth finds back (a walker whose encoder jumped). True if one
/// stands better then.
fn refit_leaders_from_given(given: &Rig, all: &mut Selection, context: &Context) -> bool {
    let most = all.last.first().map_or(0.0, |t| t.gain);
    let leads = |t: &&CandidateFit| t.gain > (LEADS * most).max(detection_threshold(context, t.candidate.keys.len()));
    let leaders: Vec<&CandidateFit> = all.last.iter().filter(leads).take(ANEW).collect();
    let one = |trial: &CandidateFit| {
        let from = &trial.hypothesis;
        if !is_misfit(&from.residuals, &context.floors) {
            return None;
        }
        let mut rig = given.clone();
        rig.effects.push(from.rig.effects.last()?.clone());
        rig.sensors.clone_from(&from.rig.sensors);
        let hypothesis = anew(&from.problem, &rig, &context.floors)?;
        let further = hypothesis.likelihood - from.likelihood > detection_threshold(context, 0);
        further.then(|| CandidateFit { hypothesis, ..trial.clone() })
    };
    let better: Vec<CandidateFit> = leaders.into_par_iter().filter_map(one).collect();
    let found = !better.is_empty();
    if found {
        all.last = merged(&all.found, better, std::mem::take(&mut all.last), context);
    }
    found
}

/// Forward selection from `base`, which is `given` with its numbers fitted. `also`: another place from which the first effect
/// is sought too. `stood`: what was found on top of it before. `is_vain`: asked of the fit with the first effect; true ends the search.
pub fn forward(
    (given, base): (&Rig, &FittedModel),
    (also, stood): (Option<&FittedModel>, Vec<CandidateFit>),
    library: impl Fn(&FittedModel) -> Vec<Candidate>,
    mut is_vain: impl FnMut(&FittedModel) -> bool,
    context: &Context,
    mut said: impl FnMut(&str),
) -> Selection {
    Search::from(given, base, (also, stood), &library, context).run(&mut is_vain, &mut said)
}

/// Forward selection on top of what `stands` in a selection.
pub fn forward_on(
    stands: Selection,
    library: impl Fn(&FittedModel) -> Vec<Candidate>,
    context: &Context,
    mut said: impl FnMut(&str),
) -> Selection {
    let (given, base) = (stands.base.rig.clone(), stands.base.clone());
    let mut search = Search::from(&given, &base, (None, Vec::new()), &library, context);
    search.explained = stands.added.iter().map(|a| a.gain).sum();
    search.all = stands;
    search.run(&mut |_| false, &mut said)
}

/// A forward selection on its way.
struct Search<'s> {
    given: &'s Rig,
    also: Option<&'s FittedModel>,
    library: &'s dyn Fn(&FittedModel) -> Vec<Candidate>,
    context: &'s Context,
    all: Selection,
    /// Gain of what was added.
    explained: f64,
    restarts: usize,
    /// Rounds of the whole library, for people.
    rounds: usize,
    last_cost: u64,
    /// What rounds cost that only freed the base from a false minimum, or were made from a second place.
    beside: u64,
    /// Trials on top of a worse base.
    stood: Vec<CandidateFit>,
    /// Effects that had been added when runners-up were asked.
    asked: usize,
    /// Those of this round.
    near: Vec<Start>,
    /// What was asked in the last round of the whole library.
    candidates: Vec<Candidate>,
    /// True once two that explain it together were sought.
    has_paired: bool,
}

impl<'s> Search<'s> {
    fn from(
        given: &'s Rig,
        base: &FittedModel,
        (also, stood): (Option<&'s FittedModel>, Vec<CandidateFit>),
        library: &'s dyn Fn(&FittedModel) -> Vec<Candidate>,
        context: &'s Context,
    ) -> Self {
        let (added, last) = (Vec::new(), Vec::new());
        let all = Selection { base: base.clone(), found: base.clone(), added, last, cut_short: false };
        let (explained, restarts, last_cost, beside, asked, near) = (0.0, 0, 0, 0, 0, Vec::new());
        let candidates = Vec::new();
        Self {
            given,
            also,
            library,
            context,
            all,
            explained,
            restarts,
            rounds: 0,
            last_cost,
            beside,
            stood,
            asked,
            near,
            candidates,
            has_paired: false,
        }
    }

    /// Round after round, until one brings nothing.
    fn run(mut self, is_vain: &mut dyn FnMut(&FittedModel) -> bool, said: &mut dyn FnMut(&str)) -> Selection {
        loop {
            if !self.next_round(said) {
                if self.adds_pair(None, said) {
                    continue;
                }
                return self.all;
            }
            tell(&self.all.last, self.context, said);
            if self.is_full() {
                return self.all;
            }
            order_by_penalised_gain(&mut self.all.last, self.context);
            // Before the recordings left out are asked: what they say of a false minimum is as false.
            if self.is_freed_by_leader(said) {
                continue;
            }
            let left_out = OnceCell::new();
            match self.accepted(&left_out, said) {
                Some(i) if i > 0 && self.is_freed_by(i, said) => {}
                Some(i) => {
                    self.add(i, said);
                    if self.all.added.len() == 1 && is_vain(&self.all.found) {
                        return self.all;
                    }
                }
                None => {
                    said("no effect of this round stands the tests");
                    let left_out = left_out.get().and_then(Option::as_ref);
                    if !self.adds_pair(left_out, said) {
                        return self.all;
                    }
                }
            }
        }
    }

    fn spent(&self) -> u64 {
        self.all.found.problem.effort.spent()
    }

    /// True if another round should end in time, by what the last one took: an answer with fewer effects is better than none.
    fn has_time(&self) -> bool {
        self.spent() + self.last_cost <= MOST_EFFORT + self.beside
    }

    /// Another round on top of what was found; false where that ends the search.
    fn next_round(&mut self, said: &mut dyn FnMut(&str)) -> bool {
        let earlier = std::mem::take(&mut self.stood);
        if self.last_cost > 0 && !self.has_time() {
            return earlier.is_empty() && self.asks_runners_up(said) || self.ends_early(earlier, said);
        }
        let spent = self.spent();
        self.candidates = (self.library)(&self.all.found);
        self.rounds += 1;
        self.near =
            self.all.added.last().map(|last| runners_up(&self.all.found, last, self.context)).unwrap_or_default();
        let asked = Asked { library: &self.candidates, near: &self.near };
        self.all.last = round(&self.all.found, (&self.all.found, earlier), asked, self.context, &mut *said);
        self.last_cost = self.spent() - spent;
        if let Some(also) = self.also.filter(|_| self.all.added.is_empty()) {
            said("   the same from the numbers as given");
            let before = self.spent();
            let asked = Asked { library: &(self.library)(also), near: &[] };
            let more = round(also, (&self.all.found, Vec::new()), asked, self.context, &mut *said);
            self.all.last = merged(&self.all.found, std::mem::take(&mut self.all.last), more, self.context);
            self.beside += self.spent() - before;
        }
        said(&self.told_of_round());
        true
    }

    /// How the round went, for people.
    fn told_of_round(&self) -> String {
        let tried = format!("round {}: {} effects tried", self.rounds, self.candidates.len());
        match self.all.last.iter().max_by(|a, b| a.gain.total_cmp(&b.gain)) {
            Some(best) => {
                format!("{tried}, best {}@{}, gain {:.0}", best.candidate.effect, best.candidate.at, best.gain)
            }
            None => format!("{tried}, none promises enough"),
        }
    }

    /// No time for a round of the whole library: the runners-up of the last one are fitted on top of its winner. Of two effects that
    /// are both there each nearly wins alone. False if there are none, or none is left.
    fn asks_runners_up(&mut self, said: &mut dyn FnMut(&str)) -> bool {
        let added = self.all.added.len();
        let last = self.all.added.last().filter(|_| added > self.asked && !is_spent(&self.all.found));
        self.near = last.map(|last| runners_up(&self.all.found, last, self.context)).unwrap_or_default();
        if self.near.is_empty() {
            return false;
        }
        said("no time for another round: the runners-up of the last are tried beside its winner");
        self.asked = added;
        let asked = Asked { library: &[], near: &self.near };
        self.all.last = round(&self.all.found, (&self.all.found, Vec::new()), asked, self.context, said);
        self.all.cut_short = true;
        !self.all.last.is_empty()
    }

    /// No time for another round: what was fitted on top of a worse base stands all the same, if there is anything.
    fn ends_early(&mut self, earlier: Vec<CandidateFit>, said: &mut dyn FnMut(&str)) -> bool {
        let is_left = !earlier.is_empty();
        let is_quick = self.context.samples < QUICK;
        let is_vain = || promises_little(&self.all.found, &(self.library)(&self.all.found), self.context);
        let is_done = !is_left && is_quick && is_vain();
        said(if is_done { "nothing promises enough for another round" } else { "no time for another round" });
        self.all.cut_short = !is_done;
        self.all.last = if is_left { merged(&self.all.found, Vec::new(), earlier, self.context) } else { Vec::new() };
        is_left
    }

    /// True if nothing may be added.
    fn is_full(&self) -> bool {
        let local = self.all.added.iter().filter(|a| is_local_here(&self.all.found, &a.candidate)).count();
        self.all.added.len() >= MOST_EFFECTS || local >= LOCAL_TERMS
    }

    /// True if the leader only freed the fit from a false minimum; the search then goes on from there.
    fn is_freed_by_leader(&mut self, said: &mut dyn FnMut(&str)) -> bool {
        let mut shaken = leader_improves_without_effect(&self.all, self.context).filter(|_| self.restarts < RESTARTS);
        if shaken.is_some()
            && self.all.added.is_empty()
            && refit_leaders_from_given(self.given, &mut self.all, self.context)
        {
            said("   fitted anew from the numbers as given");
            tell(&self.all.last, self.context, said);
            order_by_penalised_gain(&mut self.all.last, self.context);
            shaken = leader_improves_without_effect(&self.all, self.context);
        }
        let Some(better) = shaken else { return false };
        self.go_on_from(better, 0, said);
        true
    }

    /// The same for candidate `i` of the round.
    fn is_freed_by(&mut self, i: usize, said: &mut dyn FnMut(&str)) -> bool {
        if self.restarts >= RESTARTS {
            return false;
        }
        let Some(better) = improves_without_effect(&self.all.found, &self.all.last[i], self.context) else {
            return false;
        };
        self.go_on_from(better, i, said);
        true
    }

    fn go_on_from(&mut self, better: FittedModel, i: usize, said: &mut dyn FnMut(&str)) {
        said(&format!("   {} only shook the fit free: again from there", self.all.last[i].candidate.effect));
        self.restarts += 1;
        self.beside += self.last_cost;
        self.stood = std::mem::take(&mut self.all.last);
        self.all.go_on_from(better);
    }

    /// The first of the best candidates of the round that is accepted, and still admissible when it is fitted to the end; one that
    /// then runs to its bound leaves the round. Once all work is spent the best alone is asked: that nothing is missing is no answer for
    /// lack of work. `left_out`: made when needed.
    fn accepted(&mut self, left_out: &OnceCell<Option<CrossValidation>>, said: &mut dyn FnMut(&str)) -> Option<usize> {
        let mut asked = self.in_question();
        let most = asked.first().map_or(0.0, |i| self.all.last[*i].gain);
        let mut place = 0;
        while let Some(&i) = asked.get(place) {
            if place > 0 && is_spent(&self.all.found) {
                self.all.cut_short = true;
                break;
            }
            place += 1;
            if !self.is_asked(&asked[..place], most) || !self.is_believed(i, left_out, said) {
                continue;
            }
            match fitted_to_the_end(&self.all.found, &self.all.last[i], self.context) {
                Some(trial) => {
                    self.all.last[i] = trial;
                    return Some(i);
                }
                None => {
                    let dropped = self.all.last.remove(i);
                    said(&format!("   {} runs to its bound when it is fitted on", dropped.candidate.effect));
                    place -= 1;
                    asked = self.in_question();
                }
            }
        }
        None
    }

    /// The candidates of the round, best first, that do not fit a piece of anything.
    fn in_question(&self) -> Vec<usize> {
        let (now, all, context) = (&self.all.found, &self.all.last[..], self.context);
        let is_told = |trial: &CandidateFit| {
            !is_overly_flexible(now, trial, context) && !has_unresolved_order(now, trial, all, context)
        };
        (0..all.len()).filter(|i| is_told(&all[*i])).collect()
    }

    /// True if the last of `so_far`, the candidates in question of which the first gains `most`, is asked whether it is believed.
    fn is_asked(&self, so_far: &[usize], most: f64) -> bool {
        let Some((i, before)) = so_far.split_last() else { return false };
        let trial = &self.all.last[*i];
        let is_runner_up = || self.near.iter().any(|start| start.candidate.is_same_as(&trial.candidate));
        let is_near = || trial.gain > GREATER_PART * most && self.other_kinds(*i, before) < TRIED;
        before.len() < TRIED || is_near() || is_runner_up()
    }

    /// Effects and places of the candidates `before`, that of candidate `i` not counted.
    fn other_kinds(&self, i: usize, before: &[usize]) -> usize {
        let kind = |i: usize| (self.all.last[i].candidate.effect, self.all.last[i].candidate.at.as_str());
        let mut kinds: Vec<(&str, &str)> = before.iter().map(|other| kind(*other)).filter(|k| *k != kind(i)).collect();
        kinds.sort_unstable();
        kinds.dedup();
        kinds.len()
    }

    fn is_believed(&self, i: usize, left_out: &OnceCell<Option<CrossValidation>>, said: &mut dyn FnMut(&str)) -> bool {
        let (now, all, context) = (&self.all.found, &self.all.last[..], self.context);
        let trial = &all[i];
        let kept = || {
            let left_out = left_out.get_or_init(|| CrossValidation::of(now, &context.floors)).as_ref();
            left_out.and_then(|l| l.cross_validated_gain_ratio(&trial.hypothesis, &context.floors))
        };
        is_accepted(now, (trial, all), self.explained, kept, context, said)
    }

    /// Adds candidate `i` of the round, and asks those before it again.
    fn add(&mut self, i: usize, said: &mut dyn FnMut(&str)) {
        let best = self.all.last.remove(i);
        said(&format!("{}@{} is believed and added", best.candidate.effect, best.candidate.at));
        let best = out_of_local_minimum(&self.all.found, best, self.context, said);
        self.explained += best.gain;
        self.all.add(best, self.context);
        let found = self.all.found.clone();
        let found = exchange_near_rivals(found, &mut self.all.added, self.context, said);
        self.all.found = exchange_laws(found, &mut self.all.added, &self.candidates, self.context, said);
    }

    /// True if two candidates that hide each other were added together: one that does not hold alone with one that makes it hold, or two
    /// that explain what nothing explains that was found one by one.
    fn adds_pair(&mut self, left_out: Option<&CrossValidation>, said: &mut dyn FnMut(&str)) -> bool {
        let base = self.all.base.clone();
        let Some(pair) = self.hidden_pair(left_out, said).or_else(|| self.explaining_pair(&base, said)) else {
            return false;
        };
        self.all.go_back_to(base);
        self.explained = 0.0;
        for (trial, others) in pair {
            self.explained += trial.gain;
            self.all.last = others;
            self.all.add(trial, self.context);
        }
        true
    }

    /// One of the last round, where nothing was added, that does not hold alone, and the one that makes it hold.
    fn hidden_pair(&self, left_out: Option<&CrossValidation>, said: &mut dyn FnMut(&str)) -> Option<Pair> {
        let left_out = left_out.filter(|_| self.all.added.is_empty() && self.has_time());
        left_out.and_then(|_| add_jointly(&self.sought(&self.all.found, left_out), &self.all.last, said))
    }

    /// The best fit so far: what was found, or of no more than two effects the best of the last round on top of it.
    fn best(&self) -> &FittedModel {
        let leader = self.all.last.first().filter(|_| self.all.added.len() < 2).map(|t| &t.hypothesis);
        let is_better = |of: &&FittedModel| compare(of, &self.all.found, self.context).total > 0.0;
        leader.filter(is_better).unwrap_or(&self.all.found)
    }

    fn sought<'a>(&'a self, base: &'a FittedModel, left_out: Option<&'a CrossValidation>) -> Sought<'a> {
        Sought { base, library: self.library, left_out, context: self.context }
    }

    /// Two effects on top of the base that explain more than what was found one by one. Asked once, if one alone gained more than chance.
    fn explaining_pair(&mut self, base: &FittedModel, said: &mut dyn FnMut(&str)) -> Option<Pair> {
        let counts = |t: &CandidateFit| t.gain > detection_threshold(self.context, t.candidate.keys.len());
        let is_asked = !self.all.added.is_empty() || self.all.last.first().is_some_and(counts);
        if self.has_paired || !is_asked || is_spent(&self.all.found) {
            return None;
        }
        self.has_paired = true;
        let left_out = CrossValidation::of(base, &self.context.floors);
        let pair = add_together(&self.sought(base, left_out.as_ref()), self.best(), said)?;
        self.beside = self.spent();
        Some(pair)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::worked::{Shown, shown};
    use crate::diagnose::library::candidates::Key;

    #[test]
    fn a_number_that_runs_to_its_bound_is_none_and_one_that_is_found_gains() {
        let lag = |value: &str| format!("[[effect]]\neffect = \"actuator_lag\"\nat = \"u\"\ntime_constant = {value}\n");
        let Shown { context, problem } = shown(&lag("0.02"));
        let base = problem.fitted("", 20);
        let last = |most: f64| {
            let text = lag(&format!("{{ value = 0.002, min = 0.0, max = {most} }}"));
            let trial = problem.trial("actuator_lag", "u", &text, 1, 100.0);
            (fitted_to_the_end(&base, &trial, &context), trial)
        };
        assert!(last(0.01).0.is_none());
        let (found, trial) = last(0.2);
        let found = found.unwrap();
        assert!(found.gain > trial.gain, "{} {}", found.gain, trial.gain);
        assert!((found.hypothesis.rig.effects.last().unwrap().values[0].value / 0.02 - 1.0).abs() < 0.05);
    }

    /// Drag and an offset: the drag stands, and only what is asked beside it may come.
    #[test]
    fn a_search_goes_on_from_what_stands() {
        let drag = "[[effect]]\neffect = \"quadratic_drag\"\nat = \"q1\"\nquadratic = ";
        let Shown { context, problem } =
            shown(&format!("{drag}0.004\n[[effect]]\neffect = \"torque_offset\"\nat = \"q1\"\ntorque = 0.05\n"));
        let (base, found) =
            (problem.fitted("", 20), problem.fitted(&format!("{drag}{{ value = 0.001, min = 0.0, max = 0.1 }}\n"), 20));
        let stands = || Selection {
            base: base.clone(),
            found: found.clone(),
            added: vec![problem.added("quadratic_drag", "q1", 100.0, Vec::new())],
            last: Vec::new(),
            cut_short: false,
        };
        let offset = Candidate {
            keys: vec![Key { name: "torque", min: -1.0, max: 1.0, log: false }],
            starts: vec![vec![0.0]],
            ..problem.candidate("torque_offset", "q1")
        };
        let more = forward_on(stands(), |_| vec![offset.clone()], &context, |_| {});
        assert_eq!(
            more.added.iter().map(|a| a.candidate.effect).collect::<Vec<_>>(),
            ["quadratic_drag", "torque_offset"]
        );
        let value = |e: usize| more.found.rig.effects[context.given + e].values[0].value;
        assert!(
            (value(0) / 0.004 - 1.0).abs() < 0.1 && (value(1) / 0.05 - 1.0).abs() < 0.05,
            "{} {}",
            value(0),
            value(1)
        );
        let same = forward_on(stands(), |_| Vec::new(), &context, |_| {});
        assert_eq!((same.added.len(), same.found.rig), (1, found.rig.clone()));
    }

    #[test]
    fn the_best_of_a_round_is_asked_though_all_work_is_spent() {
        let offset = "[[effect]]\neffect = \"torque_offset\"\nat = \"q1\"\ntorque = ";
        let Shown { context, problem } = shown(&format!("{offset}0.05\n"));
        let base = problem.fitted("", 20);
        base.problem.effort.add(3 * MOST_EFFORT);
        assert!(is_spent(&base));
        let candidate = Candidate {
            keys: vec![Key { name: "torque", min: -1.0, max: 1.0, log: false }],
            starts: vec![vec![0.0]],
            ..problem.candidate("torque_offset", "q1")
        };
        let library = |_: &FittedModel| vec![candidate.clone()];
        let found = forward((&base.rig, &base), (None, Vec::new()), library, |_| false, &context, |_| {});
        assert_eq!(found.added.iter().map(|a| a.candidate.effect).collect::<Vec<_>>(), ["torque_offset"]);
    }
}
