//! The effects that a rig may have, as data: id, where each may stand, its keys with unit, bounds and vanishing point.
//!
//! The ids and keys are those of the diagnosis contract, schema 1; they are never renamed.
//! RT: yes.

use std::fmt;

/// What kind of place an effect stands at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SiteKind {
    /// A coordinate of the mechanism.
    Joint,
    /// An actuator, named by its column.
    Actuator,
    /// A sensor, named by its column.
    Sensor,
    /// The literal `ground`; only where a mechanism stands on it.
    Ground,
}

/// What a key of an effect does when it is made small.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Role {
    /// The effect grows from this value and is absent at it (0, or 1 for a scale).
    Strength(f64),
    /// The effect is absent at infinity: a stiffness, a limit. Search over its inverse.
    Inverse,
    /// Shapes the effect without switching it off: a velocity, a phase, a time.
    Shape,
}

/// One number of an effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// As in the rig file.
    pub name: &'static str,
    /// SI of the joint: `Nm` stands for N, and `rad` for m, on a slider.
    pub unit: &'static str,
    /// What it does when small.
    pub role: Role,
    /// Smallest value that means anything.
    pub min: f64,
    /// Largest value that means anything.
    pub max: f64,
}

impl Key {
    /// True if the effect can have this value. A phase is the same after every turn.
    #[must_use]
    pub fn allows(&self, value: f64) -> bool {
        self.name == "phase" || (self.min..=self.max).contains(&value)
    }
}

const fn strength(name: &'static str, unit: &'static str, min: f64, max: f64) -> Key {
    Key { name, unit, role: Role::Strength(0.0), min, max }
}
const fn inverse(name: &'static str, unit: &'static str) -> Key {
    Key { name, unit, role: Role::Inverse, min: 0.0, max: INF }
}
const fn shape(name: &'static str, unit: &'static str, min: f64, max: f64) -> Key {
    Key { name, unit, role: Role::Shape, min, max }
}
const INF: f64 = f64::INFINITY;
const TURN: f64 = std::f64::consts::TAU;

macro_rules! effects {
    ($($(#[$doc:meta])* $variant:ident $id:literal $site:ident [$($key:expr),* $(,)?];)*) => {
        /// A physical effect beyond the bare mechanism (contract section 3).
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum EffectKind { $($(#[$doc])* $variant,)* }

        impl EffectKind {
            /// All of them, in the order of the contract.
            pub const ALL: &'static [Self] = &[$(Self::$variant),*];

            /// Its name in files.
            #[must_use]
            pub const fn id(self) -> &'static str {
                match self { $(Self::$variant => $id),* }
            }
            /// Where it may stand.
            #[must_use]
            pub const fn site(self) -> SiteKind {
                match self { $(Self::$variant => SiteKind::$site),* }
            }
            /// Its numbers, in the order of the contract.
            #[must_use]
            pub const fn keys(self) -> &'static [Key] {
                match self { $(Self::$variant => const { &[$($key),*] }),* }
            }
        }
    };
}

effects! {
    /// -viscous · rate.
    ViscousFriction "viscous_friction" Joint [strength("viscous", "Nm s/rad", 0.0, INF)];
    /// -coulomb · sign of the rate, with true sticking.
    CoulombFriction "coulomb_friction" Joint [strength("coulomb", "Nm", 0.0, INF)];
    /// Coulomb level + difference forwards, - difference backwards.
    FrictionAsymmetry "friction_asymmetry" Joint [strength("difference", "Nm", -INF, INF)];
    /// extra · exp(-(rate/velocity)²) on top of Coulomb.
    StribeckFriction "stribeck_friction" Joint
        [strength("extra", "Nm", 0.0, INF), shape("velocity", "rad/s", 1e-4, INF)];
    /// Coulomb level that grows with the transmitted torque.
    LoadFriction "load_friction" Joint [strength("coefficient", "1", 0.0, 1.0)];
    /// -quadratic · rate · abs rate.
    QuadraticDrag "quadratic_drag" Joint [strength("quadratic", "Nm s²/rad²", 0.0, INF)];
    /// Elastic displacement before breakaway.
    Presliding "presliding" Joint [inverse("stiffness", "Nm/rad")];
    /// The Coulomb level changes by this fraction per second.
    FrictionDrift "friction_drift" Joint [strength("rate", "1/s", -1.0, 1.0)];
    /// -stiffness · (q - rest).
    ParallelSpring "parallel_spring" Joint
        [strength("stiffness", "Nm/rad", 0.0, INF), shape("rest", "rad", -INF, INF)];
    /// A constant torque.
    TorqueOffset "torque_offset" Joint [strength("torque", "Nm", -INF, INF)];
    /// amplitude · sin(order · q + phase).
    TorqueRipple "torque_ripple" Joint [
        strength("amplitude", "Nm", -INF, INF),
        shape("order", "1", 0.0, 1e4),
        shape("phase", "rad", -TURN, TURN),
    ];
    /// Motor and link joined by a spring.
    JointElasticity "joint_elasticity" Joint [
        inverse("stiffness", "Nm/rad"),
        shape("damping", "Nm s/rad", 0.0, INF),
        shape("rotor_inertia", "kg m²", 0.0, INF),
    ];
    /// Full play between motor and link.
    Backlash "backlash" Joint [strength("gap", "rad", 0.0, 1.0), shape("rotor_inertia", "kg m²", 0.0, INF)];
    /// A structural mode beyond the joint.
    LinkFlexibility "link_flexibility" Joint [
        shape("frequency", "Hz", 0.1, 1e3),
        shape("damping", "1", 0.0, 2.0),
        strength("participation", "1", 0.0, 0.9),
    ];
    /// One disturbance.
    ExternalPush "external_push" Joint [strength("impulse", "Nm s", -INF, INF), shape("time", "s", -INF, INF)];
    /// Saturation of the applied torque.
    TorqueLimit "torque_limit" Actuator [inverse("limit", "Nm")];
    /// First-order lag of the torque.
    ActuatorLag "actuator_lag" Actuator [strength("time_constant", "s", 0.0, 1.0)];
    /// Pure delay of the command.
    TransportDelay "transport_delay" Actuator [strength("delay", "s", 0.0, 1.0)];
    /// First-order lag of the reading.
    SensorLag "sensor_lag" Sensor [strength("time_constant", "s", 0.0, 1.0)];
    /// Pure delay of the reading.
    SensorDelay "sensor_delay" Sensor [strength("delay", "s", 0.0, 1.0)];
    /// Constant offset of the reading.
    SensorBias "sensor_bias" Sensor [strength("bias", "unit of the reading", -INF, INF)];
    /// Offset growing with time.
    SensorDrift "sensor_drift" Sensor [strength("rate", "unit of the reading/s", -INF, INF)];
    /// Reading = scale · truth.
    SensorScale "sensor_scale" Sensor
        [Key { name: "scale", unit: "1", role: Role::Strength(1.0), min: -10.0, max: 10.0 }];
    /// Once-per-turn error.
    EncoderEccentricity "encoder_eccentricity" Sensor
        [strength("amplitude", "rad", -1.0, 1.0), shape("phase", "rad", -TURN, TURN)];
    /// The reading jumps and stays.
    LostCounts "lost_counts" Sensor
        [strength("step", "unit of the reading", -INF, INF), shape("time", "s", -INF, INF)];
    /// The sensor's clock runs fast by this fraction.
    ClockSkew "clock_skew" Sensor [strength("skew", "1", -0.1, 0.1)];
    /// The stance toe slides beyond friction · normal force.
    FootSlip "foot_slip" Ground [inverse("friction", "1")];
    /// Touchdown with rebound.
    ElasticImpact "elastic_impact" Ground [strength("restitution", "1", 0.0, 1.0)];
    /// A spring along the leg at each toe.
    ToeCompliance "toe_compliance" Ground [inverse("stiffness", "N/m"), shape("damping", "N s/m", 0.0, INF)];
    /// Ground tilted, + falls towards +x.
    GroundSlope "ground_slope" Ground [strength("slope", "rad", -0.5, 0.5)];
    /// Constant upward force at the hip.
    Counterweight "counterweight" Ground [strength("force", "N", -INF, INF)];
    /// The toe is an arc that rolls on the ground.
    RoundFoot "round_foot" Ground [strength("radius", "m", 0.0, 10.0)];
}

impl EffectKind {
    /// The effect with this id.
    #[must_use]
    pub fn from_id(id: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|kind| kind.id() == id)
    }

    /// Position of the key `name` among [`Self::keys`].
    #[must_use]
    pub fn key_index(self, name: &str) -> Option<usize> {
        self.keys().iter().position(|key| key.name == name)
    }

    /// True if it may say `side = "motor"`: friction, which sits on either side of an elastic or loose joint.
    #[must_use]
    pub const fn has_side(self) -> bool {
        matches!(
            self,
            Self::ViscousFriction
                | Self::CoulombFriction
                | Self::FrictionAsymmetry
                | Self::StribeckFriction
                | Self::LoadFriction
                | Self::QuadraticDrag
                | Self::Presliding
                | Self::FrictionDrift
                | Self::TorqueRipple
        )
    }
}

impl fmt::Display for EffectKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.id())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_unique_and_found_again() {
        for &kind in EffectKind::ALL {
            assert_eq!(EffectKind::from_id(kind.id()), Some(kind));
        }
        assert_eq!(EffectKind::ALL.len(), 32);
        assert_eq!(EffectKind::from_id("unlisted"), None);
    }

    #[test]
    fn every_effect_has_a_key_that_switches_it_off() {
        for kind in EffectKind::ALL {
            assert!(kind.keys().iter().any(|key| !matches!(key.role, Role::Shape)), "{kind}");
        }
    }
}
