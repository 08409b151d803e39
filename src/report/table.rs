//! Tables: the same rows for the terminal and for a page. RT: no.

use std::fmt::Write;

/// How a column is set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Align {
    /// Words.
    Left,
    /// Numbers.
    Right,
}

/// Rows of text under a heading.
#[derive(Debug, Clone, Default)]
pub struct Table {
    heading: Vec<(String, Align)>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// An empty table with these columns.
    pub fn new(heading: &[(&str, Align)]) -> Self {
        Self { heading: heading.iter().map(|(name, align)| ((*name).to_owned(), *align)).collect(), rows: Vec::new() }
    }

    /// Adds a row; missing cells stay empty, cells beyond the heading are dropped.
    pub fn push(&mut self, cells: impl IntoIterator<Item = String>) {
        let mut row: Vec<String> = cells.into_iter().take(self.heading.len()).collect();
        row.resize(self.heading.len(), String::new());
        self.rows.push(row);
    }

    /// No rows?
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Without the columns that say nothing in any row.
    #[must_use]
    pub fn without_empty_columns(self) -> Self {
        let says: Vec<bool> = (0..self.heading.len()).map(|k| self.rows.iter().any(|row| !row[k].is_empty())).collect();
        let mut rows = self.rows;
        for row in &mut rows {
            let mut k = 0..says.len();
            row.retain(|_| k.next().is_some_and(|k| says[k]));
        }
        let heading = self.heading.into_iter().zip(&says).filter(|(_, says)| **says).map(|(column, _)| column);
        Self { heading: heading.collect(), rows }
    }

    /// Columns padded with blanks, a rule under the heading; no trailing blanks.
    pub fn to_text(&self) -> String {
        let heading: Vec<String> = self.heading.iter().map(|(name, _)| name.clone()).collect();
        let widths: Vec<usize> = (0..heading.len()).map(|column| self.width(column)).collect();
        let rule: Vec<String> = widths.iter().map(|width| "─".repeat(*width)).collect();
        let lines = [&heading, &rule].into_iter().chain(&self.rows);
        lines.map(|cells| self.line(cells, &widths)).collect()
    }

    fn width(&self, column: usize) -> usize {
        let cells = self.rows.iter().map(|row| row[column].chars().count());
        cells.fold(self.heading[column].0.chars().count(), usize::max)
    }

    fn line(&self, cells: &[String], widths: &[usize]) -> String {
        let mut line = String::new();
        for ((cell, width), (_, align)) in cells.iter().zip(widths).zip(&self.heading) {
            let blanks = " ".repeat(width - cell.chars().count());
            match align {
                Align::Left => line.push_str(&format!("{cell}{blanks}  ")),
                Align::Right => line.push_str(&format!("{blanks}{cell}  ")),
            }
        }
        format!("{}\n", line.trim_end())
    }

    /// The table as HTML, cells escaped.
    pub fn to_html(&self) -> String {
        let mut html = String::from("<table><thead><tr>");
        self.html_cells(&mut html, "th", self.heading.iter().map(|(name, _)| name.as_str()));
        html.push_str("</tr></thead><tbody>");
        for row in &self.rows {
            html.push_str("<tr>");
            self.html_cells(&mut html, "td", row.iter().map(String::as_str));
            html.push_str("</tr>");
        }
        html.push_str("</tbody></table>");
        html
    }

    fn html_cells<'a>(&self, html: &mut String, tag: &str, cells: impl Iterator<Item = &'a str>) {
        for (cell, (_, align)) in cells.zip(&self.heading) {
            let class = if *align == Align::Right { " class=\"n\"" } else { "" };
            let text = escape(cell);
            write!(html, "<{tag}{class}>{text}</{tag}>").unwrap_or_default();
        }
    }
}

/// Text made safe for HTML and SVG.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A number with three significant digits, as a person would write it; `–` for none.
pub fn number(value: f64) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    let size = value.abs();
    if size == 0.0 {
        "0".to_owned()
    } else if (1e-4..1e5).contains(&size) {
        #[expect(clippy::cast_possible_truncation, reason = "between -4 and 5")]
        let decimals = (2 - size.log10().floor() as i32).max(0) as usize;
        trimmed(&format!("{value:.decimals$}"))
    } else {
        format!("{value:.2e}")
    }
}

fn trimmed(text: &str) -> String {
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up() {
        let mut table = Table::new(&[("case", Align::Left), ("s", Align::Right)]);
        table.push(["a".to_owned(), "1.5".to_owned()]);
        table.push(["longer".to_owned(), "12.25".to_owned()]);
        assert_eq!(table.to_text(), "case        s\n──────  ─────\na         1.5\nlonger  12.25\n");
    }

    #[test]
    fn markup_in_cells_is_text() {
        let mut table = Table::new(&[("x", Align::Left)]);
        table.push(["<b>&".to_owned()]);
        assert!(table.to_html().contains("<td>&lt;b&gt;&amp;</td>"));
    }

    #[test]
    fn numbers_keep_three_digits() {
        for (value, text) in [(0.006159, "0.00616"), (377.04, "377"), (12.0, "12"), (1.5e-7, "1.50e-7"), (0.0, "0")] {
            assert_eq!(number(value), text);
        }
    }
}
