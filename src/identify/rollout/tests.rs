//! Free runs against figures that others computed: published reference fits of hardware, truths of other simulators.
use super::*;
use crate::identify::experiment::Experiment;
use crate::model::effect::EffectKind;
use crate::model::rig::{Effect, Use, Value};
use rayon::prelude::*;
use std::fs;
use std::path::{Path, PathBuf};

fn shared() -> Option<PathBuf> {
    let path = std::env::var_os("COMPASS_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    if path.is_dir() {
        return Some(path);
    }
    println!("SKIPPED: no shared folder at {}; set COMPASS_SHARED", path.display());
    None
}

/// Sets one number; the effect is added if the rig does not have it.
fn set(rig: &mut Rig, kind: EffectKind, at: &str, key: &str, value: f64) {
    let Some(k) = kind.key_index(key) else { return };
    let position = rig.effects.iter().position(|e| e.kind == kind && e.at == at).unwrap_or_else(|| {
        rig.effects.push(Effect::new(kind, at, vec![Value::known(0.0); kind.keys().len()]));
        rig.effects.len() - 1
    });
    rig.effects[position].values[k].value = value;
}

/// `rig` with the parameters under which a case was made.
fn with_truth(rig: &Rig, truth: &serde_json::Value) -> Rig {
    let mut rig = rig.clone();
    for (name, value) in truth["base_truth"].as_object().unwrap() {
        let value = value.as_f64().unwrap();
        let (what, at) = name.split_once(':').unwrap_or((name, ""));
        let joint = rig.mechanism.coordinate_index(at);
        match what {
            "gain" => rig.actuators.iter_mut().filter(|a| Some(a.joint) == joint).for_each(|a| a.gain.value = value),
            "viscous" => set(&mut rig, EffectKind::ViscousFriction, at, "viscous", value),
            "coulomb" if value > 0.0 => set(&mut rig, EffectKind::CoulombFriction, at, "coulomb", value),
            "stiffness" if value > 0.0 => set(&mut rig, EffectKind::ParallelSpring, at, "stiffness", value),
            "rest" if value.abs() > 0.0 => set(&mut rig, EffectKind::ParallelSpring, at, "rest", value),
            _ => {
                if let Some(i) = rig.mechanism.parameter_index(what) {
                    rig.parameters[i].value = value;
                }
            }
        }
    }
    for effect in truth["effects"].as_array().unwrap() {
        let Some(kind) = EffectKind::from_id(effect["effect"].as_str().unwrap()) else { continue };
        let at = effect["at"].as_str().unwrap();
        let values = kind.keys().iter().map(|key| {
            let given = effect["parameters"].get(key.name).or(effect.get("further").and_then(|f| f.get(key.name)));
            Value::known(given.and_then(serde_json::Value::as_f64).unwrap_or(0.0))
        });
        let mut new = Effect::new(kind, at, values.collect());
        if matches!(kind, EffectKind::LostCounts | EffectKind::ExternalPush) {
            let active = effect["active"].as_array().unwrap().iter();
            new.recordings = active.map(|a| a["recording"].as_str().unwrap().to_owned()).collect();
        }
        rig.effects.push(new);
    }
    rig
}

/// id, channel, our error with the true parameters, the noise floor.
fn errors_of_truth(shared: &Path, id: &str) -> Vec<(String, f64, f64)> {
    let text = fs::read_to_string(shared.join(format!("cases/blind-dev-truth/{id}.json"))).unwrap();
    let truth: serde_json::Value = serde_json::from_str(&text).unwrap();
    let experiment = Experiment::load(&shared.join("cases/blind-dev").join(id)).unwrap();
    let rig = with_truth(&experiment.rig, &truth);
    let pooled = Pooled::of(&rig, experiment.of_use(Use::Heldout));
    let mut out = Vec::new();
    for recording in experiment.of_use(Use::Heldout) {
        let run = free_run(&rig, recording, &pooled);
        for (channel, sensor) in rig.sensors.iter().enumerate() {
            let of = |h: &&serde_json::Value| {
                h["channel"] == sensor.column.as_str() && h["recording"] == recording.name.as_str()
            };
            let Some(held) = truth["heldout"].as_array().unwrap().iter().find(of) else { continue };
            let error = run.as_ref().ok().and_then(|r| r.nrmse[channel]).unwrap_or(f64::NAN);
            out.push((
                format!("{id} {} {}", truth["family"], sensor.column),
                error,
                held["nrmse_floor"].as_f64().unwrap(),
            ));
        }
    }
    out
}

#[test]
fn true_parameters_reproduce_the_recordings_of_other_simulators() {
    let Some(shared) = shared() else { return };
    let mut ids: Vec<String> = fs::read_dir(shared.join("cases/blind-dev"))
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    ids.sort();
    let rows: Vec<_> = ids.par_iter().flat_map_iter(|id| errors_of_truth(&shared, id)).collect();
    for (name, error, floor) in &rows {
        println!("{name}: {error:.5} floor {floor:.5} ratio {:.3}", error / floor);
    }
    // Not all can be at the floor: outliers pull the least squares of the initial state (006, 031, 041), one effect is
    // outside the library (021), and the contract's weights are not those of the noise (004, 024). Measured: 57 of 68.
    let at_floor = rows.iter().filter(|(_, error, floor)| *error < 1.15 * floor).count();
    assert!(at_floor * 100 >= rows.len() * 78, "{at_floor} of {}", rows.len());
    for (name, error, floor) in rows.iter().filter(|(name, ..)| name.contains("null_")) {
        assert!(*error < 2.0 * floor, "{name}");
    }
}

#[test]
fn reference_fits_of_hardware_are_met() {
    let Some(shared) = shared() else { return };
    for (id, channel, low, high) in [
        ("sydney_pendulum_inner", 0, 0.5200, 0.5210),
        ("sydney_pendulum_outer", 0, 0.3930, 0.3940),
        ("emps", 0, 0.4230, 0.4240),
        ("bam_xl330", 0, 0.2280, 0.2300),
        ("two_mass_bench", 1, 0.4925, 0.4940),
    ] {
        let experiment = Experiment::load(&shared.join("cases/real").join(id)).unwrap();
        let pooled = Pooled::of(&experiment.rig, experiment.of_use(Use::Heldout));
        let (mut squares, mut count) = (0.0, 0.0);
        for recording in experiment.of_use(Use::Heldout) {
            let run = free_run(&experiment.rig, recording, &pooled).unwrap();
            let n = recording.measured[channel].iter().filter(|x| !x.is_nan()).count() as f64;
            squares += n * run.nrmse[channel].unwrap().powi(2);
            count += n;
        }
        let error = (squares / count).sqrt();
        println!("{id}: {error:.5}");
        // The reference of each case, as given, to the digits that other integrators share.
        assert!((low..high).contains(&error), "{id}: {error}");
    }
}

/// The rig under which a case was made, its hidden effects free.
fn truth_rig(shared: &Path, id: &str) -> (Rig, Experiment) {
    let text = fs::read_to_string(shared.join(format!("cases/blind-dev-truth/{id}.json"))).unwrap();
    let truth: serde_json::Value = serde_json::from_str(&text).unwrap();
    let experiment = Experiment::load(&shared.join("cases/blind-dev").join(id)).unwrap();
    let mut rig = with_truth(&experiment.rig, &truth);
    let known = experiment.rig.effects.len();
    for value in rig.effects.iter_mut().skip(known).flat_map(|e| &mut e.values) {
        *value = Value::free(value.value, -1e6, 1e6);
    }
    (rig, experiment)
}

/// Prediction of a window, channels one after the other.
fn predicted(rig: &Rig, recording: &Recording, window: usize, initial: &[f64]) -> Vec<f64> {
    let rollout = Rollout::new(rig, recording, Fidelity::default()).unwrap();
    let mut readings = Readings::default();
    rollout.simulate(window, initial, &mut readings).unwrap();
    readings.channels.concat()
}

/// Relative error of each column of the Jacobian of a window against central differences; none where the window has a
/// kink: an event appears or goes, or falls on the very row at which the command jumps (fits end there now and then).
fn slope_errors(rig: &Rig, recording: &Recording, window: usize, initial: &[f64]) -> Vec<(String, Option<f64>)> {
    let theta = Theta::of(rig);
    let rollout = Rollout::new(rig, recording, Fidelity::default()).unwrap();
    let mut lin = Linearised::default();
    rollout.linearise(&theta, window, initial, &mut lin).unwrap();
    let at = |column: usize, by: f64| {
        let (mut moved, mut x) = (theta.clone(), initial.to_vec());
        if column < theta.len() {
            moved.values[column] += by;
        } else {
            x[column - theta.len()] += by;
        }
        predicted(&moved.applied(rig), recording, window, &x)
    };
    let off = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
    let one = |column: usize| {
        let value = theta.values.get(column).copied().unwrap_or(1.0).abs();
        let scale = if value > 0.0 { value } else { 1.0 };
        let slope = |from: f64, to: f64| -> Vec<f64> {
            let pairs = at(column, from * scale).into_iter().zip(at(column, to * scale));
            pairs.map(|(a, b)| (b - a) / ((to - from) * scale)).collect()
        };
        let (central, left, right) = (slope(-1e-5, 1e-5), slope(-1e-5, 0.0), slope(0.0, 1e-5));
        let exact: Vec<f64> = (0..central.len()).map(|r| lin.jacobian[r * lin.columns + column]).collect();
        let size = off(&central, &vec![0.0; central.len()]).max(1e-9);
        let name = theta.entries.get(column).map_or_else(|| format!("state {column}"), |e| e.name.clone());
        (name, (off(&left, &right) < 1e-2 * size).then(|| off(&exact, &central) / size))
    };
    (0..lin.columns).map(one).collect()
}

#[test]
fn derivatives_are_exact_through_the_steps_of_a_walk() {
    let Some(shared) = shared() else { return };
    let (mut smooth, mut all) = (0, 0);
    for id in ["dev-005", "dev-012", "dev-028", "dev-035"] {
        let (rig, experiment) = truth_rig(&shared, id);
        let pooled = Pooled::of(&rig, experiment.of_use(Use::Fit));
        for recording in experiment.of_use(Use::Fit) {
            let rollout = Rollout::new(&rig, recording, Fidelity::default()).unwrap();
            let weights = pooled.weights(&rig, recording);
            for window in 0..rollout.windows().len() {
                let initial = rollout.fit_initial(window, &weights, &rollout.guess(window)).unwrap();
                for (name, error) in slope_errors(&rig, recording, window, &initial) {
                    all += 1;
                    let Some(error) = error else { continue };
                    smooth += 1;
                    // The truncation of the differences themselves is up to 3e-5.
                    assert!(error < 1e-4, "{id} {} window {window} {name}: {error:.1e}", recording.name);
                }
            }
        }
    }
    assert!(smooth * 10 > all * 9, "{smooth} of {all} columns are smooth");
}

#[test]
fn steps_four_times_shorter_change_nothing_that_the_noise_would_show() {
    let Some(shared) = shared() else { return };
    let floor_of = |id: &String| -> Vec<(String, f64)> {
        let (rig, experiment) = truth_rig(&shared, id);
        let pooled = Pooled::of(&rig, experiment.of_use(Use::Heldout));
        let truth = fs::read_to_string(shared.join(format!("cases/blind-dev-truth/{id}.json"))).unwrap();
        let truth: serde_json::Value = serde_json::from_str(&truth).unwrap();
        let mut out = Vec::new();
        for recording in experiment.of_use(Use::Heldout) {
            let rollout = Rollout::new(&rig, recording, Fidelity::default()).unwrap();
            let finer = Rollout::new(&rig, recording, Fidelity { refine: 4 }).unwrap();
            let weights = pooled.weights(&rig, recording);
            let mut sums = vec![(0.0, 0.0); rig.sensors.len()];
            for window in 0..rollout.windows().len() {
                let initial = rollout.fit_initial(window, &weights, &rollout.guess(window)).unwrap();
                let (mut a, mut b) = (Readings::default(), Readings::default());
                rollout.simulate(window, &initial, &mut a).unwrap();
                finer.simulate(window, &initial, &mut b).unwrap();
                for (sum, (a, b)) in sums.iter_mut().zip(a.channels.iter().zip(&b.channels)) {
                    sum.0 += a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
                    sum.1 += a.len() as f64;
                }
            }
            for (channel, sensor) in rig.sensors.iter().enumerate() {
                let of = |h: &&serde_json::Value| {
                    h["channel"] == sensor.column.as_str() && h["recording"] == recording.name.as_str()
                };
                let Some(held) = truth["heldout"].as_array().unwrap().iter().find(of) else { continue };
                let noise = held["nrmse_floor"].as_f64().unwrap() * pooled.std[channel];
                let floor = (sums[channel].0 / sums[channel].1).sqrt();
                out.push((format!("{id} {} {}", truth["family"], sensor.column), floor / noise));
            }
        }
        out
    };
    let ids: Vec<String> = (1..=42).map(|k| format!("dev-{k:03}")).collect();
    let rows: Vec<_> = ids.par_iter().flat_map_iter(floor_of).collect();
    for (name, ratio) in &rows {
        println!("{name}: {ratio:.1e} of the noise");
        // Measured: at most 5e-4.
        assert!(*ratio < 1e-2, "{name}: {ratio:.1e}");
    }
}
