//! Laws of the feet: held, in the air, sliding, hitting the ground.

use super::*;

#[test]
fn pinned_is_floating_with_the_foot_held() {
    let mut dice = Dice(9);
    for p in both() {
        for _ in 0..50 {
            let (q, v, tau) = (dice.pair(1.0), dice.pair(2.0), dice.next());
            let a = dynamics::acceleration_without_friction(&p, q, v, tau);
            let force = floating::ground_force(&p, q, v, a);
            // M [q̈; 0] = free force + [0; F]
            let got = times(&floating::mass_matrix(&p, q), &[a[0], a[1], 0.0, 0.0]);
            let free = floating::free_force(&p, q, v, tau);
            let want = [free[0], free[1], free[2] + force[0], free[3] + force[1]];
            for i in 0..4 {
                assert!((got[i] - want[i]).abs() < 1e-13);
            }
        }
    }
}

#[test]
fn flight_falls_like_a_stone_and_keeps_its_angular_momentum() {
    let mut dice = Dice(10);
    for p in both() {
        let (q, v, tau) = (dice.pair(0.5), dice.pair(2.0), dice.next());
        let f = |x: &[f64; 8]| {
            let a = floating::airborne(&p, [x[0], x[1]], [x[4], x[5]], tau).unwrap();
            [x[4], x[5], x[6], x[7], a[0], a[1], a[2], a[3]]
        };
        let centre_momentum = |x: &[f64; 8]| {
            let (q, v) = ([x[0], x[1]], [x[4], x[5], x[6], x[7]]);
            let com = centre_of_mass(&p, q);
            (energy::linear_momentum(&p, q, v), energy::angular_momentum(&p, q, v, com))
        };
        let mut x = [q[0], q[1], 0.0, 0.0, v[0], v[1], 0.4, 1.3];
        let (linear, angular) = centre_momentum(&x);
        for _ in 0..400 {
            x = rk4(x, 1e-3, f);
        }
        let (later, angular_later) = centre_momentum(&x);
        assert!((later[0] - linear[0]).abs() < 1e-11);
        assert!((later[1] - linear[1] + 0.4 * p.w2).abs() < 1e-11);
        assert!((angular_later - angular).abs() < 1e-10);
    }
}

/// Centre of mass seen from the stance toe: turning all by the momentum rows (p = J q̇ for rigid turning is ẑ × com).
fn centre_of_mass(p: &Normalised<f64>, q: [f64; 2]) -> [f64; 2] {
    let j = floating::momentum_rows(p, &kinematics::Trig::new(q));
    [j[1][0] + j[1][1], -(j[0][0] + j[0][1])]
}

#[test]
fn sliding_toe_is_decelerated_by_the_friction_of_its_load() {
    let mut dice = Dice(11);
    for p in both() {
        for sign in [-1.0, 1.0] {
            let (q, v, tau) = (dice.pair(0.3), dice.pair(1.0), 0.3 * dice.next());
            let s = floating::sliding(&p, q, v, tau, 0.4, sign).unwrap();
            let [a, b, c] = s.acceleration;
            let got = times(&floating::mass_matrix(&p, q), &[a, b, c, 0.0]);
            let free = floating::free_force(&p, q, v, tau);
            assert!((got[2] - free[2] + 0.4 * sign * s.normal_force).abs() < 1e-13);
            assert!((got[3] - free[3] - s.normal_force).abs() < 1e-13);
        }
    }
}

#[test]
fn without_friction_a_sliding_toe_feels_no_horizontal_force() {
    let p = both()[0];
    let s = floating::sliding(&p, [0.1, -0.3], [0.4, 0.2], 0.3, 0.0, 1.0).unwrap();
    let q_dot = [0.4, 0.2];
    let t = kinematics::Trig::new([0.1, -0.3]);
    let j = floating::momentum_rows(&p, &t);
    let change = dot(&j[0], &[s.acceleration[0], s.acceleration[1]]) + s.acceleration[2];
    assert!((change + floating::centripetal(&p, &t, q_dot)[0]).abs() < 1e-14);
}

#[test]
fn slip_starts_at_the_torque_of_the_notes() {
    // Upright at rest, μ = .3: 46.5 Nm.
    let p = Params::sysid();
    let needed = |torque_nm: f64| {
        let [fx, fy] = p.ground_force_n([0.0; 2], [0.0; 2], torque_nm);
        fx.abs() / fy
    };
    assert!(needed(46.4) < 0.3 && needed(46.6) > 0.3);
}

/// Touchdown postures and speeds, any of them.
fn impacts(seed: u64) -> impl Iterator<Item = (Normalised<f64>, [f64; 2], [f64; 4])> {
    let mut dice = Dice(seed);
    (0..200).map(move |i| {
        let (half, v, toe) = (0.1 + 0.25 * dice.next().abs(), dice.pair(2.0), dice.pair(0.3));
        let moving = if i % 2 == 0 { [0.0; 2] } else { toe };
        (both()[i / 2 % 2], [-half, half], [v[0], v[1], moving[0], moving[1]])
    })
}

#[test]
fn rigid_impact_stops_the_new_foot_and_acts_there_only() {
    for (p, q, v) in impacts(12) {
        let hit = impact::touchdown(&p, q, v, &impact::Ground::RIGID).unwrap();
        let a = impact::contact_rows(q);
        assert!(dot(&a[0], &hit.velocity).abs() < 1e-13 && dot(&a[1], &hit.velocity).abs() < 1e-13);
        let m = floating::mass_matrix(&p, q);
        let change = times(&m, &add_scaled(&hit.velocity, -1.0, &v));
        for i in 0..4 {
            assert!((change[i] - a[0][i] * hit.impulse[0] - a[1][i] * hit.impulse[1]).abs() < 1e-13);
        }
    }
}

#[test]
fn impact_keeps_angular_momentum_about_the_new_foot() {
    for (p, q, v) in impacts(13) {
        let ground = impact::Ground { restitution: 0.3, friction: 0.5 };
        let Some(hit) = impact::touchdown(&p, q, v, &ground) else { continue };
        let foot = kinematics::swing_toe(q);
        let before = energy::angular_momentum(&p, q, v, foot);
        assert!((energy::angular_momentum(&p, q, hit.velocity, foot) - before).abs() < 1e-13);
    }
}

#[test]
fn impact_loses_the_energy_of_the_velocity_change() {
    for (p, q, v) in impacts(14) {
        let hit = impact::touchdown(&p, q, v, &impact::Ground::RIGID).unwrap();
        let loss = energy::kinetic(&p, q, v) - energy::kinetic(&p, q, hit.velocity);
        let change = energy::kinetic(&p, q, add_scaled(&hit.velocity, -1.0, &v));
        assert!((loss - change).abs() < 1e-12 && loss >= 0.0);
    }
}

#[test]
fn restitution_reverses_the_normal_speed() {
    for (p, q, v) in impacts(15) {
        let ground = impact::Ground { restitution: 0.2, friction: f64::INFINITY };
        let hit = impact::touchdown(&p, q, v, &ground).unwrap();
        let a = impact::contact_rows(q);
        assert!((dot(&a[1], &hit.velocity) + 0.2 * dot(&a[1], &v)).abs() < 1e-13);
    }
}

#[test]
fn slipping_impact_stays_on_the_friction_cone() {
    let mut slipped = 0;
    for (p, q, v) in impacts(16) {
        let ground = impact::Ground { restitution: 0.0, friction: 0.15 };
        let approaching = dot(&impact::contact_rows(q)[1], &v) < 0.0;
        let Some(hit) = impact::touchdown(&p, q, v, &ground).filter(|_| approaching) else { continue };
        assert!(hit.impulse[0].abs() <= 0.15 * hit.impulse[1] * (1.0 + 1e-12));
        slipped += u32::from(hit.slips);
    }
    assert!(slipped > 20, "the law must not be tested on nothing");
}

#[test]
fn two_exchanges_are_none() {
    let x = [0.1, -0.2, 0.3, 0.4];
    assert_eq!(impact::exchange(&impact::exchange(&x)).map(f64::to_bits), x.map(f64::to_bits));
    assert_eq!(Params::sysid().swapped().swapped(), Params::sysid());
}

#[test]
fn old_toe_leaves_upward_at_gait_like_speeds() {
    let mut dice = Dice(17);
    for p in both() {
        for _ in 0..100 {
            let half = 0.19 + 0.05 * dice.next();
            let v = [-0.8 + 0.15 * dice.next(), -0.4 + 0.4 * dice.next(), 0.0, 0.0];
            let hit = impact::touchdown(&p, [-half, half], v, &impact::Ground::RIGID).unwrap();
            assert!(hit.velocity[3] >= 0.0);
        }
    }
}
