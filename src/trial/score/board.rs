//! All marks together: the table that is printed, and its totals. RT: no.

use std::collections::BTreeMap;

use super::hardware::HardwareMark;
use super::simulated::Mark;
use super::spread::interval;
use super::wilson::Share;
use crate::report::table::{Align, Table, number};

/// The mark of one case.
#[derive(Debug, Clone)]
pub enum CaseMark {
    /// Truth known.
    Simulated(Mark),
    /// Something known.
    Hardware(HardwareMark),
    /// Nothing known of it.
    Unknown(String),
}

/// One row of the table.
#[derive(Debug, Clone)]
pub struct Row {
    /// Name of the case.
    pub case: String,
    /// What the truth is, in short.
    pub truth: String,
    /// The verdict given.
    pub verdict: String,
    /// What was named, in short.
    pub named: String,
    /// Time a user waited, s.
    pub seconds: f64,
    /// How well; without an answer, what an empty answer earns.
    pub mark: CaseMark,
    /// Why there is no answer.
    pub unanswered: Option<String>,
}

/// Median of the finite values.
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut sorted: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    match sorted.len() {
        0 => None,
        n if n % 2 == 0 => Some((sorted[middle - 1] + sorted[middle]) / 2.0),
        _ => Some(sorted[middle]),
    }
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

fn shown(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), number)
}

fn percent(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), |v| format!("{:.0} %", 100.0 * v))
}

/// The rows as a table.
pub fn case_table(rows: &[Row]) -> Table {
    let columns = ["case", "truth", "verdict", "named", "ok", "set", "param err", "IoU", "gain", "s"];
    let heading: Vec<(&str, Align)> =
        columns.iter().enumerate().map(|(i, name)| (*name, if i < 5 { Align::Left } else { Align::Right })).collect();
    let mut table = Table::new(&heading);
    for row in rows {
        let known = [row.case.clone(), row.truth.clone(), row.verdict.clone(), row.named.clone()];
        table.push(known.into_iter().chain(judgement(row)).chain([format!("{:.1}", row.seconds)]));
    }
    table
}

fn judgement(row: &Row) -> [String; 5] {
    if let Some(why) = &row.unanswered {
        return only(format!("NO ANSWER ({why})"));
    }
    match &row.mark {
        CaseMark::Simulated(mark) => simulated_cells(mark),
        CaseMark::Hardware(mark) => hardware_cells(mark),
        CaseMark::Unknown(why) => only(format!("no truth ({why})")),
    }
}

fn only(text: String) -> [String; 5] {
    [text, String::new(), String::new(), String::new(), String::new()]
}

fn simulated_cells(mark: &Mark) -> [String; 5] {
    let ok = match (mark.right(), mark.false_alarm()) {
        (true, _) => "yes",
        (false, true) => "FALSE ALARM",
        (false, false) if mark.contained && mark.extra > 0 && !mark.healthy => "more",
        (false, false) if mark.contained && !mark.healthy => "verdict",
        (false, false) if mark.healthy => "verdict",
        (false, false) => "NO",
    };
    [
        ok.to_owned(),
        mark.set_sizes.iter().map(ToString::to_string).collect::<Vec<_>>().join(","),
        median(mark.leading_errors.iter().copied()).map_or_else(String::new, |v| percent(Some(v))),
        mean(&mark.time_iou).map_or_else(String::new, number),
        mark.gain.map_or_else(String::new, |v| percent(Some(v))),
    ]
}

fn hardware_cells(mark: &HardwareMark) -> [String; 5] {
    let mut complaints = Vec::new();
    if !mark.verdict_right {
        complaints.push("verdict".to_owned());
    }
    if mark.required.0 < mark.required.1 {
        complaints.push(format!("required {}/{}", mark.required.0, mark.required.1));
    }
    if !mark.forbidden.is_empty() {
        complaints.push(format!("FORBIDDEN {}", mark.forbidden.join(" ")));
    }
    for (channel, found, limit) in mark.errors.iter().filter(|(_, found, limit)| found > limit) {
        complaints.push(format!("{channel} {} > {}", number(*found), number(*limit)));
    }
    let ok = if complaints.is_empty() { "yes".to_owned() } else { format!("NO: {}", complaints.join("; ")) };
    let ranges = format!("{}/{} in range", mark.in_range.0, mark.in_range.1);
    let place = if mark.place_right { "place ok" } else { "place?" };
    let worst = mark.errors.iter().map(|(_, found, limit)| found / limit).fold(f64::NAN, f64::max);
    [
        ok,
        String::new(),
        ranges,
        place.to_owned(),
        if worst.is_nan() { String::new() } else { format!("{worst:.2} of limit") },
    ]
}

/// Everything that is counted over all cases.
pub fn totals_table(rows: &[Row]) -> Table {
    let mut table = Table::new(&[("over all cases", Align::Left), ("", Align::Left), ("floor", Align::Left)]);
    let simulated: Vec<&Mark> = rows
        .iter()
        .filter_map(|row| match &row.mark {
            CaseMark::Simulated(mark) => Some(mark),
            CaseMark::Hardware(_) | CaseMark::Unknown(_) => None,
        })
        .collect();
    if !simulated.is_empty() {
        simulated_totals(&mut table, &simulated);
    }
    hardware_totals(&mut table, rows);
    common_totals(&mut table, rows);
    table
}

fn line(table: &mut Table, name: &str, value: impl std::fmt::Display, floor: &str) {
    table.push([name.to_owned(), value.to_string(), floor.to_owned()]);
}

fn simulated_totals(table: &mut Table, marks: &[&Mark]) {
    let listed: Vec<&&Mark> = marks.iter().filter(|m| !m.healthy && !m.outside_library).collect();
    let decidable: Vec<&&&Mark> = listed.iter().filter(|m| !m.undecidable).collect();
    let sets: Vec<f64> = listed.iter().flat_map(|m| m.set_sizes.iter().map(|n| *n as f64)).collect();
    line(table, "top-1, decidable effects", Share::count(decidable.iter().map(|m| m.top1)), "90 %");
    line(table, "truth in the answered set", Share::count(listed.iter().map(|m| m.contained)), "97 %");
    line(table, "mean set size", shown(mean(&sets)), "1.5");
    line(table, "nothing made up beside the truth", Share::count(listed.iter().map(|m| m.extra == 0)), "");
    let healthy = marks.iter().filter(|m| m.healthy);
    line(table, "false alarms on healthy cases", Share::count(healthy.clone().map(|m| m.false_alarm())), "<= 2 %");
    line(table, "healthy verdict exact", Share::count(healthy.map(|m| m.verdict_right)), "");
    let outside = marks.iter().filter(|m| m.outside_library);
    line(table, "unlisted said where true", Share::count(outside.map(|m| m.verdict_right)), "");
    let pairs = listed.iter().filter(|m| m.undecidable);
    line(table, "undecidable: a twin named", Share::count(pairs.clone().map(|m| m.contained)), "");
    line(table, "undecidable: said as a set", Share::count(pairs.map(|m| m.said_as_set)), "all");
    simulated_figures(table, marks);
}

/// A figure with its 95 % interval.
fn sure(values: &[f64], statistic: fn(&[f64]) -> Option<f64>, text: fn(Option<f64>) -> String) -> String {
    let range = interval(values, statistic);
    let range = range.map_or_else(String::new, |(low, high)| format!("  [{}, {}]", text(Some(low)), text(Some(high))));
    text(statistic(values)) + &range
}

fn middle(values: &[f64]) -> Option<f64> {
    median(values.iter().copied())
}

fn simulated_figures(table: &mut Table, marks: &[&Mark]) {
    let all_of = |part: fn(&Mark) -> &[f64]| -> Vec<f64> { marks.iter().flat_map(|m| part(m)).copied().collect() };
    let (leading, all) = (all_of(|m| &m.leading_errors), all_of(|m| &m.all_errors));
    let overlaps = all_of(|m| &m.time_iou);
    let gains: Vec<f64> = marks.iter().filter_map(|m| m.gain).collect();
    line(table, "parameter error, leading, median", sure(&leading, middle, percent), "<= 15 %");
    line(table, "parameter error, all, median", sure(&all, middle, percent), "");
    intervals(table, marks);
    line(table, "time IoU, mean", sure(&overlaps, mean, shown), "0.6");
    line(table, "time IoU, median", sure(&overlaps, middle, shown), "");
    line(table, "recoverable held-out gain, mean", sure(&gains, mean, percent), "80 %");
    line(table, "recoverable held-out gain, median", sure(&gains, middle, percent), "");
    line(table, "  cases above 80 %", Share::count(gains.iter().map(|g| *g >= 0.8)), "");
    line(table, "right in every respect", Share::count(marks.iter().map(|m| m.right())), "");
}

/// Share of the 95 % intervals that contain the truth, in all and by effect and parameter.
fn intervals(table: &mut Table, marks: &[&Mark]) {
    let all = || marks.iter().flat_map(|m| &m.intervals);
    line(table, "95 % intervals that hold", Share::count(all().map(|(_, holds)| *holds)), "95 %");
    let mut by_name: BTreeMap<&str, Vec<bool>> = BTreeMap::new();
    for (name, holds) in all() {
        by_name.entry(name).or_default().push(*holds);
    }
    for (name, holds) in by_name {
        let hits = holds.iter().filter(|h| **h).count();
        line(table, &format!("  {name}"), format!("{hits} of {}", holds.len()), "");
    }
}

fn hardware_totals(table: &mut Table, rows: &[Row]) {
    let marks: Vec<&HardwareMark> = rows
        .iter()
        .filter_map(|row| match &row.mark {
            CaseMark::Hardware(mark) => Some(mark),
            CaseMark::Simulated(_) | CaseMark::Unknown(_) => None,
        })
        .collect();
    if marks.is_empty() {
        return;
    }
    let sum = |part: fn(&HardwareMark) -> (usize, usize)| {
        let all = marks.iter().map(|m| part(m)).fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        Share { hits: all.0, of: all.1 }
    };
    line(table, "hardware: right in every respect", Share::count(marks.iter().map(|m| m.right())), "all");
    line(table, "hardware: required effects named", sum(|m| m.required), "all");
    line(table, "hardware: stretch effects named", sum(|m| m.stretch), "");
    line(table, "hardware: nothing forbidden named", Share::count(marks.iter().map(|m| m.forbidden.is_empty())), "all");
    line(table, "hardware: held-out error accepted", Share::count(marks.iter().map(|m| m.errors_accepted())), "all");
    line(table, "hardware: place right", Share::count(marks.iter().map(|m| m.place_right)), "");
    line(table, "hardware: values in plausible range", sum(|m| m.in_range), "");
}

fn common_totals(table: &mut Table, rows: &[Row]) {
    let unanswered = rows.iter().filter(|row| row.unanswered.is_some()).count();
    line(table, "cases without an answer", format!("{unanswered} of {}", rows.len()), "0");
    let seconds: Vec<f64> = rows.iter().map(|row| row.seconds).filter(|s| *s > 0.0).collect();
    let longest = seconds.iter().copied().fold(f64::NAN, f64::max);
    line(table, "seconds, median (longest)", format!("{} ({})", shown(median(seconds)), number(longest)), "< 20");
}
