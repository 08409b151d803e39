//! What no effect of the library explains: is there structure left, where does it live, what force would it take?
//!
//! RT: no.

use crate::diagnose::change_point::ChangePoint;
use crate::diagnose::fitted_model::FittedModel;
use crate::diagnose::free_curve::FreeCurve;
use crate::diagnose::held_out::{AdditionTest, Confirmation, cut_elsewhere, quiet_noise};
use crate::diagnose::instants::FreeInstants;
use crate::diagnose::judge::criterion::{Context, compare};
use crate::diagnose::judge::nameless::{Excess, asks_for_a_fit, beyond_chance, free_force_threshold, is_removed};
use crate::diagnose::judge::verdict::{Law, Member, Missing, Place};
use crate::diagnose::laws::band_95;
use crate::diagnose::likelihood::is_misfit;
use crate::diagnose::linearise::ltv_windows;
use crate::diagnose::ltv::LtvWindow;
use crate::diagnose::scan::{Curve, Over, state_curve, time_curve, vibration, vibration_columns};
use crate::diagnose::score_test::{Column, ScoreTest};
use crate::diagnose::sentence;
use crate::identify::noise::{Colour, loss};
use crate::model::effect::EffectKind;
use crate::model::rig::Rig;
use std::cell::OnceCell;
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
        }
    }
}

fn nameless(at: &str, sentence: String) -> Missing {
    let member = Member { effect: "unlisted".into(), at: at.into(), weight: 1.0, parameters: BTreeMap::new() };
    Missing { one_of: vec![member], sentence }
}

/// One way in which a free force could go with something.
struct Pattern {
    joint: usize,
    over: String,
    gain: f64,
    numbers: usize,
    curve: Option<Curve>,
    interval: Option<(usize, f64, f64)>,
    force: Force,
}

/// The force of a pattern, as it would act in other windows.
enum Force {
    /// Curves that add up.
    Curves(Vec<Curve>),
    /// Frequency, and the amplitudes of sine and cosine, recording by recording.
    Vibration(f64, Vec<f64>),
}

impl Force {
    /// What it does to readings.
    fn response(&self, windows: &[LtvWindow], joint: usize) -> Column {
        let parts: Vec<(f64, Column)> = match self {
            Self::Curves(curves) => curves.iter().map(|curve| (1.0, curve.response(windows))).collect(),
            Self::Vibration(hz, amplitudes) => {
                let columns = vibration_columns(windows, joint, amplitudes.len() / 2, *hz);
                amplitudes.iter().copied().zip(columns).collect()
            }
        };
        let mut sum: Column = vec![Vec::new(); windows.len()];
        for (amplitude, column) in parts {
            for (sum, window) in sum.iter_mut().zip(column).filter(|(_, window)| !window.is_empty()) {
                if sum.is_empty() {
                    *sum = window.iter().map(|channel| vec![0.0; channel.len()]).collect();
                }
                let rows = sum.iter_mut().flatten().zip(window.iter().flatten());
                rows.for_each(|(sum, x)| *sum += amplitude * x);
            }
        }
        sum
    }
}

/// Where a force that `of` lacks is asked whether it holds: prepared when the first one is.
struct Elsewhere<'f> {
    of: &'f FittedModel,
    context: &'f Context,
    held_out: OnceCell<Option<Examiner>>,
    cut: OnceCell<Option<Examiner>>,
}

impl<'f> Elsewhere<'f> {
    fn of(of: &'f FittedModel, context: &'f Context) -> Self {
        Self { of, context, held_out: OnceCell::new(), cut: OnceCell::new() }
    }

    /// True if `pattern` is not borne out where it was not fitted. A force that goes with the state is asked of recordings that
    /// no fit saw; a vibration, and any force if there are none, of the same recordings cut at other instants; a force that acts
    /// at times of its own recording, where it must leave but noise. One that acts all the time and goes with time alone
    /// predicts nothing.
    fn refutes(&self, pattern: &Pattern, said: &mut dyn FnMut(&str)) -> bool {
        let Self { of, context, .. } = *self;
        let floors = &context.floors;
        let event = pattern.interval.map(|(recording, ..)| of.problem.recordings[recording].name.clone());
        if event.is_none() && pattern.is_over_time() && !pattern.is_sine() {
            return true;
        }
        let told = if let Some(event) = event {
            let quiet = quiet_noise(of, |r| r.name == event, context);
            let runs = cut_elsewhere(of, |r| r.name == event, floors);
            runs.and_then(|runs| Some(Examiner::of(&runs, Some(&quiet), floors)?.asks(pattern)))
        } else {
            let (kept, runs): (_, &dyn Fn() -> Option<FittedModel>) = match &context.held_out {
                Some(held_out) if !pattern.is_over_time() => (&self.held_out, &|| held_out.predicted_by(of, floors)),
                _ => (&self.cut, &|| cut_elsewhere(of, |_| true, floors)),
            };
            let examiner = kept.get_or_init(|| Examiner::of(&runs()?, None, floors));
            examiner.as_ref().map(|examiner| examiner.asks(pattern))
        };
        let Some(told) = told else { return true };
        said(&format!("   a force over {}, where it was not fitted: {told}", pattern.over));
        !told.holds()
    }
}

/// Runs of a model where it was not fitted, and what an addition to its readings is worth there.
struct Examiner {
    windows: Vec<LtvWindow>,
    addition: AdditionTest,
}

impl Examiner {
    fn of(runs: &FittedModel, quiet: Option<&[Colour]>, floors: &[f64]) -> Option<Self> {
        Some(Self { windows: ltv_windows(runs)?, addition: AdditionTest::new(runs, quiet, floors)? })
    }

    fn asks(&self, pattern: &Pattern) -> Confirmation {
        self.addition.told(&pattern.force.response(&self.windows, pattern.joint))
    }
}

/// Most curves of the residual force that the report shows.
const SHOWN: usize = 2;

/// Knots of a free curve over position or rate: smooth laws, and narrow ones (a detent, a magnet).
const KNOTS: [usize; 2] = [40, 120];

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
    let threshold = free_force_threshold(context);
    let on_base = structure(base, true, context, said)?;
    let excess = Excess { threshold, on_base: on_base.excess, listed };
    let misfit = |h: &FittedModel| is_misfit(&h.residuals, &context.floors);
    if excess.counts()
        && let Some(changed) = changed(found, base, (&on_base, excess), context, said)
    {
        return Some((changed, true));
    }
    let removed = 1.0 - energy(found, base) / energy(base, base);
    said(&format!(
        "  ... listed effects gain {listed:.0} in the same measure, they remove {removed:.2} of the squares"
    ));
    let held = Excess { on_base: on_base.held(), ..excess };
    let force = on_base.force.map(|(force, _)| force);
    if found.rig.effects.len() == base.rig.effects.len() {
        return force.filter(|_| held.counts()).map(|force| (force, true));
    }
    let left = structure(found, !misfit(found), context, said);
    let on_top = left.as_ref().and_then(|left| left.force.as_ref());
    let asked = on_top.filter(|(_, on_found)| asks_for_a_fit(*on_found)).and_then(|(u, _)| u.over_position_of);
    if let Some(unlisted) = over_position(found, base, asked, context, said) {
        return Some((unlisted, true));
    }
    // What is left may be the imperfect form of a right effect; where next to nothing is left, the listed say it all.
    let on_found = left.as_ref().map_or(0.0, |left| left.excess);
    if is_removed(removed) || excess.leaves_little(on_found) {
        return None;
    }
    let mut is_told_by_names =
        || force.as_ref().is_some_and(|f| f.is_over_time) && bear_out(found, base, context, said);
    if held.beats_listed() && !is_told_by_names() {
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
        "another machine from {:.2} s of {name} on, fitted: {ahead:.0} ahead of what was found",
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
    said(&format!("free force over the position of {at}, fitted: {ahead:.0} ahead of what was found"));
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

/// True if recordings that no fit saw speak for the listed effects: a force over time, which explains anything where it was
/// fitted and predicts nothing, does not stand in their place.
fn bear_out(found: &FittedModel, base: &FittedModel, context: &Context, said: &mut dyn FnMut(&str)) -> bool {
    let Some(told) = Confirmation::on_kept_back(found, base, context) else { return false };
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
    let (runs, point) = FreeInstants::around(of);
    let screen = ScoreTest::new(&runs, &point, &of.noise)?;
    let mut patterns = patterns(&of.rig, &screen, &windows);
    patterns.retain(|p| with_time || !p.is_over_time());
    patterns.sort_by(|a, b| excess(b).total_cmp(&excess(a)));
    let best = patterns.first()?;
    said(&format!("free force over {}: gain {:.0} for {} numbers", best.over, best.gain, best.numbers));
    let name = |p: &Pattern| of.rig.mechanism.coordinates()[p.joint].to_owned();
    // What is too little to count says how little is left, and is not asked.
    let asked = |p: &&Pattern| excess(p) > free_force_threshold(context);
    let elsewhere = Elsewhere::of(of, context);
    let held = patterns.iter().take_while(asked).find(|p| !elsewhere.refutes(p, said));
    let force = held.map(|p| (unlisted(of, p, &patterns), excess(p)));
    Some(Structure { excess: excess(best), at: name(best), force })
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
    }
}

impl Pattern {
    fn is_over_position(&self) -> bool {
        self.curve.as_ref().is_some_and(|c| c.over == Over::Angle)
    }

    fn is_sine(&self) -> bool {
        self.curve.is_none() && self.is_over_time()
    }

    /// True if the force goes with nothing but time.
    fn is_over_time(&self) -> bool {
        self.curve.as_ref().is_none_or(|c| c.over == Over::Time)
    }
}

/// Gain beyond what its numbers bring by chance.
fn excess(p: &Pattern) -> f64 {
    beyond_chance(p.gain, p.numbers)
}

fn share(found: &FittedModel, p: &Pattern) -> f64 {
    let energy: f64 = found
        .residuals
        .iter()
        .zip(&found.noise)
        .filter(|(_, c)| c.sigma.is_finite())
        .map(|(r, c)| r.iter().flatten().map(|x| (x / c.sigma).powi(2)).sum::<f64>())
        .sum();
    (p.gain / energy.max(1e-12)).clamp(0.0, 1.0)
}

fn patterns(rig: &Rig, screen: &ScoreTest, windows: &[LtvWindow]) -> Vec<Pattern> {
    let names = rig.mechanism.coordinates();
    let mut out = Vec::new();
    for (joint, name) in names.iter().enumerate() {
        for (over, what) in [(Over::Angle, "position"), (Over::Rate, "rate")] {
            for knots in KNOTS {
                out.extend(state_curve(screen, windows, joint, over, knots).map(|curve| Pattern {
                    joint,
                    over: format!("the {what} of {name}"),
                    gain: curve.score.gain,
                    numbers: curve.knots.len(),
                    curve: Some(curve.clone()),
                    interval: None,
                    force: Force::Curves(vec![curve]),
                }));
            }
        }
        out.extend(vibration_pattern(screen, windows, joint));
        out.extend(time_patterns(screen, windows, joint));
    }
    out
}

fn vibration_pattern(screen: &ScoreTest, windows: &[LtvWindow], joint: usize) -> Option<Pattern> {
    let grid: Vec<f64> = (0..80).map(|i| 0.5 * libm::pow(1.05, f64::from(i))).collect();
    let coarse = vibration(screen, windows, joint, &grid)?.at;
    // A recording of some seconds resolves more than the grid.
    let fine: Vec<f64> = (-10..=10).map(|i| coarse * (1.0 + 0.005 * f64::from(i))).collect();
    let hit = vibration(screen, windows, joint, &fine)?;
    Some(Pattern {
        joint,
        over: format!("time, like a vibration of {:.2} Hz", hit.at),
        gain: hit.score.gain,
        numbers: hit.score.amplitudes.len() + 6,
        curve: None,
        interval: None,
        force: Force::Vibration(hit.at, hit.score.amplitudes),
    })
}

/// Force over time: of all recordings together, and of the one in which most of it acts, if it acts in a part of that.
fn time_patterns(screen: &ScoreTest, windows: &[LtvWindow], joint: usize) -> Vec<Pattern> {
    let recordings = windows.iter().map(|w| w.recording).max().map_or(0, |last| last + 1);
    let curves: Vec<Curve> = (0..recordings).filter_map(|r| time_curve(screen, windows, joint, r, 0.15)).collect();
    let Some(most) = curves.iter().max_by(|a, b| a.score.gain.total_cmp(&b.score.gain)).cloned() else {
        return Vec::new();
    };
    let pattern = |curves: Vec<Curve>, interval: Option<(usize, f64, f64)>| Pattern {
        joint,
        over: "time".into(),
        gain: curves.iter().map(|c| c.score.gain).sum(),
        numbers: curves.iter().map(|c| c.knots.len()).sum(),
        interval,
        curve: Some(most.clone()),
        force: Force::Curves(curves),
    };
    let event = busy(&most).map(|interval| pattern(vec![most.clone()], Some(interval)));
    event.into_iter().chain([pattern(curves, None)]).collect()
}

/// The part of a recording in which nearly all of a force over time acts, if it is a part.
fn busy(curve: &Curve) -> Option<(usize, f64, f64)> {
    let weigh = |(a, s): (&f64, &f64)| if *s > 0.0 { (a / s).powi(2).clamp(1.0, 1e6) - 1.0 } else { 0.0 };
    let energy: Vec<f64> = curve.score.amplitudes.iter().zip(&curve.score.deviations).map(weigh).collect();
    let total: f64 = energy.iter().sum();
    let reached = |part: f64| {
        let mut sum = 0.0;
        energy.iter().position(|e| {
            sum += e;
            sum >= part * total
        })
    };
    let (first, last) = (reached(0.03)?, reached(0.97)?);
    let is_part = last - first < energy.len() * 4 / 5;
    is_part.then_some((curve.recording?, curve.knots[first], curve.knots[last]))
}

fn law(found: &FittedModel, curve: &Curve) -> Law {
    let name = found.rig.mechanism.coordinates()[curve.joint];
    let (x_label, what) = match curve.over {
        Over::Angle => (format!("{name} (rad or m)"), "position"),
        Over::Rate => (format!("rate of {name} (rad/s or m/s)"), "rate"),
        Over::Time => ("time (s)".to_owned(), "time"),
    };
    let (y, s) = (&curve.score.amplitudes, &curve.score.deviations);
    Law {
        title: format!("Force at {name} that the model lacks, over {what}"),
        x_label,
        y_label: "torque or force (Nm or N)".into(),
        x: curve.knots.clone(),
        y: y.clone(),
        low: y.iter().zip(s).map(|(a, b)| a - band_95() * b).collect(),
        high: y.iter().zip(s).map(|(a, b)| a + band_95() * b).collect(),
    }
}

fn located(found: &FittedModel, p: &Pattern) -> Vec<Place> {
    let Some((recording, from_s, to_s)) = p.interval else { return Vec::new() };
    let sensor = found.rig.sensors.iter().find(|s| s.joint == p.joint).or_else(|| found.rig.sensors.first());
    let Some(sensor) = sensor else { return Vec::new() };
    vec![Place {
        recording: found.problem.recordings[recording].name.clone(),
        channel: sensor.column.clone(),
        from_s,
        to_s,
        share: share(found, p),
        phase: None,
        region: None,
        band_hz: None,
    }]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::candidate_fit::worked::{Shown, shown};
    use crate::diagnose::held_out::HeldOut;
    use crate::identify::experiment::{Experiment, Recording};
    use crate::model::rig::Use;
    use std::sync::Arc;

    const DRAG: &str = "[[effect]]\neffect = \"quadratic_drag\"\nat = \"q1\"\nquadratic = 0.004\n";

    /// Whether the same samples, as a recording that was kept back, speak for drag where there is `hidden`.
    fn borne_out(hidden: &str) -> bool {
        let Shown { context, problem } = shown(hidden);
        let (base, found) = (problem.fitted("", 20, &context), problem.fitted(DRAG, 20, &context));
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
}
