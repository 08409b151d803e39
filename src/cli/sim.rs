//! `compass sim`: the real tick and the simulated robot in lockstep, as fast as the machine goes. RT: no.

use super::config_args::ConfigArgs;
use super::faults;
use super::output::must_be_folder;
use super::run::duration;
use super::{Outcome, Run, from_one, progress, refused, seed};
use crate::base::time::Span;
use crate::config::Resolved;
use crate::config::checked::Limits;
use crate::config::fault::Place;
use crate::msg::TickRecord;
use crate::record::Recorder;
use crate::sim::lockstep::Lockstep;
use crate::sim::scenario::{self, Summary};
use anyhow::Context;
use std::io::{self, Write};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// The figures at the end look at so much of the run.
const TAIL: Span = Span::from_ms(10_000);
/// Runs of a soak.
const MOST_RUNS: u32 = 1_000_000_000;
/// Ticks between two looks at the progress bar.
const BAR_TICKS: u64 = 1000;
/// So long we wait for a recorder that is behind before we look again.
const RECORDER_PAUSE: Duration = Duration::from_millis(2);

/// Simulates robot and controller in lockstep: the same tick as on the robot, a simulated clock, the same bits each time.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass sim                        10 s of balance from 2 degrees of tilt
  compass sim --for 10m              ten minutes, in a few seconds
  compass sim --controller walk --set sim.on_blocks=false --for 60      it walks
  compass sim --for 30 --record recordings/
  compass sim --set control.observer_epsilon_s=0.02 --set control.lqr_r=0.01    thesis 4.4: it rings at 10 Hz
  compass sim --fault bus_off@3s:bus=1,for=200ms --fault imu_stall@6s
  compass sim --fault list           every fault, one a line; `table`: what the robot does about each (15 s)
  compass sim --soak 1000 --for 4    random faults, many times
  compass sim --set control.stance=outer --set sim.stance=outer --seed 7

Exit codes: 0 stands at the end, 1 fell or faulted, 2 usage or configuration.")]
pub(crate) struct Args {
    #[command(flatten)]
    config: ConfigArgs,
    /// Simulated time, such as 10 (seconds), 500ms or 10m
    #[arg(long = "for", value_name = "TIME", default_value = "10s", value_parser = seconds)]
    length_s: f64,
    /// Controller: idle, hold, balance, lqr_tree; walking: walk, virtual_constraint, transverse; one planned step: tvlqr
    #[arg(long, value_name = "NAME")]
    controller: Option<String>,
    /// Seed of all noise, instead of the configured one
    #[arg(long, value_parser = seed)]
    seed: Option<u64>,
    /// Injects a fault: `NAME@TIME[:ARGS]`, such as bus_off@3s:bus=1,for=200ms. May be given often. `list` prints them all
    #[arg(long = "fault", value_name = "FAULT")]
    faults: Vec<String>,
    /// Runs so often with random faults instead, and says whether torque, limits and latch held in every tick
    #[arg(long, value_name = "RUNS", value_parser = from_one::<u64>(MOST_RUNS), conflicts_with_all = ["faults", "record", "seed"])]
    soak: Option<u64>,
    /// Records every tick into this folder
    #[arg(long, value_name = "DIR")]
    record: Option<PathBuf>,
}

impl Run for Args {
    fn run(mut self) -> anyhow::Result<Outcome> {
        if faults::is_listed(&self.faults)? {
            return Ok(Outcome::Fine);
        }
        self.config.set_by("--controller", "control.controller", self.controller.as_ref());
        self.config.set_by("--seed", "sim.seed", self.seed);
        let resolved = self.config.load_with_faults(&self.faults, Place::Sim)?;
        if let Some(runs) = self.soak {
            return faults::soak(&resolved.config, runs, Span::from_s(self.length_s));
        }
        let mut lockstep = Lockstep::new(&resolved.config).map_err(|error| refused::all(&resolved, &error))?;
        let recorder = self.start_recorder(&resolved)?;
        let length = Span::from_s(self.length_s);
        let bar =
            progress::bar(u64::try_from(length.0 / resolved.config.real_time.period.0).unwrap_or(0), "simulating");
        let start = Instant::now();
        let summary = scenario::run_with_poses(&mut lockstep, length, TAIL, |record, _, poses| {
            if let Some(recorder) = &recorder {
                push(recorder, record);
                poses.iter().for_each(|pose| recorder.push_pose(pose));
            }
            if record.input.index % BAR_TICKS == 0 {
                bar.set_position(record.input.index);
            }
        });
        let took = start.elapsed();
        bar.finish_and_clear();
        let limits = &resolved.config.robot.limits;
        print(&mut io::stdout().lock(), &summary, limits, (self.length_s, took), lockstep.digest())?;
        if let Some(recorder) = recorder {
            let path = recorder.path();
            let status = recorder.finish();
            writeln!(io::stdout(), "recorded   {} ({} ticks lost)", path.display(), status.dropped)?;
        }
        Ok(if summary.stands() { Outcome::Fine } else { Outcome::Finding })
    }
}

impl Args {
    fn start_recorder(&self, resolved: &Resolved) -> anyhow::Result<Option<Recorder>> {
        if let Some(folder) = &self.record {
            must_be_folder("--record", folder)?;
        }
        let start = |folder: &PathBuf| Recorder::start(folder, resolved).context("recording");
        self.record.as_ref().map(start).transpose()
    }
}

/// The simulation is faster than a disk; here, unlike on the robot, the loop may wait for it.
fn push(recorder: &Recorder, record: &TickRecord) {
    while !recorder.has_room() {
        std::thread::sleep(RECORDER_PAUSE);
    }
    recorder.push(record);
}

fn print(
    out: &mut impl Write,
    s: &Summary,
    limits: &Limits,
    (length_s, took): (f64, Duration),
    digest: u64,
) -> io::Result<()> {
    let took_s = took.as_secs_f64();
    let verdict = if s.stands() { "stands" } else { "does not stand" };
    writeln!(out, "result     {verdict}, mode {}, first fault {}", s.mode.name(), s.first_fault)?;
    writeln!(out, "simulated  {length_s} s in {took_s:.2} s: {:.0} times real time", length_s / took_s)?;
    writeln!(out, "ticks      {}, armed {}", s.ticks, s.armed_ticks)?;
    if let Some(blocker) = &s.held_back_by {
        writeln!(out, "not armed  {}", limits.told_at_arming(blocker))?;
    }
    if s.steps > 0 {
        let speed = s.mean_speed_m_s.map(|v| format!(" at {v:.2} m/s")).unwrap_or_default();
        let cost = s.cost_of_transport.map(|c| format!(", cost of transport {c:.3}")).unwrap_or_default();
        writeln!(out, "walked     {} steps, {:.2} m{speed}{cost}", s.steps, s.distance_m)?;
    }
    if let Some(cause) = s.fall {
        writeln!(out, "fell       {}", cause.name().replace('_', " "))?;
    }
    let [stance, swing] = s.angle_rad.map(|a| a.size().to_degrees());
    writeln!(out, "largest    stance {stance:.2} deg, swing {swing:.2} deg")?;
    let [stance, swing] = s.tail_angle_rad.map(|a| a.width().to_degrees());
    let torque = s.tail_torque_nm.width();
    let tail = format!("last {} s", length_s.min(TAIL.as_s()));
    writeln!(out, "{tail:<10} peak to peak: stance {stance:.3} deg, swing {swing:.2} deg, torque {torque:.1} Nm")?;
    let (bias, error) = (s.attitude_bias_rad.to_degrees(), s.tail_error_rad.size().to_degrees());
    writeln!(out, "attitude   bias learnt {bias:.3} deg, stance angle wrong by {error:.3} deg at most")?;
    writeln!(out, "digest     {digest:016x}")
}

/// A time above 0.
fn seconds(text: &str) -> Result<f64, String> {
    let seconds = duration(text)?.as_secs_f64();
    if seconds > 0.0 { Ok(seconds) } else { Err("must be above 0".to_owned()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::FaultCode;

    #[test]
    fn times_are_understood_with_and_without_unit() {
        for (text, wanted_s) in [("10", 10.0), ("30s", 30.0), ("1.5 s", 1.5), ("10min", 600.0)] {
            assert!((seconds(text).unwrap() - wanted_s).abs() < 1e-12);
        }
        for text in ["", "0", "-3", "soon", "inf"] {
            assert!(seconds(text).is_err(), "{text}");
        }
    }

    #[test]
    fn figures_of_the_end_say_how_much_of_the_run_they_are() {
        for (length_s, told) in [(5.0, "last 5 s   peak to peak"), (60.0, "last 10 s  peak to peak")] {
            let mut out = Vec::new();
            let limits = crate::config::load(None, &[]).unwrap().config.robot.limits;
            print(&mut out, &Summary::default(), &limits, (length_s, Duration::from_secs(1)), 0).unwrap();
            let text = String::from_utf8(out).unwrap();
            assert!(text.contains(told), "{text}");
        }
    }

    #[test]
    fn a_robot_that_leans_too_far_is_told_why_it_was_not_armed() {
        let told = |lean: &str| {
            let config = crate::config::load(None, &[format!("sim.initial_angle_rad=[{lean}, 0.0]")]).unwrap().config;
            let mut lockstep = Lockstep::new(&config).unwrap();
            let summary = scenario::run(&mut lockstep, Span::from_ms(1500), TAIL, |_, _| ());
            let mut out = Vec::new();
            print(&mut out, &summary, &config.robot.limits, (1.5, Duration::from_secs(1)), 0).unwrap();
            (summary, String::from_utf8(out).unwrap())
        };
        let (summary, text) = told("0.1");
        let blocker = summary.held_back_by.unwrap();
        // The attitude errs by some mrad.
        assert!(blocker.code == FaultCode::TiltLimit && (blocker.value - 0.1).abs() < 0.02, "{blocker:?}");
        let (deg, limit) = (blocker.value.to_degrees(), "limit robot.limits.arm_tilt_rad = 0.07 (4.0 deg)");
        assert!(text.contains(&format!("not armed  TiltLimit: {deg:.1} deg, {limit}\n")), "{text}");
        assert!(!told("0.03").1.contains("not armed"));
    }
}
