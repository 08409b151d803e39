//! What no effect of the library explains: is there structure left, where does it live, what force would it take?
//!
//! RT: no.

use crate::diagnose::judge::criterion::{Context, compare, detection_threshold};
use crate::diagnose::judge::nameless::{Excess, is_removed, names_predict_better};
use crate::diagnose::judge::numbers::TOUCHDOWN_S;
use crate::diagnose::judge::verdict::{Law, Member, Missing, Place};
use crate::diagnose::nameless::change_point::ChangePoint;
use crate::diagnose::nameless::force_patterns::{Pattern, law, located, patterns, share};
use crate::diagnose::nameless::free_curve::FreeCurve;
use crate::diagnose::nameless::holds_elsewhere::Elsewhere;
use crate::diagnose::robustness::held_out::{Confirmation, fall_of_squares};
use crate::diagnose::robustness::instants::FreeInstants;
use crate::diagnose::screen::linearise::ltv_windows;
use crate::diagnose::screen::score_test::ScoreTest;
use crate::diagnose::sentence;
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::{is_misfit, white};
use crate::identify::noise::{Colour, loss};
use crate::model::effect::EffectKind;
use std::collections::BTreeMap;

/// A mismatch without a name.
#[derive(Clone, Debug)]
pub struct Unlisted {
    /// Its entry in `missing`.
    pub entry: Missing,
    /// The residual force as curves.
    pub laws: Vec<Law>,
    /// Where it lives.
    pub places: Vec<Place>,
    /// Part of the misfit that it explains, where that is known.
    pub share: Option<f64>,
    /// The joint with whose position its force goes, if it does.
    pub over_position_of: Option<usize>,
    /// True if its force goes with nothing but time: it predicts no other recording.
    pub is_over_time: bool,
    /// By how much the error falls with it where it was not fitted, in squares of what is left there without it; 0 if nothing was asked.
    pub gained: f64,
}

impl Unlisted {
    /// A mismatch of which no more is known than `sentence` says.
    #[must_use]
    pub fn at(at: &str, sentence: String) -> Self {
        Self {
            entry: nameless(at, sentence),
            laws: Vec::new(),
            places: Vec::new(),
            share: None,
            over_position_of: None,
            is_over_time: false,
            gained: 0.0,
        }
    }
}

fn nameless(at: &str, sentence: String) -> Missing {
    let member = Member { effect: "unlisted".into(), at: at.into(), weight: 1.0, parameters: BTreeMap::new() };
    Missing { one_of: vec![member], sentence }
}

/// Most curves of the residual force that the report shows.
const SHOWN: usize = 2;

/// Looks for structure that the found effects do not explain: more than they do on the base alone (then they only
/// mimic something else and the second result is true), or on top of them.
#[must_use]
pub fn unexplained(
    found: &FittedModel,
    base: &FittedModel,
    context: &Context,
    said: &mut dyn FnMut(&str),
) -> Option<(Unlisted, bool)> {
    let listed: f64 = found.blocks(&base.noise).iter().sum::<f64>() - base.blocks(&base.noise).iter().sum::<f64>();
    let threshold = detection_threshold(context, 0);
    let on_base = structure(base, true, context, said)?;
    let excess = Excess { threshold, on_base: on_base.excess, listed };
    let misfit = |h: &FittedModel| is_misfit(&h.residuals, &context.floors);
    if excess.counts()
        && let Some(changed) = changed(found, base, (&on_base, excess), context, said)
    {
        return Some((changed, true));
    }
    let removed = 1.0 - energy(found, base) / energy(base, base);
    said(&format!("   listed effects gain {listed:.0} in the same measure, they remove {removed:.2} of the squares"));
    let held = Excess { on_base: on_base.held(), ..excess };
    let force = on_base.force.map(|(force, _)| force);
    if found.rig.effects.len() == base.rig.effects.len() {
        return force.filter(|_| held.counts()).map(|force| (force, true));
    }
    let left = structure(found, !misfit(found), context, said);
    let on_top = left.as_ref().and_then(|left| left.force.as_ref());
    let asked = on_top.and_then(|(u, _)| u.over_position_of);
    if let Some(unlisted) = over_position(found, base, asked, context, said) {
        return Some((unlisted, true));
    }
    // What is left may be the imperfect form of a right effect; where next to nothing is left, the listed say it all.
    let on_found = left.as_ref().map_or(0.0, |left| left.excess);
    if is_removed(removed) || excess.leaves_little(on_found) {
        return None;
    }
    let mut names_stand = || force.as_ref().is_some_and(|force| is_told_by_names(force, found, base, context, said));
    if held.beats_listed() && !names_stand() {
        return Some((force?, true));
    }
    left.and_then(|left| left.force).filter(|(_, on_found)| excess.counts_on_top(*on_found)).map(|(u, _)| (u, false))
}

/// Another machine from some instant of a recording on, if that says more than all that was found. `force`: on the base, with its
/// excess.
fn changed(
    found: &FittedModel,
    base: &FittedModel,
    (on_base, excess): (&Structure, Excess),
    context: &Context,
    said: &mut dyn FnMut(&str),
) -> Option<Unlisted> {
    let changed = ChangePoint::fitted(base, context)?;
    let name = &base.problem.recordings[changed.recording].name;
    let ahead = changed.ahead_of(found);
    said(&format!(
        "   another machine from {:.2} s of {name} on, fitted: {ahead:.0} ahead of what was found",
        changed.from_s
    ));
    if !changed.says_more_than(found, base, context) {
        return None;
    }
    // Something that acts all the time may act a little more on one side of an instant than on the other: it is still there.
    let parts = [&changed.before, &changed.after];
    let left: f64 =
        parts.into_iter().filter_map(|h| structure(h, true, context, said)).map(|left| left.excess.max(0.0)).sum();
    if !excess.leaves_little(left) || !changed.holds(base, context) {
        return None;
    }
    let changed = changed.nearby(base, context);
    let numbers = changed.numbers();
    // A machine of which no number is another one is the same.
    if numbers.is_empty() {
        return None;
    }
    let at = on_base.at.as_str();
    let sentence = sentence::changed(at, (name, changed.from_s), &numbers);
    let places = base.rig.sensors.first().map(|s| changed.place(&s.column)).into_iter().collect();
    Some(Unlisted { places, ..Unlisted::at(at, sentence) })
}

/// A free force over the position of `joint`, or of one at which a ripple was found, that says more than all that was found.
fn over_position(
    found: &FittedModel,
    base: &FittedModel,
    joint: Option<usize>,
    context: &Context,
    said: &mut dyn FnMut(&str),
) -> Option<Unlisted> {
    // At its bounds the base is no fair start: what is listed was sought from the numbers as given as well.
    if context.is_trapped {
        return None;
    }
    let added = &found.rig.effects[base.rig.effects.len()..];
    let ripple = added.iter().find(|e| e.kind == EffectKind::TorqueRipple);
    let joint = joint.or_else(|| base.rig.mechanism.coordinate_index(&ripple?.at))?;
    let curve = FreeCurve::fitted(base, joint, &ltv_windows(base)?, context)?;
    let ahead = compare(&curve.hypothesis, found, context).total;
    let at = base.rig.mechanism.coordinates()[joint];
    said(&format!("   free force over the position of {at}, fitted: {ahead:.0} ahead of what was found"));
    let says_more = curve.says_more_than(found, base, context) && !refutes_curve(&curve, base, context, said);
    says_more.then(|| {
        let part = 1.0 - energy(&curve.hypothesis, base) / energy(base, base);
        let sentence = sentence::unlisted(at, &format!("the position of {at}"), part.clamp(0.0, 1.0));
        Unlisted {
            entry: nameless(at, sentence),
            laws: vec![curve.law()],
            places: Vec::new(),
            share: Some(part),
            over_position_of: Some(joint),
            is_over_time: false,
            gained: 0.0,
        }
    })
}

/// True if recordings that no fit saw do not bear out a fitted curve.
fn refutes_curve(curve: &FreeCurve, base: &FittedModel, context: &Context, said: &mut dyn FnMut(&str)) -> bool {
    let residuals = |of: &FittedModel| context.held_out.as_ref()?.residuals(&of.rig);
    let Some(without) = residuals(base) else { return false };
    // What cannot run on what was kept back does not hold there.
    let Some(with) = residuals(&curve.hypothesis) else { return true };
    let told = Confirmation::of(&with, &without, &context.floors);
    said(&format!("   on recordings kept back: {told}"));
    !told.holds()
}

/// True if the listed effects predict recordings that no fit saw better than `force` does, on the base: it does not stand in their place.
/// A force over time explains anything where it was fitted and predicts nothing.
fn is_told_by_names(
    force: &Unlisted,
    found: &FittedModel,
    base: &FittedModel,
    context: &Context,
    said: &mut dyn FnMut(&str),
) -> bool {
    if force.is_over_time {
        return bear_out(found, base, context, said);
    }
    let on_kept_back = |of: &FittedModel| context.held_out.as_ref()?.residuals(&of.rig);
    let (Some(with), Some(without)) = (on_kept_back(found), on_kept_back(base)) else { return false };
    let gained = fall_of_squares(&with, &without, &white(&without, &context.floors));
    said(&format!("   the listed effects on recordings kept back: gain {gained:.0}, the force {:.0}", force.gained));
    names_predict_better(gained, force.gained)
}

/// True if recordings that no fit saw speak for the listed effects.
fn bear_out(found: &FittedModel, base: &FittedModel, context: &Context, said: &mut dyn FnMut(&str)) -> bool {
    let held_out = context.held_out.as_deref();
    let Some(told) = Confirmation::on_kept_back(found, base, held_out, &context.floors) else { return false };
    said(&format!("   the listed effects on recordings kept back: {told}"));
    told.bears_out(context)
}

/// Squares of the residual in units of the spread that `base` leaves, outliers pulled in by the loss.
fn energy(of: &FittedModel, base: &FittedModel) -> f64 {
    let unit = |(runs, colour): (&Vec<Vec<f64>>, &Colour)| {
        let scale = if colour.sigma.is_finite() { 1.0 / colour.sigma } else { 0.0 };
        runs.iter().flatten().map(|x| loss(x * scale)).sum::<f64>()
    };
    let sizes: Vec<Colour> = base
        .residuals
        .iter()
        .zip(&base.noise)
        .map(|(runs, colour)| {
            let count = runs.iter().map(Vec::len).sum::<usize>().max(1) as f64;
            let rms = libm::sqrt(runs.iter().flatten().map(|x| x * x).sum::<f64>() / count);
            Colour::white(if colour.sigma.is_finite() { rms } else { f64::INFINITY })
        })
        .collect();
    of.residuals.iter().zip(&sizes).map(unit).sum::<f64>().max(1e-12)
}

/// What a fit leaves that some force without a name would explain.
struct Structure {
    /// Gain of the best force beyond chance, whether it holds elsewhere or not.
    excess: f64,
    /// The joint at which that one acts.
    at: String,
    /// The best force that holds elsewhere, and its gain beyond chance.
    force: Option<(Unlisted, f64)>,
}

impl Structure {
    /// Gain beyond chance of the force that holds elsewhere.
    fn held(&self) -> f64 {
        self.force.as_ref().map_or(0.0, |(_, excess)| *excess)
    }
}

/// The free forces that explain most of what `of` leaves.
fn structure(of: &FittedModel, with_time: bool, context: &Context, said: &mut dyn FnMut(&str)) -> Option<Structure> {
    let windows = ltv_windows(of)?;
    let (runs, point) = FreeInstants::around(of, &windows, TOUCHDOWN_S);
    let screen = ScoreTest::new(&runs, &point, &of.noise)?;
    let mut patterns = patterns(of, &screen, &windows);
    patterns.retain(|p| with_time || !p.is_over_time());
    patterns.sort_by(|a, b| b.excess().total_cmp(&a.excess()));
    let best = patterns.first()?;
    said(&format!("   free force over {}: gain {:.0} for {} numbers", best.over, best.gain, best.numbers));
    let name = |p: &Pattern| of.rig.mechanism.coordinates()[p.joint].to_owned();
    // What is too little to count says how little is left, and is not asked.
    let asked = |p: &&Pattern| p.excess() > detection_threshold(context, 0);
    let elsewhere = Elsewhere::of(of, context);
    let held = patterns.iter().take_while(asked).find_map(|p| Some((p, elsewhere.bears_out(p, said)?)));
    let force = held.map(|(p, told)| (Unlisted { gained: told.gained, ..unlisted(of, p, &patterns) }, p.excess()));
    Some(Structure { excess: best.excess(), at: name(best), force })
}

/// The answer that a force is, with curves of it and of others.
fn unlisted(of: &FittedModel, told: &Pattern, patterns: &[Pattern]) -> Unlisted {
    let at = of.rig.mechanism.coordinates()[told.joint];
    let share = share(of, told);
    let mut laws: Vec<Law> = Vec::new();
    for law in patterns.iter().filter_map(|p| p.curve.as_ref()).map(|c| law(of, c)) {
        if laws.len() < SHOWN && laws.iter().all(|l| l.title != law.title) {
            laws.push(law);
        }
    }
    Unlisted {
        entry: nameless(at, sentence::unlisted(at, &told.over, share)),
        laws,
        places: located(of, told),
        share: Some(share),
        over_position_of: told.is_over_position().then_some(told.joint),
        is_over_time: told.is_over_time(),
        gained: 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::worked::{Shown, shown};
    use crate::diagnose::robustness::held_out::HeldOut;
    use crate::identify::experiment::{Experiment, Recording};
    use crate::model::rig::Use;
    use std::sync::Arc;

    const DRAG: &str = "[[effect]]\neffect = \"quadratic_drag\"\nat = \"q1\"\nquadratic = 0.004\n";

    /// Whether the same samples, as a recording that was kept back, speak for drag where there is `hidden`.
    fn borne_out(hidden: &str) -> bool {
        let Shown { context, problem } = shown(hidden);
        let (base, found) = (problem.fitted("", 20), problem.fitted(DRAG, 20));
        let kept_back = Recording { usage: Use::Heldout, ..found.problem.recordings[0].clone() };
        let experiment = Experiment { rig: base.rig.clone(), recordings: vec![kept_back] };
        let told = |held_out| bear_out(&found, &base, &Context { held_out, ..context.clone() }, &mut |_| {});
        assert!(!told(None), "nothing was kept back");
        told(HeldOut::of(&experiment, &base.rig).map(Arc::new))
    }

    #[test]
    fn what_predicts_a_recording_kept_back_is_borne_out_and_what_spoils_it_is_not() {
        assert!(borne_out(DRAG) && !borne_out(""));
    }

    #[test]
    fn a_force_stands_in_the_place_of_effects_only_if_it_predicts_recordings_kept_back_better() {
        let Shown { context, problem } = shown(DRAG);
        let (base, found) = (problem.fitted("", 20), problem.fitted(DRAG, 20));
        let kept_back = Recording { usage: Use::Heldout, ..found.problem.recordings[0].clone() };
        let experiment = Experiment { rig: base.rig.clone(), recordings: vec![kept_back] };
        let held_out = HeldOut::of(&experiment, &base.rig).map(Arc::new);
        let samples = base.residuals.iter().flatten().flatten().count() as f64;
        let told = |part: f64, held_out| {
            let force = Unlisted { gained: part * samples, ..Unlisted::at("q1", String::new()) };
            is_told_by_names(&force, &found, &base, &Context { held_out, ..context.clone() }, &mut |_| {})
        };
        assert!(told(0.1, held_out.clone()), "the drag explains nearly all of what the base leaves");
        assert!(!told(2.0, held_out), "more than there is");
        assert!(!told(0.1, None), "nothing was kept back");
    }
}
