use super::case::Recipe;
use super::write_cases;
use crate::identify::experiment::Experiment;

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

#[test]
fn written_cases_are_what_the_reader_expects() {
    let folder = tempfile::tempdir().unwrap();
    write_cases(folder.path(), 6, 2, Recipe { healthy: Some(true), ..SHORT }).unwrap();
    for number in 1..=6 {
        let case = folder.path().join(format!("trial-{number:03}"));
        let experiment = Experiment::load(&case).unwrap();
        assert_eq!(experiment.recordings.len(), 3, "{}", case.display());
    }
}
