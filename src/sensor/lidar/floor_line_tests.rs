//! Laws of the floor's line: exact, robust, honest about its uncertainty, refused where there is none.

use super::*;
use crate::config;
use proptest::prelude::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const UTM: Parameters = Parameters {
    nearest_mm: 23,
    farthest_mm: 60_000,
    steps_per_turn: 1440,
    first: 0,
    last: 1080,
    front: 540,
    turns_per_min: 2400,
};

fn settings() -> Lidar {
    let example = include_str!("../../../config/examples/lidar.toml");
    config::load_text("lidar.toml", example, &[]).unwrap().config.robot.lidar.unwrap()
}

struct Dice(ChaCha8Rng);

impl Dice {
    fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    fn uniform(&mut self) -> f64 {
        self.0.next_u64() as f64 / u64::MAX as f64
    }

    /// Twelve uniform ones: variance 1.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// A scan whose beams, by their angle from "down", have these distances; none is no return.
fn scan(distance_m: impl FnMut(f64) -> Option<f64>) -> Scan {
    let mut out = Scan { time_ms: 0, count: STEPS, distances_mm: [0; STEPS] };
    let angles = (0..1081).map(|step| UTM.angle_rad(step));
    for (slot, distance) in out.distances_mm.iter_mut().zip(angles.map(distance_m)) {
        *slot = distance.map_or(1, |m| (1e3 * m).round() as u32);
    }
    out
}

/// Distance to a level floor `height_m` below a part that leans by `lean_rad`.
fn floor(lean_rad: f64, height_m: f64) -> impl Fn(f64) -> Option<f64> {
    move |angle| {
        let down = (angle + lean_rad).cos();
        (down > 0.05).then(|| height_m / down)
    }
}

fn fit(scan: &Scan) -> FloorLine {
    Fitter::new(&settings()).fit(scan, &UTM)
}

#[test]
fn a_clean_floor_gives_lean_and_height_to_what_millimetres_allow() {
    for lean in [-0.4, -0.05, 0.0, 0.1, 0.4] {
        let found = fit(&scan(floor(lean, 1.05)));
        assert_eq!(found.verdict, FloorVerdict::Found);
        // Distances are whole millimetres: .3 mm of noise on 500 points over 4 m.
        assert!((found.lean_rad[0] - lean).abs() < 1e-4, "{lean}: {:?}", found.lean_rad);
        assert!((found.height_m[0] - 1.05).abs() < 2e-4, "{lean}: {:?}", found.height_m);
    }
}

#[test]
fn a_lidar_that_counts_the_other_way_or_is_turned_sees_the_same_floor() {
    let seen = scan(floor(0.1, 1.05));
    let mut mirrored = seen.clone();
    mirrored.distances_mm.reverse();
    let found = Fitter::new(&Lidar { sense: -1.0, ..settings() }).fit(&mirrored, &UTM);
    assert!((found.lean_rad[0] - 0.1).abs() < 1e-4, "{found:?}");
    let turned = scan(|angle| floor(0.1, 1.05)(angle - 0.7));
    let found = Fitter::new(&Lidar { down_rad: 0.7, ..settings() }).fit(&turned, &UTM);
    assert!((found.lean_rad[0] - 0.1).abs() < 1e-4, "{found:?}");
}

#[test]
fn errors_are_as_large_as_told_on_smooth_floors_and_on_tiles() {
    // (noise, half width of tiles): standardised errors of 200 floors each.
    for (noise_m, tile_m) in [(0.01, 0.0), (0.005, 0.01)] {
        let (mut squares, mut worst) = (0.0, 0.0_f64);
        for seed in 0..200 {
            let mut dice = Dice::new(seed);
            let tiles: Vec<f64> = (0..200).map(|_| tile_m * (2.0 * dice.uniform() - 1.0)).collect();
            let lean = 0.2 * dice.uniform() - 0.1;
            let noisy = scan(|angle| {
                let level = floor(lean, 1.05)(angle)?;
                let place = level * (angle + lean).sin();
                let tile = tiles[((place / 0.1).floor() + 100.0) as usize % 200];
                floor(lean, 1.05 - tile)(angle).map(|r| r + noise_m * dice.normal())
            });
            let found = fit(&noisy);
            assert_eq!(found.verdict, FloorVerdict::Found, "{noise_m} {tile_m} {seed}: {found:?}");
            let z = (found.lean_rad[0] - lean) / found.lean_rad[1];
            squares += z * z;
            worst = worst.max((found.lean_rad[0] - lean).abs());
        }
        let scale = (squares / 200.0).sqrt();
        println!("noise {noise_m} m, tiles ±{tile_m} m: {scale:.2} of what is told, worst {worst:.5} rad");
        assert!((0.6..1.6).contains(&scale), "{noise_m} {tile_m}: {scale}");
    }
}

#[test]
fn a_wall_a_box_and_lost_beams_do_not_move_the_line() {
    let mut dice = Dice::new(3);
    let cluttered = scan(|angle| {
        let level = floor(0.05, 1.05)(angle)?;
        // A wall .8 m ahead, a box .3 m high behind, one beam in ten lost.
        let wall = if angle + 0.05 > 0.0 { 0.8 / (angle + 0.05).sin() } else { f64::INFINITY };
        let on_box = angle < -0.65;
        let boxed = if on_box { floor(0.05, 0.75)(angle)? } else { f64::INFINITY };
        (dice.uniform() > 0.1).then(|| level.min(wall).min(boxed) + 0.005 * dice.normal())
    });
    let found = fit(&cluttered);
    assert_eq!(found.verdict, FloorVerdict::Found, "{found:?}");
    // Only .7 m behind and .8 m ahead are floor.
    assert!((found.lean_rad[0] - 0.05).abs() < 4.0 * found.lean_rad[1].max(0.002), "{found:?}");
}

#[test]
fn what_is_no_floor_is_refused_and_named() {
    assert_eq!(fit(&scan(|_| None)).verdict, FloorVerdict::TooFew);
    // A wall alone, nearer than any floor may be.
    assert_eq!(fit(&scan(floor(0.0, 0.4))).verdict, FloorVerdict::TooFew);
    // A slit through which a stretch of .3 m is seen.
    let slit = scan(|angle| floor(0.0, 1.05)(angle).filter(|_| angle.abs() < 0.14));
    assert_eq!(fit(&slit).verdict, FloorVerdict::TooFew);
    let mut dice = Dice::new(5);
    let rubble = scan(|angle| floor(0.0, 1.05)(angle).map(|r| r + 0.1 * (2.0 * dice.uniform() - 1.0)));
    assert_eq!(fit(&rubble).verdict, FloorVerdict::TooRough);
}

proptest! {
    #[test]
    fn no_scan_makes_it_panic_or_give_a_number_that_is_none(
        values in prop::collection::vec(0_u32..262_144, 0..STEPS), first in 0_u32..2000
    ) {
        let mut any = Scan { time_ms: 0, count: values.len(), distances_mm: [0; STEPS] };
        any.distances_mm.iter_mut().zip(&values).for_each(|(slot, value)| *slot = *value);
        let found = Fitter::new(&settings()).fit(&any, &Parameters { first, ..UTM });
        let numbers = [found.lean_rad, found.height_m].concat();
        prop_assert!(numbers.iter().all(|x| x.is_finite()) && found.roughness_m.is_finite());
    }
}
