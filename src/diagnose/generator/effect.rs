//! What is hidden: how an effect of the contract, or one outside it, acts in the generator's own machine. RT: no.

use std::collections::BTreeMap;

use super::dice::Dice;
use super::machine::Machine;
use super::rig::{Kind, Rig};

/// One hidden effect.
#[derive(Debug, Clone)]
pub(super) struct Effect {
    /// Id of the contract, or the private name of something outside it.
    pub id: &'static str,
    /// Place.
    pub at: String,
    /// Joint or sensor it acts on.
    pub index: usize,
    /// True values.
    pub values: BTreeMap<&'static str, f64>,
    /// The value that says how strong it is.
    pub leading: &'static str,
    /// Acts in the first recording only.
    pub once: bool,
}

/// What happens between the true motion and a reading.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Reading {
    /// First-order lag, s.
    pub lag_s: f64,
    /// Pure delay, s.
    pub delay_s: f64,
    /// Constant.
    pub bias: f64,
    /// Per second.
    pub drift: f64,
    /// Factor - 1.
    pub scale: f64,
    /// Amplitude and phase of a once-per-turn error.
    pub eccentric: [f64; 2],
    /// Step and its time.
    pub lost: [f64; 2],
    /// Its clock runs fast by this fraction.
    pub skew: f64,
}

/// Families outside the library.
pub(super) const OUTSIDE: [&str; 3] = ["magnet_detent", "base_vibration", "payload_step"];

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
    match rig.kind {
        Kind::Pendulum => of.extend(["joint_elasticity", "backlash", "torque_ripple", "load_friction", "sensor_bias"]),
        Kind::Rotor => of.extend(["joint_elasticity", "torque_ripple", "encoder_eccentricity", "parallel_spring"]),
        Kind::Slider => of.extend(["parallel_spring"]),
        Kind::Double => of.extend(["sensor_bias", "load_friction"]),
        Kind::Biped => of.extend(["joint_elasticity", "sensor_bias"]),
    }
    of
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
        Kind::Biped => Scales { inertia: 1.5, torque: 8.0, angle: 0.3, rate: 1.5 },
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
        "joint_elasticity" | "backlash" | "magnet_detent" | "payload_step" | "base_vibration" => 0,
        "sensor_bias" | "lost_counts" | "encoder_eccentricity" | "clock_skew" => *dice.pick(&angles),
        _ if on_sensor => *dice.pick(&(0..rig.sensors.len()).collect::<Vec<_>>()),
        _ => *dice.pick(&(0..rig.joints.len()).collect::<Vec<_>>()),
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

impl Effect {
    fn get(&self, key: &str) -> f64 {
        self.values.get(key).copied().unwrap_or(0.0)
    }

    /// Is it outside the library?
    pub(super) fn is_outside(&self) -> bool {
        OUTSIDE.contains(&self.id)
    }

    /// Stronger by this factor. Springs, limits and bristles hide more the stiffer they are.
    pub(super) fn stronger(&self, factor: f64) -> Self {
        let mut other = self.clone();
        let inverse = matches!(self.id, "joint_elasticity" | "torque_limit" | "presliding");
        if let Some(value) = other.values.get_mut(self.leading) {
            *value *= if inverse { 1.0 / factor } else { factor };
        }
        other
    }

    /// Would a person believe these values of a real machine? Visibility alone would make a soft bristle of a friction
    /// that is too weak to be seen.
    pub(super) fn is_plausible(&self, rig: &Rig) -> bool {
        let s = scales(rig);
        let friction =
            rig.values.iter().filter(|(key, _)| key.starts_with("coulomb")).map(|(_, v)| *v).fold(0.0, f64::max);
        let value = self.get(self.leading).abs();
        match self.id {
            "presliding" => value > friction / (0.1 * s.angle),
            "friction_asymmetry" => value < 0.8 * friction,
            "stribeck_friction" => value < 4.0 * friction,
            "coulomb_friction" | "torque_offset" => value < 0.4 * s.torque,
            "load_friction" | "payload_step" => value < 0.4,
            "parallel_spring" => value < s.torque / s.angle,
            "backlash" | "encoder_eccentricity" => value < 0.15 * s.angle,
            "torque_limit" => value > 0.05 * s.torque,
            "friction_drift" => value < 0.3,
            "actuator_lag" | "transport_delay" | "sensor_lag" | "sensor_delay" => (0.000_5..0.08).contains(&value),
            "clock_skew" => value < 0.05,
            "sensor_scale" => value < 0.3,
            "base_vibration" => value < 5.0,
            _ => true,
        }
    }

    /// The part of the inertia that moves to the motor.
    pub(super) fn rotor(&self) -> f64 {
        self.get("rotor_inertia")
    }

    /// Acts on the machine.
    pub(super) fn apply(&self, machine: &mut Machine) {
        match self.id {
            "base_vibration" => machine.shaken = [self.get("acceleration"), self.get("hz"), self.get("phase")],
            "payload_step" => machine.payload = [self.get("fraction"), self.get("time")],
            _ => {}
        }
        let stiff = self.rotor() * 900.0 * 900.0;
        let Some(joint) = machine.joints.get_mut(self.index) else { return };
        match self.id {
            "coulomb_friction" => joint.coulomb += self.get("coulomb"),
            "friction_drift" => joint.drift = self.get("rate"),
            "friction_asymmetry" => joint.difference = self.get("difference"),
            "stribeck_friction" => (joint.extra, joint.fade) = (self.get("extra"), self.get("velocity")),
            "load_friction" => joint.load = self.get("coefficient"),
            "quadratic_drag" => joint.quadratic = self.get("quadratic"),
            "presliding" => joint.bristle = self.get("stiffness"),
            "parallel_spring" => joint.spring = [self.get("stiffness"), self.get("rest")],
            "torque_offset" => joint.offset = self.get("torque"),
            "torque_ripple" => joint.ripple = [self.get("amplitude"), self.get("order"), self.get("phase")],
            "joint_elasticity" => {
                (joint.drive.stiffness, joint.drive.damping) = (self.get("stiffness"), self.get("damping"))
            }
            "backlash" => {
                // Beyond the gap a spring that resonates at 140 Hz with the rotor, well damped.
                joint.drive.gap = self.get("gap");
                joint.drive.stiffness = stiff;
                joint.drive.damping = 900.0 * self.rotor();
            }
            "external_push" => joint.push = [self.get("impulse"), self.get("time"), 0.02],
            "torque_limit" => joint.limit = self.get("limit"),
            "actuator_lag" => joint.lag_s = self.get("time_constant"),
            "transport_delay" => joint.delay_s = self.get("delay"),
            "magnet_detent" => joint.detent = [self.get("depth"), self.get("centre"), self.get("width")],
            _ => {}
        }
    }

    /// Acts on the reading of sensor `index`.
    pub(super) fn read(&self, index: usize, reading: &mut Reading) {
        if index != self.index {
            return;
        }
        match self.id {
            "sensor_lag" => reading.lag_s = self.get("time_constant"),
            "sensor_delay" => reading.delay_s = self.get("delay"),
            "sensor_bias" => reading.bias = self.get("bias"),
            "sensor_drift" => reading.drift = self.get("rate"),
            "encoder_eccentricity" => reading.eccentric = [self.get("amplitude"), self.get("phase")],
            "lost_counts" => reading.lost = [self.get("step"), self.get("time")],
            "clock_skew" => reading.skew = self.get("skew"),
            "sensor_scale" => reading.scale = self.get("scale"),
            _ => {}
        }
    }
}
