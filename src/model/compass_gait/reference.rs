//! Section 10 of our notes, to all printed digits, for both stances.

use super::params::{Elasticity, Params};
use super::{dynamics, elastic, floating, impact, kinematics};
use crate::model::energy;

const Q: [f64; 2] = [0.1, -0.2];
const V: [f64; 2] = [0.5, -1.0];
const TAU: f64 = 0.301_227_0;

/// Inner stance, outer stance.
fn both() -> [Params<f64>; 2] {
    [Params::sysid(), Params::sysid().swapped()]
}

/// Agreement to the printed digits: half a unit in the last place, and the rounding of the printed inputs.
#[track_caller]
fn agrees<const N: usize>(got: [f64; N], printed: [f64; N], last_place: f64) {
    for (g, p) in got.iter().zip(printed) {
        assert!((g - p).abs() <= 0.6 * last_place, "got {g:.12}, printed {p}");
    }
}

/// The torque of the table is 5 Nm exactly; .3012270 is its rounded print.
fn tau(p: &Params<f64>) -> f64 {
    5.0 / p.inertia_kg_m2()
}

#[test]
fn normalisation_is_as_printed() {
    let p = Params::sysid();
    agrees([p.inertia_kg_m2()], [16.598_78], 1e-5);
    agrees([p.w2()], [9.387_560], 1e-6);
    agrees([p.mass_moment_kg_m()], [15.884], 1e-3);
    agrees([30.0 / p.inertia_kg_m2()], [1.807_362], 1e-6);
    agrees([tau(&p)], [TAU], 1e-7);
    agrees([p.viscous_nm_s_rad, p.coulomb_nm], [0.694, 1.841], 1e-3);
}

#[test]
fn mass_matrix_is_as_printed() {
    let printed = [[0.880_783_219_2, -0.115_016_922_6, 0.1434], [0.900_883_219_2, -0.104_221_620_3, 0.1007]];
    for (p, want) in both().iter().zip(printed) {
        let h = dynamics::mass_matrix(&p.normalised(), Q);
        agrees([h[0][0], h[0][1], h[1][1]], want, 1e-10);
    }
}

#[test]
fn coriolis_and_gravity_are_as_printed() {
    let printed = [
        [[-0.037_450_888_9, 0.009_144_169_0], [-0.826_881_602_2, -0.233_298_807_7]],
        [[-0.034_111_510_6, 0.008_309_324_4], [-0.816_291_330_7, -0.212_224_079_2]],
    ];
    for (p, [c, g]) in both().iter().zip(printed) {
        let p = p.normalised();
        agrees(dynamics::coriolis_at(&p, &kinematics::Trig::new(Q), V), c, 1e-10);
        agrees(dynamics::gravity(&p, Q), g, 1e-10);
    }
}

#[test]
fn accelerations_are_as_printed() {
    let printed = [
        [[1.399_743_661_5, 0.585_229_355_3], [1.356_168_301_1, 1.760_878_561_3]],
        [[1.325_210_792_4, 0.405_197_747_7], [1.332_866_412_5, 2.137_053_568_3]],
    ];
    for (p, [free, rubbing]) in both().iter().zip(printed) {
        let n = p.normalised();
        agrees(dynamics::acceleration_without_friction(&n, Q, V, tau(p)), free, 1e-10);
        agrees(p.acceleration_rad_s2(Q, V, 5.0), rubbing, 1e-10);
    }
}

#[test]
fn energies_are_as_printed() {
    let printed = [[0.239_306_363_7, 7.200_124_817_6], [0.215_071_212_5, 7.198_540_246_9]];
    for (p, want) in both().iter().zip(printed) {
        let n = p.normalised();
        agrees([dynamics::kinetic(&n, Q, V), dynamics::potential(&n, Q)], want, 1e-10);
    }
}

#[test]
fn ground_force_is_as_printed() {
    let printed = [[-17.839_173, 145.383_615], [-17.004_787, 145.465_893]];
    for (p, want) in both().iter().zip(printed) {
        agrees(p.ground_force_n(Q, V, 5.0), want, 1e-6);
    }
}

#[test]
fn airborne_accelerations_are_as_printed() {
    let printed = [
        [3.167_128_7, -2.051_974_9, 3.001_417_0, -9.062_697_5],
        [2.079_559_4, -3.128_562_9, 2.110_460_8, -9.172_307_4],
    ];
    for (p, want) in both().iter().zip(printed) {
        agrees(floating::airborne(&p.normalised(), Q, V, tau(p)).unwrap(), want, 1e-7);
    }
}

#[test]
fn elastic_accelerations_are_as_printed() {
    let printed = [[1.381_175_8, 1.086_185_2, 13.937_839_0], [1.328_674_6, 1.188_772_9, 14.626_028_9]];
    for (p, want) in both().iter().zip(printed) {
        let n = p.normalised();
        let e = example(p);
        let legs = elastic::without_rotor(&n, e.rotor_inertia_kg_m2);
        agrees(elastic::acceleration_with(&legs, &e, &[Q[0], Q[1], 0.31, V[0], V[1], 1.4], tau(p), 0.0), want, 1e-7);
    }
}

/// The example of section 6: .09 kg m², 10.5 Hz, 2 %.
fn example(p: &Params<f64>) -> Elasticity<f64> {
    elastic::tuned(&p.normalised(), 0.09 / p.inertia_kg_m2(), 10.5, 0.02)
}

#[test]
fn elastic_example_is_as_printed() {
    let printed = [[22.703_131, 0.013_765_011], [22.327_712, 0.013_537_393]];
    for (p, [k, d]) in both().iter().zip(printed) {
        let e = example(p);
        agrees([e.stiffness_nm_rad], [k], 1e-6);
        agrees([e.damping_nm_s_rad], [d], 1e-9);
        agrees([e.rotor_inertia_kg_m2], [0.005_422_085], 1e-9);
    }
    agrees([example(&both()[0]).stiffness_nm_rad * both()[0].inertia_kg_m2()], [377.0], 1.0);
}

const Q_HIT: [f64; 2] = [-0.2, 0.2];
const V_HIT: [f64; 4] = [-1.0, -0.5, 0.0, 0.0];

/// Impact with restitution and friction, and energies before and after in J.
fn hit(p: &Params<f64>, restitution: f64, friction: f64) -> (impact::Impact<f64>, [f64; 2]) {
    let n = p.normalised();
    let hit = impact::touchdown(&n, Q_HIT, V_HIT, &impact::Ground { restitution, friction }).unwrap();
    let joule = |v| energy::kinetic(&n, Q_HIT, v) * p.inertia_kg_m2();
    (hit, [joule(V_HIT), joule(hit.velocity)])
}

#[test]
fn inelastic_impact_is_as_printed() {
    let rates = [[-0.795_653_429, -0.888_420_832], [-0.857_321_844, -0.908_026_922]];
    let toe_m_s = [[0.095_009_6, 0.349_629_7], [0.051_930_6, 0.366_503_1]];
    let impulse_n_s = [[-2.119_943_9, 5.730_067_1], [-1.860_217_2, 5.815_978_1]];
    let joules = [[6.687_755_8, 5.252_748_2], [6.852_357_5, 5.470_474_0]];
    for (i, p) in both().iter().enumerate() {
        let (hit, energies) = hit(p, 0.0, f64::INFINITY);
        let [vs, vw, vx, vy] = hit.velocity;
        agrees([vs, vw], rates[i], 1e-9);
        agrees([vx * p.leg_length_m, vy * p.leg_length_m], toe_m_s[i], 1e-7);
        agrees(hit.impulse.map(|x| x * p.mass_moment_kg_m()), impulse_n_s[i], 1e-7);
        agrees(energies, joules[i], 1e-7);
        assert!(!hit.slips);
    }
}

#[test]
fn elastic_impact_is_as_printed() {
    let printed = [([-0.767_562_3, -0.873_808_9], 5.280_657_5), ([-0.835_587_8, -0.893_396_9], 5.498_413_3)];
    for (p, (rates, after_j)) in both().iter().zip(printed) {
        let (hit, energies) = hit(p, 0.2, f64::INFINITY);
        agrees([hit.velocity[0], hit.velocity[1]], rates, 1e-7);
        agrees([energies[1]], [after_j], 1e-7);
    }
}

#[test]
fn slipping_impact_is_as_printed() {
    let printed = [
        ([-0.875_650_2, -0.310_609_1], 0.641_172_5, 5.798_809_8),
        ([-0.904_671_7, -0.238_073_1], 0.712_987_2, 5.992_313_5),
    ];
    for (p, (rates, new_toe_m_s, after_j)) in both().iter().zip(printed) {
        let (hit, energies) = hit(p, 0.0, 0.1);
        let [vs, vw, vx, _] = hit.velocity;
        let new_toe = kinematics::swing_toe_velocity(Q_HIT, [vs, vw])[0] + vx;
        assert!(hit.slips);
        agrees([vs, vw], rates, 1e-7);
        agrees([new_toe * p.leg_length_m], [new_toe_m_s], 1e-7);
        agrees([energies[1]], [after_j], 1e-7);
    }
}

#[test]
fn published_orbit_closes() {
    // .4 m, .4 m/s orbit: touchdown of either phase leads to the start of the other.
    let starts = [
        [0.192_575_6, -0.192_575_6, -0.740_705_6, -0.715_040_1],
        [0.192_575_6, -0.192_575_6, -0.647_701_1, -0.581_495_9],
    ];
    let ends = [
        [-0.192_575_6, 0.192_575_6, -0.735_412_1, 0.006_756_1],
        [-0.192_575_6, 0.192_575_6, -0.835_606_1, -2.553_994_5],
    ];
    for i in 0..2 {
        let after = impact::step(&both()[i].normalised(), &ends[i]).unwrap();
        agrees(after, starts[1 - i], 3e-7); // the printed inputs' rounding
    }
}
