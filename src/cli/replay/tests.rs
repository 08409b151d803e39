use super::*;
use crate::base::time::Span;
use crate::cli::laws;
use crate::msg::LidarSample;
use crate::record::Recorder;
use crate::record::stream::tests::random_record;
use crate::sim::lockstep::Lockstep;
use std::path::Path;

/// Runs the tick on inputs that shake every room (frames and samples of random bits now and then) and records it.
fn record_run(folder: &Path, ticks: std::ops::Range<u64>, mut spoil: impl FnMut(&mut TickRecord)) -> PathBuf {
    let resolved = config::load(None, &[]).unwrap();
    let mut tick = Tick::new(&resolved.config).unwrap();
    let mut record = TickRecord::default();
    let recorder = Recorder::start(folder, &resolved).unwrap();
    for index in 0..ticks.end {
        let mut input = random_record(index).input;
        input.index = index;
        input.now = Stamp(1_000_000 * (index as i64 + 1));
        input.wake_latency = Span::from_us(20);
        input.stop_requested = false;
        input.operator.stamp = input.now;
        // The default robot has none.
        input.lidar = LidarSample::default();
        tick.step(&input, &mut record);
        let mut written = record;
        spoil(&mut written);
        if ticks.contains(&index) {
            recorder.push(&written);
        }
    }
    let path = recorder.path();
    assert_eq!(recorder.finish().dropped, 0);
    path
}

fn replay(path: &Path) -> Args {
    Args { recording: path.to_owned(), check: true, speed: 1.0, from_estimates: false, overrides: Vec::new() }
}

fn compare(args: &Args) -> Comparison {
    let config = args.configuration().unwrap().config;
    Replay::new(Reader::open(&args.recording).unwrap(), args.step(&config).unwrap()).compare().unwrap()
}

#[test]
fn replay_of_a_run_is_alike_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = record_run(folder.path(), 0..500, |_| {});
    let found = compare(&replay(&path));
    assert_eq!((found.alike, found.not_compared), (500, 0), "{found:?}");
    assert_eq!(replay(&path).run().unwrap(), Outcome::Fine);
    let from_estimates = Args { from_estimates: true, ..replay(&path) };
    assert_eq!(compare(&from_estimates).alike, 500);
}

/// Runs robot and controller in lockstep and records every tick.
fn record_lockstep(folder: &Path, keys: &[String], ticks: usize) -> PathBuf {
    let resolved = config::load(None, keys).unwrap();
    let mut run = Lockstep::new(&resolved.config).unwrap();
    let recorder = Recorder::start(folder, &resolved).unwrap();
    for _ in 0..ticks {
        // The simulated clock is faster than the disk.
        while !recorder.has_room() {
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        recorder.push(run.step());
    }
    let path = recorder.path();
    assert_eq!(recorder.finish().dropped, 0);
    path
}

#[test]
fn replay_of_every_law_on_the_ground_is_alike_to_the_bit() {
    let (again, again_ms, _) = laws::AGAIN;
    let each = laws::ALL.map(|(keys, _)| (keys, laws::EACH_MS));
    for (keys, ms) in each.into_iter().chain([(again, again_ms)]) {
        let folder = tempfile::tempdir().unwrap();
        let path = record_lockstep(folder.path(), &laws::on_the_ground(keys), ms);
        let found = compare(&replay(&path));
        assert_eq!((found.alike, found.not_compared), (ms as u64, 0), "{keys:?}: {found:?}");
    }
}

#[test]
fn one_bit_in_one_tick_is_found_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = record_run(folder.path(), 0..100, |record| {
        if record.input.index == 42 {
            record.snapshot.hip_angle_rad = f64::from_bits(record.snapshot.hip_angle_rad.to_bits() ^ 1);
        }
    });
    let found = compare(&replay(&path));
    let difference = found.difference.unwrap();
    assert_eq!((difference.tick, difference.field.as_str()), (42, "hip_angle_rad"));
    assert_eq!((found.alike, found.not_compared), (42, 57));
    assert_eq!(replay(&path).run().unwrap(), Outcome::Finding);
}

#[test]
fn another_configuration_gives_another_run() {
    let folder = tempfile::tempdir().unwrap();
    let path = record_run(folder.path(), 0..50, |_| {});
    let args = Args { overrides: vec!["control.stance=outer".into()], ..replay(&path) };
    assert!(compare(&args).difference.is_some());
}

#[test]
fn recording_that_begins_in_the_middle_is_not_called_alike() {
    let folder = tempfile::tempdir().unwrap();
    let path = record_run(folder.path(), 50..100, |_| {});
    let found = compare(&replay(&path));
    assert_eq!((found.alike, found.not_compared, found.gap), (0, 50, Some((0, 50))));
    assert_eq!(replay(&path).run().unwrap(), Outcome::Finding);
}

#[test]
fn a_file_that_is_cut_or_has_a_flipped_bit_is_never_called_alike() {
    let folder = tempfile::tempdir().unwrap();
    let path = record_run(folder.path(), 0..300, |_| {});
    let whole = std::fs::read(&path).unwrap();
    for cut in [whole.len() - 1, whole.len() - 5_000, whole.len() / 2] {
        std::fs::write(&path, &whole[..cut]).unwrap();
        let outcome = replay(&path).run();
        assert!(!matches!(outcome, Ok(Outcome::Fine)), "cut at {cut}");
    }
    for at in (0..whole.len()).step_by(whole.len() / 37).skip(1) {
        let mut bytes = whole.clone();
        bytes[at] ^= 1;
        std::fs::write(&path, &bytes).unwrap();
        let outcome = replay(&path).run();
        assert!(!matches!(outcome, Ok(Outcome::Fine)), "one bit flipped at {at} of {}", whole.len());
    }
}

#[test]
fn another_build_of_the_same_version_is_told() {
    let version = Some(env!("CARGO_PKG_VERSION"));
    assert_eq!(other_build(version, Some("aa"), "aa"), None);
    let line = other_build(version, Some("bb"), "aa").unwrap();
    assert!(line.contains("sha256 bb") && line.contains("sha256 aa"), "{line}");
}
