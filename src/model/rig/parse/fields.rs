//! Keys of a table taken one by one, values read with their complaints. RT: no.

use super::RigError;
use crate::model::rig::{Bounds, Value};
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// More letters of a wrong value tell nothing.
const LONGEST_SHOWN: usize = 40;

pub(super) type Item<'a> = Spanned<DeValue<'a>>;

/// A table whose keys are taken one by one; what is left over is unknown.
pub(super) struct Fields<'a> {
    pub(super) table: DeTable<'a>,
    pub(super) span: Range<usize>,
    /// How messages call the table.
    pub(super) name: String,
}

impl<'a> Fields<'a> {
    pub(super) fn new(table: DeTable<'a>, span: Range<usize>, name: &str) -> Self {
        Self { table, span, name: name.to_owned() }
    }
    pub(super) fn take(&mut self, key: &str) -> Option<Item<'a>> {
        self.table.remove(key)
    }
}

/// Collects the complaints.
pub(super) struct Reader<'t> {
    pub(super) text: &'t str,
    pub(super) file: &'t str,
    pub(super) errors: Vec<RigError>,
}

impl Reader<'_> {
    pub(super) fn complain(&mut self, span: &Range<usize>, key: &str, message: impl Into<String>) {
        let line = 1 + self.text.bytes().take(span.start).filter(|b| *b == b'\n').count();
        self.errors.push(RigError { file: self.file.to_owned(), line, key: key.to_owned(), message: message.into() });
    }

    /// Complains about the keys nobody took.
    pub(super) fn finish(&mut self, fields: Fields<'_>, known: &str) {
        for (key, _) in &fields.table {
            self.complain(&key.span(), key.get_ref(), format!("unknown key in {}; known: {known}", fields.name));
        }
    }

    pub(super) fn required<'a>(&mut self, fields: &mut Fields<'a>, key: &str) -> Option<Item<'a>> {
        let item = fields.take(key);
        if item.is_none() {
            let message = format!("missing in {}", fields.name);
            self.complain(&fields.span.clone(), key, message);
        }
        item
    }

    pub(super) fn string(&mut self, key: &str, item: Item<'_>) -> Option<String> {
        let span = item.span();
        let text = item.into_inner().as_str().map(str::to_owned);
        if text.is_none() {
            self.complain(&span, key, "must be a text in quotes");
        }
        text
    }

    pub(super) fn required_string(&mut self, fields: &mut Fields<'_>, key: &str) -> Option<(String, Range<usize>)> {
        let item = self.required(fields, key)?;
        let span = item.span();
        Some((self.string(key, item)?, span))
    }

    pub(super) fn optional_string(&mut self, fields: &mut Fields<'_>, key: &str) -> Option<(String, Range<usize>)> {
        let item = fields.take(key)?;
        let span = item.span();
        Some((self.string(key, item)?, span))
    }

    pub(super) fn float(&mut self, key: &str, item: &Item<'_>) -> Option<f64> {
        let number = match item.get_ref() {
            DeValue::Float(x) => parse_float(x.as_str()),
            DeValue::Integer(x) => i64::from_str_radix(x.as_str(), x.radix()).ok().map(int_to_float),
            _ => None,
        };
        match number {
            Some(x) if x.is_finite() => Some(x),
            Some(_) => {
                self.complain(&item.span(), key, format!("is {}, must be finite", self.typed(item)));
                None
            }
            None => {
                self.complain(&item.span(), key, format!("is {}, must be a number", self.typed(item)));
                None
            }
        }
    }

    /// A value as it stands in the file, its beginning if it is long.
    fn typed(&self, item: &Item<'_>) -> String {
        let text = self.text.get(item.span()).unwrap_or_default();
        let line = text.lines().next().unwrap_or_default();
        let shown: String = line.chars().take(LONGEST_SHOWN).collect();
        if shown.len() < text.len() { format!("{shown}...") } else { shown }
    }

    pub(super) fn optional_float(&mut self, fields: &mut Fields<'_>, key: &str, low: f64) -> Option<f64> {
        let item = fields.take(key)?;
        let x = self.float(key, &item)?;
        if x < low {
            self.complain(&item.span(), key, format!("is {x}, must be at least {low}"));
            return None;
        }
        Some(x)
    }

    /// The keys of the table that stands at `key`; `name` is what messages call it.
    pub(super) fn table<'a>(&mut self, item: Item<'a>, key: &str, name: &str) -> Option<Fields<'a>> {
        let span = item.span();
        let table = into_table(item);
        if table.is_none() {
            self.complain(&span, key, "must be a table");
        }
        Some(Fields::new(table?, span, name))
    }

    /// `{ value, min, max }` or a bare number.
    pub(super) fn value(&mut self, key: &str, item: Item<'_>) -> Option<Value> {
        let span = item.span();
        if !item.get_ref().is_table() {
            return self.float(key, &item).map(Value::known);
        }
        let mut fields = Fields::new(into_table(item)?, span.clone(), key);
        let value = self.required(&mut fields, "value").and_then(|i| self.float(&format!("{key}.value"), &i));
        let ends = ["min", "max"].map(|end| fields.take(end).map(|i| self.float(&format!("{key}.{end}"), &i)));
        self.finish(fields, "value, min, max");
        // One that is there and no number was told already.
        let end = |end: Option<Option<f64>>| end.map_or(Some(None), |number| number.map(Some));
        let (min, max) = (end(ends[0])?, end(ends[1])?);
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

    pub(super) fn required_value(&mut self, fields: &mut Fields<'_>, key: &str) -> Option<Value> {
        let item = self.required(fields, key)?;
        self.value(key, item)
    }

    /// The tables of `[[key]]`.
    pub(super) fn tables<'a>(&mut self, fields: &mut Fields<'a>, key: &str, name: &str) -> Vec<Fields<'a>> {
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

    pub(super) fn names(&mut self, fields: &mut Fields<'_>, key: &str) -> Vec<String> {
        let Some(item) = fields.take(key) else { return Vec::new() };
        let span = item.span();
        let DeValue::Array(array) = item.into_inner() else {
            self.complain(&span, key, "must be a list of texts");
            return Vec::new();
        };
        array.into_iter().filter_map(|item| self.string(key, item)).collect()
    }
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
