//! The page of an experiment: chapters of plots and tables. RT: no.

use super::{document, first_sentence, paragraph, section};
use crate::report::experiment::{Chapter, Experiment};
use crate::report::table::escape;

/// The page of an experiment, as one file that stands alone.
#[must_use]
pub fn experiment(told: &Experiment) -> String {
    let (first, rest) = first_sentence(&told.headline);
    let head = format!(
        "<header><div class=\"top\"><span><b>Compass</b> experiment</span><span>{}</span></div><h1>{}</h1>{}</header>",
        escape(&told.name),
        escape(first),
        paragraph(rest.trim())
    );
    let body: String = told.chapters.iter().map(chapter).collect();
    let foot = format!("<footer>{}</footer>", escape(&told.source));
    document(&format!("Compass experiment: {}", told.name), &[head, body, foot].concat())
}

fn chapter(chapter: &Chapter) -> String {
    let note = if chapter.note.is_empty() {
        String::new()
    } else {
        format!("<p class=\"soft\">{}</p>", escape(&chapter.note))
    };
    let plots: String = chapter.plots.iter().map(|plot| format!("<figure>{}</figure>", plot.to_svg())).collect();
    let table = if chapter.table.is_empty() { String::new() } else { chapter.table.to_html() };
    section(&chapter.heading, &[note, plots, table].concat())
}
