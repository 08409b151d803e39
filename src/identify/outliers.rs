//! Transmission errors: single samples that stick out of their neighbours by far more than noise. No model explains them, and
//! neither a fit nor a comparison may hang on them.
//!
//! RT: no.

use crate::identify::experiment::{Experiment, Recording};
use crate::identify::fitted_model::FittedModel;
use crate::identify::noise::median_abs;
use crate::identify::rollout::{FreeRun, Pooled, free_run};
use crate::model::rig::{Rig, Use};
use rayon::prelude::*;
use std::ops::Range;

/// `experiment` without such samples, for the comparison, and how many there were: what `rig` shows of each recording by
/// itself, so that anyone who has the model and a recording leaves the same samples out.
#[must_use]
pub fn cleaned(experiment: &Experiment, rig: &Rig) -> (Experiment, usize) {
    let of = |usage: Use| {
        let recordings: Vec<Recording> = experiment.of_use(usage).cloned().collect();
        clean(rig, recordings)
    };
    let [(fit, a), (heldout, b)] = [of(Use::Fit), of(Use::Heldout)];
    let new = |old: &Recording| fit.iter().chain(&heldout).find(|new| new.index == old.index).unwrap_or(old).clone();
    let recordings = experiment.recordings.iter().map(new).collect();
    (Experiment { rig: experiment.rig.clone(), recordings }, a + b)
}

/// Recordings of one use without such samples, and how many there were. One on which `rig` runs away stays as it is.
#[must_use]
pub fn clean(rig: &Rig, mut recordings: Vec<Recording>) -> (Vec<Recording>, usize) {
    let pooled = Pooled::of(rig, recordings.iter());
    let one =
        |recording: &mut Recording| free_run(rig, recording, &pooled).map_or(0, |run| drop_seen(recording, rig, &run));
    let dropped = recordings.par_iter_mut().map(one).sum();
    (recordings, dropped)
}

/// Takes out what sticks out of the residual of a free run; how many.
fn drop_seen(recording: &mut Recording, rig: &Rig, run: &FreeRun) -> usize {
    let windows = recording.windows();
    let mut dropped = 0;
    for (channel, sensor) in rig.sensors.iter().enumerate() {
        let (measured, predicted) = (&recording.measured[channel], &run.predicted[channel]);
        let in_window = |window: &Range<usize>| {
            let rows: Vec<usize> = window.clone().filter(|k| measured[*k].is_finite()).collect();
            let residual: Vec<f64> = rows.iter().map(|k| predicted[*k] - measured[*k]).collect();
            peaks_of(&rows, &residual)
        };
        let peaks: Vec<Peak> = windows.iter().flat_map(in_window).collect();
        for row in sticking_out(&[peaks], sensor.quantum).into_iter().flatten() {
            recording.measured[channel][row] = f64::NAN;
            dropped += 1;
        }
    }
    dropped
}

/// Rows of the peaks of one channel that stick out of all of them, by recording.
fn sticking_out(peaks: &[Vec<Peak>], quantum: f64) -> Vec<Vec<usize>> {
    let all: Vec<f64> = peaks.iter().flatten().map(|p| p.height).collect();
    let limit = 8.0 * median_abs(&all) / 0.6745;
    let least = limit.max(quantum * 2.5);
    let out = |p: &&Peak| limit > 0.0 && p.lonely && p.height.abs() > least;
    peaks.iter().map(|list| list.iter().filter(out).map(|p| p.row).collect()).collect()
}

/// Takes single samples out that stick out of their neighbours by far more than noise: transmission errors.
///
/// In: a hypothesis whose residual is smooth but for noise. Gives how many were taken out per recording.
pub fn drop_spikes(recordings: &mut [Recording], of: &FittedModel) -> Vec<usize> {
    let mut dropped = vec![0; recordings.len()];
    for channel in 0..of.rig.sensors.len() {
        let peaks: Vec<Vec<Peak>> = (0..recordings.len()).map(|r| peaks(of, r, channel)).collect();
        let rows = sticking_out(&peaks, of.rig.sensors[channel].quantum);
        for (r, rows) in rows.into_iter().enumerate() {
            dropped[r] += rows.len();
            rows.into_iter().for_each(|row| recordings[r].measured[channel][row] = f64::NAN);
        }
    }
    dropped
}

/// How far a sample sticks out of its neighbours.
struct Peak {
    row: usize,
    height: f64,
    /// It has no neighbour on its side: a spike, not a jump that stays.
    lonely: bool,
}

/// Residual of each row minus the mean of its two neighbours, where all three lie in one window.
fn peaks(of: &FittedModel, recording: usize, channel: usize) -> Vec<Peak> {
    let mut out = Vec::new();
    let measured = &of.problem.recordings[recording].measured[channel];
    let windows = of.problem.recordings[recording].windows();
    let mine = of.problem.windows.iter().enumerate().filter(|(_, (r, _))| *r == recording);
    for (flat, (_, w)) in mine {
        let rows: Vec<usize> = windows[*w].clone().filter(|k| measured[*k].is_finite()).collect();
        out.extend(peaks_of(&rows, &of.residuals[channel][flat]));
    }
    out
}

/// The same of one window: rows with a sample and their residuals.
fn peaks_of(rows: &[usize], e: &[f64]) -> Vec<Peak> {
    let one = |k: usize| {
        let (a, b, c) = (e[k - 1], e[k], e[k + 1]);
        let middle = b - 0.5 * (a + c);
        let lonely = (b - a) * (b - c) > 0.0 && (b - a).abs().min((b - c).abs()) > 0.5 * middle.abs();
        Peak { row: rows[k], height: middle, lonely }
    };
    (1..rows.len().saturating_sub(1)).map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::synthesis::shaken_pendulum;

    #[test]
    fn a_wrong_sample_is_left_out_of_the_comparison_too_and_a_push_is_not() {
        let mut experiment = shaken_pendulum();
        let recordings = &mut experiment.recordings;
        recordings[1].measured[0][170] += 0.4;
        // Two thirds of a second that no model follows are physics.
        recordings[1].measured[0][300..360].iter_mut().for_each(|y| *y += 0.05);
        let (clean, dropped) = cleaned(&experiment, &experiment.rig);
        assert_eq!(dropped, 1);
        let missing: Vec<usize> = (0..400).filter(|k| clean.recordings[1].measured[0][*k].is_nan()).collect();
        assert_eq!(missing, [170]);
        assert_eq!(clean.recordings[0], experiment.recordings[0]);
    }
}
