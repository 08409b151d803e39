//! From the configuration's backends to wires: the same threads on simulated and real devices. RT: no.

use super::mock::MockParts;
use crate::base::listening::Pulse;
use crate::base::time::Stamp;
use crate::bus::loopback::{self, Loopback};
use crate::bus::socketcan::master::MasterLock;
use crate::bus::socketcan::{End, SocketCan, link_report};
use crate::cli::imu_probe;
use crate::config::checked::{BusBackend, BusConfig, Config, SerialBackend};
use crate::msg::BUSES;
use crate::rt::io::{ByteLine, ImuPort};
use crate::rt::process::BusPort;
use crate::rt::thread::Missing;
use crate::sensor::imu::ImuReader;
use crate::sensor::lidar::link::LidarLine;
use crate::sensor::operator::Hand;
use crate::sensor::serial::replug::LastingLine;
use anyhow::Context;
use std::io::{ErrorKind, Read, Write};
use std::os::fd::{AsRawFd, RawFd};
use std::os::unix::net::UnixStream;
use std::sync::Arc;

/// Wires, opened.
pub(super) struct Wiring {
    pub(super) buses: [BusPort; BUSES],
    pub(super) imu: ImuPort,
    pub(super) lidar: Option<LidarLine>,
    pub(super) hand: Hand,
    pub(super) mock: Option<MockParts>,
    pub(super) missing: Missing,
    /// Nobody else commands this robot or its buses while these live.
    pub(super) locks: Vec<MasterLock>,
}

/// True if no bus is real: then nothing can be hurt.
pub(super) fn is_simulated(config: &Config) -> bool {
    config.robot.is_simulated()
}

/// Opens everything that the configuration names.
pub(super) fn open(config: &Config, robot: &str) -> anyhow::Result<Wiring> {
    let locks = lock(config, robot)?;
    let pulse = Arc::default();
    let [(bus0, robot0, missing0), (bus1, robot1, missing1)] =
        [open_bus(config, 0, &pulse)?, open_bus(config, 1, &pulse)?];
    let (line, serial) = open_imu(config, &pulse)?;
    let (lidar, scanner) = open_lidar(config)?;
    let ends = [robot0, robot1];
    let mocked = ends.iter().any(Option::is_some) || serial.is_some() || scanner.is_some();
    Ok(Wiring {
        buses: [bus0, bus1],
        imu: ImuPort::new(ImuReader::new(&config.robot.imu), line),
        lidar,
        hand: Hand::open(config).context("robot.operator.source")?,
        mock: mocked.then(|| MockParts { config: config.clone(), ends, serial, scanner, pulse }),
        missing: missing0 | missing1,
        locks,
    })
}

/// One master for each interface, and one for each robot's channels.
fn lock(config: &Config, robot: &str) -> anyhow::Result<Vec<MasterLock>> {
    let mut locks = vec![MasterLock::take("robot", robot).with_context(|| format!("robot `{robot}`"))?];
    for bus in &config.robot.buses {
        if let BusBackend::SocketCan(name) = &bus.backend {
            locks.push(MasterLock::take("can", name).with_context(|| format!("CAN interface {name}"))?);
        }
    }
    Ok(locks)
}

fn open_bus(config: &Config, bus: usize, pulse: &Arc<Pulse>) -> anyhow::Result<(BusPort, Option<Loopback>, Missing)> {
    let settings = &config.robot.buses[bus];
    match &settings.backend {
        BusBackend::Mock => {
            let (host, robot) = loopback::mock(pulse)?;
            let (transmit, receive) = host.split();
            let last_words = Box::new(transmit.clone());
            let port = BusPort { transmit: Box::new(transmit), receive: Box::new(receive), last_words };
            Ok((port, Some(robot), Missing::default()))
        }
        BusBackend::SocketCan(name) => {
            let (port, missing) =
                open_socket(name, settings).with_context(|| format!("robot.bus{bus}.backend = socketcan:{name}"))?;
            Ok((port, None, missing))
        }
    }
}

fn open_socket(name: &str, settings: &BusConfig) -> std::io::Result<(BusPort, Missing)> {
    let (transmit, receive) = SocketCan::open(name, End::Controller, settings.echo_timeout)?.split();
    if settings.data_bitrate.is_some() {
        link_report::must_carry_fd(name)?;
    }
    let last_words = Box::new(transmit.clone());
    let may_restart = link_report::may_change_links();
    let missing = if may_restart { Missing::default() } else { Missing::BUS_RESTART };
    Ok((BusPort { transmit: Box::new(transmit), receive: Box::new(receive), last_words }, missing))
}

fn open_imu(config: &Config, pulse: &Arc<Pulse>) -> anyhow::Result<(Box<dyn ByteLine>, Option<UnixStream>)> {
    match &config.robot.imu.backend {
        SerialBackend::Mock => {
            let (host, device) = UnixStream::pair()?;
            host.set_nonblocking(true)?;
            device.set_nonblocking(true)?;
            Ok((Box::new(MockLine { host, robot: Arc::clone(pulse) }), Some(device)))
        }
        SerialBackend::Device(path) => {
            // A device that does not answer at all may get its power later.
            let answers = imu_probe::find(path, &config.robot.imu);
            if let Some(what) = answers.and_then(|answers| imu_probe::complaint(&config.robot.imu, answers)) {
                anyhow::bail!("robot.imu.backend = {path}: {what}");
            }
            let line = LastingLine::open(path, config.robot.imu.baud)
                .with_context(|| format!("robot.imu.backend = {path}"))?;
            Ok((Box::new(RealLine(line)), None))
        }
    }
}

/// The line to the lidar, if there is one, and the far end of a simulated one.
fn open_lidar(config: &Config) -> anyhow::Result<(Option<LidarLine>, Option<UnixStream>)> {
    let Some(lidar) = &config.robot.lidar else { return Ok((None, None)) };
    if let Some(line) = LidarLine::new(&lidar.link) {
        return Ok((Some(line), None));
    }
    let (line, device) = LidarLine::pair()?;
    Ok((Some(line), Some(device)))
}

/// The serial line of the simulated IMU.
struct MockLine {
    host: UnixStream,
    robot: Arc<Pulse>,
}

impl ByteLine for MockLine {
    fn read(&mut self, buffer: &mut [u8]) -> Option<usize> {
        match self.host.read(buffer) {
            Ok(0) => None,
            Ok(count) => Some(count),
            Err(error) => matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted).then_some(0),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> bool {
        self.host.write(bytes).is_ok_and(|count| count == bytes.len())
    }

    fn readable_fd(&self) -> RawFd {
        self.host.as_raw_fd()
    }

    fn complete_until(&self, now: Stamp) -> Stamp {
        self.robot.last().min(now)
    }
}

/// A serial device, which may be unplugged and come back.
struct RealLine(LastingLine);

impl ByteLine for RealLine {
    fn read(&mut self, buffer: &mut [u8]) -> Option<usize> {
        self.0.read(buffer)
    }

    fn write(&mut self, bytes: &[u8]) -> bool {
        self.0.write(bytes)
    }

    fn readable_fd(&self) -> RawFd {
        self.0.readable_fd()
    }
}
