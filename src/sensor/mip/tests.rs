use super::*;
use proptest::prelude::*;

fn hex(text: &str) -> Vec<u8> {
    let digits: Vec<u8> = text.bytes().filter(|c| !c.is_ascii_whitespace()).collect();
    digits.chunks(2).map(|pair| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap()).collect()
}

/// The data packet of docs/protocols.md: level, at rest.
fn level() -> Vec<u8> {
    hex("75 65 80 1C 0E 04 00000000 00000000 3F800000 0E 05 00000000 00000000 00000000 5A EE")
}

fn packets(parser: &mut Parser, bytes: &[u8]) -> Vec<(u8, Option<Measurement>)> {
    let mut out = Vec::new();
    bytes.iter().for_each(|byte| parser.push(*byte, |packet| out.push((packet.set, packet.measurement()))));
    out
}

#[test]
fn commands_are_those_of_the_reference() {
    assert_eq!(Command::Ping.packet().as_slice(), hex("75 65 01 02 02 01 E0 C6"));
    assert_eq!(Command::Idle.packet().as_slice(), hex("75 65 01 02 02 02 E1 C7"));
    let format = Command::Format { fields: [0x04, 0x05, 0x0A], decimation: 1 };
    assert_eq!(format.packet().as_slice(), hex("75 65 0C 0D 0D 08 01 03 04 00 01 05 00 01 0A 00 01 22 1D"));
    assert_eq!(Command::Stream.packet().as_slice(), hex("75 65 0C 05 05 11 01 01 01 04 1A"));
}

#[test]
fn answers_and_data_of_the_reference_are_read() {
    let bytes = hex("75 65 0C 04 04 F1 08 00 E7 BA");
    let packet = Packet::parse(&bytes).unwrap();
    let format = Command::Format { fields: [4, 5, 0x0A], decimation: 1 };
    assert_eq!(packet.acknowledges(format), Some(0));
    assert_eq!(packet.acknowledges(Command::Stream), None, "it is the answer to another command");
    let bytes = level();
    let measured = Packet::parse(&bytes).unwrap().measurement().unwrap();
    assert_eq!(measured.accel_g, Some([0.0, 0.0, 1.0]));
    assert_eq!(measured.rate_rad_s, Some([0.0; 3]));
    assert_eq!((measured.euler_rad, measured.time_s), (None, None));
}

#[test]
fn packets_are_refused_at_every_truncation() {
    let bytes = level();
    assert!((0..bytes.len()).all(|length| Packet::parse(&bytes[..length]).is_none()));
}

#[test]
fn the_next_packets_are_found_behind_a_lost_inserted_or_flipped_byte() {
    let good = level();
    for at in 0..good.len() {
        let mut lost = good.clone();
        lost.remove(at);
        let mut inserted = good.clone();
        inserted.insert(at, 0x75);
        let mut flipped = good.clone();
        flipped[at] ^= 0x10;
        for bad in [lost, inserted, flipped] {
            let mut parser = Parser::default();
            // A damaged length may ask for 255 bytes: eight more packets fill that.
            let stream = [bad, good.repeat(10)].concat();
            let got = packets(&mut parser, &stream);
            assert!(got.len() >= 10, "damage at {at}: {} packets", got.len());
            assert!(got.iter().all(|(set, _)| *set == set::DATA));
        }
    }
}

#[test]
fn a_field_with_an_impossible_length_ends_the_walk() {
    for length in [0, 1, 9, 255] {
        let mut bytes = vec![0x75, 0x65, 0x80, 4, length, 4, 0, 0];
        let sums = check(&bytes);
        bytes.extend(sums);
        assert!(Packet::parse(&bytes).unwrap().fields().count() <= 2, "{length}");
    }
}

proptest! {
    #[test]
    fn any_packet_survives_the_round_trip(set: u8, a in prop::collection::vec(any::<u8>(), 0..100), b in prop::collection::vec(any::<u8>(), 0..100)) {
        let bytes: Short<MAX_PACKET> = packet(set, &[(1, &a), (2, &b)]);
        let fields: Vec<(u8, Vec<u8>)> =
            Packet::parse(bytes.as_slice()).unwrap().fields().map(|(d, data)| (d, data.to_vec())).collect();
        prop_assert_eq!(fields, [(1, a), (2, b)]);
        let mut parser = Parser::default();
        prop_assert_eq!(packets(&mut parser, bytes.as_slice()).len(), 1);
    }

    #[test]
    fn random_bytes_never_panic_and_are_all_accounted_for(bytes in prop::collection::vec(prop_oneof![Just(0x75), Just(0x65), any::<u8>()], 0..1000)) {
        let mut parser = Parser::default();
        let mut found = 0;
        for byte in &bytes {
            parser.push(*byte, |packet| found += packet.payload.len() + 6);
        }
        prop_assert_eq!(found as u64 + parser.skipped + parser.waiting() as u64, bytes.len() as u64);
    }
}
