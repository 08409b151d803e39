//! Reads a rig file strictly: unknown keys, wrong types and impossible values are errors with their line, all at once.
//!
//! `fields` takes keys and values out of tables, `entries` reads effects and recordings, the rest of a rig is here.
//! RT: no.

mod entries;
mod fields;

use super::{Actuator, MechanismKind, Numerics, Rig, Sensor, Side, Value};
use fields::{Fields, Reader};
use std::fmt;
use std::ops::{Range, RangeInclusive};
use toml::Spanned;
use toml::de::DeTable;

/// One thing that is wrong with a rig file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RigError {
    /// File as given.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// Key or table concerned; empty if the text is no TOML.
    pub key: String,
    /// What is wrong and what would be right.
    pub message: String,
}

/// Everything that is wrong with a rig file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub struct RigErrors(pub Vec<RigError>);

impl fmt::Display for RigErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, e) in self.0.iter().enumerate() {
            let end = if i + 1 < self.0.len() { "\n" } else { "" };
            let key = if e.key.is_empty() { String::new() } else { format!("`{}`: ", e.key) };
            write!(f, "{}:{}: {key}{}{end}", e.file, e.line, e.message)?;
        }
        Ok(())
    }
}

impl Rig {
    /// Reads the text of a rig file; `file` is its name for messages.
    ///
    /// # Errors
    /// Everything that is wrong, each with its line.
    pub fn parse(text: &str, file: &str) -> Result<Self, RigErrors> {
        let mut reader = Reader { text, file, errors: Vec::new() };
        let rig = match DeTable::parse(text) {
            Ok(table) => {
                let span = table.span();
                reader.rig(Fields::new(table.into_inner(), span, "rig"))
            }
            Err(error) => {
                let message = format!("not TOML: {}", error.message().replace('\n', ", "));
                reader.complain(&error.span().unwrap_or(0..0), "", message);
                None
            }
        };
        match rig {
            Some(rig) if reader.errors.is_empty() => Ok(rig),
            _ => {
                reader.errors.sort_by_key(|e| e.line);
                Err(RigErrors(reader.errors))
            }
        }
    }
}

/// Rates within which friction may change its sign, rad/s or m/s.
const SMOOTH_RATE: RangeInclusive<f64> = 1e-5..=1.0;

/// Time constants that friction may have as a soft constraint, s.
const SOFT_FRICTION_S: RangeInclusive<f64> = 1e-3..=1.0;

impl Reader<'_> {
    fn rig(&mut self, mut fields: Fields<'_>) -> Option<Rig> {
        self.schema(&mut fields);
        let name = self.optional_string(&mut fields, "name").map(|(n, _)| n).unwrap_or_default();
        let mechanism = self.mechanism(&mut fields)?;
        let mut rig = Rig {
            name,
            mechanism,
            numerics: self.numerics(&mut fields),
            parameters: Vec::new(),
            actuators: Vec::new(),
            sensors: Vec::new(),
            effects: Vec::new(),
            recordings: Vec::new(),
        };
        rig.parameters = self.parameters(&mut fields, mechanism);
        for table in self.distinct(&mut fields, "actuator", "[[actuator]]", "column") {
            let actuator = self.actuator(table, mechanism);
            rig.actuators.extend(actuator);
        }
        for table in self.distinct(&mut fields, "sensor", "[[sensor]]", "column") {
            let sensor = self.sensor(table, mechanism);
            rig.sensors.extend(sensor);
        }
        let mut spans = Vec::new();
        for table in self.tables(&mut fields, "effect", "[[effect]]") {
            let span = table.span.clone();
            if let Some(effect) = self.effect(table, &rig, true) {
                rig.effects.push(effect);
                spans.push(span);
            }
        }
        for table in self.distinct(&mut fields, "recording", "[[recording]]", "file") {
            let entry = self.recording(table, &rig);
            rig.recordings.extend(entry);
        }
        self.recordings_exist(&rig, &spans);
        self.finish(fields, "schema, name, mechanism, numerics, parameters, actuator, sensor, effect, recording");
        Some(rig)
    }

    fn schema(&mut self, fields: &mut Fields<'_>) {
        let Some(item) = self.required(fields, "schema") else { return };
        let schema = self.float("schema", &item);
        if schema.is_some_and(|s| s.to_bits() != 1.0_f64.to_bits()) {
            self.complain(&item.span(), "schema", "must be 1, the only one this program reads");
        }
    }

    fn mechanism(&mut self, fields: &mut Fields<'_>) -> Option<MechanismKind> {
        let (id, span) = self.required_string(fields, "mechanism")?;
        let kind = MechanismKind::from_id(&id);
        if kind.is_none() {
            let known: Vec<&str> = MechanismKind::ALL.iter().map(|m| m.id()).collect();
            self.complain(&span, "mechanism", format!("`{id}` is not one of {}", known.join(", ")));
        }
        kind
    }

    fn numerics(&mut self, fields: &mut Fields<'_>) -> Numerics {
        let Some(item) = fields.take("numerics") else { return Numerics::default() };
        let Some(mut fields) = self.table(item, "numerics", "[numerics]") else { return Numerics::default() };
        let soft = fields.table.get("soft_friction_s").map(Spanned::span);
        let numerics = Numerics {
            euler_step_s: self.within(&mut fields, "euler_step_s", Numerics::EULER_STEP_S),
            smooth_rate: self.within(&mut fields, "smooth_rate", SMOOTH_RATE),
            soft_friction_s: self.within(&mut fields, "soft_friction_s", SOFT_FRICTION_S),
        };
        if let Some(span) = soft.filter(|_| numerics.smooth_rate.is_some()) {
            self.complain(
                &span,
                "soft_friction_s",
                "stands beside smooth_rate; friction has one form, give one of them",
            );
        }
        self.finish(fields, "euler_step_s, smooth_rate, soft_friction_s");
        numerics
    }

    fn within(&mut self, fields: &mut Fields<'_>, key: &str, range: RangeInclusive<f64>) -> Option<f64> {
        let at = fields.table.get(key).map(Spanned::span)?;
        let value = self.optional_float(fields, key, 0.0)?;
        if !range.contains(&value) {
            self.complain(&at, key, format!("is {value}, must be from {} to {}", range.start(), range.end()));
        }
        Some(value)
    }

    fn parameters(&mut self, fields: &mut Fields<'_>, mechanism: MechanismKind) -> Vec<Value> {
        let Some(item) = self.required(fields, "parameters") else { return Vec::new() };
        let Some(mut fields) = self.table(item, "parameters", "[parameters]") else { return Vec::new() };
        let mut out = Vec::new();
        for info in mechanism.parameters() {
            let at = fields.table.get(info.name).map_or(fields.span.clone(), Spanned::span);
            let value = self.required_value(&mut fields, info.name);
            if let Some(value) = value {
                self.positive(&at, info.name, info.positive, value);
                out.push(value);
            }
        }
        self.finish(fields, &parameter_names(mechanism));
        out
    }

    fn positive(&mut self, span: &Range<usize>, key: &str, positive: bool, value: Value) {
        let low = value.bounds.map_or(value.value, |b| b.min);
        if positive && low <= 0.0 {
            self.complain(span, key, format!("is {low}, must be above 0, its `min` too"));
        }
    }

    fn joint(&mut self, key: &str, name: &str, span: &Range<usize>, mechanism: MechanismKind) -> Option<usize> {
        let index = mechanism.coordinate_index(name);
        if index.is_none() {
            let known = mechanism.coordinates().join(", ");
            self.complain(span, key, format!("`{name}` is no coordinate of {}: {known}", mechanism.id()));
        }
        index
    }

    fn actuator(&mut self, mut fields: Fields<'_>, mechanism: MechanismKind) -> Option<Actuator> {
        let joint = self.required_string(&mut fields, "joint");
        let column = self.required_string(&mut fields, "column");
        let gain = self.required_value(&mut fields, "gain");
        let enable_column = self.optional_string(&mut fields, "enable_column").map(|(c, _)| c);
        let back_emf = fields.take("back_emf").and_then(|i| self.value("back_emf", i));
        self.finish(fields, "joint, column, gain, enable_column, back_emf");
        let (joint, span) = joint?;
        let joint = self.joint("joint", &joint, &span, mechanism)?;
        if mechanism == MechanismKind::CompassGait && mechanism.coordinates()[joint] != "hip" {
            self.complain(&span, "joint", "the compass gait is driven at `hip` only");
        }
        Some(Actuator { joint, column: column?.0, gain: gain?, enable_column, back_emf })
    }

    fn sensor(&mut self, mut fields: Fields<'_>, mechanism: MechanismKind) -> Option<Sensor> {
        let measures = self.required_string(&mut fields, "measures");
        let column = self.required_string(&mut fields, "column");
        let side = self.side(&mut fields);
        let noise_std = self.optional_float(&mut fields, "noise_std", 0.0);
        let quantum = self.optional_float(&mut fields, "quantum", 0.0).unwrap_or(0.0);
        self.finish(fields, "measures, side, column, noise_std, quantum");
        let (measures, span) = measures?;
        let rate_of = measures.strip_suffix("_rate");
        let joint = self.joint("measures", rate_of.unwrap_or(&measures), &span, mechanism)?;
        Some(Sensor { joint, is_rate: rate_of.is_some(), side, column: column?.0, noise_std, quantum })
    }

    fn side(&mut self, fields: &mut Fields<'_>) -> Side {
        match self.optional_string(fields, "side") {
            Some((side, _)) if side == "motor" => Side::Motor,
            Some((side, span)) if side != "link" => {
                self.complain(&span, "side", format!("`{side}` is neither \"link\" nor \"motor\""));
                Side::Link
            }
            _ => Side::Link,
        }
    }

    /// The tables of `[[key]]`, of which no two may have the same name.
    fn distinct<'a>(&mut self, fields: &mut Fields<'a>, key: &str, table: &str, name: &str) -> Vec<Fields<'a>> {
        let tables = self.tables(fields, key, table);
        let mut known: Vec<String> = Vec::new();
        for fields in &tables {
            let Some(item) = fields.table.get(name) else { continue };
            let Some(text) = item.get_ref().as_str().map(str::to_owned) else { continue };
            if known.contains(&text) {
                self.complain(&item.span(), name, format!("`{text}` is named twice"));
            }
            known.push(text);
        }
        tables
    }
}

fn parameter_names(mechanism: MechanismKind) -> String {
    mechanism.parameters().iter().map(|p| p.name).collect::<Vec<_>>().join(", ")
}
