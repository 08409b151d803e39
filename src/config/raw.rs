//! Configuration as a person typed it: a tree of values, each knowing its file and line. RT: before arming only.
//!
//! serde with `deny_unknown_fields` would stop at the first error; this tree lets [`super::reader`] find all of them.

use super::problem::Problem;
use std::collections::BTreeMap;
use std::sync::Arc;
use toml::de::{DeTable, DeValue};

/// Where a value was typed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Origin {
    /// File as named by the user.
    pub(super) file: Arc<str>,
    /// Line, from 1; 0 on the command line.
    pub(super) line: usize,
}

/// A value and where it was typed.
#[derive(Clone, Debug)]
pub(super) struct Node {
    /// Where.
    pub(super) at: Origin,
    /// What.
    pub(super) value: Raw,
}

/// A value as typed.
#[derive(Clone, Debug)]
pub(super) enum Raw {
    Table(BTreeMap<String, Node>),
    List(Vec<Node>),
    /// `whole` if it was typed as an integer that fits.
    Number {
        value: f64,
        whole: Option<i64>,
    },
    Flag(bool),
    Text(String),
    /// Dates, and numbers that fit nothing.
    Other(String),
}

impl Node {
    /// An empty table.
    pub(super) fn empty(file: &str) -> Self {
        Self { at: Origin { file: file.into(), line: 0 }, value: Raw::Table(BTreeMap::new()) }
    }

    /// Its children, if it is a table.
    pub(super) fn table(&self) -> Option<&BTreeMap<String, Self>> {
        match &self.value {
            Raw::Table(map) => Some(map),
            _ => None,
        }
    }

    /// The value as TOML would show it.
    pub(super) fn show(&self) -> String {
        match &self.value {
            Raw::Table(_) => "a table".into(),
            Raw::List(items) => format!("[{}]", items.iter().map(Self::show).collect::<Vec<_>>().join(", ")),
            Raw::Number { whole: Some(n), .. } => n.to_string(),
            Raw::Number { value, .. } => format!("{value:?}"),
            Raw::Flag(b) => b.to_string(),
            Raw::Text(s) => toml::Value::String(s.clone()).to_string(),
            Raw::Other(s) => s.clone(),
        }
    }

    /// Takes a key out, if it is a table that has it.
    pub(super) fn remove(&mut self, key: &str) {
        if let Raw::Table(map) = &mut self.value {
            map.remove(key);
        }
    }

    /// Puts `leaf` at a path such as `["hip", "gear_ratio"]`, making tables on the way.
    pub(super) fn put(&mut self, path: &[&str], leaf: Self) {
        let Some((first, rest)) = path.split_first() else {
            *self = leaf;
            return;
        };
        if self.table().is_none() {
            self.value = Raw::Table(BTreeMap::new());
        }
        if let Raw::Table(map) = &mut self.value {
            let at = leaf.at.clone();
            map.entry((*first).to_owned()).or_insert(Self { at, value: Raw::Table(BTreeMap::new()) }).put(rest, leaf);
        }
    }
}

/// Reads a TOML text. All syntax errors at once.
pub(super) fn parse(file: &str, text: &str) -> Result<Node, Vec<Problem>> {
    let place = Place::new(file, text);
    let (document, errors) = DeTable::parse_recoverable(text);
    if errors.is_empty() {
        return Ok(Node { at: place.origin(0), value: place.table(document.get_ref()) });
    }
    Err(errors.iter().map(|error| place.syntax_error(error)).collect())
}

/// Reads `key.path=value` of the command line. A value that is no TOML is taken as text, to save quotes in a shell.
pub(super) fn parse_override(typed: &str) -> Result<(String, Node), Problem> {
    let problem = |what: &str| Problem {
        file: "--set".into(),
        line: 0,
        key: String::new(),
        value: None,
        what: format!("`{typed}`: {what}"),
    };
    let (key, value) = typed.split_once('=').ok_or_else(|| problem("expected key=value"))?;
    let key = key.trim();
    if key.is_empty() || key.split('.').any(str::is_empty) {
        return Err(problem("expected a key such as robot.hip.gear_ratio"));
    }
    let at = Origin { file: "--set".into(), line: 0 };
    let place = Place::new("--set", value);
    let value = match DeValue::parse(value.trim()) {
        Ok(parsed) => place.value(parsed.get_ref()),
        Err(_) => Raw::Text(value.trim().to_owned()),
    };
    Ok((key.to_owned(), Node { at, value }))
}

/// A text's name and where its lines end: turns byte offsets into lines. Asked for each value, so it must not count anew.
struct Place {
    file: Arc<str>,
    line_ends: Vec<usize>,
}

impl Place {
    fn new(file: &str, text: &str) -> Self {
        let line_ends = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n').map(|(at, _)| at).collect();
        Self { file: file.into(), line_ends }
    }

    fn origin(&self, byte: usize) -> Origin {
        let line = 1 + self.line_ends.partition_point(|end| *end < byte);
        Origin { file: self.file.clone(), line }
    }

    fn syntax_error(&self, error: &toml::de::Error) -> Problem {
        let at = self.origin(error.span().map_or(0, |span| span.start));
        Problem {
            file: at.file.to_string(),
            line: at.line,
            key: String::new(),
            value: None,
            what: format!("not TOML: {}", error.message().replace('\n', ", ")),
        }
    }

    fn table(&self, table: &DeTable<'_>) -> Raw {
        let entry = |(key, value): (&toml::Spanned<_>, &toml::Spanned<_>)| {
            let at = self.origin(key.span().start);
            let key: &std::borrow::Cow<'_, str> = key.get_ref();
            (key.to_string(), Node { at, value: self.value(value.get_ref()) })
        };
        Raw::Table(table.iter().map(entry).collect())
    }

    fn value(&self, value: &DeValue<'_>) -> Raw {
        match value {
            DeValue::String(s) => Raw::Text(s.to_string()),
            DeValue::Integer(n) => integer(n.as_str(), n.radix()),
            DeValue::Float(x) => x
                .as_str()
                .parse()
                .map_or_else(|_| Raw::Other(x.to_string()), |value| Raw::Number { value, whole: None }),
            DeValue::Boolean(b) => Raw::Flag(*b),
            DeValue::Datetime(d) => Raw::Other(d.to_string()),
            DeValue::Array(items) => Raw::List(
                items
                    .iter()
                    .map(|item| Node { at: self.origin(item.span().start), value: self.value(item.get_ref()) })
                    .collect(),
            ),
            DeValue::Table(table) => self.table(table),
        }
    }
}

#[expect(clippy::cast_precision_loss, reason = "integers beyond 2^53 are outside every range we allow")]
fn integer(text: &str, radix: u32) -> Raw {
    match i64::from_str_radix(text, radix) {
        Ok(n) => Raw::Number { value: n as f64, whole: Some(n) },
        Err(_) => Raw::Other(text.to_owned()),
    }
}
