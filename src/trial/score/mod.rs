//! Marks for diagnoses: answers against what is known.
//!
//! ```text
//! cases ── runner (the binary, one process per case) ──> diagnosis.json ── answer ─┐
//! truth of a trial (JSON) ── truth ── simulated ─┬──> board: table, totals        │
//! facts about hardware (TOML) ── truth ── hardware ┘ <────────────────────────────┘
//! ```
//! How things are counted:
//! - An entry of `missing` answers a hidden effect if one of its members stands in the truth's `one_of` (the effect and
//!   the twins that this data cannot tell apart). No entry answers two effects.
//! - Top-1: the heaviest member of the entry does. Contained: any member does. Every hidden effect of a case counts.
//! - `extra`: entries that answer nothing. On a healthy case that is a false alarm.
//! - Gain: part of the held-out error between re-fitted and floor that `nrmse_explained` recovered.
//!
//! RT: no.

mod answer;
mod board;
mod hardware;
mod interval;
mod runner;
mod simulated;
mod spread;
mod truth;
mod wilson;

use std::path::Path;

pub use answer::{Answer, Entry, FitRow, Found, Member, Place, ReadError};
pub use board::{CaseMark, Row, case_table, median, totals_table};
pub use hardware::{HardwareMark, SampleCounts, mark as mark_hardware, token_fits};
pub use interval::time_iou;
pub use runner::{RunEnd, Runner};
pub use simulated::{Mark, mark as mark_simulated};
pub use truth::{Acceptance, Accepted, Expected, Hardware, Hidden, Interval, Recoverable, Simulated, Truth};
pub use wilson::Share;

/// The row of one case: reads its answer, finds its truth, marks it.
///
/// A case without an answer is marked like an empty one: it stays in every count.
pub fn row(case: &Path, answer: &Path, truth: &Path, end: &RunEnd) -> Row {
    let name = case.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let truth = Truth::find(truth, &name);
    let (answer, unanswered) = match end {
        RunEnd::Failed(why) => (Answer::none(), Some(why.clone())),
        RunEnd::Answered(_) | RunEnd::Reused => match Answer::read(answer) {
            Ok(answer) => (answer, None),
            Err(error) => (Answer::none(), Some(error.to_string())),
        },
    };
    let mark = match &truth {
        Ok(Truth::Simulated(truth)) => CaseMark::Simulated(mark_simulated(truth, &answer)),
        Ok(Truth::Hardware(truth)) => CaseMark::Hardware(mark_hardware(truth, &answer, &count_samples(case, &answer))),
        Err(error) => CaseMark::Unknown(error.to_string()),
    };
    let seconds = if let RunEnd::Answered(seconds) = end { *seconds } else { answer.seconds };
    let known = truth.as_ref().map_or_else(|_| String::new(), describe);
    Row { case: name, truth: known, verdict: answer.verdict.clone(), named: names(&answer), seconds, mark, unanswered }
}

fn describe(truth: &Truth) -> String {
    match truth {
        Truth::Simulated(truth) if truth.effects.is_empty() => format!("{} healthy", truth.level),
        Truth::Simulated(truth) => {
            let effects: Vec<String> = truth.effects.iter().map(|e| format!("{}@{}", e.effect, e.at)).collect();
            format!("{} {} {}", truth.level, truth.bin, effects.join(" + "))
        }
        Truth::Hardware(truth) => {
            let required = truth.expected.iter().filter(|e| e.tier == "required");
            required.map(|e| e.any_of.join(" | ")).collect::<Vec<_>>().join(" + ")
        }
    }
}

/// What an answer names, in short.
pub fn names(answer: &Answer) -> String {
    let entry =
        |entry: &Entry| entry.one_of.iter().map(|m| format!("{}@{}", m.effect, m.at)).collect::<Vec<_>>().join(" | ");
    answer.missing.iter().map(entry).collect::<Vec<_>>().join(" + ")
}

/// Filled cells by held-out recording and channel. A recording that cannot be read as CSV weighs like any other.
fn count_samples(case: &Path, answer: &Answer) -> SampleCounts {
    let rows = answer.fit.iter().filter(|row| row.role == "heldout");
    rows.filter_map(|row| {
        let count = filled_cells(&case.join(&row.recording), &row.channel)?;
        Some(((row.recording.clone(), row.channel.clone()), count))
    })
    .collect()
}

fn filled_cells(recording: &Path, channel: &str) -> Option<usize> {
    let mut reader = csv::Reader::from_path(recording).ok()?;
    let column = reader.headers().ok()?.iter().position(|name| name == channel)?;
    Some(reader.records().flatten().filter(|record| record.get(column).is_some_and(|cell| !cell.is_empty())).count())
}
