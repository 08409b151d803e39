//! The table of `docs/faults.md`: each fault with what the robot did about it. RT: no.

use super::reaction::{self, Reaction};
use crate::base::time::Span;
use crate::config::fault::{CATALOGUE, Device, Entry, FaultName, Injection, Place};
use crate::config::{self, Errors};
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

/// The whole table as Markdown. Takes a minute.
///
/// # Errors
/// [`TableError`] when a robot cannot be built.
pub fn markdown() -> Result<String, TableError> {
    let mut out = String::from(
        "| fault | where | noticed as | after, ms | no torque after, ms | armed again after, ms | what happens |\n\
         |---|---|---|---|---|---|---|\n",
    );
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
    let longest = |of: fn(&Reaction) -> Option<Span>| {
        let all: Option<Vec<Span>> = row.reactions.iter().map(of).collect();
        all.and_then(|all| all.into_iter().max())
            .map_or_else(|| "-".to_owned(), |span| format!("{:.0}", span.as_s() * 1e3))
    };
    let _infallible = writeln!(
        out,
        "| `{}`{kind} | {} | {} | {} | {} | {} | {} |",
        entry.name,
        places.join(", "),
        noticed(row),
        longest(|r| r.detected.map(|(_, after)| after)),
        longest(|r| r.safe_after),
        longest(|r| r.recovered_after),
        entry.what,
    );
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
            None if reaction.ends_armed => "tolerated".to_owned(),
            None => "not armed".to_owned(),
        };
        if !names.contains(&name) {
            names.push(name);
        }
    }
    if names.is_empty() { "-".to_owned() } else { names.join(" or ") }
}
