//! Takes checked values out of the raw tree and notes everything that is wrong on the way. RT: before arming only.
//!
//! A reading function goes on after an error with a placeholder, so that one run finds all errors of all files;
//! [`Log::finish`] then refuses the result. What was read is written down in canonical form, so the text of a
//! configuration depends on its meaning alone: comments, order and `30` against `30.0` do not change its hash.

use super::checked::Parameter;
use super::problem::{ACROSS_KEYS, Errors, Problem};
use super::raw::{Node, Origin, Raw};
use crate::base::time::Span;
use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

/// An allowed range with its unit.
#[derive(Clone, Copy, Debug)]
pub struct Range {
    min: f64,
    max: f64,
    unit: &'static str,
}

/// Closed range; the unit is shown in errors, `"1"` = none.
pub const fn range(min: f64, max: f64, unit: &'static str) -> Range {
    Range { min, max, unit }
}

impl Range {
    /// In words, with the unit.
    pub fn describe(self) -> String {
        let unit = if self.unit == "1" { String::new() } else { format!(" {}", self.unit) };
        format!("{} to {}{unit}", self.min, self.max)
    }

    /// True within, ends included.
    pub fn contains(self, value: f64) -> bool {
        // A NaN is in no range.
        value >= self.min && value <= self.max
    }
}

/// What was found while reading.
#[derive(Default)]
pub struct Log {
    errors: RefCell<Vec<Problem>>,
    warnings: RefCell<Vec<Problem>>,
    canonical: RefCell<BTreeMap<String, String>>,
    muted: Cell<bool>,
}

impl Log {
    /// Notes an error.
    pub fn error(&self, problem: Problem) {
        if !self.muted.get() {
            self.errors.borrow_mut().push(problem);
        }
    }

    /// True if nothing is wrong so far.
    pub fn is_clean(&self) -> bool {
        self.errors.borrow().is_empty()
    }

    /// Notes something suspicious.
    pub fn warn(&self, problem: Problem) {
        self.warnings.borrow_mut().push(problem);
    }

    fn canonical(&self, key: String, value: String) {
        if !self.muted.get() {
            self.canonical.borrow_mut().insert(key, value);
        }
    }

    /// Gives every problem between keys, which knows no place, the place of one of its keys.
    pub(super) fn locate(&self, place: impl Fn(&str) -> Option<Origin>) {
        for problem in self.errors.borrow_mut().iter_mut().chain(self.warnings.borrow_mut().iter_mut()) {
            if problem.file == ACROSS_KEYS
                && let Some(Origin { file, line }) = place(&problem.key)
            {
                (problem.file, problem.line) = (file.to_string(), line);
            }
        }
    }

    /// The canonical text and the warnings.
    ///
    /// # Errors
    /// All that were noted.
    pub fn finish(self) -> Result<(String, Vec<Problem>), Errors> {
        let errors = self.errors.into_inner();
        if !errors.is_empty() {
            return Err(Errors(errors));
        }
        let mut text = String::new();
        for (key, value) in self.canonical.into_inner() {
            writeln!(text, "{key} = {value}").unwrap_or_default();
        }
        Ok((text, self.warnings.into_inner()))
    }
}

/// Reads one table.
pub struct Reader<'a> {
    path: String,
    node: &'a Node,
    seen: RefCell<BTreeSet<&'static str>>,
    log: &'a Log,
}

/// Reads a table with `f`; keys that `f` did not ask for are errors.
pub fn read<T>(log: &Log, path: &str, node: &Node, f: impl FnOnce(&Reader<'_>) -> T) -> T {
    let reader = Reader { path: path.to_owned(), node, seen: RefCell::default(), log };
    let result = f(&reader);
    reader.refuse_unknown_keys();
    result
}

impl Reader<'_> {
    /// A number in a range.
    pub fn number(&self, key: &'static str, range: Range) -> f64 {
        self.get(key).map_or(f64::NAN, |node| self.checked_number(key, node, range))
    }

    /// A number in a range, or nothing.
    pub fn optional_number(&self, key: &'static str, range: Range) -> Option<f64> {
        self.find(key).map(|node| self.checked_number(key, node, range))
    }

    /// A length of time typed in the unit that ends the key: `_s`, `_ms`, `_us`.
    pub fn span(&self, key: &'static str, min: f64, max: f64) -> Span {
        let (unit, scale) = match key.rsplit('_').next() {
            Some("ms") => ("ms", 1e-3),
            Some("us") => ("us", 1e-6),
            _ => ("s", 1.0),
        };
        Span::from_s(self.number(key, range(min, max, unit)) * scale)
    }

    /// A list of any length of pairs of numbers, each in its range.
    pub fn pairs(&self, key: &'static str, first: Range, second: Range) -> Vec<[f64; 2]> {
        let Some(node) = self.get(key) else { return Vec::new() };
        let Raw::List(items) = &node.value else {
            self.wrong(key, node, "must be a list of pairs of numbers");
            return Vec::new();
        };
        let mut out = Vec::new();
        for item in items {
            match &item.value {
                Raw::List(pair) if pair.len() == 2 => {
                    out.push([self.plain_number(key, &pair[0], first), self.plain_number(key, &pair[1], second)]);
                }
                _ => self.wrong(key, item, "must be a pair of numbers"),
            }
        }
        self.note_pairs(key, &out);
        out
    }

    /// Notes pairs of numbers, wherever they stood.
    pub fn note_pairs(&self, key: &'static str, pairs: &[[f64; 2]]) {
        let text: Vec<String> = pairs.iter().map(|[a, b]| format!("[{a:?}, {b:?}]")).collect();
        self.note(key, format!("[{}]", text.join(", ")));
    }

    /// So many numbers in a range.
    pub fn numbers<const N: usize>(&self, key: &'static str, range: Range) -> [f64; N] {
        let mut out = [f64::NAN; N];
        let Some(node) = self.get(key) else { return out };
        let Raw::List(items) = &node.value else {
            self.wrong(key, node, &format!("must be a list of {N} numbers"));
            return out;
        };
        if items.len() != N {
            self.wrong(key, node, &format!("must have {N} numbers, has {}", items.len()));
            return out;
        }
        for (slot, item) in out.iter_mut().zip(items) {
            *slot = self.plain_number(key, item, range);
        }
        let text: Vec<String> = out.iter().map(|x| format!("{x:?}")).collect();
        self.note(key, format!("[{}]", text.join(", ")));
        out
    }

    /// A list of tables `{ key = number, ... }` that all have the same keys.
    pub fn rows<const N: usize>(
        &self,
        key: &'static str,
        columns: [&'static str; N],
        ranges: [Range; N],
    ) -> Vec<[f64; N]> {
        let Some(node) = self.get(key) else { return Vec::new() };
        let Raw::List(items) = &node.value else {
            self.wrong(key, node, &format!("must be a list of tables with {}", columns.join(", ")));
            return Vec::new();
        };
        let mut out = Vec::with_capacity(items.len());
        for (i, item) in items.iter().enumerate() {
            let path = self.path_of(&format!("{key}[{i}]"));
            if item.table().is_none() {
                self.wrong(key, item, &format!("must be a list of tables with {}", columns.join(", ")));
                continue;
            }
            // The list is one line of the canonical text, not one per number.
            let private = Log::default();
            out.push(read(&private, &path, item, |r| std::array::from_fn(|k| r.number(columns[k], ranges[k]))));
            private.errors.into_inner().into_iter().for_each(|problem| self.log.error(problem));
        }
        let row = |row: &[f64; N]| {
            let cells: Vec<String> = columns.iter().zip(row).map(|(name, x)| format!("{name} = {x:?}")).collect();
            format!("{{ {} }}", cells.join(", "))
        };
        self.note(key, format!("[{}]", out.iter().map(row).collect::<Vec<_>>().join(", ")));
        out
    }

    /// A whole number in a range.
    pub fn integer<T: TryFrom<i64> + Default>(&self, key: &'static str, min: i64, max: i64, unit: &str) -> T {
        self.get(key).and_then(|node| self.checked_integer(key, node, (min, max), unit)).unwrap_or_default()
    }

    /// A whole number in a range, or nothing.
    pub fn optional_integer<T: TryFrom<i64>>(&self, key: &'static str, min: i64, max: i64, unit: &str) -> Option<T> {
        self.find(key).and_then(|node| self.checked_integer(key, node, (min, max), unit))
    }

    /// `true` or `false`.
    pub fn flag(&self, key: &'static str) -> bool {
        let Some(node) = self.get(key) else { return false };
        match node.value {
            Raw::Flag(value) => {
                self.note(key, value.to_string());
                value
            }
            _ => {
                self.wrong(key, node, "must be true or false");
                false
            }
        }
    }

    /// A text that is not noted as it was typed: see [`Reader::note_text`].
    pub fn silent_text(&self, key: &'static str) -> String {
        match self.get(key).map(|node| &node.value) {
            Some(Raw::Text(value)) => value.clone(),
            Some(_) => {
                self.refuse(key, "must be a text in quotes");
                String::new()
            }
            None => String::new(),
        }
    }

    /// Notes what a text stands for.
    pub fn note_text(&self, key: &'static str, text: &str) {
        self.note(key, toml::Value::String(text.to_owned()).to_string());
    }

    /// A text.
    pub fn text(&self, key: &'static str) -> String {
        let Some(node) = self.get(key) else { return String::new() };
        match &node.value {
            Raw::Text(value) => {
                self.note(key, node.show());
                value.clone()
            }
            _ => {
                self.wrong(key, node, "must be a text in quotes");
                String::new()
            }
        }
    }

    /// A list of texts, each read by `parse`; empty if the key is not there. Canonical is what `show` says.
    pub fn parsed_texts<T>(
        &self,
        key: &'static str,
        parse: impl Fn(&str) -> Result<T, String>,
        show: impl Fn(&T) -> String,
    ) -> Vec<T> {
        let Some(node) = self.find(key) else { return Vec::new() };
        let Raw::List(items) = &node.value else {
            self.wrong(key, node, "must be a list of texts in quotes");
            return Vec::new();
        };
        let mut out = Vec::new();
        for (i, item) in items.iter().enumerate() {
            let place = format!("{key}[{i}]");
            match &item.value {
                Raw::Text(text) => match parse(text) {
                    Ok(value) => out.push(value),
                    Err(what) => self.wrong(&place, item, &what),
                },
                _ => self.wrong(&place, item, "must be a text in quotes"),
            }
        }
        if !out.is_empty() {
            let text: Vec<String> = out.iter().map(|value| toml::Value::String(show(value)).to_string()).collect();
            self.note(key, format!("[{}]", text.join(", ")));
        }
        out
    }

    /// One of some words.
    pub fn choice<T: Copy>(&self, key: &'static str, choices: &[(&str, T)], placeholder: T) -> T {
        let text = self.text(key);
        if let Some((_, value)) = choices.iter().find(|(word, _)| *word == text) {
            return *value;
        }
        let words: Vec<String> = choices.iter().map(|(word, _)| format!("\"{word}\"")).collect();
        self.refuse(key, &format!("must be one of {}", words.join(", ")));
        placeholder
    }

    /// One of some words, or nothing.
    pub fn optional_choice<T: Copy>(&self, key: &'static str, choices: &[(&str, T)]) -> Option<T> {
        let (_, first) = choices.first()?;
        self.find(key).map(|_| self.choice(key, choices, *first))
    }

    /// The value of a key as typed, or nothing.
    pub fn optional_node(&self, key: &'static str) -> Option<&Node> {
        self.find(key)
    }

    /// Notes that a value below a key is not allowed; `place` is its path from here.
    pub fn refuse_node(&self, place: &str, node: &Node, what: &str) {
        self.wrong(place, node, what);
    }

    /// A table within.
    pub fn table<T>(&self, key: &'static str, f: impl FnOnce(&Reader<'_>) -> T) -> T {
        self.table_or(key, "must be a table", f)
    }

    /// A table within; `what` is said of anything else.
    fn table_or<T>(&self, key: &'static str, what: &str, f: impl FnOnce(&Reader<'_>) -> T) -> T {
        let empty = Node::empty(&self.node.at.file);
        let node = self.get(key).filter(|node| self.is_table(key, node, what));
        // One error for the missing table is enough: read placeholders silently.
        let muted = self.log.muted.replace(node.is_none() || self.log.muted.get());
        let result = read(self.log, &self.path_of(key), node.unwrap_or(&empty), f);
        self.log.muted.set(muted);
        result
    }

    /// A table within, or nothing.
    pub fn optional_table<T>(&self, key: &'static str, f: impl FnOnce(&Reader<'_>) -> T) -> Option<T> {
        let node = self.find(key)?;
        self.is_table(key, node, "must be a table").then(|| read(self.log, &self.path_of(key), node, f))
    }

    /// `{ value, min, max, unit, source, free }`. `units` are the allowed units with the factor to the first of them.
    pub fn parameter(&self, key: &'static str, range: Range, units: &[(&'static str, f64)]) -> Parameter {
        let all = super::reader::range(f64::MIN, f64::MAX, "1");
        let number = self.path_of(&format!("{key}.value"));
        let what =
            format!("must be a table {{ value, min, max, unit, source, free }}; for the number alone set {number}");
        self.table_or(key, &what, |r| {
            let unit = r.choice("unit", &units.iter().map(|u| (u.0, *u)).collect::<Vec<_>>(), ("", 1.0));
            let raw = Parameter {
                value: r.number("value", Range { unit: unit.0, ..range }),
                min: r.number("min", all),
                max: r.number("max", all),
                unit: units.first().map_or("", |u| u.0).to_owned(),
                source: r.text("source"),
                free: r.flag("free"),
            };
            if raw.value < raw.min || raw.value > raw.max {
                r.refuse("value", &format!("is outside its own bounds {} to {} {}", raw.min, raw.max, unit.0));
            }
            Parameter { value: raw.value * unit.1, min: raw.min * unit.1, max: raw.max * unit.1, ..raw }
        })
    }

    /// Notes that the value of a key which was read is not allowed.
    pub fn refuse(&self, key: &'static str, what: &str) {
        if let Some(node) = self.find(key) {
            self.wrong(key, node, what);
        }
    }

    fn checked_number(&self, key: &str, node: &Node, range: Range) -> f64 {
        let value = self.plain_number(key, node, range);
        self.note(key, format!("{value:?}"));
        value
    }

    fn plain_number(&self, key: &str, node: &Node, range: Range) -> f64 {
        match node.value {
            Raw::Number { value, .. } if range.contains(value) => value,
            Raw::Number { .. } => {
                self.wrong(key, node, &format!("must be {}", range.describe()));
                f64::NAN
            }
            _ => {
                self.wrong(key, node, &format!("must be a number, {}", range.describe()));
                f64::NAN
            }
        }
    }

    fn checked_integer<T: TryFrom<i64>>(&self, key: &str, node: &Node, range: (i64, i64), unit: &str) -> Option<T> {
        let value = match node.value {
            Raw::Number { whole: Some(n), .. } if (range.0..=range.1).contains(&n) => T::try_from(n).ok(),
            _ => None,
        };
        let unit = if unit == "1" { String::new() } else { format!(" {unit}") };
        match value {
            Some(_) => self.note(key, node.show()),
            None => self.wrong(key, node, &format!("must be a whole number, {} to {}{unit}", range.0, range.1)),
        }
        value
    }

    fn is_table(&self, key: &str, node: &Node, what: &str) -> bool {
        let is = node.table().is_some();
        if !is {
            self.wrong(key, node, what);
        }
        is
    }

    /// The value of a key that must be there.
    fn get(&self, key: &'static str) -> Option<&Node> {
        let found = self.find(key);
        if found.is_none() {
            self.log.error(self.problem(key, &self.node.at, None, "is missing"));
        }
        found
    }

    fn find(&self, key: &'static str) -> Option<&Node> {
        self.seen.borrow_mut().insert(key);
        self.node.table()?.get(key)
    }

    fn refuse_unknown_keys(&self) {
        let seen = self.seen.borrow();
        for (key, node) in self.node.table().into_iter().flatten() {
            if !seen.contains(key.as_str()) {
                let known: Vec<&str> = seen.iter().copied().collect();
                self.wrong(key, node, &format!("unknown key; known here: {}", known.join(", ")));
            }
        }
    }

    fn wrong(&self, key: &str, node: &Node, what: &str) {
        self.log.error(self.problem(key, &node.at, Some(node.show()), what));
    }

    fn problem(&self, key: &str, at: &Origin, value: Option<String>, what: &str) -> Problem {
        let key = self.path_of(key);
        Problem { file: at.file.to_string(), line: at.line, key, value, what: what.to_owned() }
    }

    fn note(&self, key: &str, value: String) {
        self.log.canonical(self.path_of(key), value);
    }

    fn path_of(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }
}
