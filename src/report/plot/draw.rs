//! The SVG of a plot. RT: no.

use std::fmt::Write;

use super::axis::Ruler;
use super::decimate;
use super::{Mark, Plot, Tone};
use crate::report::table::escape;

const LEFT: f64 = 64.0;
const RIGHT: f64 = 16.0;
const BOTTOM: f64 = 40.0;
/// Room for the title, if there is one.
const TITLE: f64 = 22.0;
/// Room for the label of the vertical axis and the legend.
const HEAD: f64 = 26.0;

/// Narrower drawings have no legend: it would run into the label.
const LEGEND_FROM: f64 = 500.0;

/// The inner rectangle and its rulers.
struct Sheet {
    left: f64,
    top: f64,
    width: f64,
    height: f64,
    x: Ruler,
    y: Ruler,
}

impl Sheet {
    fn new(plot: &Plot) -> Self {
        let top = HEAD + if plot.title.is_empty() { 0.0 } else { TITLE };
        let (width, height) = (plot.width - LEFT - RIGHT, plot.height - top - BOTTOM);
        let x = Ruler::new(&plot.x, plot.marks.iter().flat_map(abscissae).copied(), width, 0.0);
        let y = Ruler::new(&plot.y, plot.marks.iter().flat_map(ordinates).copied(), height, 0.06);
        Self { left: LEFT, top, width, height, x, y }
    }

    /// Place inside the sheet, y downwards.
    fn point(&self, x: f64, y: f64) -> Option<(f64, f64)> {
        Some((self.x.place(x)?, self.height - self.y.place(y)?))
    }
}

fn abscissae(mark: &Mark) -> &[f64] {
    match mark {
        Mark::Line { x, .. } | Mark::Band { x, .. } | Mark::AtLeast { x, .. } => x,
        Mark::Bars { edges, .. } => edges,
        Mark::Span { .. } | Mark::Level { .. } => &[],
    }
}

fn ordinates(mark: &Mark) -> Vec<&f64> {
    match mark {
        Mark::Line { y, .. } | Mark::AtLeast { y, .. } => y.iter().collect(),
        Mark::Band { low, high, .. } => low.iter().chain(high).collect(),
        Mark::Bars { heights, .. } => heights.iter().chain(&[0.0]).collect(),
        Mark::Level { y, .. } => vec![y],
        Mark::Span { .. } => Vec::new(),
    }
}

/// The whole element; `style` goes inside, if any.
pub(super) fn svg(plot: &Plot, style: &str) -> String {
    let sheet = Sheet::new(plot);
    let mut out = format!(
        "<svg class=\"plot\" xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0} {1}\" width=\"{0}\" height=\"{1}\" \
         role=\"img\" aria-label=\"{2}\">",
        plot.width,
        plot.height,
        escape(if plot.title.is_empty() { &plot.y.label } else { &plot.title })
    );
    if !style.is_empty() {
        out += &format!("<style>{style}</style><rect width=\"100%\" height=\"100%\" fill=\"var(--paper)\"/>");
    }
    head(&mut out, plot, &sheet);
    grid(&mut out, plot, &sheet);
    // A nested svg clips what leaves the sheet; no id is needed, so plots can share a page.
    put(
        &mut out,
        format_args!(
            "<svg x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" overflow=\"hidden\">",
            sheet.left, sheet.top, sheet.width, sheet.height
        ),
    );
    for mark in &plot.marks {
        draw(&mut out, mark, &sheet);
    }
    out += "</svg>";
    // An arrow from the top of the sheet points beyond it: it is not clipped.
    for mark in &plot.marks {
        if let Mark::AtLeast { tone, x, y } = mark {
            arrows(&mut out, *tone, (x, y), &sheet);
        }
    }
    out + "</svg>"
}

/// Writing into a string cannot fail.
fn put(out: &mut String, text: std::fmt::Arguments<'_>) {
    out.write_fmt(text).unwrap_or_default();
}

fn head(out: &mut String, plot: &Plot, sheet: &Sheet) {
    if !plot.title.is_empty() {
        put(out, format_args!("<text class=\"title\" x=\"4\" y=\"15\">{}</text>", escape(&plot.title)));
    }
    let y = sheet.top - 10.0;
    put(out, format_args!("<text x=\"4\" y=\"{y}\">{}</text>", escape(&plot.y.label)));
    let (x, low) = (sheet.left + sheet.width, plot.height - 5.0);
    put(out, format_args!("<text x=\"{x}\" y=\"{low}\" text-anchor=\"end\">{}</text>", escape(&plot.x.label)));
    // A narrow drawing stands beside a wide one that tells the tones.
    if plot.width >= LEGEND_FROM {
        legend(out, plot, sheet.left + sheet.width, y);
    }
}

/// Samples and names in one row, ending at `right`.
fn legend(out: &mut String, plot: &Plot, right: f64, y: f64) {
    let mut entries: Vec<(&str, Tone, bool)> = Vec::new();
    for mark in &plot.marks {
        let entry = match mark {
            Mark::Line { name, tone, .. } => (name.as_str(), *tone, true),
            Mark::Band { name, tone, .. } | Mark::Bars { name, tone, .. } => (name.as_str(), *tone, false),
            Mark::Span { .. } | Mark::Level { .. } | Mark::AtLeast { .. } => continue,
        };
        if !entry.0.is_empty() && !entries.iter().any(|known| known.0 == entry.0) {
            entries.push(entry);
        }
    }
    let mut x = right;
    for (name, tone, is_line) in entries.into_iter().rev() {
        // Width of a letter of the 12 px sans, rounded up (DejaVu, the widest of the list): 7.3 px. The name begins beside its sample.
        let name_starts = x - 7.3 * name.chars().count() as f64;
        put(out, format_args!("<text class=\"strong\" x=\"{name_starts:.0}\" y=\"{y}\">{}</text>", escape(name)));
        let end = name_starts - 6.0;
        let (start, middle) = (end - 24.0, y - 4.0);
        if is_line {
            put(out, format_args!("<path class=\"line {}\" d=\"M{start:.0} {middle}H{end:.0}\"/>", tone.class()));
        } else {
            put(
                out,
                format_args!(
                    "<rect class=\"area {}\" x=\"{start:.0}\" y=\"{:.0}\" width=\"24\" height=\"10\"/>",
                    tone.class(),
                    middle - 5.0
                ),
            );
        }
        x = start - 16.0;
    }
}

fn grid(out: &mut String, plot: &Plot, sheet: &Sheet) {
    let (right, bottom) = (sheet.left + sheet.width, sheet.top + sheet.height);
    for (value, text) in sheet.y.ticks(per(sheet.height, 34.0)) {
        let Some(place) = sheet.y.place(value) else { continue };
        let y = bottom - place;
        let class = if value == 0.0 && plot.y.scale == super::Scale::Linear { "zero" } else { "grid" };
        put(out, format_args!("<path class=\"{class}\" d=\"M{} {y:.1}H{right}\"/>", sheet.left));
        put(
            out,
            format_args!("<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{text}</text>", sheet.left - 8.0, y + 4.0),
        );
    }
    for (value, text) in sheet.x.ticks(per(sheet.width, 84.0)) {
        let Some(place) = sheet.x.place(value) else { continue };
        let x = sheet.left + place;
        put(out, format_args!("<path class=\"grid\" d=\"M{x:.1} {}V{bottom}\"/>", sheet.top));
        put(out, format_args!("<text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">{text}</text>", bottom + 16.0));
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a handful of ticks")]
fn per(length_px: f64, each_px: f64) -> usize {
    (length_px / each_px).max(2.0) as usize
}

fn draw(out: &mut String, mark: &Mark, sheet: &Sheet) {
    match mark {
        Mark::Line { tone, x, y, .. } => line(out, *tone, x, y, sheet),
        Mark::Band { tone, x, low, high, .. } => band(out, *tone, x, (low, high), sheet),
        Mark::Span { tone, from, to } => span(out, *tone, *from, *to, sheet),
        Mark::Level { tone, y } => line(out, *tone, &sheet.x.ends(), &[*y, *y], sheet),
        Mark::Bars { tone, edges, heights, .. } => bars(out, *tone, edges, heights, sheet),
        Mark::AtLeast { .. } => {}
    }
}

/// The points just outside the sheet stay, so that the line runs to the edge.
fn near(sheet: &Sheet, x: &[f64], i: usize) -> bool {
    let beside = [i.checked_sub(1), Some(i), Some(i + 1)];
    beside.into_iter().flatten().filter_map(|j| x.get(j)).any(|value| sheet.x.shows(*value))
}

fn line(out: &mut String, tone: Tone, x: &[f64], y: &[f64], sheet: &Sheet) {
    let points = (0..x.len().min(y.len())).filter(|i| near(sheet, x, *i)).map(|i| sheet.point(x[i], y[i]));
    let mut path = String::new();
    for run in decimate::runs(points, sheet.width) {
        polyline(&mut path, &run, 'M');
    }
    put(out, format_args!("<path class=\"line {}\" d=\"{path}\"/>", tone.class()));
}

fn polyline(path: &mut String, points: &[(f64, f64)], start: char) {
    for (i, (x, y)) in points.iter().enumerate() {
        let letter = if i == 0 { start } else { 'L' };
        put(path, format_args!("{letter}{x:.1} {y:.1}"));
    }
    if let [(x, y)] = points {
        // A point between two gaps would be invisible: a dot, by the round cap of a line without length.
        put(path, format_args!("L{x:.1} {y:.1}"));
    }
}

/// A band; an upper edge without end lies above the sheet.
fn band(out: &mut String, tone: Tone, x: &[f64], (low, high): (&[f64], &[f64]), sheet: &Sheet) {
    let place = |(x, y): (&f64, &f64)| {
        if *y == f64::INFINITY { Some((sheet.x.place(*x)?, -sheet.height)) } else { sheet.point(*x, *y) }
    };
    let edge = |edge: &[f64]| -> Vec<(f64, f64)> { x.iter().zip(edge).filter_map(place).collect() };
    let mut back = edge(high);
    back.reverse();
    let mut path = String::new();
    polyline(&mut path, &edge(low), 'M');
    polyline(&mut path, &back, 'L');
    put(out, format_args!("<path class=\"area {}\" d=\"{path}Z\"/>", tone.class()));
}

/// Length of an arrow, and how far its head reaches back and to the sides, px.
const ARROW: f64 = 16.0;
const ARROW_HEAD: f64 = 4.0;

/// A dot, an arrow upwards from it, and `≥` beside it; in the coordinates of the whole drawing.
fn arrows(out: &mut String, tone: Tone, (x, y): (&[f64], &[f64]), sheet: &Sheet) {
    let (class, head) = (tone.class(), ARROW_HEAD);
    for (x, y) in x.iter().zip(y).filter_map(|(x, y)| sheet.point(*x, *y)) {
        let (x, y) = (sheet.left + x, sheet.top + y);
        let (tip, beside) = (y - ARROW, x + 2.0 * head);
        put(
            out,
            format_args!(
                "<path class=\"line {class} arrow\" d=\"M{0:.1} {y:.1}H{1:.1}M{x:.1} {y:.1}V{tip:.1}M{0:.1} {2:.1}L{x:.1} \
                 {tip:.1}L{1:.1} {2:.1}\"/><text class=\"strong\" x=\"{beside:.1}\" y=\"{3:.1}\">≥</text>",
                x - head,
                x + head,
                tip + head,
                y - head
            ),
        );
    }
}

fn span(out: &mut String, tone: Tone, from: f64, to: f64, sheet: &Sheet) {
    let (Some(from), Some(to)) = (sheet.x.place(from), sheet.x.place(to)) else { return };
    let (class, height, width) = (tone.class(), sheet.height, (to - from).max(1.5));
    put(
        out,
        format_args!("<rect class=\"area {class}\" x=\"{from:.1}\" y=\"0\" width=\"{width:.1}\" height=\"{height}\"/>"),
    );
}

fn bars(out: &mut String, tone: Tone, edges: &[f64], heights: &[f64], sheet: &Sheet) {
    for (edge, height) in edges.windows(2).zip(heights) {
        let (Some((x, y)), Some(end)) = (sheet.point(edge[0], *height), sheet.x.place(edge[1])) else { continue };
        let (width, height) = ((end - x - 0.5).max(0.5), (sheet.height - y).max(0.0));
        put(
            out,
            format_args!(
                "<rect class=\"bar {}\" x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\"/>",
                tone.class()
            ),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::super::Axis;
    use super::*;

    #[test]
    fn a_long_recording_makes_a_small_file() {
        let t: Vec<f64> = (0..60_000).map(|i| f64::from(i) * 1e-3).collect();
        let y: Vec<f64> = t.iter().map(|t| (*t * 7.0) % 1.0).collect();
        let svg =
            Plot::new(Axis::linear("t, s"), Axis::linear("q, rad")).line("measured", Tone::Measured, &t, &y).to_svg();
        assert!(svg.len() < 60_000, "{}", svg.len());
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }

    #[test]
    fn a_lower_bound_is_an_arrow_and_its_band_is_open_upwards() {
        let mut plot = Plot::new(Axis::linear("floor"), Axis::log("steps"));
        let (x, low, high) = (vec![0.0, 1.0], vec![100.0, 10.0], vec![f64::INFINITY, 90.0]);
        plot.marks.push(Mark::Band { name: String::new(), tone: Tone::Series(0), x, low, high });
        plot.marks.push(Mark::AtLeast { tone: Tone::Series(0), x: vec![0.0], y: vec![300.0] });
        let svg = plot.to_svg();
        assert!(svg.contains('≥') && !svg.contains("inf"));
        let band = svg.split("class=\"area s0\" d=\"").nth(1).unwrap().split('Z').next().unwrap();
        assert!(band.contains(&format!("L0.0 -{:.1}", 280.0 - HEAD - BOTTOM)), "above the sheet: {band}");
    }

    #[test]
    fn a_simulation_that_ran_away_does_not_break_the_drawing() {
        let x = [0.0, 1.0, 2.0, 3.0];
        let y = [0.0, f64::INFINITY, 1e300, f64::NAN];
        let axis = Axis::linear("q").within(-1.0, 1.0);
        let svg = Plot::new(Axis::linear("t"), axis).line("given", Tone::Given, &x, &y).to_svg();
        assert!(!svg.contains("NaN") && !svg.contains("inf") && !svg.contains("e+"));
    }
}
