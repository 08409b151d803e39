//! A model on fewer windows, for the first look at many candidates.
//!
//! A round fits a dozen candidates of which most lose by far. Windows are kept evenly ([`few`]), and those in which a single event of
//! a candidate lies. Leaders are fitted to everything.
//! RT: no.

use crate::diagnose::judge::criterion::Context;
use crate::diagnose::library::candidates::Candidate;
use crate::diagnose::screen::subsample::{evenly, few};
use crate::identify::fit::Point;
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::samples;
use crate::identify::problem::Problem;

/// Samples that tell from which start one step promises most.
const LOOK_SAMPLES: usize = 3000;

/// A hypothesis on some of its windows.
pub struct Subsample {
    /// On those windows.
    pub hypothesis: FittedModel,
    /// Fewer samples ask for less gain.
    pub context: Context,
    kept: Vec<usize>,
}

/// `of` on fewer windows; `None` if all of them are needed.
#[must_use]
pub fn subsampled(of: &FittedModel, library: &[Candidate], context: &Context) -> Option<Subsample> {
    let kept = few(&of.problem, context.samples)?;
    Some(Subsample::of(of, &kept, library, context))
}

impl Subsample {
    fn of(of: &FittedModel, kept: &[usize], library: &[Candidate], context: &Context) -> Self {
        let wanted = |w: &usize| kept.contains(w) || holds_event(&of.problem, *w, library);
        let kept: Vec<usize> = (0..of.problem.spans.len()).filter(wanted).collect();
        let hypothesis = of.on_windows(&kept);
        let context = Context { samples: samples(&hypothesis.residuals, &context.floors), ..context.clone() };
        Self { hypothesis, context, kept }
    }

    /// Still fewer windows, for the screening of starts.
    #[must_use]
    pub fn thinner(&self, library: &[Candidate]) -> Self {
        let all: Vec<usize> = (0..self.kept.len()).collect();
        let kept = evenly(&self.hypothesis.problem, self.context.samples / LOOK_SAMPLES).unwrap_or(all);
        Self::of(&self.hypothesis, &kept, library, &self.context)
    }

    /// These windows of another fit of the same recordings.
    #[must_use]
    pub fn windows_of(&self, of: &FittedModel) -> FittedModel {
        of.on_windows(&self.kept)
    }

    /// `trial`, fitted to these windows, as a start on all windows of `base`.
    #[must_use]
    pub fn widened(&self, base: &FittedModel, trial: &FittedModel) -> (Problem, Point) {
        let (problem, mut point) = base.extended(trial.rig.clone());
        for (w, state) in self.kept.iter().zip(&trial.point.states) {
            point.states[*w].clone_from(state);
        }
        (problem, point)
    }
}

/// True if a candidate's single event lies in window `w`.
fn holds_event(problem: &Problem, w: usize, library: &[Candidate]) -> bool {
    let recording = &problem.recordings[problem.windows[w].0];
    let rows = &problem.spans[w];
    let (from, to) = (recording.times[rows.start], recording.times[rows.end - 1]);
    let inside = |c: &Candidate| {
        let time = c.keys.iter().position(|k| k.name == "time");
        time.is_some_and(|k| c.starts.iter().any(|s| s[k] >= from && s[k] <= to))
    };
    library.iter().any(|c| c.only.as_ref() == Some(&recording.name) && inside(c))
}
