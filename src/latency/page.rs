//! `compass bench --html`: the table, then the histograms. RT: no.

use super::window::{Paired, Window};
use crate::report::plot::{Axis, Plot, STYLE, Tone};
use crate::report::table::escape;

/// One comparison of the page.
#[derive(Clone, Debug)]
pub struct Chapter<'a> {
    /// What is compared.
    pub title: &'a str,
    /// Who the rival is.
    pub rival: &'a str,
    /// The windows.
    pub pair: &'a Paired,
}

/// The page: the table given, then a histogram per chapter. Self-contained.
#[must_use]
pub fn html(heading: &str, table_html: &str, chapters: &[Chapter]) -> String {
    let plots: String = chapters
        .iter()
        .map(|c| format!("<h2>{} <small>against {}</small></h2>\n{}\n", escape(c.title), escape(c.rival), histogram(c)))
        .collect();
    format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>{0}</title><style>{STYLE}{PAGE}</style>\n<h1>{0}</h1>\n{table_html}\n{plots}</html>\n",
        escape(heading)
    )
}

const PAGE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:1000px;margin:2em auto;padding:0 1em;color:var(--ink);background:var(--paper)}\
table{border-collapse:collapse}th,td{padding:.25em .8em;border-bottom:1px solid var(--faint);text-align:left}\
th.n,td.n{text-align:right}small{color:var(--soft);font-weight:normal}svg{max-width:100%;height:auto}";

/// Share of samples above a latency, both axes logarithmic: the tail is what matters, and it shows here.
fn histogram(chapter: &Chapter) -> String {
    let (ours, theirs) = (Paired::pooled(&chapter.pair.ours), Paired::pooled(&chapter.pair.theirs));
    let (x1, y1) = tail(&ours);
    let (x2, y2) = tail(&theirs);
    Plot::new(Axis::log("latency, us"), Axis::log("share of samples above"))
        .line("Compass", Tone::Series(0), &x1, &y1)
        .line(chapter.rival, Tone::Series(1), &x2, &y2)
        .to_svg()
}

#[expect(clippy::cast_precision_loss, reason = "fewer than 2^52 samples")]
fn tail(window: &Window) -> (Vec<f64>, Vec<f64>) {
    let n = window.len() as f64;
    window.samples_us().iter().enumerate().map(|(i, us)| (*us, (n - i as f64) / n)).unzip()
}
