//! What is hidden: how an effect of the contract, or one outside it, acts in the generator's own machine. What is drawn
//! stands in `draw`. RT: no.

use std::collections::BTreeMap;

use super::draw::scales;
use super::machine::{Machine, Mode};
use super::rig::{Kind, Rig};

/// How long a push lasts, s; its instant is the middle (contract section 3).
pub(super) const PUSH_S: f64 = 0.02;

/// One hidden effect.
#[derive(Debug, Clone)]
pub(super) struct Effect {
    /// Id of the contract, or the private name of something outside it.
    pub id: &'static str,
    /// Place.
    pub at: String,
    /// Joint or sensor it acts on; the leg of a leg's own effect; [`NONE`] at the ground.
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

/// Index of an effect that acts at no joint and no sensor.
pub(super) const NONE: usize = usize::MAX;

/// Stiffness of a spring that is none, Nm/rad.
const SOFT: f64 = 1e-6;

/// Families outside the library.
pub(super) const OUTSIDE: [&str; 3] = ["magnet_detent", "base_vibration", "payload_step"];

impl Effect {
    fn get(&self, key: &str) -> f64 {
        self.values.get(key).copied().unwrap_or(0.0)
    }

    /// Is it outside the library?
    pub(super) fn is_outside(&self) -> bool {
        OUTSIDE.contains(&self.id)
    }

    /// The same in the other sense, where it has one.
    pub(super) fn turned(&self) -> Option<Self> {
        let signed = matches!(
            self.id,
            "torque_offset" | "friction_asymmetry" | "sensor_bias" | "ground_slope" | "counterweight" | "sensor_drift"
        );
        let mut other = self.clone();
        *other.values.get_mut(self.leading)? *= -1.0;
        signed.then_some(other)
    }

    /// Stronger by this factor. Springs, limits and bristles hide more the stiffer they are.
    pub(super) fn stronger(&self, factor: f64) -> Self {
        let mut other = self.clone();
        let inverse =
            matches!(self.id, "joint_elasticity" | "torque_limit" | "presliding" | "foot_slip" | "toe_compliance");
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
            "parallel_spring" => value < s.torque / s.angle || rig.kind == Kind::Biped,
            "backlash" | "encoder_eccentricity" => value < 0.15 * s.angle,
            "torque_limit" => value > 0.05 * s.torque,
            "friction_drift" => value < 0.3,
            "actuator_lag" | "transport_delay" | "sensor_lag" | "sensor_delay" => (0.000_5..0.08).contains(&value),
            "clock_skew" => value < 0.05,
            "sensor_scale" => value < 0.3,
            "base_vibration" => value < 5.0,
            "link_flexibility" => (0.01..0.5).contains(&value),
            "foot_slip" => (0.03..1.0).contains(&value),
            "elastic_impact" => value < 0.6,
            // The foot sinks in by less than a centimetre and a half under the standing robot.
            "toe_compliance" => value > 1e4,
            "ground_slope" => value < 0.06,
            "counterweight" => value < 50.0,
            "round_foot" => value < 0.25,
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
            "link_flexibility" => self.bend(machine),
            "counterweight" | "foot_slip" | "elastic_impact" | "toe_compliance" | "ground_slope" | "round_foot" => {
                self.apply_to_ground(machine);
            }
            // A spring between a leg and the ground: the biped's joint is its hip.
            "parallel_spring" if self.is_at_leg() => {
                machine.setup_springs.push((self.index, self.get("stiffness"), self.get("rest")));
                return;
            }
            // A soft spring that rests far away.
            "torque_offset" if self.is_at_leg() => {
                machine.setup_springs.push((self.index, SOFT, self.get("torque") / SOFT));
                return;
            }
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
            "external_push" => joint.push = [self.get("impulse"), self.get("time") - 0.5 * PUSH_S, PUSH_S],
            "torque_limit" => joint.limit = self.get("limit"),
            "actuator_lag" => joint.lag_s = self.get("time_constant"),
            "transport_delay" => joint.delay_s = self.get("delay"),
            "magnet_detent" => joint.detent = [self.get("depth"), self.get("centre"), self.get("width")],
            _ => {}
        }
    }

    fn is_at_leg(&self) -> bool {
        matches!(self.at.as_str(), "inner" | "outer")
    }

    /// A share of the link hangs on a spring of its own.
    fn bend(&self, machine: &mut Machine) {
        let inertia = self.get("participation") * self.get("whole");
        let omega = std::f64::consts::TAU * self.get("frequency");
        let along = match (self.index, self.at.as_str()) {
            (0, _) => [1.0, 0.0],
            // Link 2 turns by the sum of both angles, a leg by its own.
            (_, "q2") => [1.0, 1.0],
            _ => [0.0, 1.0],
        };
        let damping = 2.0 * self.get("damping") * omega * inertia;
        machine.mode = Mode { along, inertia, stiffness: inertia * omega * omega, damping };
    }

    fn apply_to_ground(&self, machine: &mut Machine) {
        let Some(ground) = machine.ground.as_mut() else {
            // Only the counterweight acts on a pinned robot.
            if let Some((_, moment)) = machine.lifted.as_mut() {
                *moment += self.get("force") * self.get("lever");
            }
            return;
        };
        match self.id {
            "counterweight" => ground.lifted_n = self.get("force"),
            "foot_slip" => ground.friction = self.get("friction"),
            "elastic_impact" => ground.restitution = self.get("restitution"),
            "toe_compliance" => ground.spring = [self.get("stiffness"), self.get("damping")],
            "ground_slope" => ground.slope = self.get("slope"),
            _ => ground.radius_m = self.get("radius"),
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
