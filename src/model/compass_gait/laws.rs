//! Laws that the equations must obey, whatever their form: section 7 of the house style, sections 3 to 6 of our notes.
//! Random states by a fixed-seed congruence, so that every run sees the same ones.

mod contact;

use super::params::{Link, Links, Normalised, Params};
use super::{dynamics, elastic, floating, impact, kinematics};
use crate::base::linalg::{add_scaled, dot, times};
use crate::base::scalar::{Dual, Scalar};
use crate::model::energy;

/// Numbers in -1..1, the same in every run.
struct Dice(u64);

impl Dice {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
    fn pair(&mut self, scale: f64) -> [f64; 2] {
        [self.next() * scale, self.next() * scale]
    }
}

fn both() -> [Normalised<f64>; 2] {
    [Params::sysid().normalised(), Params::sysid().swapped().normalised()]
}

/// A robot drawn by hand, so that sums over its three links are a second derivation.
fn drawn() -> Links<f64> {
    let link = |mass_kg, centre_m, inertia_kg_m2| Link { mass_kg, centre_m, inertia_kg_m2 };
    Links {
        links: [link(4.1, 0.43, 0.21), link(3.7, 0.39, 0.26), link(7.4, 0.13, 0.09)],
        leg_length_m: 1.045,
        gravity_m_s2: 9.81,
    }
}

/// Position and velocity of each link's centre, angle rate of each, in m, m/s: straight from the drawing.
fn centres(links: &Links<f64>, q: [f64; 2], v: [f64; 2], toe: [f64; 2]) -> [([f64; 2], [f64; 2], f64); 3] {
    let l = links.leg_length_m;
    let body = [(q[0] + q[1]) / 2.0, (v[0] + v[1]) / 2.0];
    let arms = [
        (q[0], v[0], -links.links[0].centre_m),
        (q[1], v[1], -links.links[1].centre_m),
        (body[0], body[1], links.links[2].centre_m),
    ];
    let direction = |a: f64| [-libm::sin(a), libm::cos(a)];
    let turn = |a: f64, rate: f64| [-libm::cos(a) * rate, -libm::sin(a) * rate];
    let (d, dd) = (direction(q[0]), turn(q[0], v[0]));
    arms.map(|(angle, rate, arm)| {
        let (e, ee) = (direction(angle), turn(angle, rate));
        let place = [l * d[0] + arm * e[0], l * d[1] + arm * e[1]];
        let speed = [toe[0] + l * dd[0] + arm * ee[0], toe[1] + l * dd[1] + arm * ee[1]];
        (place, speed, rate)
    })
}

#[test]
fn energy_and_momenta_are_the_sums_over_the_links() {
    let (links, mut dice) = (drawn(), Dice(1));
    let p = links.params();
    let (n, l) = (p.normalised(), p.leg_length_m);
    for _ in 0..50 {
        let (q, v, toe, about) = (dice.pair(1.0), dice.pair(3.0), dice.pair(1.0), dice.pair(0.5));
        let (mut kinetic, mut potential, mut linear, mut angular) = (0.0, 0.0, [0.0; 2], 0.0);
        for (link, (r, s, w)) in links.links.iter().zip(centres(&links, q, v, toe)) {
            let m = link.mass_kg;
            kinetic += 0.5 * m * dot(&s, &s) + 0.5 * link.inertia_kg_m2 * w * w;
            potential += m * links.gravity_m_s2 * r[1];
            linear = add_scaled(&linear, m, &s);
            let arm = [r[0] - about[0] * l, r[1] - about[1] * l];
            angular += m * (arm[0] * s[1] - arm[1] * s[0]) + link.inertia_kg_m2 * w;
        }
        let state = [v[0], v[1], toe[0] / l, toe[1] / l];
        let (unit, moment) = (p.inertia_kg_m2(), p.mass_moment_kg_m());
        let ours = energy::linear_momentum(&n, q, state);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12 * (1.0 + b.abs()), "{a} {b}"); // rounding
        near(energy::kinetic(&n, q, state) * unit, kinetic);
        near(energy::total(&n, q, 0.0, state) * unit, kinetic + potential);
        near(ours[0] * moment, linear[0]);
        near(ours[1] * moment, linear[1]);
        near(energy::angular_momentum(&n, q, state, about) * unit, angular);
    }
}

#[test]
fn identified_set_is_possible_and_calculated_set_is_not() {
    let least = Params::sysid().least_mass_shares();
    for (share, printed) in least.iter().zip([0.132, 0.112, 0.045]) {
        assert!((share - printed).abs() < 6e-4);
    }
    let calculated = Params { c: [0.0207, 0.1101, 0.0017, 0.1382, 0.0987, 0.0329], ..Params::sysid() };
    let least = calculated.least_mass_shares();
    assert!(least[0] > 1.0 && least[2] > 2.5);
    assert_eq!(Params::sysid().inconsistencies([0.3, 0.3, 0.4]), [false; 3]);
    assert_eq!(calculated.inconsistencies([0.3, 0.3, 0.4]), [true, false, true]);
}

#[test]
fn every_drawn_robot_is_consistent() {
    let links = drawn();
    let total: f64 = links.links.iter().map(|k| k.mass_kg).sum();
    let shares = links.links.map(|k| k.mass_kg / total);
    assert_eq!(links.params().inconsistencies(shares), [false; 3]);
}

#[test]
fn mass_matrix_is_symmetric_and_positive() {
    let mut dice = Dice(2);
    for p in both() {
        for _ in 0..200 {
            let (q, v) = (dice.pair(3.0), [dice.next(), dice.next(), dice.next(), dice.next()]);
            let h = dynamics::mass_matrix(&p, q);
            assert_eq!(h[0][1].to_bits(), h[1][0].to_bits());
            assert!(h[0][0] > 0.0 && h[0][0] * h[1][1] > h[0][1] * h[1][0]);
            let m = floating::mass_matrix(&p, q);
            for i in 0..4 {
                for j in 0..4 {
                    assert_eq!(m[i][j].to_bits(), m[j][i].to_bits());
                }
            }
            assert!(energy::kinetic(&p, q, v) > 0.0);
        }
    }
}

#[test]
fn coriolis_does_no_work_beside_the_changing_mass_matrix() {
    let mut dice = Dice(3);
    for p in both() {
        for _ in 0..100 {
            let (q, v) = (dice.pair(2.0), dice.pair(3.0));
            let along = [Dual::<1> { v: q[0], d: [v[0]] }, Dual { v: q[1], d: [v[1]] }];
            let h_dot = dynamics::mass_matrix(&lift(&p), along).map(|row| row.map(|x| x.d[0]));
            let power = dot(&v, &times(&h_dot, &v)) - 2.0 * dot(&v, &times(&dynamics::coriolis_matrix(&p, q, v), &v));
            assert!(power.abs() < 1e-13); // rounding
        }
    }
}

fn lift<S: Scalar>(p: &Normalised<f64>) -> Normalised<S> {
    Normalised {
        c: p.c.map(S::constant),
        w2: S::constant(p.w2),
        viscous: S::constant(p.viscous),
        coulomb: S::constant(p.coulomb),
    }
}

/// Second derivation: Lagrange's equations from T and U alone, second derivatives by duals of central differences.
#[test]
fn equations_of_motion_follow_from_the_energies() {
    let mut dice = Dice(4);
    for p in both() {
        for _ in 0..50 {
            let (q, v, a) = (dice.pair(1.5), dice.pair(2.0), dice.pair(5.0));
            let p_lift = lift::<Dual<2>>(&p);
            let momentum = |q: [f64; 2], v: [f64; 2]| {
                let rates = [Dual::variable(v[0], 0), Dual::variable(v[1], 1)];
                dynamics::kinetic(&p_lift, q.map(Dual::constant), rates).d
            };
            let h = 1e-5;
            let after = momentum(add_scaled(&q, h, &v), add_scaled(&v, h, &a));
            let before = momentum(add_scaled(&q, -h, &v), add_scaled(&v, -h, &a));
            let angles = [Dual::variable(q[0], 0), Dual::variable(q[1], 1)];
            let force =
                (dynamics::kinetic(&p_lift, angles, v.map(Dual::constant)) - dynamics::potential(&p_lift, angles)).d;
            let bias = dynamics::bias_at(&p, &kinematics::Trig::new(q), v);
            let inertia = times(&dynamics::mass_matrix(&p, q), &a);
            for i in 0..2 {
                let lagrange = (after[i] - before[i]) / (2.0 * h) - force[i];
                assert!((lagrange - inertia[i] - bias[i]).abs() < 1e-8); // central difference
            }
        }
    }
}

#[test]
fn gravity_is_the_slope_of_the_potential() {
    let mut dice = Dice(5);
    for p in both() {
        for _ in 0..50 {
            let q = dice.pair(2.0);
            let slope = dynamics::potential(&lift(&p), [Dual::<2>::variable(q[0], 0), Dual::variable(q[1], 1)]).d;
            let g = dynamics::gravity(&p, q);
            assert!((slope[0] - g[0]).abs() < 1e-14 && (slope[1] - g[1]).abs() < 1e-14);
        }
    }
}

#[test]
fn dual_derivatives_agree_with_differences() {
    let mut dice = Dice(6);
    for p in both() {
        for _ in 0..20 {
            let (q, v, tau) = (dice.pair(1.0), dice.pair(1.0), dice.next());
            let x = [q[0], q[1], v[0], v[1], tau];
            let smooth = Normalised { coulomb: 0.0, ..p };
            let mut duals = [Dual::<5>::default(); 5];
            for i in 0..5 {
                duals[i] = Dual::variable(x[i], i);
            }
            let exact = dynamics::derivative(&lift(&smooth), &[duals[0], duals[1], duals[2], duals[3]], duals[4]);
            for j in 0..5 {
                let h = 1e-6;
                let at = |s: f64| {
                    let mut y = x;
                    y[j] += s;
                    dynamics::derivative(&smooth, &[y[0], y[1], y[2], y[3]], y[4])
                };
                let (after, before) = (at(h), at(-h));
                for i in 0..4 {
                    let slope = (after[i] - before[i]) / (2.0 * h);
                    assert!((slope - exact[i].d[j]).abs() < 1e-7 * (1.0 + slope.abs())); // central difference
                }
            }
        }
    }
}

/// One classical Runge-Kutta step, local to these tests.
fn rk4<const N: usize>(x: [f64; N], h: f64, f: impl Fn(&[f64; N]) -> [f64; N]) -> [f64; N] {
    let k1 = f(&x);
    let k2 = f(&add_scaled(&x, h / 2.0, &k1));
    let k3 = f(&add_scaled(&x, h / 2.0, &k2));
    let k4 = f(&add_scaled(&x, h, &k3));
    let mut out = x;
    for i in 0..N {
        out[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
    }
    out
}

#[test]
fn frictionless_swing_keeps_its_energy() {
    for p in both() {
        let p = p.frictionless();
        let energy =
            |x: &[f64; 4]| dynamics::kinetic(&p, [x[0], x[1]], [x[2], x[3]]) + dynamics::potential(&p, [x[0], x[1]]);
        let mut x = [0.3, -0.5, 0.2, 1.0];
        let start = energy(&x);
        let mut largest = 0.0_f64;
        for _ in 0..2000 {
            x = rk4(x, 1e-3, |x| dynamics::derivative(&p, x, 0.0));
            largest = largest.max((energy(&x) - start).abs());
        }
        // Section 10: below 2e-10 after 2 s. On the way, upside down at 6 rad/s, it is up to 1.4e-9 for a moment.
        assert!((energy(&x) - start).abs() < 2e-10, "drift {:e}", energy(&x) - start);
        assert!(largest < 2e-9, "{largest:e}");
    }
}

#[test]
fn motor_and_friction_power_balance_the_energy() {
    // The accumulated work is one more state, so the balance holds to the integrator's error.
    for p in both() {
        let f = |x: &[f64; 5]| {
            let tau = 0.4 * libm::sin(3.0 * x[0]) + 0.1;
            let d = dynamics::derivative(&p, &[x[0], x[1], x[2], x[3]], tau);
            let r = x[2] - x[3];
            [d[0], d[1], d[2], d[3], (tau + dynamics::friction(&p, r)) * r]
        };
        let energy =
            |x: &[f64; 5]| dynamics::kinetic(&p, [x[0], x[1]], [x[2], x[3]]) + dynamics::potential(&p, [x[0], x[1]]);
        let mut x = [0.3, -0.5, 0.2, 1.0, 0.0];
        let start = energy(&x);
        for _ in 0..10_000 {
            x = rk4(x, 1e-4, f);
        }
        assert!((energy(&x) - start - x[4]).abs() < 1e-9, "{:e}", energy(&x) - start - x[4]);
        assert!(x[4].abs() > 1e-2, "the law must not be tested on nothing");
    }
}

#[test]
fn friction_never_gives_energy() {
    let p = both()[0];
    for r in [-3.0, -0.1, -1e-3, 1e-3, 0.1, 3.0] {
        assert!(dynamics::friction(&p, r) * r < 0.0);
        assert!(dynamics::stick_slip(&p, r, false, 0.0).torque() * r < 0.0);
    }
}

#[test]
fn smoothed_and_true_friction_agree_in_motion() {
    let p = both()[0];
    for r in [-2.0, -0.2, 0.2, 2.0] {
        let (smooth, exact) = (dynamics::friction(&p, r), dynamics::stick_slip(&p, r, false, 0.0).torque());
        assert!((smooth - exact).abs() < 1e-15);
    }
}

#[test]
fn locked_hip_does_not_accelerate_and_breaks_away_at_the_coulomb_level() {
    let mut dice = Dice(7);
    for p in both() {
        for _ in 0..50 {
            let (q, r) = (dice.pair(1.0), dice.next());
            let v = [r, r];
            let lock = dynamics::locking_torque(&p, q, v);
            let a = dynamics::acceleration_without_friction(&p, q, v, lock);
            assert!((a[0] - a[1]).abs() < 1e-12);
            let within = dynamics::stick_slip(&p, 0.0, true, 0.999 * p.coulomb);
            assert_eq!(within, dynamics::HipFriction::Stick(0.999 * p.coulomb));
            let beyond = dynamics::stick_slip(&p, 0.0, true, -1.001 * p.coulomb);
            assert_eq!(beyond, dynamics::HipFriction::Slip(-p.coulomb));
        }
    }
}

#[test]
fn holding_torque_keeps_an_equilibrium() {
    // Balanced postures: the sum of both gravity rows is zero, and the torque is the first of them.
    for p in both() {
        for swing in [-0.6, -0.2, 0.3] {
            let (mut low, mut high) = (-0.5, 0.5);
            for _ in 0..60 {
                let mid = 0.5 * (low + high);
                let g = dynamics::gravity(&p, [mid, swing]);
                if g[0] + g[1] > 0.0 { low = mid } else { high = mid }
            }
            let q = [low, swing];
            let a = dynamics::acceleration(&p, q, [0.0; 2], dynamics::gravity(&p, q)[0]);
            assert!(a[0].abs() < 1e-12 && a[1].abs() < 1e-12);
        }
    }
}

#[test]
fn mirrored_legs_move_mirrored() {
    let mut dice = Dice(8);
    for p in both() {
        let (q, v, tau) = (dice.pair(1.0), dice.pair(2.0), dice.next());
        let (mut x, mut y) = ([q[0], q[1], v[0], v[1]], [-q[0], -q[1], -v[0], -v[1]]);
        for _ in 0..300 {
            x = rk4(x, 1e-3, |x| dynamics::derivative(&p, x, tau));
            y = rk4(y, 1e-3, |x| dynamics::derivative(&p, x, -tau));
            for i in 0..4 {
                assert_eq!(x[i].to_bits(), (-y[i]).to_bits());
            }
        }
    }
}

#[test]
fn stiff_spring_meets_the_rigid_robot() {
    // Slowly forced from rest, the stiff elastic robot follows the rigid one; error falls with the stiffness.
    let p = both()[0];
    let (jr, tau) = (0.005_422_085, 0.2);
    let legs = elastic::without_rotor(&p.frictionless(), jr);
    let deviation = |stiffness_hz: f64| {
        let e = elastic::tuned(&p, jr, stiffness_hz, 0.7);
        let (mut x, mut y) = ([0.05, -0.1, 0.15, 0.0, 0.0, 0.0], [0.05, -0.1, 0.0, 0.0]);
        let h = 2e-5;
        for k in 0..15_000 {
            let push = tau * libm::sin(f64::from(k) * h * 6.0);
            x = rk4(x, h, |x| elastic::derivative(&legs, &e, x, push));
            y = rk4(y, h, |y| dynamics::derivative(&p.frictionless(), y, push));
        }
        (x[0] - y[0]).abs().max((x[1] - y[1]).abs())
    };
    let (soft, stiff) = (deviation(50.0), deviation(400.0));
    assert!(stiff < 2e-4 && stiff < soft / 20.0, "{soft:e} {stiff:e}");
}

#[test]
fn integrator_of_these_tests_shows_its_order() {
    let p = both()[0].frictionless();
    let run = |steps: i32| {
        let mut x = [0.3, -0.5, 0.2, 1.0];
        for _ in 0..steps {
            x = rk4(x, 0.5 / f64::from(steps), |x| dynamics::derivative(&p, x, 0.1));
        }
        x
    };
    let (coarse, fine, exact) = (run(25), run(50), run(1600));
    let error = |x: [f64; 4]| (x[1] - exact[1]).abs();
    assert!((error(coarse) / error(fine)).log2() > 3.7);
}

#[test]
fn massless_body_meets_the_two_link_robot() {
    // Textbook two-link compass gait (Goswami 1998): hip mass m_h at the body's place, legs of mass m at b below the hip.
    let (m, mh, a, b) = (5.0, 10.0, 0.5, 0.5);
    let leg = Link { mass_kg: m, centre_m: b, inertia_kg_m2: 0.0 };
    let body = Link { mass_kg: mh, centre_m: 0.0, inertia_kg_m2: 0.0 };
    let p = Links { links: [leg, leg, body], leg_length_m: a + b, gravity_m_s2: 9.81 }.params();
    let (q, l) = ([0.2, -0.35], a + b);
    let h = p.mass_matrix_kg_m2(q);
    let g = p.gravity_nm(q);
    let cross = -m * l * b * libm::cos(q[0] - q[1]);
    let want = [mh * l * l + m * (l * l + a * a), cross, m * b * b];
    for (got, want) in [h[0][0], h[0][1], h[1][1]].iter().zip(want) {
        assert!((got - want).abs() < 1e-12);
    }
    assert!((g[0] + (mh * l + m * a + m * l) * 9.81 * libm::sin(q[0])).abs() < 1e-12);
    assert!((g[1] - m * b * 9.81 * libm::sin(q[1])).abs() < 1e-12);
}
