//! Which candidate is believed: worth enough, no piece of a smooth misfit, and true where it was not fitted.
//!
//! RT: no.

use crate::diagnose::candidates::Candidate;
use crate::diagnose::carry::rings_by_itself;
use crate::diagnose::folds::LeftOut;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::likelihood::{Difference, is_misfit};
use crate::diagnose::tables::estimates;
use crate::diagnose::tried::{Context, Trial, at_zero, compare, worth};
use crate::diagnose::unlisted::is_patch;
use crate::model::effect::{EffectKind, Key, Role};
use crate::model::rig::{Effect, Scope, Sensor, Slot, Value};
use std::cell::OnceCell;

/// Least gain of a further effect, in parts of what those before it gained.
const SHARE: f64 = 0.04;

/// The same where nothing else gains nearly as much: what the form of the first leaves is as good for several.
const SHARE_ALONE: f64 = 0.02;

/// Part of a trial's gain from which another effect gains nearly as much.
const NEARLY: f64 = 0.6;

/// The same where smooth misfit stays: no form fits hardware to the noise. Tuned on a pendulum with gears, where a ripple
/// (.14) and a play (.06) came after the Coulomb friction that explains it.
const SHARE_OF_MISFIT: f64 = 0.15;

/// True if a bristle is in the rig: what damps it no contract or catalogue tells, and another damping leaves a tenth (seen: a
/// sensor scale of .74 made up for it).
fn has_bristle(now: &Hypothesis) -> bool {
    now.rig.effects.iter().any(|effect| effect.kind == EffectKind::Presliding)
}

/// True if `trial` explains enough to be believed. `all`: the trials of its round.
fn is_worth(base: &Hypothesis, (trial, all): (&Trial, &[Trial]), explained_before: f64, context: &Context) -> bool {
    let sure = compare(&trial.hypothesis, base, context);
    // A second effect must not live off the first one's imperfect form.
    let misfit = is_misfit(&trial.hypothesis.residuals, &context.floors);
    let inexact = misfit || has_bristle(base);
    let other = |t: &Trial| t.candidate.effect != trial.candidate.effect && t.gain > NEARLY * trial.gain;
    let least = match (inexact, all.iter().any(other)) {
        (true, _) => SHARE_OF_MISFIT,
        (false, true) => SHARE,
        (false, false) => SHARE_ALONE,
    };
    let share = trial.gain >= least * explained_before;
    // Against smooth misfit chance has no measure: a tenth of the squares is the least that a user would notice.
    let noticed = !misfit || trial.gain > 0.1 * context.samples as f64;
    let admitted = noticed && !is_piece(base, trial, context);
    trial.gain > worth(context, trial.candidate.keys.len())
        && is_sure(&trial.candidate, trial.gain, sure, context)
        && share
        && admitted
        && !at_zero(trial)
        && trial.hypothesis.rig.effects.len().checked_sub(1).is_none_or(|e| is_found(&trial.hypothesis, e, context))
}

/// True if effect `e` of `of` is one that was found: no number of it at the edge of its range, and no mode that something else
/// shakes.
#[must_use]
pub fn is_found(of: &Hypothesis, e: usize, context: &Context) -> bool {
    !of.rig.effects.get(e).is_some_and(is_cut_off) && !rings_by_itself(of, e, &context.floors)
}

/// True if the gain is no chance of which blocks of the recordings there are. A single event is in one of them: all of its
/// gain, or none, is in a sample of blocks, which says nothing; it must be worth more instead.
pub fn is_sure(candidate: &Candidate, gain: f64, sure: Difference, context: &Context) -> bool {
    let single = candidate.only.is_some() && gain > SINGLE * worth(context, candidate.keys.len());
    sure.low > 0.0 || single && sure.total > 0.0
}

/// Least gain of a single event in parts of [`worth`], where the blocks do not bear it out.
const SINGLE: f64 = 1.5;

/// True for a single event where a resonance that is none ([`is_found`]) gains far more: something shakes the machine, and a push
/// fits a piece of that.
#[must_use]
pub fn is_shaken(trial: &Trial, all: &[Trial], context: &Context) -> bool {
    let far = |t: &Trial| t.gain - trial.gain > (SHAKEN * trial.gain).max(worth(context, t.candidate.keys.len()));
    let rings = |t: &Trial| {
        let effects = &t.hypothesis.rig.effects;
        effects.last().is_some_and(|e| e.get("frequency").is_some())
            && !is_found(&t.hypothesis, effects.len() - 1, context)
    };
    trial.candidate.only.is_some() && all.iter().any(|t| rings(t) && far(t))
}

/// Part of an event's gain that such a resonance is ahead.
const SHAKEN: f64 = 0.25;

/// A number at the edge of the range in which it was sought was not found (the design's "no bound hit"): a resonance
/// there stands for a slower or faster motion that is none, one without damping for a vibration from elsewhere, a
/// memory as long as a window for the start of each window. Nothing at all is no such edge.
#[must_use]
pub fn is_cut_off(effect: &Effect) -> bool {
    let hits = |value: &Value| {
        let at = |bound: f64| bound != 0.0 && (value.value / bound - 1.0).abs() < AT_EDGE;
        value.bounds.is_some_and(|b| at(b.min) || at(b.max))
    };
    let resonance =
        effect.get("frequency").is_some_and(|f| hits(&f) || effect.get("damping").is_some_and(|d| hits(&d)));
    let strength = |(key, value): (&Key, &Value)| matches!(key.role, Role::Strength(_)) && hits(value);
    resonance || effect.kind.keys().iter().zip(&effect.values).any(strength)
}

/// Nearer to its bound than this part a number hits it.
const AT_EDGE: f64 = 0.01;

/// True for a push, a jump or a few waves of a ripple where more than noise stays: they fit a piece of any smooth misfit.
#[must_use]
pub fn is_piece(base: &Hypothesis, trial: &Trial, context: &Context) -> bool {
    let misfit = is_misfit(&trial.hypothesis.residuals, &context.floors);
    periods(base, trial) < if misfit { PERIODS } else { LEAST_PERIODS } || misfit && is_patched(base, &trial.candidate)
}

/// Fewer periods than this within the travel are no ripple that anyone could tell from another law of position.
const PERIODS: f64 = 3.0;

/// The same where it leaves nothing but noise: half a wave is a parabola.
const LEAST_PERIODS: f64 = 0.75;

/// Periods of a trial's ripple within the travel; infinite for other effects.
fn periods(base: &Hypothesis, trial: &Trial) -> f64 {
    waves(base, trial).unwrap_or(f64::INFINITY)
}

/// Periods of a trial's ripple within the travel; none for other effects, or where no sensor tells the travel.
fn waves(base: &Hypothesis, trial: &Trial) -> Option<f64> {
    let ripple = trial.hypothesis.rig.effects.last().filter(|e| e.kind == EffectKind::TorqueRipple)?;
    let joint = base.rig.mechanism.coordinate_index(&trial.candidate.at);
    let travel = |(c, sensor): (usize, &Sensor)| {
        let all = base.problem.recordings.iter().flat_map(|r| &r.measured[c]).filter(|x| x.is_finite());
        let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
        if Some(sensor.joint) == joint && !sensor.is_rate { high - low } else { 0.0 }
    };
    let range = base.rig.sensors.iter().enumerate().map(travel).fold(0.0, f64::max);
    (range > 0.0).then_some(ripple.get("order")?.value * range / (2.0 * std::f64::consts::PI))
}

/// True if `candidate` fits a piece of anything on this machine.
#[must_use]
pub fn is_patched(now: &Hypothesis, candidate: &Candidate) -> bool {
    EffectKind::from_id(candidate.effect).is_some_and(|kind| is_patch(&now.rig, kind))
}

/// True if `trial` is worth it and holds on recordings that it was not fitted to. `left_out`: of `now`, made when needed; `all`: the trials of its round.
pub fn believed(
    now: &Hypothesis,
    left_out: &OnceCell<Option<LeftOut>>,
    (trial, all): (&Trial, &[Trial]),
    explained: f64,
    context: &Context,
    said: &mut impl FnMut(&str),
) -> bool {
    if !is_worth(now, (trial, all), explained, context) {
        return false;
    }
    let misfit = is_misfit(&trial.hypothesis.residuals, &context.floors);
    // A strength that a base parameter shares is uncertain; that it is none is not, with a gain like this.
    let beyond_doubt = !misfit && trial.gain > CERTAIN * worth(context, trial.candidate.keys.len());
    if !beyond_doubt && is_doubtful(&trial.hypothesis) {
        said(&format!("   {} is not two deviations from nothing", trial.candidate.effect));
        return false;
    }
    let left_out = left_out.get_or_init(|| LeftOut::of(now, &context.floors)).as_ref();
    let Some(kept) = left_out.and_then(|l| l.kept_by(&trial.hypothesis, &context.floors)) else { return true };
    said(&format!("   {} keeps {:.2} of its gain on recordings left out", trial.candidate.effect, kept));
    let least = if trial.gain > MUCH * worth(context, trial.candidate.keys.len()) { LEAST_OF_MUCH } else { LEAST_KEPT };
    kept >= least || trial.candidate.only.is_some()
}

/// True if the last effect's strength is less than two deviations from nothing, with all that widens an interval: where
/// misfit stays a gain may be all of a piece, and the same data then do not tell its strength.
fn is_doubtful(of: &Hypothesis) -> bool {
    let of = of.clone().with_intervals();
    let (Some(e), known) = (of.rig.effects.len().checked_sub(1), estimates(&of)) else { return false };
    let unsure = |(k, key): (usize, &Key)| {
        let (Role::Strength(nothing), slot) = (key.role, Slot::Effect(Scope::Rig, e, k)) else { return false };
        let fitted = of.problem.theta.index_of_slot(slot).map(|i| known[i].1);
        fitted.is_some_and(|x| (x.value - nothing).abs() < SURE * x.std)
    };
    of.rig.effects[e].kind.keys().iter().enumerate().any(unsure)
}

/// Gain beyond doubt, in parts of [`worth`].
const CERTAIN: f64 = 5.0;

/// Deviations from nothing from which a strength is believed.
const SURE: f64 = 2.0;

/// True for a ripple in smooth misfit whose order the data do not tell: another order at the same joint explains nearly as
/// much, more than two waves over the travel resemble each other.
#[must_use]
pub fn is_unresolved(base: &Hypothesis, trial: &Trial, others: &[Trial], context: &Context) -> bool {
    let Some(mine) = waves(base, trial).filter(|_| is_misfit(&trial.hypothesis.residuals, &context.floors)) else {
        return false;
    };
    let rival = |other: &Trial| {
        let of_other = if other.candidate.at == trial.candidate.at { waves(base, other) } else { None };
        of_other
            .is_some_and(|w| (w - mine).abs() > 0.0 && other.gain > 0.5 * (1.0 + resemblance(w - mine)) * trial.gain)
    };
    others.iter().any(rival)
}

/// Part of a wave's energy that another can take over which differs by so many periods within the travel.
fn resemblance(periods: f64) -> f64 {
    let x = std::f64::consts::PI * periods;
    if x == 0.0 { 1.0 } else { (libm::sin(x) / x).powi(2) }
}

/// Smallest part of its gain that an effect must keep on recordings that it was not fitted to.
pub const LEAST_KEPT: f64 = 0.25;

/// The same for a gain of more than so many times what counts: while another effect is missing, the base bends to one
/// recording for that (an eccentric encoder beside a lag of it kept .21 of 150 times what counts).
const LEAST_OF_MUCH: f64 = 0.15;
const MUCH: f64 = 30.0;

/// An effect that is the limit of another: the other, with one number more, must gain clearly more to be believed.
pub const LIMITS_OF: &[(&str, &str)] = &[
    ("torque_offset", "parallel_spring"),
    ("coulomb_friction", "stribeck_friction"),
    // Over less than a turn.
    ("sensor_bias", "encoder_eccentricity"),
];

/// Part of the richer effect's gain that is enough for the simpler one.
pub const ENOUGH: f64 = 0.95;

/// Where a simpler limit of the leader gains nearly as much, the leader goes after it: what is left may still be added. Then the first
/// is who gains most for the numbers that it adds (Schwarz 1978; an initial state of a window brings 1 by chance).
pub fn simplest_first(trials: &mut Vec<Trial>, context: &Context) {
    let Some(leader) = trials.first() else { return };
    let simple = LIMITS_OF.iter().filter(|(_, rich)| *rich == leader.candidate.effect).find_map(|(simple, _)| {
        // Where the leader leaves nothing but noise, what it is ahead counts as anything else does.
        let most =
            if is_misfit(&leader.hypothesis.residuals, &context.floors) { f64::INFINITY } else { worth(context, 1) };
        let close = |t: &Trial| {
            let near = t.gain >= (ENOUGH * leader.gain).max(leader.gain - most);
            t.candidate.effect == *simple && t.candidate.at == leader.candidate.at && near
        };
        trials.iter().position(close)
    });
    let rich = simple.map(|i| {
        let simple = trials.remove(i);
        std::mem::replace(&mut trials[0], simple)
    });
    let net = |t: &Trial| t.gain - price(t, context);
    let best = trials.iter().enumerate().max_by(|a, b| net(a.1).total_cmp(&net(b.1))).map_or(0, |(i, _)| i);
    trials[..=best].rotate_right(1);
    // Next to it, for the contest among the best few.
    if let Some(rich) = rich {
        trials.insert(1, rich);
    }
}

/// What a trial's numbers are worth by chance, in twice the log-likelihood.
fn price(trial: &Trial, context: &Context) -> f64 {
    let numbers = trial.candidate.keys.iter().filter(|k| k.max > k.min).count() as f64;
    let states = trial.hypothesis.point.states.iter().map(Vec::len).sum::<usize>() as f64;
    numbers * libm::log(context.samples.max(2) as f64) + states
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::candidates;
    use crate::identify::problem::Problem;

    const RIG: &str = "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = 0.01\ngravity_nm = 0.4\n\
        [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.3\n[[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\n";

    fn trial(effect: &'static str, numbers: usize, gain: f64) -> Trial {
        let problem = Problem::shaken(RIG, None, vec![0.0; 200]);
        let start = problem.start();
        let hypothesis = Hypothesis::at(problem, start, nalgebra::DMatrix::zeros(0, 0), &[1e-3]).unwrap();
        let key = candidates::Key { name: "x", min: 0.0, max: 1.0, log: false };
        let candidate = Candidate {
            effect,
            at: "q1".into(),
            keys: vec![key; numbers],
            starts: Vec::new(),
            only: None,
            motor_sensor: None,
            side: crate::model::rig::Side::Link,
        };
        Trial { candidate, hypothesis, gain }
    }

    fn order(mut trials: Vec<Trial>) -> Vec<&'static str> {
        let context = Context { floors: vec![1e-3], samples: 1000, given: 0, is_trapped: false, seed: 1 };
        simplest_first(&mut trials, &context);
        trials.iter().map(|t| t.candidate.effect).collect()
    }

    #[test]
    fn who_needs_fewer_numbers_stands_first_where_more_bring_no_more() {
        // ln 1000 = 6.9 for a number.
        let close = vec![trial("joint_elasticity", 3, 512.0), trial("actuator_lag", 1, 500.0)];
        assert_eq!(order(close), ["actuator_lag", "joint_elasticity"]);
        let far = vec![trial("joint_elasticity", 3, 515.0), trial("actuator_lag", 1, 500.0)];
        assert_eq!(order(far), ["joint_elasticity", "actuator_lag"]);
    }

    #[test]
    fn a_limit_of_the_leader_goes_first_with_most_of_its_gain() {
        let most = vec![trial("parallel_spring", 2, 1000.0), trial("torque_offset", 1, 960.0)];
        assert_eq!(order(most)[0], "torque_offset");
        let less = vec![trial("parallel_spring", 2, 1000.0), trial("torque_offset", 1, 940.0)];
        assert_eq!(order(less)[0], "parallel_spring");
    }

    #[test]
    fn waves_that_differ_by_a_period_have_nothing_in_common() {
        assert!(resemblance(1.0) < 1e-12 && (resemblance(0.0) - 1.0).abs() < 1e-12);
        assert!((0.3..0.5).contains(&resemblance(0.5)), "{}", resemblance(0.5));
    }

    #[test]
    fn a_push_is_no_piece_of_a_vibration() {
        let context = Context { floors: vec![1e-3], samples: 1000, given: 0, is_trapped: false, seed: 1 };
        let mut push = trial("external_push", 2, 400.0);
        push.candidate.only = Some("a.csv".into());
        let ringing = |push: &Trial, damping: f64, gain: f64| {
            let mut trial = trial("link_flexibility", 3, gain);
            let values = [3.0, damping, 0.1].map(|x| Value::free(x, 0.002, 60.0)).to_vec();
            trial.hypothesis.rig.effects.push(Effect::new(EffectKind::LinkFlexibility, "q1", values));
            [trial, push.clone()]
        };
        assert!(is_shaken(&push, &ringing(&push, 0.002, 900.0), &context), "undamped and far ahead");
        assert!(!is_shaken(&push, &ringing(&push, 0.05, 900.0), &context), "a mode of the link may be one");
        assert!(!is_shaken(&push, &ringing(&push, 0.002, 450.0), &context), "no farther than chance");
        push.candidate.only = None;
        assert!(!is_shaken(&push, &ringing(&push, 0.002, 900.0), &context), "no single event");
    }

    #[test]
    fn a_memory_at_the_end_of_its_range_was_not_found_but_none_is_none() {
        let lag = |x: f64| Effect::new(EffectKind::SensorLag, "q", vec![Value::free(x, 0.0, 0.01)]);
        assert!(is_cut_off(&lag(0.01)) && !is_cut_off(&lag(0.006)) && !is_cut_off(&lag(0.0)));
    }
}
