//! `compass operator`: a dead-man switch for a hand at a key. RT: no.
//!
//! Nothing here holds by itself. With `--device` the key's state is asked of the kernel. A terminal tells no release, so
//! there "held" means that the key repeats without a gap; when a connection or a keyboard dies, repeats end.

pub(super) mod key;

use super::{Outcome, Run};
use crate::rt::stop::Stop;
use crate::sensor::operator::socket::{HELD, OPEN, stick_datagram, zero_datagram};
use anyhow::Context;
use key::{Key, KeyArgs, KeyState};
use std::io::{self, Write};
use std::os::unix::net::UnixDatagram;
use std::path::PathBuf;
use std::time::Duration;

/// Between two heartbeats: five fit into the 100 ms after which silence is a fault.
const HEARTBEAT: Duration = Duration::from_millis(20);

/// Heartbeats of the release, so that one lost datagram does not matter.
const RELEASES: usize = 3;

/// Holds the dead-man switch of a running robot while a key is held.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass run --config /etc/compass                                (robot.operator.source = \"socket:/run/compass/operator\")
  compass operator --socket /run/compass/operator                  the space bar of this terminal
  compass operator --socket /run/compass/operator --device /dev/input/by-id/usb-Pedal-event-kbd --key 57

First hold until the toes have found their zero, let go, then press again to arm. In a terminal a key counts as held while
it repeats without a gap of 100 ms, which begins after the keyboard's first delay; z confirms the hip's zero with the legs
aligned, q ends. A key of a device is held once it was seen released and then pressed; a wireless device needs
--heartbeat-axis and --heartbeat-ms, as its receiver may repeat a held key for ever when the radio dies. With --speed-axis a
stick of the device asks for the walking speed while the key is held; a robot without robot.operator.speed does not take
such a hand. Only one process at a time has the switch: a second one is refused by the robot.
Killing it is as good as letting go: silence is a fault after robot.limits.operator_age_ms.
Exit codes: 0 ended by the person, 2 no key to hold, 3 nobody listens at the socket or the device is gone.")]
pub(crate) struct Args {
    /// The robot's socket (robot.operator.source)
    #[arg(long, value_name = "PATH")]
    socket: PathBuf,
    #[command(flatten)]
    key: KeyArgs,
}

impl Run for Args {
    fn run(self) -> anyhow::Result<Outcome> {
        let stop = Stop::on_signals().context("signal handlers")?;
        let socket = connect(&self.socket)?;
        let mut key = Key::open(&self.key)?;
        let held = beat(&socket, &mut key, &stop);
        for _ in 0..RELEASES {
            // The robot may be gone already, and then all is well.
            drop(socket.send(&[OPEN]));
        }
        drop(key);
        held?;
        Ok(Outcome::Fine)
    }
}

/// A socket towards the robot's.
pub(super) fn connect(path: &std::path::Path) -> anyhow::Result<UnixDatagram> {
    let socket = UnixDatagram::unbound()?;
    socket.connect(path).map_err(|error| {
        let why = why_not(error.kind());
        anyhow::Error::new(error).context(format!("{why} {}", path.display()))
    })?;
    Ok(socket)
}

/// A robot that listens, but not to this user, is not gone.
const fn why_not(kind: io::ErrorKind) -> &'static str {
    match kind {
        io::ErrorKind::PermissionDenied => "only the robot's user and members of its group operate it at",
        _ => "nobody listens at",
    }
}

/// Says how the key is, again and again, until the person or a signal ends it.
fn beat(socket: &UnixDatagram, key: &mut Key, stop: &Stop) -> anyhow::Result<()> {
    let mut shown = String::new();
    while !stop.is_requested() {
        match key.wait(HEARTBEAT)? {
            KeyState::Quit => return Ok(()),
            KeyState::Zero => drop(socket.send(&zero_datagram(0.0)).context("the robot is gone")?),
            KeyState::Switch { held, stick } => {
                match stick {
                    Some(share) => socket.send(&stick_datagram(held, share)),
                    None => socket.send(&[if held { HELD } else { OPEN }]),
                }
                .context("the robot is gone")?;
                let line = in_words(held, stick);
                if line != shown {
                    write!(io::stderr(), "{line}\r\n")?;
                    shown = line;
                }
            }
        }
    }
    Ok(())
}

/// The switch, and the stick in tenths of its way.
pub(super) fn in_words(held: bool, stick: Option<f64>) -> String {
    let switch = if held { "held" } else { "open" };
    stick
        .map_or_else(|| switch.to_owned(), |share| format!("{switch}, stick at {:.0} %", 10.0 * (10.0 * share).round()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stick_is_told_in_tenths() {
        assert_eq!(in_words(true, Some(0.46)), "held, stick at 50 %");
        assert_eq!(in_words(false, None), "open");
    }

    #[test]
    fn who_is_refused_and_who_finds_nobody_are_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let told = format!("{:#}", connect(&folder.path().join("hand")).unwrap_err());
        assert!(told.starts_with("nobody listens at ") && told.contains("No such file"), "{told}");
        // Seen whole in the guest, as another user: this one may be root.
        assert!(why_not(io::ErrorKind::PermissionDenied).contains("members of its group"));
    }
}
