//! `compass zero`: a person says that the hip's legs are aligned. RT: no.

use super::operator::connect;
use super::{Outcome, Run, UsageError};
use crate::sensor::operator::socket::zero_datagram;
use anyhow::Context;
use std::io::{self, Write};
use std::path::PathBuf;

/// Confirms the hip's zero of a running robot: the legs are aligned, at rest and without torque.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass zero --socket /run/compass/operator                  the legs are aligned
  compass zero --socket /run/compass/operator --angle-deg 2    the inner leg is 2 degrees ahead of the outer one

The hip's encoder is incremental: its zero is lost at each boot-up of its drive, and nothing is armed without it. The robot
takes it only while it is disarmed, and when the hip has been at rest for 0.1 s; the blocker ZeroUnknown (index 0) goes away.
Exit codes: 0 told, 2 no such angle, 3 nobody listens at the socket.")]
pub(crate) struct Args {
    /// The robot's socket (robot.operator.source)
    #[arg(long, value_name = "PATH")]
    socket: PathBuf,
    /// Hip angle now, inner minus outer leg
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_negative_numbers = true)]
    angle_deg: f64,
}

impl Run for Args {
    fn run(self) -> anyhow::Result<Outcome> {
        if !(-90.0..=90.0).contains(&self.angle_deg) {
            return Err(UsageError(format!("--angle-deg {}: must be -90 to 90", self.angle_deg)).into());
        }
        let socket = connect(&self.socket)?;
        socket.send(&zero_datagram(self.angle_deg.to_radians())).context("the robot is gone")?;
        writeln!(io::stderr(), "told: the hip stands at {} degrees", self.angle_deg)?;
        Ok(Outcome::Fine)
    }
}
