use super::case::Recipe;
use super::dice::Dice;
use super::experiment::{Physics, Recording, record};
use super::rig::{self, Kind};
use super::{draw, program, write_cases};

const SHORT: Recipe = Recipe { rows: 400, healthy: None };

#[test]
fn same_seed_writes_the_same_bytes() {
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let healthy = Recipe { healthy: Some(true), ..SHORT };
    for folder in &folders {
        let truths = write_cases(folder.path(), 2, 5, healthy).unwrap();
        assert!(truths.values().all(|truth| truth.effects.is_empty()));
    }
    for file in ["trial-001/rig.toml", "trial-002/run_a.csv"] {
        let [a, b] = [&folders[0], &folders[1]].map(|folder| std::fs::read(folder.path().join(file)).unwrap());
        assert!(a == b && a.len() > 100);
    }
}

#[test]
fn every_hidden_effect_is_accepted_as_its_own_answer() {
    let folder = tempfile::tempdir().unwrap();
    let truths = write_cases(folder.path(), 1, 11, Recipe { healthy: Some(false), ..SHORT }).unwrap();
    for (name, truth) in truths {
        assert!(!truth.effects.is_empty() && truth.bin != "null", "{name}");
        for hidden in &truth.effects {
            assert!(hidden.one_of.iter().any(|a| a.effect == hidden.effect), "{name} {hidden:?}");
        }
    }
}

fn walk(number: u64, effect: Option<(&'static str, f64)>) -> Recording {
    let mut dice = Dice::new(77, number);
    let rig = rig::draw(&mut dice, Kind::Walker);
    let programs = program::draw(&mut dice, &rig, false);
    let hidden = |(id, value): (&'static str, f64)| {
        let mut drawn = draw::draw(&mut Dice::new(0, 0), &rig, id, 3.0);
        drawn.values.insert(drawn.leading, value);
        drawn
    };
    let effects = effect.into_iter().map(hidden).collect();
    record(&Physics { rig, effects, coarse: 1.0 }, &programs, 0, false, 1200)
}

fn steps(recording: &Recording) -> usize {
    (1..recording.stance.len()).filter(|k| recording.stance[*k] != recording.stance[k - 1]).count()
}

#[test]
fn robot_walks_on_level_ground_and_with_every_effect_of_the_ground() {
    let effects = [
        ("foot_slip", 0.2),
        ("elastic_impact", 0.2),
        ("toe_compliance", 4e4),
        ("ground_slope", 0.005),
        ("counterweight", 5.0),
        ("round_foot", 0.05),
    ];
    let level = walk(1, None);
    for (id, value) in effects {
        let other = walk(1, Some((id, value)));
        assert!(steps(&other) >= 4 && other.clean[0].iter().all(|x| x.abs() < 0.4), "{id}");
        let moved = other.clean[0].iter().zip(&level.clean[0]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(moved > 1e-3, "{id} shows nothing: {moved}");
    }
}

#[test]
fn effects_of_the_ground_vanish_with_their_strength() {
    let level = walk(2, None);
    for (id, value) in [("elastic_impact", 1e-9), ("round_foot", 1e-9), ("foot_slip", 1e3), ("counterweight", 1e-9)] {
        let other = walk(2, Some((id, value)));
        let moved = other.clean[0].iter().zip(&level.clean[0]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(moved < 1e-6, "{id} {moved}");
    }
}
