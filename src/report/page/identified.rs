//! The page of an identification: how well the simulation follows, the numbers, what stays open. RT: no.

use super::{document, section, signals};
use crate::report::findings::Figure;
use crate::report::identified::Identified;
use crate::report::table::{escape, number};

/// Drawings at most; the table below names them all.
const DRAWN: usize = 8;

/// The page of an identification, as one file that stands alone.
#[must_use]
pub fn identification(found: &Identified) -> String {
    let body = [head(found), drawings(found), numbers(found), errors(found), warnings(found), foot()].concat();
    document(&format!("Compass identification: {}", found.rig), &body)
}

fn head(found: &Identified) -> String {
    format!(
        "<header><div class=\"top\"><span><b>Compass</b> identification</span><span>{}</span></div><h1>{}</h1></header>",
        escape(&found.rig),
        escape(&found.headline)
    )
}

/// Held-out recordings first: they were never fitted.
fn drawings(found: &Identified) -> String {
    let mut figures: Vec<&Figure> = found.figures.iter().collect();
    figures.sort_by_key(|f| f.use_ != "heldout");
    let drawn: String = figures
        .iter()
        .take(DRAWN)
        .filter_map(|f| {
            let trace = found.traces.iter().find(|t| t.recording == f.recording && t.channel == f.channel)?;
            let never = if f.use_ == "heldout" { "never fitted" } else { "fitted" };
            let caption = format!(
                "{never}; error {} % as given, {} % fitted",
                number(100.0 * f.nrmse_given),
                number(100.0 * f.nrmse_refitted)
            );
            Some(signals::titled(trace, &caption))
        })
        .collect();
    section("Does the simulation follow?", &format!("<div class=\"pair\">{drawn}</div>"))
}

fn numbers(found: &Identified) -> String {
    let open: String = found.undetermined.iter().map(|text| format!("<li>{}</li>", escape(text))).collect();
    let open = if open.is_empty() {
        "<p>The recordings determine every combination of these numbers.</p>".to_owned()
    } else {
        format!("<p>Not determined by these recordings, and what would determine it:</p><ul class=\"said\">{open}</ul>")
    };
    section("Parameters", &(found.parameters().to_html() + &open))
}

fn errors(found: &Identified) -> String {
    section("Errors of the free runs (part of the channel's standard deviation)", &found.errors().to_html())
}

fn warnings(found: &Identified) -> String {
    super::odd_input(&found.warnings)
}

fn foot() -> String {
    format!(
        "<footer>compass {} · ±: one standard deviation, from the curvature of the fit, the colour of the residual that it \
         leaves and how much its blocks scatter. The intervals hold if no physics is missing: <code>compass diagnose</code> tells.</footer>",
        env!("CARGO_PKG_VERSION")
    )
}
