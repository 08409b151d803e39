//! What a base fit makes suspicious about its input: runs that forget their start, recordings of different machines.
//!
//! RT: no.

use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::likelihood::white;
use crate::diagnose::tables::estimates;
use crate::diagnose::unlisted::Unlisted;
use crate::identify::experiment::Recording;
use crate::identify::fit::{FreeRuns, Limits, Point};
use crate::identify::noise::{Colour, median_abs};
use crate::identify::problem::Problem;
use crate::identify::rollout::Pooled;
use crate::identify::theta::Theta;
use crate::model::rig::Rig;
use crate::report::findings::{Estimate, Figure};
use crate::report::table::number;

/// Warnings that go with a base fit: what, where, remedy.
#[must_use]
pub fn suspicions(of: &Hypothesis, floors: &[f64]) -> Vec<String> {
    let mut out = unstable(of);
    out.extend(disagreement(of, floors));
    out
}

/// A start that grows by this factor within a window is lost in it.
const LOST: f64 = 3e3;

/// Growth at which a window should end.
const ENOUGH: f64 = 30.0;

/// One line per recording whose windows are too long for an unstable or chaotic motion; one linearisation.
fn unstable(of: &Hypothesis) -> Vec<String> {
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

/// Largest growth of an initial coordinate within a window, and the time after which it is [`ENOUGH`].
fn growth(of: &Hypothesis, flat: usize, window: usize, recording: &Recording) -> Option<(f64, f64)> {
    let channels = of.problem.run(flat, &of.point.parameters, &of.point.states[flat], true)?;
    let rows = recording.windows()[window].clone();
    let (first, count) = (of.point.parameters.len(), of.problem.degrees());
    let mut worst = (0.0_f64, f64::INFINITY);
    for (series, _) in channels.iter().zip(&of.rig.sensors).filter(|(_, s)| !s.is_rate) {
        for slope in series.slopes.iter().skip(first).take(count) {
            for (k, x) in slope.iter().enumerate().filter(|(_, x)| x.is_finite()) {
                worst.0 = worst.0.max(x.abs());
                if x.abs() > ENOUGH {
                    worst.1 = worst.1.min(recording.times[rows.start + k] - recording.times[rows.start]);
                }
            }
        }
    }
    Some(worst)
}

/// One line per number of `given` that the data pull to a bound. Zero is where nature ends, no bound of a person.
#[must_use]
pub fn at_bounds(of: &Hypothesis, given: &Rig) -> Vec<String> {
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

/// Residuals that fall by this factor when each recording is fitted alone ask whether all are of one machine.
const ALONE: f64 = 3.0;

/// A residual within this factor of the sample-to-sample noise is explained.
const EXPLAINED: f64 = 2.0;

/// A residual of so many times the noise of neighbouring samples that is this part of the channel's spread is no agreement.
const UNFOLLOWED: f64 = 5.0;
const MOSTLY: f64 = 0.3;

/// The answer where nothing was found and a channel does not follow all the same: its sign, its column, its place.
#[must_use]
pub fn unfollowed(of: &Hypothesis, floors: &[f64]) -> Option<Unlisted> {
    let worst = |c: usize| {
        let residual: Vec<f64> = of.residuals[c].iter().flatten().copied().collect();
        let rms = libm::sqrt(residual.iter().map(|x| x * x).sum::<f64>() / residual.len().max(1) as f64);
        let pooled = Pooled::of(&of.rig, of.problem.recordings.iter());
        let clear = (0..of.problem.recordings.len()).any(|r| over_noise(of, r, c, floors) > UNFOLLOWED);
        (clear && rms > MOSTLY * pooled.std[c]).then(|| (c, rms / pooled.std[c]))
    };
    let channels = (0..of.rig.sensors.len()).filter(|c| floors[*c].is_finite());
    let (c, part) = channels.filter_map(worst).max_by(|a, b| a.1.total_cmp(&b.1))?;
    let column = &of.rig.sensors[c].column;
    Some(Unlisted::at(
        column,
        format!(
            "The simulation does not follow {column}: it is off by {part:.2} of its spread, and no effect and no force of the \
             library mends that. Check the column's sign, its unit and what rig.toml says that it measures."
        ),
    ))
}

/// The answer where every recording agrees with the model by itself, but not with the others, and `found` does not bring
/// them together: they are of different machines.
#[must_use]
pub fn no_common_machine(base: &Hypothesis, found: &Hypothesis, floors: &[f64]) -> Option<Unlisted> {
    let count = found.problem.recordings.len();
    if (0..count).all(|r| excess(found, r, floors) <= EXPLAINED) {
        return None;
    }
    let text = disagreement(base, floors)?;
    let at = base.rig.mechanism.coordinates()[0];
    Some(Unlisted::at(at, format!("{}{}.", text[..1].to_uppercase(), &text[1..])))
}

/// Says so if every recording agrees with the model by itself, but not with the others.
fn disagreement(of: &Hypothesis, floors: &[f64]) -> Option<String> {
    let count = of.problem.recordings.len();
    if count < 2 || of.point.parameters.is_empty() {
        return None;
    }
    let noise = white(&of.residuals, floors);
    // Cheap first: nothing to ask for where the common fit explains everything.
    let together: Vec<f64> = (0..count).map(|r| excess(of, r, floors)).collect();
    if together.iter().all(|x| *x < ALONE) {
        return None;
    }
    // The first that is not explained even by itself ends the search: physics is missing there, not a parameter.
    let explained = |r: usize| alone(of, r, &noise, floors).filter(|a| excess(a, 0, floors) <= EXPLAINED);
    let alone: Vec<Hypothesis> = (0..count).map(explained).collect::<Option<_>>()?;
    if !alone.iter().zip(&together).any(|(a, before)| *before > ALONE * excess(a, 0, floors)) {
        return None;
    }
    let values: Vec<Vec<f64>> = alone.iter().map(|a| a.problem.values(&a.point.parameters)).collect();
    let spread = |i: usize| {
        let (low, high) = values.iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v[i]), h.max(v[i])));
        (high - low) / low.abs().max(high.abs()).max(1e-300)
    };
    let most = (0..values[0].len()).max_by(|a, b| spread(*a).total_cmp(&spread(*b)))?;
    let each = of.problem.recordings.iter().zip(&values).map(|(r, v)| format!("{} in {}", number(v[most]), r.name));
    Some(format!(
        "each recording agrees with the model by itself, but not with the others: {} is {}; are they all of the same rig? \
         What differs on purpose belongs into `parameters` of its recording in rig.toml",
        of.problem.theta.entries[most].name,
        each.collect::<Vec<_>>().join(", ")
    ))
}

/// The same rig fitted to one recording only.
fn alone(of: &Hypothesis, recording: usize, noise: &[Colour], floors: &[f64]) -> Option<Hypothesis> {
    let problem = Problem::new(of.rig.clone(), vec![of.problem.recordings[recording].clone()]);
    let mine = of.problem.windows.iter().zip(&of.point.states).filter(|((r, _), _)| *r == recording);
    let start = Point { parameters: problem.vector(), states: mine.map(|(_, state)| state.clone()).collect() };
    Hypothesis::fitted(problem, start, noise, floors, Limits { iterations: 10, tolerance: 1e-4 })
}

/// Residual of one recording over its sample-to-sample noise, the worst channel.
fn excess(of: &Hypothesis, recording: usize, floors: &[f64]) -> f64 {
    let channels = (0..of.rig.sensors.len()).filter(|c| floors[*c].is_finite());
    channels.map(|c| over_noise(of, recording, c, floors)).fold(0.0, f64::max)
}

/// Residual of one channel of a recording over its sample-to-sample noise.
fn over_noise(of: &Hypothesis, recording: usize, c: usize, floors: &[f64]) -> f64 {
    let windows = (0..of.problem.windows.len()).filter(|w| of.problem.windows[*w].0 == recording);
    let samples = &of.problem.recordings[recording].measured[c];
    let bends: Vec<f64> = samples.windows(3).map(|y| y[0] - 2.0 * y[1] + y[2]).collect();
    let noise = (median_abs(&bends) / (0.6745 * libm::sqrt(6.0))).max(floors[c]);
    let residual: Vec<f64> = windows.flat_map(|w| of.residuals[c][w].iter().copied()).collect();
    let rms = libm::sqrt(residual.iter().map(|x| x * x).sum::<f64>() / residual.len().max(1) as f64);
    if noise.is_finite() && noise > 0.0 { rms / noise } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use crate::diagnose::identification::identify;
    use crate::diagnose::pipeline::diagnose;
    use crate::identify::experiment::{Experiment, Recording};
    use crate::identify::synthesis::record;
    use crate::model::rig::{RecordingEntry, Rig};

    fn rig(parameters: &str) -> Rig {
        let text = format!(
            "schema = 1\nmechanism = \"pendulum\"\n[parameters]\n{parameters}\n[[actuator]]\njoint = \"q1\"\n\
             column = \"u\"\ngain = 0.05\n[[sensor]]\nmeasures = \"q1\"\ncolumn = \"q_rad\"\nnoise_std = 0.001\n\
             [[recording]]\nfile = \"a.csv\"\nuse = \"fit\"\n[[recording]]\nfile = \"b.csv\"\nuse = \"fit\"\n"
        );
        Rig::parse(&text, "rig.toml").unwrap()
    }

    /// Five seconds of `truth` under two sines, as recording `index` of `of`.
    fn recorded(truth: &Rig, of: &Rig, index: usize, initial: &[f64]) -> Recording {
        let times: Vec<f64> = (0..500).map(|k| f64::from(k) * 0.01).collect();
        let input = times.iter().map(|t| libm::sin(4.0 * t) + libm::sin(7.1 * t + index as f64)).collect();
        let RecordingEntry { file, usage, .. } = &of.recordings[index];
        let recording = Recording::new(file, times, vec![input], Vec::new());
        let mut recording = Recording { index, usage: *usage, ..recording };
        recording.measured = record(truth, &recording, initial, Some(index as u64)).unwrap().measured;
        recording
    }

    fn warnings(truths: [&Rig; 2], model: Rig) -> String {
        let recordings = truths.iter().enumerate().map(|(i, truth)| recorded(truth, &model, i, &[0.3])).collect();
        identify(&Experiment { rig: model, recordings }).unwrap().found.warnings.join("\n")
    }

    const FREE: &str = "inertia_kg_m2 = { value = 0.011, min = 0.005, max = 0.03 }\n\
        gravity_nm = { value = 0.36, min = 0.2, max = 0.8 }";

    #[test]
    fn two_recordings_of_different_rigs_are_told_apart_by_what_differs() {
        let (light, heavy) =
            (rig("inertia_kg_m2 = 0.010\ngravity_nm = 0.35"), rig("inertia_kg_m2 = 0.015\ngravity_nm = 0.36"));
        let said = warnings([&light, &heavy], rig(FREE));
        assert!(said.contains("all of the same rig") && said.contains("inertia_kg_m2"), "{said}");
        assert!(said.contains("a.csv") && said.contains("b.csv"), "{said}");
        assert_eq!(warnings([&light, &light], rig(FREE)), "");
    }

    #[test]
    fn a_diagnosis_of_two_machines_names_no_physics_but_what_differs() {
        let (light, heavy) =
            (rig("inertia_kg_m2 = 0.010\ngravity_nm = 0.35"), rig("inertia_kg_m2 = 0.016\ngravity_nm = 0.36"));
        let recordings =
            [&light, &heavy].iter().enumerate().map(|(i, truth)| recorded(truth, &rig(FREE), i, &[0.3])).collect();
        let answer = diagnose(&Experiment { rig: rig(FREE), recordings }, 0, |_| ()).unwrap().findings;
        let [entry] = &answer.diagnosis.missing[..] else { panic!("{:?}", answer.diagnosis.missing) };
        assert_eq!((entry.one_of[0].effect.as_str(), entry.one_of.len()), ("unlisted", 1));
        assert!(entry.sentence.contains("inertia_kg_m2") && entry.sentence.contains("same rig"), "{}", entry.sentence);
        assert!(!answer.warnings.iter().any(|w| w.contains("same rig")), "said twice: {:?}", answer.warnings);
    }

    #[test]
    fn a_reading_of_the_wrong_sign_is_never_called_explained() {
        let truth = rig("inertia_kg_m2 = 0.010\ngravity_nm = 0.35");
        let recordings = (0..2).map(|i| {
            let mut recording = recorded(&truth, &truth, i, &[0.3]);
            recording.inputs[0].iter_mut().for_each(|u| *u = -*u);
            recording
        });
        let answer = diagnose(&Experiment { rig: rig(FREE), recordings: recordings.collect() }, 0, |_| ()).unwrap();
        assert!(answer.findings.diagnosis.verdict.is_mismatch(), "{:?}", answer.findings.diagnosis);
    }

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
