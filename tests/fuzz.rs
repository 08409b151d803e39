//! The targets of `fuzz/` with the ordinary toolchain: seeded bytes, and every input that ever broke one.
#[path = "../fuzz/targets.rs"]
#[expect(clippy::unwrap_used, unreachable_pub, reason = "a test; the fuzzers name them")]
mod targets;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::fs;
use std::path::Path;
use targets::TARGETS;

/// Inputs per target; `COMPASS_FUZZ_INPUTS` for more.
fn inputs() -> u64 {
    std::env::var("COMPASS_FUZZ_INPUTS").ok().and_then(|text| text.parse().ok()).unwrap_or(2_000)
}

/// Bytes made of the beginnings: cut, repeated, joined, changed, or nothing but chance.
fn bytes(rng: &mut ChaCha8Rng, seeds: &[&[u8]]) -> Vec<u8> {
    let pick = |rng: &mut ChaCha8Rng, below: usize| (rng.next_u32() as usize) % below.max(1);
    let mut out = Vec::new();
    for _ in 0..=pick(rng, 8) {
        let seed = seeds[pick(rng, seeds.len())];
        match pick(rng, 4) {
            0 => out.extend(seed),
            1 => out.extend(&seed[..pick(rng, seed.len() + 1)]),
            2 => out.extend((0..pick(rng, 40)).map(|_| rng.next_u32() as u8)),
            _ => out.extend(std::iter::repeat_n([0, 0xFF, 0x75, 0xC2, b','][pick(rng, 5)], pick(rng, 20))),
        }
    }
    for _ in 0..pick(rng, 4) {
        let at = pick(rng, out.len());
        if let Some(byte) = out.get_mut(at) {
            *byte ^= 1 << pick(rng, 8);
        }
    }
    out
}

#[test]
fn no_parser_of_outside_bytes_panics_on_seeded_bytes() {
    for (number, (name, run, seeds)) in TARGETS.iter().enumerate() {
        let mut rng = ChaCha8Rng::seed_from_u64(number as u64);
        println!("{name}");
        for _ in 0..inputs() {
            run(&bytes(&mut rng, seeds));
        }
    }
}

#[test]
fn what_once_broke_a_parser_does_not_any_more() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/regressions");
    for folder in fs::read_dir(root).unwrap().map(|entry| entry.unwrap().path()).filter(|path| path.is_dir()) {
        let name = folder.file_name().unwrap().to_str().unwrap();
        let (_, run, _) = TARGETS.iter().find(|(target, ..)| *target == name).unwrap();
        for file in fs::read_dir(&folder).unwrap() {
            run(&fs::read(file.unwrap().path()).unwrap());
        }
    }
}
