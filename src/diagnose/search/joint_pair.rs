//! Two effects that hide each other, added together.
//!
//! One at a time they look like nothing that is true (an offset beside friction that falls with speed), or like something else (an
//! eccentric encoder and a spring like a ripple): who is first takes what the other did, and nothing finds back. Either one of the best of
//! a round that is not believed alone finds the other beside it ([`add_jointly`]), or both are sought together ([`add_together`]).
//! Both together must leave but noise.
//! RT: no.

use crate::diagnose::judge::accept::{is_accepted, is_admissible};
use crate::diagnose::judge::criterion::{Context, compare, detection_threshold};
use crate::diagnose::judge::flexibility::is_local_here;
use crate::diagnose::judge::numbers::QUARTER;
use crate::diagnose::judge::simplicity::order_by_penalised_gain;
use crate::diagnose::library::candidate_fit::{CandidateFit, REFIT, TO_THE_END, with_effect};
use crate::diagnose::library::candidates::Candidate;
use crate::diagnose::library::limited_fit::refit_without;
use crate::diagnose::robustness::cross_validation::CrossValidation;
use crate::diagnose::search::budget::{MOST_EFFORT, allowance, is_spent, within};
use crate::diagnose::search::converge_rivals::fitted_in_its_place;
use crate::diagnose::search::round::{Asked, FITTED, Start, round, tell};
use crate::diagnose::search::runners_up::{COMPANIONS, LEADS};
use crate::diagnose::search::screening::{RankedPair, screened_pairs};
use crate::diagnose::search::subsample::subsampled;
use crate::identify::base_fit::anew;
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::{is_misfit, samples, white};
use rayon::prelude::*;

/// An effect, then another on top of it, each with what else may stand in its place.
pub(super) type Pair = [(CandidateFit, Vec<CandidateFit>); 2];

/// What a pair is sought on: the base, the library on top of it or of a leader, and the base without each recording (`None`: there is but
/// one window).
pub(super) struct Sought<'s> {
    pub(super) base: &'s FittedModel,
    pub(super) library: &'s dyn Fn(&FittedModel) -> Vec<Candidate>,
    pub(super) left_out: Option<&'s CrossValidation>,
    pub(super) context: &'s Context,
}

/// A leader of the base's last round `last` that does not hold on recordings left out, and the effect that makes it hold.
pub(super) fn add_jointly(of: &Sought<'_>, last: &[CandidateFit], said: &mut dyn FnMut(&str)) -> Option<Pair> {
    let Sought { base, context, .. } = of;
    let mut leaders: Vec<&CandidateFit> = Vec::new();
    for trial in last.iter().filter(|t| t.gain > detection_threshold(context, t.candidate.keys.len())) {
        let e = trial.hypothesis.rig.effects.len() - 1;
        let is_new = leaders.iter().all(|l| l.candidate.effect != trial.candidate.effect);
        if is_new && !is_local_here(base, &trial.candidate) && is_admissible(&trial.hypothesis, e, context) {
            leaders.push(trial);
        }
    }
    let most = leaders.first().map_or(0.0, |l| l.gain);
    leaders.retain(|l| l.gain > LEADS * most);
    // Who has few numbers makes up for little of what the other does, and is soon asked.
    leaders.sort_by_key(|l| l.candidate.keys.iter().filter(|k| k.max > k.min).count());
    let is_early = |_: &&&CandidateFit| base.problem.effort.spent() <= MOST_EFFORT / 3 * 2;
    let mut leaders = leaders.iter().take(COMPANIONS).take_while(is_early);
    let [(leader, mut rivals), second] = leaders.find_map(|leader| of.beside(leader, &[], said))?;
    let is_new = |t: &&CandidateFit| {
        let is = |other: &CandidateFit| t.candidate.is_same_as(&other.candidate);
        !is(&leader) && !is(&second.0) && !rivals.iter().any(is)
    };
    let rest: Vec<CandidateFit> = last.iter().filter(is_new).cloned().collect();
    rivals.extend(rest);
    Some([(leader, rivals), second])
}

/// Of the pairs of which one step promises most, and more than `found` brings, those that leave but noise; of these the best one, if it is
/// clearly better than `found`, the best fit so far, and one of the two is accepted beside the other.
pub(super) fn add_together(of: &Sought<'_>, found: &FittedModel, said: &mut dyn FnMut(&str)) -> Option<Pair> {
    let Sought { base, context, .. } = of;
    let both = of.fitted_pair(found)?;
    let ahead = compare(&both.hypothesis, found, context).total;
    let names = both.candidates.each_ref().map(|c| format!("{}@{}", c.effect, c.at));
    said(&format!("   {} leave but noise, {ahead:.0} ahead of what was found", names.join(" and ")));
    if ahead <= detection_threshold(context, 0) {
        return None;
    }
    let first = base.rig.effects.len();
    let in_order = |leads: usize| {
        let other = 1 - leads;
        let now = refit_without(&both.hypothesis, first + other, &context.floors)?;
        let gain = compare(&now, base, context).total;
        let leader = CandidateFit { candidate: both.candidates[leads].clone(), hypothesis: now, gain };
        let mut rig = both.hypothesis.rig.clone();
        rig.effects.swap(first + leads, first);
        let start = Start { candidate: both.candidates[other].clone(), from: both.hypothesis.clone(), rig };
        Some((leader, start))
    };
    let mut orders = [0, 1].into_iter().filter_map(in_order);
    orders.find_map(|(leader, start)| of.beside(&leader, &[start], said))
}

/// Two candidates, fitted together.
struct Both {
    candidates: [Candidate; 2],
    hypothesis: FittedModel,
}

impl Sought<'_> {
    /// The best pair that leaves but noise, of those of which one step promises most, and more than `found` brings.
    fn fitted_pair(&self, found: &FittedModel) -> Option<Both> {
        let Sought { base, library, context, .. } = *self;
        let library = library(base);
        let thin = subsampled(base, &library, context);
        let thinner = thin.as_ref().map(|t| t.thinner(&library));
        let look = thinner.as_ref().map_or(base, |t| &t.hypothesis);
        let noise = white(&look.residuals, &context.floors);
        let pairs = screened_pairs(look, &library, &noise);
        // A look at fewer samples promises as many times less.
        let part = samples(&look.residuals, &context.floors) as f64 / context.samples.max(1) as f64;
        let gain = |h: &FittedModel| -> f64 { h.blocks(&noise).iter().sum() };
        let least = part * (gain(found) - gain(base) + detection_threshold(context, 0));
        let pairs: Vec<_> = pairs.into_iter().take_while(|(_, promise)| *promise > least).take(FITTED).collect();
        let (few, rule) = thin.as_ref().map_or((base, context), |t| (&t.hypothesis, &t.context));
        let noise = white(&few.residuals, &rule.floors);
        let one = |(pair, _): &RankedPair<'_>| {
            let rig = pair.iter().fold(few.rig.clone(), |rig, (candidate, start)| with_effect(&rig, candidate, start));
            let (problem, point) = few.extended(rig);
            let hypothesis = within(allowance(base), base, problem, point, (&noise, REFIT), rule)?;
            let leaves_noise = !is_misfit(&hypothesis.residuals, &rule.floors);
            leaves_noise.then(|| Both { candidates: pair.map(|(candidate, _)| candidate.clone()), hypothesis })
        };
        let fits: Vec<Both> = pairs.par_iter().filter_map(one).collect();
        let best = fits.into_iter().max_by(|a, b| a.hypothesis.likelihood.total_cmp(&b.hypothesis.likelihood))?;
        // Two that hide each other lie along a ridge, on which a fit among many stops early.
        let fresh = anew(&base.problem, &best.hypothesis.rig, &context.floors)?;
        let noise = white(&fresh.residuals, &context.floors);
        let hypothesis = fresh.polished(&noise, &context.floors, TO_THE_END).unwrap_or(fresh);
        (!is_misfit(&hypothesis.residuals, &context.floors)).then_some(Both { hypothesis, ..best })
    }

    /// `leader` and what leaves but noise on top of it, if that is accepted there and both hold on recordings left out. `near`: what is
    /// fitted whatever one step promises.
    fn beside(&self, leader: &CandidateFit, near: &[Start], said: &mut dyn FnMut(&str)) -> Option<Pair> {
        let Sought { left_out, context, .. } = *self;
        let now = &leader.hypothesis;
        if is_spent(now) {
            return None;
        }
        said(&format!("   with {}@{} for company", leader.candidate.effect, leader.candidate.at));
        let library = (self.library)(now);
        let mut seconds = round(now, (now, Vec::new()), Asked { library: &library, near }, context, &mut *said);
        tell(&seconds, context, said);
        order_by_penalised_gain(&mut seconds, context);
        let second = seconds.first().filter(|s| !is_misfit(&s.hypothesis.residuals, &context.floors))?;
        let kept = left_out.map(|l| l.cross_validated_gain_ratio(&second.hypothesis, &context.floors).unwrap_or(0.0));
        if let Some(kept) = kept {
            let name = second.candidate.effect;
            said(&format!("   with {name} both keep {kept:.2} of their gain on recordings left out"));
        }
        let alone = || {
            CrossValidation::of(now, &context.floors)?.cross_validated_gain_ratio(&second.hypothesis, &context.floors)
        };
        if kept.is_some_and(|kept| kept < QUARTER)
            || !is_accepted(now, (second, &seconds), leader.gain, alone, context, said)
        {
            return None;
        }
        let second = seconds.remove(0);
        let e = self.base.rig.effects.len();
        let place = (leader.gain, e);
        let alike = library.iter().filter(|c| c.looks_like(&leader.candidate));
        let in_its_place = |c: &Candidate| fitted_in_its_place(&second.hypothesis, c, place, context);
        let rivals = alike.filter_map(in_its_place).collect();
        Some([(leader.clone(), rivals), (second, seconds)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::worked::{Shown, shown};
    use crate::diagnose::library::candidates::Key;

    /// Drag and an offset, for which a lag was taken: a pair that explains it, and is the better one, takes its place.
    #[test]
    fn two_that_explain_it_together_are_found_where_one_leaves_misfit() {
        let drag = "[[effect]]\neffect = \"quadratic_drag\"\nat = \"q1\"\nquadratic = ";
        let offset = "[[effect]]\neffect = \"torque_offset\"\nat = \"q1\"\ntorque = ";
        let lag = "[[effect]]\neffect = \"actuator_lag\"\nat = \"u\"\ntime_constant = ";
        let Shown { context, problem } = shown(&format!("{drag}0.004\n{offset}0.05\n"));
        let (base, found) =
            (problem.fitted("", 20), problem.fitted(&format!("{lag}{{ value = 0.001, min = 0.0, max = 0.2 }}\n"), 20));
        let candidate = |effect, at, (name, min, max), start: f64| Candidate {
            keys: vec![Key { name, min, max, log: false }],
            starts: vec![vec![start]],
            ..problem.candidate(effect, at)
        };
        let all = [
            candidate("actuator_lag", "u", ("time_constant", 0.0, 0.2), 0.001),
            candidate("torque_offset", "q1", ("torque", -1.0, 1.0), 0.0),
            candidate("coulomb_friction", "q1", ("coulomb", 0.0, 0.2), 0.001),
            candidate("quadratic_drag", "q1", ("quadratic", 0.0, 0.1), 0.001),
        ];
        let library = |now: &FittedModel| -> Vec<Candidate> {
            let is_there = |c: &Candidate| now.rig.effects.iter().any(|e| e.kind.id() == c.effect);
            all.iter().filter(|c| !is_there(c)).cloned().collect()
        };
        let of = |library| Sought { base: &base, library, left_out: None, context: &context };
        let pair = add_together(&of(&library), &found, &mut |_| {}).unwrap();
        let mut names = pair.each_ref().map(|(trial, _)| trial.candidate.effect);
        names.sort_unstable();
        assert_eq!(names, ["quadratic_drag", "torque_offset"]);
        let last = &pair[1].0.hypothesis;
        let value = |effect: &str| last.rig.effects.iter().find(|e| e.kind.id() == effect).unwrap().values[0].value;
        let near = |effect: &str, truth: f64| (value(effect) / truth - 1.0).abs() < 0.1;
        assert!(near("quadratic_drag", 0.004) && near("torque_offset", 0.05), "{:?}", last.rig.effects);
        // Not where what was found is no worse, nor where one of the two is not in the library.
        assert!(add_together(&of(&library), last, &mut |_| {}).is_none());
        let less = |now: &FittedModel| library(now).into_iter().filter(|c| c.effect != "torque_offset").collect();
        assert!(add_together(&of(&less), &found, &mut |_| {}).is_none());
    }
}
