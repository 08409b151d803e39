//! Two effects that hide each other, added together.
//!
//! RT: no.

use crate::diagnose::judge::accept::{is_accepted, is_admissible};
use crate::diagnose::judge::criterion::{Context, detection_threshold};
use crate::diagnose::judge::flexibility::is_local_here;
use crate::diagnose::judge::numbers::QUARTER;
use crate::diagnose::judge::simplicity::order_by_penalised_gain;
use crate::diagnose::library::candidate_fit::CandidateFit;
use crate::diagnose::library::candidates::Candidate;
use crate::diagnose::robustness::cross_validation::CrossValidation;
use crate::diagnose::search::budget::MOST_EFFORT;
use crate::diagnose::search::round::{Asked, round, tell};
use crate::diagnose::search::runners_up::{COMPANIONS, LEADS};
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::is_misfit;

/// On top of `found`, whose last round was `last`: a leader that does not hold on recordings left out, and the effect that makes it hold: two that hide each other look, one
/// at a time, like nothing that is true (an offset beside friction that falls with speed). Both together must leave but noise.
pub(super) fn add_jointly(
    found: &FittedModel,
    last: &[CandidateFit],
    library: &dyn Fn(&FittedModel) -> Vec<Candidate>,
    left_out: &CrossValidation,
    context: &Context,
    said: &mut dyn FnMut(&str),
) -> Option<[CandidateFit; 2]> {
    let mut leaders: Vec<&CandidateFit> = Vec::new();
    for trial in last.iter().filter(|t| t.gain > detection_threshold(context, t.candidate.keys.len())) {
        let e = trial.hypothesis.rig.effects.len() - 1;
        let is_new = leaders.iter().all(|l| l.candidate.effect != trial.candidate.effect);
        if is_new && !is_local_here(found, &trial.candidate) && is_admissible(&trial.hypothesis, e, context) {
            leaders.push(trial);
        }
    }
    let most = leaders.first().map_or(0.0, |l| l.gain);
    leaders.retain(|l| l.gain > LEADS * most);
    // Who has few numbers makes up for little of what the other does, and is soon asked.
    leaders.sort_by_key(|l| l.candidate.keys.iter().filter(|k| k.max > k.min).count());
    for leader in leaders.into_iter().take(COMPANIONS) {
        let now = &leader.hypothesis;
        if now.problem.effort.spent() > MOST_EFFORT / 3 * 2 {
            return None;
        }
        said(&format!("   with {}@{} for company", leader.candidate.effect, leader.candidate.at));
        let asked = Asked { library: &library(now), near: &[] };
        let mut seconds = round(now, (now, Vec::new()), asked, context, &mut *said);
        tell(&seconds, context, said);
        order_by_penalised_gain(&mut seconds, context);
        let Some(second) = seconds.first().filter(|s| !is_misfit(&s.hypothesis.residuals, &context.floors)) else {
            continue;
        };
        let kept = left_out.cross_validated_gain_ratio(&second.hypothesis, &context.floors).unwrap_or(0.0);
        said(&format!("   with {} both keep {kept:.2} of their gain on recordings left out", second.candidate.effect));
        let alone = || {
            CrossValidation::of(now, &context.floors)?.cross_validated_gain_ratio(&second.hypothesis, &context.floors)
        };
        if kept >= QUARTER && is_accepted(now, (second, &seconds), leader.gain, alone, context, said) {
            return Some([leader.clone(), second.clone()]);
        }
    }
    None
}
