//! Laws of the IMU's bytes.

use super::*;
use proptest::prelude::*;

fn hex(text: &str) -> Vec<u8> {
    let digits: Vec<u8> = text.bytes().filter(|c| !c.is_ascii_whitespace()).collect();
    digits.chunks(2).map(|pair| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap()).collect()
}

fn standing() -> Reply {
    Reply::AccelRate { accel_g: [0.0, 0.0, -1.0], rate_rad_s: [0.0; 3], ticks: 62_500 }
}

fn run(parser: &mut Parser, bytes: &[u8]) -> Vec<Reply> {
    bytes.iter().filter_map(|b| parser.push(*b)).collect()
}

#[test]
fn vectors_of_the_reference_read_and_write() {
    let standing_bytes = hex("C2 00000000 00000000 BF800000 00000000 00000000 00000000 0000F424 0319");
    assert_eq!(Reply::parse(&standing_bytes), Some(standing()));
    assert_eq!(standing().emit().as_slice(), standing_bytes);
    let set = Reply::SetContinuous { kind: 0xC2, ticks: 62_500 };
    assert_eq!(set.emit().as_slice(), hex("C4 C2 00 00 F4 24 02 9E"));
    assert_eq!(Reply::Mode(2).emit().as_slice(), hex("D4 02 00 D6"));
    assert_eq!(Request::StopContinuous.emit().as_slice(), hex("FA 75 B4"));
    assert_eq!(Request::SetContinuous(Kind::AccelRate).emit().as_slice(), hex("C4 C1 29 C2"));
}

#[test]
fn sampling_request_has_twenty_bytes_and_its_reply_nineteen() {
    let sampling = Sampling { decimation: 2, ..Sampling::default() };
    let request = Request::SetSampling(sampling).emit();
    assert_eq!(request.as_slice(), hex("DB A8 B9 01 0002 0003 0F 11 000A 000A 00 0000000000"));
    assert_eq!(Request::parse(request.as_slice()), Found::Request(Request::SetSampling(sampling), 20));
    assert_eq!(Reply::Sampling(sampling).emit().as_slice().len(), 19);
}

#[test]
fn replies_are_refused_at_every_truncation() {
    let bytes = standing().emit();
    for len in 0..bytes.as_slice().len() {
        assert_eq!(Reply::parse(&bytes.as_slice()[..len]), None);
    }
}

#[test]
fn parser_finds_the_next_message_after_a_lost_inserted_or_flipped_byte() {
    let good = standing().emit().as_slice().to_vec();
    for at in 0..good.len() {
        let mut lost = good.clone();
        lost.remove(at);
        let mut inserted = good.clone();
        inserted.insert(at, 0xC2);
        let mut flipped = good.clone();
        flipped[at] ^= 0x10;
        for bad in [lost, inserted, flipped] {
            let mut parser = Parser::new(&[Kind::AccelRate]);
            let stream = [bad, good.clone(), good.clone()].concat();
            let got = run(&mut parser, &stream);
            assert!(got.len() >= 2, "damage at {at}: {} messages", got.len());
            assert!(got.iter().all(|r| *r == standing()));
        }
    }
}

#[test]
fn failures_are_counted() {
    let mut bytes = standing().emit().as_slice().to_vec();
    bytes[5] ^= 1;
    let mut parser = Parser::new(&[Kind::AccelRate]);
    assert!(run(&mut parser, &bytes).is_empty());
    assert_eq!((parser.failures, parser.skipped), (1, 31));
}

#[test]
fn requests_in_pieces_are_waited_for() {
    for request in [
        Request::StopContinuous,
        Request::Identity(1),
        Request::SetSampling(Sampling::default()),
        Request::SetContinuous(Kind::EulerRate),
        Request::Mode(0),
    ] {
        let bytes = request.emit();
        for len in 0..bytes.as_slice().len() {
            assert_eq!(Request::parse(&bytes.as_slice()[..len]), Found::Incomplete, "{request:?} cut at {len}");
        }
        assert_eq!(Request::parse(bytes.as_slice()), Found::Request(request, bytes.as_slice().len()));
    }
}

proptest! {
    #[test]
    fn replies_survive_the_round_trip_and_the_parser(a in any::<[f32; 3]>(), b in any::<[f32; 3]>(), ticks: u32, text: [u8; 16], selector: u8) {
        let all = [
            Reply::AccelRate { accel_g: a, rate_rad_s: b, ticks },
            Reply::EulerRate { euler_rad: a, rate_rad_s: b, ticks },
            Reply::Euler { euler_rad: a, ticks },
            Reply::AccelRateMatrix { accel_g: a, rate_rad_s: b, matrix: [a[0]; 9], ticks },
            Reply::Identity { selector, text },
        ];
        for reply in all {
            let bytes = reply.emit();
            // Bytes, not values: a NaN is not equal to itself.
            prop_assert_eq!(Reply::parse(bytes.as_slice()).map(|r| r.emit()), Some(bytes));
            let mut parser = Parser::new(&Kind::ALL);
            prop_assert_eq!(run(&mut parser, bytes.as_slice()).len(), 1);
        }
    }

    #[test]
    fn random_bytes_never_panic_and_are_all_accounted_for(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let mut parser = Parser::new(&Kind::ALL);
        let found: usize = run(&mut parser, &bytes).iter().map(|r| r.kind().reply_bytes()).sum();
        prop_assert_eq!(found as u64 + parser.skipped + parser.count as u64, bytes.len() as u64);
        if let Found::Request(request, len) = Request::parse(&bytes) {
            prop_assert!(len <= bytes.len());
            prop_assert_eq!(request.emit().as_slice().len(), len);
        }
    }
}
