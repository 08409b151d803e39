//! The binary as a person meets it: exit codes, errors, and a recording from its making to its replay.
#![expect(clippy::unwrap_used, reason = "a test")]

use assert_cmd::Command;
use std::fs;
use std::process::{Command as Plain, Stdio};

fn compass(arguments: &[&str]) -> (i32, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_compass")).args(arguments).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

#[test]
fn exit_codes_are_those_of_the_help() {
    assert_eq!(compass(&["check-config"]).0, 0);
    let (code, _, stderr) = compass(&["check-config", "--set", "robot.hip.gear_ratio=-3", "--set", "rt.nonsense=1"]);
    assert_eq!(code, 2);
    assert!(stderr.contains("2 errors") && stderr.contains("must be 1 to 500"), "{stderr}");
    assert_eq!(compass(&["no-such-command"]).0, 2);
    assert_eq!(compass(&["inspect", "/nowhere/x.mcap"]).0, 3);
}

#[test]
fn simulated_run_is_recorded_and_replays_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let into = folder.path().to_str().unwrap();
    let (code, stdout, stderr) = compass(&["sim", "--for", "3", "--record", into]);
    assert_eq!(code, 0, "{stdout}{stderr}");
    let file = fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
    let file = file.to_str().unwrap();
    let (code, stdout, _) = compass(&["inspect", file]);
    assert_eq!(code, 0, "{stdout}");
    assert!(stdout.contains("file      whole") && stdout.contains("mode Armed"), "{stdout}");
    let (code, stdout, _) = compass(&["replay", file, "--check"]);
    assert_eq!((code, stdout.as_str()), (0, "3000 ticks alike to the bit\n"));
    let (code, stdout, _) = compass(&["replay", file, "--check", "--set", "control.lqr_r=0.5"]);
    assert_eq!(code, 1);
    assert!(stdout.contains("first difference: tick") && stdout.contains("wanted.hip_torque_nm"), "{stdout}");
}

#[test]
fn reader_that_goes_away_is_no_failure() {
    let mut child = Plain::new(env!("CARGO_BIN_EXE_compass"))
        .args(["check-config", "--print"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!((output.status.code(), String::from_utf8(output.stderr).unwrap()), (Some(0), String::new()));
}
