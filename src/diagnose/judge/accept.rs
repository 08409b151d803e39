//! Which candidate is accepted: it gains enough, significantly, is found rather than cut off, and holds on recordings that it was
//! not fitted to.
//!
//! RT: no.

use super::continuity::is_externally_driven;
use super::criterion::{Context, compare, detection_threshold};
use super::estimates::estimates;
use super::evidence::{Comparison, Evidence};
use super::flexibility::is_overly_flexible;
use super::numbers::{DEVIATIONS, FORM, GREATER_PART, LEAST_SHARE, QUARTER, ROUGH_FORM, TOUCHDOWN_S};
use crate::diagnose::library::candidate_fit::CandidateFit;
use crate::diagnose::library::candidates::Candidate;
use crate::diagnose::robustness::held_out::Confirmation;
use crate::diagnose::robustness::instants::gain_beside_instants;
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::{Difference, is_misfit};
use crate::model::effect::{EffectKind, Key, Role};
use crate::model::resonance::resonance_hz;
use crate::model::rig::{Effect, Rig, Scope, Slot, Value};

/// True if a bristle is in the rig: what damps it no contract or catalogue tells, and another damping leaves a tenth (seen: a
/// sensor scale of .74 made up for it).
fn has_bristle(now: &FittedModel) -> bool {
    now.rig.effects.iter().any(|effect| effect.kind == EffectKind::Presliding)
}

/// What a candidate that gained enough did not stand, as the report tells it.
mod failed {
    pub(super) const TOO_LITTLE: &str = "it gains too little where it was asked last";
    pub(super) const SCATTERED: &str =
        "it gains on some stretches of the recordings and loses on others, as chance does";
    pub(super) const OF_FORM: &str =
        "beside what was found before it the gain is so small that the imperfect form of that may be all it explains";
    pub(super) const BESIDE_MISFIT: &str = "the gain is small beside the smooth misfit that it leaves";
    pub(super) const FITS_ANYTHING: &str =
        "it fits a piece of any smooth misfit, and recordings kept back do not bear it out";
    pub(super) const NOTHING: &str = "its strength was fitted to nothing";
    pub(super) const NOT_FOUND: &str =
        "a number of it ran to the edge of its range, or it rings only where something else shakes it";
    pub(super) const ONLY_LATE: &str =
        "readings and commands, whose instants are known only to a part of a row, explain it as well";
    pub(super) const REACHES_NOTHING: &str = "its 95 % interval reaches nothing";
    pub(super) const REFUTED: &str = "its recording, cut into other windows, speaks against it";
    pub(super) const NOT_KEPT: &str =
        "it keeps less than a quarter of its gain on recordings, or stretches, left out of the fit";
}

/// Why `trial` does not explain enough to be accepted; none if it does.
fn explains_too_little(
    base: &FittedModel,
    trial: &CandidateFit,
    explained_before: f64,
    context: &Context,
) -> Option<&'static str> {
    let sure = compare(&trial.hypothesis, base, context);
    // A second effect must not live off the first one's imperfect form.
    let misfit = is_misfit(&trial.hypothesis.residuals, &context.floors);
    let inexact = misfit || has_bristle(base);
    let least = if inexact { ROUGH_FORM } else { FORM };
    let last = || trial.hypothesis.rig.effects.len().checked_sub(1);
    if trial.gain <= detection_threshold(context, trial.candidate.keys.len()) {
        Some(failed::TOO_LITTLE)
    } else if !is_significant(&trial.candidate, sure) {
        Some(failed::SCATTERED)
    } else if trial.gain < least * explained_before {
        Some(failed::OF_FORM)
    } else if misfit && trial.gain <= LEAST_SHARE * context.samples as f64 {
        // Against smooth misfit chance has no measure: what matters to a user has.
        Some(failed::BESIDE_MISFIT)
    } else if is_overly_flexible(base, trial, context) {
        Some(failed::FITS_ANYTHING)
    } else if is_at_zero(trial) {
        Some(failed::NOTHING)
    } else if last().is_some_and(|e| !is_admissible(&trial.hypothesis, e, context)) {
        Some(failed::NOT_FOUND)
    } else {
        None
    }
}

/// True if effect `e` of `of` is one that was found: no number of it at the edge of its range, and no mode that something else
/// shakes.
#[must_use]
pub fn is_admissible(of: &FittedModel, e: usize, context: &Context) -> bool {
    !of.rig.effects.get(e).is_some_and(is_at_bound) && !is_externally_driven(of, e, &context.floors)
}

/// True if the gain is no chance of which blocks of the recordings there are. A single event is in one of them: all of its
/// gain, or none, is in a sample of blocks, which says nothing; its own recording is asked instead ([`Confirmation`]).
pub fn is_significant(candidate: &Candidate, sure: Difference) -> bool {
    sure.low > 0.0 || candidate.only.is_some() && sure.total > 0.0
}

/// A number at the edge of the range in which it was sought was not found (the design's "no bound hit"): a memory as long as a
/// window stands for the start of each window. Of what rings all numbers count: a resonance at the edge stands for a slower or faster
/// motion that is none, one without damping for a vibration from elsewhere, one that is damped as much as may be, or whose rotor
/// weighs nothing, for a lag. Nothing at all is no such edge.
#[must_use]
pub fn is_at_bound(effect: &Effect) -> bool {
    let hits = |value: &Value| {
        let at = |bound: f64| bound != 0.0 && (value.value / bound - 1.0).abs() < FORM;
        value.bounds.is_some_and(|b| at(b.min) || at(b.max))
    };
    let rings = effect.get("damping").is_some();
    let counts = |key: &Key| rings || matches!(key.role, Role::Strength(_));
    effect.kind.keys().iter().zip(&effect.values).any(|(key, value)| counts(key) && hits(value))
}

/// True if `trial` explains enough and holds on recordings that it was not fitted to. `all`: the trials of its round; `kept`: asked
/// last, the part of its gain that it keeps when each recording, or each stretch of the only one, is predicted from the others
/// (`None`: there is but one window).
pub fn is_accepted(
    now: &FittedModel,
    (trial, all): (&CandidateFit, &[CandidateFit]),
    explained: f64,
    kept: impl FnOnce() -> Option<f64>,
    context: &Context,
    said: &mut dyn FnMut(&str),
) -> bool {
    let failed = failed_test(now, trial, explained, kept, context, said);
    let by_rule = failed.is_none();
    let evidence = Evidence::over(now, &trial.hypothesis, trial.gain, all.len());
    context.ledger.note(Comparison {
        question: "accept",
        effect: trial.candidate.effect.to_owned(),
        at: trial.candidate.at.clone(),
        against: None,
        gain: trial.gain,
        by_rule,
        failed,
        by_evidence: evidence.total() > 0.0,
        evidence,
    });
    by_rule
}

/// The first test that `trial` does not stand; none if it stands all.
fn failed_test(
    now: &FittedModel,
    trial: &CandidateFit,
    explained: f64,
    kept: impl FnOnce() -> Option<f64>,
    context: &Context,
    said: &mut dyn FnMut(&str),
) -> Option<&'static str> {
    let too_little = explains_too_little(now, trial, explained, context);
    if too_little.is_some() {
        return too_little;
    }
    let effect = trial.candidate.effect;
    let threshold = detection_threshold(context, trial.candidate.keys.len());
    let only = trial.candidate.only.as_deref();
    let beside = gain_beside_instants(now, &trial.hypothesis, (trial.gain, threshold), only, TOUCHDOWN_S);
    said(&format!("   {effect} gains {:.0}, {beside:.0} beside instants that are known to half a step", trial.gain));
    if beside <= threshold {
        return Some(failed::ONLY_LATE);
    }
    let misfit = is_misfit(&trial.hypothesis.residuals, &context.floors);
    let last = trial.hypothesis.rig.effects.len().saturating_sub(1);
    // Where but noise is left, a strength that a base parameter shares is uncertain; that it is none is not.
    if misfit && strength_is_undetermined(&trial.hypothesis.clone().with_intervals(), last) {
        said(&format!("   {effect} is not two deviations from nothing"));
        return Some(failed::REACHES_NOTHING);
    }
    // What lasts is asked in company, at the end: while another effect is missing the first bends to the recordings it is fitted to.
    let event = trial.candidate.only.as_ref();
    let (held_out, floors) = (context.held_out.as_deref(), &context.floors);
    let of_event = || Confirmation::of_candidate(&trial.candidate, &trial.hypothesis, now, held_out, floors);
    let told = event.and_then(|_| of_event());
    if let Some(told) = told {
        said(&format!("   {effect}, in its recording cut elsewhere: {told}"));
        if told.refutes(trial.candidate.keys.len(), context) {
            return Some(failed::REFUTED);
        }
    }
    let kept = kept()?;
    said(&format!("   {effect} keeps {kept:.2} of its gain on recordings left out"));
    if kept >= QUARTER || trial.candidate.only.is_some() {
        return None;
    }
    // What few recordings say of one another, when one is left out, is less than what those say that no fit saw.
    let told = Confirmation::on_kept_back(&trial.hypothesis, now, held_out, floors);
    let is_borne_out = told.is_some_and(|told| {
        said(&format!("   {effect}, on recordings kept back: {told}"));
        told.bears_out(context)
    });
    (!is_borne_out).then_some(failed::NOT_KEPT)
}

/// True if the strength of effect `e` is not two deviations from nothing, as far as the residual tells: such a number is no
/// explanation. What instants within a row make of it is asked apart ([`gain_beside_instants`]). `of`: with intervals. What is absent at infinity (a stiffness, a limit) is not asked: stiffness, damping and rotor
/// inertia share a scale that the recordings may leave open (195 ± 124) where the effect itself is beyond doubt.
#[must_use]
pub fn strength_is_undetermined(of: &FittedModel, e: usize) -> bool {
    let Some(effect) = of.rig.effects.get(e) else { return false };
    let known = estimates(of);
    let unsure = |(k, key): (usize, &Key)| {
        let Role::Strength(nothing) = key.role else { return false };
        let fitted = of.problem.theta.index_of_slot(Slot::Effect(Scope::Rig, e, k)).map(|i| known[i].1);
        fitted.is_some_and(|x| (x.value - nothing).abs() < DEVIATIONS * x.std)
    };
    effect.kind.keys().iter().enumerate().any(unsure)
}

/// True if the fit left the candidate's strength at nothing.
fn is_at_zero(trial: &CandidateFit) -> bool {
    let Some(effect) = trial.hypothesis.rig.effects.last() else { return true };
    effect.values.iter().all(|v| v.value == 0.0)
}

/// True if one of the effects beyond the first `given` is a spring so soft that within a window it moves nothing: the link then
/// coasts from its fitted start, which explains any slow motion and no force.
#[must_use]
pub fn has_slack_spring(rig: &Rig, given: usize, window_s: f64) -> bool {
    let mut hz = rig.effects.iter().skip(given).filter_map(|effect| resonance_hz(rig, effect));
    hz.any(|hz| hz * window_s < GREATER_PART)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_memory_at_the_end_of_its_range_was_not_found_but_none_is_none() {
        let lag = |x: f64| Effect::new(EffectKind::SensorLag, "q", vec![Value::free(x, 0.0, 0.01)]);
        assert!(is_at_bound(&lag(0.01)) && !is_at_bound(&lag(0.006)) && !is_at_bound(&lag(0.0)));
    }

    #[test]
    fn an_elastic_joint_that_rings_undamped_or_does_not_ring_or_has_no_rotor_was_not_found() {
        let elastic = |damping: f64, rotor: f64| {
            let values = [(9.0, 1e-3, 1e3), (damping, 1e-6, 0.5), (rotor, 1e-4, 0.1)];
            let free = values.map(|(value, min, max)| Value::free(value, min, max));
            is_at_bound(&Effect::new(EffectKind::JointElasticity, "q1", free.to_vec()))
        };
        assert!(elastic(1e-6, 0.003) && elastic(0.5, 0.003) && elastic(0.01, 1e-4) && !elastic(0.01, 0.003));
    }

    #[test]
    fn a_spring_that_moves_nothing_within_a_window_is_slack_wherever_it_stands() {
        let rig = |stiffness: f64| {
            let text = format!(
                "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = 0.01\ngravity_nm = 0.4\n\
                 [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.3\n[[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\n\
                 [[effect]]\neffect = \"joint_elasticity\"\nat = \"q1\"\nstiffness = {stiffness}\ndamping = 0.0001\n\
                 rotor_inertia = 0.004\n\
                 [[effect]]\neffect = \"actuator_lag\"\nat = \"u\"\ntime_constant = 0.002\n"
            );
            Rig::parse(&text, "rig.toml").unwrap()
        };
        // sqrt(k (1 / 0.004 + 1 / 0.006)) / 2 pi: 0.18 Hz and 18 Hz.
        assert!(has_slack_spring(&rig(0.003), 0, 2.0) && !has_slack_spring(&rig(30.0), 0, 2.0));
        assert!(!has_slack_spring(&rig(0.003), 0, 4.0), "a longer window shows it");
        assert!(!has_slack_spring(&rig(0.003), 1, 2.0), "what was given is not asked");
    }
}
