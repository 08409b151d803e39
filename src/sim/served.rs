//! The simulated robot on real interfaces, at the pace of the real clock: two CAN sockets, a pseudo-terminal, and the ports
//! of lidar and motion capture.
//!
//! What comes is handed to the plant when it is noticed, what the plant sends goes out when its time has come; so the
//! reaction of a drive is late by the wake-up of this process. RT: no.

pub mod lidar;
mod mocap;

use super::plant::Plant;
use crate::base::time::{Span, Stamp};
use crate::bus::socketcan::{End, SocketCan, link_report};
use crate::bus::{Receive, Transmit};
use crate::config::checked::{BusBackend, Config, SerialBackend};
use crate::msg::{BUSES, FrameBatch};
use crate::rt::{clock, poll};
use crate::sensor::serial::PseudoTerminal;
use lidar::LidarPort;
use mocap::MocapPort;
use std::fs;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

/// The plant moves on at least so often.
const STEP: Span = Span::from_us(500);

/// Why the robot cannot be put on its interfaces.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// A bus without a name.
    #[error("robot.bus{0}.backend must be \"socketcan:NAME\": the simulated robot needs an interface to sit on")]
    NoInterface(usize),
    /// A bus that cannot be opened.
    #[error("cannot open CAN interface {name}: {cause}")]
    Can {
        /// The interface.
        name: String,
        /// Why not.
        cause: std::io::Error,
    },
    /// No pseudo-terminal.
    #[error("cannot make a pseudo-terminal")]
    Terminal(#[from] serialport::Error),
    /// The address where the controller looks for the lidar is not this machine's, or taken.
    #[error("cannot serve the lidar at {address} (robot.lidar.link, an address of this machine): {cause}")]
    Lidar {
        /// The address.
        address: SocketAddr,
        /// Why not.
        cause: std::io::Error,
    },
    /// The address where the controller looks for motion capture is not this machine's, or taken.
    #[error("cannot serve motion capture at {address} (robot.mocap.server, an address of this machine): {cause}")]
    Mocap {
        /// The address.
        address: SocketAddr,
        /// Why not.
        cause: std::io::Error,
    },
    /// The path where the controller looks for a serial device is taken, or its folder is not there.
    #[error("cannot make {path} point to the pseudo-terminal: {cause}")]
    Symlink {
        /// The path.
        path: String,
        /// Why not.
        cause: std::io::Error,
    },
}

/// What went through.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Frames from the controller.
    pub heard: u64,
    /// Frames to the controller.
    pub sent: u64,
    /// Frames that an interface did not take.
    pub refused: u64,
    /// Bytes of the IMU that nobody took.
    pub imu_refused: u64,
}

/// The robot on its interfaces.
pub struct Served {
    plant: Plant,
    buses: Vec<SocketCan>,
    /// None while the IMU is unplugged.
    terminal: Option<PseudoTerminal>,
    /// Where the controller looks for it.
    imu_path: Option<String>,
    link: Option<Link>,
    lidar: Option<LidarPort>,
    mocap: Option<MocapPort>,
    traffic: Traffic,
    bytes: Vec<u8>,
}

impl Served {
    /// Opens everything. If the configuration names a path for the IMU, it is made to point to the pseudo-terminal.
    ///
    /// # Errors
    /// [`ServeError`].
    pub fn open(config: &Config, mut plant: Plant) -> Result<Self, ServeError> {
        let buses = (0..BUSES).map(|bus| open_bus(config, bus)).collect::<Result<_, _>>()?;
        let terminal = PseudoTerminal::new()?;
        let imu_path = match &config.robot.imu.backend {
            SerialBackend::Mock => None,
            SerialBackend::Device(path) => Some(path.clone()),
        };
        let link = imu_path.as_ref().map(|path| Link::new(path, terminal.path().unwrap_or_default())).transpose()?;
        let robot = &config.robot;
        let lidar = robot.lidar.as_ref().map(|it| LidarPort::open(&it.link)).transpose()?.flatten();
        let mocap = robot.mocap.as_ref().map(MocapPort::open).transpose()?;
        plant.set_echo(false);
        plant.start_at(clock::now());
        let terminal = Some(terminal);
        let (traffic, bytes) = (Traffic::default(), Vec::new());
        Ok(Self { plant, buses, terminal, imu_path, link, lidar, mocap, traffic, bytes })
    }

    /// Where the IMU can be opened.
    #[must_use]
    pub fn imu_path(&self) -> String {
        self.terminal.as_ref().and_then(PseudoTerminal::path).unwrap_or_default()
    }

    /// The robot.
    pub const fn plant(&mut self) -> &mut Plant {
        &mut self.plant
    }

    /// What went through.
    #[must_use]
    pub const fn traffic(&self) -> &Traffic {
        &self.traffic
    }

    /// Waits for something to do, at most a step, and does it.
    pub fn turn(&mut self) {
        let imu = self.terminal.as_ref().map_or(-1, |terminal| terminal.far.readable_fd());
        let [lidar, host] = self.lidar.as_ref().map_or([-1; 2], LidarPort::readable_fds);
        let mocap = self.mocap.as_ref().map_or(-1, MocapPort::readable_fd);
        let fds = [self.buses[0].readable_fd(), self.buses[1].readable_fd(), imu, lidar, host, mocap];
        poll::readable(fds, self.plant.now() + STEP);
        let now = clock::now();
        self.plant.advance_to(now);
        self.replug();
        self.hear();
        self.speak(now);
        if let (Some(port), Some(device)) = (&mut self.lidar, self.plant.lidar()) {
            port.turn(device, now);
        }
        if let (Some(port), Some(server)) = (&mut self.mocap, self.plant.mocap()) {
            port.turn(server, now);
        }
    }

    /// The IMU's line goes with its adapter, and comes back under another name. Where none can be made it stays away.
    fn replug(&mut self) {
        if !self.plant.imu_is_plugged() {
            (self.terminal, self.link) = (None, None);
        } else if self.terminal.is_none() {
            self.terminal = PseudoTerminal::new().ok();
            let target = self.imu_path();
            self.link = self.imu_path.as_ref().and_then(|path| Link::new(path, target).ok());
        }
    }

    fn hear(&mut self) {
        for (bus, socket) in self.buses.iter_mut().enumerate() {
            while let Some(received) = socket.receive() {
                if !received.frame.is_error() {
                    self.traffic.heard += 1;
                    self.traffic.refused += u64::from(!self.plant.deliver(bus, &received.frame));
                }
            }
        }
        let mut buffer = [0; 256];
        let read = self.terminal.as_mut().and_then(|terminal| terminal.far.read(&mut buffer));
        if let Some(count) = read.filter(|n| *n > 0) {
            self.plant.deliver_imu_bytes(&buffer[..count]);
        }
    }

    fn speak(&mut self, now: Stamp) {
        // What was heard may have been answered within the step.
        self.plant.advance_to(now);
        for (bus, socket) in self.buses.iter_mut().enumerate() {
            let mut batch = FrameBatch::default();
            self.plant.take_frames(bus, &mut batch);
            for frame in &batch {
                match socket.send(&frame.frame) {
                    Ok(()) => self.traffic.sent += 1,
                    Err(_) => self.traffic.refused += 1,
                }
            }
        }
        self.bytes.clear();
        self.plant.take_imu_bytes(&mut self.bytes);
        let taken = self.terminal.as_mut().is_none_or(|terminal| terminal.far.write(&self.bytes));
        if !self.bytes.is_empty() && !taken {
            self.traffic.imu_refused += self.bytes.len() as u64;
        }
    }
}

/// The name of a device, which points to its pseudo-terminal as long as this lives.
#[derive(Debug)]
struct Link(PathBuf);

impl Link {
    /// Replaces an old link, never a real file or device.
    fn new(path: &str, target: String) -> Result<Self, ServeError> {
        let error = |cause| ServeError::Symlink { path: path.to_owned(), cause };
        let link = Path::new(path);
        if fs::symlink_metadata(link).is_ok_and(|m| m.file_type().is_symlink()) {
            fs::remove_file(link).map_err(error)?;
        }
        std::os::unix::fs::symlink(target, link).map_err(error)?;
        Ok(Self(link.to_owned()))
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        // If it is gone already there is nothing to do.
        drop(fs::remove_file(&self.0));
    }
}

fn open_bus(config: &Config, bus: usize) -> Result<SocketCan, ServeError> {
    let settings = &config.robot.buses[bus];
    let BusBackend::SocketCan(name) = &settings.backend else { return Err(ServeError::NoInterface(bus)) };
    let can_error = |cause| ServeError::Can { name: name.clone(), cause };
    let socket = SocketCan::open(name, End::Robot, settings.echo_timeout).map_err(can_error)?;
    if settings.data_bitrate.is_some() {
        link_report::must_carry_fd(name).map_err(can_error)?;
    }
    Ok(socket)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_old_link_is_replaced_and_a_real_file_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("imu");
        let name = path.to_str().unwrap();
        let first = Link::new(name, "/dev/pts/1".into()).unwrap();
        let second = Link::new(name, "/dev/pts/2".into()).unwrap();
        assert_eq!(fs::read_link(&path).unwrap(), Path::new("/dev/pts/2"));
        drop((first, second));
        assert!(fs::symlink_metadata(&path).is_err(), "it goes with its device");
        let file = folder.path().join("file");
        fs::write(&file, "mine").unwrap();
        assert!(Link::new(file.to_str().unwrap(), "/dev/pts/1".into()).is_err());
        assert_eq!(fs::read_to_string(&file).unwrap(), "mine");
    }
}
