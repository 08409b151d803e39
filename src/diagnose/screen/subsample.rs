//! Fewer windows for a first look.
//!
//! Some thousand samples tell a leader from who loses by far, and what a recording that is left out says. So many windows of every
//! recording are kept, evenly.
//! RT: no.

use crate::identify::problem::Problem;

/// Samples that tell a leader from the rest; the cases of other laboratories at hand have about as many in all.
const ENOUGH_SAMPLES: usize = 6000;

/// Fewest windows that are kept, over all recordings and of each: a window has initial states of its own, and a few of
/// them can be overlaid by wrong base parameters whatever is missing.
const LEAST_WINDOWS: usize = 16;
const LEAST_OF_EACH: usize = 3;

/// Evenly chosen windows with about [`ENOUGH_SAMPLES`] of all `samples`; `None` if that is not many fewer.
#[must_use]
pub fn few(problem: &Problem, samples: usize) -> Option<Vec<usize>> {
    evenly(problem, samples / ENOUGH_SAMPLES)
}

/// One window of so many, evenly; `None` if these are all.
#[must_use]
pub fn evenly(problem: &Problem, part: usize) -> Option<Vec<usize>> {
    if part < 2 {
        return None;
    }
    let mut kept = Vec::new();
    let least = LEAST_WINDOWS.div_ceil(problem.recordings.len().max(1)).max(LEAST_OF_EACH);
    for r in 0..problem.recordings.len() {
        let mine: Vec<usize> = (0..problem.windows.len()).filter(|w| problem.windows[*w].0 == r).collect();
        let count = mine.len().div_ceil(part).max(least).min(mine.len());
        kept.extend((0..count).map(|i| mine[i * mine.len() / count]));
    }
    (kept.len() < problem.windows.len()).then_some(kept)
}
