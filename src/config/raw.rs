//! Configuration as a person typed it: a tree of values, each knowing its file and line. RT: before arming only.
//!
//! serde with `deny_unknown_fields` would stop at the first error; this tree lets [`super::reader`] find all of them.

use super::problem::Problem;
use std::collections::BTreeMap;
use std::sync::Arc;
use toml::de::{DeTable, DeValue};

/// Where a value was typed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    /// File as named by the user.
    pub file: Arc<str>,
    /// Line, from 1; 0 on the command line.
    pub line: usize,
}

/// A value and where it was typed.
#[derive(Clone, Debug)]
pub struct Node {
    /// Where.
    pub at: Origin,
    /// What.
    pub value: Raw,
}

/// A value as typed.
#[derive(Clone, Debug)]
pub enum Raw {
    /// Keys with their values.
    Table(BTreeMap<String, Node>),
    /// Values in order.
    List(Vec<Node>),
    /// A number.
    Number {
        /// As computed with.
        value: f64,
        /// If it was typed as an integer that fits.
        whole: Option<i64>,
    },
    /// `true` or `false`.
    Flag(bool),
    /// A text in quotes.
    Text(String),
    /// Dates, and numbers that fit nothing.
    Other(String),
}

impl Node {
    /// An empty table.
    pub fn empty(file: &str) -> Self {
        Self { at: Origin { file: file.into(), line: 0 }, value: Raw::Table(BTreeMap::new()) }
    }

    /// Its children, if it is a table.
    pub fn table(&self) -> Option<&BTreeMap<String, Self>> {
        match &self.value {
            Raw::Table(map) => Some(map),
            _ => None,
        }
    }

    /// The value as TOML would show it.
    pub fn show(&self) -> String {
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

    /// The value on one line of TOML, tables written out.
    #[must_use]
    pub fn inline(&self) -> String {
        match &self.value {
            Raw::Table(map) => {
                let entry = |(key, node): (&String, &Self)| format!("{} = {}", quoted(key), node.inline());
                format!("{{ {} }}", map.iter().map(entry).collect::<Vec<_>>().join(", "))
            }
            Raw::List(items) => format!("[{}]", items.iter().map(Self::inline).collect::<Vec<_>>().join(", ")),
            _ => self.show(),
        }
    }

    /// Every leaf below this table with its path, such as `hip.gear_ratio`; itself, without a path, if it is no table.
    #[must_use]
    pub fn leaves(&self) -> Vec<(String, &Self)> {
        let Some(map) = self.table() else { return vec![(String::new(), self)] };
        let mut out = Vec::new();
        for (key, node) in map {
            let path = |rest: String| if rest.is_empty() { key.clone() } else { format!("{key}.{rest}") };
            out.extend(node.leaves().into_iter().map(|(rest, leaf)| (path(rest), leaf)));
        }
        out
    }

    /// Takes a key out, if it is a table that has it.
    pub fn remove(&mut self, key: &str) {
        if let Raw::Table(map) = &mut self.value {
            map.remove(key);
        }
    }

    /// Puts `leaf` at a path such as `["hip", "gear_ratio"]`, making tables on the way.
    pub fn put(&mut self, path: &[&str], leaf: Self) {
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

/// A key as TOML has it.
fn quoted(key: &str) -> String {
    let is_bare = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    if !key.is_empty() && key.chars().all(is_bare) {
        key.to_owned()
    } else {
        toml::Value::String(key.to_owned()).to_string()
    }
}

/// Reads a TOML text.
///
/// # Errors
/// All syntax errors at once.
pub fn parse(file: &str, text: &str) -> Result<Node, Vec<Problem>> {
    let place = Place::new(file, text);
    let (document, errors) = DeTable::parse_recoverable(text);
    if errors.is_empty() {
        return Ok(Node { at: place.origin(0), value: place.table(document.get_ref()) });
    }
    Err(errors.iter().map(|error| place.syntax_error(error)).collect())
}

/// A single value with the place where it was typed: an option of the command line, or a line of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Setting {
    /// Where.
    pub at: Origin,
    /// `key=value`.
    pub text: String,
}

impl Setting {
    /// Of an option of the command line, such as `--set`.
    #[must_use]
    pub fn of_option(option: &str, text: impl Into<String>) -> Self {
        Self { at: Origin { file: option.into(), line: 0 }, text: text.into() }
    }

    /// Of a file.
    #[must_use]
    pub fn of_node(key: &str, node: &Node) -> Self {
        Self { at: node.at.clone(), text: format!("{key}={}", node.inline()) }
    }
}

/// Reads `key.path=value`. A value that is no TOML is taken as text, to save quotes in a shell.
pub(super) fn parse_setting(setting: &Setting) -> Result<(String, Node), Problem> {
    let Setting { at, text: typed } = setting;
    let problem = |what: &str| Problem {
        file: at.file.to_string(),
        line: at.line,
        key: String::new(),
        value: None,
        what: format!("`{typed}`: {what}"),
    };
    let (key, value) = typed.split_once('=').ok_or_else(|| problem("expected key=value"))?;
    let key = key.trim();
    if key.is_empty() || key.split('.').any(str::is_empty) {
        return Err(problem("expected a key such as robot.hip.gear_ratio"));
    }
    let place = Place { file: at.file.clone(), line_ends: Vec::new(), first_line: at.line };
    let value = match DeValue::parse(value.trim()) {
        Ok(parsed) => place.value(parsed.get_ref()),
        Err(_) => Raw::Text(value.trim().to_owned()),
    };
    Ok((key.to_owned(), Node { at: at.clone(), value }))
}

/// A text's name and where its lines end: turns byte offsets into lines. Asked for each value, so it must not count anew.
struct Place {
    file: Arc<str>,
    line_ends: Vec<usize>,
    first_line: usize,
}

impl Place {
    fn new(file: &str, text: &str) -> Self {
        let line_ends = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n').map(|(at, _)| at).collect();
        Self { file: file.into(), line_ends, first_line: 1 }
    }

    fn origin(&self, byte: usize) -> Origin {
        let line = self.first_line + self.line_ends.partition_point(|end| *end < byte);
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
