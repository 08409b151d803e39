//! `compass run`: the main job. RT: no; it assembles and watches the threads that are.

mod lidar;
mod mocap;
mod mock;
mod sinks;
mod summary;
mod supervise;
mod view;
mod wiring;

use super::config_args::ConfigArgs;
use super::output::must_be_folder;
use super::{Outcome, Run, refused};
use crate::bus::socketcan::master::MasterLock;
use crate::config::checked::Config;
use crate::config::fault::Place;
use crate::record::live::Window;
use crate::rt::process::{self, Parts, Running, Summary};
use crate::rt::relay::Sinks;
use crate::rt::stop::{self, Stop};
use crate::rt::tick::Tick;
use crate::sensor::operator::Refused;
use anyhow::Context;
use lidar::Scanner;
use mocap::Capture;
use sinks::Archive;
use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use view::View;

/// Runs the robot: the real one or, as in the default configuration, a simulated one in this process.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass run                                          the simulated robot balances until Ctrl-C
  compass run --for 30s --record log                   and is recorded
  compass run --controller walk --set sim.on_blocks=false         it walks, on the ground
  compass run --record /var/lib/compass --keep 100GB   the oldest recordings go when the folder is full
  compass run --config /etc/compass                    a robot's own configuration
  compass run --config /etc/compass --record log       real buses, IMU and dead-man switch are named there
  compass run --watch-socket /run/compass/watch        others of the group may read along (compass watch)

Real buses with the simulated operator or the simulated IMU are refused: motors would run with nobody there.

Exit codes: 0 fine (letting the switch go is), 1 a fall, a fault or lost recording, 2 configuration, 3 a device, 70 internal.")]
pub(crate) struct Args {
    #[command(flatten)]
    config: ConfigArgs,
    /// Ends by itself after this time, such as 30 (seconds), 10m, 1h; without it on Ctrl-C or SIGTERM
    #[arg(long = "for", value_name = "TIME", value_parser = duration)]
    run_for: Option<Duration>,
    /// Controller: idle, hold, balance, lqr_tree; walking: walk, virtual_constraint, transverse; one planned step: tvlqr
    #[arg(long, value_name = "NAME")]
    controller: Option<String>,
    /// Records everything into this folder; the ticks around a fault go to its folder `flight`
    #[arg(long, value_name = "DIR")]
    record: Option<PathBuf>,
    /// What the recordings in that folder may take, such as 100GB: a new file is begun in time and the oldest are removed
    #[arg(long, value_name = "SIZE", value_parser = size, requires = "record")]
    keep: Option<u64>,
    /// Makes a socket at which others of this process's group may read along: `compass watch --socket PATH`
    #[arg(long, value_name = "PATH")]
    watch_socket: Option<PathBuf>,
    /// Name of the robot in its channels, by which other processes find it
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
}

/// A number with a unit: ms, s, m, h; seconds without one.
pub(super) fn duration(text: &str) -> Result<Duration, String> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let seconds_per_unit = match &text[digits.len()..] {
        "ms" => 1e-3,
        "" | "s" => 1.0,
        "m" | "min" => 60.0,
        "h" => 3600.0,
        _ => return Err("must be a number of seconds, or one with ms, s, m or h, such as 10m".into()),
    };
    let number: f64 = digits.trim().parse().map_err(|_| "must begin with a number, such as 30s".to_owned())?;
    Duration::try_from_secs_f64(number * seconds_per_unit).map_err(|_| "must be 0 or more and below an age".into())
}

/// A number of bytes with a unit: MB, GB, TB.
fn size(text: &str) -> Result<u64, String> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let unit: u64 = match &text[digits.len()..] {
        "MB" => 1_000_000,
        "GB" => 1_000_000_000,
        "TB" => 1_000_000_000_000,
        _ => return Err("must be a whole number with MB, GB or TB, such as 100GB".into()),
    };
    let number: u64 = digits.parse().map_err(|_| "must begin with a whole number, such as 100GB".to_owned())?;
    let bytes = number.checked_mul(unit).ok_or("is more than there is")?;
    if bytes < LEAST_KEPT { Err("must be 100MB or more: a minute and a half".into()) } else { Ok(bytes) }
}

/// Less would remove what was recorded a minute ago.
const LEAST_KEPT: u64 = 100_000_000;

impl Run for Args {
    fn run(mut self) -> anyhow::Result<Outcome> {
        self.config.set_by("--controller", "control.controller", self.controller.as_ref());
        let resolved = self.config.load_with_faults(&[], Place::Run)?;
        if let Some(folder) = &self.record {
            must_be_folder("--record", folder)?;
        }
        let tick = Tick::new(&resolved.config).map_err(|error| refused::all(&resolved, &error.into()))?;
        let stop = Stop::on_signals().context("signal handlers")?;
        let archive = Arc::new(Archive::open(self.record.as_deref(), self.keep, &resolved)?);
        let open = |path: &PathBuf| Window::open(path, &resolved.text).with_context(|| path.display().to_string());
        let window = self.watch_socket.as_ref().map(open).transpose().context("--watch-socket")?;
        let robot = self.name.clone().unwrap_or_else(|| default_name(&resolved.config));
        let Assembled { running, mock, scanner, refused, locks } =
            assemble(&resolved.config, tick, &robot, archive.sinks(window), &stop)?;
        let capture = capture(&resolved.config, &archive)?;
        let watcher = supervise::spawn(running.progress(), stop.clone(), self.run_for)?;
        let view = View::start(&view::Parts {
            config: &resolved.config,
            robot: &robot,
            running: &running,
            archive: &archive,
            refused,
            stop: &stop,
        })?;
        // A signal, the time, a person at the view or a panic ends it; the view itself does not.
        let summary = running.wait();
        drop((mock, locks));
        let beside = [scanner.and_then(Scanner::finish), capture.and_then(Capture::finish)];
        if watcher.join().is_err() {
            anyhow::bail!("the supervising thread failed");
        }
        let closed = archive.finish();
        let mut words = Vec::new();
        summary::write(&mut words, &summary, &resolved.config.robot.limits, &closed)?;
        beside.iter().flatten().try_for_each(|line| writeln!(words, "{line}"))?;
        view.finish(String::from_utf8_lossy(&words).into_owned());
        let lost = closed.recorded.as_ref().map_or(0, |(_, status)| status.dropped);
        outcome(&summary, lost, stop::panics())
    }
}

/// Ground truth beside the run, if cameras are configured and there is a recording to put it into.
fn capture(config: &Config, archive: &Archive) -> anyhow::Result<Option<Capture>> {
    let parts = config.robot.mocap.as_ref().zip(archive.poses());
    parts.map(|(config, each)| Capture::start(config, each, archive.news())).transpose()
}

/// A real robot is called `robot`; simulated ones must not hear each other.
fn default_name(config: &Config) -> String {
    if wiring::is_simulated(config) { format!("simulated-{}", std::process::id()) } else { "robot".into() }
}

/// What runs.
struct Assembled {
    running: Running,
    mock: Option<mock::MockRobot>,
    scanner: Option<Scanner>,
    refused: Refused,
    locks: Vec<MasterLock>,
}

fn assemble(config: &Config, tick: Tick, robot: &str, sinks: Sinks, stop: &Stop) -> anyhow::Result<Assembled> {
    let wiring = wiring::open(config, robot)?;
    let (stop_frames, refused) = (tick.stop_frames(), wiring.hand.refused());
    let start = |(lidar, line)| Scanner::start(lidar, line);
    let (scanner, words) = config.robot.lidar.as_ref().zip(wiring.lidar).map(start).transpose()?.unzip();
    let parts = Parts {
        config: config.clone(),
        robot: robot.to_owned(),
        buses: wiring.buses,
        imu: wiring.imu,
        lidar: words,
        hand: wiring.hand,
        stop_frames,
        missing: wiring.missing,
        simulated: wiring::is_simulated(config),
        sinks,
        stop: stop.clone(),
    };
    let mock = wiring.mock.map(mock::MockRobot::start).transpose()?;
    Ok(Assembled { running: process::start(tick, parts)?, mock, scanner, refused, locks: wiring.locks })
}

/// How the run ended. Letting the switch go is the ordinary end of it; anything else that was latched is a finding, and so are
/// ticks that were to be recorded and are lost.
fn outcome(summary: &Summary, lost: u64, panics: u32) -> anyhow::Result<Outcome> {
    if summary.panicked || panics > 0 {
        // The hook has told where; this only brings the exit code 70.
        std::panic::resume_unwind(Box::new("a thread panicked"));
    }
    Ok(if summary.observed.faulted || lost > 0 { Outcome::Finding } else { Outcome::Fine })
}

#[cfg(test)]
mod tests;
