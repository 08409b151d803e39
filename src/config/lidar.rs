//! The laser scanner, if there is one. RT: before arming only.

use super::reader::{Reader, range};
use crate::base::time::Span;
use std::f64::consts::{FRAC_PI_2, PI};
use std::net::{Ipv4Addr, SocketAddr};

/// A Hokuyo UTM-30LX or UTM-30LX-EW in the walking plane.
#[derive(Clone, Debug, PartialEq)]
pub struct Lidar {
    /// What carries its bytes.
    pub link: LidarLink,
    /// The part of the robot that carries it.
    pub mount: LidarMount,
    /// +1 if its angles count like ours, counter-clockwise with the robot walking to the right; else -1.
    pub sense: f64,
    /// Its angle of the beam that runs along the part to the floor, counter-clockwise from its front, rad.
    pub down_rad: f64,
    /// Where the floor is looked for, from that beam, + forward, rad.
    pub floor_rad: [f64; 2],
    /// Nearer returns are the robot itself, m.
    pub nearest_m: f64,
    /// Height of its mirror over the floor, lowest and highest, m.
    pub height_m: [f64; 2],
    /// A floor that scatters more about its line is none, m.
    pub roughest_m: f64,
    /// Fewer points on a line are none.
    pub least_points: u16,
    /// Time constant of the terrain zeroing filter.
    pub zero_time: Span,
    /// How the IMU's attitude drifts, rad/sqrt(s): the correction's uncertainty grows with it.
    pub drift_rad_sqrt_s: f64,
}

/// What carries the lidar's bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LidarLink {
    /// The simulated one in this process.
    Mock,
    /// UTM-30LX-EW: its address and port.
    Tcp(SocketAddr),
    /// UTM-30LX: its device, a USB modem (CDC).
    Serial(String),
}

/// The part of the robot that carries the lidar.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LidarMount {
    /// The inner leg, which carries the IMU.
    InnerLeg,
    /// The body, which bisects the legs.
    Body,
}

pub(super) fn lidar(r: &Reader<'_>) -> Lidar {
    const MOUNTS: &[(&str, LidarMount)] = &[("inner_leg", LidarMount::InnerLeg), ("body", LidarMount::Body)];
    let sense: i32 = r.integer("sense", -1, 1, "1");
    if sense == 0 {
        r.refuse("sense", "must be 1 or -1");
    }
    let lidar = Lidar {
        link: link(r),
        mount: r.choice("mount", MOUNTS, LidarMount::InnerLeg),
        sense: f64::from(sense),
        down_rad: r.number("down_rad", range(-PI, PI, "rad")),
        floor_rad: r.numbers("floor_rad", range(-FRAC_PI_2, FRAC_PI_2, "rad")),
        nearest_m: r.number("nearest_m", range(0.023, 10.0, "m")),
        height_m: r.numbers("height_m", range(0.05, 5.0, "m")),
        roughest_m: r.number("roughest_m", range(0.001, 0.5, "m")),
        least_points: r.integer("least_points", 10, 1081, "points"),
        zero_time: r.span("zero_time_s", 1.0, 600.0),
        drift_rad_sqrt_s: r.number("drift_rad_sqrt_s", range(0.0, 0.1, "rad/sqrt(s)")),
    };
    let [low, high] = lidar.height_m;
    if low >= high {
        r.refuse("height_m", "must be the lowest and the highest height, in this order");
    }
    let [from, to] = lidar.floor_rad;
    if to - from < 0.2 {
        r.refuse("floor_rad", "must be a sector of at least 0.2 rad, from behind to ahead: [-1.1, 1.1]");
    }
    lidar
}

fn link(r: &Reader<'_>) -> LidarLink {
    let text = r.text("link");
    if let Some(address) = text.strip_prefix("tcp:").and_then(|address| address.parse().ok()) {
        return LidarLink::Tcp(address);
    }
    if let Some(path) = text.strip_prefix("serial:").filter(|path| path.starts_with('/')) {
        return LidarLink::Serial(path.to_owned());
    }
    if text != "mock" {
        let example = SocketAddr::from((Ipv4Addr::new(192, 168, 0, 10), 10940));
        r.refuse(
            "link",
            &format!("must be \"mock\", \"tcp:ADDRESS:PORT\" such as \"tcp:{example}\", or \"serial:PATH\" such as \"serial:/dev/ttyACM0\""),
        );
    }
    LidarLink::Mock
}
