//! Reads one of `robot.drives`: what every drive has, then what its protocol has. RT: before arming only.

use super::checked::{Cia402, DriveConfig, DriveMode, DriveProtocol, Mit, MitDialect, Moteus, Odrive, OdriveFirmware};
use super::reader::{Reader, range};
use crate::base::time::Span;

/// How `protocol` is written.
#[derive(Clone, Copy)]
enum Word {
    Cia402,
    Mit,
    Odrive,
    Moteus,
}

const PROTOCOLS: &[(&str, Word)] =
    &[("cia402", Word::Cia402), ("mit", Word::Mit), ("odrive", Word::Odrive), ("moteus", Word::Moteus)];

pub(super) fn drive(r: &Reader<'_>) -> DriveConfig {
    let word = r.choice("protocol", PROTOCOLS, Word::Cia402);
    let (mode, profile_torque) = mode(r, word);
    let (first, last) = match word {
        Word::Cia402 | Word::Moteus => (1, 126),
        Word::Mit => (1, 127),
        Word::Odrive => (0, 62),
    };
    DriveConfig {
        protocol: match word {
            Word::Cia402 => DriveProtocol::Cia402(Cia402 { profile_torque }),
            Word::Mit => DriveProtocol::Mit(mit(r, mode)),
            Word::Odrive => DriveProtocol::Odrive(odrive(r)),
            Word::Moteus => DriveProtocol::Moteus(Moteus { counts_per_turn: counts_per_turn(r) }),
        },
        bus: r.integer("bus", 0, 1, "1"),
        node: r.integer("node", first, last, "1"),
        mode,
        rated_torque_nm: r.number("rated_torque_nm", range(0.001, 1000.0, "Nm")),
        max_torque_permille: r.integer("max_torque_permille", 1, 10_000, "1/1000 of rated"),
        sync_divisor: r.integer("sync_divisor", 1, 240, "SYNCs"),
        heartbeat: r.span("heartbeat_ms", 1.0, 65_535.0),
        watchdog: r.span("watchdog_ms", 5.0, 1000.0),
    }
}

/// The mode, and whether torque is by the profile.
fn mode(r: &Reader<'_>, word: Word) -> (DriveMode, bool) {
    const PLAIN: (&str, (DriveMode, bool)) = ("torque", (DriveMode::CyclicTorque, false));
    const POSITION: (&str, (DriveMode, bool)) = ("position", (DriveMode::CyclicPosition, false));
    const PROFILE: (&str, (DriveMode, bool)) = ("profile_torque", (DriveMode::CyclicTorque, true));
    match word {
        Word::Cia402 => r.choice("mode", &[PLAIN, POSITION, PROFILE], PLAIN.1),
        // Its torque could not be limited while a toe looks for its stop.
        Word::Odrive => r.choice("mode", &[PLAIN], PLAIN.1),
        Word::Mit | Word::Moteus => r.choice("mode", &[PLAIN, POSITION], PLAIN.1),
    }
}

fn counts_per_turn(r: &Reader<'_>) -> f64 {
    r.number("counts_per_turn", range(100.0, 1e9, "counts"))
}

fn mit(r: &Reader<'_>, mode: DriveMode) -> Mit {
    const DIALECTS: &[(&str, MitDialect)] = &[
        ("mini_cheetah", MitDialect::MiniCheetah),
        ("cubemars", MitDialect::CubeMars),
        ("damiao", MitDialect::Damiao),
        ("myactuator", MitDialect::MyActuator),
    ];
    let dialect = r.choice("dialect", DIALECTS, MitDialect::MiniCheetah);
    let stiffness_range_nm_rad = r.number("stiffness_range_nm_rad", range(1.0, 10_000.0, "Nm/rad"));
    let damping_range_nm_s_rad = r.number("damping_range_nm_s_rad", range(0.1, 1000.0, "Nm s/rad"));
    let node: i64 = r.integer("node", 1, 127, "1");
    if dialect == MitDialect::MyActuator && node > 32 {
        r.refuse("node", "must be 1 to 32 with dialect \"myactuator\"");
    }
    if dialect == MitDialect::Damiao && node > 15 {
        r.refuse("node", "must be 1 to 15 with dialect \"damiao\": its answers carry four bits of it");
    }
    Mit {
        dialect,
        reply_id: match dialect {
            MitDialect::MyActuator => 0,
            _ => r.integer("reply_id", 0, 0x7FE, "1"),
        },
        position_range_rad: r.number("position_range_rad", range(1.0, 1000.0, "rad")),
        velocity_range_rad_s: r.number("velocity_range_rad_s", range(1.0, 1000.0, "rad/s")),
        torque_range_nm: r.number("torque_range_nm", range(0.1, 1000.0, "Nm")),
        stiffness_range_nm_rad,
        damping_range_nm_s_rad,
        counts_per_turn: counts_per_turn(r),
        gains: match mode {
            DriveMode::CyclicTorque => [0.0; 2],
            DriveMode::CyclicPosition => [
                r.number("stiffness_nm_rad", range(0.0, stiffness_range_nm_rad, "Nm/rad")),
                r.number("damping_nm_s_rad", range(0.0, damping_range_nm_s_rad, "Nm s/rad")),
            ],
        },
    }
}

fn odrive(r: &Reader<'_>) -> Odrive {
    const FIRMWARES: &[(&str, OdriveFirmware)] = &[("0.5", OdriveFirmware::V5), ("0.6", OdriveFirmware::V6)];
    let firmware = r.choice("firmware", FIRMWARES, OdriveFirmware::V6);
    Odrive {
        firmware,
        torque_constant_nm_a: match firmware {
            OdriveFirmware::V5 => r.number("torque_constant_nm_a", range(1e-4, 100.0, "Nm/A")),
            OdriveFirmware::V6 => 0.0,
        },
        velocity_limit_turns_s: r.number("velocity_limit_turns_s", range(0.01, 10_000.0, "turns/s")),
        current_limit_a: r.number("current_limit_a", range(0.1, 1000.0, "A")),
        feedback: Span::from_ms(r.integer("feedback_ms", 1, 100, "ms")),
        counts_per_turn: counts_per_turn(r),
    }
}
