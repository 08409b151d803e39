//! Experiments of our notes (sections 7 and 8) on the mechanics alone: true state or linear observer, no bytes.

use super::World;
use super::world::BlocksWorld;
use crate::base::ode::rk4;
use crate::base::riccati::zero_order_hold;
use crate::base::time::{Span, Stamp};
use crate::config::checked::Config;
use crate::config::load;
use crate::control::{Controller, balance_gain};
use crate::model::compass_gait::dynamics;
use crate::model::compass_gait::elastic::{self, without_rotor};
use crate::model::compass_gait::linear::{elastic_hip, rigid};
use crate::model::compass_gait::params::Normalised;
use crate::msg::{Estimate, Leg, Snapshot};
use nalgebra::SMatrix;

fn config(keys: &[&str]) -> Config {
    load(None, &keys.iter().map(|k| (*k).to_owned()).collect::<Vec<_>>()).unwrap().config
}

/// The mechanics of [`ideal`]: true stick and slip, or the smoothed friction of Thesis (4.12).
enum Plant {
    True(Box<BlocksWorld>),
    Smooth(Normalised<f64>, [f64; 4]),
}

impl Plant {
    /// Rigid hip, leaning by `tilt` on the stance leg.
    fn new(config: &mut Config, smooth: bool, tilt: f64) -> Self {
        let inner = config.simulation.stance == Leg::Inner;
        config.simulation.initial_angle_rad = if inner { [tilt, 0.0] } else { [0.0, tilt] };
        config.simulation.hip_elasticity = None;
        config.simulation.release_torque_nm = 0.0;
        let p = config.robot.model.params();
        if smooth {
            Self::Smooth(if inner { p } else { p.swapped() }.normalised(), [tilt, 0.0, 0.0, 0.0])
        } else {
            Self::True(Box::new(BlocksWorld::new(config)))
        }
    }

    /// `[θs, θw, θ̇s, θ̇w]`.
    fn state(&self) -> [f64; 4] {
        match self {
            Self::Smooth(_, x) => *x,
            Self::True(world) => {
                let r = world.reading();
                let (s, w) = if r.stance == Leg::Inner { (0, 1) } else { (1, 0) };
                [r.leg_angle_rad[s], r.leg_angle_rad[w], r.leg_rate_rad_s[s], r.leg_rate_rad_s[w]]
            }
        }
    }

    /// One millisecond under a torque + on the stance row.
    fn step(&mut self, stance: Leg, torque_nm: f64, unit_nm: f64) {
        match self {
            Self::Smooth(p, x) => *x = rk4(x, 1e-3, |x| dynamics::derivative(p, x, torque_nm / unit_nm)),
            Self::True(world) => {
                let sign = if stance == Leg::Inner { 1.0 } else { -1.0 };
                world.step(sign * torque_nm, world.reading().toe_position_m, Span::from_ms(1));
            }
        }
    }
}

/// True state in, torque at once: the ideal loop of section 8, rigid hip, 1 kHz. Leg angles, stance first, every ms.
fn ideal(leg: &str, smooth: bool, tilt_deg: f64, compensation: f64, seconds: usize) -> Vec<[f64; 2]> {
    let keys = [&format!("sim.stance={leg}"), &format!("control.friction_compensation={compensation:?}")];
    let mut config = config(&keys.map(String::as_str));
    let (stance, unit) = (config.simulation.stance, config.robot.model.params().inertia_kg_m2());
    let mut plant = Plant::new(&mut config, smooth, tilt_deg.to_radians());
    let mut controller = Controller::new(&config).unwrap();
    (0..1000 * seconds)
        .map(|_| {
            let [ts, tw, vs, vw] = plant.state();
            let e = Estimate {
                stance,
                theta_stance_rad: ts,
                theta_swing_rad: tw,
                theta_stance_rad_s: vs,
                theta_swing_rad_s: vw,
                ..Estimate::default()
            };
            let motor = controller.step(Stamp(0), &e, &Snapshot::default()).hip_torque_nm.clamp(-30.0, 30.0);
            plant.step(stance, if stance == Leg::Inner { motor } else { -motor }, unit);
            [ts, tw]
        })
        .collect()
}

/// Peak to peak over the last 10 s, degrees: stance, swing.
fn cycle(trace: &[[f64; 2]]) -> [f64; 2] {
    let tail = &trace[trace.len() - 10_000..];
    [0, 1].map(|i| {
        let (low, high) = tail.iter().fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(x[i]), h.max(x[i])));
        (high - low).to_degrees()
    })
}

/// Limit cycle on the inner leg after a tilt of 1°.
fn limit_cycle(smooth: bool, compensation: f64) -> [f64; 2] {
    cycle(&ideal("inner", smooth, 1.0, compensation, 40))
}

#[test]
fn forgotten_friction_gives_the_limit_cycle_of_the_notes() {
    // Section 8, friction smoothed as there: .43°/4.0° without compensation, .05°/.6° with 80 %, none with 100 %.
    for (compensation, [stance, swing]) in [(0.0, [0.43, 4.0]), (0.8, [0.05, 0.6]), (1.0, [0.0, 0.0])] {
        let got = limit_cycle(true, compensation);
        println!("{compensation}: {got:?}");
        assert!((got[0] - stance).abs() < 0.03 && (got[1] - swing).abs() < 0.3, "{compensation}: {got:?}");
    }
    assert!(limit_cycle(true, 1.2)[0] < 0.4);
}

#[test]
fn true_stiction_keeps_a_small_limit_cycle_even_when_compensated() {
    // True sticking cannot be compensated by a torque that is zero at rest: measured .46°/3.8° without compensation,
    // .12°/1.4° with 80 %, .07°/1.3° with 100 %.
    for (compensation, bound) in [(0.0, [0.5, 4.2]), (0.8, [0.2, 1.8]), (1.0, [0.12, 1.6])] {
        let got = limit_cycle(false, compensation);
        println!("{compensation}: {got:?}");
        assert!(got[0] < bound[0] && got[1] < bound[1] && got[1] > 0.5, "{compensation}: {got:?}");
    }
}

#[test]
fn basins_at_30_nm_are_those_of_the_notes() {
    // Stance tilt 4.25° inner, 3.25° outer with everything else zero (section 8, resolution .25°).
    for (name, tilt) in [("inner", 4.25), ("outer", 3.25)] {
        let recovers = |deg: f64| ideal(name, false, deg, 1.0, 6).iter().all(|x| x[0].abs() < 0.5);
        assert!(recovers(tilt - 0.2), "{name}");
        assert!(!recovers(tilt + 0.5), "{name}");
    }
}

/// Growth rate, 1/s, of the fastest mode of plant (elastic, frictionless), observer at 1 kHz with the rigid model, LQR.
fn growth(leg: Leg, epsilon_s: Option<f64>) -> f64 {
    let config = config(&[]);
    let inner = config.robot.model.params();
    let p = if leg == Leg::Inner { inner } else { inner.swapped() }.normalised().frictionless();
    let jr = 0.09 / inner.inertia_kg_m2();
    let spring = elastic::tuned(&p, jr, 10.5, 0.02);
    let plant = elastic_hip(&without_rotor(&p, jr), &spring, &[0.0; 6], 0.0);
    let model = rigid(&p, &[0.0; 4], 0.0);
    let k = balance_gain(&config, leg).unwrap().0;
    let k = SMatrix::<f64, 1, 4>::new(k[0], k[1], k[3], k[4]);
    let t = 1e-3;
    let a = SMatrix::<f64, 6, 6>::from_fn(|i, j| plant.a[i][j]);
    let (ad, bd) = zero_order_hold(&a, &SMatrix::<f64, 6, 1>::from(plant.b), t);
    // Legs of the plant among its six states.
    let legs = SMatrix::<f64, 4, 6>::from_fn(|i, j| f64::from(u8::from([0, 1, 3, 4][i] == j)));
    let fastest = match epsilon_s {
        None => (ad - bd * k * legs).complex_eigenvalues().iter().map(|e| e.norm()).fold(0.0, f64::max),
        Some(epsilon) => {
            let l = SMatrix::<f64, 4, 2>::new(
                2.0 / epsilon,
                0.0,
                0.0,
                2.0 / epsilon,
                epsilon.powi(-2),
                0.0,
                0.0,
                epsilon.powi(-2),
            );
            let am = SMatrix::<f64, 4, 4>::from_fn(|i, j| model.a[i][j]);
            let (am, bm) = zero_order_hold(&am, &SMatrix::<f64, 4, 1>::from(model.b), t);
            let c = SMatrix::<f64, 2, 4>::identity();
            // x⁺ = Ad x - Bd K x̂;  x̂⁺ = x̃ + T L C (legs x⁺ - x̃) with x̃ = Am x̂ - Bm K x̂.
            let predict = am - bm * k;
            let (lc, one) = (l * c * t, SMatrix::<f64, 4, 4>::identity());
            let mut loop_matrix = SMatrix::<f64, 10, 10>::zeros();
            loop_matrix.fixed_view_mut::<6, 6>(0, 0).copy_from(&ad);
            loop_matrix.fixed_view_mut::<6, 4>(0, 6).copy_from(&(-bd * k));
            loop_matrix.fixed_view_mut::<4, 6>(6, 0).copy_from(&(lc * legs * ad));
            loop_matrix.fixed_view_mut::<4, 4>(6, 6).copy_from(&((one - lc) * predict - lc * legs * bd * k));
            loop_matrix.complex_eigenvalues().iter().map(|e| e.norm()).fold(0.0, f64::max)
        }
    };
    fastest.ln() / t
}

#[test]
fn observer_is_a_model_pass_filter_for_the_elastic_mode() {
    // Section 7: ideal state +4.9 (inner), +5.6 (outer); with the observer (inner) +3.7, +1.3, -1.8, -2.0, -1.4.
    assert!((growth(Leg::Inner, None) - 4.9).abs() < 0.05 && (growth(Leg::Outer, None) - 5.6).abs() < 0.05);
    for (epsilon, printed) in [(0.005, 3.7), (0.01, 1.3), (0.02, -1.8), (0.05, -2.0), (0.2, -1.4)] {
        let ours = growth(Leg::Inner, Some(epsilon));
        // Ours corrects with the angles of the same instant, theirs with those of the last.
        assert!((ours - printed).abs() < 0.25, "ε {epsilon}: {ours} against {printed}");
    }
}
