//! `compass operator`: a dead-man switch at a terminal, held while this program lives. RT: no.

use super::{Outcome, Run};
use crate::rt::stop::Stop;
use anyhow::Context;
use std::io::{self, Write};
use std::os::unix::net::UnixDatagram;
use std::path::PathBuf;
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Between two heartbeats: five fit into the 100 ms after which silence is a fault.
const HEARTBEAT: Duration = Duration::from_millis(20);
/// So long the switch is shown open before it is pressed: arming wants to see a release first.
const OPEN_FIRST: Duration = Duration::from_millis(500);
/// Heartbeats of the release, so that one lost datagram does not matter.
const RELEASES: usize = 3;

const RELEASED: [u8; 1] = [0];
const HELD: [u8; 1] = [1];

/// Holds the dead-man switch of a running robot; Ctrl-C lets go.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass run --set robot.operator.source=socket:/run/compass/operator
  compass operator --socket /run/compass/operator      shows an open switch, presses, holds; Ctrl-C lets go

Killing it is as good as letting go: silence is a fault after robot.limits.operator_age_ms.
Exit codes: 0 let go, 3 nobody listens at the socket.")]
pub(crate) struct Args {
    /// The robot's socket (robot.operator.source)
    #[arg(long, value_name = "PATH")]
    socket: PathBuf,
}

impl Run for Args {
    fn run(self) -> anyhow::Result<Outcome> {
        let stop = Stop::on_signals().context("signal handlers")?;
        let socket = UnixDatagram::unbound()?;
        socket.connect(&self.socket).with_context(|| format!("nobody listens at {}", self.socket.display()))?;
        beat(&socket, &RELEASED, &stop, Some(Instant::now() + OPEN_FIRST))?;
        writeln!(io::stderr(), "held; Ctrl-C lets go")?;
        let held = beat(&socket, &HELD, &stop, None);
        for _ in 0..RELEASES {
            // The robot may be gone already, and then all is well.
            drop(socket.send(&RELEASED));
        }
        held?;
        writeln!(io::stderr(), "released")?;
        Ok(Outcome::Fine)
    }
}

/// Says the same again and again until `end` or the stop.
fn beat(socket: &UnixDatagram, byte: &[u8; 1], stop: &Stop, end: Option<Instant>) -> anyhow::Result<()> {
    while !stop.is_requested() && end.is_none_or(|end| Instant::now() < end) {
        socket.send(byte).context("the robot is gone")?;
        sleep(HEARTBEAT);
    }
    Ok(())
}
