//! What the data do not tell apart stands together: which rivals are in the set of an effect, and with what weight.
//!
//! RT: no.

use super::accept::is_at_bound;
use super::criterion::{Context, compare};
use super::evidence::{Comparison, Evidence};
use super::numbers::{CLEAR_LEAD, DEVIATIONS, FORM, GREATER_PART, LEAST_GAIN, NEARLY_ALL, ROUGH_FORM};
use super::simplicity::LIMITS_OF;
use crate::diagnose::library::candidate_fit::CandidateFit;
use crate::diagnose::robustness::held_out::Confirmation;
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::{Difference, is_misfit};
use crate::model::rig::Effect;

/// Weight of `trial` against 1 of the winner, if the data do not tell it from the effect at `place` of the winner, which gained
/// `gain`.
#[must_use]
pub fn weight_in_set(
    winner: &FittedModel,
    trial: &CandidateFit,
    (place, gain): (usize, f64),
    context: &Context,
) -> Option<f64> {
    let lead = compare(winner, &trial.hypothesis, context);
    let exact = !is_misfit(&winner.residuals, &context.floors);
    let events = [winner, &trial.hypothesis].iter().all(|h| h.rig.effects.get(place).is_some_and(is_event));
    // A trial of an earlier round has fewer effects than the winner: it says nothing in this company.
    // One number more and no better: the simpler one says the same.
    let mine = winner.rig.effects[place].kind;
    let more_of_it = exact && LIMITS_OF.contains(&(mine.id(), trial.candidate.effect)) && lead.total < -CLEAR_LEAD;
    let simple = trial.candidate.keys.len() <= mine.keys().len() || more_of_it;
    let comparable = simple && trial.hypothesis.rig.effects.len() == winner.rig.effects.len();
    // A memory as long as its range allows stands for the start of each window, in the winner's place as in its own.
    let cut_off =
        trial.candidate.has_inner_states() && trial.hypothesis.rig.effects.get(place).is_some_and(is_at_bound);
    let is_member =
        is_inseparable(lead, gain, exact, events) && comparable && !cut_off && trial.gain > GREATER_PART * gain;
    if trial.hypothesis.rig.effects.len() == winner.rig.effects.len() {
        let evidence = Evidence::over(&trial.hypothesis, winner, lead.total, 0);
        context.ledger.note(Comparison {
            question: "member",
            effect: trial.candidate.effect.to_owned(),
            at: trial.candidate.at.clone(),
            against: Some(format!("{}@{}", mine.id(), winner.rig.effects[place].at)),
            gain: -lead.total,
            by_rule: is_member,
            failed: None,
            by_evidence: evidence.is_in_window(),
            evidence,
        });
    }
    let (held_out, floors) = (context.held_out.as_deref(), &context.floors);
    let told = || Confirmation::of_candidate(&trial.candidate, winner, &trial.hypothesis, held_out, floors);
    let is_behind_elsewhere = is_member && told().is_some_and(|told| told.bears_out(context));
    (is_member && !is_behind_elsewhere).then(|| weight(lead, gain))
}

/// True if a winner whose effect gained `gain` is not told from a rival by its `lead`. `exact`: it leaves but noise; `events`: both
/// are single events, which are in one block, all of them or none: samples of blocks say nothing of what is between them.
fn is_inseparable(lead: Difference, gain: f64, exact: bool, events: bool) -> bool {
    let form = if exact { (FORM * gain).min(LEAST_GAIN) } else { ROUGH_FORM * gain };
    let chance = if events && exact { LEAST_GAIN } else { DEVIATIONS * lead.std };
    lead.total < chance || lead.total < form
}

/// True for an effect that acts in one recording alone: a push, a jump.
fn is_event(effect: &Effect) -> bool {
    !effect.recordings.is_empty()
}

/// Weight of a rival against 1 of the winner: how often it would win if the blocks were drawn again.
fn weight(lead: Difference, gain: f64) -> f64 {
    let scale = lead.std.max(FORM * gain).max(1.0);
    libm::exp(-lead.total.max(0.0) / scale).clamp(1.0 - NEARLY_ALL, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lead(total: f64, std: f64) -> Difference {
        Difference { total, low: total - 2.0 * std, high: total + 2.0 * std, std }
    }

    #[test]
    fn rivals_within_two_deviations_or_within_the_error_of_form_are_not_told_apart() {
        assert!(is_inseparable(lead(10.0, 6.0), 100.0, true, false), "two deviations");
        assert!(!is_inseparable(lead(10.0, 4.0), 100.0, true, false));
        assert!(is_inseparable(lead(10.0, 1.0), 1000.0, true, false), "2 % of the gain");
        assert!(!is_inseparable(lead(70.0, 1.0), 1e5, true, false), "but not more than 60 where but noise is left");
        assert!(is_inseparable(lead(100.0, 1.0), 1000.0, false, false), "15 % where misfit stays");
        assert!(is_inseparable(lead(25.0, 1.0), 100.0, true, true), "events are in one block");
    }

    #[test]
    fn who_is_ahead_weighs_full_and_who_is_behind_less_but_something() {
        assert!((weight(lead(-5.0, 3.0), 100.0) - 1.0).abs() < 1e-12);
        assert!((weight(lead(3.0, 3.0), 100.0) - libm::exp(-1.0)).abs() < 1e-12);
        assert!((weight(lead(1e4, 3.0), 100.0) - (1.0 - NEARLY_ALL)).abs() < 1e-12);
    }
}
