//! The generator's machines against MuJoCo 4.0.0: a third derivation of the same equations, by other people.
//!
//! The numbers come from `tests/oracle/generator.py` (RK4 at 50 us; half the step gives the same seven decimals); they
//! stand here so that the comparison needs no Python. What c3 and c6 do is held against the reference accelerations of
//! the model notes in `rig`. RT: no.

use super::chain::Pair;
use super::machine::Machine;
use super::rig::{Kind, Rig};

/// Coordinates and rates after 0.5, 1.0, 1.5 and 2.0 s.
type Motion = [[f64; 4]; 4];

const DOUBLE_PENDULUM: Motion = [
    [-0.390_769_0, -0.077_736_6, -1.361_266_4, -4.708_850_5],
    [-0.190_780_6, 0.439_100_2, 1.100_246_9, 5.062_989_5],
    [0.345_555_3, 0.321_517_3, -4.183_808_3, 5.991_695_4],
    [-0.461_269_6, -0.541_892_9, -1.486_391_4, 4.068_611_4],
];

const COMPASS_GAIT: Motion = [
    [0.142_491_6, -0.254_125_9, -0.060_957_4, 0.627_778_7],
    [0.046_434_7, 0.019_068_8, -0.311_970_8, 0.824_871_9],
    [-0.116_094_8, 0.164_477_5, -0.270_665_8, 0.292_615_7],
    [-0.153_992_8, 0.094_984_0, 0.138_723_5, 0.075_901_1],
];

/// Torque that changes its sign this often, s.
fn square(t: f64, height: f64, half_s: f64) -> f64 {
    if libm::fmod(t + 1e-9, 2.0 * half_s) < half_s { height } else { -height }
}

/// Largest difference to `expected`, coordinates in rad and rates in rad/s.
fn worst(machine: &Machine, q: Pair, v: Pair, torque: impl Fn(f64) -> Pair, expected: &Motion) -> [f64; 2] {
    let (h, mut state, mut worst) = (machine.step_s(), machine.start(q, v), [0.0_f64; 2]);
    let mut step = 0;
    for (half, row) in expected.iter().enumerate() {
        while (f64::from(step) + 0.5) * h < 0.5 * (half as f64 + 1.0) {
            let t = f64::from(step) * h;
            machine.step(&mut state, torque(t), t, h);
            step += 1;
        }
        let now = [state.q()[0], state.q()[1], state.v()[0], state.v()[1]];
        for (i, (a, b)) in now.iter().zip(row).enumerate() {
            worst[i / 2] = worst[i / 2].max((a - b).abs());
        }
    }
    worst
}

fn rig(kind: Kind, values: &[(&str, f64)], joints: Vec<(&'static str, &'static str, f64)>, spring: Pair) -> Rig {
    let values = values.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    Rig {
        kind,
        values,
        uncertain: Vec::new(),
        joints,
        sensors: Vec::new(),
        spring,
        window_s: 1.0,
        setup: "inner_stance",
    }
}

#[test]
fn double_pendulum_moves_as_in_mujoco() {
    let values = [
        ("inertia1_kg_m2", 0.031),
        ("inertia2_kg_m2", 0.016),
        ("moment1_kg_m", 0.12),
        ("moment2_kg_m", 0.075),
        ("mass2_kg", 0.5),
        ("length1_m", 0.3),
        ("viscous@q1", 0.012),
        ("viscous@q2", 0.006),
    ];
    let machine = rig(Kind::Double, &values, vec![("q1", "a", 1.0), ("q2", "b", 1.0)], [0.0; 2]).machine(0.0);
    let torque = |t| [square(t, 0.4, 0.25), square(t, 0.15, 0.125)];
    let worst = worst(&machine, [0.8, -0.5], [0.0; 2], torque, &DOUBLE_PENDULUM);
    // An eighth of the encoder noise of a trial (0.8 mrad) after two seconds of swinging through.
    assert!(worst[0] < 1e-4 && worst[1] < 2e-3, "{worst:?}");
}

#[test]
fn pinned_compass_gait_moves_as_in_mujoco() {
    let values = [
        ("leg_length_m", 1.045),
        ("total_mass_kg", 15.2),
        ("gravity_m_s2", 9.81),
        ("c1", 0.09),
        ("c2", 0.14),
        ("c3", 0.0),
        ("c4", 0.115),
        ("c5", 0.126),
        ("c6", 0.0),
        ("viscous@hip", 0.7),
    ];
    let machine = rig(Kind::Biped, &values, vec![("hip", "u", 1.0)], [220.0, 0.0]).machine(0.0);
    let torque = |t| [square(t, 5.0, 0.25), 0.0];
    let worst = worst(&machine, [0.1, -0.2], [0.2, -0.3], torque, &COMPASS_GAIT);
    assert!(worst[0] < 2e-5 && worst[1] < 2e-4, "{worst:?}");
}
