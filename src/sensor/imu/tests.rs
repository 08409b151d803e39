//! The MIP dialogue, by bytes. What both protocols owe is tested with the simulated device.

use super::*;
use crate::config;
use crate::sensor::mip::{self, ACKNOWLEDGE, Command, MAX_PACKET, set};

fn reader(message: &str) -> ImuReader {
    let keys = ["robot.imu.protocol=mip".to_owned(), format!("robot.imu.message={message}")];
    ImuReader::new(&config::load(None, &keys).unwrap().config.robot.imu)
}

fn at_ms(ms: i64) -> Stamp {
    Stamp(ms * 1_000_000)
}

fn packet(set: u8, fields: &[(u8, &[u8])]) -> Vec<u8> {
    mip::packet::<MAX_PACKET>(set, fields).as_slice().to_vec()
}

fn acknowledge(command: Command, more: &[(u8, &[u8])]) -> Vec<u8> {
    let (set, descriptor) = command.descriptors();
    let yes = [descriptor, 0];
    packet(set, &[&[(ACKNOWLEDGE, &yes[..])], more].concat())
}

/// A reader whose device answered as it should.
fn streaming(message: &str) -> (ImuReader, ImuBatch, Vec<Vec<u8>>) {
    let (mut reader, mut batch, mut asked) = (reader(message), ImuBatch::default(), Vec::new());
    let mut info = vec![0, 7];
    info.extend(b"        3DM-CV5-AHRS");
    let format = Command::Format { fields: [0; 3], decimation: 1 };
    let answers = [
        (Command::Info, acknowledge(Command::Info, &[(0x81, &info)])),
        (Command::BaseRate, acknowledge(Command::BaseRate, &[(0x83, &[0x03, 0xE8])])),
        (format, acknowledge(format, &[])),
        (Command::Stream, acknowledge(Command::Stream, &[])),
    ];
    assert_eq!(reader.transmit(at_ms(0)).unwrap().as_slice(), Command::Idle.packet().as_slice());
    reader.receive(at_ms(50), &data(0.0, 1.0), &mut batch);
    for (i, (command, answer)) in answers.iter().enumerate() {
        let now = at_ms(120 + 10 * i64::try_from(i).unwrap());
        let request = reader.transmit(now).unwrap();
        let (set, descriptor) = command.descriptors();
        assert_eq!((request.as_slice()[2], request.as_slice()[5]), (set, descriptor));
        asked.push(request.as_slice().to_vec());
        reader.receive(now, answer, &mut batch);
    }
    assert!(reader.is_streaming() && batch.count == 0);
    (reader, batch, asked)
}

fn data(pitch: f32, time_s: f64) -> Vec<u8> {
    let floats = |x: [f32; 3]| x.iter().flat_map(|x| x.to_be_bytes()).collect::<Vec<u8>>();
    let time = [&time_s.to_be_bytes()[..], &[0, 1, 0, 7]].concat();
    packet(set::DATA, &[(0x0C, &floats([0.0, pitch, 0.0])), (0x05, &floats([0.0, 0.5, 0.0])), (0x12, &time)])
}

#[test]
fn start_up_asks_for_what_the_configuration_says() {
    let (reader, _, asked) = streaming("euler_rate");
    assert_eq!(reader.model(), b"        3DM-CV5-");
    // 1000 Hz over 2 is the 500 Hz of the configuration.
    assert_eq!(asked[2][4..], mip::Command::Format { fields: [0x0C, 5, 0x12], decimation: 2 }.packet().as_slice()[4..]);
    let (_, _, asked) = streaming("accel_rate");
    assert_eq!(asked[2][8], 0x04);
}

#[test]
fn data_become_samples_with_the_times_of_the_device() {
    let (mut reader, mut batch, _) = streaming("euler_rate");
    // A week ends between the second and the third.
    for (k, time_s) in [604_799.996, 604_799.998, 0.0, 0.002].into_iter().enumerate() {
        reader.receive(at_ms(200 + 2 * i64::try_from(k).unwrap()), &data(0.25, time_s), &mut batch);
    }
    let samples = batch.as_slice();
    assert_eq!((samples.len(), batch.dropped), (4, 0));
    assert!(
        samples
            .iter()
            .all(|s| s.has_attitude && (s.euler_rad[1] - 0.25).abs() < 1e-12 && (s.rate_rad_s[1] - 0.5).abs() < 1e-12)
    );
    for pair in samples.windows(2) {
        assert!((pair[1].stamp.since(pair[0].stamp).0 - 2_000_000).abs() < 2_000, "{pair:?}");
    }
    assert_eq!(samples[0].stamp, at_ms(200) - line_time(MIP_DATA_BYTES, 921_600));
}

#[test]
fn a_gap_and_a_damaged_packet_count_once_each() {
    let (mut reader, mut batch, _) = streaming("euler_rate");
    let mut damaged = data(0.1, 1.004);
    damaged[20] ^= 1;
    for (k, bytes) in [data(0.1, 1.0), data(0.1, 1.002), damaged, data(0.1, 1.006), data(0.1, 1.010)].iter().enumerate()
    {
        reader.receive(at_ms(200 + 2 * i64::try_from(k).unwrap()), bytes, &mut batch);
    }
    assert_eq!((batch.count, batch.dropped), (4, 2), "1.004 and 1.008");
}

#[test]
fn a_device_that_refuses_or_is_silent_is_asked_again_from_the_start() {
    let mut reader = reader("euler_rate");
    let mut batch = ImuBatch::default();
    for ms in 0..3_000 {
        if let Some(request) = reader.transmit(at_ms(ms))
            && request.as_slice()[2] == set::BASE
            && request.as_slice()[5] == 0x03
        {
            reader.receive(at_ms(ms), &packet(set::BASE, &[(ACKNOWLEDGE, &[0x03, 4])]), &mut batch);
        }
    }
    assert!(reader.counters().starts >= 5 && reader.counters().refused >= 5, "{:?}", reader.counters());
}

#[test]
fn a_silent_stream_starts_over() {
    let (mut reader, mut batch, _) = streaming("euler_rate");
    reader.receive(at_ms(200), &data(0.0, 1.0), &mut batch);
    assert_eq!(reader.transmit(at_ms(600)), None);
    assert!(reader.transmit(at_ms(701)).is_some() && !reader.is_streaming());
}
