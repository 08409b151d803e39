//! What was found and is no explanation: effects too small to matter, effects that recordings kept back refute, and numbers
//! that the data do not tell from nothing.
//!
//! All are told as seen, not as missing. This comes after everything is decided and fits again only what stays.
//! RT: no.

use crate::diagnose::explain::answer_sets::member;
use crate::diagnose::judge::accept::{is_admissible, is_at_bound, strength_is_undetermined};
use crate::diagnose::judge::criterion::{Context, compare, detection_threshold, explained_part};
use crate::diagnose::judge::estimates::within_its_intervals;
use crate::diagnose::judge::flexibility::is_overly_flexible;
use crate::diagnose::judge::numbers::{GREATER_PART, TOUCHDOWN_S};
use crate::diagnose::judge::verdict::{Member, Seen, is_material};
use crate::diagnose::library::candidate_fit::{CandidateFit, SelectedEffect};
use crate::diagnose::library::candidates::Candidate;
use crate::diagnose::library::limited_fit::{refit_without, refitted};
use crate::diagnose::nameless::residual_force::Unlisted;
use crate::diagnose::robustness::held_out::Confirmation;
use crate::diagnose::robustness::instants::gain_beside_instants;
use crate::diagnose::search::basin_hopping::led_out;
use crate::diagnose::search::kept_back_exchange::exchange_by_kept_back;
use crate::diagnose::sentence;
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::white;
use std::collections::BTreeMap;

/// A force without a name, if it matters; else as what was only seen.
#[must_use]
pub fn split_by_interest(rest: Option<Unlisted>, least: f64) -> (Option<Unlisted>, Option<Seen>) {
    match rest {
        Some(Unlisted { share: Some(share), entry, .. }) if !is_material(share, least) => {
            let member = entry.one_of.into_iter().next();
            let at = member.map_or_else(String::new, |m| m.at);
            let sentence = sentence::seen(&format!("a force at {at} that no effect explains"), share, TOO_SMALL);
            (None, Some(Seen { effect: "unlisted".into(), at, share, parameters: BTreeMap::new(), sentence }))
        }
        rest => (rest, None),
    }
}

/// Where nothing is named and what was taken out for its undetermined strength removes a good part of the misfit: something is there.
#[must_use]
pub fn undetermined(added: &[SelectedEffect], seen: &[Seen], least: f64) -> Option<Unlisted> {
    let most = seen.iter().filter(|_| added.is_empty()).max_by(|a, b| a.share.total_cmp(&b.share))?;
    is_material(most.share, least).then(|| Unlisted::at(&most.at, sentence::undetermined(&most.at, most.share)))
}

/// Why an effect that was found is not named.
const TOO_SMALL: &str = "too small to matter";
const REACHES_NOTHING: &str = "with a 95 % interval that reaches nothing";
const AT_ITS_EDGE: &str = "with a number that ran to the edge of its range";
const REFUTED: &str = "refuted by recordings that were not fitted";
const CHANCE: &str = "with no more gain than chance beside the others";
const WITHIN_ITS_ROW: &str = "explained as well by commands, readings and forces that go with rates off by an eighth of a row, and touchdowns by some milliseconds";

/// Where nothing was added: the first of the last round, if it gains what would be worth it and instants within their rows explain all
/// of that (a drive's lag of a tenth of a row).
#[must_use]
pub fn within_its_row(base: &FittedModel, last: &[CandidateFit], context: &Context) -> Option<Seen> {
    let CandidateFit { candidate, hypothesis, gain } = last.first()?;
    let least = detection_threshold(context, candidate.keys.len());
    let only = candidate.only.as_deref();
    let beside = || gain_beside_instants(base, hypothesis, (*gain, least), only, TOUCHDOWN_S);
    if *gain <= least || beside() > least {
        return None;
    }
    let e = hypothesis.rig.effects.len().checked_sub(1)?;
    let of = member(&hypothesis.clone().with_intervals(), e);
    let share = explained_part(base, hypothesis, context);
    let sentence = sentence::seen(&sentence::describe(&of), share, WITHIN_ITS_ROW);
    Some(Seen { effect: of.effect, at: of.at, share, parameters: of.parameters, sentence })
}

/// An effect that is none.
struct Refuted {
    /// Which.
    effect: usize,
    /// What it gains where it was asked.
    gained: f64,
    /// The best model without it.
    without: FittedModel,
    why: &'static str,
}

/// What stays of a search, and what was only seen.
#[derive(Clone, Debug)]
pub struct Kept {
    /// With what stays.
    pub found: FittedModel,
    /// What stays.
    pub added: Vec<SelectedEffect>,
    /// What does not, in the order in which it was taken out.
    pub seen: Vec<Seen>,
    /// True if one of those removed the greater part of what stays without it, and something that stays was sought beside it.
    pub is_astray: bool,
    /// The best models without each of `added`, once they were asked for.
    without: Vec<Option<FittedModel>>,
}

impl Kept {
    /// Everything that was added.
    #[must_use]
    pub fn all(found: FittedModel, added: Vec<SelectedEffect>) -> Self {
        Self { found, added, seen: Vec::new(), is_astray: false, without: Vec::new() }
    }

    /// Nothing, in the place of all that was added; what was seen stays.
    #[must_use]
    pub fn nothing(self, base: &FittedModel) -> Self {
        Self { seen: self.seen, is_astray: self.is_astray, ..Self::all(base.clone(), Vec::new()) }
    }

    /// The same after `earlier` was seen.
    #[must_use]
    pub fn after(self, earlier: Vec<Seen>) -> Self {
        Self { seen: [earlier, self.seen].concat(), ..self }
    }

    /// Takes out, one by one, the effects whose strength is not told from nothing, or a number of which ran to the edge of its range in
    /// the last fits. Of two that share what they explain the first goes, and the other is asked again alone.
    #[must_use]
    pub fn without_undetermined(mut self, base: &FittedModel, context: &Context) -> Self {
        let undetermined = |of: &Self| {
            let known = of.found.clone().with_intervals();
            let why = |e: usize| {
                let reaches_nothing = strength_is_undetermined(&known, e).then_some(REACHES_NOTHING);
                reaches_nothing.or_else(|| is_at_bound(&known.rig.effects[e]).then_some(AT_ITS_EDGE))
            };
            (0..of.added.len()).rev().find_map(|i| Some((i, why(context.given + i)?)))
        };
        while let Some((i, why)) = undetermined(&self) {
            if self.replace_by_determined(i, context) {
                continue;
            }
            let Some(without) = self.refit_without(i, base, context) else { break };
            self.take_out(i, without, why, context);
        }
        self
    }

    /// Takes out, the worst first, the effects that instants within their rows explain as well, and those that recordings kept
    /// back refute: what explains only what it was fitted to is no explanation. An event lives in one recording; that one is
    /// asked, cut at other instants.
    #[must_use]
    pub fn without_refuted(mut self, base: &FittedModel, context: &Context) -> Self {
        let count = self.added.len();
        // What goes for its row is true all the same: what it leaves then hides the others, which were asked beside it.
        let mut is_hidden = false;
        while let Some(Refuted { effect, without, why, .. }) = self.worst_refuted(is_hidden, base, context) {
            is_hidden |= why == WITHIN_ITS_ROW;
            self.take_out(effect, without, why, context);
        }
        self.asked_again(count, base, context)
    }

    /// What stays is determined no more, perhaps, or runs to its edge, when what stood beside it is gone. `count`: how many they were.
    fn asked_again(self, count: usize, base: &FittedModel, context: &Context) -> Self {
        if self.added.len() < count { self.without_undetermined(base, context) } else { self }
    }

    /// Exchanges effects for lookalikes that recordings kept back bear out against them; these are asked as the others were.
    #[must_use]
    pub fn exchanged_by_kept_back(
        mut self,
        base: &FittedModel,
        library: &dyn Fn(&FittedModel) -> Vec<Candidate>,
        context: &Context,
        said: &mut dyn FnMut(&str),
    ) -> Self {
        if !exchange_by_kept_back(&mut self.found, &mut self.added, library, context, said) {
            return self;
        }
        self.without.clear();
        self.without_undetermined(base, context).without_refuted(base, context)
    }

    /// `is_hidden`: chance is not asked.
    fn worst_refuted(&mut self, is_hidden: bool, base: &FittedModel, context: &Context) -> Option<Refuted> {
        self.ask_without(base, context);
        let one = |effect: usize| {
            let (candidate, without) = (&self.added[effect].candidate, self.without[effect].clone()?);
            let numbers = candidate.keys.len();
            let gain = compare(&self.found, &without, context).total;
            let (held_out, floors) = (context.held_out.as_deref(), &context.floors);
            let only = candidate.only.as_deref();
            let with = (&self.found, context.given + effect);
            let told = Confirmation::of_effect(candidate, with, &without, held_out, floors);
            let told = told.filter(|told| told.refutes(numbers, context));
            if let Some(told) = told.filter(|_| !self.replicates_within_its_intervals(effect, &without, context)) {
                return Some(Refuted { effect, gained: told.gained, without, why: REFUTED });
            }
            let least = detection_threshold(context, numbers);
            let beside = gain_beside_instants(&without, &self.found, (gain, least), only, TOUCHDOWN_S);
            let why = if gain > least { WITHIN_ITS_ROW } else { CHANCE };
            let is_none = beside <= least && !(is_hidden && why == CHANCE);
            is_none.then_some(Refuted { effect, gained: beside, without, why })
        };
        (0..self.added.len()).filter_map(one).min_by(|a, b| a.gained.total_cmp(&b.gained))
    }

    /// True if effect `i`, which recordings kept back refute as it was found, replicates there with numbers within its intervals: recordings
    /// without a command tell ratios of forces alone, and not how large the friction is.
    fn replicates_within_its_intervals(&self, i: usize, without: &FittedModel, context: &Context) -> bool {
        let (candidate, e) = (&self.added[i].candidate, context.given + i);
        let (held_out, floors) = (context.held_out.as_deref(), &context.floors);
        let as_sure_as_it_is = || {
            let effect = within_its_intervals(&self.found.clone().with_intervals(), e)?;
            Confirmation::replicated(effect, (&self.found, e), without, held_out, floors)
        };
        candidate.only.is_none()
            && as_sure_as_it_is().is_some_and(|told| told.replicates(candidate.keys.len(), context))
    }

    /// Takes out, the least first, the effects that remove less than `least` of the misfit that is there without them.
    #[must_use]
    pub fn of_interest(mut self, least: f64, base: &FittedModel, context: &Context) -> Self {
        let count = self.added.len();
        loop {
            self.ask_without(base, context);
            let part = |i: usize| {
                let without = self.without[i].clone()?;
                Some((i, explained_part(&without, &self.found, context), without))
            };
            let parts = (0..self.added.len()).filter_map(part);
            let small = parts.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, part, _)| !is_material(*part, least));
            let Some((i, _, without)) = small else {
                return self.asked_again(count, base, context).with_shares(base, context);
            };
            self.take_out(i, without, TOO_SMALL, context);
        }
    }

    /// What each of the effects removes, where others were taken out: of what all of them remove, by what each does as the last one.
    fn with_shares(mut self, base: &FittedModel, context: &Context) -> Self {
        if self.seen.is_empty() || self.added.is_empty() {
            return self;
        }
        self.ask_without(base, context);
        let part = |of: &Option<FittedModel>| of.as_ref().map_or(0.0, |of| explained_part(of, &self.found, context));
        let parts: Vec<f64> = self.without.iter().map(part).collect();
        let (whole, sum) = (explained_part(base, &self.found, context), parts.iter().sum::<f64>());
        if sum > 0.0 {
            self.added.iter_mut().zip(parts).for_each(|(added, part)| added.removed = whole * part / sum);
        }
        self
    }

    /// Puts a rival of effect `i` in its place that gains nearly as much and is determined, if there is one.
    fn replace_by_determined(&mut self, i: usize, context: &Context) -> bool {
        let (e, gain) = (context.given + i, self.added[i].gain);
        let stands = |t: &CandidateFit| {
            let comparable = t.hypothesis.rig.effects.len() == self.found.rig.effects.len();
            comparable
                && t.gain > GREATER_PART * gain
                && is_admissible(&t.hypothesis, e, context)
                && !is_overly_flexible(&self.found, t, context)
                && !strength_is_undetermined(&t.hypothesis.clone().with_intervals(), e)
        };
        let Some(k) = self.added[i].others.iter().position(stands) else { return false };
        let added = &mut self.added[i];
        let CandidateFit { candidate, hypothesis, gain } = added.others.remove(k);
        let candidate = std::mem::replace(&mut added.candidate, candidate);
        added.gain = gain;
        self.found = hypothesis;
        self.without.clear();
        // The undetermined one is no member of the set either: it goes for good.
        added.others.retain(|t| !t.candidate.is_same_as(&candidate));
        true
    }

    /// Fits the models without each of the effects, if what was found has changed since.
    fn ask_without(&mut self, base: &FittedModel, context: &Context) {
        if self.without.len() != self.added.len() {
            self.without = (0..self.added.len()).map(|i| self.refit_without(i, base, context)).collect();
        }
    }

    /// The best model without effect `i`: from where the others stand, and from the base's numbers, as they may have bent to it.
    fn refit_without(&self, i: usize, base: &FittedModel, context: &Context) -> Option<FittedModel> {
        if self.added.len() == 1 {
            return Some(base.clone());
        }
        let beside = refit_without(&self.found, context.given + i, &context.floors);
        let from_base = self.refit_from_base(i, base, context);
        let total = |h: &FittedModel| -> f64 { h.blocks(&self.found.noise).iter().sum() };
        beside.into_iter().chain(from_base).max_by(|a, b| total(a).total_cmp(&total(b)))
    }

    fn refit_from_base(&self, i: usize, base: &FittedModel, context: &Context) -> Option<FittedModel> {
        let mut rig = base.rig.clone();
        rig.sensors.clone_from(&self.found.rig.sensors);
        rig.effects.extend_from_slice(&self.found.rig.effects[context.given..]);
        rig.effects.remove(context.given + i);
        let (problem, start) = base.extended(rig);
        let noise = white(&base.residuals, &context.floors);
        let first = refitted(&self.found, (problem, start), &noise, &context.floors)?;
        refitted(&self.found, (first.problem, first.point), &self.found.noise, &context.floors)
    }

    /// Goes on `without` effect `i`, led out of the false minimum in which an effect that stays would gain nothing.
    fn take_out(&mut self, i: usize, without: FittedModel, why: &str, context: &Context) {
        let is_last = self.added.len() == 1;
        let without = if is_last { without } else { led_out(without, &self.found.noise, &context.floors) };
        let Member { effect, at, parameters, .. } = member(&self.found.clone().with_intervals(), context.given + i);
        let share = explained_part(&without, &self.found, context);
        // Effects stand in the order in which they were added.
        let is_beside_it = i + 1 < self.added.len();
        self.is_astray |= is_beside_it && share > GREATER_PART;
        self.seen.push(Seen {
            sentence: sentence::seen(&self.describe(i, context), share, why),
            effect,
            at,
            share,
            parameters,
        });
        self.added.remove(i);
        self.found = without;
        self.without.clear();
    }

    fn describe(&self, i: usize, context: &Context) -> String {
        sentence::describe(&member(&self.found.clone().with_intervals(), context.given + i))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::worked::{Shown, shown};
    use crate::diagnose::robustness::held_out::HeldOut;
    use crate::identify::experiment::{Experiment, Recording};
    use crate::identify::fit::Limits;
    use crate::identify::noise::Colour;
    use crate::identify::problem::Problem;
    use crate::identify::synthesis::record;
    use crate::model::rig::{Rig, Use};
    use std::sync::Arc;

    const DRAG: &str = "[[effect]]\neffect = \"quadratic_drag\"\nat = \"q1\"\nquadratic = ";
    const LAG: &str = "[[effect]]\neffect = \"actuator_lag\"\nat = \"u\"\ntime_constant = ";
    const DELAY: &str = "[[effect]]\neffect = \"sensor_delay\"\nat = \"y\"\ndelay = ";
    const OFFSET: &str = "[[effect]]\neffect = \"torque_offset\"\nat = \"q1\"\ntorque = ";

    fn free(effect: &str, value: f64, most: f64) -> String {
        let min = if effect == OFFSET { -most } else { 0.0 };
        format!("{effect}{{ value = {value}, min = {min}, max = {most} }}\n")
    }

    #[test]
    fn an_effect_that_removes_less_than_asked_is_seen_and_not_named() {
        let Shown { context, problem } = shown(&format!("{DRAG}0.0004\n"));
        let (base, found) = (problem.fitted("", 20), problem.fitted(&free(DRAG, 0.001, 0.1), 20));
        let share = explained_part(&base, &found, &context);
        assert!((0.02..0.98).contains(&share), "{share}");
        let of_interest = |least: f64| {
            let added = problem.added("quadratic_drag", "q1", 100.0, Vec::new());
            Kept::all(found.clone(), vec![added]).of_interest(least, &base, &context)
        };
        let named = of_interest(share - 0.01);
        assert!(named.added.len() == 1 && named.seen.is_empty() && named.found.rig == found.rig);
        let small = of_interest(share + 0.01);
        assert!(small.added.is_empty() && small.found.rig == base.rig);
        let [seen] = &small.seen[..] else { panic!("{:?}", small.seen) };
        assert!((seen.share - share).abs() < 1e-12 && seen.effect == "quadratic_drag");
        assert!(seen.sentence.contains("too small to matter: drag at q1"), "{}", seen.sentence);
    }

    /// A pendulum that coasts to rest shows ratios of forces alone: begun from 2.8 times all numbers, friction comes out as much too large, and its
    /// interval says so. A driven recording that was kept back speaks little for it as it was found, and bears it out within its
    /// interval; not where there is none.
    #[test]
    fn friction_whose_size_is_not_known_replicates_within_its_interval() {
        let rig = |factor: f64, friction: &str| {
            let free =
                |value: f64| format!("{{ value = {}, min = {}, max = {} }}", factor * value, 0.3 * value, 3.0 * value);
            let text = format!(
                "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = {}\ngravity_nm = {}\n\
                 [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.3\n\
                 [[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\nnoise_std = 0.001\n{friction}",
                free(0.01),
                free(0.4)
            );
            Rig::parse(&text, "rig.toml").unwrap()
        };
        let dry = |value: &str| format!("[[effect]]\neffect = \"coulomb_friction\"\nat = \"q1\"\ncoulomb = {value}\n");
        let recorded = |usage: Use, command: f64, friction: &str| {
            let times: Vec<f64> = (0..400).map(|k| f64::from(k) * 0.01).collect();
            let inputs = vec![times.iter().map(|t| command * libm::sin(5.0 * t)).collect()];
            let blank = Recording { usage, ..Recording::new("a.csv", times, inputs, Vec::new()) };
            let measured = record(&rig(1.0, friction), &blank, &[0.9, 0.0], Some(3)).unwrap().measured;
            Recording { measured, ..blank }
        };
        let coasting = recorded(Use::Fit, 0.0, &dry("0.01"));
        let fitted = |friction: &str| {
            let problem = Problem::new(rig(2.8, friction), vec![coasting.clone()]);
            let (start, limits) = (problem.start(), Limits { iterations: 30, tolerance: 1e-7 });
            FittedModel::fitted(problem, start, &[Colour::white(0.001)], &[1e-5], limits).unwrap()
        };
        let (base, found) = (fitted(""), fitted(&dry("{ value = 0.01, min = 0.0, max = 0.1 }")));
        assert!(found.rig.effects[0].values[0].value > 0.02, "{:?}", found.rig.effects);
        let Shown { context, problem } = shown("");
        let added = problem.added("coulomb_friction", "q1", 1000.0, Vec::new());
        let asked = |friction: &str| {
            let recordings = vec![recorded(Use::Heldout, 1.0, friction)];
            let held_out = HeldOut::of(&Experiment { rig: base.rig.clone(), recordings }, &found.rig).map(Arc::new);
            let context = Context { held_out, given: 0, samples: 400, floors: vec![1e-5], ..context.clone() };
            let of = (&found, 0);
            let as_found =
                Confirmation::of_effect(&added.candidate, of, &base, context.held_out.as_deref(), &context.floors);
            let kept = Kept::all(found.clone(), vec![added.clone()]);
            let Confirmation { promised, gained, .. } = as_found.unwrap();
            (gained / promised, kept.replicates_within_its_intervals(0, &base, &context))
        };
        let (so, replicates) = asked(&dry("0.01"));
        assert!(so < 0.5 && replicates, "{so}");
        let (so, replicates) = asked("");
        assert!(so < 0.0 && !replicates, "{so}");
    }

    #[test]
    fn what_stays_shares_what_all_of_it_removes_when_something_was_taken_out() {
        let Shown { context, problem } = shown(&format!("{DRAG}0.004\n{OFFSET}0.05\n"));
        let (base, found) =
            (problem.fitted("", 20), problem.fitted(&[free(DRAG, 0.001, 0.1), free(OFFSET, 0.001, 1.0)].concat(), 20));
        let added = ["quadratic_drag", "torque_offset"].map(|effect| problem.added(effect, "q1", 1000.0, Vec::new()));
        let removed = |kept: Kept| kept.of_interest(0.01, &base, &context).added.iter().map(|a| a.removed).collect();
        let all = Kept::all(found.clone(), added.to_vec());
        let as_found: Vec<f64> = removed(all.clone());
        assert_eq!(as_found, [0.5, 0.5], "nothing was taken out");
        let (effect, at, sentence) = (String::new(), String::new(), String::new());
        let seen = vec![Seen { effect, at, share: 0.6, parameters: BTreeMap::new(), sentence }];
        let shares: Vec<f64> = removed(all.after(seen));
        let whole = explained_part(&base, &found, &context);
        assert!((shares.iter().sum::<f64>() / whole - 1.0).abs() < 1e-9, "{shares:?} {whole}");
        assert!(shares[1] > shares[0] && shares[0] > 0.0, "the offset is the larger force: {shares:?}");
    }

    /// A lag of 20 ms, for which an offset of nothing was taken.
    fn without_undetermined(rivals: bool) -> Kept {
        let Shown { context, problem } = shown(&format!("{LAG}0.02\n"));
        let (base, found) = (problem.fitted("", 20), problem.fitted(&free(OFFSET, 0.001, 1.0), 20));
        let lag = problem.trial("actuator_lag", "u", &free(LAG, 0.002, 0.2), 25, 900.0);
        let others = if rivals { vec![lag] } else { Vec::new() };
        let added = problem.added("torque_offset", "q1", 1000.0, others);
        Kept::all(found, vec![added]).without_undetermined(&base, &context)
    }

    #[test]
    fn a_strength_that_reaches_nothing_is_no_explanation() {
        let kept = without_undetermined(false);
        assert!(kept.added.is_empty());
        assert!(kept.seen[0].sentence.contains("interval that reaches nothing"), "{:?}", kept.seen);
    }

    #[test]
    fn what_stays_is_asked_again_when_what_stood_beside_it_is_gone() {
        let Shown { context, problem } = shown(&format!("{LAG}0.02\n"));
        let (base, found) = (problem.fitted("", 20), problem.fitted(&free(OFFSET, 0.001, 1.0), 20));
        let stays = |count: usize| {
            let added = problem.added("torque_offset", "q1", 1000.0, Vec::new());
            Kept::all(found.clone(), vec![added]).asked_again(count, &base, &context).added.len()
        };
        assert_eq!((stays(1), stays(2)), (1, 0), "an offset of nothing");
    }

    #[test]
    fn a_rival_that_is_determined_takes_its_place() {
        let kept = without_undetermined(true);
        assert_eq!((kept.added[0].candidate.effect, kept.seen.len()), ("actuator_lag", 0));
    }

    /// A pendulum with `hidden` drag, for which `DRAG` of .004 was taken; the same samples as a recording that was kept back.
    fn asked_elsewhere(hidden: &str) -> Kept {
        let Shown { context, problem } = shown(hidden);
        let base = problem.fitted("", 20);
        let found = problem.fitted(&format!("{DRAG}0.004\n"), 20);
        let kept_back = Recording { usage: Use::Heldout, ..found.problem.recordings[0].clone() };
        let experiment = Experiment { rig: base.rig.clone(), recordings: vec![kept_back] };
        let added = problem.added("quadratic_drag", "q1", 1000.0, Vec::new());
        let held_out = HeldOut::of(&experiment, &found.rig).map(Arc::new);
        Kept::all(found, vec![added]).without_refuted(&base, &Context { held_out, ..context })
    }

    #[test]
    fn an_effect_that_spoils_what_was_not_fitted_is_not_named_and_one_that_holds_there_is() {
        let refuted = asked_elsewhere("");
        assert!(refuted.added.is_empty());
        assert!(refuted.seen[0].sentence.contains("refuted by recordings that were not fitted"), "{:?}", refuted.seen);
        assert_eq!(asked_elsewhere(&format!("{DRAG}0.004\n")).added.len(), 1);
    }

    /// An offset, and readings that are late: beside that misfit the offset alone gains no more than chance, and what a delay that went
    /// for its row hides is not asked for chance.
    #[test]
    fn what_a_delay_within_its_row_hides_is_not_asked_for_chance() {
        let Shown { context, problem } = shown(&format!("{DELAY}0.004\n{OFFSET}0.001\n"));
        let (base, alone) = (problem.fitted("", 20), problem.fitted(&free(OFFSET, 0.001, 0.1), 20));
        let gain = compare(&alone, &base, &context).total;
        assert!(gain > 0.0 && gain < detection_threshold(&context, 1), "{gain}");
        let refuted = |is_hidden: bool| {
            let added = vec![problem.added("torque_offset", "q1", 1000.0, Vec::new())];
            Kept::all(alone.clone(), added).worst_refuted(is_hidden, &base, &context).map(|refuted| refuted.why)
        };
        assert_eq!((refuted(false), refuted(true)), (Some(CHANCE), None));
    }

    #[test]
    fn a_delay_within_its_row_goes_and_what_stands_beside_it_stays() {
        let Shown { context, problem } = shown(&format!("{DELAY}0.001\n{OFFSET}0.001\n"));
        let base = problem.fitted("", 20);
        let found = problem.fitted(&[free(DELAY, 0.0005, 0.2), free(OFFSET, 0.001, 0.1)].concat(), 20);
        let added = [("sensor_delay", "y"), ("torque_offset", "q1")]
            .map(|(effect, at)| problem.added(effect, at, 1000.0, Vec::new()));
        let kept = Kept::all(found, added.to_vec()).without_refuted(&base, &context);
        assert_eq!(kept.added.iter().map(|a| a.candidate.effect).collect::<Vec<_>>(), ["torque_offset"]);
        let [seen] = &kept.seen[..] else { panic!("{:?}", kept.seen) };
        assert!(seen.effect == "sensor_delay" && seen.sentence.contains("of a row"), "{}", seen.sentence);
    }

    #[test]
    fn a_delay_within_an_eighth_of_a_row_is_seen_where_nothing_was_added_and_a_longer_one_is_no_matter_of_instants() {
        let told = |delay_s: f64| {
            let Shown { context, problem } = shown(&format!("{DELAY}{delay_s}\n"));
            let base = problem.fitted("", 20);
            let mut trial = problem.trial("sensor_delay", "y", &free(DELAY, 0.0005, 0.2), 25, 0.0);
            trial.gain = compare(&trial.hypothesis, &base, &context).total;
            within_its_row(&base, &[trial], &context)
        };
        let seen = told(0.001).unwrap();
        assert!(seen.effect == "sensor_delay" && seen.sentence.contains("of a row"), "{}", seen.sentence);
        assert!((seen.parameters["delay"].value / 0.001 - 1.0).abs() < 0.2);
        assert!(told(0.03).is_none() && told(0.0).is_none());
    }

    #[test]
    fn what_came_after_an_effect_that_is_taken_out_was_sought_beside_it() {
        let (drag, offset) = (free(DRAG, 0.001, 0.1), free(OFFSET, 0.02, 0.2));
        let Shown { context, problem } = shown(&format!("{DRAG}0.01\n{OFFSET}0.02\n"));
        let without_drag = |order: [(&'static str, &String); 2]| {
            let found = problem.fitted(&order.map(|(_, text)| text.clone()).concat(), 20);
            let added = order.map(|(effect, _)| problem.added(effect, "q1", 1000.0, Vec::new()));
            let drag = added.iter().position(|a| a.candidate.effect == "quadratic_drag").unwrap();
            let mut kept = Kept::all(found, added.to_vec());
            kept.take_out(drag, problem.fitted(&offset, 20), REFUTED, &context);
            assert!(kept.seen[0].share > GREATER_PART, "{}", kept.seen[0].share);
            kept.is_astray
        };
        assert!(without_drag([("quadratic_drag", &drag), ("torque_offset", &offset)]));
        assert!(!without_drag([("torque_offset", &offset), ("quadratic_drag", &drag)]));
    }

    #[test]
    fn a_nameless_force_is_small_too() {
        let mut force = Unlisted::at("q1", "something".into());
        assert!(split_by_interest(Some(force.clone()), 0.12).0.is_some(), "of unknown share");
        force.share = Some(0.05);
        let (rest, seen) = split_by_interest(Some(force.clone()), 0.12);
        assert!(rest.is_none() && seen.is_some_and(|s| s.effect == "unlisted" && s.at == "q1"));
        assert!(split_by_interest(Some(force), 0.04).0.is_some());
    }
}
