//! Motion capture, if there is any. RT: before arming only.

use super::reader::Reader;
use std::net::{Ipv4Addr, SocketAddr};

/// Where ground truth comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mocap {
    /// Our address and UDP port: the interface towards the cameras.
    pub listen: SocketAddr,
    /// Who sends, and which of its bodies is the robot.
    pub source: MocapSource,
}

/// Who sends poses.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MocapSource {
    /// OptiTrack NatNet.
    NatNet {
        /// Address and command port of the server.
        server: SocketAddr,
        /// Number of the rigid body.
        body: u32,
    },
    /// Vicon's UDP object stream.
    Vicon {
        /// Name of the object.
        body: String,
    },
}

pub(super) fn mocap(r: &Reader<'_>) -> Mocap {
    const SOURCES: &[(&str, bool)] = &[("natnet", true), ("vicon", false)];
    let is_natnet = r.choice("source", SOURCES, false);
    let listen = address(r, "listen", "\"192.168.1.20:1511\"");
    let body = r.text("body");
    let source = if is_natnet {
        let number = body.parse();
        if number.is_err() {
            r.refuse("body", "must be the number of a rigid body in quotes, such as \"1\"");
        }
        MocapSource::NatNet { server: address(r, "server", "\"192.168.1.5:1510\""), body: number.unwrap_or(0) }
    } else {
        if body.is_empty() || body.len() > 24 {
            r.refuse("body", "must be the name of an object, 1 to 24 bytes");
        }
        MocapSource::Vicon { body }
    };
    Mocap { listen, source }
}

fn address(r: &Reader<'_>, key: &'static str, example: &str) -> SocketAddr {
    let text = r.text(key);
    text.parse().unwrap_or_else(|_| {
        r.refuse(key, &format!("must be an address and a port in numbers, such as {example}"));
        SocketAddr::from((Ipv4Addr::LOCALHOST, 0))
    })
}
