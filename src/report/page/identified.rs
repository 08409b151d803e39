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
    let (first, rest) = super::first_sentence(&found.headline);
    format!(
        "<header><div class=\"top\"><span><b>Compass</b> identification</span><span>{}</span></div><h1>{}</h1>{}</header>",
        escape(&found.rig),
        escape(first),
        super::paragraph(rest)
    )
}

/// Held-out recordings first: they were never fitted.
fn drawings(found: &Identified) -> String {
    let mut figures: Vec<&Figure> = found.figures.iter().collect();
    figures.sort_by_key(|f| f.use_ != "heldout");
    let drawn = |(i, f): (usize, &&Figure)| {
        let trace = found.traces.iter().find(|t| t.recording == f.recording && t.channel == f.channel)?;
        // The first is wide enough for the legend.
        Some(if i == 0 { signals::wide(trace, &caption(f)) } else { signals::titled(trace, &caption(f)) })
    };
    let mut drawn = figures.iter().enumerate().take(DRAWN).filter_map(drawn);
    let lead = drawn.next().unwrap_or_default();
    let none = "<p class=\"soft\">No recording was held out: a model is proved on data that it was not fitted to. Mark one \
                recording <code>use = \"heldout\"</code>.</p>";
    let note = if figures.iter().any(|f| f.use_ == "heldout") { "" } else { none };
    let rest: String = drawn.collect();
    section("Does the simulation follow?", &format!("{note}{lead}<div class=\"pair\">{rest}</div>"))
}

fn caption(f: &Figure) -> String {
    let never = if f.use_ == "heldout" { "never fitted" } else { "fitted" };
    let tell = |x: f64| if x.is_finite() { format!("{} %", number(100.0 * x)) } else { "ran away".to_owned() };
    format!("{never}; error {} as given, {} fitted", tell(f.nrmse_given), tell(f.nrmse_refitted))
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
        "<footer>compass {} · 95 % intervals: from the curvature of the fit, the colour of the residual that it leaves and how \
         much its blocks scatter, and what no residual shows, the instant to a row and the form of the laws. They hold if no physics is missing: <code>compass diagnose</code> tells.</footer>",
        env!("CARGO_PKG_VERSION")
    )
}
