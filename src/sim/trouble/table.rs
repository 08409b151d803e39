//! The table of `docs/faults.md`: each fault with what the robot did about it. RT: no.

use super::reaction::{self, Meanwhile, Reaction};
use crate::base::time::Span;
use crate::config::fault::{CATALOGUE, Device, Entry, FaultName, Injection, Place};
use crate::config::{self, Errors};
use crate::msg::FaultCode;
use crate::sim::lockstep::LockstepError;
use std::fmt::Write;

/// The robot balances since more than a second.
const WHILE_ARMED: Span = Span::from_ms(3000);
/// Between homing and arming.
const BEFORE_ARMING: Span = Span::from_ms(300);
/// Between two injections of one fault: no multiple of any period of the robot.
const PHASE: Span = Span(1_300_000);
/// So often each fault is injected; the longest times are told.
const TIMES: i64 = 3;

/// Why there is no table.
#[derive(Debug, thiserror::Error)]
pub enum TableError {
    /// A robot's configuration is wrong.
    #[error(transparent)]
    Config(#[from] Errors),
    /// A robot cannot be built.
    #[error(transparent)]
    Lockstep(#[from] LockstepError),
}

/// A fault and what came of it.
#[derive(Clone, Debug)]
pub struct Row {
    /// With its arguments.
    pub injection: Injection,
    /// Of each injection; empty if it cannot be injected here.
    pub reactions: Vec<Reaction>,
}

/// The robot that has what can break, by its example.
#[must_use]
pub const fn robot_for(device: Device) -> (&'static str, &'static str) {
    match device {
        Device::Mit => ("mit.toml", include_str!("../../../config/examples/mit.toml")),
        Device::Odrive => ("odrive.toml", include_str!("../../../config/examples/odrive.toml")),
        Device::Moteus => ("moteus.toml", include_str!("../../../config/examples/moteus.toml")),
        Device::Lidar => ("lidar.toml", include_str!("../../../config/examples/lidar.toml")),
        Device::Mocap => ("mocap.toml", include_str!("../../../config/examples/mocap.toml")),
        _ => ("default", ""),
    }
}

/// Faults that are about what was before arming.
const fn moment(fault: FaultName) -> Span {
    match fault {
        FaultName::JoystickHeldAtStart => Span::ZERO,
        FaultName::MitEnterKick => BEFORE_ARMING,
        _ => WHILE_ARMED,
    }
}

/// Every kind of a fault with its default arguments, at its moment.
#[must_use]
pub fn kinds(entry: &'static Entry) -> Vec<Injection> {
    let at = moment(entry.fault).as_s();
    let texts: Vec<String> = if entry.kinds.is_empty() {
        vec![format!("{}@{at}", entry.name)]
    } else {
        entry.kinds.iter().map(|kind| format!("{}@{at}:kind={kind}", entry.name)).collect()
    };
    texts.iter().filter_map(|text| Injection::parse(text).ok()).collect()
}

/// Injects a fault so often, each time in another phase.
///
/// # Errors
/// [`TableError`] when its robot cannot be built.
pub fn row(injection: &Injection, times: i64) -> Result<Row, TableError> {
    let (name, text) = robot_for(injection.entry.device);
    let config = config::load_text(name, text, &[])?.config;
    let mut row = Row { injection: *injection, reactions: Vec::new() };
    if !injection.entry.is_for(Place::Sim) || injection.check(&config.robot).is_err() {
        return Ok(row);
    }
    for k in 0..times {
        let at = Span(injection.at.0 + k * PHASE.0);
        row.reactions.push(reaction::measure(&config, &Injection { at, ..*injection })?);
    }
    Ok(row)
}

/// The whole table as Markdown. Takes a quarter of a minute.
///
/// # Errors
/// [`TableError`] when a robot cannot be built.
pub fn markdown() -> Result<String, TableError> {
    let head = String::from(
        "| fault | where | noticed as | after, ms | no torque after, ms | while it lasts | armed again after, ms | what happens |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    Ok(head + &rows()?)
}

/// Its rows.
fn rows() -> Result<String, TableError> {
    let mut out = String::new();
    for entry in CATALOGUE {
        for injection in kinds(entry) {
            line(&mut out, &row(&injection, TIMES)?);
        }
    }
    Ok(out)
}

fn line(out: &mut String, row: &Row) {
    let entry = row.injection.entry;
    let places: Vec<&str> = entry.places.iter().map(|place| place.name()).collect();
    let kind = if row.injection.kind.is_empty() { String::new() } else { format!(" {}", row.injection.kind) };
    let noticed_ones =
        || row.reactions.iter().filter(|reaction| reaction.detected.is_some() || reaction.told.is_some());
    let longest = |of: fn(&Reaction) -> Option<Span>| {
        let span = noticed_ones().filter_map(of).max();
        span.map_or_else(|| "-".to_owned(), |span| format!("{:.0}", span.as_s() * 1e3))
    };
    let _infallible = writeln!(
        out,
        "| `{}`{kind} | {} | {} | {} | {} | {} | {} | {} |",
        entry.name,
        places.join(", "),
        noticed(row),
        longest(|r| r.detected.map(|(_, after)| after).or(r.told.map(|(_, after)| after))),
        longest(|r| r.safe_after.filter(|_| r.detected.is_some())),
        meanwhile(row),
        longest(|r| r.recovered_after.or(r.sound_after)),
        entry.what,
    );
}

/// How a robot is that is held, while the fault goes on.
fn meanwhile(row: &Row) -> String {
    let mut words: Vec<String> = Vec::new();
    for Meanwhile { armed_ticks, ticks, drive_error, blockers } in row.reactions.iter().filter_map(|r| r.meanwhile) {
        let word = match (armed_ticks, drive_error) {
            (0, 0) => format!("not armed: {}", first_name(blockers)),
            (0, code) => format!("not armed: {}, error {code:#06x}", first_name(blockers)),
            _ if armed_ticks < ticks => "armed at times".to_owned(),
            _ => "armed".to_owned(),
        };
        if !words.contains(&word) {
            words.push(word);
        }
    }
    if words.is_empty() { "-".to_owned() } else { words.join(" or ") }
}

/// The first of what stands in the way.
fn first_name(blockers: u64) -> &'static str {
    let first = u8::try_from(blockers.trailing_zeros()).ok().and_then(FaultCode::from_u8);
    first.map_or("by the latched fault", FaultCode::name)
}

/// The fault codes that it was latched as, or what else became of it.
fn noticed(row: &Row) -> String {
    let mut names: Vec<String> = Vec::new();
    for reaction in &row.reactions {
        let name = match reaction.detected {
            Some((fault, _)) if reaction.drive_error != 0 => {
                format!("{} {}, error {:#06x}", fault.code.name(), fault.index, reaction.drive_error)
            }
            Some((fault, _)) => format!("{} {}", fault.code.name(), fault.index),
            None if reaction.ends_armed => {
                reaction.told.map_or_else(|| "tolerated".to_owned(), |(what, _)| format!("told: {what}, balances on"))
            }
            None => "not armed".to_owned(),
        };
        if !names.contains(&name) {
            names.push(name);
        }
    }
    match (names.is_empty(), row.injection.entry.is_for(Place::Sim)) {
        (false, _) => names.join(" or "),
        (true, true) => "-".to_owned(),
        // Kernel, disk and threads are measured there; the page has them in a table of their own.
        (true, false) => "see \"In the guest\"".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a fault shall lead to.
    enum Expected {
        /// One of these is latched within so many ms, and the motor is without torque within so many.
        Stops(&'static [FaultCode], i64, i64),
        /// It balances on.
        Tolerated,
        /// It balances on, and this is told within so many ms; sound words come again so many ms after the fault's end.
        Told(&'static str, i64, i64),
        /// As `Stops`, or it balances on: which, hangs on the moment.
        MayStop(&'static [FaultCode], i64, i64),
        /// It is not armed.
        NotArmed,
        /// Only in the guest; the page has it in a table of its own.
        InGuest,
    }
    use Expected::{InGuest, MayStop, NotArmed, Stops, Told, Tolerated};
    use FaultCode::{
        BusUnhealthy, DeadManReleased, DriveFault, DriveStale, ImuStale, OperatorStale, OutOfRange, Overrun,
    };

    /// The drive's own watchdog, for what no command can reach any more.
    const WATCHDOG_MS: i64 = 52;

    /// Every fault, with each of its kinds.
    const EXPECTED: &[(&str, Expected)] = &[
        ("bus_off", Stops(&[BusUnhealthy], 1, WATCHDOG_MS)),
        ("no_acknowledge", Stops(&[DriveStale], 8, WATCHDOG_MS)),
        ("queue_full", Stops(&[DriveStale], 8, WATCHDOG_MS)),
        ("link_down", Stops(&[BusUnhealthy], 1, WATCHDOG_MS)),
        ("frame_errors lost", Tolerated),
        ("frame_errors doubled", Tolerated),
        ("frame_errors late", MayStop(&[DriveStale], 1000, 1050)),
        ("frame_errors reordered", Tolerated),
        ("frame_errors flipped", Stops(&[OutOfRange, DriveFault, DriveStale, BusUnhealthy], 1000, 1050)),
        ("foreign_traffic unknown", Tolerated),
        ("foreign_traffic master", Stops(&[BusUnhealthy], 3, 5)),
        ("bus_load low", Tolerated),
        ("bus_load high", Stops(&[DriveStale], 8, WATCHDOG_MS)),
        ("wrong_length", Stops(&[DriveStale], 8, 10)),
        ("stale_queue", Stops(&[DriveStale], 8, 8)),
        ("boot_up", Stops(&[DriveStale], 8, 8)),
        ("emergency", Stops(&[DriveFault], 2, 3)),
        ("heartbeat_stops", Stops(&[DriveFault], 160, 165)),
        ("object_server silent", Stops(&[DriveStale], 8, 8)),
        ("object_server abort", Stops(&[DriveStale], 8, 8)),
        ("object_server wrong_index", Stops(&[DriveStale], 8, 8)),
        ("refuses_torque_mode", Stops(&[DriveStale], 8, 8)),
        ("statusword_stuck no_power", Stops(&[DriveFault], 1000, 3)),
        ("statusword_stuck stuck", Tolerated),
        ("mapping_lost command", Stops(&[DriveFault], 2000, 2050)),
        ("mapping_lost answer", Stops(&[DriveStale], 8, 10)),
        ("two_nodes", Stops(&[DriveFault], 25, 30)),
        ("mit_wrong_id", Stops(&[DriveStale], 8, 10)),
        ("mit_reply_length", Tolerated),
        ("mit_position_wrap", Stops(&[DriveFault], 3, 5)),
        ("mit_wrong_ranges torque", Stops(&[DriveStale], 8, 8)),
        ("mit_wrong_ranges motor", Stops(&[DriveStale], 8, 8)),
        ("mit_enter_kick", Tolerated),
        ("mit_no_zero", Stops(&[DriveStale], 8, 8)),
        ("odrive_error", Stops(&[DriveFault], 12, 12)),
        ("odrive_watchdog", Stops(&[DriveFault], 12, 12)),
        ("odrive_dialect", Stops(&[DriveStale], 9, 9)),
        ("odrive_no_encoder", Stops(&[DriveStale], 9, 11)),
        ("moteus_timed_out", Stops(&[DriveFault], 3, 3)),
        ("moteus_fault", Stops(&[DriveFault], 3, 3)),
        ("moteus_not_set", Stops(&[DriveStale], 8, 10)),
        ("moteus_no_reply", Stops(&[DriveStale], 8, 10)),
        ("moteus_read_error", Stops(&[DriveStale], 8, 10)),
        ("imu_bytes lost", Tolerated),
        ("imu_bytes inserted", Tolerated),
        ("imu_bytes flipped", Tolerated),
        ("imu_bursts", Tolerated),
        ("imu_stall", Stops(&[ImuStale], 33, 35)),
        ("imu_timer_wrap", Tolerated),
        ("imu_wrong_baud", Stops(&[ImuStale], 33, 35)),
        ("imu_nan", Stops(&[ImuStale], 33, 35)),
        ("imu_replug", Stops(&[ImuStale], 33, 35)),
        ("lidar_check", Told("damaged scans", 1000, 100)),
        ("lidar_split", Tolerated),
        ("lidar_not_ready", Told("NotReady", 60, 800)),
        ("lidar_laser_off", Told("LaserOff", 60, 800)),
        ("lidar_hardware", Told("Hardware", 60, 800)),
        ("lidar_half_open", Told("Silent", 170, 1000)),
        ("lidar_time_wrap", Tolerated),
        ("mocap_untracked", Told("Untracked", 20, 250)),
        ("mocap_frozen", Told("Frozen", 120, 250)),
        ("mocap_gaps", Told("FramesMissing", 500, 250)),
        ("mocap_reordered", Told("FramesMissing", 500, 300)),
        ("mocap_version", Told("Unreadable", 30, 500)),
        ("mocap_clock_jump", Told("ClockJumped", 30, 250)),
        ("mocap_section", Tolerated),
        ("joystick_unplugged", Stops(&[DeadManReleased, OperatorStale], 12, 15)),
        ("joystick_dropped", Stops(&[DeadManReleased], 12, 15)),
        ("joystick_axis_stuck", Stops(&[DeadManReleased], 72, 75)),
        ("joystick_wireless_hold", Stops(&[DeadManReleased], 72, 75)),
        ("joystick_held_at_start", NotArmed),
        ("step_overrun many", Stops(&[Overrun], 1000, 1005)),
        ("step_overrun once", Tolerated),
        ("disk_full", InGuest),
        ("log_stalled", InGuest),
        ("clock_step", InGuest),
        ("memory_pressure", InGuest),
        ("thread_killed", InGuest),
    ];

    /// Faults that show as a restart first: how a robot that is held stays while they last.
    const LASTING: &[(&str, &str)] = &[
        ("object_server silent", "not armed"),
        ("object_server abort", "not armed"),
        ("object_server wrong_index", "not armed"),
        ("refuses_torque_mode", "not armed"),
        // The ranges of a CubeMars motor are nowhere on the wire, and one that is held does not move enough to tell them.
        ("mit_wrong_ranges torque", "armed"),
        ("mit_wrong_ranges motor", "armed"),
        ("odrive_dialect", "not armed"),
    ];

    fn check(name: &str, expected: &Expected, reaction: &Reaction) {
        let ms = |span: Span| span.0 / 1_000_000;
        assert!(!reaction.torque_unarmed, "{name}: torque without being armed");
        match expected {
            MayStop(..) if reaction.detected.is_none() => assert!(reaction.ends_armed, "{name}: {reaction:?}"),
            Stops(codes, within_ms, safe_ms) | MayStop(codes, within_ms, safe_ms) => {
                assert!(reaction.was_armed, "{name}");
                let (fault, after) = reaction.detected.unwrap_or_else(|| panic!("{name} was not noticed"));
                assert!(codes.contains(&fault.code), "{name}: {fault:?}");
                assert!(ms(after) <= *within_ms, "{name}: noticed after {} ms", ms(after));
                let safe = reaction.safe_after.unwrap_or_else(|| panic!("{name}: there is torque at the end"));
                assert!(ms(safe) <= *safe_ms, "{name}: torque for {} ms", ms(safe));
                assert!(!reaction.ends_armed, "{name}: armed again by nobody");
                assert!(reaction.recovered_after.is_some(), "{name}: {:#x} in the way for ever", reaction.blockers);
            }
            Tolerated => assert!(reaction.ends_armed && reaction.detected.is_none(), "{name}: {reaction:?}"),
            Told(what, within_ms, again_ms) => {
                assert!(
                    reaction.was_armed && reaction.ends_armed && reaction.detected.is_none(),
                    "{name}: {reaction:?}"
                );
                let (told, after) = reaction.told.unwrap_or_else(|| panic!("{name} was not told"));
                assert_eq!(told, *what, "{name}");
                assert!(ms(after) <= *within_ms, "{name}: told after {} ms", ms(after));
                let sound = reaction.sound_after.unwrap_or_else(|| panic!("{name}: never sound again"));
                assert!(ms(sound) <= *again_ms, "{name}: sound again after {} ms", ms(sound));
            }
            InGuest => unreachable!("{name} is not injected here"),
            NotArmed => assert!(!reaction.ends_armed && reaction.safe_after.is_some(), "{name}: {reaction:?}"),
        }
    }

    #[test]
    fn the_page_has_a_row_for_every_kind_of_every_fault() {
        let page = include_str!("../../../docs/faults.md");
        for entry in CATALOGUE {
            for injection in kinds(entry) {
                let kind = if injection.kind.is_empty() { String::new() } else { format!(" {}", injection.kind) };
                let row = format!("\n| `{}`{kind} | ", entry.name);
                assert!(page.contains(&row), "no row for {}{kind}: run `compass sim --fault table`", entry.name);
            }
        }
    }

    /// With its kind, as `--fault list` and the page name it.
    fn full_name(injection: &Injection) -> String {
        let space = if injection.kind.is_empty() { "" } else { " " };
        format!("{}{space}{}", injection.entry.name, injection.kind)
    }

    #[test]
    fn every_kind_of_every_fault_has_an_expected_reaction() {
        let listed: Vec<String> = CATALOGUE.iter().flat_map(kinds).map(|injection| full_name(&injection)).collect();
        for name in &listed {
            assert_eq!(EXPECTED.iter().filter(|(known, _)| known == name).count(), 1, "{name}");
        }
        for (name, expected) in EXPECTED {
            assert!(listed.iter().any(|known| known == name), "no fault is called {name}");
            let fault = name.split(' ').next().unwrap();
            let entry = CATALOGUE.iter().find(|entry| entry.name == fault).unwrap();
            assert_eq!(matches!(expected, InGuest), !entry.is_for(Place::Sim), "{name}");
            let page = include_str!("../../../docs/faults.md");
            let (_, guest) = page.split_once("## In the guest").unwrap();
            assert!(!matches!(expected, InGuest) || guest.contains(&format!("\n| `{fault}`")), "no row for {name}");
        }
    }

    /// In lockstep, so the times are the same everywhere. Some hang on how the robot balances: they change with its controller.
    #[test]
    fn the_page_is_as_measured() {
        let page = include_str!("../../../docs/faults.md");
        let measured = rows().unwrap();
        let stale: Vec<&str> = measured.lines().filter(|row| !page.contains(row)).collect();
        assert!(
            stale.is_empty(),
            "put what `compass sim --fault table` prints onto the page; other rows than there:\n{stale:#?}"
        );
    }

    #[test]
    fn every_fault_leads_to_a_robot_without_torque_or_is_tolerated() {
        for (name, expected) in EXPECTED {
            let (fault, kind) = name.split_once(' ').unwrap_or((name, ""));
            let entry = CATALOGUE.iter().find(|entry| entry.name == fault).unwrap();
            let injection = kinds(entry).into_iter().find(|injection| injection.kind == kind).unwrap();
            let row = row(&injection, 1).unwrap();
            for reaction in &row.reactions {
                check(name, expected, reaction);
            }
            if let Some((_, lasting)) = LASTING.iter().find(|(known, _)| known == name) {
                assert!(meanwhile(&row).starts_with(lasting), "{name}: {}", meanwhile(&row));
            }
        }
    }
}
