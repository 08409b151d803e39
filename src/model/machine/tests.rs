//! Laws of the stepping machine.
use super::*;
use crate::base::scalar::Dual;
use crate::model::effect::{EffectKind, Role};
use crate::model::rig::{Numerics, Rig, Scope, Setup, Slot};
use crate::model::setting::{Number, Setting};
use std::f64::consts::PI;

const PENDULUM: &str = "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = 0.05\ngravity_nm = 1.2\n\
    [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 1.0\n[[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\n";
const SLIDER: &str = "schema = 1\nmechanism = \"slider\"\n[parameters]\nmass_kg = 2.0\n\
    [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 1.0\n[[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\n";
const DOUBLE: &str = "schema = 1\nmechanism = \"double_pendulum\"\n[parameters]\ninertia1_kg_m2 = 0.03\n\
    inertia2_kg_m2 = 0.05\nmoment1_kg_m = 0.1\nmoment2_kg_m = 0.15\nmass2_kg = 0.6\nlength1_m = 0.2\ngravity_m_s2 = 9.81\n\
    [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 1.0\n[[sensor]]\nmeasures = \"q2\"\ncolumn = \"y\"\n";
const WALKER: &str = "schema = 1\nmechanism = \"compass_gait\"\n[parameters]\nleg_length_m = 1.045\ntotal_mass_kg = 15.2\n\
    gravity_m_s2 = 9.81\nc1 = 0.1007\nc2 = 0.1434\nc3 = 0.000596\nc4 = 0.1151\nc5 = 0.1264\nc6 = 0.0026\n\
    [[actuator]]\njoint = \"hip\"\ncolumn = \"u\"\ngain = 1.0\n[[sensor]]\nmeasures = \"inner\"\ncolumn = \"y\"\n";

fn rig(base: &str, effects: &str) -> Rig {
    Rig::parse(&format!("{base}{effects}"), "test").unwrap()
}

fn effect(id: &str, at: &str, keys: &str) -> String {
    format!("[[effect]]\neffect = \"{id}\"\nat = \"{at}\"\n{keys}\n")
}

fn machine(rig: &Rig, setup: Option<Setup>) -> Machine<f64> {
    Machine::new(&Setting::of(rig, None, setup), &|n: &Number| n.value, 1).unwrap()
}

/// Runs under a slow square wave of torque and samples the first sensor.
fn samples<S: Scalar>(machine: &mut Machine<S>, initial: &[S], torque: f64, seconds: f64) -> Vec<S> {
    machine.reset(0.0, initial);
    let mut out = Vec::new();
    let rows = (seconds * 200.0) as usize;
    for k in 0..rows {
        let t = k as f64 * 0.005;
        machine.advance_to(t).unwrap();
        out.push(machine.read(0));
        machine.command(0, if (t * 1.7).fract() < 0.5 { torque } else { -0.6 * torque }, true);
    }
    out
}

#[test]
fn frictionless_double_pendulum_keeps_its_energy() {
    let mut m = machine(&rig(DOUBLE, ""), None);
    let potential = |m: &Machine<f64>| {
        let (q1, q12) = (m.coordinate(0), m.coordinate(0) + m.coordinate(1));
        -9.81 * ((0.1 + 0.6 * 0.2) * q1.cos() + 0.15 * q12.cos())
    };
    m.reset(0.0, &[1.5, -0.7, 0.0, 2.0]);
    let before = m.kinetic_energy() + potential(&m);
    m.advance_to(5.0).unwrap();
    let after = m.kinetic_energy() + potential(&m);
    // The step's own error; its order is tested below.
    assert!((after - before).abs() < 2e-5, "{before} {after}");
}

#[test]
fn step_shows_fourth_order() {
    let run = |refine| {
        let mut m =
            Machine::<f64>::new(&Setting::of(&rig(DOUBLE, ""), None, None), &|n: &Number| n.value, refine).unwrap();
        m.reset(0.0, &[1.0, 0.5, 0.0, 0.0]);
        m.advance_to(1.0).unwrap();
        m.coordinate(1)
    };
    let (coarse, fine, exact) = (run(1), run(2), run(16));
    let order = ((coarse - exact) / (fine - exact)).abs().log2();
    assert!((3.6..4.4).contains(&order), "{order}");
}

/// Against the recursions themselves: a damper is `v (1 - d h)` a step, a spring moves by its new rate.
#[test]
fn semi_implicit_euler_takes_forces_from_the_start_of_a_step_and_moves_by_the_new_rate() {
    let effects = effect("parallel_spring", "q1", "stiffness = 50.0\nrest = 0.0")
        + &effect("viscous_friction", "q1", "viscous = 3.0");
    let mut m = machine(
        &Rig { numerics: Numerics { euler_step_s: Some(0.01), ..Numerics::default() }, ..rig(SLIDER, &effects) },
        None,
    );
    m.reset(0.0, &[0.2, 0.0]);
    let (mut q, mut v) = (0.2_f64, 0.0_f64);
    for row in 1..100 {
        // Two steps a row; a row's time is rounded.
        m.advance_to(f64::from(row) * 0.02).unwrap();
        for _ in 0..2 {
            v += 0.01 * (-50.0 * q - 3.0 * v) / 2.0;
            q += 0.01 * v;
        }
        assert!((m.coordinate(0) - q).abs() < 1e-9 && (m.rate(0) - v).abs() < 1e-9, "{row}: {} {q}", m.coordinate(0));
    }
}

/// A mass pulled by .5 N under friction of 1 N: it creeps at the rate at which the friction holds it.
#[test]
fn a_joint_whose_friction_has_a_smooth_sign_creeps_where_it_would_stick() {
    let effects = effect("coulomb_friction", "q1", "coulomb = 1.0") + &effect("torque_offset", "q1", "torque = 0.5");
    let numerics = Numerics { smooth_rate: Some(0.01), ..Numerics::default() };
    let mut m = machine(&Rig { numerics, ..rig(SLIDER, &effects) }, None);
    m.reset(0.0, &[0.0, 0.0]);
    m.advance_to(2.0).unwrap();
    assert!((m.rate(0) / (0.01 * 0.5_f64.atanh()) - 1.0).abs() < 1e-6 && !m.is_stuck(0), "{}", m.rate(0));
    assert!(m.is_smooth());
}

/// Against MuJoCo 4.0.0: a mass of 2 kg on a spring of 10 N/m, `frictionloss` 1 N, Euler steps of 5 ms; it slides, creeps and turns back.
#[test]
fn friction_as_a_soft_constraint_moves_as_in_mujoco() {
    let effects = effect("coulomb_friction", "q1", "coulomb = 1.0")
        + &effect("parallel_spring", "q1", "stiffness = 10.0\nrest = 0.0");
    let of = |soft_s: f64| {
        let numerics = Numerics { euler_step_s: Some(0.005), smooth_rate: None, soft_friction_s: Some(soft_s) };
        let mut m = machine(&Rig { numerics, ..rig(SLIDER, &effects) }, None);
        m.reset(0.0, &[0.35, 0.0]);
        m
    };
    let both = [
        (0.2, 0.324_809_261, -0.241_754_556),
        (0.6, 0.155_426_072, -0.544_412_882),
        (1.0, -0.055_420_032, -0.439_808_988),
        (1.4, -0.150_000_137, -0.006_194_538),
    ];
    // By default it recovers within 20 ms; with `solreffriction="0.004 1"` in 10 ms, twice the step.
    for (soft_s, q, v) in [(0.02, -0.145_668_941, 0.045_059_015), (0.004, -0.145_194_260, 0.047_265_225)] {
        let mut m = of(soft_s);
        for (t, q, v) in both.into_iter().chain([(1.6, q, v)]) {
            m.advance_to(t).unwrap();
            assert!(
                (m.coordinate(0) - q).abs() < 1e-8 && (m.rate(0) - v).abs() < 1e-8,
                "{t}: {} {}",
                m.coordinate(0),
                m.rate(0)
            );
        }
        assert!(m.is_smooth());
    }
}

/// Two joints, the first pulled by less than its friction, against MuJoCo 4.0.0 with Euler steps of 1 ms: they slide, stop and creep.
#[test]
fn two_joints_of_soft_friction_move_as_in_mujoco() {
    let effects = effect("coulomb_friction", "q1", "coulomb = 0.5")
        + &effect("coulomb_friction", "q2", "coulomb = 0.2")
        + &effect("torque_offset", "q1", "torque = 0.3");
    let numerics = Numerics { euler_step_s: Some(0.001), smooth_rate: None, soft_friction_s: Some(0.02) };
    let mut m = machine(&Rig { numerics, ..rig(DOUBLE, &effects) }, None);
    m.reset(0.0, &[0.0, 0.0, 0.4, -0.2]);
    let expected = [
        (0.02, [0.006_534_03, -0.001_538_19], [0.286_064_82, -0.019_039_09]),
        (0.05, [0.014_167_45, -0.001_506_36], [0.229_649_9, 0.008_383_33]),
        (0.1, [0.023_582_42, -0.001_021_34], [0.147_255_13, 0.010_083_11]),
        (0.4, [0.030_979_25, -0.000_973_22], [0.005_548_1, -0.004_239_89]),
    ];
    for (t, q, v) in expected {
        m.advance_to(t).unwrap();
        // MuJoCo keeps the softness that a joint has at rest.
        let near = |a: f64, b: f64| (a - b).abs() < 2e-4 * b.abs() + 2e-6;
        assert!(
            (0..2).all(|j| near(m.coordinate(j), q[j]) && near(m.rate(j), v[j])),
            "{t}: {} {}",
            m.rate(0),
            m.rate(1)
        );
    }
}

#[test]
fn what_sticks_plays_or_steps_is_not_smooth() {
    let smooth = |text: &str, effects: &str| machine(&rig(text, effects), None).is_smooth();
    assert!(smooth(DOUBLE, "") && smooth(SLIDER, &effect("parallel_spring", "q1", "stiffness = 50.0\nrest = 0.0")));
    assert!(!smooth(SLIDER, &effect("coulomb_friction", "q1", "coulomb = 1.0")));
    assert!(!smooth(SLIDER, &effect("backlash", "q1", "gap = 0.01\nrotor_inertia = 0.1")));
}

#[test]
fn coulomb_friction_takes_the_textbook_amount_per_half_swing() {
    // Spring and Coulomb friction: the amplitude falls by 2 mu/k every half period, exactly, and then it sticks.
    let effects = effect("parallel_spring", "q1", "stiffness = 50.0\nrest = 0.0")
        + &effect("coulomb_friction", "q1", "coulomb = 1.0");
    let mut m = machine(&rig(SLIDER, &effects), None);
    m.reset(0.0, &[0.21, 0.0]);
    let half = PI / (50.0_f64 / 2.0).sqrt();
    for (k, expected) in [-0.17, 0.13, -0.09, 0.05, -0.01, -0.01].iter().enumerate() {
        m.advance_to(half * (k + 1) as f64).unwrap();
        assert!((m.coordinate(0) - expected).abs() < 1e-7, "{k}: {}", m.coordinate(0));
    }
    assert!(m.is_stuck(0));
    m.advance_to(20.0).unwrap();
    assert_eq!(m.rate(0).to_bits(), 0.0_f64.to_bits(), "sticking holds to the bit");
}

#[test]
fn two_masses_on_a_spring_ring_at_their_resonance() {
    let keys = "stiffness = 40.0\ndamping = 0.0\nrotor_inertia = 0.02";
    let mut m = machine(&rig(&PENDULUM.replace("1.2", "0.0"), &effect("joint_elasticity", "q1", keys)), None);
    // 0.05 in all: 0.02 at the motor, 0.03 at the link.
    let w = (40.0_f64 * (1.0 / 0.02 + 1.0 / 0.03)).sqrt();
    m.reset(0.0, &[0.0, 0.0, 0.1, 0.0]);
    m.advance_to(10.0 * 2.0 * PI / w).unwrap();
    assert!((m.motor(0)[0] - m.coordinate(0) - 0.1).abs() < 2e-5, "twist after ten periods");
}

#[test]
fn a_rotor_as_heavy_as_rotor_and_link_leaves_no_link() {
    let built = |kind: &str, keys: &str, rotor: f64| {
        let mut rig = rig(PENDULUM, &effect(kind, "q1", &format!("{keys}rotor_inertia = 0.01")));
        // As a fit may come to it: a file with such numbers is not read.
        rig.effects[0].values.last_mut().unwrap().value = rotor;
        Machine::<f64>::new(&Setting::of(&rig, None, None), &|n: &Number| n.value, 1)
    };
    for (kind, keys) in [("joint_elasticity", "stiffness = 40.0\ndamping = 0.0\n"), ("backlash", "gap = 0.01\n")] {
        assert!(built(kind, keys, 0.049).is_ok());
        for rotor in [0.05, 0.06] {
            let error = built(kind, keys, rotor).unwrap_err().to_string();
            assert!(error.contains("rotor_inertia at q1") && error.contains("5.0000e-2"), "{error}");
        }
    }
}

#[test]
fn delayed_command_acts_after_its_delay_to_the_instant() {
    let mut m = machine(&rig(SLIDER, &effect("transport_delay", "u", "delay = 0.0137")), None);
    m.reset(0.0, &[0.0, 0.0]);
    m.command(0, 2.0, true);
    m.advance_to(0.1).unwrap();
    let t: f64 = 0.1 - 0.0137;
    assert!((m.coordinate(0) - 0.5 * t * t).abs() < 1e-15);
}

#[test]
fn lagged_torque_follows_its_closed_form() {
    let mut m = machine(&rig(SLIDER, &effect("actuator_lag", "u", "time_constant = 0.03")), None);
    m.reset(0.0, &[0.0, 0.0]);
    m.command(0, 2.0, true);
    m.advance_to(0.1).unwrap();
    assert!((m.motor_torque(0) - 2.0 * (1.0 - (-0.1_f64 / 0.03).exp())).abs() < 1e-12);
    let speed = 0.1 - 0.03 * (1.0 - (-0.1_f64 / 0.03).exp());
    assert!((m.rate(0) - speed).abs() < 1e-8, "step error of RK4");
}

#[test]
fn push_changes_the_rate_by_impulse_over_inertia() {
    let mut m = machine(&rig(SLIDER, &effect("external_push", "q1", "impulse = 3.0\ntime = 0.0421")), None);
    m.reset(0.0, &[0.0, 0.0]);
    m.advance_to(0.1).unwrap();
    assert!((m.rate(0) - 1.5).abs() < 1e-15 && (m.coordinate(0) - 1.5 * (0.1 - 0.0421)).abs() < 1e-15);
}

#[test]
fn load_is_the_mean_of_what_pulls_and_what_is_held_or_the_motors_torque_on_its_side() {
    // 2 Nm against 1.2 sin 0.3 Nm, from a slow forward turn: the first 0.1 ms.
    let speed_up = |side: &str| {
        let keys = format!("coefficient = 0.1{side}");
        let mut m = machine(&rig(PENDULUM, &effect("load_friction", "q1", &keys)), None);
        m.reset(0.0, &[0.3, 0.1]);
        m.command(0, 2.0, true);
        m.advance_to(1e-4).unwrap();
        (m.rate(0) - 0.1) / 1e-4
    };
    let held = 1.2 * 0.3_f64.sin();
    let expected = |load: f64| (2.0 - held - 0.1 * load) / 0.05;
    // The turn during that time moves the load by 1e-6.
    assert!((speed_up("") - expected(0.5 * (2.0 + held))).abs() < 1e-2);
    assert!((speed_up("\nside = \"motor\"") - expected(2.0)).abs() < 1e-2);
}

#[test]
fn asymmetric_friction_is_the_twin_of_an_offset_sticking_included() {
    let dry = effect("coulomb_friction", "q1", "coulomb = 0.3");
    let a = rig(PENDULUM, &(dry.clone() + &effect("friction_asymmetry", "q1", "difference = 0.1")));
    let b = rig(PENDULUM, &(dry + &effect("torque_offset", "q1", "torque = -0.1")));
    let run = |r: &Rig| samples(&mut machine(r, None), &[0.3, 0.0], 1.0, 4.0);
    assert_eq!(run(&a), run(&b));
}

#[test]
fn every_effect_at_its_zero_reproduces_the_bare_machine() {
    for (base, setup) in [
        (PENDULUM, None),
        (SLIDER, None),
        (DOUBLE, None),
        (WALKER, Some(Setup::InnerStance)),
        (WALKER, Some(Setup::Walk)),
    ] {
        let bare = rig(base, "");
        let initial = if bare.mechanism.has_ground() { [0.1, -0.2, -0.6, 0.3] } else { [0.3, 0.1, 0.5, -0.4] };
        let seconds = if bare.mechanism.has_ground() { 0.3 } else { 2.0 };
        let run = |r: &Rig| samples(&mut machine(r, setup), &initial, 0.8, seconds);
        let expected = run(&bare);
        for kind in EffectKind::ALL {
            // Absent at zero; those absent at infinity are only close there and have laws of their own.
            if kind.keys().iter().any(|k| k.role == Role::Inverse) || *kind == EffectKind::Backlash {
                continue;
            }
            for place in bare.places(*kind) {
                let keys = kind.keys().iter().map(|k| match k.role {
                    Role::Strength(zero) => format!("{} = {zero:?}", k.name),
                    _ => format!("{} = {:?}", k.name, if k.name == "time" { 0.1 } else { 1.3 }),
                });
                let keys: Vec<String> = keys.collect();
                let got = run(&rig(base, &effect(kind.id(), place, &keys.join("\n"))));
                let worst = expected.iter().zip(&got).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                // Events split steps: the difference is the error of RK4, not more.
                assert!(worst < 1e-7, "{kind} at {place} of {:?}: {worst:e}", bare.mechanism);
            }
        }
    }
}

#[test]
fn stiff_joint_is_a_rigid_one() {
    let keys = "stiffness = 2e5\ndamping = 20.0\nrotor_inertia = 0.01";
    let rigid = samples(&mut machine(&rig(PENDULUM, ""), None), &[0.3, 0.0], 0.5, 1.0);
    let elastic = rig(PENDULUM, &effect("joint_elasticity", "q1", keys));
    let stiff = samples(&mut machine(&elastic, None), &[0.3, 0.0], 0.5, 1.0);
    let worst = rigid.iter().zip(&stiff).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-4, "{worst}");
}

#[test]
fn play_without_gap_is_a_rigid_joint() {
    let rigid = samples(&mut machine(&rig(PENDULUM, ""), None), &[0.3, 0.0], 0.5, 1.0);
    let loose = rig(PENDULUM, &effect("backlash", "q1", "gap = 0.0\nrotor_inertia = 0.01"));
    let got = samples(&mut machine(&loose, None), &[0.3, 0.0], 0.5, 1.0);
    let worst = rigid.iter().zip(&got).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-9, "{worst}");
}

/// Derivatives of all samples by one number of the rig: dual against central difference.
fn derivative_error(
    base: &str,
    effects: &str,
    setup: Option<Setup>,
    key: (usize, usize),
    initial: &[f64],
    seconds: f64,
) -> f64 {
    let rig = rig(base, effects);
    let slot = Slot::Effect(Scope::Rig, key.0, key.1);
    let setting = Setting::of(&rig, None, setup);
    let lift = |n: &Number| {
        if n.slot == Some(slot) { Dual::<1>::variable(n.value, 0) } else { Dual::constant(n.value) }
    };
    let start: Vec<Dual<1>> = initial.iter().map(|x| Dual::constant(*x)).collect();
    let exact = samples(&mut Machine::new(&setting, &lift, 1).unwrap(), &start, 1.0, seconds);
    let h = 1e-6 * rig.effects[key.0].values[key.1].value.abs().max(0.01);
    let shifted = |d: f64| {
        let mut other = rig.clone();
        other.effects[key.0].values[key.1].value += d;
        samples(&mut machine(&other, setup), initial, 1.0, seconds)
    };
    let (up, down) = (shifted(h), shifted(-h));
    let scale = exact.iter().map(|x| x.d[0].abs()).fold(0.0, f64::max);
    assert!(scale > 0.0, "the number has no influence");
    let errors = exact.iter().zip(up.iter().zip(&down)).map(|(e, (u, d))| (e.d[0] - (u - d) / (2.0 * h)).abs());
    errors.fold(0.0, f64::max) / scale
}

#[test]
fn derivatives_are_exact_through_sticking() {
    let effects = effect("coulomb_friction", "q1", "coulomb = 0.35");
    let error = derivative_error(PENDULUM, &effects, None, (0, 0), &[0.4, 0.0], 3.0);
    assert!(error < 1e-5, "{error}");
}

#[test]
fn derivatives_are_exact_through_delays_and_lags() {
    let delay = effect("transport_delay", "u", "delay = 0.0131");
    assert!(derivative_error(PENDULUM, &delay, None, (0, 0), &[0.4, 0.0], 2.0) < 1e-5);
    let lag = effect("sensor_lag", "y", "time_constant = 0.03");
    assert!(derivative_error(PENDULUM, &lag, None, (0, 0), &[0.4, 0.0], 2.0) < 1e-5);
}

#[test]
fn derivatives_are_exact_through_play() {
    let play = effect("backlash", "q1", "gap = 0.05\nrotor_inertia = 0.01");
    let error = derivative_error(PENDULUM, &play, None, (0, 0), &[0.4, 0.0, 0.03], 0.6);
    assert!(error < 1e-4, "{error}");
}

#[test]
fn touchdown_gives_the_velocities_of_the_notes() {
    // Section 10: inner stance, q = [-.2, .2], v = [-1, -.5]; labels exchanged after.
    let mut m = machine(&rig(WALKER, ""), Some(Setup::Walk));
    m.reset(0.0, &[-0.2, 0.2, -1.0, -0.5]);
    m.touch_down_now();
    assert_eq!(m.stance(), 1);
    assert!((m.rate(0) + 0.795_653_429).abs() < 1e-8 && (m.rate(1) + 0.888_420_832).abs() < 1e-8);
    let slippery = effect("foot_slip", "ground", "friction = 0.1");
    let mut m = machine(&rig(WALKER, &slippery), Some(Setup::Walk));
    m.reset(0.0, &[-0.2, 0.2, -1.0, -0.5]);
    m.touch_down_now();
    assert!(
        (m.rate(0) + 0.875_650_2).abs() < 1e-6 && (m.rate(1) + 0.310_609_1).abs() < 1e-6,
        "{} {}",
        m.rate(0),
        m.rate(1)
    );
    assert!(matches!(m.contact(), Contact::Sliding(_)));
}

#[test]
fn a_rebound_leaves_what_a_damped_spring_of_that_restitution_leaves() {
    // Such a contact, without weight: the foot falls at 1 m/s and slides at 1 m/s until the spring pushes no more.
    let (w, d, h) = (100.0_f64, 0.3_f64, 1e-6);
    let (mut x, mut fall, mut slide) = (0.0_f64, -1.0_f64, 1.0_f64);
    while x <= 0.0 {
        fall -= (w * w * x + 2.0 * d * w * fall) * h;
        slide -= 2.0 * d * w * slide * h;
        x += fall * h;
    }
    let e = (-PI * d / (1.0 - d * d).sqrt()).exp();
    assert!((fall - e).abs() < 1e-3 && (slide - e * e).abs() < 1e-3, "{fall} {slide} {e}");
    let bouncy = effect("elastic_impact", "ground", "restitution = 0.2");
    let mut m = machine(&rig(WALKER, &bouncy), Some(Setup::Walk));
    m.reset(0.0, &[-0.2, 0.2, -1.0, -0.5]);
    let before = m.kinetic_energy();
    m.touch_down_now();
    let [along, down] = m.last_strike().velocity_m_s;
    // The foot's speed is that of the toe that is stance now.
    assert!((m.y.v[2] - 0.04 * along).abs() < 1e-12 && (m.y.v[3] + 0.2 * down).abs() < 1e-12);
    assert!(m.kinetic_energy() < before);
    assert_eq!(m.contact(), Contact::Flight);
}

#[test]
fn held_foot_moves_as_the_pinned_robot_does() {
    let mut pinned = machine(&rig(WALKER, ""), Some(Setup::InnerStance));
    let mut held = machine(&rig(WALKER, ""), Some(Setup::Walk));
    for m in [&mut pinned, &mut held] {
        m.reset(0.0, &[0.1, -0.2, -0.5, 0.3]);
        m.command(0, 5.0, true);
        m.advance_to(0.2).unwrap();
    }
    assert!((pinned.coordinate(0) - held.coordinate(0)).abs() < 1e-12);
    assert!((pinned.coordinate(1) - held.coordinate(1)).abs() < 1e-12);
}

#[test]
fn ground_carries_the_force_of_the_notes() {
    // Section 10: q = [.1, -.2], v = [.5, -1], 5 Nm, inner stance.
    let mut m = machine(&rig(WALKER, ""), Some(Setup::Walk));
    m.reset(0.0, &[0.1, -0.2, 0.5, -1.0]);
    m.command(0, 5.0, true);
    let [x, y] = m.ground_force();
    assert!((x + 17.839_173).abs() < 1e-4 && (y - 145.383_615).abs() < 1e-4, "{x} {y}");
}

#[test]
fn a_push_on_a_robot_that_stands_moves_it_as_on_a_pin() {
    let pushed = effect("external_push", "outer", "impulse = 0.3\ntime = 0.05");
    let mut pinned = machine(&rig(WALKER, &pushed), Some(Setup::InnerStance));
    let mut held = machine(&rig(WALKER, &pushed), Some(Setup::Walk));
    for m in [&mut pinned, &mut held] {
        m.reset(0.0, &[0.1, -0.2, -0.5, 0.3]);
        m.advance_to(0.2).unwrap();
    }
    assert!((pinned.coordinate(0) - held.coordinate(0)).abs() < 1e-12);
    assert!((pinned.coordinate(1) - held.coordinate(1)).abs() < 1e-12);
    assert!(held.toe_m().iter().all(|x| x.abs() < 1e-12));
}

#[test]
fn a_rotor_on_its_stop_stays_within_its_play_through_touchdown_and_push() {
    let play = effect("backlash", "hip", "gap = 0.004\nrotor_inertia = 0.17");
    let pushed = effect("external_push", "outer", "impulse = 0.3\ntime = 0.1");
    let mut m = machine(&rig(WALKER, &(play + &pushed)), Some(Setup::Walk));
    for side in [-0.002, 0.002] {
        m.reset(0.0, &[-0.2, 0.2, -1.0, -0.5, side]);
        m.touch_down_now();
        for k in 1..40 {
            m.advance_to(f64::from(k) * 0.005).unwrap();
            let twist = m.motor(2)[0] - m.coordinate(2);
            assert!(twist.abs() < 0.002 + 1e-9, "{side} {k} {twist}");
        }
        assert!(m.toe_m()[1].abs() < 1e-12);
    }
}

#[test]
fn a_bristle_slides_like_coulomb_friction_however_fast() {
    // Bent over after 1 mrad; at 20 rad/s that takes 60 us, a fortieth of a step.
    let coulomb = effect("coulomb_friction", "q1", "coulomb = 0.0225");
    let bristle = effect("presliding", "q1", "stiffness = 20.0");
    let run = |effects: &str, inner: &[f64]| {
        let mut m = machine(&rig(PENDULUM, effects), None);
        m.reset(0.0, &[&[0.3, 20.0], inner].concat());
        m.advance_to(2.0).unwrap();
        m.coordinate(0)
    };
    let (rigid, bent) = (run(&coulomb, &[]), run(&(coulomb.clone() + &bristle), &[0.001_125]));
    // 20 rad/s for 2 s: the friction of a whole bend less, 2.5e-5 J of 10 J, is 1e-4 rad.
    assert!((rigid - bent).abs() < 1e-3, "{rigid} {bent}");
}

#[test]
fn a_bristle_gives_back_no_more_than_it_stores() {
    let text = effect("coulomb_friction", "q1", "coulomb = 0.02") + &effect("presliding", "q1", "stiffness = 40.0");
    let mut m = machine(&rig(PENDULUM, &text), None);
    m.reset(0.0, &[1.0, 0.0, 0.0]);
    let energy = |m: &mut Machine<f64>| m.kinetic_energy() - 1.2 * m.coordinate(0).cos();
    let (stored, mut least) = (0.02 * 0.02 / (2.0 * 40.0), energy(&mut m));
    for k in 1..2500 {
        m.advance_to(f64::from(k) * 0.01).unwrap();
        let now = energy(&mut m);
        assert!(now < least + stored + 1e-6, "at {} s: {now} after {least}", f64::from(k) * 0.01);
        least = least.min(now);
    }
    assert!(least < -1.19, "friction brought it to rest: {least}");
}

/// A walker with a sprung hip and toes that move, its stance leg leaning by `lean_rad`.
fn walker_with_toes(slope_rad: f64, lean_rad: f64) -> Machine<f64> {
    let effects = effect("viscous_friction", "hip", "viscous = 0.1")
        + &effect("coulomb_friction", "hip", "coulomb = 0.3")
        + &effect("joint_elasticity", "hip", "stiffness = 377.0\ndamping = 0.2\nrotor_inertia = 0.09")
        + &effect("foot_slip", "ground", "friction = 0.6")
        + &effect("ground_slope", "ground", &format!("slope = {slope_rad:?}"));
    let mut m = machine(&rig(WALKER, &effects), Some(Setup::Walk));
    m.let_lift_off();
    m.let_stand_on_both();
    m.give_toes([0.01, 0.03]).unwrap();
    m.reset(0.0, &[lean_rad, -0.1, -0.9, 1.1]);
    m
}

#[test]
fn a_foot_that_is_eliminated_moves_as_one_that_is_held_by_forces() {
    for (slope_rad, lean_rad) in [(0.0, 0.12), (0.03, 0.05), (-0.04, -0.1)] {
        let mut both = [walker_with_toes(slope_rad, lean_rad), walker_with_toes(slope_rad, lean_rad)];
        both[1].plant.keeps_constraints = true;
        let mut eliminated = 0;
        for k in 0..400 {
            let t = f64::from(k) * 1e-3;
            for m in &mut both {
                let swings = 0.02 * (9.0 * t).cos();
                let [[inner, _], [outer, _]] = m.toes();
                m.set_toes([
                    ToeMotion {
                        short_m: inner,
                        rate_m_s: 0.01 * (7.0 * t).sin(),
                        acceleration_m_s2: 0.07 * (7.0 * t).cos(),
                    },
                    ToeMotion { short_m: outer, rate_m_s: swings, acceleration_m_s2: -0.18 * (9.0 * t).sin() },
                ]);
                m.command(0, 8.0 * (23.0 * t).sin(), true);
                m.advance_to(t + 1e-3).unwrap();
            }
            let [a, b] = &mut both;
            eliminated += u32::from(a.plant.stands_on_a_point());
            let ([fa, ha], [fb, hb]) = (
                <[_; 2]>::from(a.ground_force_and_hip_acceleration()),
                <[_; 2]>::from(b.ground_force_and_hip_acceleration()),
            );
            for i in 0..2 {
                // Rounding, and how the motion makes it grow.
                assert!((fa[i] - fb[i]).abs() < 1e-6 && (ha[i] - hb[i]).abs() < 1e-7, "{t}: {fa:?} {fb:?}");
                assert!((a.coordinate(i) - b.coordinate(i)).abs() < 1e-9, "{t}");
                assert!((a.rate(i) - b.rate(i)).abs() < 1e-8, "{t}");
            }
        }
        assert!(eliminated > 300, "{eliminated}");
    }
}

/// What a reading says is what the machine did so much earlier, between steps as on them.
#[test]
fn a_delayed_rate_is_the_rate_of_then() {
    let sensors = "[[sensor]]\nmeasures = \"q1_rate\"\ncolumn = \"r\"\n";
    let late = |delay_s: f64| {
        let effects = format!("{sensors}{}", effect("sensor_delay", "r", &format!("delay = {delay_s}")));
        let mut m = machine(&rig(PENDULUM, &effects), None);
        m.reset(0.0, &[1.0, 0.0]);
        m.command(0, 0.0, true);
        m
    };
    for delay_s in [0.001, 0.00125, 0.0037] {
        let (mut delayed, mut own) = (late(delay_s), late(0.0));
        for k in 10..200 {
            let t = f64::from(k) * 0.005;
            own.advance_to(t - delay_s).unwrap();
            delayed.advance_to(t).unwrap();
            let error = delayed.read(1) - own.read(1);
            assert!(error.abs() < 1e-5, "{error} rad/s at {t} s, {delay_s} s late");
        }
    }
}

#[test]
fn steps_of_a_simulator_may_be_finer_than_our_own() {
    let numerics = Numerics { euler_step_s: Some(9e-6), ..Numerics::default() };
    let mut m = machine(&Rig { numerics, ..rig(PENDULUM, "") }, None);
    m.reset(0.0, &[0.1, 0.0]);
    m.advance_to(0.01).unwrap();
    assert!(m.coordinate(0).is_finite());
}
