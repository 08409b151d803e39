//! Laws of the world on the ground.

use super::*;
use crate::config::load;
use crate::sim::world::BlocksWorld;

const GROUND: &str = "sim.on_blocks=false";

fn config(keys: &[&str]) -> Config {
    let free = ["sim.release_torque_nm=0.0"];
    load(None, &free.iter().chain(keys).map(|k| (*k).to_owned()).collect::<Vec<_>>()).unwrap().config
}

fn world(keys: &[&str]) -> GroundWorld {
    GroundWorld::new(&config(keys)).unwrap()
}

/// Steps of 1 ms until `stop`, at most `ms`; says whether it did.
fn run(world: &mut GroundWorld, torque_nm: f64, ms: u32, mut stop: impl FnMut(&Reading) -> bool) -> bool {
    let toes = world.reading().toe_position_m;
    (0..ms).any(|_| {
        world.step(torque_nm, toes, Span::from_ms(1));
        stop(&world.reading())
    })
}

#[test]
fn machine_and_blocks_world_agree_on_both_legs() {
    for stance in ["sim.stance=inner", "sim.stance=outer"] {
        let config = config(&[stance, "sim.initial_angle_rad=[0.05, -0.1]"]);
        let (mut a, mut b) = (GroundWorld::new(&config).unwrap(), BlocksWorld::new(&config));
        for k in 0..500 {
            let torque = 8.0 * libm::sin(f64::from(k) * 0.02);
            a.step(torque, [0.01; 4], Span::from_ms(1));
            b.step(torque, [0.01; 4], Span::from_ms(1));
        }
        let (a, b) = (a.reading(), b.reading());
        for i in 0..2 {
            let gap = (a.leg_angle_rad[i] - b.leg_angle_rad[i]).abs();
            assert!(gap < 1e-4, "{stance}: {:?} {:?}", a.leg_angle_rad, b.leg_angle_rad);
            // The elastic hip rings: steps of both differ by some 1e-3 of 10 m/s^2.
            let gap = (a.imu_accel_m_s2[i] - b.imu_accel_m_s2[i]).abs();
            assert!(gap < 2e-2, "{stance}: {:?} {:?}", a.imu_accel_m_s2, b.imu_accel_m_s2);
        }
    }
}

#[test]
fn acceleration_of_the_hip_is_the_difference_of_its_velocity() {
    let l = config(&[]).robot.model.params().leg_length_m;
    let keys = [GROUND, "sim.initial_angle_rad=[0.1, -0.2]", "sim.initial_rate_rad_s=[-0.5, 0.6]"];
    let mut world = world(&keys);
    let velocity = |r: &Reading| {
        let (sin, cos) = libm::sincos(r.leg_angle_rad[0]);
        [-l * cos * r.leg_rate_rad_s[0], -l * sin * r.leg_rate_rad_s[0]]
    };
    run(&mut world, 3.0, 20, |_| false);
    let (before, toes) = (world.reading(), world.reading().toe_position_m);
    world.step(3.0, toes, Span::from_us(20));
    let after = world.reading();
    for i in 0..2 {
        let mean = 0.5 * (before.imu_accel_m_s2[i] + after.imu_accel_m_s2[i]);
        let slope = (velocity(&after)[i] - velocity(&before)[i]) / 2e-5;
        assert!((mean - slope).abs() < 1e-3, "{mean} {slope}");
    }
}

#[test]
fn falling_robot_lands_on_its_other_foot_and_the_springs_tell() {
    let keys = [GROUND, "sim.initial_angle_rad=[-0.05, 0.3]", "sim.initial_rate_rad_s=[-0.8, 0.0]"];
    let mut world = world(&keys);
    assert_eq!(world.reading().stance, Leg::Inner);
    assert!(run(&mut world, 0.0, 1500, |r| r.stance == Leg::Outer), "{:?}", world.reading());
    let mut most = 0.0_f64;
    run(&mut world, 0.0, 30, |r| {
        most = most.max(r.toe_spring_m[2]);
        assert!(r.toe_spring_m[0] <= 0.0, "the leg that left is not loaded");
        false
    });
    assert!((5e-4..0.02).contains(&most), "{most} m");
}

#[test]
fn shorter_swing_toe_lands_later() {
    let angle = |toe: &str| {
        let keys = [GROUND, "sim.initial_angle_rad=[-0.05, 0.3]", "sim.initial_rate_rad_s=[-0.8, 0.0]", toe];
        let mut world = world(&keys);
        assert!(run(&mut world, 0.0, 1500, |r| r.stance == Leg::Outer));
        world.reading().leg_angle_rad
    };
    let l = config(&[]).robot.model.params().leg_length_m;
    let (even, short) =
        (angle("sim.initial_toe_m=[0.03, 0.03, 0.03, 0.03]"), angle("sim.initial_toe_m=[0.03, 0.03, 0.01, 0.01]"));
    let drop = |[inner, outer]: [f64; 2], short: f64| l * libm::cos(inner) - (l - short) * libm::cos(outer);
    // Within a millisecond of falling: some 1 mm.
    assert!(drop(even, 0.0).abs() < 1.5e-3, "{}", drop(even, 0.0));
    assert!(drop(short, 0.02).abs() < 1.5e-3, "{}", drop(short, 0.02));
}

#[test]
fn restitution_makes_it_fly_and_come_back() {
    let keys = [
        GROUND,
        "sim.initial_angle_rad=[-0.05, 0.3]",
        "sim.initial_rate_rad_s=[-0.8, 0.0]",
        "sim.initial_toe_m=[0.03, 0.03, 0.03, 0.03]",
        "sim.restitution=0.4",
    ];
    let mut world = world(&keys);
    assert!(run(&mut world, 0.0, 1500, |r| r.airborne));
    assert!(run(&mut world, 0.0, 500, |r| !r.airborne));
}

#[test]
fn ground_pulls_only_if_lift_off_is_switched_off() {
    // A stance leg that turns at 6 rad/s would have to be held down: v²/l = 37 m/s² is far beyond gravity.
    let spin = [GROUND, "sim.initial_angle_rad=[0.0, 0.0]", "sim.initial_rate_rad_s=[-6.0, -6.0]"];
    let mut flying = world(&spin);
    assert!(run(&mut flying, 0.0, 5, |r| r.airborne));
    assert!(flying.reading().ground_force_n[1].abs() < 1e-9);
    let mut glued = world(&[&spin[..], &["sim.lift_off=false"]].concat());
    assert!(!run(&mut glued, 0.0, 5, |r| r.airborne) && glued.reading().ground_force_n[1] < -100.0);
}

#[test]
fn retracting_the_stance_toe_lowers_the_robot_and_keeps_its_foot() {
    let keys = [GROUND, "sim.initial_angle_rad=[0.0, 0.0]"];
    let mut world = world(&keys);
    let height = |w: &GroundWorld| w.machine.toe_m()[1];
    assert!(height(&world).abs() < 1e-12);
    for _ in 0..500 {
        world.step(0.0, [0.01; 4], Span::from_ms(1));
    }
    assert!((height(&world) + 0.02).abs() < 1e-6, "{}", height(&world));
    assert_eq!(world.reading().stance, Leg::Inner);
}

#[test]
fn a_fallen_robot_lies_still() {
    let mut world = world(&[GROUND, "sim.initial_angle_rad=[0.3, 0.4]", "sim.initial_rate_rad_s=[1.0, 1.0]"]);
    let rests = |r: &Reading| r.leg_rate_rad_s.iter().all(|v| v.abs() < 1e-12);
    assert!(run(&mut world, 0.0, 3000, rests), "{:?}", world.reading());
    let lying = world.reading();
    run(&mut world, 30.0, 1000, |_| false);
    assert_eq!(world.reading(), lying);
}
