//! Reads a rig file strictly: unknown keys, wrong types and impossible values are errors with their line, all at once.
//!
//! RT: no.

use super::{Actuator, Bounds, Effect, MechanismKind, RecordingEntry, Rig, Sensor, Setup, Side, Use, Value};
use crate::model::effect::{EffectKind, SiteKind};
use std::fmt;
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// One thing that is wrong with a rig file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RigError {
    /// File as given.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// Key or table concerned.
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
            write!(f, "{}:{}: `{}`: {}{end}", e.file, e.line, e.key, e.message)?;
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
                reader.complain(&error.span().unwrap_or(0..0), "toml", error.message());
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

type Item<'a> = Spanned<DeValue<'a>>;

/// A table whose keys are taken one by one; what is left over is unknown.
struct Fields<'a> {
    table: DeTable<'a>,
    span: Range<usize>,
    /// How messages call the table.
    name: String,
}

impl<'a> Fields<'a> {
    fn new(table: DeTable<'a>, span: Range<usize>, name: &str) -> Self {
        Self { table, span, name: name.to_owned() }
    }
    fn take(&mut self, key: &str) -> Option<Item<'a>> {
        self.table.remove(key)
    }
}

/// Collects the complaints.
struct Reader<'t> {
    text: &'t str,
    file: &'t str,
    errors: Vec<RigError>,
}

impl Reader<'_> {
    fn complain(&mut self, span: &Range<usize>, key: &str, message: impl Into<String>) {
        let line = 1 + self.text.bytes().take(span.start).filter(|b| *b == b'\n').count();
        self.errors.push(RigError { file: self.file.to_owned(), line, key: key.to_owned(), message: message.into() });
    }

    /// Complains about the keys nobody took.
    fn finish(&mut self, fields: Fields<'_>, known: &str) {
        for (key, _) in &fields.table {
            self.complain(&key.span(), key.get_ref(), format!("unknown key in {}; known: {known}", fields.name));
        }
    }

    fn required<'a>(&mut self, fields: &mut Fields<'a>, key: &str) -> Option<Item<'a>> {
        let item = fields.take(key);
        if item.is_none() {
            let message = format!("missing in {}", fields.name);
            self.complain(&fields.span.clone(), key, message);
        }
        item
    }

    fn string(&mut self, key: &str, item: Item<'_>) -> Option<String> {
        let span = item.span();
        let text = item.into_inner().as_str().map(str::to_owned);
        if text.is_none() {
            self.complain(&span, key, "must be a text in quotes");
        }
        text
    }

    fn required_string(&mut self, fields: &mut Fields<'_>, key: &str) -> Option<(String, Range<usize>)> {
        let item = self.required(fields, key)?;
        let span = item.span();
        Some((self.string(key, item)?, span))
    }

    fn optional_string(&mut self, fields: &mut Fields<'_>, key: &str) -> Option<(String, Range<usize>)> {
        let item = fields.take(key)?;
        let span = item.span();
        Some((self.string(key, item)?, span))
    }

    fn float(&mut self, key: &str, item: &Item<'_>) -> Option<f64> {
        let number = match item.get_ref() {
            DeValue::Float(x) => parse_float(x.as_str()),
            DeValue::Integer(x) => i64::from_str_radix(x.as_str(), x.radix()).ok().map(int_to_float),
            _ => None,
        };
        match number {
            Some(x) if x.is_finite() => Some(x),
            Some(_) => {
                self.complain(&item.span(), key, "must be finite");
                None
            }
            None => {
                self.complain(&item.span(), key, "must be a number");
                None
            }
        }
    }

    fn optional_float(&mut self, fields: &mut Fields<'_>, key: &str, low: f64) -> Option<f64> {
        let item = fields.take(key)?;
        let x = self.float(key, &item)?;
        if x < low {
            self.complain(&item.span(), key, format!("is {x}, must be at least {low}"));
            return None;
        }
        Some(x)
    }

    /// `{ value, min, max }` or a bare number.
    fn value(&mut self, key: &str, item: Item<'_>) -> Option<Value> {
        let span = item.span();
        if !item.get_ref().is_table() {
            return self.float(key, &item).map(Value::known);
        }
        let mut fields = Fields::new(into_table(item)?, span.clone(), key);
        let value = self.required(&mut fields, "value").and_then(|i| self.float(key, &i));
        let min = fields.take("min").and_then(|i| self.float(key, &i));
        let max = fields.take("max").and_then(|i| self.float(key, &i));
        self.finish(fields, "value, min, max");
        let value = value?;
        match (min, max) {
            (None, None) => Some(Value::known(value)),
            (Some(min), Some(max)) if min < max && (min..=max).contains(&value) => {
                Some(Value { value, bounds: Some(Bounds { min, max }) })
            }
            (Some(min), Some(max)) => {
                self.complain(
                    &span,
                    key,
                    format!("needs min <= value <= max and min < max, got {min}, {value}, {max}"),
                );
                None
            }
            _ => {
                self.complain(&span, key, "needs both `min` and `max`, or none of them");
                None
            }
        }
    }

    fn required_value(&mut self, fields: &mut Fields<'_>, key: &str) -> Option<Value> {
        let item = self.required(fields, key)?;
        self.value(key, item)
    }

    /// The tables of `[[key]]`.
    fn tables<'a>(&mut self, fields: &mut Fields<'a>, key: &str, name: &str) -> Vec<Fields<'a>> {
        let Some(item) = fields.take(key) else { return Vec::new() };
        let span = item.span();
        let DeValue::Array(array) = item.into_inner() else {
            self.complain(&span, key, format!("must be a list of tables: [[{key}]]"));
            return Vec::new();
        };
        let mut out = Vec::new();
        for item in array {
            let span = item.span();
            match item.into_inner() {
                DeValue::Table(table) => out.push(Fields::new(table, span, name)),
                _ => self.complain(&span, key, "must be a table"),
            }
        }
        out
    }

    fn rig(&mut self, mut fields: Fields<'_>) -> Option<Rig> {
        self.schema(&mut fields);
        let name = self.optional_string(&mut fields, "name").map(|(n, _)| n).unwrap_or_default();
        let mechanism = self.mechanism(&mut fields)?;
        let mut rig = Rig {
            name,
            mechanism,
            parameters: Vec::new(),
            actuators: Vec::new(),
            sensors: Vec::new(),
            effects: Vec::new(),
            recordings: Vec::new(),
        };
        rig.parameters = self.parameters(&mut fields, mechanism);
        for table in self.tables(&mut fields, "actuator", "[[actuator]]") {
            let actuator = self.actuator(table, mechanism);
            rig.actuators.extend(actuator);
        }
        for table in self.tables(&mut fields, "sensor", "[[sensor]]") {
            let sensor = self.sensor(table, mechanism);
            rig.sensors.extend(sensor);
        }
        self.distinct_columns(&fields.span.clone(), &rig);
        for table in self.tables(&mut fields, "effect", "[[effect]]") {
            let effect = self.effect(table, &rig, true);
            rig.effects.extend(effect);
        }
        for table in self.tables(&mut fields, "recording", "[[recording]]") {
            let entry = self.recording(table, &rig);
            rig.recordings.extend(entry);
        }
        self.distinct_files(&fields.span.clone(), &rig);
        self.finish(fields, "schema, name, mechanism, parameters, actuator, sensor, effect, recording");
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

    fn parameters(&mut self, fields: &mut Fields<'_>, mechanism: MechanismKind) -> Vec<Value> {
        let Some(item) = self.required(fields, "parameters") else { return Vec::new() };
        let span = item.span();
        let Some(table) = into_table(item) else {
            self.complain(&span, "parameters", "must be a table");
            return Vec::new();
        };
        let mut fields = Fields::new(table, span, "[parameters]");
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

    fn setup(&mut self, fields: &mut Fields<'_>, mechanism: MechanismKind) -> Option<Setup> {
        let (id, span) = self.optional_string(fields, "setup")?;
        if !mechanism.has_ground() {
            self.complain(&span, "setup", "only the compass gait has set-ups");
            return None;
        }
        let setup = Setup::from_id(&id);
        if setup.is_none() {
            let known: Vec<&str> = Setup::ALL.iter().map(|s| s.id()).collect();
            self.complain(&span, "setup", format!("`{id}` is not one of {}", known.join(", ")));
        }
        setup
    }

    /// `scoped`: it may say in which set-up or recordings it acts.
    fn effect(&mut self, mut fields: Fields<'_>, rig: &Rig, scoped: bool) -> Option<Effect> {
        let (id, id_span) = self.required_string(&mut fields, "effect")?;
        let Some(kind) = EffectKind::from_id(&id) else {
            let known: Vec<&str> = EffectKind::ALL.iter().map(|k| k.id()).collect();
            self.complain(&id_span, "effect", format!("`{id}` is not one of {}", known.join(", ")));
            return None;
        };
        let at = self.required_string(&mut fields, "at");
        if let Some((at, span)) = &at {
            self.place(rig, kind, at, span);
        }
        let values: Vec<Option<Value>> =
            kind.keys().iter().map(|key| self.required_value(&mut fields, key.name)).collect();
        let side = if kind.has_side() { self.side(&mut fields) } else { Side::Link };
        let setup = if scoped { self.setup(&mut fields, rig.mechanism) } else { None };
        let recordings = if scoped { self.names(&mut fields, "recordings") } else { Vec::new() };
        let keys: Vec<&str> = kind.keys().iter().map(|key| key.name).collect();
        self.finish(fields, &format!("effect, at, {}, side (friction), setup, recordings", keys.join(", ")));
        let values = values.into_iter().collect::<Option<Vec<Value>>>()?;
        Some(Effect { kind, at: at?.0, values, side, setup, recordings })
    }

    fn place(&mut self, rig: &Rig, kind: EffectKind, at: &str, span: &Range<usize>) {
        if rig.site(kind, at).is_some() {
            return;
        }
        let what = match kind.site() {
            SiteKind::Joint => "a coordinate",
            SiteKind::Actuator => "the column of an actuator",
            SiteKind::Sensor => "the column of a sensor",
            SiteKind::Ground => "`ground`, of a mechanism that stands on it",
        };
        let places = rig.places(kind).join(", ");
        self.complain(span, "at", format!("`{at}`: {kind} stands at {what}; here: {places}"));
    }

    fn names(&mut self, fields: &mut Fields<'_>, key: &str) -> Vec<String> {
        let Some(item) = fields.take(key) else { return Vec::new() };
        let span = item.span();
        let DeValue::Array(array) = item.into_inner() else {
            self.complain(&span, key, "must be a list of texts");
            return Vec::new();
        };
        array.into_iter().filter_map(|item| self.string(key, item)).collect()
    }

    fn recording(&mut self, mut fields: Fields<'_>, rig: &Rig) -> Option<RecordingEntry> {
        let span = fields.span.clone();
        let file = self.required_string(&mut fields, "file");
        let usage = self.usage(&mut fields);
        let window_s = self.window(&mut fields);
        let setup = self.setup(&mut fields, rig.mechanism);
        if rig.mechanism.has_ground() && setup.is_none() {
            self.complain(&span, "setup", "missing: a recording of the compass gait says how it was set up");
        }
        let stance_column = self.optional_string(&mut fields, "stance_column").map(|(c, _)| c);
        let parameters = self.overrides(&mut fields, rig.mechanism);
        let mut effects = Vec::new();
        for table in self.tables(&mut fields, "effects", "effects of a recording") {
            let effect = self.effect(table, rig, false);
            effects.extend(effect);
        }
        self.finish(fields, "file, use, window_s, setup, stance_column, parameters, effects");
        Some(RecordingEntry { file: file?.0, usage: usage?, window_s, setup, stance_column, parameters, effects })
    }

    fn usage(&mut self, fields: &mut Fields<'_>) -> Option<Use> {
        let (word, span) = self.required_string(fields, "use")?;
        match word.as_str() {
            "fit" => Some(Use::Fit),
            "heldout" => Some(Use::Heldout),
            _ => {
                self.complain(&span, "use", format!("`{word}` is neither \"fit\" nor \"heldout\""));
                None
            }
        }
    }

    fn window(&mut self, fields: &mut Fields<'_>) -> Option<f64> {
        let item = fields.take("window_s")?;
        let window_s = self.float("window_s", &item)?;
        if window_s <= 0.0 {
            self.complain(&item.span(), "window_s", format!("is {window_s}, must be above 0"));
            return None;
        }
        Some(window_s)
    }

    fn overrides(&mut self, fields: &mut Fields<'_>, mechanism: MechanismKind) -> Vec<(usize, Value)> {
        let Some(item) = fields.take("parameters") else { return Vec::new() };
        let span = item.span();
        let Some(table) = into_table(item) else {
            self.complain(&span, "parameters", "must be a table");
            return Vec::new();
        };
        let mut fields = Fields::new(table, span, "parameters of a recording");
        let mut out = Vec::new();
        for (i, info) in mechanism.parameters().iter().enumerate() {
            if let Some(item) = fields.take(info.name) {
                let span = item.span();
                if let Some(value) = self.value(info.name, item) {
                    self.positive(&span, info.name, info.positive, value);
                    out.push((i, value));
                }
            }
        }
        self.finish(fields, &parameter_names(mechanism));
        out
    }

    fn distinct_columns(&mut self, span: &Range<usize>, rig: &Rig) {
        let columns: Vec<&str> = rig.sensors.iter().map(|s| s.column.as_str()).collect();
        self.distinct(span, "column", &columns);
        let columns: Vec<&str> = rig.actuators.iter().map(|a| a.column.as_str()).collect();
        self.distinct(span, "column", &columns);
    }

    fn distinct_files(&mut self, span: &Range<usize>, rig: &Rig) {
        let files: Vec<&str> = rig.recordings.iter().map(|r| r.file.as_str()).collect();
        self.distinct(span, "file", &files);
    }

    fn distinct(&mut self, span: &Range<usize>, key: &str, names: &[&str]) {
        for (i, name) in names.iter().enumerate() {
            if names[..i].contains(name) {
                self.complain(span, key, format!("`{name}` is named twice"));
            }
        }
    }
}

fn parameter_names(mechanism: MechanismKind) -> String {
    mechanism.parameters().iter().map(|p| p.name).collect::<Vec<_>>().join(", ")
}

fn into_table<'a>(item: Item<'a>) -> Option<DeTable<'a>> {
    match item.into_inner() {
        DeValue::Table(table) => Some(table),
        _ => None,
    }
}

/// TOML floats may have underscores and signs; `inf` and `nan` are refused later.
fn parse_float(text: &str) -> Option<f64> {
    text.replace('_', "").parse().ok()
}

#[expect(clippy::cast_precision_loss, reason = "numbers of a rig are small")]
fn int_to_float(x: i64) -> f64 {
    x as f64
}
