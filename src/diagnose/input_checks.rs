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
    let mut out = unstable(of);
    out.extend(disagreement(of, floors));
    out
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
pub(crate) mod tests {
    use crate::diagnose::identification::identify;
    use crate::identify::experiment::{Experiment, Recording};
    use crate::identify::synthesis::record;
    use crate::model::rig::{RecordingEntry, Rig};

    pub(crate) fn rig(parameters: &str) -> Rig {
        let text = format!(
            "schema = 1\nmechanism = \"pendulum\"\n[parameters]\n{parameters}\n[[actuator]]\njoint = \"q1\"\n\
             column = \"u\"\ngain = 0.05\n[[sensor]]\nmeasures = \"q1\"\ncolumn = \"q_rad\"\nnoise_std = 0.001\n\
             [[recording]]\nfile = \"a.csv\"\nuse = \"fit\"\n[[recording]]\nfile = \"b.csv\"\nuse = \"fit\"\n"
        );
        Rig::parse(&text, "rig.toml").unwrap()
    }

    /// Five seconds of `truth` under two sines, as recording `index` of `of`.
    pub(crate) fn recorded(truth: &Rig, of: &Rig, index: usize, initial: &[f64]) -> Recording {
        let times: Vec<f64> = (0..500).map(|k| f64::from(k) * 0.01).collect();
        let input = times.iter().map(|t| libm::sin(4.0 * t) + libm::sin(7.1 * t + index as f64)).collect();
        let RecordingEntry { file, usage, .. } = &of.recordings[index];
        let recording = Recording::new(file, times, vec![input], Vec::new());
        let mut recording = Recording { index, usage: *usage, ..recording };
        recording.measured = record(truth, &recording, initial, Some(index as u64)).unwrap().measured;
        recording
    }

    pub(crate) fn warnings(truths: [&Rig; 2], model: Rig) -> String {
        let recordings = truths.iter().enumerate().map(|(i, truth)| recorded(truth, &model, i, &[0.3])).collect();
        identify(&Experiment { rig: model, recordings }).unwrap().found.warnings.join("\n")
    }

    pub(crate) const FREE: &str = "inertia_kg_m2 = { value = 0.011, min = 0.005, max = 0.03 }\n\
        gravity_nm = { value = 0.36, min = 0.2, max = 0.8 }";

    #[test]
    fn a_case_without_any_motion_is_refused_with_what_is_wrong() {
        let model = rig(FREE);
        let mut still = recorded(&model, &model, 0, &[0.3]);
        still.measured[0].fill(0.3);
        still.warnings = vec!["a.csv: column `q_rad` never changes".to_owned()];
        let refused = identify(&Experiment { rig: model, recordings: vec![still] }).unwrap_err().to_string();
        assert!(refused.contains("no column") && refused.contains("never changes"), "{refused}");
    }

    #[test]
    fn a_number_at_a_bound_of_its_own_is_told_with_the_remedy() {
        let truth = rig("inertia_kg_m2 = 0.010\ngravity_nm = 0.35");
        let said = warnings([&truth, &truth], rig(&FREE.replace("min = 0.005", "min = 0.0105")));
        assert!(said.contains("inertia_kg_m2 is at its lower bound 0.0105") && said.contains("widen"), "{said}");
    }

    #[test]
    fn an_unstable_mechanism_without_windows_is_told_to_use_them() {
        // Two links thrown from above the horizontal: chaotic.
        let links = "inertia1_kg_m2 = 0.031\ninertia2_kg_m2 = 0.016\nmoment1_kg_m = 0.12\nmoment2_kg_m = 0.075\n\
            mass2_kg = 0.5\nlength1_m = 0.3\ngravity_m_s2 = 9.81";
        let double = |parameters: &str| {
            let text = rig(FREE).to_toml().replace("\"pendulum\"", "\"double_pendulum\"");
            let from = text.find("[parameters]").unwrap();
            let to = text.find("[[actuator]]").unwrap();
            let text = format!("{}[parameters]\n{parameters}\n\n{}", &text[..from], &text[to..]);
            Rig::parse(&text, "rig.toml").unwrap()
        };
        let truth = double(links);
        let model = double(&links.replace("= 0.12", "= { value = 0.1201, min = 0.1, max = 0.15 }"));
        let recordings = (0..2).map(|i| recorded(&truth, &model, i, &[2.4, 1.0])).collect();
        let said = identify(&Experiment { rig: model, recordings }).unwrap().found.warnings.join("\n");
        assert!(said.contains("a.csv: unstable or chaotic") && said.contains("`window_s = "), "{said}");
    }

    #[test]
    fn a_held_out_recording_far_worse_than_the_fitted_ones_is_a_contradiction() {
        let line = |use_: &str, error: f64| crate::report::findings::Figure {
            recording: "c.csv".into(),
            use_: use_.into(),
            channel: "q1_rad".into(),
            nrmse_given: 1.0,
            nrmse_refitted: 1.0,
            nrmse_explained: error,
        };
        let said = super::contradicted(&[line("fit", 0.008), line("fit", 0.02), line("heldout", 1.8)]);
        assert!(said.len() == 1 && said[0].contains("q1_rad is off by 1.80"), "{said:?}");
        assert!(super::contradicted(&[line("fit", 0.3), line("heldout", 0.6)]).is_empty());
        assert!(super::contradicted(&[line("fit", 0.001), line("heldout", 0.05)]).is_empty());
    }
}
