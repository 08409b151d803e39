//! A CSV file as columns of numbers, strictly. RT: no.

use std::collections::HashSet;

/// Columns of a CSV file; empty cells are NaN.
#[derive(Clone, Debug)]
pub struct Table {
    file: String,
    names: Vec<String>,
    columns: Vec<Vec<Cell>>,
    /// Row number of each record as an editor counts.
    rows: Vec<u64>,
}

/// A cell as read.
#[derive(Clone, Debug)]
enum Cell {
    Number(f64),
    Empty,
    Bad(String),
}

impl Cell {
    /// As it stands in a file; a number reads back to the same bits.
    fn show(&self) -> String {
        match self {
            Self::Number(x) => format!("{x}"),
            Self::Empty => String::new(),
            Self::Bad(text) => text.clone(),
        }
    }
}

/// After so many complaints about one column the rest is counted, not listed.
const LISTED: usize = 3;

impl Table {
    /// Reads the bytes of a file; `file` is its name for messages.
    ///
    /// # Errors
    /// One line for everything that is wrong with the form: no header, no rows, short rows.
    pub fn parse(file: &str, bytes: &[u8]) -> Result<Self, Vec<String>> {
        let mut reader = csv::ReaderBuilder::new().flexible(true).trim(csv::Trim::All).from_reader(bytes);
        let header = reader.headers().map_err(|e| vec![format!("{file}: {e}")])?.clone();
        // A byte order mark is what spreadsheets put first.
        let names: Vec<String> = header.iter().map(|n| n.trim_start_matches('\u{feff}').to_owned()).collect();
        let mut table = Self { file: file.to_owned(), columns: vec![Vec::new(); names.len()], names, rows: Vec::new() };
        let mut wrong = table.header_errors();
        for record in reader.records() {
            match record {
                Ok(record) => wrong.extend(table.push(&record)),
                Err(e) => wrong.push(format!("{file}: {e}")),
            }
        }
        if table.rows.len() < 2 && wrong.is_empty() {
            wrong.push(format!("{file}: has {} rows of data, at least 2 are needed", table.rows.len()));
        }
        if wrong.is_empty() { Ok(table) } else { Err(shortened(wrong)) }
    }

    /// A table made of `columns`; NaN = empty. `file` is its name for messages.
    #[must_use]
    pub fn of_columns(file: &str, names: &[&str], columns: Vec<Vec<f64>>) -> Self {
        let of = |x: f64| if x.is_finite() { Cell::Number(x) } else { Cell::Empty };
        let rows = columns.first().map_or(0, Vec::len) as u64;
        Self {
            file: file.to_owned(),
            names: names.iter().map(|n| (*n).to_owned()).collect(),
            columns: columns.into_iter().map(|c| c.into_iter().map(of).collect()).collect(),
            // As an editor would count, were it a CSV file.
            rows: (2..rows + 2).collect(),
        }
    }

    /// The rows `rows` as the text of a CSV file.
    #[must_use]
    pub fn to_csv(&self, rows: std::ops::Range<usize>) -> String {
        let mut text = self.names.join(",") + "\n";
        for row in rows {
            let cells: Vec<String> = self.columns.iter().map(|c| c[row].show()).collect();
            text.push_str(&cells.join(","));
            text.push('\n');
        }
        text
    }

    /// How many rows of data.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// True without data.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    fn header_errors(&self) -> Vec<String> {
        let mut wrong = Vec::new();
        if self.names.first().is_none_or(|n| n != "t_s") {
            let first = self.names.first().map_or("", String::as_str);
            let separated = first.contains([';', '\t']);
            let what = match first {
                "" => "the file is empty or has no header; it must begin with the names of its columns, `t_s` first"
                    .to_owned(),
                _ if separated => format!("`{first}` is one cell: separate cells by commas, with points in numbers"),
                _ => format!("the first column is `{first}`, must be `t_s` (time in s)"),
            };
            wrong.push(format!("{}: row 1: {what}", self.file));
        }
        let mut seen = HashSet::with_capacity(self.names.len());
        for name in &self.names {
            if !seen.insert(name) {
                wrong.push(format!("{}: row 1: column `{name}` stands twice, rename one", self.file));
            }
        }
        wrong
    }

    fn push(&mut self, record: &csv::StringRecord) -> Option<String> {
        let row = record.position().map_or(0, csv::Position::line);
        if record.len() != self.names.len() {
            let (has, wants) = (record.len(), self.names.len());
            return Some(format!("{}: row {row}: has {has} cells, the header has {wants}", self.file));
        }
        for (column, text) in self.columns.iter_mut().zip(record) {
            column.push(cell(text));
        }
        self.rows.push(row);
        None
    }

    /// Names of all columns.
    #[must_use]
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// The numbers of column `name`. `empty_is`: what an empty cell stands for; none = it must not be empty.
    ///
    /// # Errors
    /// The column is missing, or its bad cells.
    pub fn column(&self, name: &str, empty_is: Option<f64>) -> Result<Vec<f64>, Vec<String>> {
        let Some(index) = self.names.iter().position(|n| n == name) else {
            let has = self.names.join(", ");
            let file = &self.file;
            return Err(vec![format!(
                "{file}: row 1: column `{name}` is missing; the file has: {has}; name one of these in rig.toml"
            )]);
        };
        let mut wrong = Vec::new();
        let mut numbers = Vec::with_capacity(self.rows.len());
        for (cell, row) in self.columns[index].iter().zip(&self.rows) {
            match (cell, empty_is) {
                (Cell::Number(x), _) => numbers.push(*x),
                (Cell::Empty, Some(x)) => numbers.push(x),
                (Cell::Empty, None) => {
                    wrong.push(format!("{}: row {row}, column `{name}`: empty, needs a number", self.file));
                }
                (Cell::Bad(text), _) => wrong.push(format!(
                    "{}: row {row}, column `{name}`: `{text}` is not a finite number; leave a missing sample empty",
                    self.file
                )),
            }
        }
        if wrong.is_empty() { Ok(numbers) } else { Err(shortened(wrong)) }
    }

    /// The complaint about a table that is too short.
    pub(super) fn too_few(&self, least: usize) -> String {
        format!("{}: has {} rows, at least {least} are needed: record some seconds", self.file, self.len())
    }

    /// The complaint about windows of too few rows.
    pub(super) fn short_windows(&self, window_s: f64, rows: usize, least: usize) -> String {
        format!(
            "{}: column `t_s`: a window of `window_s = {window_s}` holds {rows} rows, at least {least} are needed: lengthen it \
             in rig.toml; if the times are milliseconds, divide them by 1000",
            self.file
        )
    }

    /// Complaints about instants that do not increase.
    pub(super) fn check_time(&self, times: &[f64]) -> Vec<String> {
        let mut wrong = Vec::new();
        for (k, pair) in times.windows(2).enumerate() {
            if pair[1] <= pair[0] {
                let what = if pair[1] < pair[0] { "goes back" } else { "is repeated" };
                let row = self.rows[k + 1];
                let (t, file) = (pair[1], &self.file);
                wrong.push(format!("{file}: row {row}, column `t_s`: {t} {what}; sort the rows, drop doubles"));
            }
        }
        shortened(wrong)
    }

    /// Complaints about a stance column that is neither 0 nor 1.
    pub(super) fn check_stance(&self, name: Option<&str>, stance: &[f64]) -> Vec<String> {
        let Some(name) = name else { return Vec::new() };
        let leg = |x: f64| x.to_bits() == 0.0_f64.to_bits() || x.to_bits() == 1.0_f64.to_bits();
        let bad = stance.iter().zip(&self.rows).filter(|(x, _)| !leg(**x));
        let file = &self.file;
        shortened(
            bad.map(|(x, row)| format!("{file}: row {row}, column `{name}`: {x} must be 0 (inner) or 1 (outer)"))
                .collect(),
        )
    }
}

fn cell(text: &str) -> Cell {
    if text.is_empty() {
        return Cell::Empty;
    }
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() => Cell::Number(x),
        _ => Cell::Bad(text.to_owned()),
    }
}

fn shortened(mut lines: Vec<String>) -> Vec<String> {
    if lines.len() > LISTED {
        let more = lines.len() - LISTED;
        lines.truncate(LISTED);
        if let Some(last) = lines.last_mut() {
            last.push_str(&format!(" (and {more} more)"));
        }
    }
    lines
}
