//! Does a force without a name hold where it was not fitted?
//!
//! RT: no.

use crate::diagnose::judge::criterion::Context;
use crate::diagnose::nameless::force_patterns::Pattern;
use crate::diagnose::robustness::held_out::{AdditionTest, Confirmation, cut_elsewhere, quiet_noise};
use crate::diagnose::screen::linearise::ltv_windows;
use crate::diagnose::screen::ltv::LtvWindow;
use crate::identify::fitted_model::FittedModel;
use crate::identify::noise::Colour;
use std::cell::OnceCell;

/// Where a force that `of` lacks is asked whether it holds: prepared when the first one is.
pub(in crate::diagnose) struct Elsewhere<'f> {
    of: &'f FittedModel,
    context: &'f Context,
    held_out: OnceCell<Option<Examiner>>,
    cut: OnceCell<Option<Examiner>>,
}

impl<'f> Elsewhere<'f> {
    /// For forces that `of` lacks.
    pub(in crate::diagnose) fn of(of: &'f FittedModel, context: &'f Context) -> Self {
        Self { of, context, held_out: OnceCell::new(), cut: OnceCell::new() }
    }

    /// What bears `pattern` out where it was not fitted; `None` if nothing does. A force that goes with the state is asked of recordings that
    /// no fit saw; a vibration, and any force if there are none, of the same recordings cut at other instants; a force that acts
    /// at times of its own recording, where it must leave but noise. One that acts all the time and goes with time alone
    /// predicts nothing.
    pub(in crate::diagnose) fn bears_out(&self, pattern: &Pattern, said: &mut dyn FnMut(&str)) -> Option<Confirmation> {
        let Self { of, context, .. } = *self;
        let floors = &context.floors;
        let event = pattern.interval.map(|(recording, ..)| of.problem.recordings[recording].name.clone());
        if event.is_none() && pattern.is_over_time() && !pattern.is_sine() {
            return None;
        }
        let told = if let Some(event) = event {
            let quiet = quiet_noise(of, |r| r.name == event, floors);
            let runs = cut_elsewhere(of, |r| r.name == event, None, floors);
            runs.and_then(|runs| Some(Examiner::of(&runs, Some(&quiet), floors)?.asks(pattern)))
        } else {
            let (kept, runs): (_, &dyn Fn() -> Option<FittedModel>) = match &context.held_out {
                Some(held_out) if !pattern.is_over_time() => (&self.held_out, &|| held_out.predicted_by(of, floors)),
                _ => (&self.cut, &|| cut_elsewhere(of, |_| true, None, floors)),
            };
            let examiner = kept.get_or_init(|| Examiner::of(&runs()?, None, floors));
            examiner.as_ref().map(|examiner| examiner.asks(pattern))
        };
        let told = told?;
        said(&format!("   a force over {}, where it was not fitted: {told}", pattern.over));
        told.holds().then_some(told)
    }
}

/// Runs of a model where it was not fitted, and what an addition to its readings is worth there.
struct Examiner {
    windows: Vec<LtvWindow>,
    addition: AdditionTest,
}

impl Examiner {
    fn of(runs: &FittedModel, quiet: Option<&[Colour]>, floors: &[f64]) -> Option<Self> {
        Some(Self { windows: ltv_windows(runs)?, addition: AdditionTest::new(runs, quiet, floors)? })
    }

    fn asks(&self, pattern: &Pattern) -> Confirmation {
        self.addition.told(&pattern.force.response(&self.windows, pattern.joint))
    }
}
