//! Plots as SVG: lines, bands, shaded intervals, histograms; linear and logarithmic axes.
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
        /// Upper edge.
        high: Vec<f64>,
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
