//! A ranking as horizontal bars. RT: no.

use super::Tone;
use crate::report::table::escape;

/// One bar.
#[derive(Debug, Clone)]
pub struct Bar {
    /// Name at the left.
    pub name: String,
    /// Length.
    pub value: f64,
    /// Text at the end of the bar.
    pub text: String,
    /// Colour.
    pub tone: Tone,
}

const ROW: f64 = 26.0;
/// Room for a name, at least.
const NAME: f64 = 250.0;
/// Width of a letter of 12 px, with margin.
const LETTER: f64 = 6.8;
const TEXT: f64 = 150.0;

/// Bars from zero, the longest as long as the paper allows; negative values have no bar.
pub fn ranking(bars: &[Bar], width: f64) -> String {
    let height = ROW * bars.len() as f64 + 6.0;
    let letters = bars.iter().map(|bar| bar.name.chars().count()).max().unwrap_or(0);
    let name = (LETTER * letters as f64 + 14.0).max(NAME);
    let longest = bars.iter().map(|bar| bar.value).fold(f64::MIN_POSITIVE, f64::max);
    let mut out = format!(
        "<svg class=\"plot\" xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" \
         height=\"{height}\" role=\"img\" aria-label=\"ranking\">"
    );
    for (i, bar) in bars.iter().enumerate() {
        let length = (bar.value / longest).max(0.0) * (width - name - TEXT);
        let (top, base) = (ROW * i as f64 + 4.0, ROW * i as f64 + 18.0);
        out += &format!(
            "<text class=\"strong\" x=\"{:.0}\" y=\"{base}\" text-anchor=\"end\">{}</text>\
             <rect class=\"bar {}\" x=\"{name}\" y=\"{top}\" width=\"{length:.1}\" height=\"18\" rx=\"2\"/>\
             <text x=\"{:.1}\" y=\"{base}\">{}</text>",
            name - 10.0,
            escape(&bar.name),
            bar.tone.class(),
            name + length + 8.0,
            escape(&bar.text)
        );
    }
    out + "</svg>"
}
