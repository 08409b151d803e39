//! The simulated server of motion capture on UDP: NatNet answers at its command port, Vicon sends to who listens.

use super::ServeError;
use crate::base::time::Stamp;
use crate::config::checked::{Mocap, MocapSource};
use crate::sim::mocap::SimMocap;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::os::fd::{AsRawFd, RawFd};

/// Its socket.
#[derive(Debug)]
pub(super) struct MocapPort {
    socket: UdpSocket,
    /// Who hears the frames; of NatNet, who asked for them last.
    host: Option<SocketAddr>,
}

impl MocapPort {
    /// At the address where the configuration looks for the server.
    pub(super) fn open(mocap: &Mocap) -> Result<Self, ServeError> {
        let (address, host) = match mocap.source {
            MocapSource::NatNet { server, .. } => (server, None),
            MocapSource::Vicon { .. } => (SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0)), Some(mocap.listen)),
        };
        let error = |cause| ServeError::Mocap { address, cause };
        let socket = UdpSocket::bind(address).map_err(error)?;
        socket.set_nonblocking(true).map_err(error)?;
        Ok(Self { socket, host })
    }

    /// Polls readable when somebody asks.
    pub(super) fn readable_fd(&self) -> RawFd {
        self.socket.as_raw_fd()
    }

    /// Takes requests, sends what is due. What the network does not take is lost, as on any.
    pub(super) fn turn(&mut self, server: &mut SimMocap, now: Stamp) {
        let mut buffer = [0; 512];
        while let Ok((count, from)) = self.socket.recv_from(&mut buffer) {
            self.host = Some(from);
            server.hear(now, &buffer[..count]);
        }
        while let Some(datagram) = server.take(now) {
            if let Some(host) = self.host {
                self.socket.send_to(&datagram, host).ok();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::time::Span;
    use crate::msg::MocapSample;
    use crate::sensor::mocap::MocapReader;
    use crate::sim::{Place, Reading};

    /// What a host at a real socket reads in the second frame that is sent.
    fn heard(mocap: &Mocap, host: &UdpSocket) -> MocapSample {
        let mut port = MocapPort::open(mocap).unwrap();
        let mut server = SimMocap::new(mocap, None, 1);
        let mut reader = MocapReader::new(mocap);
        host.set_nonblocking(true).unwrap();
        let (mut now, mut bytes, mut last) = (Stamp(1_000_000_000), [0; 2048], None);
        let mut frames = 0;
        while frames < 2 && now < Stamp(100_000_000_000) {
            if let (MocapSource::NatNet { server, .. }, Some(request)) = (&mocap.source, reader.request()) {
                host.send_to(request, server).unwrap();
            }
            server.measure(now, &Reading { leg_angle_rad: [0.2, 0.0], ..Reading::default() }, &Place::default());
            now += Span::from_ms(10);
            port.turn(&mut server, now);
            // Before the request has come there is nothing yet.
            while let Ok((count, _)) = host.recv_from(&mut bytes) {
                if let Some(pose) = reader.take(now, &bytes[..count]) {
                    (last, frames) = (Some(pose), frames + 1);
                }
            }
        }
        last.unwrap()
    }

    #[test]
    fn poses_come_over_the_network_from_both_kinds_of_server() {
        let host = UdpSocket::bind("127.0.0.1:0").unwrap();
        let listen = host.local_addr().unwrap();
        // A port that is free now.
        let server = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        for source in [MocapSource::NatNet { server, body: 3 }, MocapSource::Vicon { body: "robot".into() }] {
            let pose = heard(&Mocap { listen, source }, &host);
            assert!(pose.tracked && (pose.quaternion[2] - libm::sin(0.05)).abs() < 1e-5, "{pose:?}");
        }
    }
}
