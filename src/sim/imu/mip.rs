//! The same simulated IMU when it speaks MIP: its end of the dialogue and its data packets. RT: no.

use crate::base::time::Stamp;
use crate::sensor::imu_codec::{Kind, Reply};
use crate::sensor::mip::{ACKNOWLEDGE, Command, MAX_PACKET, Packet, field, packet, set};

/// Samples per second without decimation.
const BASE_RATE_HZ: u16 = 1000;
/// The device's clock was started on a Tuesday.
const WEEK_START_S: f64 = 200_000.0;
/// Codes of an acknowledge.
const OK: u8 = 0;
const UNKNOWN: u8 = 1;
const BAD_PARAMETER: u8 = 3;

/// What a command changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Order {
    /// Nothing.
    Nothing,
    /// It stops streaming.
    Stop,
    /// It measures this, at the base rate over the number.
    Format(Kind, u16),
    /// It streams.
    Stream,
}

/// Answers a packet of the host; `formatted`: it has been told what to stream.
pub(super) fn obey(heard: Packet<'_>, formatted: bool) -> (Order, Vec<u8>) {
    let mut order = Order::Nothing;
    let mut fields: Vec<(u8, Vec<u8>)> = Vec::new();
    for (descriptor, data) in heard.fields() {
        let is = |command: Command| command.descriptors() == (heard.set, descriptor);
        let mut code = OK;
        let mut more = None;
        if is(Command::Idle) {
            order = Order::Stop;
        } else if is(Command::Info) {
            more = Some((0x81, info()));
        } else if is(Command::BaseRate) {
            more = Some((0x83, BASE_RATE_HZ.to_be_bytes().to_vec()));
        } else if is(Command::Format { fields: [0; 3], decimation: 1 }) {
            match format(data) {
                Some((kind, decimation)) => order = Order::Format(kind, decimation),
                None => code = BAD_PARAMETER,
            }
        } else if is(Command::Stream) {
            if formatted && data == [1, 1, 1] { order = Order::Stream } else { code = BAD_PARAMETER }
        } else if !is(Command::Ping) {
            code = UNKNOWN;
        }
        fields.push((ACKNOWLEDGE, vec![descriptor, code]));
        fields.extend(more);
    }
    let parts: Vec<(u8, &[u8])> = fields.iter().map(|(descriptor, data)| (*descriptor, data.as_slice())).collect();
    (order, packet::<MAX_PACKET>(heard.set, &parts).as_slice().to_vec())
}

fn info() -> Vec<u8> {
    let names = ["simulated MIP", "0000-0000", "0000.00000", "0000", "5g, 300d/s"];
    let texts = names.iter().flat_map(|name| format!("{name:>16}").into_bytes());
    [0x04, 0x38].into_iter().chain(texts).collect()
}

/// Which message the wanted fields are, all at one decimation.
fn format(data: &[u8]) -> Option<(Kind, u16)> {
    let [1, 3, a, a0, a1, b, b0, b1, c, c0, c1] = *data else { return None };
    let decimation = u16::from_be_bytes([a0, a1]);
    let same = [a0, a1] == [b0, b1] && [b0, b1] == [c0, c1];
    let kind = match [a, b, c] {
        [field::EULER, field::RATE, field::TIME_OF_WEEK] => Kind::EulerRate,
        [field::ACCEL, field::RATE, field::TIME_OF_WEEK] => Kind::AccelRate,
        _ => return None,
    };
    (same && decimation > 0).then_some((kind, decimation))
}

/// A data packet with what the other protocol's reply holds.
pub(super) fn data(reply: &Reply, now: Stamp) -> Vec<u8> {
    let floats = |x: &[f32; 3]| x.iter().flat_map(|x| x.to_be_bytes()).collect::<Vec<u8>>();
    let (first, values, rate) = match reply {
        Reply::EulerRate { euler_rad, rate_rad_s, .. } => (field::EULER, floats(euler_rad), floats(rate_rad_s)),
        Reply::AccelRate { accel_g, rate_rad_s, .. } => (field::ACCEL, floats(accel_g), floats(rate_rad_s)),
        _ => return Vec::new(),
    };
    let time = [&(WEEK_START_S + now.as_s()).to_be_bytes()[..], &[0x08, 0xAE, 0, 7]].concat();
    let fields = [(first, &values[..]), (field::RATE, &rate[..]), (field::TIME_OF_WEEK, &time[..])];
    packet::<MAX_PACKET>(set::DATA, &fields).as_slice().to_vec()
}
