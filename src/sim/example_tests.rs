//! The example robots of `config/examples`, whole: the real tick, every byte over the wires, each protocol at the hip.

use super::*;
use crate::bus::line::SetupFault;
use crate::config::{self, Resolved};
use crate::msg::{Drive, FaultCode, Mode};
use crate::sim::scenario;
use std::path::Path;

const EXAMPLES: [&str; 8] = [
    "mit.toml",
    "myactuator.toml",
    "odrive.toml",
    "moteus.toml",
    "profile_torque.toml",
    "mixed.toml",
    "lidar.toml",
    "mocap.toml",
];

/// Those whose devices are the usual ones: they are for walking.
const WALKS: [&str; 2] = ["heavier_leg.toml", "hill.toml"];

fn example(name: &str) -> Resolved {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/examples").join(name);
    config::load(Some(&path), &[]).unwrap()
}

#[test]
fn every_example_is_valid_without_a_warning() {
    for name in EXAMPLES.into_iter().chain(WALKS) {
        assert_eq!(example(name).warnings, [], "{name}");
    }
}

#[test]
fn the_folder_of_examples_holds_what_is_tested() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/examples");
    let mut found: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    found.sort_unstable();
    let mut known: Vec<String> = EXAMPLES.into_iter().chain(WALKS).map(str::to_owned).collect();
    known.sort_unstable();
    assert_eq!(found, known);
}

#[test]
fn every_example_balances() {
    for name in EXAMPLES {
        let mut lockstep = Lockstep::new(&example(name).config).unwrap();
        let summary = scenario::run(&mut lockstep, Span::from_ms(20_000), Span::from_ms(10_000), |_, _| {});
        let width = summary.tail_angle_rad[0].width().to_degrees();
        println!("{name}: stance leg swings over {width:.2} degrees, {} ticks armed", summary.armed_ticks);
        assert!(summary.stands(), "{name}: {summary:?}");
        assert!(width < 1.0, "{name}: {summary:?}");
    }
}

#[test]
fn every_walk_walks() {
    for name in WALKS {
        let mut lockstep = Lockstep::new(&example(name).config).unwrap();
        let summary = scenario::run(&mut lockstep, Span::from_ms(20_000), Span::from_ms(10_000), |_, _| {});
        assert!(summary.fall.is_none() && summary.steps >= 15, "{name}: {summary:?}");
    }
}

/// In every dialect: no robot that walks is taken for one with another kind of motor (that is found: `drive_laws`).
#[test]
fn what_an_mit_hip_tells_of_its_velocity_fits_its_way_while_it_walks() {
    for (name, more) in [
        ("mit.toml", None),
        ("mit.toml", Some("robot.drives.hip.dialect=mini_cheetah")),
        ("myactuator.toml", None),
        ("mixed.toml", None),
    ] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/examples").join(name);
        let keys = ["control.controller=walk", "sim.on_blocks=false"].into_iter().chain(more);
        let config = config::load(Some(&path), &keys.map(str::to_owned).collect::<Vec<_>>()).unwrap().config;
        let mut lockstep = Lockstep::new(&config).unwrap();
        let mut refused = false;
        let summary = scenario::run(&mut lockstep, Span::from_ms(20_000), Span::from_ms(1000), |record, _| {
            refused |= record.feedback.drives[Drive::Hip as usize].error_code == SetupFault::WrongRange as u16;
        });
        println!("{name} {more:?}: {} steps", summary.steps);
        assert!(summary.steps > 10 && !refused, "{name} {more:?}: {summary:?}");
    }
}

/// Runs until armed for a second, breaks something, and tells the first fault and after how many ms.
fn fault_after(name: &str, hurt: impl FnOnce(&mut Plant)) -> (FaultCode, u8, i64) {
    let mut lockstep = Lockstep::new(&example(name).config).unwrap();
    let mut armed = 0;
    while armed < 1000 {
        assert!(lockstep.now() < Stamp(20_000_000_000), "{name} does not arm");
        armed += i32::from(lockstep.step().status.mode == Mode::Armed);
    }
    hurt(&mut lockstep.plant);
    for ms in 1..=500 {
        let status = lockstep.step().status;
        if status.mode == Mode::Faulted {
            // A drive that hears nothing any more ends it by its own watchdog of 50 ms.
            for _ in 0..60 {
                lockstep.step();
            }
            assert!(lockstep.plant().hip_torque_nm().abs() < 0.2, "{name}: torque is gone");
            return (status.first_fault.code, status.first_fault.index, ms);
        }
    }
    panic!("{name}: no fault within 500 ms");
}

#[test]
fn a_hip_that_falls_silent_is_stale() {
    for name in EXAMPLES {
        let (code, index, ms) = fault_after(name, |p| p.drive_mut(Drive::Hip).defects_mut().unplugged = true);
        println!("{name}: silent hip, {code:?} after {ms} ms");
        assert_eq!((code, index), (FaultCode::DriveStale, 0), "{name}");
        assert!(ms <= 12, "{name}: {ms} ms");
    }
}

#[test]
fn a_fault_of_the_hip_is_told() {
    for name in EXAMPLES {
        let (code, index, ms) = fault_after(name, |p| p.fail_drive(Drive::Hip, 0x2324));
        println!("{name}: fault of the hip, {code:?} after {ms} ms");
        assert_eq!((code, index), (FaultCode::DriveFault, 0), "{name}");
        assert!(ms <= 15, "{name}: {ms} ms");
    }
}

#[test]
fn a_hip_that_restarts_is_never_driven_on() {
    for name in EXAMPLES {
        let (code, index, ms) = fault_after(name, |p| p.reboot_drive(Drive::Hip));
        println!("{name}: restart of the hip, {code:?} after {ms} ms");
        let known = [FaultCode::DriveStale, FaultCode::DriveNotEnabled, FaultCode::DriveFault];
        assert!(known.contains(&code) && index == 0, "{name}: {code:?}");
        assert!(ms <= 12, "{name}: {ms} ms");
    }
}

#[test]
fn a_hip_that_makes_no_torque_is_found() {
    for name in EXAMPLES {
        let (code, _, ms) = fault_after(name, |p| p.drive_mut(Drive::Hip).defects_mut().no_torque = true);
        println!("{name}: hip without torque, {code:?} after {ms} ms");
    }
}
