//! Where the dead-man switch is, whether a stick beside it asks for the speed, and how that is written. RT: before arming only.

use super::reader::{Reader, range};
use crate::base::time::Span;
use std::net::{Ipv4Addr, SocketAddr};

/// Where the dead-man switch is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Operator {
    /// Simulated: pressed after a moment, held to the end.
    Simulated,
    /// A UNIX datagram socket: byte 1 = held, 0 = released, at 20 Hz or more.
    Socket(String),
    /// A key of an input device.
    Device(OperatorDevice),
    /// `compass remote` over a network.
    Remote(OperatorRemote),
}

/// A key of an input device (evdev).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OperatorDevice {
    /// The device.
    pub path: String,
    /// Number of the dead-man key, as linux/input-event-codes.h counts.
    pub key: u16,
    /// Number of the key that confirms the hip's zero with the legs aligned.
    pub zero_key: u16,
    /// What a wireless device must show.
    pub heartbeat: Option<Heartbeat>,
}

/// A sign of life: an axis that is never quite still.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Heartbeat {
    /// Number of the axis (ABS_X is 0).
    pub axis: u16,
    /// It moves at least once in this time.
    pub within: Span,
}

/// A hand behind a network.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OperatorRemote {
    /// Address and UDP port at which the robot listens.
    pub listen: SocketAddr,
    /// File with the secret that both ends know.
    pub secret_file: String,
}

/// The operator asks for the walking speed by a stick, in the place of `control.walk`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OperatorSpeed {
    /// What the stick asks for when it is pushed all the way, m/s.
    pub highest_m_s: f64,
    /// What the robot is asked for rises and falls no faster, m/s²; a stick at rest asks for 0 at once.
    pub rate_m_s2: f64,
    /// The stick of the robot's own input device; `None`: the person's end has one.
    pub stick: Option<Stick>,
}

/// An axis of an input device that is pushed from its rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stick {
    /// Number of the axis (`ABS_Y` is 1).
    pub axis: u16,
    /// Where it stands when nobody touches it, counts of the device.
    pub rest: i32,
    /// Where it stands when it is pushed all the way, counts.
    pub full: i32,
    /// Share of the way that still counts as rest.
    pub dead_zone: f64,
}

impl Stick {
    /// How far it is pushed, 0 to 1; pulled the other way is not pushed.
    #[must_use]
    pub fn share(&self, counts: i32) -> f64 {
        let way = f64::from(self.full) - f64::from(self.rest);
        let pushed = (f64::from(counts) - f64::from(self.rest)) / way;
        let share = ((pushed - self.dead_zone) / (1.0 - self.dead_zone)).clamp(0.0, 1.0);
        // No number at all: a way or a zone that `config` would have refused.
        if share.is_nan() { 0.0 } else { share }
    }
}

const SOURCES: &str =
    "must be \"simulated\", \"socket:/PATH\" of at most 107 bytes, \"device:/PATH\" or \"udp:ADDRESS:PORT\"";

/// The switch, and the stick if there is one.
pub(super) fn operator(r: &Reader<'_>) -> (Operator, Option<OperatorSpeed>) {
    let operator = switch(r);
    let has_axis = matches!(operator, Operator::Device(_));
    (operator, r.optional_table("speed", |r| speed(r, has_axis)))
}

/// A device of the robot's own has its axis here; with any other source the axis is the person's end's matter.
fn speed(r: &Reader<'_>, has_axis: bool) -> OperatorSpeed {
    OperatorSpeed {
        highest_m_s: r.number("highest_m_s", range(0.05, 2.0, "m/s")),
        rate_m_s2: r.number("rate_m_s2", range(0.01, 10.0, "m/s^2")),
        stick: has_axis.then(|| stick(r)),
    }
}

fn switch(r: &Reader<'_>) -> Operator {
    let source = r.text("source");
    match source.split_once(':') {
        None if source == "simulated" => Operator::Simulated,
        Some(("socket", path)) if path.starts_with('/') && path.len() < 108 => Operator::Socket(path.to_owned()),
        Some(("device", path)) if path.starts_with('/') => device(r, path),
        Some(("udp", address)) => remote(r, address),
        _ => {
            r.refuse("source", SOURCES);
            Operator::Simulated
        }
    }
}

fn stick(r: &Reader<'_>) -> Stick {
    let counts = |key| r.integer(key, i64::from(i32::MIN), i64::from(i32::MAX), "counts");
    let stick = Stick {
        axis: r.integer("axis", 0, 0x3F, "1"),
        rest: counts("rest_counts"),
        full: counts("full_counts"),
        dead_zone: r.number("dead_zone", range(0.0, 0.9, "1")),
    };
    if stick.rest == stick.full {
        r.refuse("full_counts", "must be another place than rest_counts");
    }
    stick
}

fn device(r: &Reader<'_>, path: &str) -> Operator {
    // KEY_MAX and ABS_MAX of the kernel.
    let key = |name| r.integer(name, 1, 0x2FF, "1");
    let (key, zero_key) = (key("key"), key("zero_key"));
    if key == zero_key {
        r.refuse("zero_key", "must be another key than the dead-man's");
    }
    let axis = r.optional_integer("heartbeat_axis", 0, 0x3F, "1");
    let within = r.optional_number("heartbeat_ms", range(20.0, 1000.0, "ms"));
    if axis.is_some() != within.is_some() {
        let key = if axis.is_some() { "heartbeat_axis" } else { "heartbeat_ms" };
        r.refuse(key, "heartbeat_axis and heartbeat_ms go together: both for a wireless device, none for a wired one");
    }
    let heartbeat = axis.zip(within).map(|(axis, ms)| Heartbeat { axis, within: Span::from_s(ms * 1e-3) });
    Operator::Device(OperatorDevice { path: path.to_owned(), key, zero_key, heartbeat })
}

fn remote(r: &Reader<'_>, address: &str) -> Operator {
    let listen = address.parse().ok().filter(|listen: &SocketAddr| listen.port() > 0);
    if listen.is_none() {
        r.refuse("source", "must be \"udp:ADDRESS:PORT\" with numbers, such as \"udp:127.0.0.1:4440\"");
    }
    let secret_file = r.text("secret_file");
    if !secret_file.starts_with('/') {
        r.refuse("secret_file", "must be a whole path, such as \"/etc/compass/remote.secret\"");
    }
    let listen = listen.unwrap_or(SocketAddr::from((Ipv4Addr::LOCALHOST, 0)));
    Operator::Remote(OperatorRemote { listen, secret_file })
}
