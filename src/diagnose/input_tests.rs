//! What an identification and a diagnosis say of recordings that are odd: of a machine that stands still, that is chaotic, of two
//! machines, of a reading with the wrong sign.

use crate::diagnose::identification::identify;
use crate::diagnose::pipeline::{Options, diagnose};
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
    let answer = diagnose(&Experiment { rig: rig(FREE), recordings }, Options::default(), |_| ()).unwrap().findings;
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
    let answer =
        diagnose(&Experiment { rig: rig(FREE), recordings: recordings.collect() }, Options::default(), |_| ()).unwrap();
    assert!(answer.findings.diagnosis.verdict.is_mismatch(), "{:?}", answer.findings.diagnosis);
}
