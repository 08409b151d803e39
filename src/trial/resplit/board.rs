//! All variants together: a line for each, and the counts that matter. RT: no.

use std::collections::BTreeMap;

use serde::Serialize;

use super::mark::VariantMark;
use super::settle::Settled;
use crate::report::table::{Align, Table, number};
use crate::trial::score::Share;

/// One variant, marked.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// Name of the variant.
    pub variant: String,
    /// The case that it was made of.
    pub case: String,
    /// What was changed.
    pub note: String,
    /// What was named, in short.
    pub named: String,
    /// Time a user waited, s.
    pub seconds: f64,
    /// Why there is no answer.
    pub unanswered: Option<String>,
    /// What the variant can decide.
    pub settled: Settled,
    /// These recordings can tell the truth from the plain rig and from each rival.
    pub decidable: bool,
    /// Right in every respect.
    pub right: bool,
    /// In detail.
    pub mark: VariantMark,
}

/// Everything that was marked.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// Seed of the variants.
    pub seed: u64,
    /// Variants in order.
    pub rows: Vec<Row>,
}

impl Report {
    /// A line for each variant.
    pub fn table(&self) -> Table {
        let mut table = Table::new(&[
            ("variant", Align::Left),
            ("change", Align::Left),
            ("named", Align::Left),
            ("ok", Align::Left),
            ("error", Align::Right),
            ("truth", Align::Right),
            ("plain", Align::Right),
            ("s", Align::Right),
        ]);
        for row in &self.rows {
            table.push([
                row.variant.clone(),
                row.note.clone(),
                row.named.clone(),
                complaint(row),
                number(row.mark.error),
                number(row.settled.truth),
                number(row.settled.base),
                format!("{:.1}", row.seconds),
            ]);
        }
        table
    }

    /// Shares by case and in all, of the variants that can be decided.
    pub fn totals(&self) -> Table {
        let mut table = Table::new(&[
            ("case", Align::Left),
            ("right, of the decidable", Align::Left),
            ("named", Align::Left),
            ("a forbidden effect alone", Align::Left),
            ("right, of all", Align::Left),
        ]);
        let mut cases: BTreeMap<&str, Vec<&Row>> = BTreeMap::new();
        for row in &self.rows {
            cases.entry(&row.case).or_default().push(row);
        }
        cases.insert("all", self.rows.iter().collect());
        for (case, rows) in cases {
            let can = || rows.iter().filter(|r| r.decidable);
            table.push([
                case.to_owned(),
                Share::count(can().map(|r| r.right)).to_string(),
                Share::count(can().map(|r| r.mark.named)).to_string(),
                Share::count(can().map(|r| r.mark.forbidden_alone)).to_string(),
                Share::count(rows.iter().map(|r| r.right)).to_string(),
            ]);
        }
        table
    }

    /// Every decidable variant is right.
    pub fn is_right(&self) -> bool {
        self.rows.iter().filter(|r| r.decidable).all(|r| r.right)
    }
}

fn complaint(row: &Row) -> String {
    if let Some(why) = &row.unanswered {
        return format!("NO ANSWER ({why})");
    }
    let mut text = Vec::new();
    if !row.decidable {
        text.push("undecidable".to_owned());
    }
    if row.right {
        text.push("yes".to_owned());
    }
    if !row.mark.named {
        text.push("NOT NAMED".to_owned());
    }
    if !row.mark.forbidden.is_empty() {
        text.push(format!("FORBIDDEN {}", row.mark.forbidden.join(" ")));
    }
    if !row.mark.error_reached {
        text.push("WORSE THAN THE TRUTH".to_owned());
    }
    text.join("; ")
}
