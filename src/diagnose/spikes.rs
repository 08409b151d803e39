//! Transmission errors: single samples that stick out of their neighbours by far more than noise. No model explains them, and
//! neither a fit nor a comparison may hang on them.
//!
//! RT: no.

use crate::diagnose::base::as_given;
use crate::diagnose::hypothesis::Hypothesis;
use crate::identify::experiment::{Experiment, Recording};
use crate::identify::noise::median_abs;
use crate::identify::rollout::Pooled;
use crate::model::rig::{Rig, Use};

/// `experiment` without such samples, for the comparison; and how many were taken out of the recordings left out of the fit.
/// `fitted`: the fit recordings, cleaned; `rig`: whose runs show what sticks out.
#[must_use]
pub fn cleaned(experiment: &Experiment, fitted: &[Recording], rig: &Rig, floors: &[f64]) -> (Experiment, usize) {
    let mut left_out: Vec<Recording> = experiment.of_use(Use::Heldout).cloned().collect();
    let pooled = Pooled::of(&experiment.rig, experiment.of_use(Use::Heldout));
    let of = if left_out.is_empty() { None } else { as_given(rig, &left_out, &pooled, floors) };
    let dropped = of.map_or(0, |of| drop_spikes(&mut left_out, &of).iter().sum());
    let clean =
        |old: &Recording| fitted.iter().chain(&left_out).find(|new| new.index == old.index).unwrap_or(old).clone();
    let recordings = experiment.recordings.iter().map(clean).collect();
    (Experiment { rig: experiment.rig.clone(), recordings }, dropped)
}

/// Takes single samples out that stick out of their neighbours by far more than noise: transmission errors.
///
/// In: a hypothesis whose residual is smooth but for noise. Gives how many were taken out per recording.
pub fn drop_spikes(recordings: &mut [Recording], of: &Hypothesis) -> Vec<usize> {
    let mut dropped = vec![0; recordings.len()];
    for channel in 0..of.rig.sensors.len() {
        let peaks: Vec<Vec<Peak>> = (0..recordings.len()).map(|r| peaks(of, r, channel)).collect();
        let all: Vec<f64> = peaks.iter().flatten().map(|p| p.height).collect();
        let limit = 8.0 * median_abs(&all) / 0.6745;
        if limit <= 0.0 {
            continue;
        }
        for (r, list) in peaks.iter().enumerate() {
            let least = limit.max(of.rig.sensors[channel].quantum * 2.5);
            for peak in list.iter().filter(|p| p.lonely && p.height.abs() > least) {
                recordings[r].measured[channel][peak.row] = f64::NAN;
                dropped[r] += 1;
            }
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
fn peaks(of: &Hypothesis, recording: usize, channel: usize) -> Vec<Peak> {
    let mut out = Vec::new();
    let measured = &of.problem.recordings[recording].measured[channel];
    let windows = of.problem.recordings[recording].windows();
    let mine = of.problem.windows.iter().enumerate().filter(|(_, (r, _))| *r == recording);
    for (flat, (_, w)) in mine {
        let rows: Vec<usize> = windows[*w].clone().filter(|k| measured[*k].is_finite()).collect();
        let e = &of.residuals[channel][flat];
        for k in 1..rows.len().saturating_sub(1) {
            let (a, b, c) = (e[k - 1], e[k], e[k + 1]);
            let middle = b - 0.5 * (a + c);
            let lonely = (b - a) * (b - c) > 0.0 && (b - a).abs().min((b - c).abs()) > 0.5 * middle.abs();
            out.push(Peak { row: rows[k], height: middle, lonely });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::synthesis::record;

    const RIG: &str = "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = 0.01\ngravity_nm = 0.4\n\
        [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.3\n\
        [[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\nnoise_std = 0.001\n\
        [[recording]]\nfile = \"a.csv\"\nuse = \"fit\"\n[[recording]]\nfile = \"b.csv\"\nuse = \"heldout\"\n";

    #[test]
    fn a_wrong_sample_is_left_out_of_the_comparison_too_and_a_push_is_not() {
        let rig = Rig::parse(RIG, "rig.toml").unwrap();
        let times: Vec<f64> = (0..400).map(|k| f64::from(k) * 0.01).collect();
        let inputs = vec![times.iter().map(|t| libm::sin(9.0 * t)).collect()];
        let recording = |index: usize, name: &str, usage: Use| {
            let mut out = Recording { index, usage, ..Recording::new(name, times.clone(), inputs.clone(), Vec::new()) };
            out.measured = record(&rig, &out, &[0.3, 0.0], Some(index as u64)).unwrap().measured;
            out
        };
        let mut recordings = vec![recording(0, "a.csv", Use::Fit), recording(1, "b.csv", Use::Heldout)];
        recordings[1].measured[0][170] += 0.4;
        // Two thirds of a second that no model follows are physics.
        recordings[1].measured[0][300..360].iter_mut().for_each(|y| *y += 0.05);
        let experiment = Experiment { rig: rig.clone(), recordings };
        let (clean, dropped) = cleaned(&experiment, &experiment.recordings[..1], &rig, &[1e-5]);
        assert_eq!(dropped, 1);
        let missing: Vec<usize> = (0..400).filter(|k| clean.recordings[1].measured[0][*k].is_nan()).collect();
        assert_eq!(missing, [170]);
        assert_eq!(clean.recordings[0], experiment.recordings[0]);
    }
}
