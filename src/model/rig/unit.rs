//! The unit of a number of a rig, for people. RT: no.

use super::{MechanismKind, Rig, Scope, Sensor, Slot};
use crate::model::effect::EffectKind;

/// What the catalogue says of a number that is counted as its sensor reads.
const OF_THE_READING: &str = "unit of the reading";
/// The same per second.
const OF_THE_READING_PER_S: &str = "unit of the reading/s";

impl Rig {
    /// Unit of the number at `slot`; empty for a pure number.
    #[must_use]
    pub fn unit(&self, slot: Slot) -> &'static str {
        match slot {
            Slot::Parameter(scope, i) => {
                let index = match scope {
                    Scope::Rig => Some(i),
                    Scope::Recording(r) => {
                        self.recordings.get(r).and_then(|entry| entry.parameters.get(i)).map(|(index, _)| *index)
                    }
                };
                index.and_then(|i| self.mechanism.parameters().get(i)).map_or("", |info| named_unit(info.name))
            }
            Slot::Gain(_) if self.is_straight() => "N per unit of the column",
            Slot::Gain(_) => "Nm per unit of the column",
            Slot::BackEmf(_) if self.is_straight() => "N s/m",
            Slot::BackEmf(_) => "Nm s/rad",
            Slot::Effect(scope, e, k) => {
                self.effects_of(scope).get(e).map_or("", |effect| self.effect_unit(effect.kind, &effect.at, k))
            }
        }
    }

    /// Unit of key `k` of an effect at `at`; empty for a pure number.
    #[must_use]
    pub fn effect_unit(&self, kind: EffectKind, at: &str, k: usize) -> &'static str {
        let Some(key) = kind.keys().get(k) else { return "" };
        let reading = || self.sensors.iter().find(|s| s.column == at).map(|s| s.unit(self.mechanism));
        match key.unit {
            "1" => "",
            OF_THE_READING => reading().unwrap_or(""),
            OF_THE_READING_PER_S => per_second(reading().unwrap_or("")),
            unit if self.is_straight() && key.name != "phase" => along_a_line(unit),
            unit => unit,
        }
    }

    /// True if its coordinates are positions, not angles.
    fn is_straight(&self) -> bool {
        self.mechanism == MechanismKind::Slider
    }
}

impl Sensor {
    /// Unit of its readings.
    #[must_use]
    pub fn unit(&self, mechanism: MechanismKind) -> &'static str {
        match (mechanism == MechanismKind::Slider, self.is_rate) {
            (false, false) => "rad",
            (false, true) => "rad/s",
            (true, false) => "m",
            (true, true) => "m/s",
        }
    }
}

fn per_second(unit: &str) -> &'static str {
    match unit {
        "rad" => "rad/s",
        "rad/s" => "rad/s²",
        "m" => "m/s",
        "m/s" => "m/s²",
        _ => "",
    }
}

/// The unit of a joint that turns, for one that slides.
fn along_a_line(unit: &'static str) -> &'static str {
    match unit {
        "Nm" => "N",
        "Nm s" => "N s",
        "Nm/rad" => "N/m",
        "Nm s/rad" => "N s/m",
        "Nm s²/rad²" => "N s²/m²",
        "rad" => "m",
        "rad/s" => "m/s",
        "kg m²" => "kg",
        other => other,
    }
}

/// The unit at the end of a parameter's name.
fn named_unit(name: &str) -> &'static str {
    // Longer ends first: "_kg_m2" ends in "_m2".
    const ENDS: [(&str, &str); 6] =
        [("_kg_m2", "kg m²"), ("_kg_m", "kg m"), ("_m_s2", "m/s²"), ("_nm", "Nm"), ("_kg", "kg"), ("_m", "m")];
    ENDS.iter().find(|(end, _)| name.ends_with(end)).map_or("", |(_, unit)| unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig(mechanism: &str, parameters: &str) -> Rig {
        let text = format!(
            "schema = 1\nmechanism = \"{mechanism}\"\n[parameters]\n{parameters}\n[[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\n\
             gain = 1.0\n[[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\n[[sensor]]\nmeasures = \"q1_rate\"\ncolumn = \"w\"\n"
        );
        Rig::parse(&text, "rig.toml").unwrap()
    }

    #[test]
    fn a_number_has_the_unit_of_its_joint_or_of_its_reading() {
        let turning = rig("pendulum", "inertia_kg_m2 = 1.0\ngravity_nm = 1.0");
        assert_eq!(turning.unit(Slot::Parameter(Scope::Rig, 0)), "kg m²");
        assert_eq!(turning.effect_unit(EffectKind::QuadraticDrag, "q1", 0), "Nm s²/rad²");
        assert_eq!(turning.effect_unit(EffectKind::SensorBias, "w", 0), "rad/s");
        assert_eq!(turning.effect_unit(EffectKind::SensorScale, "w", 0), "");
        let sliding = rig("slider", "mass_kg = 1.0");
        assert_eq!(sliding.unit(Slot::Parameter(Scope::Rig, 0)), "kg");
        assert_eq!(sliding.effect_unit(EffectKind::QuadraticDrag, "q1", 0), "N s²/m²");
        assert_eq!(sliding.effect_unit(EffectKind::SensorDrift, "y", 0), "m/s");
        assert_eq!(sliding.effect_unit(EffectKind::TorqueRipple, "q1", 2), "rad", "a phase is an angle everywhere");
    }

    #[test]
    fn no_key_of_a_turning_joint_keeps_its_unit_on_a_slider() {
        let sliding = rig("slider", "mass_kg = 1.0");
        for kind in EffectKind::ALL {
            for (k, key) in kind.keys().iter().enumerate().filter(|(_, key)| key.name != "phase") {
                let unit = sliding.effect_unit(*kind, "y", k);
                assert!(!unit.contains("rad") && !unit.contains("Nm"), "{kind}.{}: {unit}", key.name);
            }
        }
    }

    #[test]
    fn every_parameter_with_a_unit_in_its_name_has_one() {
        for mechanism in MechanismKind::ALL {
            for info in mechanism.parameters().iter().filter(|info| info.name.contains('_')) {
                assert_ne!(named_unit(info.name), "", "{}", info.name);
            }
        }
    }
}
