//! Fewer windows for a first look.
//!
//! Some thousand samples tell a leader from who loses by far, and what a recording that is left out says. So many windows of every
//! recording are kept, evenly.
//! RT: no.

use crate::diagnose::screen::ltv::LtvWindow;
use crate::identify::fitted_model::FittedModel;
use crate::identify::problem::Problem;

/// Samples that tell a leader from the rest; the cases of other laboratories at hand have about as many in all.
const ENOUGH_SAMPLES: usize = 6000;

/// Fewest windows of each recording that are kept: a window has initial states of its own, and one or two can be overlaid by wrong base
/// parameters whatever is missing.
const LEAST_OF_EACH: usize = 3;

/// Evenly chosen windows with about [`ENOUGH_SAMPLES`] of all `samples`; `None` if that is not many fewer.
#[must_use]
pub fn few(problem: &Problem, samples: usize) -> Option<Vec<usize>> {
    evenly(problem, samples / ENOUGH_SAMPLES)
}

/// `windows` of the tangent of `of` with only those of [`few`]; the others are left out. What rings, vibrates or goes with the position
/// shows in every window alike.
#[must_use]
pub fn windows_of_a_first_look(of: &FittedModel, windows: &[LtvWindow]) -> Vec<LtvWindow> {
    let samples = of.residuals.iter().flatten().map(Vec::len).sum();
    let kept = few(&of.problem, samples);
    let is_kept = |w: usize| kept.as_ref().is_none_or(|kept| kept.contains(&w));
    let seen = |(w, window): (usize, &LtvWindow)| if is_kept(w) { window.clone() } else { window.left_out() };
    windows.iter().enumerate().map(seen).collect()
}

/// One window of so many, evenly; `None` if these are all.
#[must_use]
pub fn evenly(problem: &Problem, part: usize) -> Option<Vec<usize>> {
    if part < 2 {
        return None;
    }
    let mut kept = Vec::new();
    for r in 0..problem.recordings.len() {
        let mine: Vec<usize> = (0..problem.windows.len()).filter(|w| problem.windows[*w].0 == r).collect();
        let count = mine.len().div_ceil(part).max(LEAST_OF_EACH).min(mine.len());
        kept.extend((0..count).map(|i| mine[i * mine.len() / count]));
    }
    (kept.len() < problem.windows.len()).then_some(kept)
}
