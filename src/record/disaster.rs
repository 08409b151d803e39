//! Recordings under kill -9 and on a full file system, tried with a real process on a real disk; and read by the
//! packages that other people read MCAP with.
//!
//! The writing process is this test binary itself, started with [`CHILD`] set.

use super::reader::Reader;
use super::recorder::Recorder;
use super::scan::Ending;
use super::stream::tests::random_record;
use crate::base::time::Stamp;
use crate::config;
use crate::msg::RecorderState;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// Folder that the child records into; without it the child's test does nothing.
const CHILD: &str = "COMPASS_TEST_RECORD_INTO";
const CHILD_TEST: &str = "record::disaster::writing_child";

/// Records 1000 ticks a second and says how many are safe, until somebody kills it or the disk is full.
#[test]
fn writing_child() {
    let Some(folder) = std::env::var_os(CHILD) else { return };
    let recorder = Recorder::start(Path::new(&folder), &config::load(None, &[]).unwrap()).unwrap();
    let start = Instant::now();
    for index in 0..20_000 {
        let mut record = random_record(index);
        record.input.index = index;
        record.input.now = Stamp(1_000_000 * (index as i64 + 1));
        recorder.push(&record);
        let status = recorder.status();
        println!("safe {}", status.written);
        if status.state == RecorderState::DiskFull {
            println!("full, slowest so far ok");
            return;
        }
        thread::sleep(Duration::from_millis(index + 1).saturating_sub(start.elapsed()));
    }
}

fn child(folder: &Path) -> Command {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args([CHILD_TEST, "--exact", "--nocapture"]).env(CHILD, folder).stdout(Stdio::piped());
    command
}

/// Numbers of the lines `safe N`.
fn safe_ticks(line: &str) -> Option<u64> {
    line.rsplit("safe ").next()?.trim().parse().ok()
}

fn recordings(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

fn count_ticks(path: &Path) -> (u64, Option<Ending>) {
    let mut reader = Reader::open(path).unwrap();
    let mut next = 0;
    while let Some(tick) = reader.next_tick().unwrap() {
        assert_eq!(tick.input.index, next, "no tick is missing before the end");
        next += 1;
    }
    (next, reader.ending())
}

#[test]
fn killed_recording_reads_up_to_the_last_flush() {
    let folder = tempfile::tempdir().unwrap();
    let mut writer = child(folder.path()).spawn().unwrap();
    let mut told = 0;
    // Three flushes in: kill -9 between two of them.
    for line in BufReader::new(writer.stdout.take().unwrap()).lines() {
        told = safe_ticks(&line.unwrap()).unwrap_or(told);
        if told > 1200 {
            break;
        }
    }
    writer.kill().unwrap();
    writer.wait().unwrap();
    let (ticks, ending) = count_ticks(&recordings(folder.path())[0]);
    assert!(ticks >= told, "{ticks} ticks are there, {told} were told to be safe");
    assert!(matches!(ending, Some(Ending::Torn { .. })), "{ending:?}");
}

#[test]
fn full_file_system_keeps_what_was_told_to_be_safe() {
    let folder = tempfile::tempdir().unwrap();
    // A file system of 3 MB in a namespace of its own; its files are copied out at the end.
    let script = "mount -t tmpfs -o size=3m none \"$0\" && \"$@\"; cp \"$0\"/* \"$OUT\"";
    let disk = folder.path().join("disk");
    let out = folder.path().join("out");
    fs::create_dir(&disk).unwrap();
    fs::create_dir(&out).unwrap();
    let writer = child(&disk);
    let output = Command::new("unshare")
        .args(["-rm", "sh", "-c", script])
        .arg(&disk)
        .arg(writer.get_program())
        .args(writer.get_args())
        .env(CHILD, &disk)
        .env("OUT", &out)
        .output();
    let Some(text) =
        output.ok().map(|o| String::from_utf8_lossy(&o.stdout).into_owned()).filter(|t| t.contains("safe"))
    else {
        println!("SKIPPED: no user namespaces or no `unshare` here, so no small file system to fill");
        return;
    };
    assert!(text.contains("full"), "the file system of 3 MB was not filled");
    let told = text.lines().filter_map(safe_ticks).max().unwrap();
    let (ticks, _) = count_ticks(&recordings(&out)[0]);
    assert!(told > 200, "{told}");
    assert_eq!(ticks, told, "what was told to be safe, and nothing torn");
}

/// Reads with the Python packages `mcap` and `mcap-ros2-support`; prints topic counts and one decoded value.
const PYTHON: &str = r"
import sys
from mcap_ros2.decoder import DecoderFactory
from mcap.reader import make_reader
counts = {}
torque = None
with open(sys.argv[1], 'rb') as f:
    for schema, channel, message, ros in make_reader(f, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
        counts[channel.topic] = counts.get(channel.topic, 0) + 1
        if channel.topic == 'wanted' and torque is None:
            torque = ros.hip_torque_nm
print(sorted(counts.items()), repr(torque))
";

/// Another Python can be named by this variable.
const PYTHON_VARIABLE: &str = "COMPASS_PYTHON";

#[test]
fn packages_of_other_people_read_the_recording() {
    let python = std::env::var(PYTHON_VARIABLE).unwrap_or_else(|_| "python3".into());
    let check = Command::new(&python).args(["-c", "import mcap.reader, mcap_ros2.decoder"]).output();
    if !check.is_ok_and(|output| output.status.success()) {
        println!("SKIPPED: {python} has no packages mcap and mcap-ros2-support (set {PYTHON_VARIABLE})");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let recorder = Recorder::start(folder.path(), &config::load(None, &[]).unwrap()).unwrap();
    for index in 0..50 {
        let mut record = random_record(index);
        record.wanted.hip_torque_nm = -12.5;
        recorder.push(&record);
    }
    let path = recorder.path();
    assert_eq!(recorder.finish().written, 50);
    let script = folder.path().join("read.py");
    fs::File::create(&script).unwrap().write_all(PYTHON.as_bytes()).unwrap();
    let output = Command::new(&python).arg(&script).arg(&path).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(text.contains("('wanted', 50)") && text.contains("('status', 50)") && text.contains("-12.5"), "{text}");
}
