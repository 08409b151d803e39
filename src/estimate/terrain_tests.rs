//! Laws of the terrain zeroing filter, and of its bargain with the learner.

use super::*;
use crate::config::checked::Config;
use crate::config::load_text;
use crate::msg::{FloorVerdict, ImuSample, LidarState, TerrainState};

/// T of the filter, s.
const T: f64 = 2.0;

fn config(keys: &[&str]) -> Config {
    let ideal = ["robot.imu.latency_ms=0.0", "robot.lidar.zero_time_s=2.0", "control.attitude_time_s=0.5"];
    let keys: Vec<String> = ideal.iter().chain(keys).map(|k| (*k).to_owned()).collect();
    load_text("lidar.toml", include_str!("../../config/examples/lidar.toml"), &keys).unwrap().config
}

fn ms(k: i64) -> Stamp {
    Stamp(0) + Span::from_ms(k)
}

/// An ideal snapshot of legs at these angles, the IMU wrong by `error_rad`.
fn snapshot(now: Stamp, [inner, outer]: [f64; 2], error_rad: f64) -> Snapshot {
    let euler_rad = [0.0, inner + error_rad, 0.0];
    let imu = ImuSample { stamp: now, has_attitude: true, euler_rad, ..ImuSample::default() };
    Snapshot { stamp: now, imu, leg_angle_rad: inner + error_rad, hip_angle_rad: inner - outer, ..Snapshot::default() }
}

/// A line of the floor, 15 ms old, of a part that leant so then.
fn line(now: Stamp, lean_rad: f64) -> LidarSample {
    LidarSample {
        stamp: now - Span::from_ms(15),
        arrived: now,
        state: LidarState::Streaming,
        verdict: FloorVerdict::Found,
        lean_rad,
        lean_sigma_rad: 1e-3,
        height_m: 1.0,
        ..LidarSample::default()
    }
}

/// Ticks of a robot that stands upright while the IMU reads `error_rad` too much at a time and the lidar, every 25 ms,
/// sees a floor that falls by `slope_rad`; armed or not. What the estimator said last.
fn stand(
    estimator: &mut Estimator,
    ticks: std::ops::Range<i64>,
    armed: bool,
    error_rad: impl Fn(i64) -> f64,
    slope_rad: Option<f64>,
) -> (Estimate, Terrain) {
    let mut said = (Estimate::default(), Terrain::default());
    for k in ticks {
        let seen = snapshot(ms(k), [0.0; 2], error_rad(k));
        let word = slope_rad.filter(|_| k % 25 == 0).map_or_else(LidarSample::default, |lean| line(ms(k), lean));
        estimator.hear(ms(k), &word);
        let estimate =
            if armed { estimator.step(ms(k), &seen, &JointCommand::default()) } else { estimator.follow(ms(k), &seen) };
        said = (estimate, estimator.terrain(ms(k)));
    }
    said
}

#[test]
fn its_state_is_the_low_passed_difference_of_the_two_raw_readings() {
    let mut estimator = Estimator::new(&config(&["control.bias_time_s=0.0"])).unwrap();
    let error = |k: i64| if k < 4000 { 0.01 } else { 0.03 };
    // At first it is the mean of all lines: at once there, and the attitude is right while nobody is armed.
    let (estimate, terrain) = stand(&mut estimator, 0..4000, false, error, Some(0.0));
    assert_eq!(terrain.state, TerrainState::Following);
    assert!((terrain.zero_rad - 0.01).abs() < 1e-12 && estimate.theta_stance_rad.abs() < 1e-3, "{terrain:?}");
    // A step is followed with the time constant, the complementary filter of the attitude before it (.5 s).
    let (_, one) = stand(&mut estimator, 4000..4000 + 2000, false, error, Some(0.0));
    let (_, five) = stand(&mut estimator, 6000..4000 + 10_000, false, error, Some(0.0));
    let tau = config(&[]).control.attitude_time_s;
    let left = |t: f64| (T * (-t / T).exp() - tau * (-t / tau).exp()) / (T - tau);
    for (zero, t) in [(one.zero_rad, 2.0), (five.zero_rad, 10.0)] {
        let expected = 0.03 - 0.02 * left(t);
        assert!((zero - expected).abs() < 4e-4, "after {t} s {zero}, not {expected}");
    }
}

#[test]
fn the_slow_part_is_the_terrains_the_rest_the_learners_and_their_sum_is_one_number() {
    let drift = |k: i64| 0.012 + 1e-6 * k as f64;
    let sums = [None, Some(0.0), Some(0.008)].map(|slope| {
        let mut estimator = Estimator::new(&config(&["control.bias_time_s=0.3"])).unwrap();
        estimator.follow(ms(0), &snapshot(ms(0), [0.0; 2], drift(0)));
        let mut sums = Vec::new();
        for k in 1..12_000 {
            let (estimate, terrain) = stand(&mut estimator, k..k + 1, true, drift, slope);
            sums.push(estimate.attitude_bias_rad + terrain.zero_rad);
        }
        let (estimate, terrain) = stand(&mut estimator, 12_000..12_001, true, drift, slope);
        // A floor that falls: the part leans less against it, and the difference is all the filter can know.
        let by_floor = slope.map_or(0.0, |slope| drift(12_000) - slope);
        // A ramp is followed with its time constants: T of the filter, .5 s of the attitude.
        assert!((terrain.zero_rad - by_floor).abs() < 3e-6 * (1e3 * (T + 0.6)), "{slope:?}: {terrain:?}");
        let rest = drift(12_000) - terrain.zero_rad;
        assert!((estimate.attitude_bias_rad - rest).abs() < 2e-3 * 0.6 + 2e-4, "{slope:?}: {estimate:?}");
        sums
    });
    // With or without a lidar, on a level floor or a slope: the sum is what the balance of momentum wants.
    for k in 1000..sums[0].len() {
        let spread = sums.iter().map(|sum| (sum[k] - sums[0][k]).abs()).fold(0.0, f64::max);
        assert!(spread < 1e-4, "tick {k}: the sums are {spread} rad apart");
    }
}

#[test]
fn without_lines_the_last_correction_is_held_and_its_uncertainty_grows_by_the_drift() {
    let mut estimator = Estimator::new(&config(&["robot.lidar.drift_rad_sqrt_s=0.001"])).unwrap();
    let (_, before) = stand(&mut estimator, 0..3000, false, |_| 0.01, Some(0.0));
    let (_, after) = stand(&mut estimator, 3000..13_000, false, |_| 0.02, None);
    assert_eq!((after.state, after.zero_rad.to_bits()), (TerrainState::Holding, before.zero_rad.to_bits()));
    let grown = after.zero_sigma_rad.powi(2) - before.zero_sigma_rad.powi(2);
    assert!((grown.sqrt() - 1e-3 * 10.0_f64.sqrt()).abs() < 1e-5, "{before:?} {after:?}");
    // It comes back with its time constant, without a jump.
    let (_, back) = stand(&mut estimator, 13_000..13_100, false, |_| 0.02, Some(0.0));
    assert_eq!(back.state, TerrainState::Following);
    assert!((back.zero_rad - before.zero_rad).abs() < 2e-3 && back.zero_sigma_rad < after.zero_sigma_rad, "{back:?}");
}

#[test]
fn lines_are_compared_with_the_attitude_of_their_own_time() {
    let mut estimator = Estimator::new(&config(&["control.bias_time_s=0.0", "control.attitude_time_s=0.01"])).unwrap();
    let angle = |t: Stamp| 0.3 * (3.0 * t.as_s()).sin();
    let mut terrain = Terrain::default();
    for k in 0..8000 {
        let now = ms(k);
        let mut word = LidarSample::default();
        if k % 25 == 0 {
            word = line(now, 0.0);
            word.lean_rad = angle(word.stamp);
        }
        estimator.hear(now, &word);
        let mut seen = snapshot(now, [angle(now), 0.0], 0.01);
        seen.imu.rate_rad_s = [0.0, 0.9 * (3.0 * now.as_s()).cos(), 0.0];
        estimator.follow(now, &seen);
        terrain = estimator.terrain(now);
        if k > 100 {
            // 15 ms at .9 rad/s would be .013 rad.
            assert!((terrain.zero_rad - 0.01).abs() < 2e-4, "{k}: {terrain:?}");
        }
    }
    assert!(terrain.lines > 300 && terrain.refused <= 1, "{terrain:?}");
}

#[test]
fn a_lidar_on_the_body_sees_half_of_the_hip_angle() {
    let mut estimator = Estimator::new(&config(&["robot.lidar.mount=body", "control.bias_time_s=0.0"])).unwrap();
    let mut zero = 0.0;
    for k in 0..2000 {
        let word = if k % 25 == 0 { line(ms(k), 0.5 * (0.1 - 0.3)) } else { LidarSample::default() };
        estimator.hear(ms(k), &word);
        estimator.follow(ms(k), &snapshot(ms(k), [0.1, -0.3], 0.01));
        zero = estimator.terrain(ms(k)).zero_rad;
    }
    assert!((zero - 0.01).abs() < 1e-9, "{zero}");
}

#[test]
fn another_floor_is_refused_and_a_robot_without_a_lidar_says_nothing() {
    let mut estimator = Estimator::new(&config(&[])).unwrap();
    let (_, level) = stand(&mut estimator, 0..2000, false, |_| 0.0, Some(0.0));
    let (_, stairs) = stand(&mut estimator, 2000..4000, false, |_| 0.0, Some(0.3));
    assert_eq!(stairs.zero_rad.to_bits(), level.zero_rad.to_bits());
    assert!(stairs.refused - level.refused >= 79, "{stairs:?}");
    let mut without = Estimator::new(&crate::config::load(None, &[]).unwrap().config).unwrap();
    let (_, nothing) = stand(&mut without, 0..100, false, |_| 0.0, Some(0.2));
    assert_eq!(nothing, Terrain::default());
}
