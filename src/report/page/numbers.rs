//! The tables of the page, and the ranking of the candidates. RT: no.

use super::{section, words};
use crate::report::findings::{Estimate, Findings, Member, Ranked};
use crate::report::interval::{interval, said_before, value, with_interval};
use crate::report::plot::Tone;
use crate::report::plot::bars::{Bar, ranking};
use crate::report::table::{Align, Table, escape, number};

/// Bars shown.
const CANDIDATES: usize = 10;

/// What is missing, what else was considered, what was ruled out and why.
pub(super) fn candidates(findings: &Findings) -> String {
    let mut body = String::new();
    if !findings.diagnosis.missing.is_empty() {
        body += &found_table(findings).to_html();
    }
    if !findings.ranking.is_empty() {
        let bars: Vec<Bar> = findings.ranking.iter().take(CANDIDATES).map(bar).collect();
        body += "<p class=\"soft\">How much likelier each candidate alone makes the recordings (twice the rise of the \
                 log-likelihood), everything else re-fitted with it. Blue: in the answer.</p>";
        body += &format!("<figure>{}</figure>", ranking(&bars, 860.0));
    }
    if !findings.diagnosis.rejected.is_empty() {
        body += "<h2>Ruled out, and why</h2>";
        body += &rejected_table(findings).to_html();
    }
    if body.is_empty() { body } else { section("The candidates", &body) }
}

fn bar(candidate: &Ranked) -> Bar {
    // The part of the misfit counts noise as well: beside a small misfit even a useless candidate would show a bar.
    let part = format!(", explains {} %", number((100.0 * candidate.explained).round()));
    Bar {
        name: format!("{} at {}", words(&candidate.effect), candidate.at),
        value: candidate.gain.max(0.0),
        text: number(candidate.gain.max(0.0).round()) + if candidate.chosen { &part } else { "" },
        tone: if candidate.chosen { Tone::Explained } else { Tone::Given },
    }
}

fn found_table(findings: &Findings) -> Table {
    let mut table = Table::new(&[
        ("missing", Align::Left),
        ("at", Align::Left),
        ("weight", Align::Right),
        ("parameters, with their 95 % intervals", Align::Left),
    ]);
    for (i, entry) in findings.diagnosis.missing.iter().enumerate() {
        for (j, member) in entry.one_of.iter().enumerate() {
            let lead = if j == 0 { format!("{}. ", i + 1) } else { "    or ".to_owned() };
            let weight = format!("{:.2}", member.weight);
            table.push([lead + &words(&member.effect), member.at.clone(), weight, values(member)]);
        }
    }
    table
}

fn values(member: &Member) -> String {
    let told = |(key, v): (&String, &Estimate)| format!("{} {}", words(key), said_before(&with_interval(v)));
    member.parameters.iter().map(told).collect::<Vec<_>>().join(", ")
}

fn rejected_table(findings: &Findings) -> Table {
    let mut table = Table::new(&[("effect", Align::Left), ("at", Align::Left), ("why not", Align::Left)]);
    for rejected in &findings.diagnosis.rejected {
        table.push([words(&rejected.effect), rejected.at.clone(), rejected.why.clone()]);
    }
    table
}

/// Free-run errors of every recording and channel.
pub(super) fn errors(findings: &Findings) -> String {
    let right = Align::Right;
    let mut table = Table::new(&[
        ("recording", Align::Left),
        ("use", Align::Left),
        ("channel", Align::Left),
        ("given", right),
        ("re-fitted", right),
        ("explained", right),
    ]);
    for row in &findings.diagnosis.fit {
        let figures = [row.nrmse_given, row.nrmse_refitted, row.nrmse_explained].map(number);
        table.push([row.recording.clone(), row.use_.clone(), row.channel.clone()].into_iter().chain(figures));
    }
    if table.is_empty() {
        return String::new();
    }
    section("Errors of the free runs (part of the channel's standard deviation)", &table.to_html())
}

/// Parameters before and after, and what the data does not determine.
pub(super) fn parameters(findings: &Findings) -> String {
    let right = Align::Right;
    let mut table = Table::new(&[
        ("parameter", Align::Left),
        ("given", right),
        ("re-fitted", right),
        ("explained", right),
        ("95 % interval", right),
        ("unit", Align::Left),
        ("", Align::Left),
    ]);
    for line in &findings.parameters {
        let before = [line.given, line.refitted].map(number);
        let after = [value(&line.explained), interval(&line.explained), line.explained.unit.to_owned()];
        let note = if line.at_bound { "at its bound" } else { "" };
        table.push([line.name.clone()].into_iter().chain(before).chain(after).chain([note.to_owned()]));
    }
    let open: String = findings.undetermined.iter().map(|text| format!("<li>{}</li>", escape(text))).collect();
    let open = if open.is_empty() {
        open
    } else {
        format!("<p>Not determined by these recordings:</p><ul class=\"said\">{open}</ul>")
    };
    if table.is_empty() && open.is_empty() {
        return String::new();
    }
    section("Parameters", &(table.without_empty_columns().to_html() + &open))
}
