//! `compass remote`: a dead-man switch for a hand at a key of another computer. RT: no.

use super::operator::in_words;
use super::operator::key::{Key, KeyArgs, KeyState};
use super::{Outcome, Run};
use crate::base::time::Span;
use crate::msg::{FaultCode, Mode};
use crate::rt::clock;
use crate::rt::stop::Stop;
use crate::sensor::operator::remote::packet::{Datagram, LONGEST};
use crate::sensor::operator::remote::sender::Sender;
use crate::sensor::operator::remote::{REPEAT_AFTER, STATE_EVERY, chance, read_secret};
use anyhow::Context;
use std::io::{self, ErrorKind, Write};
use std::net::{SocketAddr, ToSocketAddrs, UdpSocket};
use std::path::PathBuf;
use std::time::Duration;

/// States of the release at the end, each sent twice.
const RELEASES: usize = 10;
/// The robot is called silent after this: three of its views.
const SILENT: Span = Span::from_ms(300);

/// Holds the dead-man switch of a robot on another computer while a key is held.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  head -c 32 /dev/urandom | base64 > remote.secret && chmod 600 remote.secret    once, then to both computers
  compass remote --to 10.0.0.2:4440 --secret remote.secret                       the space bar of this terminal
  compass remote --to 10.0.0.2:4440 --secret remote.secret --device /dev/input/by-id/usb-Pedal-event-kbd --key 57

The robot listens where robot.operator.source = \"udp:ADDRESS:PORT\" says. Its loopback address and a tunnel keep the port
from everybody else. Keys and --speed-axis as in `compass operator`; z confirms the hip's zero, q ends. What comes back is the robot's mode
and fault, ten times a second.
Exit codes: 0 ended by the person, 2 no key to hold, 3 the secret, the address or the device.")]
pub(crate) struct Args {
    /// The robot's address and UDP port
    #[arg(long, value_name = "HOST:PORT")]
    to: String,
    /// File with the secret that the robot knows too, 16 bytes or more; nobody else may read it
    #[arg(long, value_name = "PATH")]
    secret: PathBuf,
    #[command(flatten)]
    key: KeyArgs,
}

impl Run for Args {
    fn run(self) -> anyhow::Result<Outcome> {
        let stop = Stop::on_signals().context("signal handlers")?;
        let secret = read_secret(&self.secret).with_context(|| format!("--secret {}", self.secret.display()))?;
        let socket = connect(&self.to).with_context(|| format!("--to {}", self.to))?;
        let mut key = Key::open(&self.key)?;
        let mut link = Link { socket, sender: Sender::new(secret, chance()?), stick: None, shown: String::new() };
        let held = beat(&mut link, &mut key, &stop);
        for _ in 0..RELEASES {
            let open = link.sender.state(clock::now(), false, link.stick.and(Some(0.0)));
            for _ in 0..2 {
                link.send(open.as_ref())?;
                std::thread::sleep(pause(REPEAT_AFTER));
            }
        }
        drop(key);
        held?;
        Ok(Outcome::Fine)
    }
}

/// A socket towards the robot.
fn connect(to: &str) -> anyhow::Result<UdpSocket> {
    let address = to.to_socket_addrs()?.next().context("no such address")?;
    let here: SocketAddr = if address.is_ipv4() { "0.0.0.0:0".parse()? } else { "[::]:0".parse()? };
    let socket = UdpSocket::bind(here)?;
    socket.connect(address)?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

fn pause(span: Span) -> Duration {
    Duration::from_nanos(u64::try_from(span.0).unwrap_or(0))
}

/// Says how the key is, each state twice, until the person or a signal ends it.
fn beat(link: &mut Link, key: &mut Key, stop: &Stop) -> anyhow::Result<()> {
    let rest = Span(STATE_EVERY.0 - REPEAT_AFTER.0);
    while !stop.is_requested() {
        let held = match key.wait(pause(rest))? {
            KeyState::Quit => return Ok(()),
            KeyState::Zero => {
                link.sender.confirm_zero(0.0);
                false
            }
            KeyState::Switch { held, stick } => {
                link.stick = stick;
                held
            }
        };
        let now = clock::now();
        let hello = link.sender.hello(now);
        link.send(hello.as_ref())?;
        let state = link.sender.state(now, held, link.stick);
        link.send(state.as_ref())?;
        std::thread::sleep(pause(REPEAT_AFTER));
        link.send(state.as_ref())?;
        link.listen()?;
        link.show(held)?;
    }
    Ok(())
}

/// The socket and what is known at this end.
struct Link {
    socket: UdpSocket,
    sender: Sender,
    /// How far the stick is pushed, if there is one, 0 to 1.
    stick: Option<f64>,
    shown: String,
}

impl Link {
    /// Sends; a network that is not there is as good as loss.
    fn send(&self, datagram: Option<&Datagram>) -> io::Result<()> {
        let Some(datagram) = datagram else { return Ok(()) };
        match self.socket.send(datagram.as_slice()) {
            Ok(_) => Ok(()),
            Err(error) if is_loss(&error) => Ok(()),
            Err(error) => Err(error),
        }
    }

    fn listen(&mut self) -> io::Result<()> {
        let mut bytes = [0; LONGEST + 1];
        loop {
            match self.socket.recv(&mut bytes) {
                Ok(count) => {
                    // What is not the robot's changes nothing.
                    self.sender.take(clock::now(), &bytes[..count]);
                }
                Err(error) if is_loss(&error) => return Ok(()),
                Err(error) => return Err(error),
            }
        }
    }

    /// A line when something has changed.
    fn show(&mut self, held: bool) -> io::Result<()> {
        let robot = match self.sender.robot(clock::now()) {
            None => "no answer yet".to_owned(),
            Some((_, age)) if age > SILENT => "SILENT".to_owned(),
            Some((view, _)) if view.mode == Mode::Faulted => format!("fault {}", view.first_fault.name()),
            Some((view, _)) => format!("{}{}", view.mode.name(), blockers(view.arm_blockers)),
        };
        let line = format!("{}  robot: {robot}", in_words(held, self.stick));
        if line != self.shown {
            write!(io::stderr(), "{line}\r\n")?;
            self.shown = line;
        }
        Ok(())
    }
}

/// What keeps the robot from arming.
fn blockers(bits: u64) -> String {
    let names: Vec<&str> =
        (0..64).filter(|bit| bits >> bit & 1 == 1).filter_map(FaultCode::from_u8).map(FaultCode::name).collect();
    if names.is_empty() { String::new() } else { format!(", not to be armed: {}", names.join(", ")) }
}

/// Nothing there, or nobody: an unreachable host may come back.
fn is_loss(error: &io::Error) -> bool {
    use ErrorKind::{ConnectionRefused, HostUnreachable, Interrupted, NetworkDown, NetworkUnreachable, WouldBlock};
    [WouldBlock, ConnectionRefused, HostUnreachable, NetworkDown, NetworkUnreachable, Interrupted]
        .contains(&error.kind())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blockers_are_told_by_name() {
        let bits = 1 << FaultCode::ImuStale as u64 | 1 << FaultCode::ZeroUnknown as u64;
        assert_eq!(blockers(bits), ", not to be armed: ImuStale, ZeroUnknown");
        assert_eq!(blockers(0), "");
    }
}
