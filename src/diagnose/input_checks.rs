//! What a base fit makes suspicious about its input: runs that forget their start, numbers at bounds, recordings that
//! contradict the answer.
//!
//! RT: no.

use crate::diagnose::judge::estimates::estimates;
use crate::diagnose::nameless::pooling_test::disagreement;
use crate::identify::experiment::Recording;
use crate::identify::fit::FreeRuns;
use crate::identify::fitted_model::FittedModel;
use crate::identify::theta::Theta;
use crate::model::rig::Rig;
use crate::report::findings::{Estimate, Figure};
use crate::report::table::number;

/// Warnings that go with a base fit: what, where, remedy.
#[must_use]
pub fn suspicions(of: &FittedModel, floors: &[f64]) -> Vec<String> {
    let mut out = far_from_zero(of);
    out.extend(unstable(of));
    out.extend(disagreement(of, floors));
    out
}

/// A recording that begins later than so many times its own length counts from something else than its start.
const FAR: f64 = 100.0;

/// One line if times count from a computer's start, or from 1970: what grows with time has grown as long by then.
fn far_from_zero(of: &FittedModel) -> Vec<String> {
    let is_far = |recording: &&Recording| match recording.times[..] {
        [first, .., last] => first > FAR * (last - first),
        _ => false,
    };
    let line = |recording: &Recording| {
        format!(
            "{}: its times begin at {} s: drifts and errors of a sensor's clock count from 0 s; subtract the first row's time",
            recording.name,
            number(recording.times[0])
        )
    };
    of.problem.recordings.iter().find(is_far).map(line).into_iter().collect()
}

/// A start that grows by this factor within a window is lost in it.
const LOST: f64 = 3e3;

/// Growth at which a window should end.
const GROWTH_OF_A_WINDOW: f64 = 30.0;

/// One line per recording whose windows are too long for an unstable or chaotic motion; one linearisation.
fn unstable(of: &FittedModel) -> Vec<String> {
    let mut out = Vec::new();
    for (r, recording) in of.problem.recordings.iter().enumerate() {
        let windows = of.problem.windows.iter().enumerate().filter(|(_, (of, _))| *of == r);
        let worst =
            windows.filter_map(|(flat, (_, w))| growth(of, flat, *w, recording)).max_by(|a, b| a.0.total_cmp(&b.0));
        let Some((factor, enough_s)) = worst.filter(|(factor, _)| *factor > LOST) else { continue };
        out.push(format!(
            "{}: unstable or chaotic: an error of the start grows {factor:.0e} times within a window; set `window_s = {}` \
             for it in rig.toml",
            recording.name,
            number(enough_s)
        ));
    }
    out
}

/// Largest growth of an initial coordinate within a window, and the time after which it is [`GROWTH_OF_A_WINDOW`].
fn growth(of: &FittedModel, flat: usize, window: usize, recording: &Recording) -> Option<(f64, f64)> {
    let channels = of.problem.run(flat, &of.point.parameters, &of.point.states[flat], true)?;
    let rows = recording.windows()[window].clone();
    let (first, count) = (of.point.parameters.len(), of.problem.degrees());
    let mut worst = (0.0_f64, f64::INFINITY);
    for (series, _) in channels.iter().zip(&of.rig.sensors).filter(|(_, s)| !s.is_rate) {
        for slope in series.slopes.iter().skip(first).take(count) {
            for (k, x) in slope.iter().enumerate().filter(|(_, x)| x.is_finite()) {
                worst.0 = worst.0.max(x.abs());
                if x.abs() > GROWTH_OF_A_WINDOW {
                    worst.1 = worst.1.min(recording.times[rows.start + k] - recording.times[rows.start]);
                }
            }
        }
    }
    Some(worst)
}

/// One line per number of `given` that the data pull to a bound. Zero is where nature ends, no bound of a person.
#[must_use]
pub fn at_bounds(of: &FittedModel, given: &Rig) -> Vec<String> {
    let own = Theta::of(given);
    let line = |(name, fitted): (String, Estimate)| {
        let bounds = own.entries[own.index_of(&name)?].bounds;
        let width = bounds.max - bounds.min;
        let near = |bound: f64| bound.abs() > 0.0 && (fitted.value - bound).abs() <= 1e-6 * width;
        let (side, bound) = [("lower", bounds.min), ("upper", bounds.max)].into_iter().find(|(_, b)| near(*b))?;
        // What the data do not see stays where it was, and has the deviation of anything between the bounds: .29 widths.
        (fitted.std < 0.25 * width).then(|| {
            format!(
                "{name} is at its {side} bound {}: the recordings want it beyond; widen the bound in rig.toml if the \
                 machine allows it, else the model or a unit is wrong",
                number(bound)
            )
        })
    };
    estimates(of).into_iter().filter_map(line).collect()
}

/// A held-out recording that is explained so many times worse than all that were fitted contradicts the answer, where its
/// error is this part of its spread.
const WORSE: f64 = 5.0;
const NOTABLE: f64 = 0.1;

/// Says so of each held-out channel that the answer does not explain, though it explains what was fitted.
#[must_use]
pub fn contradicted(fit: &[Figure]) -> Vec<String> {
    let worst_fitted = |channel: &str| {
        let fitted = fit.iter().filter(|l| l.use_ == "fit" && l.channel == channel);
        fitted.map(|l| l.nrmse_explained).fold(0.0, f64::max)
    };
    let line = |l: &Figure| {
        let fitted = worst_fitted(&l.channel);
        (l.use_ == "heldout" && l.nrmse_explained > NOTABLE.max(WORSE * fitted) && fitted > 0.0).then(|| {
            format!(
                "{} (held out) contradicts this: {} is off by {:.2} of its spread there, by {:.3} at most where it was fitted; \
                 what is missing shows only there: mark it use = \"fit\" and hold another recording out",
                l.recording, l.channel, l.nrmse_explained, fitted
            )
        })
    };
    fit.iter().filter_map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_held_out_recording_far_worse_than_the_fitted_ones_is_a_contradiction() {
        let line = |use_: &str, error: f64| Figure {
            recording: "c.csv".into(),
            use_: use_.into(),
            channel: "q1_rad".into(),
            nrmse_given: 1.0,
            nrmse_refitted: 1.0,
            nrmse_explained: error,
        };
        let said = contradicted(&[line("fit", 0.008), line("fit", 0.02), line("heldout", 1.8)]);
        assert!(said.len() == 1 && said[0].contains("q1_rad is off by 1.80"), "{said:?}");
        assert!(contradicted(&[line("fit", 0.3), line("heldout", 0.6)]).is_empty());
        assert!(contradicted(&[line("fit", 0.001), line("heldout", 0.05)]).is_empty());
    }
}
