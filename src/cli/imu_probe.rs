//! At which baud rate, and in which protocol, does the IMU answer? For `run` before its threads start, and for `doctor`. RT: no.

use crate::config::checked::{Imu, ImuProtocol};
use crate::sensor::imu_codec::{Kind, Parser, Request};
use crate::sensor::mip::{self, Command};
use crate::sensor::serial::SerialLine;
use std::thread::sleep;
use std::time::Duration;

/// What these devices can be set to, bit/s.
const BAUDS: [u32; 4] = [921_600, 460_800, 230_400, 115_200];
/// After the stop request what was under way arrives.
const DRAIN: Duration = Duration::from_millis(60);
/// An answer takes a few milliseconds, 16 more behind an adapter with its latency timer as delivered.
const PATIENCE: Duration = Duration::from_millis(80);

/// How a device answers.
pub(super) type Answers = (u32, ImuProtocol);

/// What a probed line has to do.
trait Line {
    /// Sends a request; what comes within a while.
    fn exchange(&mut self, request: &[u8], patience: Duration) -> Vec<u8>;
}

impl Line for SerialLine {
    fn exchange(&mut self, request: &[u8], patience: Duration) -> Vec<u8> {
        let mut heard = Vec::new();
        if self.write(request) {
            sleep(patience);
            let mut bytes = [0; 512];
            while let Some(count @ 1..) = self.read(&mut bytes) {
                heard.extend_from_slice(&bytes[..count]);
            }
        }
        heard
    }
}

/// Asks the device at this path; `None` if it does not answer at any rate in any protocol, or is not there.
pub(super) fn find(path: &str, imu: &Imu) -> Option<Answers> {
    find_on(imu, |baud| SerialLine::open(path, baud).ok())
}

/// A sentence if the device answers otherwise than configured.
pub(super) fn complaint(imu: &Imu, answers: Answers) -> Option<String> {
    let (baud, protocol) = answers;
    let word = |protocol| match protocol {
        ImuProtocol::Gx3 => "gx3",
        ImuProtocol::Mip => "mip",
    };
    ((baud, protocol) != (imu.baud, imu.protocol)).then(|| {
        format!(
            "the IMU answers at {baud} bit/s in protocol {}; robot.imu.baud_bit_s is {} and robot.imu.protocol {}",
            word(protocol),
            imu.baud,
            word(imu.protocol)
        )
    })
}

/// As configured first, then all others.
fn find_on<L: Line>(imu: &Imu, mut open: impl FnMut(u32) -> Option<L>) -> Option<Answers> {
    let other = match imu.protocol {
        ImuProtocol::Gx3 => ImuProtocol::Mip,
        ImuProtocol::Mip => ImuProtocol::Gx3,
    };
    let bauds = std::iter::once(imu.baud).chain(BAUDS.into_iter().filter(|baud| *baud != imu.baud));
    for baud in bauds {
        for protocol in [imu.protocol, other] {
            let mut line = open(baud)?;
            if answers(&mut line, protocol) {
                return Some((baud, protocol));
            }
        }
    }
    None
}

/// True if what comes back on a question is an answer, its checksum included.
fn answers(line: &mut impl Line, protocol: ImuProtocol) -> bool {
    match protocol {
        ImuProtocol::Gx3 => {
            line.exchange(Request::StopContinuous.emit().as_slice(), DRAIN);
            let heard = line.exchange(Request::Identity(2).emit().as_slice(), PATIENCE);
            let mut parser = Parser::new(&[Kind::Identity]);
            heard.iter().any(|byte| parser.push(*byte).is_some())
        }
        ImuProtocol::Mip => {
            line.exchange(Command::Idle.packet().as_slice(), DRAIN);
            let heard = line.exchange(Command::Ping.packet().as_slice(), PATIENCE);
            let (mut parser, mut found) = (mip::Parser::default(), false);
            heard
                .iter()
                .for_each(|byte| parser.push(*byte, |packet| found |= packet.acknowledges(Command::Ping).is_some()));
            found
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::time::Stamp;
    use crate::config;
    use crate::sim::Reading;
    use crate::sim::imu::SimImu;

    /// The simulated device at one rate; at any other it hears and says garbage.
    struct Wired {
        device: SimImu,
        now: Stamp,
        right: bool,
    }

    impl Line for Wired {
        fn exchange(&mut self, request: &[u8], patience: Duration) -> Vec<u8> {
            let mut heard = Vec::new();
            let garbled: Vec<u8> = request.iter().map(|byte| byte & 0xF0 | 0x0E).collect();
            let bytes = if self.right { request } else { &garbled };
            self.device.hear(self.now, bytes, &Reading::default());
            self.now += crate::base::time::Span(i64::try_from(patience.as_nanos()).unwrap());
            self.device.take(self.now, &mut heard);
            if self.right { heard } else { vec![0x80, 0x78, 0xFE, 0x00] }
        }
    }

    fn found(configured: (u32, ImuProtocol), device: (u32, ImuProtocol)) -> Option<Answers> {
        let config = config::load(None, &[]).unwrap().config;
        let imu = |(baud, protocol)| Imu { baud, protocol, ..config.robot.imu.clone() };
        find_on(&imu(configured), |baud| {
            let wired = SimImu::new(&imu(device), &config.simulation.imu, 1);
            Some(Wired { device: wired, now: Stamp(1_000_000_000), right: baud == device.0 })
        })
    }

    #[test]
    fn a_device_at_another_rate_or_in_another_protocol_is_named() {
        use ImuProtocol::{Gx3, Mip};
        for device in [(921_600, Gx3), (115_200, Gx3), (460_800, Mip)] {
            assert_eq!(found((921_600, Gx3), device), Some(device));
        }
        assert_eq!(found((921_600, Gx3), (57_600, Gx3)), None, "no rate of ours");
        let imu = Imu { baud: 921_600, ..config::load(None, &[]).unwrap().config.robot.imu };
        assert_eq!(complaint(&imu, (921_600, Gx3)), None);
        let words = complaint(&imu, (115_200, Mip)).unwrap();
        assert!(words.contains("answers at 115200 bit/s in protocol mip"), "{words}");
    }
}
