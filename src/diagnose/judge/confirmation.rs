//! Whether an effect holds where it was not fitted, by what recordings that no fit saw, or an event's own cut elsewhere, tell.
//!
//! RT: no.

use super::criterion::{Context, detection_threshold};
use super::numbers::{GREATER_PART, QUARTER};
use crate::diagnose::robustness::held_out::Confirmation;
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::white;

impl Confirmation {
    /// True if it speaks for the one model against another of as many numbers.
    #[must_use]
    pub fn bears_out(&self, context: &Context) -> bool {
        self.replicates(0, context)
    }

    /// True if it speaks for a force that has no other claim than that it is seen.
    #[must_use]
    pub fn holds(&self) -> bool {
        is_kept(self.promised, self.gained) && is_removed_where_it_acts(self.left)
    }

    /// True if it speaks for an effect of so many numbers.
    #[must_use]
    pub fn replicates(&self, numbers: usize, context: &Context) -> bool {
        is_borne_out(self.promised, self.gained, numbers, context)
    }

    /// True if it speaks against an effect of so many numbers.
    #[must_use]
    pub fn refutes(&self, numbers: usize, context: &Context) -> bool {
        is_refuted(self.promised, self.gained, numbers, context) || !is_removed_where_it_acts(self.left)
    }
}

/// True if a channel of the recordings kept back is predicted much worse than those that were fitted.
#[must_use]
pub fn is_contradicted(of: &FittedModel, context: &Context) -> bool {
    let kept_back = context.held_out.as_ref().and_then(|held_out| held_out.residuals(&of.rig));
    let Some(kept_back) = kept_back else { return false };
    let (fitted, kept_back) = (white(&of.residuals, &context.floors), white(&kept_back, &context.floors));
    fitted.iter().zip(&kept_back).any(|(fitted, kept_back)| fitted.sigma < GREATER_PART * kept_back.sigma)
}

/// True if of the fall of squares that a change of predictions would be, were it the truth, so much is so that it may be.
fn is_kept(promised: f64, gained: f64) -> bool {
    gained > 0.0 && gained >= QUARTER * promised
}

/// True if recordings that were not fitted speak against an effect of so many numbers: it changes what is predicted there by more
/// than chance, `promised`, and of the fall of squares that this change would be, were it the truth, it keeps less than [`QUARTER`],
/// as it must where fitted recordings are left out in turn. What changes nothing there is not asked.
fn is_refuted(promised: f64, gained: f64, numbers: usize, context: &Context) -> bool {
    promised > detection_threshold(context, numbers) && !is_kept(promised, gained)
}

/// True if an event is the explanation where it acts: of the squares above noise it leaves little there.
fn is_removed_where_it_acts(left: f64) -> bool {
    left <= QUARTER
}

/// True if recordings that were not fitted speak for one model against another that has so many numbers less: the change between them is
/// more than chance, and [`QUARTER`] of it is so.
fn is_borne_out(promised: f64, gained: f64, numbers: usize, context: &Context) -> bool {
    promised > detection_threshold(context, numbers) && is_kept(promised, gained)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::worked::{Shown, shown};
    use crate::diagnose::library::candidates::Candidate;
    use crate::diagnose::library::worked::{FLOORS, hiding};
    use crate::diagnose::robustness::held_out::HeldOut;
    use crate::identify::experiment::{Experiment, Recording};
    use crate::model::rig::Use;
    use std::sync::Arc;

    #[test]
    fn an_effect_is_refuted_where_it_changes_much_and_little_of_that_is_so() {
        let context = Context { samples: 1000, ..shown("").context };
        assert!(is_refuted(200.0, 20.0, 1, &context) && is_refuted(200.0, -150.0, 1, &context));
        assert!(!is_refuted(200.0, 180.0, 1, &context), "the truth keeps all of it");
        assert!(!is_refuted(60.0, -60.0, 1, &context), "what hardly acts there is not asked");
    }

    const PUSH: &str = "[[effect]]\neffect = \"external_push\"\nat = \"q1\"\nimpulse = ";

    /// What a push at .6 s of so much promises and gains in windows of 1 s that were not fitted, if `happened` is the truth.
    fn push(happened: &str, so_much: f64) -> Confirmation {
        let problem = hiding(happened);
        let with = problem.fitted(&format!("{PUSH}{so_much}\ntime = 0.6\n"), 10);
        let without = problem.fitted("", 10);
        let candidate = Candidate { only: Some("a.csv".into()), ..problem.candidate("external_push", "q1") };
        Confirmation::of_candidate(&candidate, &with, &without, None, &FLOORS).unwrap()
    }

    #[test]
    fn a_push_holds_in_its_own_recording_cut_at_other_instants_if_it_happened() {
        let context = shown("").context;
        let happened = push(&format!("{PUSH}0.01\ntime = 0.6\n"), 0.01);
        assert!(!happened.refutes(2, &context) && happened.left < 0.1, "{happened}");
        let other = push(&format!("{PUSH}-0.01\ntime = 0.6\n"), 0.01);
        assert!(other.refutes(2, &context), "the other way round: {other}");
        let nothing = push("", 0.01);
        assert!(nothing.refutes(2, &context), "{nothing}");
    }

    const DRAG: &str = "[[effect]]\neffect = \"quadratic_drag\"\nat = \"q1\"\nquadratic = 0.004\n";

    #[test]
    fn a_model_is_contradicted_where_it_predicts_much_worse_than_it_was_fitted() {
        let Shown { context, problem } = shown(DRAG);
        let right = problem.fitted(DRAG, 20);
        let kept_back = Recording { usage: Use::Heldout, ..right.problem.recordings[0].clone() };
        let experiment = Experiment { rig: right.rig.clone(), recordings: vec![kept_back] };
        let context = Context { held_out: HeldOut::of(&experiment, &right.rig).map(Arc::new), ..context };
        assert!(!is_contradicted(&right, &context));
        assert!(is_contradicted(&hiding("").fitted("", 20), &context), "fitted to another machine");
        assert!(!is_contradicted(&right, &Context { held_out: None, ..context }), "nothing was kept back");
    }
}
