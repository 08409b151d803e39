//! A case on disk, as the contract wants it, and its truth in the form that `score` reads. RT: no.

use std::fmt::Write as _;
use std::fs;
use std::io;
use std::path::Path;

use super::case::{Case, Level};
use super::effect::{Effect, PUSH_S};
use super::experiment::{ROW_S, Recording};
use super::rig::{Kind, Rig};
use crate::trial::score::{Accepted, Hidden, Interval, Recoverable, Simulated};

/// Names of the recordings.
fn file(number: usize) -> String {
    format!("run_{}.csv", ["a", "b", "c", "d"].get(number).copied().unwrap_or("x"))
}

/// Writes `rig.toml` and the recordings into `folder`.
pub(super) fn write(case: &Case, name: &str, folder: &Path) -> io::Result<()> {
    fs::create_dir_all(folder)?;
    fs::write(folder.join("rig.toml"), rig_text(case, name))?;
    for (recording, readings) in case.recordings.iter().zip(&case.readings) {
        fs::write(folder.join(file(recording.number)), rows(&case.published, recording, readings))?;
    }
    Ok(())
}

/// Significant digits of a published number.
fn digits(value: f64) -> String {
    if value == 0.0 {
        "0.0".to_owned()
    } else {
        format!("{:?}", format!("{value:.4e}").parse::<f64>().unwrap_or(value))
    }
}

fn bounded(value: f64, low: f64, high: f64) -> String {
    let (low, high) = if value < 0.0 { (high, low) } else { (low, high) };
    format!("{{ value = {}, min = {}, max = {} }}", digits(value), digits(low * value), digits(high * value))
}

fn rig_text(case: &Case, name: &str) -> String {
    let rig = &case.published;
    let mut text = format!("schema = 1\nname = \"{name}\"\nmechanism = \"{}\"\n\n[parameters]\n", rig.kind.mechanism());
    for (key, value) in rig.values.iter().filter(|(key, _)| !key.contains('@')) {
        let shown = if rig.uncertain.contains(key) {
            bounded(*value, 0.5, 2.0)
        } else {
            format!("{{ value = {} }}", digits(*value))
        };
        text += &format!("{key} = {shown}\n");
    }
    for (joint, column, gain) in &rig.joints {
        text += &format!("\n[[actuator]]\njoint = \"{joint}\"\ncolumn = \"{column}\"\ngain = {{ value = {gain:?} }}\n");
    }
    text += &sensors_text(rig);
    for (key, value) in &rig.values {
        if let Some((what, at)) = key.split_once('@') {
            let shown = bounded(*value, 0.0, 6.0);
            text += &format!("\n[[effect]]\neffect = \"{what}_friction\"\nat = \"{at}\"\n{what} = {shown}\n");
        }
    }
    if rig.kind == Kind::Biped {
        let [stiffness, rest] = rig.spring;
        let leg = ["inner", "outer"][rig.stance()];
        text += &format!(
            "\n[[effect]]\neffect = \"parallel_spring\"\nat = \"{leg}\"\nstiffness = {{ value = {stiffness:?} }}\n\
             rest = {{ value = {rest:?} }}\n"
        );
    }
    text + &recordings_text(case)
}

fn sensors_text(rig: &Rig) -> String {
    let mut text = String::new();
    for sensor in &rig.sensors {
        text += &format!("\n[[sensor]]\nmeasures = \"{}\"\ncolumn = \"{}\"\n", sensor.measures, sensor.column);
        if sensor.quantum > 0.0 {
            text += &format!("noise_std = {}\nquantum = {:?}\n", digits(sensor.noise), sensor.quantum);
        }
    }
    text
}

fn recordings_text(case: &Case) -> String {
    let mut text = String::new();
    for recording in &case.recordings {
        let role = if recording.heldout { "heldout" } else { "fit" };
        let window = case.published.window_s;
        text += &format!(
            "\n[[recording]]\nfile = \"{}\"\nuse = \"{role}\"\nwindow_s = {window:?}\n",
            file(recording.number)
        );
        if case.published.is_legged() {
            text += &format!("setup = \"{}\"\n", case.published.setup);
        }
        if case.published.kind == Kind::Walker {
            text += "stance_column = \"stance\"\n";
        }
    }
    text
}

fn rows(rig: &Rig, recording: &Recording, readings: &[Vec<f64>]) -> String {
    let mut text = "t_s".to_owned();
    for (_, column, _) in &rig.joints {
        text += &format!(",{column}");
    }
    for sensor in &rig.sensors {
        text += &format!(",{}", sensor.column);
    }
    text += if recording.stance.is_empty() { "" } else { ",stance" };
    text.push('\n');
    for (k, command) in recording.commands.iter().enumerate() {
        // Writing into a string cannot fail.
        write!(text, "{}", (k as f64 * ROW_S * 1e6).round() / 1e6).unwrap_or_default();
        for u in command.iter().take(rig.joints.len()) {
            write!(text, ",{u}").unwrap_or_default();
        }
        for signal in readings {
            cell(&mut text, signal[k]);
        }
        if let Some(leg) = recording.stance.get(k) {
            write!(text, ",{leg}").unwrap_or_default();
        }
        text.push('\n');
    }
    text
}

fn cell(text: &mut String, value: f64) {
    if value.is_finite() {
        write!(text, ",{}", (value * 1e7).round() / 1e7).unwrap_or_default();
    } else {
        text.push(',');
    }
}

/// The truth of a case.
pub(super) fn truth(case: &Case) -> Simulated {
    let effects: Vec<Hidden> = case
        .physics
        .effects
        .iter()
        .zip(&case.accepted)
        .map(|(effect, accepted)| hidden(case, effect, accepted))
        .collect();
    let undecidable = effects.iter().any(|e| e.one_of.len() > 1);
    let verdicts: &[&str] = match (&effects[..], case.level) {
        ([], Level::True) => &["consistent"],
        ([], _) => &["parameters"],
        (all, _) if all.iter().any(|e| e.effect == "unlisted") => &["unlisted"],
        _ if undecidable => &["ambiguous", "explained"],
        _ => &["explained"],
    };
    let bin = match case.visibility {
        v if v <= 0.0 => "null",
        v if v < 6e3 => "hard",
        v if v < 6e4 => "medium",
        _ => "easy",
    };
    Simulated {
        verdict: verdicts.iter().map(|v| (*v).to_owned()).collect(),
        level: case.level.name().to_owned(),
        bin: bin.to_owned(),
        note: note(case),
        effects,
        heldout: heldout(case),
    }
}

fn note(case: &Case) -> String {
    let hidden: Vec<&str> = case.physics.effects.iter().map(|e| e.id).collect();
    format!(
        "{:?}; hidden: {}; visible {:.0} squared noise deviations; {:?} noise; {} % outliers; {} % lost readings",
        case.published.kind,
        if hidden.is_empty() { "nothing".to_owned() } else { hidden.join(", ") },
        case.visibility,
        case.noise,
        100.0 * case.nuisance.outliers,
        100.0 * case.nuisance.dropouts
    )
}

fn heldout(case: &Case) -> Vec<Recoverable> {
    let Some(recording) = case.recordings.iter().find(|r| r.heldout) else { return Vec::new() };
    let each = case.heldout.iter().zip(&case.published.sensors);
    each.map(|([refitted, floor], sensor)| Recoverable {
        recording: file(recording.number),
        channel: sensor.column.to_owned(),
        nrmse_refitted: *refitted,
        nrmse_floor: *floor,
        recoverable: 1.0 - floor / refitted,
    })
    .collect()
}

fn hidden(case: &Case, effect: &Effect, accepted: &[(String, String)]) -> Hidden {
    let active = active(case, effect);
    let one_of =
        accepted.iter().map(|(effect, at)| Accepted { effect: effect.clone(), at: Some(at.clone()) }).collect();
    // The contract's scale is a factor, the generator's a deviation from one.
    let told = |own: &Effect, value: f64| if own.id == "sensor_scale" { 1.0 + value } else { value };
    // What only the generator needs to know is none of the contract's keys.
    let known = |own: &Effect| own.values.clone().into_iter().filter(|(key, _)| !matches!(*key, "whole" | "lever"));
    let values = |own: &Effect| known(own).map(|(key, value)| (key.to_owned(), told(own, value))).collect();
    if effect.is_outside() {
        let anywhere = vec![Accepted { effect: "unlisted".to_owned(), at: None }];
        return Hidden {
            effect: "unlisted".to_owned(),
            at: effect.at.clone(),
            one_of: anywhere,
            parameters: [].into(),
            localised: !active.is_empty(),
            active,
        };
    }
    Hidden {
        effect: effect.id.to_owned(),
        at: effect.at.clone(),
        one_of,
        parameters: values(effect),
        localised: !active.is_empty(),
        active,
    }
}

/// Where an effect acts, if not everywhere.
fn active(case: &Case, effect: &Effect) -> Vec<Interval> {
    let value = |key: &str| effect.values.get(key).copied().unwrap_or(0.0);
    let interval =
        |recording: &Recording, from_s: f64, to_s: f64| Interval { recording: file(recording.number), from_s, to_s };
    let end_s = |recording: &Recording| (recording.commands.len() - 1) as f64 * ROW_S;
    let first = &case.recordings[0];
    match effect.id {
        "external_push" => vec![interval(first, value("time") - 0.5 * PUSH_S, value("time") + 0.5 * PUSH_S)],
        "lost_counts" | "payload_step" => vec![interval(first, value("time"), end_s(first))],
        "torque_limit" => case
            .recordings
            .iter()
            .flat_map(|r| limited(r).map(|(a, b)| interval(r, a, b)).collect::<Vec<_>>())
            .collect(),
        _ => Vec::new(),
    }
}

/// Stretches of rows where the limit acted; gaps below 20 ms are bridged.
fn limited(recording: &Recording) -> impl Iterator<Item = (f64, f64)> {
    let mut stretches: Vec<(f64, f64)> = Vec::new();
    for (k, _) in recording.limited.iter().enumerate().filter(|(_, limited)| **limited) {
        let (from, to) = (k as f64 * ROW_S, (k + 1) as f64 * ROW_S);
        match stretches.last_mut() {
            Some(last) if from - last.1 < 0.02 => last.1 = to,
            _ => stretches.push((from, to)),
        }
    }
    stretches.into_iter()
}
