use super::*;
use proptest::prelude::*;

fn line(text: &[u8]) -> Vec<u8> {
    [text, &[check(text)], b"\n"].concat()
}

fn encode(value: u32, characters: u32) -> Vec<u8> {
    (0..characters).rev().map(|k| (value >> (6 * k) & 0x3F) as u8 + 0x30).collect()
}

/// A scan of the stream as a UTM-30LX sends it.
fn scan_bytes(time_ms: u32, distances_mm: &[u32]) -> Vec<u8> {
    let mut out = b"MD0000108001000\n".to_vec();
    out.extend(line(b"99"));
    out.extend(line(&encode(time_ms, 4)));
    let data: Vec<u8> = distances_mm.iter().flat_map(|d| encode(*d, 3)).collect();
    data.chunks(64).for_each(|part| out.extend(line(part)));
    out.push(b'\n');
    out
}

fn replies(reader: &mut Reader, bytes: &[u8]) -> (Vec<Reply>, Vec<String>) {
    let mut lines = Vec::new();
    let mut each = |text: &[u8]| lines.push(String::from_utf8_lossy(text).into_owned());
    let out = bytes.iter().filter_map(|byte| reader.push(*byte, &mut each)).collect();
    (out, lines)
}

fn utm() -> Parameters {
    let mut parameters = Parameters::default();
    for text in ["DMIN:23", "DMAX:60000", "ARES:1440", "AMIN:0", "AMAX:1080", "AFRT:540", "SCAN:2400"] {
        assert!(parameters.take(text.as_bytes()));
    }
    parameters
}

#[test]
fn values_and_checks_are_those_of_the_reference() {
    for (text, value) in [("CB", 1234), ("1Dh", 5432), (">YP", 60_000), ("0?X", 1000)] {
        assert_eq!(decode(text.as_bytes()), Some(value));
        assert_eq!(encode(value, u32::try_from(text.len()).unwrap()), text.as_bytes());
    }
    let published = ["00P", "99b", "0Ee", "02R", "10Q", "01Q", "03S", "04T", "05U", "06V", "07W"];
    assert!(published.iter().all(|text| checked(text.as_bytes()).is_some()));
    let information = ["MODL:UTM-30LX-EW;I", "DMIN:23;7", "DMAX:60000;J", "ARES:1440;^", "AMIN:0;?", "AMAX:1080;Z"];
    assert!(information.iter().all(|text| checked(text.as_bytes()).is_some()));
    assert_eq!(checked(b"SCAN:2400;U"), Some(&b"SCAN:2400"[..]));
    assert_eq!(checked(b"SCAN:2401;U"), None);
}

#[test]
fn a_scanner_tells_its_angles_and_times() {
    let utm = utm();
    assert!(utm.is_sound());
    assert!((utm.angle_rad(540)).abs() < 1e-15 && (utm.angle_rad(0).to_degrees() + 135.0).abs() < 1e-9);
    assert_eq!(utm.delay(1440), Span::from_ms(25));
    assert_eq!((utm.distance_m(22), utm.distance_m(1500), utm.distance_m(60_001)), (None, Some(1.5), None));
    assert!(!Parameters { last: 5000, ..utm }.is_sound() && !Parameters::default().is_sound());
    assert!(!Parameters::default().take(b"DMIN:x"));
}

#[test]
fn a_stream_of_scans_is_read_in_pieces_of_any_size() {
    let distances: Vec<u32> = (0..1081).map(|k| 1000 + 53 * k).collect();
    let bytes = scan_bytes(0x00FF_FFF0, &distances);
    assert_eq!(bytes.len(), 16 + 4 + 6 + 3243 + 2 * 51 + 1, "as long as docs/protocols.md says");
    let mut reader = Reader::default();
    let acknowledge = [&STREAM[..], &line(b"00"), b"\n"].concat();
    assert_eq!(replies(&mut reader, &acknowledge).0, [Reply::Status(*b"00")]);
    for _ in 0..3 {
        assert_eq!(replies(&mut reader, &bytes).0, [Reply::Scan]);
        assert_eq!((reader.scan().count, reader.scan().time_ms), (1081, 0x00FF_FFF0));
        assert_eq!(reader.scan().distances_mm[..], distances[..]);
    }
}

#[test]
fn a_scan_of_any_time_is_read_also_of_one_that_ends_with_a_semicolon() {
    for time_ms in 0..128 {
        let mut reader = Reader::default();
        assert_eq!(replies(&mut reader, &scan_bytes(time_ms, &[1500; 30])).0, [Reply::Scan], "{time_ms}");
        assert_eq!(reader.scan().time_ms, time_ms);
    }
}

#[test]
fn information_and_refusals_are_told_apart() {
    let mut reader = Reader::default();
    let reply = [&PARAMETERS[..], &line(b"00"), b"DMIN:23;7\n", b"SCAN:2400;U\n", b"\n"].concat();
    let (got, lines) = replies(&mut reader, &reply);
    assert_eq!((got, lines), (vec![Reply::Lines], vec!["DMIN:23".to_owned(), "SCAN:2400".to_owned()]));
    for status in [b"0E", b"10", b"50"] {
        let reply = [&STREAM[..], &line(status), b"\n"].concat();
        assert_eq!(replies(&mut reader, &reply).0, [Reply::Status(*status)]);
    }
}

#[test]
fn a_damaged_scan_is_lost_and_the_next_one_is_not() {
    let good = scan_bytes(5, &[1500; 100]);
    for at in 0..good.len() {
        let mut damaged = good.clone();
        damaged[at] ^= 0x04;
        let mut reader = Reader::default();
        // A damaged line end joins lines, a made-up one ends the reply early: two good ones follow, one at least is whole.
        let (got, _) = replies(&mut reader, &[damaged, good.clone(), good.clone()].concat());
        assert_eq!(got.last(), Some(&Reply::Scan), "damage at {at}: {got:?}");
        assert!(reader.scan().distances_mm[..100].iter().all(|d| *d == 1500), "{at}");
    }
}

proptest! {
    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(prop_oneof![Just(b'\n'), Just(b'0'), any::<u8>()], 0..2000)) {
        let mut reader = Reader::default();
        replies(&mut reader, &bytes);
        prop_assert!(reader.scan().count <= STEPS);
    }
}
