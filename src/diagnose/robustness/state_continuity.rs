//! What a machine carries from one window into the next.
//!
//! The contract fits the initial state of every window, inner states included: the twist of a spring, the bend of a
//! bristle, what a filter remembers. A machine is not started again at each window: what is inside it there is what the
//! window before left. An effect whose inner states jump at every window is a free force per window and no effect
//! (measured on a motor turning slowly, windows of .05 s: a bristle ten times softer than the travel of a window, and a
//! filter slower than a window, removed 99 % of the misfit).
//! RT: no.

use crate::identify::base_fit::known;
use crate::identify::fit::{FreeRuns, Limits, Point, Series, fit};
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::{Residuals, blocks, white};
use crate::identify::noise::Colour;
use crate::identify::problem::Problem;
use crate::model::effect::EffectKind;
use crate::model::rig::{Rig, Value};
use rayon::prelude::*;
use std::f64::consts::TAU;
use std::ops::Range;

/// Part of the gain of `richer` over `plain` that is left when its inner states go on from window to window through each whole
/// recording, coordinates and rates fitted anew in each. `None` if there are no inner states that could, or nothing is gained.
///
/// From one window into the next alone, a spring as slow as a window passes: what it holds there is what the free fit of the window
/// before left in it (a cogging motor, windows of .05 s).
#[must_use]
pub fn gain_ratio_with_continuous_states(plain: &FittedModel, richer: &FittedModel, floors: &[f64]) -> Option<f64> {
    if !has_more_states(plain, richer) || richer.problem.windows.len() == richer.problem.recordings.len() {
        return None;
    }
    let held = richer.problem.with_rig(known(&richer.rig));
    let own = white(&richer.residuals, floors);
    let states = chains(&held).into_par_iter().flat_map_iter(|windows| carried_through(&held, richer, windows, &own));
    let residuals = held.residuals(&Point { parameters: Vec::new(), states: states.collect() })?;
    let noise = white(&plain.residuals, floors);
    let total = |h: &FittedModel| -> f64 { h.blocks(&noise).iter().sum() };
    let free = total(richer) - total(plain);
    let left: f64 = blocks(&residuals, &noise).iter().sum::<f64>() - total(plain);
    (free > 0.0).then(|| left / free)
}

/// Windows that follow one another, each chain from one that nothing goes before.
fn chains(of: &Problem) -> Vec<Range<usize>> {
    let starts: Vec<usize> = (0..of.windows.len()).filter(|w| !follows(of, *w)).collect();
    let ends = starts.iter().skip(1).copied().chain([of.windows.len()]);
    starts.iter().zip(ends).map(|(start, end)| *start..end).collect()
}

/// The states of `windows`, which follow one another: the first as fitted, then inner ones that arrive and others that are fitted.
fn carried_through(held: &Problem, of: &FittedModel, windows: Range<usize>, noise: &[Colour]) -> Vec<Vec<f64>> {
    let mut out: Vec<Vec<f64>> = Vec::with_capacity(windows.len());
    for w in windows {
        let fitted = &of.point.states[w];
        let arrived = out.last().and_then(|state| held.arrived(w - 1, &[], state)).filter(|a| a.len() == fitted.len());
        let rigid = held.rigid(w);
        out.push(arrived.map_or_else(
            || fitted.clone(),
            |arrived| {
                let runs = Carried { problem: held, window: w, inner: &arrived[rigid..], rigid };
                let start = Point { parameters: Vec::new(), states: vec![fitted[..rigid].to_vec()] };
                let mut state = fit(&runs, start, &[], noise, FEW_STEPS).point.states.swap_remove(0);
                state.extend_from_slice(&arrived[rigid..]);
                state
            },
        ));
    }
    out
}

/// True if `richer` has inner states that `plain` has not.
#[must_use]
pub fn has_more_states(plain: &FittedModel, richer: &FittedModel) -> bool {
    let count = |h: &FittedModel| h.point.states.first().map_or(0, Vec::len);
    count(richer) > count(plain)
}

/// Likelihoods of a mode of a link: what it explains by how it rings, and by the motion of its link.
#[derive(Clone, Copy, Debug)]
pub struct Ringing {
    /// As fitted.
    pub as_fitted: f64,
    /// At rest at the start of each recording: what its link drives.
    pub from_rest: f64,
    /// Without the mode.
    pub without: f64,
}

impl Ringing {
    /// Of effect `e` of `of`, its inner states going on from window to window. `None` if it is no mode of a link, dies away within a
    /// recording, or cannot be run.
    #[must_use]
    pub fn of_mode(of: &FittedModel, e: usize, floors: &[f64]) -> Option<Self> {
        let effect = of.rig.effects.get(e).filter(|e| e.kind == EffectKind::LinkFlexibility)?;
        let [Some(hz), Some(damping)] = ["frequency", "damping"].map(|key| effect.get(key)) else { return None };
        if damping.value * TAU * hz.value * of.problem.longest_recording_s() > 1.0 {
            return None;
        }
        let noise = white(&of.residuals, floors);
        let total =
            |rig: &Rig, from_rest: bool| unbroken(of, rig, from_rest).map(|r| blocks(&r, &noise).iter().sum::<f64>());
        let mut without = of.rig.clone();
        let share = effect.kind.keys().iter().position(|key| key.name == "participation")?;
        without.effects[e].values[share] = Value::known(0.0);
        Some(Self {
            as_fitted: total(&of.rig, false)?,
            from_rest: total(&of.rig, true)?,
            without: total(&without, true)?,
        })
    }
}

/// The residuals of `of` with `rig`'s numbers held and inner states that go on from window to window: from the first
/// window's, or from rest.
fn unbroken(of: &FittedModel, rig: &Rig, from_rest: bool) -> Option<Residuals> {
    let held = of.problem.with_rig(known(rig));
    let mut at = Point { parameters: Vec::new(), states: of.point.states.clone() };
    let rest = held.start().states;
    for (w, rest) in rest.iter().enumerate() {
        let rigid = held.rigid(w);
        let inner = before(&held, &at, w).or_else(|| from_rest.then(|| rest.clone()));
        if let Some(inner) = inner.filter(|i| i.len() == at.states[w].len()) {
            at.states[w][rigid..].copy_from_slice(&inner[rigid..]);
        }
    }
    held.residuals(&at)
}

/// A few steps from the free fit tell.
const FEW_STEPS: Limits = Limits { iterations: 6, tolerance: 1e-4 };

/// Where the window before `w` arrives, if it is of the same recording and ends where `w` starts.
fn before(problem: &Problem, at: &Point, w: usize) -> Option<Vec<f64>> {
    if follows(problem, w) { problem.arrived(w - 1, &at.parameters, &at.states[w - 1]) } else { None }
}

/// True if `w` starts where the window before it, of the same recording, ends.
fn follows(problem: &Problem, w: usize) -> bool {
    let Some(last) = w.checked_sub(1) else { return false };
    problem.windows[last].0 == problem.windows[w].0 && problem.spans[last].end == problem.spans[w].start
}

/// Free runs of one window whose inner states are known.
struct Carried<'p> {
    problem: &'p Problem,
    window: usize,
    inner: &'p [f64],
    rigid: usize,
}

impl FreeRuns for Carried<'_> {
    fn windows(&self) -> usize {
        1
    }

    fn run(&self, _: usize, parameters: &[f64], state: &[f64], slopes: bool) -> Option<Vec<Series>> {
        let whole = [state, self.inner].concat();
        let mut channels = self.problem.run(self.window, parameters, &whole, slopes)?;
        channels.iter_mut().for_each(|series| series.slopes.truncate(parameters.len() + self.rigid));
        Some(channels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    const RIG: &str = "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = 0.01\ngravity_nm = 0.4\n\
        [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.3\n[[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\n\
        [[effect]]\neffect = \"coulomb_friction\"\nat = \"q1\"\ncoulomb = 0.02\n\
        [[effect]]\neffect = \"presliding\"\nat = \"q1\"\nstiffness = 2.0\n\
        [[effect]]\neffect = \"joint_elasticity\"\nat = \"q1\"\nstiffness = 9.0\ndamping = 0.01\nrotor_inertia = 0.003\n\
        [[effect]]\neffect = \"sensor_lag\"\nat = \"y\"\ntime_constant = 0.03\n";

    fn problem(window_s: Option<f64>) -> Problem {
        Problem::shaken(RIG, window_s, vec![0.0; 200])
    }

    #[test]
    fn a_machine_that_starts_where_it_arrived_goes_on_as_if_it_had_never_stopped() {
        let (whole, halves) = (problem(None), problem(Some(1.0)));
        let mut first = whole.start().states.swap_remove(0);
        (first[0], first[1]) = (0.6, 0.2);
        let at = Point { parameters: Vec::new(), states: vec![first.clone(), first.clone()] };
        assert!(halves.windows.len() == 2 && before(&halves, &at, 0).is_none());
        let arrived = before(&halves, &at, 1).unwrap();
        assert!(arrived.len() == first.len() && arrived.len() > 2, "{arrived:?}");
        let unbroken = &whole.run(0, &[], &first, false).unwrap()[0].residual;
        let again = &halves.run(1, &[], &arrived, false).unwrap()[0].residual;
        let apart = unbroken[100..].iter().zip(again).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(again.len() == 100 && apart < 1e-5, "{apart}");
    }

    /// Part of what a mode of 6 Hz explains that its link drives. It has hardly any damping, runs in two windows that follow each other,
    /// and starts bent by `deflection`.
    fn driven(participation: f64, deflection: f64) -> f64 {
        let rig = format!(
            "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = 0.01\ngravity_nm = 0.4\n\
             [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.3\n[[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\n\
             [[effect]]\neffect = \"link_flexibility\"\nat = \"q1\"\nfrequency = 6.0\ndamping = 0.002\n\
             participation = {participation}\n"
        );
        let floors = [1e-5];
        let of = |measured: Vec<f64>| {
            let problem = Problem::shaken(&rig, Some(1.0), measured);
            let mut at = problem.start();
            let rigid = problem.rigid(0);
            (at.states[0][0], at.states[0][1]) = (0.3, 0.0);
            at.states[0][rigid] = deflection;
            at.states[1] = before(&problem, &at, 1).unwrap();
            FittedModel::at(problem, at, DMatrix::zeros(0, 0), &floors).unwrap()
        };
        let readings = |h: &FittedModel, sign: f64| h.residuals[0].concat().iter().map(|r| sign * r).collect();
        let unread = of(vec![0.0; 200]);
        let exact = [1.0, -1.0].map(|sign| of(readings(&unread, sign)));
        let rms = |h: &FittedModel| h.residuals[0].concat().iter().map(|r| r * r).sum::<f64>();
        let best = exact.iter().min_by(|a, b| rms(a).total_cmp(&rms(b))).unwrap();
        assert!(rms(best) < 1e-12, "{}", rms(best));
        let Ringing { as_fitted, from_rest, without } = Ringing::of_mode(best, 0, &floors).unwrap();
        assert!(as_fitted > without);
        (from_rest - without) / (as_fitted - without)
    }

    /// Part of a mode's gain that stays through four windows of half a second, if its deflection jumps by `jump` where each starts.
    fn kept(jump: f64) -> f64 {
        let bare = "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = 0.01\ngravity_nm = 0.4\n\
            [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.3\n[[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\n";
        let mode = "[[effect]]\neffect = \"link_flexibility\"\nat = \"q1\"\nfrequency = 2.0\ndamping = 0.02\nparticipation = 0.5\n";
        let with_mode = format!("{bare}{mode}");
        let start = |problem: &Problem| {
            let mut at = problem.start();
            (at.states[0][0], at.states[0][1]) = (0.3, 0.0);
            for w in 1..at.states.len() {
                at.states[w] = before(problem, &at, w).unwrap();
                if let Some(deflection) = at.states[w].get_mut(problem.rigid(w)) {
                    *deflection += if w % 2 == 0 { -jump } else { jump };
                }
            }
            at
        };
        let fitted = |rig: &str, measured: Vec<f64>, states: Option<Vec<Vec<f64>>>| {
            let problem = Problem::shaken(rig, Some(0.5), measured);
            let mut at = start(&problem);
            at.states = states.unwrap_or(at.states);
            FittedModel::at(problem, at, DMatrix::zeros(0, 0), &[1e-5]).unwrap()
        };
        let unread = fitted(&with_mode, vec![0.0; 200], None);
        let readings = |sign: f64| -> Vec<f64> { unread.residuals[0].concat().iter().map(|r| sign * r).collect() };
        let rms = |h: &FittedModel| h.residuals[0].concat().iter().map(|r| r * r).sum::<f64>();
        let exact = [1.0, -1.0].map(|sign| fitted(&with_mode, readings(sign), None));
        let which = usize::from(rms(&exact[1]) < rms(&exact[0]));
        let rigid = exact[which].point.states.iter().map(|state| state[..2].to_vec()).collect();
        let plain = fitted(bare, readings([1.0, -1.0][which]), Some(rigid));
        gain_ratio_with_continuous_states(&plain, &exact[which], &[1e-5]).unwrap()
    }

    #[test]
    fn a_mode_that_goes_on_keeps_its_gain_through_a_whole_recording_and_one_that_jumps_at_each_window_does_not() {
        let (steady, jumping) = (kept(0.0), kept(0.5));
        assert!(steady > 0.95, "{steady}");
        assert!(jumping < 0.5, "{jumping}");
    }

    #[test]
    fn a_mode_that_its_link_drives_is_one_and_one_that_only_rings_on_is_shaken_from_elsewhere() {
        assert!(driven(0.2, 0.0) > 0.5, "driven");
        assert!(driven(0.2, 0.001) > 0.5, "driven, and ringing a little at the start");
        assert!(driven(0.001, 3.0) < 0.5, "rings on");
    }
}
