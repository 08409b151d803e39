//! What may be hidden where, and at what strength it starts; its visibility then corrects the strength. RT: no.

use super::dice::Dice;
use super::effect::{Effect, NONE};
use super::rig::{Kind, Rig};

/// What only walking shows.
const OF_WALKING: [&str; 6] =
    ["foot_slip", "elastic_impact", "toe_compliance", "ground_slope", "counterweight", "round_foot"];

/// Each of them comes so many times as often as any other effect.
const OF_WALKING_WEIGHT: usize = 3;

/// Effects that make sense on a machine and are not in its base already.
pub(super) fn candidates(rig: &Rig) -> Vec<&'static str> {
    let mut of = vec![
        "quadratic_drag",
        "torque_offset",
        "torque_limit",
        "actuator_lag",
        "transport_delay",
        "sensor_lag",
        "lost_counts",
        "clock_skew",
        "external_push",
        "sensor_drift",
    ];
    let has_friction = rig.values.keys().any(|name| name.starts_with("coulomb"));
    of.extend(if has_friction {
        &["stribeck_friction", "presliding", "friction_asymmetry", "friction_drift"][..]
    } else {
        &["coulomb_friction"][..]
    });
    if rig.sensors.len() > 1 {
        of.extend(["sensor_delay", "sensor_scale"]);
    }
    if rig.kind == Kind::Walker {
        of.extend([OF_WALKING; OF_WALKING_WEIGHT].concat());
    }
    of.extend(by_kind(rig.kind));
    if rig.kind == Kind::Walker {
        // Bristles and a sensor's own clock are not drawn here: over steps of half a second they show nothing.
        of.retain(|id| !matches!(*id, "presliding" | "clock_skew" | "friction_drift"));
    }
    of
}

fn by_kind(kind: Kind) -> &'static [&'static str] {
    match kind {
        Kind::Pendulum => &[
            "joint_elasticity",
            "backlash",
            "torque_ripple",
            "load_friction",
            "sensor_bias",
            "parallel_spring",
            "encoder_eccentricity",
            "link_flexibility",
        ],
        Kind::Rotor => &[
            "joint_elasticity",
            "backlash",
            "torque_ripple",
            "load_friction",
            "encoder_eccentricity",
            "parallel_spring",
            "link_flexibility",
        ],
        Kind::Slider => &["parallel_spring", "load_friction"],
        Kind::Double => &[
            "sensor_bias",
            "load_friction",
            "torque_ripple",
            "parallel_spring",
            "encoder_eccentricity",
            "link_flexibility",
        ],
        Kind::Biped => &[
            "joint_elasticity",
            "sensor_bias",
            "torque_ripple",
            "parallel_spring",
            "encoder_eccentricity",
            "link_flexibility",
            "counterweight",
        ],
        Kind::Walker => &["sensor_bias", "parallel_spring", "torque_ripple"],
    }
}

/// Scales of a rig that starting magnitudes are made from.
pub(super) struct Scales {
    /// kg m² or kg.
    pub inertia: f64,
    /// Nm or N.
    pub torque: f64,
    /// rad or m.
    pub angle: f64,
    /// rad/s or m/s.
    pub rate: f64,
}

/// The scales of a rig.
pub(super) fn scales(rig: &Rig) -> Scales {
    let value = |name: &str| rig.values.get(name).copied().unwrap_or(0.0);
    match rig.kind {
        Kind::Pendulum | Kind::Rotor => {
            let inertia = value("inertia_kg_m2");
            Scales { inertia, torque: 30.0 * inertia, angle: 0.6, rate: 4.0 }
        }
        Kind::Slider => Scales { inertia: value("mass_kg"), torque: 3.0 * value("mass_kg"), angle: 0.15, rate: 0.5 },
        Kind::Double => Scales { inertia: value("inertia1_kg_m2"), torque: 1.0, angle: 0.6, rate: 3.0 },
        Kind::Biped | Kind::Walker => Scales { inertia: 1.5, torque: 8.0, angle: 0.3, rate: 1.5 },
    }
}

/// Draws one effect of this id, at a magnitude that the detectability then corrects.
pub(super) fn draw(dice: &mut Dice, rig: &Rig, id: &'static str, duration_s: f64) -> Effect {
    let s = scales(rig);
    let on_sensor = matches!(
        id,
        "sensor_lag"
            | "sensor_delay"
            | "sensor_bias"
            | "sensor_drift"
            | "lost_counts"
            | "clock_skew"
            | "sensor_scale"
            | "encoder_eccentricity"
    );
    let index = place(dice, rig, id, on_sensor);
    let at = match id {
        _ if index == NONE => "ground",
        _ if is_at_leg(rig, id) => ["inner", "outer"][index],
        _ if on_sensor => rig.sensors[index].column,
        "torque_limit" | "actuator_lag" | "transport_delay" => rig.joints[index].1,
        _ => rig.joints[index].0,
    };
    let moment = dice.between(0.3, 0.7) * duration_s;
    let phase = dice.between(-3.0, 3.0);
    let (leading, values): (&'static str, Vec<(&'static str, f64)>) = match id {
        "coulomb_friction" => ("coulomb", vec![("coulomb", 0.05 * s.torque)]),
        "friction_asymmetry" => ("difference", vec![("difference", dice.sign() * 0.02 * s.torque)]),
        "stribeck_friction" => {
            ("extra", vec![("extra", 0.05 * s.torque), ("velocity", dice.between(0.05, 0.2) * s.rate)])
        }
        "load_friction" => ("coefficient", vec![("coefficient", 0.03)]),
        "quadratic_drag" => ("quadratic", vec![("quadratic", 0.03 * s.torque / (s.rate * s.rate))]),
        "presliding" => ("stiffness", vec![("stiffness", 1.5 * s.torque / s.angle)]),
        "parallel_spring" => {
            ("stiffness", vec![("stiffness", 0.05 * s.torque / s.angle), ("rest", dice.between(-0.5, 0.5) * s.angle)])
        }
        "torque_offset" => ("torque", vec![("torque", dice.sign() * 0.05 * s.torque)]),
        "torque_ripple" => {
            let order = *dice.pick(&[6.0, 7.0, 12.0, 14.0]);
            ("amplitude", vec![("amplitude", 0.05 * s.torque), ("order", order), ("phase", phase)])
        }
        "joint_elasticity" => ("stiffness", elasticity(dice, rig, &s)),
        "backlash" => ("gap", vec![("gap", 0.01), ("rotor_inertia", dice.between(0.1, 0.4) * s.inertia)]),
        "external_push" => ("impulse", vec![("impulse", dice.sign() * 0.1 * s.inertia * s.rate), ("time", moment)]),
        "torque_limit" => ("limit", vec![("limit", 0.4 * s.torque)]),
        "friction_drift" => ("rate", vec![("rate", dice.sign() * 0.5 / duration_s)]),
        "sensor_delay" => ("delay", vec![("delay", 0.006)]),
        "actuator_lag" => ("time_constant", vec![("time_constant", 0.01)]),
        "transport_delay" => ("delay", vec![("delay", 0.006)]),
        "sensor_lag" => ("time_constant", vec![("time_constant", 0.01)]),
        "sensor_bias" => ("bias", vec![("bias", dice.sign() * 0.05 * s.angle)]),
        "sensor_drift" => ("rate", vec![("rate", dice.sign() * 0.05 * reach(rig, index, &s) / duration_s)]),
        "lost_counts" => ("step", vec![("step", dice.sign() * 0.05 * reach(rig, index, &s)), ("time", moment)]),
        "clock_skew" => ("skew", vec![("skew", dice.sign() * 0.004)]),
        // Stored as factor - 1, so that it can be made stronger.
        "sensor_scale" => ("scale", vec![("scale", dice.sign() * 0.02)]),
        "encoder_eccentricity" => ("amplitude", vec![("amplitude", 0.005), ("phase", phase)]),
        "link_flexibility" => {
            let (hz, damping) = (dice.log_between(5.0, 25.0), dice.between(0.01, 0.05));
            let whole = link_inertia(rig, index);
            ("participation", vec![("frequency", hz), ("damping", damping), ("participation", 0.1), ("whole", whole)])
        }
        "foot_slip" => ("friction", vec![("friction", 0.2)]),
        "elastic_impact" => ("restitution", vec![("restitution", 0.2)]),
        // A quarter of critical damping for the standing robot.
        "toe_compliance" => {
            let stiffness = 4e4;
            let damping = 2.0 * dice.between(0.1, 0.4) * libm::sqrt(stiffness * 15.2);
            ("stiffness", vec![("stiffness", stiffness), ("damping", damping)])
        }
        "ground_slope" => ("slope", vec![("slope", dice.sign() * 0.005)]),
        "counterweight" => {
            let lever = rig.values.get("leg_length_m").copied().unwrap_or(0.0);
            ("force", vec![("force", dice.sign() * 3.0), ("lever", lever)])
        }
        "round_foot" => ("radius", vec![("radius", 0.03)]),
        "magnet_detent" => {
            let centre = dice.between(-0.3, 0.3) * s.angle;
            (
                "depth",
                vec![("depth", 0.1 * s.torque), ("centre", centre), ("width", dice.between(0.06, 0.12) * s.angle)],
            )
        }
        "base_vibration" => {
            ("acceleration", vec![("acceleration", 0.3), ("hz", dice.between(2.0, 5.0)), ("phase", phase)])
        }
        _ => ("fraction", vec![("fraction", 0.1), ("time", moment)]),
    };
    let once = matches!(id, "external_push" | "lost_counts" | "payload_step");
    Effect { id, at: at.to_owned(), index, values: values.into_iter().collect(), leading, once }
}

/// Joint or sensor; where the sensors of a rig differ in kind, the position sensors (a rate has no turn to be off by).
fn place(dice: &mut Dice, rig: &Rig, id: &str, on_sensor: bool) -> usize {
    let angles: Vec<usize> = (0..rig.sensors.len()).filter(|i| !rig.sensors[*i].is_rate).collect();
    match id {
        "counterweight" | "foot_slip" | "elastic_impact" | "toe_compliance" | "ground_slope" | "round_foot" => NONE,
        _ if is_at_leg(rig, id) => *dice.pick(&[0, 1]),
        "link_flexibility" => *dice.pick(&(0..rig.joints.len()).collect::<Vec<_>>()),
        "joint_elasticity" | "backlash" | "magnet_detent" | "payload_step" | "base_vibration" => 0,
        "sensor_bias" | "lost_counts" | "encoder_eccentricity" | "clock_skew" => *dice.pick(&angles),
        _ if on_sensor => *dice.pick(&(0..rig.sensors.len()).collect::<Vec<_>>()),
        _ => *dice.pick(&(0..rig.joints.len()).collect::<Vec<_>>()),
    }
}

/// Acts on one leg of the biped, not at its hip.
fn is_at_leg(rig: &Rig, id: &str) -> bool {
    matches!(rig.kind, Kind::Biped) && matches!(id, "link_flexibility" | "parallel_spring")
}

/// Inertia of a link about its joint (of a leg about the hip), kg m².
fn link_inertia(rig: &Rig, index: usize) -> f64 {
    let value = |name: &str| rig.values.get(name).copied().unwrap_or(0.0);
    match rig.kind {
        Kind::Double => value(["inertia1_kg_m2", "inertia2_kg_m2"][index]),
        Kind::Biped | Kind::Walker => {
            let unit = value("total_mass_kg") * value("leg_length_m") * value("leg_length_m");
            (value(["c1", "c2"][index]) - value("c3")) * unit
        }
        Kind::Pendulum | Kind::Rotor | Kind::Slider => scales(rig).inertia,
    }
}

/// How far the reading of a sensor swings.
fn reach(rig: &Rig, sensor: usize, s: &Scales) -> f64 {
    if rig.sensors[sensor].is_rate { s.rate } else { s.angle }
}

/// Two masses with a resonance between 8 and 25 Hz, a few per cent damped.
fn elasticity(dice: &mut Dice, rig: &Rig, s: &Scales) -> Vec<(&'static str, f64)> {
    // The biped's hip turns mostly the swing leg: its inertia about the hip.
    let total = if rig.kind == Kind::Biped { 0.12 * 16.6 } else { s.inertia };
    let rotor = if rig.kind == Kind::Biped { dice.between(0.06, 0.1) } else { dice.between(0.1, 0.3) * total };
    let reduced = rotor * (total - rotor) / total;
    let omega = std::f64::consts::TAU * dice.log_between(8.0, 25.0);
    let stiffness = omega * omega * reduced;
    let damping = 2.0 * dice.between(0.01, 0.05) * omega * reduced;
    vec![("stiffness", stiffness), ("damping", damping), ("rotor_inertia", rotor)]
}
