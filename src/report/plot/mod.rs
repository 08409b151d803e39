//! Plots as SVG: lines, bands, lower bounds, shaded intervals, histograms; linear and logarithmic axes.
//!
//! Own writer, not `plotters`: the tones are classes, so that one drawing serves light, dark and paper, and every tone
//! has a dash of its own, so that it also serves a black-and-white printer and colour-blind readers.
//!
//! - [`axis`]: ranges, ticks, places on the paper
//! - [`decimate`]: as many points as the paper has columns, extremes kept
//! - [`bars`]: a ranking as horizontal bars
//!
//! RT: no.

pub mod axis;
pub mod bars;
pub mod decimate;
mod draw;
mod tone;

pub use axis::{Axis, Scale};
pub use tone::{STYLE, Tone};

/// One thing drawn in a plot. Values that are not finite leave a gap.
#[derive(Debug, Clone)]
pub enum Mark {
    /// A signal.
    Line {
        /// Legend.
        name: String,
        /// Colour and dash.
        tone: Tone,
        /// Abscissae, ascending.
        x: Vec<f64>,
        /// Ordinates.
        y: Vec<f64>,
    },
    /// What lies between two curves.
    Band {
        /// Legend.
        name: String,
        /// Colour.
        tone: Tone,
        /// Abscissae, ascending.
        x: Vec<f64>,
        /// Lower edge.
        low: Vec<f64>,
        /// Upper edge; infinite where the band is open upwards.
        high: Vec<f64>,
    },
    /// Arrows upwards: values of which only a lower bound is known.
    AtLeast {
        /// Colour.
        tone: Tone,
        /// Abscissae.
        x: Vec<f64>,
        /// The bounds.
        y: Vec<f64>,
    },
    /// A shaded interval of the abscissa, full height.
    Span {
        /// Colour.
        tone: Tone,
        /// Start.
        from: f64,
        /// End.
        to: f64,
    },
    /// A horizontal line.
    Level {
        /// Colour and dash.
        tone: Tone,
        /// Where.
        y: f64,
    },
    /// A histogram: one bar between every two edges.
    Bars {
        /// Legend.
        name: String,
        /// Colour.
        tone: Tone,
        /// Edges, ascending, one more than heights.
        edges: Vec<f64>,
        /// Heights.
        heights: Vec<f64>,
    },
}

/// A drawing with two axes. Later marks lie over earlier ones.
#[derive(Debug, Clone)]
pub struct Plot {
    /// Above the drawing; may be empty.
    pub title: String,
    /// Horizontal.
    pub x: Axis,
    /// Vertical.
    pub y: Axis,
    /// What is drawn.
    pub marks: Vec<Mark>,
    /// Width of the paper, px.
    pub width: f64,
    /// Height of the paper, px.
    pub height: f64,
}

impl Plot {
    /// An empty plot of page width.
    pub fn new(x: Axis, y: Axis) -> Self {
        Self { title: String::new(), x, y, marks: Vec::new(), width: 860.0, height: 280.0 }
    }

    /// With one more line.
    #[must_use]
    pub fn line(mut self, name: &str, tone: Tone, x: &[f64], y: &[f64]) -> Self {
        self.marks.push(Mark::Line { name: name.to_owned(), tone, x: x.to_vec(), y: y.to_vec() });
        self
    }

    /// The `<svg>` element for a page that contains [`STYLE`].
    pub fn to_svg(&self) -> String {
        draw::svg(self, "")
    }

    /// A file that stands alone.
    pub fn to_file_svg(&self) -> String {
        draw::svg(self, STYLE)
    }
}

/// Several plots one below the other, as a file that stands alone: for `compass predict` and for results of a bench.
pub fn sheet(plots: &[Plot]) -> String {
    let width = plots.iter().map(|plot| plot.width).fold(1.0, f64::max);
    let height: f64 = plots.iter().map(|plot| plot.height).sum();
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\">\
         <style>{STYLE}</style><rect width=\"100%\" height=\"100%\" fill=\"var(--paper)\"/>"
    );
    let mut top = 0.0;
    for plot in plots {
        // An inner svg takes its place by x and y.
        out += &plot.to_svg().replacen("<svg ", &format!("<svg y=\"{top}\" "), 1);
        top += plot.height;
    }
    out + "</svg>\n"
}

/// Measured against simulated, channel by channel: names, and the two signals over the same times.
pub fn comparison(t_s: &[f64], channels: &[(&str, &[f64], &[f64])]) -> String {
    let plot = |(name, measured, simulated): &(&str, &[f64], &[f64])| {
        Plot::new(Axis::linear("time, s"), Axis::linear(name)).line("measured", Tone::Measured, t_s, measured).line(
            "simulated",
            Tone::Explained,
            t_s,
            simulated,
        )
    };
    sheet(&channels.iter().map(plot).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_comparison_draws_every_channel_once() {
        let t = [0.0, 1.0, 2.0];
        let svg = comparison(&t, &[("q1_rad", &t, &t), ("q2_rad", &t, &t)]);
        assert_eq!(svg.matches("line measured").count(), 4, "a line and its sample in the legend, twice");
        assert!(svg.contains("q2_rad"));
    }
}
