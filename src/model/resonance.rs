//! At which frequency a machine with an elastic joint rings: what an engineer looks for in a spectrum.
//!
//! `ω² = k (1/Jr + 1/J)`, J what hangs on the spring's other side, everything else free and gravity aside (model notes,
//! section 6). With a sensor on the link alone k and Jr are hardly separable; this frequency is sharp nevertheless.
//! RT: yes.

use super::compass_gait::elastic::{leg_inertia, without_rotor};
use super::compass_gait::params::Params;
use super::effect::EffectKind;
use super::rig::{Effect, MechanismKind, Rig, Setup};
use std::f64::consts::TAU;

/// Resonance of `effect`, a joint elasticity, in `rig`, Hz. `None` for other effects, and where nothing can ring.
#[must_use]
pub fn resonance_hz(rig: &Rig, effect: &Effect) -> Option<f64> {
    if effect.kind != EffectKind::JointElasticity {
        return None;
    }
    let (stiffness, rotor) = (effect.get("stiffness")?.value, effect.get("rotor_inertia")?.value);
    let link = link_inertia(rig, &effect.at, rotor)?;
    let square = stiffness * (1.0 / rotor + 1.0 / link);
    (square.is_finite() && square > 0.0).then(|| libm::sqrt(square) / TAU)
}

/// Inertia beyond the spring at coordinate `at`, joints straight, SI.
fn link_inertia(rig: &Rig, at: &str, rotor: f64) -> Option<f64> {
    let p: Vec<f64> = rig.parameters.iter().map(|v| v.value).collect();
    let link = match (rig.mechanism, &p[..]) {
        (MechanismKind::Pendulum | MechanismKind::Slider, [total, ..]) => total - rotor,
        (MechanismKind::DoublePendulum, &[j1, j2, _, moment2, mass2, length1, _]) => {
            double_pendulum(j1 + mass2 * length1 * length1, j2, moment2 * length1, at)
        }
        (MechanismKind::CompassGait, &[l, m, g, c1, c2, c3, c4, c5, c6]) => {
            let params = Params {
                c: [c1, c2, c3, c4, c5, c6],
                leg_length_m: l,
                total_mass_kg: m,
                gravity_m_s2: g,
                viscous_nm_s_rad: 0.0,
                coulomb_nm: 0.0,
            };
            legs(&params, rig.recordings.iter().find_map(|r| r.setup), rotor)?
        }
        _ => return None,
    };
    (link > 0.0).then_some(link)
}

/// `1 / (M⁻¹)ᵢᵢ` of the links, stretched out: M = [a + j2 + 2b, j2 + b; j2 + b, j2].
fn double_pendulum(a: f64, j2: f64, b: f64, at: &str) -> f64 {
    let (m11, m12, m22) = (a + j2 + 2.0 * b, j2 + b, j2);
    let determinant = m11 * m22 - m12 * m12;
    determinant / if at == "q1" { m22 } else { m11 }
}

/// What the hip's spring sees of the legs at the upright.
fn legs(params: &Params<f64>, setup: Option<Setup>, rotor: f64) -> Option<f64> {
    let unit = params.inertia_kg_m2();
    let [c1, c2, ..] = params.c;
    let standing = |p: &Params<f64>| leg_inertia(&without_rotor(&p.normalised(), rotor / unit), [0.0; 2]) * unit;
    match setup {
        Some(Setup::OuterStance) => Some(standing(&params.swapped())),
        // That leg is held, the other swings alone.
        Some(Setup::InnerFixed) => Some(c2 * unit - rotor),
        Some(Setup::OuterFixed) => Some(c1 * unit - rotor),
        Some(Setup::Parallel) => None,
        Some(Setup::InnerStance | Setup::Walk) | None => Some(standing(params)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::rig::Value;

    /// A rig of `mechanism` in `setup` with the SysID legs, or a pendulum of 2 kg m².
    fn rig(mechanism: &str, parameters: &str, setup: &str) -> Rig {
        let text = format!(
            "schema = 1\nname = \"r\"\nmechanism = \"{mechanism}\"\n[parameters]\n{parameters}\n[[recording]]\n\
             file = \"a.csv\"\nuse = \"fit\"\n{setup}\n"
        );
        Rig::parse(&text, "test").unwrap()
    }

    fn spring(at: &str, stiffness: f64, rotor: f64) -> Effect {
        let values = [stiffness, 0.1, rotor].map(Value::known).to_vec();
        Effect::new(EffectKind::JointElasticity, at, values)
    }

    const LEGS: &str = "leg_length_m = { value = 1.045 }\ntotal_mass_kg = { value = 15.2 }\n\
                        gravity_m_s2 = { value = 9.81 }\nc1 = { value = 0.1007 }\nc2 = { value = 0.1434 }\n\
                        c3 = { value = 0.000596 }\nc4 = { value = 0.1151 }\nc5 = { value = 0.1264 }\n\
                        c6 = { value = 0.0026 }";

    #[test]
    fn the_example_of_the_notes_rings_at_ten_and_a_half_hertz_on_both_legs() {
        // Section 6: Jr = .09 kg m²; k = 22.703131 (inner), 22.327712 (outer) times 16.59878.
        for (setup, k) in [("inner_stance", 22.703_131), ("outer_stance", 22.327_712)] {
            let rig = rig("compass_gait", LEGS, &format!("setup = \"{setup}\""));
            let hz = resonance_hz(&rig, &spring("hip", k * 16.598_78, 0.09)).unwrap();
            assert!((hz - 10.5).abs() < 1e-4, "{setup}: {hz}");
        }
    }

    #[test]
    fn two_equal_inertias_ring_faster_than_one_by_root_two() {
        let rig = rig("pendulum", "inertia_kg_m2 = { value = 2.0 }\ngravity_nm = { value = 0.0 }", "");
        let hz = resonance_hz(&rig, &spring("q1", 100.0, 1.0)).unwrap();
        assert!((hz - libm::sqrt(200.0) / TAU).abs() < 1e-12, "{hz}");
    }

    #[test]
    fn what_cannot_ring_has_no_frequency() {
        let rig = rig("pendulum", "inertia_kg_m2 = { value = 2.0 }\ngravity_nm = { value = 0.0 }", "");
        assert_eq!(resonance_hz(&rig, &spring("q1", 100.0, 3.0)), None);
        let drag = Effect::new(EffectKind::QuadraticDrag, "q1", vec![Value::known(1.0)]);
        assert_eq!(resonance_hz(&rig, &drag), None);
    }
}
