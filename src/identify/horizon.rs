//! Pieces of windows, short enough for the base to follow.
//!
//! Where the simulation is far from what was recorded, a fit ends in a false minimum and nothing that is missing is found. Two links that
//! whirl forget their start in a third of a second: over several such times the misfit has a minimum for every turn more or less (measured:
//! a spring of a double pendulum, windows of 1.5 s, was answered as three ripples). And what goes with the angle is sought at the
//! angles where the simulation is (measured: a ripple of 7 cm on a slider that was 2 cm off after 3 s was not found). Over pieces in which
//! an error of the start does not grow e-fold and the base follows, the misfit is smooth (Pisarenko and Sornette, *Statistical methods of
//! parameter estimation for deterministically chaotic time series*, 2004).
//! RT: no.

use crate::identify::base_fit::{fitted, follows};
use crate::identify::experiment::{FEWEST_ROWS, Recording};
use crate::identify::fit::FreeRuns;
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::is_misfit;
use crate::identify::rollout::Pooled;
use crate::model::rig::Rig;
use rayon::prelude::*;
use std::f64::consts::E;

/// `rig` fitted over halves of the windows of `first`, its fit, over halves of these, and so on until it follows, or misses by noise
/// alone, and motion in none of them is chaotic; `only_chaotic`: halved only where it is. Nothing where `first` misses by noise alone.
#[must_use]
pub fn within_horizon(
    rig: &Rig,
    first: &FittedModel,
    only_chaotic: bool,
    (pooled, floors): (&Pooled, &[f64]),
) -> Vec<FittedModel> {
    let is_followed = |of: &FittedModel| follows(of, pooled, floors) || !is_misfit(&of.residuals, floors);
    let mut closer: Vec<FittedModel> = Vec::new();
    while is_misfit(&first.residuals, floors) {
        let now = closer.last().unwrap_or(first);
        let shorter = pieces(now, only_chaotic || !closer.is_empty() && is_followed(now));
        let is_cut = is_cut(&now.problem.recordings, &shorter);
        let Some(next) = is_cut.then(|| fitted(rig, &shorter, pooled, floors)).flatten() else { break };
        closer.push(next);
    }
    closer
}

/// The recordings of `of` in halves of their windows; `only_chaotic`: those in one of which an error of the start grows e-fold. Not
/// where feet land: a touchdown makes errors larger at once, however short the window.
fn pieces(of: &FittedModel, only_chaotic: bool) -> Vec<Recording> {
    let halved = |(r, recording): (usize, &Recording)| {
        let window_s = recording.window_s.map(|whole_s| {
            let has_rows = 0.5 * whole_s >= FEWEST_ROWS as f64 * recording.usual_row_s().unwrap_or(whole_s);
            if has_rows && !recording.has_steps() && (!only_chaotic || is_chaotic(of, r)) {
                0.5 * whole_s
            } else {
                whole_s
            }
        });
        Recording { window_s, ..recording.clone() }
    };
    of.problem.recordings.iter().enumerate().map(halved).collect()
}

/// True if `now` are the same recordings in other windows than `before`.
fn is_cut(before: &[Recording], now: &[Recording]) -> bool {
    before.iter().zip(now).any(|(before, now)| before.window_s != now.window_s)
}

/// True if an error of a coordinate at the start grows e-fold in a window of recording `r`.
fn is_chaotic(of: &FittedModel, r: usize) -> bool {
    let mine = (0..of.problem.windows()).into_par_iter().filter(|w| of.problem.windows[*w].0 == r);
    mine.any(|w| grows(of, w))
}

/// True if an error of a coordinate at the start of window `w` grows e-fold there.
fn grows(of: &FittedModel, w: usize) -> bool {
    let Some(run) = of.problem.run(w, &of.point.parameters, &of.point.states[w], true) else { return false };
    let (shared, degrees) = (of.point.parameters.len(), of.problem.degrees());
    let mut positions = run.iter().zip(&of.problem.rig.sensors).filter(|(_, sensor)| !sensor.is_rate);
    positions.any(|(series, _)| {
        let slopes = || series.slopes.iter().skip(shared).take(degrees);
        let first = slopes().filter_map(|slope| slope.first()).fold(0.0, |most: f64, s| most.max(s.abs()));
        slopes().flatten().any(|s| s.abs() > E * first)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::base_fit::floors;
    use crate::identify::fit::Limits;
    use crate::identify::synthesis::record;
    use crate::model::rig::Effect;

    const LINKS: &str = "schema = 1\nmechanism = \"double_pendulum\"\n[parameters]\ninertia1_kg_m2 = 0.014\n\
        inertia2_kg_m2 = { value = 0.09, min = 0.04, max = 0.2 }\nmoment1_kg_m = 0.13\nmoment2_kg_m = { value = 0.31, min = 0.15, max = \
        0.6 }\nmass2_kg = 1.05\nlength1_m = 0.24\ngravity_m_s2 = 9.81\n\
        [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 1.0\n\
        [[sensor]]\nmeasures = \"q1\"\ncolumn = \"q1_rad\"\nnoise_std = 0.001\n\
        [[sensor]]\nmeasures = \"q2\"\ncolumn = \"q2_rad\"\nnoise_std = 0.001\n\
        [[recording]]\nfile = \"a.csv\"\nuse = \"fit\"\nwindow_s = 1.5\n";
    const SPRING: &str = "[[effect]]\neffect = \"parallel_spring\"\nat = \"q2\"\nstiffness = 1.2\nrest = -0.3\n";

    /// Six seconds of `truth` from `initial`, and what a fit of [`LINKS`] comes to on whole windows and within the horizon.
    fn fits(truth: &str, initial: [f64; 4]) -> (FittedModel, Vec<FittedModel>) {
        let times: Vec<f64> = (0..1200).map(|k| f64::from(k) * 0.005).collect();
        let input = times.iter().map(|t| 0.8 * libm::sin(5.0 * t)).collect();
        let blank = Recording::new("a.csv", times, vec![input], Vec::new());
        let measured = record(&Rig::parse(truth, "truth").unwrap(), &blank, &initial, Some(1)).unwrap().measured;
        let recordings = [Recording { measured, window_s: Some(1.5), ..blank }];
        let rig = Rig::parse(LINKS, "rig.toml").unwrap();
        let pooled = Pooled::of(&rig, recordings.iter());
        let floors = floors(&rig, &pooled, &recordings);
        let first = fitted(&rig, &recordings, &pooled, &floors).unwrap();
        let closer = within_horizon(&rig, &first, false, (&pooled, &floors));
        (first, closer)
    }

    #[test]
    fn links_that_whirl_with_a_force_unknown_are_followed_in_pieces_and_the_unknown_force_is_found_there() {
        let truth = LINKS.to_owned() + SPRING;
        let (first, closer) = fits(&truth, [1.5, 2.5, 3.0, -2.0]);
        let windows: Vec<usize> = closer.iter().map(|of| of.problem.windows()).collect();
        assert!(windows[0] > first.problem.windows() && windows.is_sorted_by(|a, b| a < b), "{windows:?}");
        let last = closer.last().unwrap();
        // From a spring of nothing, fitted beside the base.
        let mut springy = last.rig.clone();
        let free = SPRING
            .replace("1.2", "{ value = 0.01, min = 0.0, max = 10.0 }")
            .replace("-0.3", "{ value = 0.0, min = -3.0, max = 3.0 }");
        let spring: Effect = Rig::parse(&(LINKS.to_owned() + &free), "spring").unwrap().effects[0].clone();
        springy.effects.push(spring);
        let stiffness = |of: &FittedModel| {
            let (problem, start) = of.extended(springy.clone());
            let fit = FittedModel::fitted(problem, start, &of.noise, &[1e-4; 2], Limits::default()).unwrap();
            fit.rig.effects[0].values[0].value
        };
        assert!((stiffness(last) / 1.2 - 1.0).abs() < 0.02, "{}", stiffness(last));
        assert!(
            (stiffness(&first) / 1.2 - 1.0).abs() > 0.2,
            "the whole windows find it as well: {}",
            stiffness(&first)
        );
    }

    #[test]
    fn what_leaves_but_noise_keeps_its_windows() {
        let (first, closer) = fits(LINKS, [0.4, 0.3, 0.5, -0.5]);
        assert!(!is_misfit(&first.residuals, &[1e-4; 2]));
        assert!(closer.is_empty());
    }

    #[test]
    fn a_rail_with_an_unknown_ripple_is_cut_until_it_is_followed_and_no_further() {
        let rig = "schema = 1\nmechanism = \"slider\"\n[parameters]\nmass_kg = { value = 18.0, min = 10.0, max = 40.0 }\n\
            [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 1.0\n\
            [[sensor]]\nmeasures = \"q1\"\ncolumn = \"x\"\nnoise_std = 0.0001\n\
            [[effect]]\neffect = \"viscous_friction\"\nat = \"q1\"\nviscous = { value = 5.0, min = 0.0, max = 20.0 }\n\
            [[recording]]\nfile = \"a.csv\"\nuse = \"fit\"\nwindow_s = 3.0\n";
        let ripple =
            "[[effect]]\neffect = \"torque_ripple\"\nat = \"q1\"\namplitude = 20.0\norder = 80.0\nphase = 0.3\n";
        let times: Vec<f64> = (0..1200).map(|k| f64::from(k) * 0.005).collect();
        let input = times.iter().map(|t| 2.0 * libm::sin(1.1 * t) + 30.0 * libm::sin(9.0 * t)).collect();
        let blank = Recording::new("a.csv", times, vec![input], Vec::new());
        let truth = Rig::parse(&(rig.to_owned() + ripple), "truth").unwrap();
        let measured = record(&truth, &blank, &[0.0, 0.3], Some(1)).unwrap().measured;
        let recordings = [Recording { measured, window_s: Some(3.0), ..blank }];
        let rig = Rig::parse(rig, "rig.toml").unwrap();
        let pooled = Pooled::of(&rig, recordings.iter());
        let floors = floors(&rig, &pooled, &recordings);
        let first = fitted(&rig, &recordings, &pooled, &floors).unwrap();
        let closer = within_horizon(&rig, &first, false, (&pooled, &floors));
        let followed: Vec<bool> = closer.iter().map(|of| follows(of, &pooled, &floors)).collect();
        assert!(followed.last() == Some(&true) && followed.iter().filter(|f| **f).count() == 1, "{followed:?}");
    }
}
