//! Steps and their cost counted on a robot that is moved by hand; agreement on made-up records.

use super::agreement::Agreement;
use super::effort::Effort;
use super::fall::Irregularity;
use super::footsteps::Footsteps;
use crate::base::time::Span;
use crate::config::load;
use crate::msg::{Leg, Mode, TickRecord};
use crate::sim::Reading;

fn standing(angles: [f64; 2], stance: Leg) -> Reading {
    Reading {
        leg_angle_rad: angles,
        leg_rate_rad_s: [0.0; 2],
        imu_accel_m_s2: [0.0; 2],
        hip_encoder_rad: angles[0] - angles[1],
        toe_position_m: [0.03; 4],
        toe_spring_m: [0.0; 4],
        ground_force_n: [0.0, 170.0],
        stance,
        airborne: false,
        slides: false,
    }
}

#[test]
fn distance_is_the_sum_of_the_strides_and_speed_leaves_the_first_out() {
    let config = load(None, &[]).unwrap().config;
    let leg_m = config.body().leg_length_m.value;
    let mut feet = Footsteps::new(&config);
    // The swing leg lands ahead: +.2 rad; the leg behind stands at -.2 rad then.
    assert!(feet.look(0.0, &standing([0.0, 0.0], Leg::Inner), false).is_none());
    for k in 0..5_u32 {
        let (stance, angles) = if k % 2 == 0 { (Leg::Outer, [-0.2, 0.2]) } else { (Leg::Inner, [0.2, -0.2]) };
        let step = feet.look(f64::from(k) * 0.5, &standing(angles, stance), false).unwrap();
        assert!((step.stride_m - 2.0 * leg_m * libm::sin(0.2)).abs() < 1e-12);
    }
    assert!(feet.look(3.0, &standing([0.2, -0.2], Leg::Inner), true).is_none(), "it rocks at rest");
    assert_eq!(feet.steps(), 5);
    let stride_m = 2.0 * leg_m * libm::sin(0.2);
    assert!((feet.distance_m() - 5.0 * stride_m).abs() < 1e-12);
    assert!((feet.mean_speed_m_s().unwrap() - stride_m / 0.5).abs() < 1e-12);
}

#[test]
fn only_positive_work_is_counted_and_divided_by_weight_and_distance() {
    let config = load(None, &[]).unwrap().config;
    let body = config.body().params();
    let mut effort = Effort::new(&config);
    let turning = |rate: f64| Reading { leg_rate_rad_s: [rate, 0.0], ..standing([0.0; 2], Leg::Inner) };
    effort.look(0.0, &turning(0.0), 0.0);
    effort.step();
    effort.look(0.5, &turning(2.0), 10.0);
    effort.look(1.0, &turning(-2.0), 10.0);
    // The stance toe lifts 10 mm under 170 N, and comes back.
    let lifted = Reading { toe_position_m: [0.04, 0.03, 0.03, 0.03], ..turning(0.0) };
    effort.look(1.5, &lifted, 0.0);
    effort.look(2.0, &turning(0.0), 0.0);
    effort.step();
    let [hip_j, toe_j] = effort.work_j();
    assert!((hip_j - 10.0).abs() < 1e-12 && (toe_j - 1.7).abs() < 1e-12, "{hip_j} {toe_j}");
    let expected = 11.7 / (body.total_mass_kg * body.gravity_m_s2 * 2.0);
    assert!((effort.cost_of_transport(2.0).unwrap() - expected).abs() < 1e-12);
}

/// Ticks of a ms: true stance, believed stance, torque. What was found, and the counters.
fn agreement(ticks: &[(Leg, Leg, f64)]) -> (Vec<Irregularity>, Agreement) {
    let mut agreement = Agreement::new(Span::from_ms(1));
    let mut found = Vec::new();
    let mut record = Box::<TickRecord>::default();
    record.status.mode = Mode::Armed;
    for (k, (truth, believed, torque_nm)) in ticks.iter().enumerate() {
        record.estimate.stance = *believed;
        record.allowed.hip_torque_nm = *torque_nm;
        found.extend(agreement.look(1e-3 * k as f64, &record, *truth).into_iter().map(|(_, what)| what));
    }
    (found, agreement)
}

fn ticks(n: usize, truth: Leg, believed: Leg, torque_nm: f64) -> Vec<(Leg, Leg, f64)> {
    vec![(truth, believed, torque_nm); n]
}

#[test]
fn a_touchdown_seen_some_milliseconds_late_or_early_is_seen() {
    let (inner, outer) = (Leg::Inner, Leg::Outer);
    let late = [ticks(50, inner, inner, 9.0), ticks(5, outer, inner, 9.0), ticks(200, outer, outer, 9.0)].concat();
    let early = [ticks(50, inner, inner, 9.0), ticks(5, inner, outer, 9.0), ticks(200, outer, outer, 9.0)].concat();
    for walk in [late, early] {
        let (found, a) = agreement(&walk);
        assert!(found.is_empty(), "{found:?}");
        assert_eq!((a.missed(), a.invented(), a.wrong_ticks()), (0, 0, 5));
        assert!((a.longest_wrong_torque_s() - 5e-3).abs() < 1e-12);
    }
}

#[test]
fn missed_and_invented_touchdowns_and_torque_on_the_wrong_leg_are_found() {
    let (inner, outer) = (Leg::Inner, Leg::Outer);
    let (found, a) = agreement(&[ticks(50, inner, inner, 9.0), ticks(100, outer, inner, 9.0)].concat());
    assert_eq!(found, [Irregularity::WrongStance, Irregularity::MissedTouchdown]);
    assert_eq!((a.missed(), a.invented()), (1, 0));
    let (found, a) = agreement(&[ticks(50, inner, inner, 0.0), ticks(100, inner, outer, 0.0)].concat());
    assert_eq!(found, [Irregularity::InventedTouchdown]);
    assert!(a.longest_wrong_torque_s() < 1e-12, "no torque, no harm");
}
