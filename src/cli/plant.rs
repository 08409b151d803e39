//! `compass plant`: the simulated robot as a process of its own, on SocketCAN and a pseudo-terminal. RT: no.

use super::config_args::ConfigArgs;
use super::faults;
use super::{Outcome, Run, UsageError};
use crate::base::time::{Span, Stamp};
use crate::config::checked::Config;
use crate::config::fault::Place;
use crate::msg::Drive;
use crate::rt::clock;
use crate::rt::stop::Stop;
use crate::rt::thread::{self, Missing};
use crate::sim::plant::Plant;
use crate::sim::served::{ServeError, Served};
use crate::sim::world;
use std::io::{self, Write};

/// Runs the simulated robot on real CAN interfaces and a pseudo-terminal, for a controller in another process.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ip link add vcan0 type vcan; ip link set vcan0 up       and the same for vcan1
  compass plant --set robot.bus0.backend=socketcan:vcan0 --set robot.bus1.backend=socketcan:vcan1
  compass plant --config robot.toml --for 60
  compass plant --config robot.toml --fault boot_up@20s:drive=hip

If robot.imu.backend names a path, it becomes a symbolic link to the pseudo-terminal; otherwise its path is printed.
robot.lidar.link and robot.mocap.server are served too, if their addresses are of this machine.
A line per second tells angles, hip torque and the drives' states. Ends with SIGINT, SIGTERM or SIGHUP.
Exit codes: 0 fine, 2 configuration, 3 no such interface or address.")]
pub(crate) struct Args {
    #[command(flatten)]
    config: ConfigArgs,
    /// Injects a fault: `NAME@TIME[:ARGS]`, such as boot_up@3s:drive=hip. May be given often. `list` prints them all
    #[arg(long = "fault", value_name = "FAULT")]
    faults: Vec<String>,
    /// Ends after so many seconds
    #[arg(long = "for", value_name = "SECONDS")]
    for_s: Option<f64>,
}

impl Run for Args {
    fn run(self) -> anyhow::Result<Outcome> {
        if faults::is_listed(&self.faults)? {
            return Ok(Outcome::Fine);
        }
        let config = self.config.load_with_faults(&self.faults, Place::Plant)?.config;
        let stop = Stop::on_signals()?;
        let mut served = open(&config)?;
        let mut out = io::stdout().lock();
        writeln!(out, "IMU at {}", served.imu_path())?;
        if thread::enter(&config.real_time.simulated_robot()) != Missing::default() {
            writeln!(
                out,
                "no real-time priority: on a busy machine this robot answers late, and its controller trips"
            )?;
        }
        let start = clock::now();
        let end = self.for_s.map(|s| start + Span::from_s(s));
        let mut next_line = start;
        while !stop.is_requested() && end.is_none_or(|end| clock::now() < end) {
            served.turn();
            if served.plant().now() >= next_line {
                next_line += Span::from_ms(1000);
                write_line(&mut out, &mut served, start)?;
            }
        }
        let t = served.traffic();
        writeln!(
            out,
            "frames heard {}, sent {}, refused {}; IMU bytes nobody took {}",
            t.heard, t.sent, t.refused, t.imu_refused
        )?;
        Ok(Outcome::Fine)
    }
}

fn open(config: &Config) -> anyhow::Result<Served> {
    let plant = Plant::with_world(config, world::build(config)?);
    Served::open(config, plant).map_err(|error| match error {
        ServeError::NoInterface(_) => UsageError(error.to_string()).into(),
        other => other.into(),
    })
}

/// Time, leg angles, torque, states.
fn write_line(out: &mut impl Write, served: &mut Served, start: Stamp) -> io::Result<()> {
    let plant = served.plant();
    let seconds = plant.now().since(start).as_s();
    let [inner, outer] = plant.reading().leg_angle_rad.map(f64::to_degrees);
    let torque = plant.hip_torque_nm();
    write!(out, "{seconds:8.1} s  inner {inner:7.2} deg  outer {outer:7.2} deg  hip {torque:7.2} Nm ")?;
    for drive in Drive::ALL {
        write!(out, " {:?}", plant.drive_mut(*drive).state())?;
    }
    writeln!(out)?;
    out.flush()
}
