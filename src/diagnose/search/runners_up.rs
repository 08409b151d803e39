//! Those that nearly won a round, on top of what won it.
//!
//! Two effects that are both there look like one or the other: each alone explains most of what both do (Coulomb friction of
//! both joints of an arm). Once one of them stands, its numbers have made up for the other, and one linear step promises little.
//! RT: no.

use crate::diagnose::judge::criterion::Context;
use crate::diagnose::judge::flexibility::is_overly_flexible;
use crate::diagnose::library::candidate_fit::{CandidateFit, SelectedEffect, with_effect};
use crate::diagnose::search::round::Start;
use crate::identify::fitted_model::FittedModel;

/// Part of the first one's gain from which others of its round lead as well.
pub(super) const LEADS: f64 = 0.3;

/// Leaders of a round that are tried in company.
pub(super) const COMPANIONS: usize = 3;

/// The others of the round that `winner` won which gained nearly as much, one of each effect and place, on top of it: from a start near
/// nothing, from where they stood, and from their own fit with the winner near nothing. Where the one order ends in a false minimum
/// the other may not. What fits a piece of anything is left out.
#[must_use]
pub fn runners_up(now: &FittedModel, winner: &SelectedEffect, context: &Context) -> Vec<Start> {
    let mut near: Vec<&CandidateFit> = Vec::new();
    for trial in winner.others.iter().filter(|t| t.gain > LEADS * winner.gain) {
        let kind = |t: &CandidateFit| (t.candidate.effect, t.candidate.at.clone());
        let is_new = near.iter().all(|other| kind(other) != kind(trial));
        if is_new && near.len() < COMPANIONS && !is_overly_flexible(now, trial, context) {
            near.push(trial);
        }
    }
    near.into_iter()
        .flat_map(|trial| {
            let (candidate, own) = (&trial.candidate, &trial.hypothesis);
            let start = |from: &FittedModel, rig| Start { candidate: candidate.clone(), from: from.clone(), rig };
            let weak = candidate.starts.first().map(|values| start(now, with_effect(&now.rig, candidate, values)));
            let stood = own.rig.effects.last().map(|effect| {
                let mut rig = now.rig.clone();
                rig.effects.push(effect.clone());
                if candidate.motor_sensor.is_some() {
                    rig.sensors.clone_from(&own.rig.sensors);
                }
                start(now, rig)
            });
            let other_order =
                winner.candidate.starts.first().filter(|_| own.rig.effects.len() == now.rig.effects.len());
            let other_order = other_order.map(|values| {
                let mut rig = with_effect(&own.rig, &winner.candidate, values);
                let last = rig.effects.len() - 1;
                rig.effects.swap(last - 1, last);
                start(own, rig)
            });
            [weak, stood, other_order].into_iter().flatten()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::criterion::detection_threshold;
    use crate::diagnose::judge::worked::{Shown, shown};
    use crate::diagnose::search::round::{Asked, round};

    /// Drag and a spring, of which the drag has won a round: the spring is found beside it, whatever one step promises.
    #[test]
    fn a_runner_up_is_fitted_on_top_of_the_winner() {
        let of = |effect: &str, key: &str, value: &str| {
            format!("[[effect]]\neffect = \"{effect}\"\nat = \"q1\"\n{key} = {value}\n")
        };
        let drag = |value: &str| of("quadratic_drag", "quadratic", value);
        let spring = |value: &str| of("parallel_spring", "stiffness", value) + "rest = 0.2\n";
        let Shown { context, problem } = shown(&(drag("0.004") + &spring("0.5")));
        let found = problem.fitted(&drag("{ value = 0.001, min = 0.0, max = 0.1 }"), 12);
        let free = spring("{ value = 0.1, min = 0.0, max = 2.0 }");
        let behind = |gain: f64| problem.trial("parallel_spring", "q1", &free, 12, gain);
        let near = |gain: f64| {
            let winner = problem.added("quadratic_drag", "q1", 1000.0, vec![behind(gain)]);
            runners_up(&found, &winner, &context)
        };
        assert!(near(100.0).is_empty(), "far behind");
        let near = near(900.0);
        assert!(near.iter().all(|start| start.rig.effects.last().is_some_and(|e| e.kind.id() == "parallel_spring")));
        let asked = Asked { library: &[], near: &near };
        let trials = round(&found, (&found, Vec::new()), asked, &context, |_: &str| {});
        let best = trials.first().unwrap();
        assert!(best.gain > detection_threshold(&context, 1), "{}", best.gain);
        let stiffness = best.hypothesis.rig.effects.last().unwrap().values[0].value;
        assert!((stiffness / 0.5 - 1.0).abs() < 0.1, "{stiffness}");
    }
}
