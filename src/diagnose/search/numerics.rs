//! What the simulator that made a recording, if one did, does to the equations of the machine: its steps, and friction that gives.
//!
//! A simulator that takes forces from the beginning of a step as long as a row is off by what such a step makes of the machine: in two
//! links that whirl that is more than most effects of the library do, and half a step ([`crate::diagnose::robustness::instants`]) is but its
//! first order. Where friction's sign is smooth, or friction is a soft constraint, a joint creeps where it would stick. No machine steps. So these are numbers like any other of the
//! simulation: the likeliest are taken, the rig's own unless others are more than chance.
//! RT: no.

use crate::diagnose::judge::confirmation::is_contradicted;
use crate::diagnose::judge::criterion::{Context, compare, detection_threshold, leaves_slow_noise};
use crate::diagnose::library::candidate_fit::REFIT;
use crate::diagnose::robustness::instants::FINEST_STEPS_PER_ROW;
use crate::diagnose::screen::subsample::few;
use crate::diagnose::search::budget::{allowance, allowance_of_a_look, within};
use crate::identify::base_fit::anew;
use crate::identify::experiment::Recording;
use crate::identify::fit::{Limits, Point};
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::{is_misfit, white};
use crate::identify::noise::Colour;
use crate::identify::problem::Problem;
use crate::model::effect::EffectKind;
use crate::model::rig::{Numerics, Rig};
use rayon::prelude::*;

/// Steps per row that are tried. The error of a step goes with its length: what lies between is nearly one of these.
const PER_ROW: [f64; 3] = [1.0, 2.0, FINEST_STEPS_PER_ROW];

/// Rates within which friction may change its sign that are tried, rad/s or m/s; a simulator that is to look right has no larger ones.
const SMOOTH_RATES: [f64; 6] = [1e-3, 2e-3, 4e-3, 8e-3, 0.016, 0.032];

/// Time constants of friction as a soft constraint that are tried, s: MuJoCo's own, and shorter ones. What lies between is nearly one of these.
const SOFT_FRICTIONS_S: [f64; 3] = [0.02, 0.01, 0.005];

/// `of` fitted again with the numerics that these recordings show; `None` if it has them, or if more than noise stays with any: what made
/// these recordings is then no simulation of this machine, but a machine, or one that lacks something.
#[must_use]
pub fn with_likeliest_numerics(of: &FittedModel, context: &Context) -> Option<FittedModel> {
    let own = of.rig.numerics;
    let steps: Vec<Option<f64>> = std::iter::once(None).chain(steps_s(of)?.into_iter().map(Some)).collect();
    let stepped = |from: &FittedModel| {
        let all = steps.iter().map(|euler_step_s| Numerics { euler_step_s: *euler_step_s, ..from.rig.numerics });
        likeliest(from, all, context)
    };
    let is_base = of.rig.effects.len() == context.given;
    let rubbed = |from: &FittedModel| likeliest(from, frictions(from, is_base).into_iter(), context);
    let first = stepped(of);
    let best = if has_dry_friction(of) {
        let one = rubbed(&first);
        // What is asked first takes some of what the other does: both orders, of the base, where a fit costs little.
        let is_asked = is_base && one.rig.numerics != own;
        let other = is_asked.then(|| if first.rig.numerics == own { stepped(&one) } else { stepped(&rubbed(of)) });
        other.filter(|other| other.likelihood > one.likelihood).unwrap_or(one)
    } else {
        first
    };
    (best.rig.numerics != own && shows_its_numerics(&best, of, context)).then_some(best)
}

/// The base fitted anew from `given`, with the steps that these recordings show, if recordings kept back contradict it or it leaves noise that
/// is too slow ([`leaves_slow_noise`]): two links that whirl have a false minimum for every wrong step, in which short windows look like noise, and
/// from which no other step leads out.
#[must_use]
pub fn stepped_from_given(given: &Rig, base: &FittedModel, context: &Context) -> Option<FittedModel> {
    let is_wrong = || leaves_slow_noise(base) || is_contradicted(base, context);
    if is_misfit(&base.residuals, &context.floors) || !is_wrong() {
        return None;
    }
    let fitted = |step_s: f64| {
        let numerics = Numerics { euler_step_s: Some(step_s), ..base.rig.numerics };
        anew(&base.problem, &Rig { numerics, ..given.clone() }, &context.floors)
    };
    let fits = steps_s(base)?.into_iter().filter_map(fitted);
    fits.filter(|fit| shows_its_numerics(fit, base, context)).max_by(|a, b| a.likelihood.total_cmp(&b.likelihood))
}

/// Steps of a simulator that are tried, s.
fn steps_s(of: &FittedModel) -> Option<Vec<f64>> {
    let row_s = of.problem.recordings.iter().filter_map(Recording::usual_row_s).min_by(f64::total_cmp)?;
    let steps = PER_ROW.map(|n| row_s / n).into_iter();
    Some(steps.filter(|step_s| Numerics::EULER_STEP_S.contains(step_s)).collect())
}

/// True if `fit` is ahead of `of` by more than chance, and leaves nothing but noise.
fn shows_its_numerics(fit: &FittedModel, of: &FittedModel, context: &Context) -> bool {
    compare(fit, of, context).total > detection_threshold(context, 1) && !is_misfit(&fit.residuals, &context.floors)
}

/// The ways in which a simulator may take friction that are tried: it sticks, its sign is smooth, or, of the base, it is a soft constraint. Beside
/// an effect that would stand for how the friction of a machine gives.
fn frictions(of: &FittedModel, is_base: bool) -> Vec<Numerics> {
    let own = of.rig.numerics;
    let sticks = Numerics { smooth_rate: None, soft_friction_s: None, ..own };
    let smooth = SMOOTH_RATES.map(|rate| Numerics { smooth_rate: Some(rate), ..sticks });
    let soft = SOFT_FRICTIONS_S.map(|time_s| Numerics { soft_friction_s: Some(time_s), ..sticks });
    [&[sticks][..], &smooth, if is_base { &soft } else { &[] }].concat()
}

fn has_dry_friction(of: &FittedModel) -> bool {
    let is_dry =
        |kind| matches!(kind, EffectKind::CoulombFriction | EffectKind::StribeckFriction | EffectKind::LoadFriction);
    of.rig.effects.iter().any(|effect| is_dry(effect.kind))
}

/// `of`, or fitted again with the one among `all` numerics that first steps on some windows recommend, if that is likelier. How a simulator
/// computes shows in every window alike. No look may cost more than a candidate's: a sign of friction that is sharp beside what a row
/// changes makes a light machine stiff.
///
/// One linear step says nothing here: what a step of a row makes of two links that whirl is far from small.
fn likeliest(of: &FittedModel, all: impl Iterator<Item = Numerics>, context: &Context) -> FittedModel {
    let others = all.filter(|numerics| *numerics != of.rig.numerics);
    let numerics: Vec<Numerics> = std::iter::once(of.rig.numerics).chain(others).collect();
    let kept = few(&of.problem, context.samples).unwrap_or_else(|| (0..of.problem.windows.len()).collect());
    let few = of.on_windows(&kept);
    let (most, noise) = (allowance_of_a_look(&few), white(&of.residuals, &context.floors));
    let look = |numerics: Numerics| {
        let (problem, start) = few.extended(Rig { numerics, ..few.rig.clone() });
        within(most, &few, problem, start, (&noise, LOOK), context)
    };
    let looks: Vec<FittedModel> = numerics.into_par_iter().filter_map(look).collect();
    let best = looks.into_iter().max_by(|a, b| a.likelihood.total_cmp(&b.likelihood));
    let other = best.filter(|look| look.rig.numerics != of.rig.numerics);
    let fitted = other.and_then(|look| {
        let (problem, mut start) = of.extended(Rig { numerics: look.rig.numerics, ..of.rig.clone() });
        start.parameters.clone_from(&look.point.parameters);
        kept.iter().zip(look.point.states).for_each(|(w, state)| start.states[*w] = state);
        to_its_end(of, problem, start, context)
    });
    fitted.filter(|fitted| fitted.likelihood > of.likelihood).unwrap_or_else(|| of.clone())
}

/// First steps of a fit with other numerics, from where the fit without them ended.
const LOOK: Limits = Limits { iterations: 6, tolerance: 3e-4 };

/// `of` fitted again with other numerics.
#[must_use]
pub fn with_numerics(of: &FittedModel, numerics: Numerics, context: &Context) -> Option<FittedModel> {
    let (problem, start) = of.extended(Rig { numerics, ..of.rig.clone() });
    to_its_end(of, problem, start, context)
}

/// `problem`, which is that of `of` with other numerics, fitted under white noise and then under its own.
#[must_use]
pub fn to_its_end(of: &FittedModel, problem: Problem, start: Point, context: &Context) -> Option<FittedModel> {
    let most = allowance(of);
    let fitted = |problem: Problem, start: Point, noise: &[Colour], limits: Limits| {
        within(most, of, problem, start, (noise, limits), context)
    };
    let first = fitted(problem, start, &white(&of.residuals, &context.floors), Limits::default())?;
    let noise = white(&first.residuals, &context.floors);
    let whiter = fitted(first.problem.clone(), first.point, &noise, Limits::default())?;
    let finer = fitted(whiter.problem.clone(), whiter.point.clone(), &whiter.noise, REFIT);
    Some(finer.filter(|finer| finer.likelihood > whiter.likelihood).unwrap_or(whiter))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::evidence::Ledger;
    use crate::identify::experiment::Recording;
    use crate::identify::synthesis::record;

    const LINKS: &str = "mechanism = \"double_pendulum\"\n[parameters]\ninertia1_kg_m2 = 0.02\ninertia2_kg_m2 = 0.055\n\
        moment1_kg_m = 0.07\nmoment2_kg_m = { value = 0.2, min = 0.1, max = 0.3 }\nmass2_kg = 1.1\nlength1_m = 0.25\n\
        gravity_m_s2 = 9.81\n[[sensor]]\nmeasures = \"q1\"\ncolumn = \"q1_rad\"\n[[sensor]]\nmeasures = \"q2\"\ncolumn = \"q2_rad\"\n";

    /// Friction of .1 Nm holds it against what the actuator gives for most of the time.
    const HELD: &str = "mechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = { value = 0.01, min = 0.005, max = 0.02 }\n\
        gravity_nm = 0.1\n[[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.15\n[[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\nnoise_std = 0.0005\n\
        [[effect]]\neffect = \"coulomb_friction\"\nat = \"q1\"\ncoulomb = { value = 0.1, min = 0.0, max = 0.2 }\n";

    /// What is recorded of `machine` with `numerics` in rows of 10 ms from `start` on, fitted in exact steps and with sticking friction.
    fn fitted_exactly(machine: &str, start: &[f64], numerics: Numerics) -> (FittedModel, Context) {
        let rig = Rig::parse(&format!("schema = 1\n{machine}"), "rig.toml").unwrap();
        let sensors = rig.sensors.len();
        let times: Vec<f64> = (0..200).map(|k| f64::from(k) * 0.01).collect();
        let inputs = rig.actuators.iter().map(|_| times.iter().map(|t| libm::sin(5.0 * t)).collect()).collect();
        let mut recording = Recording::new("a.csv", times, inputs, vec![Vec::new(); sensors]);
        recording.measured = record(&Rig { numerics, ..rig.clone() }, &recording, start, Some(3)).unwrap().measured;
        let context = Context {
            floors: vec![2e-4; sensors],
            samples: 200 * sensors,
            given: rig.effects.len(),
            is_trapped: false,
            seed: 1,
            ledger: Ledger::default(),
            held_out: None,
        };
        let problem = Problem::new(rig, vec![recording]);
        let (start, noise) = (problem.start(), vec![Colour::white(0.01); sensors]);
        (FittedModel::fitted(problem, start, &noise, &context.floors, Limits::default()).unwrap(), context)
    }

    #[test]
    fn steps_of_a_simulator_are_found_and_exact_motion_stays_exact() {
        for step_s in [0.01, 0.005] {
            let numerics = Numerics { euler_step_s: Some(step_s), ..Numerics::default() };
            let (of, context) = fitted_exactly(LINKS, &[1.2, -0.4, 0.0, 0.0], numerics);
            let found = with_likeliest_numerics(&of, &context).unwrap();
            assert!((found.rig.numerics.euler_step_s.unwrap() / step_s - 1.0).abs() < 1e-9);
            let moment2 = found.problem.values(&found.point.parameters)[0];
            assert!((moment2 / 0.2 - 1.0).abs() < 1e-3, "{moment2}");
            assert!(with_likeliest_numerics(&found, &context).is_none(), "they are its own");
        }
        for (machine, start) in [(LINKS, &[1.2, -0.4, 0.0, 0.0][..]), (HELD, &[0.0, 0.0])] {
            let (of, context) = fitted_exactly(machine, start, Numerics::default());
            assert!(with_likeliest_numerics(&of, &context).is_none());
        }
    }

    #[test]
    fn a_base_that_leaves_slow_noise_is_fitted_anew_with_each_step() {
        let numerics = Numerics { euler_step_s: Some(0.01), ..Numerics::default() };
        let (of, context) = fitted_exactly(LINKS, &[0.3, -0.1, 0.0, 0.0], numerics);
        let quick = FittedModel { noise: vec![Colour::white(0.001); 2], ..of.clone() };
        assert!(!is_misfit(&of.residuals, &context.floors));
        assert!(stepped_from_given(&of.rig, &quick, &context).is_none());
        let slow = FittedModel { noise: vec![Colour { ar: vec![0.95], sigma: 0.001 }; 2], ..of.clone() };
        let found = stepped_from_given(&of.rig, &slow, &context).unwrap();
        assert!((found.rig.numerics.euler_step_s.unwrap() / 0.01 - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_smooth_sign_of_friction_is_found() {
        let numerics = Numerics { smooth_rate: Some(0.03), ..Numerics::default() };
        let (of, context) = fitted_exactly(HELD, &[0.0, 0.0], numerics);
        let found = with_likeliest_numerics(&of, &context).unwrap();
        let rate = found.rig.numerics.smooth_rate.unwrap();
        assert!((0.5..2.0).contains(&(rate / 0.03)), "{rate}");
    }

    #[test]
    fn friction_as_a_soft_constraint_is_found() {
        let numerics = Numerics { soft_friction_s: Some(0.025), ..Numerics::default() };
        let (of, context) = fitted_exactly(HELD, &[0.0, 0.0], numerics);
        let found = with_likeliest_numerics(&of, &context).unwrap();
        assert_eq!(found.rig.numerics, Numerics { soft_friction_s: Some(0.02), ..Numerics::default() });
    }
}
