//! What an experiment of many runs tells, as plain data: for the page. RT: no.

use super::plot::Plot;
use super::table::Table;

/// A heading with what stands under it.
#[derive(Clone, Debug, Default)]
pub struct Chapter {
    /// Heading.
    pub heading: String,
    /// How to read it.
    pub note: String,
    /// Drawings.
    pub plots: Vec<Plot>,
    /// Numbers.
    pub table: Table,
}

/// The whole page.
#[derive(Clone, Debug, Default)]
pub struct Experiment {
    /// Name of the experiment's file.
    pub name: String,
    /// One or two sentences; the first is the headline.
    pub headline: String,
    /// In this order.
    pub chapters: Vec<Chapter>,
    /// Where it comes from: hash, version.
    pub source: String,
}
