//! `compass run`: the main job. RT: no; it assembles and watches the threads that are.

mod mock;
mod sinks;
mod summary;
mod supervise;
mod wiring;

use super::config_args::ConfigArgs;
use super::{Outcome, Run, UsageError};
use crate::channel::port::{Endpoint, Subscriber};
use crate::channel::topic;
use crate::config::Resolved;
use crate::config::checked::{Config, Thread};
use crate::msg::{FaultCode, RecorderStatus, TickRecord};
use crate::rt::process::{self, Parts, Progress, Running};
use crate::rt::stop::Stop;
use crate::rt::thread::Missing;
use crate::rt::tick::Tick;
use crate::telemetry::{self, Side, ThreadLine};
use anyhow::Context;
use sinks::Archive;
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// Runs the robot: the real one or, as in the default configuration, a simulated one in this process.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass run                                          the simulated robot balances until Ctrl-C
  compass run --for 30s --record log                   and is recorded
  compass run --config /etc/compass                    a robot's own configuration
  compass run --config /etc/compass --record log       real buses, IMU and dead-man switch are named there

Real buses with the simulated hand or the simulated IMU are refused: motors would run with nobody there.

Exit codes: 0 fine, 1 a fault was latched, 2 configuration, 3 a device, 70 internal.")]
pub(crate) struct Args {
    #[command(flatten)]
    config: ConfigArgs,
    /// Ends by itself after this time, such as 30s, 10m, 1h; without it on Ctrl-C or SIGTERM
    #[arg(long = "for", value_name = "TIME", value_parser = duration)]
    run_for: Option<Duration>,
    /// Controller: idle, hold or balance
    #[arg(long, value_name = "NAME")]
    controller: Option<String>,
    /// Records everything into this folder; the ticks around a fault go to its folder `flight`
    #[arg(long, value_name = "DIR")]
    record: Option<PathBuf>,
    /// Name of the robot in its channels, by which other processes find it
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
}

/// A number with a unit: ms, s, m, h.
pub(super) fn duration(text: &str) -> Result<Duration, String> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let seconds_per_unit = match &text[digits.len()..] {
        "ms" => 1e-3,
        "s" => 1.0,
        "m" | "min" => 60.0,
        "h" => 3600.0,
        _ => return Err("must be a number with ms, s, m or h, such as 30s".into()),
    };
    let number: f64 = digits.parse().map_err(|_| "must begin with a number, such as 30s".to_owned())?;
    Duration::try_from_secs_f64(number * seconds_per_unit).map_err(|_| "must be 0 or more and below an age".into())
}

impl Run for Args {
    fn run(mut self) -> anyhow::Result<Outcome> {
        self.config.overrides.extend(self.controller.iter().map(|name| format!("control.controller={name}")));
        let resolved = self.config.load()?;
        let stop = Stop::on_signals().context("signal handlers")?;
        let archive = Archive::open(self.record.as_deref(), &resolved)?;
        let robot = self.name.clone().unwrap_or_else(|| default_name(&resolved.config));
        let (running, mock) = assemble(&resolved, &robot, &archive, &stop)?;
        let watcher = supervise::spawn(running.progress(), stop.clone(), self.run_for)?;
        let shown = show(&resolved.config, &robot, &running, &archive, &stop);
        stop.request();
        let summary = running.wait();
        drop(mock);
        if watcher.join().is_err() {
            anyhow::bail!("the supervising thread failed");
        }
        let closed = archive.finish();
        summary::write(&mut io::stdout().lock(), &summary, &closed)?;
        shown?;
        if summary.panicked {
            // The hook has told where; this only brings the exit code 70.
            std::panic::resume_unwind(Box::new("the control thread panicked"));
        }
        let faulted = summary.observed.faults.iter().any(|fault| fault.code != FaultCode::Stopping);
        Ok(if faulted { Outcome::Finding } else { Outcome::Fine })
    }
}

/// A real robot is called `robot`; simulated ones must not hear each other.
fn default_name(config: &Config) -> String {
    if wiring::is_simulated(config) { format!("simulated-{}", std::process::id()) } else { "robot".into() }
}

fn assemble(
    resolved: &Resolved,
    robot: &str,
    archive: &Archive,
    stop: &Stop,
) -> anyhow::Result<(Running, Option<mock::MockRobot>)> {
    let config = &resolved.config;
    let tick = Tick::new(config).map_err(|error| UsageError(error.to_string()))?;
    let wiring = wiring::open(config)?;
    let stop_frames = tick.stop_frames();
    let parts = Parts {
        config: config.clone(),
        robot: robot.to_owned(),
        buses: wiring.buses,
        imu: wiring.imu,
        hand: wiring.hand,
        stop_frames,
        missing: wiring.missing,
        simulated: wiring::is_simulated(config),
        sinks: archive.sinks(),
        stop: stop.clone(),
    };
    let mock = wiring.mock.map(mock::MockRobot::start).transpose()?;
    Ok((process::start(tick, parts)?, mock))
}

/// Shows the run until it ends.
fn show(config: &Config, robot: &str, running: &Running, archive: &Archive, stop: &Stop) -> anyhow::Result<()> {
    let channels = Endpoint::join(robot)?;
    let mut feed = Watched {
        ticks: channels.subscriber(&topic::TICK)?,
        progress: running.progress(),
        archive,
        threads: thread_lines(config, running.missing()),
        notices: notices(config, robot, running.missing()),
    };
    Ok(telemetry::run(config, &mut feed, stop.flag())?)
}

/// What a person should know at the start.
fn notices(config: &Config, robot: &str, missing: Missing) -> Vec<String> {
    let mut notices: Vec<String> = missing.in_words().map(|text| format!("not granted: {text}")).collect();
    if missing.needed() != Missing::default() {
        notices.push(if wiring::is_simulated(config) {
            "no real time: fine for a simulated robot, a real one would not be armed".into()
        } else {
            "NO REAL TIME: the robot will NOT be armed; `compass doctor` says what to do".into()
        });
    }
    notices.push(format!("channels of robot `{robot}`; recordings and views of other processes attach there"));
    notices
}

fn thread_lines(config: &Config, missing: Missing) -> Vec<ThreadLine> {
    let timing = &config.real_time;
    let [bus0, bus1] = &timing.bus;
    let all = [("control", &timing.control), ("bus0", bus0), ("bus1", bus1), ("imu", &timing.imu)];
    all.into_iter().map(|(name, thread)| thread_line(name, thread, missing)).collect()
}

fn thread_line(name: &str, thread: &Thread, missing: Missing) -> ThreadLine {
    let refused = |bit: Missing| missing.0 & bit.0 != 0;
    let policy = match thread.priority {
        0 => "ordinary".to_owned(),
        _ if refused(Missing::FIFO) => "FIFO refused".to_owned(),
        priority => format!("FIFO {priority}"),
    };
    let core = thread.core.map_or_else(|| "any core".to_owned(), |core| format!("core {core}"));
    let good = !refused(Missing::FIFO) && !refused(Missing::CORE);
    ThreadLine { name: name.to_owned(), detail: format!("{policy}, {core}"), good }
}

/// The running loop as the terminal sees it: through the same channel as any other process.
struct Watched<'a> {
    ticks: Subscriber<TickRecord>,
    progress: Arc<Progress>,
    archive: &'a Archive,
    threads: Vec<ThreadLine>,
    notices: Vec<String>,
}

impl telemetry::Feed for Watched<'_> {
    fn poll(&mut self, each: &mut dyn FnMut(&TickRecord)) -> bool {
        let more = !self.progress.has_ended();
        while let Some(record) = self.ticks.receive() {
            each(&record);
        }
        more
    }

    fn side(&mut self) -> Side {
        let mut notices = std::mem::take(&mut self.notices);
        notices.extend(self.archive.take_notices());
        let recorder: RecorderStatus = self.archive.status().unwrap_or_default();
        Side { recorder, threads: self.threads.clone(), notices }
    }
}

#[cfg(test)]
mod tests;
