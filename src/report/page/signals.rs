//! The drawings of the page: measured against simulated, residuals where the mismatch lives, laws. RT: no.

use super::section;
use crate::report::findings::{Figure, Findings, Law, Place, Trace};
use crate::report::plot::{Axis, Mark, Plot, Tone};
use crate::report::table::{escape, number};

/// Small drawings beside the large one.
const FURTHER: usize = 4;

/// Measured against given, re-fitted and explained, on recordings that were never fitted.
pub(super) fn proof(findings: &Findings) -> String {
    let ranked = ranked_figures(findings);
    let Some((lead, trace)) = ranked.first() else { return String::new() };
    let never = if lead.use_ == "heldout" { "a recording that was never fitted" } else { "a fitted recording" };
    let mut body =
        format!("<p class=\"soft\">{}, channel {}: {never}.</p>", escape(&trace.recording), escape(&trace.channel));
    body += &cards(lead);
    body += &figure(&overlay(trace, 860.0, 300.0), "");
    body += &figure(&residual(trace, &findings.diagnosis.places, 860.0, 190.0), "Measured minus simulated.");
    let small: String = ranked.iter().skip(1).take(FURTHER).map(|(row, trace)| small_figure(row, trace)).collect();
    if !small.is_empty() {
        body += &format!("<div class=\"pair\">{small}</div>");
    }
    section("Does the simulation follow?", &body)
}

/// Held-out figures that have a trace, the one that tells most first: the largest fall from given to explained.
fn ranked_figures(findings: &Findings) -> Vec<(&Figure, &Trace)> {
    let heldout = findings.diagnosis.fit.iter().filter(|row| row.use_ == "heldout");
    let mut rows: Vec<(&Figure, &Trace)> = heldout.filter_map(|row| Some((row, trace_of(findings, row)?))).collect();
    if rows.is_empty() {
        rows = findings.diagnosis.fit.iter().filter_map(|row| Some((row, trace_of(findings, row)?))).collect();
    }
    let fall = |row: &Figure| {
        let before = if findings.diagnosis.missing.is_empty() { row.nrmse_given } else { row.nrmse_refitted };
        let ratio = before / row.nrmse_explained;
        if ratio.is_finite() { ratio } else { 0.0 }
    };
    rows.sort_by(|a, b| fall(b.0).total_cmp(&fall(a.0)));
    rows
}

fn trace_of<'a>(findings: &'a Findings, row: &Figure) -> Option<&'a Trace> {
    findings.traces.iter().find(|trace| trace.recording == row.recording && trace.channel == row.channel)
}

fn cards(row: &Figure) -> String {
    let card = |class: &str, name: &str, value: f64| {
        let text = if value.is_finite() { format!("{} %", number(100.0 * value)) } else { "ran away".to_owned() };
        // To the bit: nothing was added.
        let nothing = class == "e" && value.to_bits() == row.nrmse_refitted.to_bits();
        let text = if nothing { "nothing added".to_owned() } else { text };
        format!("<div class=\"card {class}\"><div class=\"k\">error, {name}</div><div class=\"v\">{text}</div></div>")
    };
    format!(
        "<div class=\"cards\">{}{}{}</div>",
        card("g", "as given", row.nrmse_given),
        card("r", "parameters re-fitted", row.nrmse_refitted),
        card("e", "explained", row.nrmse_explained)
    )
}

fn figure(plot: &Plot, caption: &str) -> String {
    let caption =
        if caption.is_empty() { String::new() } else { format!("<figcaption>{}</figcaption>", escape(caption)) };
    format!("<figure>{}{caption}</figure>", plot.to_svg())
}

fn small_figure(row: &Figure, trace: &Trace) -> String {
    let caption = format!(
        "error {} % given, {} % re-fitted, {} % explained",
        number(100.0 * row.nrmse_given),
        number(100.0 * row.nrmse_refitted),
        number(100.0 * row.nrmse_explained)
    );
    titled(trace, &caption)
}

/// A drawing of one trace, half the page wide.
pub(super) fn titled(trace: &Trace, caption: &str) -> String {
    let mut plot = overlay(trace, 450.0, 220.0);
    plot.title = format!("{}, {}", trace.recording, trace.channel);
    figure(&plot, caption)
}

/// The same over the whole page, with a legend.
pub(super) fn wide(trace: &Trace, caption: &str) -> String {
    let mut plot = overlay(trace, 860.0, 260.0);
    plot.title = format!("{}, {}", trace.recording, trace.channel);
    figure(&plot, caption)
}

/// How far from what it must show a drawing follows another curve, in heights of that.
const FOLLOWED: f64 = 1.0;

/// Range that shows all of `shown`, and of `beside` what is not far off it: a simulation that runs away leaves the paper.
fn range_of(shown: &[&[f64]], beside: &[&[f64]]) -> [f64; 2] {
    let Some([low, high]) = ends(shown).filter(|[low, high]| low < high) else { return [-1.0, 1.0] };
    let reach = FOLLOWED * (high - low);
    let [below, above] = ends(beside).unwrap_or([low, high]);
    let (low, high) = (below.clamp(low - reach, low), above.clamp(high, high + reach));
    [low - 0.08 * (high - low), high + 0.08 * (high - low)]
}

/// The lowest and the highest value; none if there is no finite one.
fn ends(signals: &[&[f64]]) -> Option<[f64; 2]> {
    let finite = signals.iter().flat_map(|signal| signal.iter()).filter(|v| v.is_finite());
    finite
        .fold(None, |range: Option<[f64; 2]>, v| Some(range.map_or([*v; 2], |[low, high]| [low.min(*v), high.max(*v)])))
}

/// `name_rad_s` as a label: name, unit. A name without its unit gets it.
fn label(channel: &str, unit: &str) -> String {
    let units = [("_rad_s", "rad/s"), ("_m_s", "m/s"), ("_rad", "rad"), ("_nm", "Nm"), ("_m", "m"), ("_deg", "deg")];
    let named = units.iter().find_map(|(end, unit)| channel.strip_suffix(end).map(|name| (name, *unit)));
    let (name, unit) = named.unwrap_or((channel, unit));
    if unit.is_empty() { name.to_owned() } else { format!("{name}, {unit}") }
}

fn overlay(trace: &Trace, width: f64, height: f64) -> Plot {
    let [low, high] = range_of(&[&trace.measured, &trace.explained], &[&trace.given, &trace.refitted]);
    let y = Axis::linear(&label(&trace.channel, trace.unit)).within(low, high);
    let mut plot = Plot::new(Axis::linear("time, s"), y)
        .line("measured", Tone::Measured, &trace.t_s, &trace.measured)
        .line("given", Tone::Given, &trace.t_s, &trace.given)
        .line("re-fitted", Tone::Refitted, &trace.t_s, &trace.refitted);
    if trace.explained != trace.refitted {
        plot = plot.line("explained", Tone::Explained, &trace.t_s, &trace.explained);
    }
    (plot.width, plot.height) = (width, height);
    plot
}

fn difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

fn residual(trace: &Trace, places: &[Place], width: f64, height: f64) -> Plot {
    let refitted = difference(&trace.measured, &trace.refitted);
    let explained = difference(&trace.measured, &trace.explained);
    let [low, high] = range_of(&[&refitted, &explained], &[]);
    let y = Axis::linear(&format!("residual, {}", label(&trace.channel, trace.unit))).within(low, high);
    let mut plot = Plot::new(Axis::linear("time, s"), y);
    let here = places.iter().filter(|p| p.recording == trace.recording && p.channel == trace.channel);
    plot.marks.extend(here.map(|p| Mark::Span { tone: Tone::Attention, from: p.from_s, to: p.to_s }));
    plot = plot.line("re-fitted", Tone::Refitted, &trace.t_s, &refitted);
    if trace.explained != trace.refitted {
        plot = plot.line("explained", Tone::Explained, &trace.t_s, &explained);
    }
    (plot.width, plot.height) = (width, height);
    plot
}

/// Where the mismatch lives: in words, and the signal around the first place.
pub(super) fn place(findings: &Findings) -> String {
    let places = &findings.diagnosis.places;
    let Some(first) = places.first() else { return String::new() };
    let items: String = places
        .iter()
        .filter(|place| place.share >= 0.005)
        .take(5)
        .map(|place| format!("<li>{}</li>", escape(&sentence(place))))
        .collect();
    let further = places.iter().filter(|place| place.share >= 0.005).count().saturating_sub(5);
    let more = if further > 0 { format!("<p class=\"soft\">and {further} more places.</p>") } else { String::new() };
    let mut body = format!("<ul class=\"said\">{items}</ul>{more}");
    let found = findings.traces.iter().find(|t| t.recording == first.recording && t.channel == first.channel);
    if let Some(trace) = found {
        body += &around(trace, first, places);
    }
    section("Where the mismatch lives", &body)
}

fn sentence(place: &Place) -> String {
    let mut text = format!(
        "{} % of it in {}, {}, from {} to {} s",
        number((100.0 * place.share).round()),
        place.recording,
        place.channel,
        number(place.from_s),
        number(place.to_s)
    );
    if let Some(phase) = &place.phase {
        text += &format!(", {phase}");
    }
    if let Some(region) = &place.region {
        text += &format!(", where {region}");
    }
    if let Some([low, high]) = place.band_hz {
        text += &format!(", between {} and {} Hz", number(low), number(high));
    }
    text + "."
}

/// Signal and residual around a place, with a third of its length at both sides.
fn around(trace: &Trace, first: &Place, places: &[Place]) -> String {
    let (Some(start), Some(end)) = (trace.t_s.first(), trace.t_s.last()) else { return String::new() };
    let margin = ((first.to_s - first.from_s) / 3.0).max(0.02 * (end - start));
    let (from, to) = ((first.from_s - margin).max(*start), (first.to_s + margin).min(*end));
    let cut = cut(trace, from, to);
    let mut residual = residual(&cut, places, 860.0, 220.0);
    residual.x = residual.x.within(from, to);
    let mut drawings = String::new();
    if to - from < 0.5 * (end - start) {
        let mut overlay = overlay(&cut, 860.0, 240.0);
        overlay.title = format!("{}, {}", trace.recording, trace.channel);
        overlay.x = overlay.x.within(from, to);
        drawings += &figure(&overlay, "");
    } else {
        residual.title = format!("{}, {}", trace.recording, trace.channel);
    }
    drawings + &figure(&residual, "Measured minus simulated; shaded: the places above.")
}

fn cut(trace: &Trace, from: f64, to: f64) -> Trace {
    let inside = |signal: &[f64]| -> Vec<f64> {
        trace.t_s.iter().zip(signal).filter(|(t, _)| (from..=to).contains(*t)).map(|(_, v)| *v).collect()
    };
    Trace {
        recording: trace.recording.clone(),
        use_: trace.use_.clone(),
        channel: trace.channel.clone(),
        unit: trace.unit,
        t_s: inside(&trace.t_s),
        measured: inside(&trace.measured),
        given: inside(&trace.given),
        refitted: inside(&trace.refitted),
        explained: inside(&trace.explained),
    }
}

/// The laws that were found, with their bands.
pub(super) fn laws(findings: &Findings) -> String {
    if findings.laws.is_empty() {
        return String::new();
    }
    let wide = findings.laws.len() == 1;
    let drawings: String = findings.laws.iter().map(|law| figure(&law_plot(law, wide), "")).collect();
    let body = if wide { drawings } else { format!("<div class=\"pair\">{drawings}</div>") };
    let heading =
        if findings.diagnosis.missing.is_empty() { "The laws that hold" } else { "The law, as the recordings tell it" };
    section(heading, &format!("{body}<p class=\"soft\">Line: best estimate. Band: 95 %.</p>"))
}

fn law_plot(law: &Law, wide: bool) -> Plot {
    let mut plot = Plot::new(Axis::linear(&law.x_label), Axis::linear(&law.y_label));
    plot.title.clone_from(&law.title);
    (plot.width, plot.height) = if wide { (860.0, 300.0) } else { (450.0, 250.0) };
    let (x, low, high) = (law.x.clone(), law.low.clone(), law.high.clone());
    plot.marks.push(Mark::Band { name: String::new(), tone: Tone::Explained, x, low, high });
    plot.line("", Tone::Explained, &law.x, &law.y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drawing_shows_the_simulation_as_given_unless_it_runs_away() {
        let [low, high] = range_of(&[&[-1.0, 1.0]], &[&[-1.4, 1.5]]);
        assert!(low < -1.4 && high > 1.5, "{low} {high}");
        let [low, high] = range_of(&[&[-1.0, 1.0]], &[&[0.0, 1e9, f64::NAN]]);
        assert!(low > -1.5 && high < 3.5, "{low} {high}");
        let [low, high] = range_of(&[&[f64::NAN]], &[]);
        assert!(low < 0.0 && high > 0.0, "nothing to show");
    }

    #[test]
    fn a_channel_whose_name_carries_no_unit_has_that_of_its_sensor() {
        assert_eq!(label("q1_pos", "rad"), "q1_pos, rad");
        assert_eq!(label("q1_rad_s", "rad/s"), "q1, rad/s");
    }
}
