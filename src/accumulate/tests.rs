use super::*;
use crate::config;

fn accumulator() -> Accumulator {
    Accumulator::new(&config::load(None, &[]).unwrap().config.robot)
}

fn sample(stamp: i64, pitch: f64) -> ImuSample {
    ImuSample {
        stamp: Stamp(stamp),
        euler_rad: [9.0, pitch, 9.0],
        rate_rad_s: [9.0, -pitch, 9.0],
        ..Default::default()
    }
}

fn batch(samples: &[ImuSample]) -> ImuBatch {
    let mut batch = ImuBatch::default();
    samples.iter().for_each(|s| assert!(batch.push(*s)));
    batch
}

fn silent_drives() -> DriveFeedbacks {
    let mut drives = DriveFeedbacks::default();
    drives.drives.iter_mut().for_each(|d| d.stamp = Stamp::NEVER);
    drives
}

#[test]
fn what_never_spoke_is_older_than_any_limit() {
    let operator = OperatorSample { stamp: Stamp::NEVER, ..Default::default() };
    let seen = accumulator().snapshot(Stamp(5), &silent_drives(), &ImuBatch::default(), &operator);
    let hour = Span::from_s(3600.0);
    assert!([seen.imu_age, seen.hip_age, seen.toe_age, seen.operator_age].iter().all(|age| *age > hour));
}

#[test]
fn the_newest_sample_stays_and_grows_old() {
    let mut room = accumulator();
    let operator = OperatorSample::default();
    room.snapshot(Stamp(100), &silent_drives(), &batch(&[sample(70, 0.1), sample(90, 0.2)]), &operator);
    let seen = room.snapshot(Stamp(200), &silent_drives(), &ImuBatch::default(), &operator);
    assert_eq!((seen.leg_angle_rad, seen.leg_rate_rad_s, seen.imu_age), (0.2, -0.2, Span(110)));
}

#[test]
fn a_stick_asks_only_with_fresh_news_of_a_held_switch_and_by_a_speed_that_it_can_say() {
    let asked = |stick: bool, age_ms: i64, dead_man: bool, speed_m_s: f64| {
        let keys =
            if stick { vec!["robot.operator.speed={ highest_m_s = 0.5, rate_m_s2 = 0.2 }".to_owned()] } else { vec![] };
        let mut room = Accumulator::new(&config::load(None, &keys).unwrap().config.robot);
        let now = Stamp(5_000_000_000);
        let stamp = if age_ms < 0 { Stamp::NEVER } else { now - Span::from_ms(age_ms) };
        let operator = OperatorSample { stamp, dead_man, speed_m_s, ..OperatorSample::default() };
        room.snapshot(now, &silent_drives(), &ImuBatch::default(), &operator).asked_m_s
    };
    assert!((asked(true, 100, true, 0.5) - 0.5).abs() < 1e-15);
    for (stick, age_ms, dead_man, speed_m_s) in [
        (false, 0, true, 0.5),
        (true, 101, true, 0.5),
        (true, -1, true, 0.5),
        (true, 0, false, 0.5),
        (true, 0, true, 0.501),
        (true, 0, true, -0.1),
        (true, 0, true, f64::NAN),
        (true, 0, true, f64::INFINITY),
    ] {
        let said = asked(stick, age_ms, dead_man, speed_m_s);
        assert_eq!(said.to_bits(), 0.0_f64.to_bits(), "{stick} {age_ms} {dead_man} {speed_m_s}");
    }
}

#[test]
fn one_silent_toe_makes_the_toes_old() {
    let mut drives = silent_drives();
    for (index, drive) in drives.drives.iter_mut().enumerate().filter(|(i, _)| *i != 3) {
        drive.stamp = Stamp(i64::try_from(index).unwrap());
    }
    let seen = accumulator().snapshot(Stamp(10), &drives, &ImuBatch::default(), &OperatorSample::default());
    assert_eq!((seen.hip_age, seen.toe_age), (Span(10), Span(i64::MAX)));
}

#[test]
fn drive_units_become_joint_units() {
    let mut drives = DriveFeedbacks::default();
    drives.drives[0].position_counts = 5_000;
    drives.drives[0].torque_permille = -1_000;
    drives.drives[2].position_counts = 6_000;
    let seen = accumulator().snapshot(Stamp(0), &drives, &ImuBatch::default(), &OperatorSample::default());
    assert!((seen.hip_angle_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-12, "a quarter of 20000 counts");
    assert!((seen.hip_torque_nm + 15.0).abs() < 1e-12, "0.5 Nm rated, 30:1");
    assert!((seen.toe_position_m[1] - 0.03).abs() < 1e-12, "200 counts per mm");
}
