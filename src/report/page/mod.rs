//! `report.html`: a diagnosis as one page that is read in a minute and stands alone (no script, nothing fetched).
//!
//! From the top: the sentence, the verdict, what would decide, the fit on a recording that was never fitted, where the
//! mismatch lives, the law that was found, the candidates, what was ruled out, the numbers.
//!
//! - [`signals`]: measured against simulated, residuals, laws
//! - [`numbers`]: tables and the ranking
//! - [`identified`]: the page of an identification
//! - [`mod@experiment`]: the page of an experiment of many runs
//!
//! RT: no.

mod experiment;
mod identified;
mod numbers;
mod signals;

use super::findings::{Findings, Verdict};
use super::interval::said_before;
use super::plot::STYLE;
use super::table::escape;

pub use experiment::experiment;
pub use identified::identification;

/// Sizes and spaces; colours come with the plots.
const LAYOUT: &str = include_str!("page.css");

/// The page of a diagnosis.
pub fn html(findings: &Findings) -> String {
    let body = [
        head(findings),
        next(findings),
        signals::proof(findings),
        signals::place(findings),
        signals::laws(findings),
        numbers::candidates(findings),
        numbers::errors(findings),
        numbers::parameters(findings),
        odd_input(&findings.warnings),
        foot(findings),
    ]
    .concat();
    document(&format!("Compass diagnosis: {}", findings.rig), &body)
}

/// A whole file around a body.
pub(super) fn document(title: &str, body: &str) -> String {
    let title = escape(title);
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"><title>{title}</title>\
         <style>{STYLE}{LAYOUT}</style></head><body>{body}</body></html>\n"
    )
}

/// A heading and what follows it.
fn section(heading: &str, body: &str) -> String {
    format!("<section><h2>{}</h2>{body}</section>", escape(heading))
}

/// Id of an effect as words.
fn words(id: &str) -> String {
    id.replace('_', " ")
}

fn head(findings: &Findings) -> String {
    let verdict = findings.diagnosis.verdict;
    let (class, meaning) = verdict_words(verdict);
    let (first, rest) = first_sentence(&findings.headline);
    let headline = said_before(&findings.headline);
    let sentences: String = findings
        .diagnosis
        .missing
        .iter()
        .filter(|entry| !entry.sentence.is_empty() && !headline.contains(&said_before(&entry.sentence)))
        .map(|entry| format!("<li>{}</li>", escape(&entry.sentence)))
        .collect();
    let said = if sentences.is_empty() { String::new() } else { format!("<ul class=\"said\">{sentences}</ul>") };
    format!(
        "<header><div class=\"top\"><span><b>Compass</b> diagnosis</span><span>{}</span></div><h1>{}</h1>{}{said}\
         <p><span class=\"badge {class}\">{class}</span> {meaning}</p></header>",
        escape(&findings.rig),
        escape(first),
        paragraph(rest)
    )
}

/// The first sentence is the headline, further ones are read below it. "0.5" has no blank behind its point.
fn first_sentence(text: &str) -> (&str, &str) {
    text.split_at(text.find(". ").map_or(text.len(), |dot| dot + 1))
}

fn paragraph(text: &str) -> String {
    if text.is_empty() { String::new() } else { format!("<p>{}</p>", escape(text)) }
}

fn verdict_words(verdict: Verdict) -> (&'static str, &'static str) {
    match verdict {
        Verdict::Consistent => ("consistent", "The simulation as given explains the recordings to within their noise."),
        Verdict::Parameters => ("parameters", "New parameter values explain the recordings; no physics is missing."),
        Verdict::Explained => ("explained", "Physics is missing, and the recordings say which."),
        Verdict::Ambiguous => ("ambiguous", "Physics is missing; these recordings allow more than one explanation."),
        Verdict::Unlisted => {
            ("unlisted", "Physics is missing; its place is known, but no effect of the library explains it.")
        }
    }
}

fn next(findings: &Findings) -> String {
    let told = |text: &String| format!("<div class=\"next\"><b>What would decide</b>{}</div>", escape(text));
    findings.diagnosis.next_experiment.as_ref().map(told).unwrap_or_default()
}

fn odd_input(warnings: &[String]) -> String {
    let items: String = warnings.iter().map(|text| format!("<li>{}</li>", escape(text))).collect();
    if items.is_empty() {
        return String::new();
    }
    format!("<div class=\"warn\"><b>Odd in the input</b><ul class=\"said\">{items}</ul></div>")
}

fn foot(findings: &Findings) -> String {
    format!(
        "<footer>compass {} · diagnosis contract schema {} · seed {} · {:.1} s · the same case, seed and version give the \
         same diagnosis. Errors are those of free runs: recorded inputs, no correction on the way; the error is divided by \
         the standard deviation of its channel.</footer>",
        env!("CARGO_PKG_VERSION"),
        findings.diagnosis.schema,
        findings.diagnosis.seed,
        findings.diagnosis.seconds
    )
}

#[cfg(test)]
mod tests;
