//! The dialogue with a scanner that is put together from lines here; the simulated device behind the same reader, with
//! its faults: `sim`.

use super::*;
use crate::config;
use crate::sensor::scip::check;

fn reader() -> LidarReader {
    let example = include_str!("../../../config/examples/lidar.toml");
    LidarReader::new(&config::load_text("lidar.toml", example, &[]).unwrap().config.robot.lidar.unwrap())
}

fn line(text: &[u8]) -> Vec<u8> {
    [text, &[check(text)], b"\n"].concat()
}

fn at(ms: i64) -> Stamp {
    Stamp(0) + Span::from_ms(ms)
}

fn information(model: &[&str]) -> Vec<u8> {
    let lines = model.iter().map(|text| [text.as_bytes(), b";", &[check(text.as_bytes())], b"\n"].concat());
    lines.collect::<Vec<_>>().concat()
}

const UTM: [&str; 7] = ["DMIN:23", "DMAX:60000", "ARES:1440", "AMIN:0", "AMAX:1080", "AFRT:540", "SCAN:2400"];

/// Asks until a request is due, at most two seconds; the request and when.
fn next(reader: &mut LidarReader, from: i64, told: &mut Vec<LidarState>) -> (i64, &'static [u8]) {
    for ms in from..from + 2000 {
        if let Some(request) = reader.transmit(at(ms), |word| told.push(word.state)) {
            return (ms, request);
        }
    }
    panic!("nothing is asked");
}

/// Runs the dialogue with a device that answers all with yes and has these parameters, up to a request that begins so.
fn dialogue(reader: &mut LidarReader, until: &[u8], parameters: &[&str], told: &mut Vec<LidarState>) -> i64 {
    let mut ms = 0;
    for _ in 0..20 {
        let (asked, request) = next(reader, ms, told);
        ms = asked + 1;
        if request.starts_with(until) {
            return ms;
        }
        let text = request.strip_suffix(b"\n").unwrap();
        let lines = match text {
            b"PP" => information(parameters),
            b"TM1" => line(b"00D0"),
            _ => Vec::new(),
        };
        let reply = [text, b"\n", &line(b"00"), &lines, b"\n"].concat();
        reader.receive(at(ms), &reply, |word| told.push(word.state));
    }
    panic!("{until:?} is never asked");
}

#[test]
fn the_dialogue_asks_for_parameters_and_clock_before_the_stream() {
    let (mut reader, mut told) = (reader(), Vec::new());
    let ms = dialogue(&mut reader, b"MD", &UTM, &mut told);
    assert_eq!(told, [LidarState::Connecting]);
    assert_eq!(reader.parameters().front, 540);
    assert!(ms > 100 && reader.times.read.is_some(), "after the drain, with the clock read");
}

#[test]
fn silence_at_the_start_and_in_the_stream_asks_for_a_new_connection_once_each() {
    let (mut reader, mut told) = (reader(), Vec::new());
    next(&mut reader, 0, &mut told);
    for ms in 1..500 {
        reader.transmit(at(ms), |word| told.push(word.state));
    }
    assert_eq!(told, [LidarState::Connecting, LidarState::Silent]);
    assert!(reader.takes_new_connection() && !reader.takes_new_connection());
    let (mut reader, mut told) = (self::reader(), Vec::new());
    let ms = dialogue(&mut reader, b"MD", &UTM, &mut told);
    reader.receive(at(ms), &[b"MD0000108001000\n", &line(b"00")[..], b"\n"].concat(), |_| {});
    assert!((ms..ms + 140).all(|ms| reader.transmit(at(ms), |_| {}).is_none()) && !reader.takes_new_connection());
    reader.transmit(at(ms + 142), |word| told.push(word.state));
    assert_eq!(told.last(), Some(&LidarState::Silent));
    assert!(reader.takes_new_connection());
}

#[test]
fn every_status_instead_of_a_scan_is_named_and_asked_again_after_a_pause() {
    let expected = [
        (b"0E", LidarState::NotReady),
        (b"10", LidarState::LaserOff),
        (b"50", LidarState::Hardware),
        (b"97", LidarState::Hardware),
        (b"21", LidarState::Refused),
        (b"05", LidarState::Refused),
    ];
    for (status, state) in expected {
        let (mut reader, mut told) = (reader(), Vec::new());
        let ms = dialogue(&mut reader, b"MD", &UTM, &mut told);
        let refusal = [b"MD0000108001000\n", &line(status)[..], b"\n"].concat();
        let mut word = LidarSample::default();
        reader.receive(at(ms), &refusal, |newest| word = *newest);
        assert_eq!((word.state, word.status), (state, u16::from_be_bytes(*status)));
        assert_eq!(next(&mut reader, ms, &mut told), (ms + 200, &scip::QUIT[..]));
    }
}

#[test]
fn a_device_whose_scans_cannot_be_read_is_refused() {
    let (mut reader, mut told) = (reader(), Vec::new());
    let strange = ["DMIN:23", "DMAX:60000", "ARES:1440", "AMIN:0", "AMAX:5000", "AFRT:540", "SCAN:2400"];
    let ms = dialogue(&mut reader, b"PP", &strange, &mut told);
    reader.receive(at(ms), &[b"PP\n", &line(b"00")[..], &information(&strange), b"\n"].concat(), |word| {
        told.push(word.state);
    });
    assert_eq!(told, [LidarState::Connecting, LidarState::Refused]);
}
