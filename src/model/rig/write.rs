//! Writes a rig as TOML that parses to the same rig. RT: no.

use super::{Actuator, Effect, Numerics, RecordingEntry, Rig, Sensor, Side, Use, Value};

impl Rig {
    /// The rig as the text of a rig file.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let mut out = format!("schema = 1\nname = {}\nmechanism = \"{}\"\n", quoted(&self.name), self.mechanism.id());
        if self.numerics != Numerics::default() {
            out.push_str("\n[numerics]\n");
        }
        let Numerics { euler_step_s, smooth_rate, soft_friction_s } = self.numerics;
        let numerics =
            [("euler_step_s", euler_step_s), ("smooth_rate", smooth_rate), ("soft_friction_s", soft_friction_s)];
        for (key, value) in numerics {
            value.iter().for_each(|value| line(&mut out, key, &float(*value)));
        }
        out.push_str("\n[parameters]\n");
        for (info, value) in self.mechanism.parameters().iter().zip(&self.parameters) {
            line(&mut out, info.name, &number(value));
        }
        self.actuators.iter().for_each(|a| self.write_actuator(&mut out, a));
        self.sensors.iter().for_each(|s| self.write_sensor(&mut out, s));
        for effect in &self.effects {
            out.push_str("\n[[effect]]\n");
            effect_fields(effect).iter().for_each(|(key, text)| line(&mut out, key, text));
        }
        self.recordings.iter().for_each(|r| self.write_recording(&mut out, r));
        out
    }

    fn write_actuator(&self, out: &mut String, actuator: &Actuator) {
        out.push_str("\n[[actuator]]\n");
        line(out, "joint", &quoted(self.mechanism.coordinates()[actuator.joint]));
        line(out, "column", &quoted(&actuator.column));
        line(out, "gain", &number(&actuator.gain));
        if let Some(column) = &actuator.enable_column {
            line(out, "enable_column", &quoted(column));
        }
        if let Some(back_emf) = &actuator.back_emf {
            line(out, "back_emf", &number(back_emf));
        }
    }

    fn write_sensor(&self, out: &mut String, sensor: &Sensor) {
        out.push_str("\n[[sensor]]\n");
        let rate = if sensor.is_rate { "_rate" } else { "" };
        line(out, "measures", &format!("\"{}{rate}\"", self.mechanism.coordinates()[sensor.joint]));
        if sensor.side == Side::Motor {
            line(out, "side", "\"motor\"");
        }
        line(out, "column", &quoted(&sensor.column));
        if let Some(std) = sensor.noise_std {
            line(out, "noise_std", &float(std));
        }
        if sensor.quantum > 0.0 {
            line(out, "quantum", &float(sensor.quantum));
        }
    }

    fn write_recording(&self, out: &mut String, entry: &RecordingEntry) {
        out.push_str("\n[[recording]]\n");
        line(out, "file", &quoted(&entry.file));
        line(out, "use", if entry.usage == Use::Fit { "\"fit\"" } else { "\"heldout\"" });
        if let Some(window_s) = entry.window_s {
            line(out, "window_s", &float(window_s));
        }
        if let Some(setup) = entry.setup {
            line(out, "setup", &format!("\"{}\"", setup.id()));
        }
        if let Some(column) = &entry.stance_column {
            line(out, "stance_column", &quoted(column));
        }
        if let Some([inner, outer]) = &entry.toe_columns {
            line(out, "toe_columns", &format!("[{}, {}]", quoted(inner), quoted(outer)));
        }
        if let Some(column) = &entry.window_column {
            line(out, "window_column", &quoted(column));
        }
        if !entry.parameters.is_empty() {
            let fields: Vec<String> = entry
                .parameters
                .iter()
                .map(|(i, value)| format!("{} = {}", self.mechanism.parameters()[*i].name, number(value)))
                .collect();
            line(out, "parameters", &format!("{{ {} }}", fields.join(", ")));
        }
        if !entry.effects.is_empty() {
            let tables: Vec<String> = entry.effects.iter().map(inline_effect).collect();
            line(out, "effects", &format!("[ {} ]", tables.join(", ")));
        }
    }
}

fn inline_effect(effect: &Effect) -> String {
    let fields: Vec<String> = effect_fields(effect).iter().map(|(key, text)| format!("{key} = {text}")).collect();
    format!("{{ {} }}", fields.join(", "))
}

fn effect_fields(effect: &Effect) -> Vec<(&'static str, String)> {
    let mut fields = vec![("effect", quoted(effect.kind.id())), ("at", quoted(&effect.at))];
    fields.extend(effect.kind.keys().iter().zip(&effect.values).map(|(key, value)| (key.name, number(value))));
    if effect.side == Side::Motor {
        fields.push(("side", quoted("motor")));
    }
    if let Some(setup) = effect.setup {
        fields.push(("setup", quoted(setup.id())));
    }
    if !effect.recordings.is_empty() {
        let names: Vec<String> = effect.recordings.iter().map(|r| quoted(r)).collect();
        fields.push(("recordings", format!("[{}]", names.join(", "))));
    }
    fields
}

fn line(out: &mut String, key: &str, text: &str) {
    for part in [key, " = ", text, "\n"] {
        out.push_str(part);
    }
}

fn number(value: &Value) -> String {
    match value.bounds {
        None => format!("{{ value = {} }}", float(value.value)),
        Some(b) => format!("{{ value = {}, min = {}, max = {} }}", float(value.value), float(b.min), float(b.max)),
    }
}

/// Shortest text that reads back to the same bits, always as a TOML float.
fn float(x: f64) -> String {
    if x.is_infinite() {
        return if x > 0.0 { "inf".to_owned() } else { "-inf".to_owned() };
    }
    format!("{x:?}")
}

fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}
