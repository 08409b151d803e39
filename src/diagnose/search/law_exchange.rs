//! One law in the place of those that stand at a joint. What was found follows the machine, so the force that its laws make along
//! its run is nearly the missing one, by whatever names: there starts the law that is nearest to it, which from nothing ended in a
//! false minimum (a spring, for which one ripple was taken, or four).
//!
//! RT: no.

use crate::diagnose::judge::criterion::{Context, compare};
use crate::diagnose::judge::exchange::{Lead, takes_its_place};
use crate::diagnose::judge::numbers::GREATER_PART;
use crate::diagnose::judge::simplicity::stands_for_several;
use crate::diagnose::library::candidate_fit::{CandidateFit, REFIT, SelectedEffect, with_effect};
use crate::diagnose::library::candidates::Candidate;
use crate::diagnose::library::laws::{self, Form, form, nearest};
use crate::diagnose::screen::linearise::ltv_windows;
use crate::diagnose::search::budget::{allowance, is_spent, within};
use crate::diagnose::search::converge_rivals::is_admitted;
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::is_misfit;
use crate::model::effect::EffectKind;
use crate::model::rig::{Effect, Side, Value};

/// Where misfit stays, or several laws stand at the joint of the last one, these are exchanged for one that is better, or for one alone
/// that is as good. `library`: what may stand there.
#[must_use]
pub fn exchange_laws(
    found: FittedModel,
    added: &mut Vec<SelectedEffect>,
    library: &[Candidate],
    context: &Context,
    said: &mut dyn FnMut(&str),
) -> FittedModel {
    let Some(last) = added.last().and_then(|a| place(&a.candidate)) else { return found };
    let stand: Vec<usize> = (0..added.len()).filter(|i| place(&added[*i].candidate) == Some(last)).collect();
    let is_open = stand.len() > 1 || is_misfit(&found.residuals, &context.floors);
    if !is_open || is_spent(&found) {
        return found;
    }
    let Some(best) = nearest_in_their_place(&found, (added, &stand), library, context) else { return found };
    let names: Vec<&str> = stand.iter().map(|i| added[*i].candidate.effect).collect();
    let (effect, at) = (best.candidate.effect, &best.candidate.at);
    said(&format!("   {effect}@{at} in the place of {}", names.join(", ")));
    put_in_their_place(found, added, &stand, best)
}

/// Form and joint of a candidate that is a law of forces over a coordinate or its rate.
fn place(candidate: &Candidate) -> Option<(Form, &str)> {
    let form = EffectKind::from_id(candidate.effect).and_then(form);
    let is_plain = candidate.only.is_none() && candidate.motor_sensor.is_none() && candidate.side == Side::Link;
    form.filter(|f| is_plain && matches!(f, Form::Friction | Form::Force)).map(|f| (f, candidate.at.as_str()))
}

/// The law that is nearest to those of `added` that `stand`, fitted in their place, if it makes the greater part of their force and the
/// judge lets it stand there.
fn nearest_in_their_place(
    found: &FittedModel,
    (added, stand): (&[SelectedEffect], &[usize]),
    library: &[Candidate],
    context: &Context,
) -> Option<CandidateFit> {
    let first = context.given;
    let (form, at) = place(&added[*stand.first()?].candidate)?;
    let laws: Vec<&Effect> = stand.iter().filter_map(|i| found.rig.effects.get(first + i)).collect();
    let points = forces(found, (form, at), &laws)?;
    let is_itself = |c: &Candidate| stand.len() == 1 && c.effect == added[stand[0]].candidate.effect;
    let others = library.iter().filter(|c| place(c) == Some((form, at)) && !is_itself(c));
    let near = others.filter_map(|c| nearest(c, &points).map(|values| (left(c, &values, &points), c, values)));
    let all: f64 = points.iter().map(|(_, f)| f * f).sum();
    let (_, candidate, values) =
        near.filter(|(left, ..)| *left < (1.0 - GREATER_PART) * all).min_by(|a, b| a.0.total_cmp(&b.0))?;
    let mut rig = with_effect(&found.rig, candidate, &values);
    let effect = rig.effects.pop()?;
    stand.iter().rev().for_each(|i| {
        rig.effects.remove(first + i);
    });
    rig.effects.insert(first + stand[0], effect);
    let (problem, start) = found.extended(rig);
    let hypothesis = within(allowance(found), found, problem, start, (&found.noise, REFIT), context)?;
    let gain: f64 = stand.iter().map(|i| added[*i].gain).sum();
    let behind = compare(found, &hypothesis, context).total;
    let trial = CandidateFit { candidate: candidate.clone(), hypothesis, gain: gain - behind };
    let is_better = match stand {
        [one] => takes_its_place(found, &trial, &added[*one], (gain, Lead::Clear), context),
        _ => stands_for_several(found, &trial, gain, context),
    };
    (is_better && is_admitted(found, &trial, first + stand[0], context)).then_some(trial)
}

/// Coordinate or rate, and the force that `laws` make there, row by row of the run.
fn forces(found: &FittedModel, (form, at): (Form, &str), laws: &[&Effect]) -> Option<Vec<(f64, f64)>> {
    let joint = found.rig.mechanism.coordinate_index(at)?;
    let entry = joint + if form == Form::Friction { found.rig.mechanism.coordinates().len() } else { 0 };
    let windows = ltv_windows(found)?;
    let visited = windows.iter().flat_map(|w| w.states.iter().filter_map(|state| state.get(entry).copied()));
    Some(visited.map(|x| (x, laws.iter().map(|law| laws::at(law, x)).sum())).collect())
}

/// Squares of the forces that `candidate` with `values` leaves.
fn left(candidate: &Candidate, values: &[f64], points: &[(f64, f64)]) -> f64 {
    let Some(kind) = EffectKind::from_id(candidate.effect) else { return f64::INFINITY };
    let law = Effect::new(kind, &candidate.at, values.iter().map(|v| Value::known(*v)).collect());
    points.iter().map(|(x, f)| (f - laws::at(&law, *x)).powi(2)).sum()
}

/// `best` in the place of those of `added` that `stand`; what stood is its rival.
fn put_in_their_place(
    found: FittedModel,
    added: &mut Vec<SelectedEffect>,
    stand: &[usize],
    best: CandidateFit,
) -> FittedModel {
    let removed = stand.iter().map(|i| added[*i].removed).sum();
    let mut stood: Vec<SelectedEffect> = stand.iter().rev().map(|i| added.remove(*i)).collect();
    let mut others = stood
        .pop()
        .map(|one| {
            let old = CandidateFit { candidate: one.candidate, hypothesis: found, gain: one.gain };
            [vec![old], one.others].concat()
        })
        .unwrap_or_default();
    others.retain(|t| !t.candidate.is_same_as(&best.candidate));
    added.insert(stand[0], SelectedEffect { candidate: best.candidate, others, gain: best.gain, removed });
    best.hypothesis
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::worked::{Shown, shown};
    use crate::diagnose::library::candidates::Key;

    const SPRING: &str = "[[effect]]\neffect = \"parallel_spring\"\nat = \"q1\"\n";

    fn ripple(order: f64) -> String {
        let free = "{ value = 0.01, min = 0.0, max = 2.0 }\nphase = { value = 0.1, min = -9.0, max = 9.0 }";
        format!("[[effect]]\neffect = \"torque_ripple\"\nat = \"q1\"\norder = {order:.1}\namplitude = {free}\n")
    }

    fn spring(of: &FittedModel, e: usize) -> [f64; 2] {
        let effect = &of.rig.effects[e];
        ["stiffness", "rest"].map(|key| effect.get(key).unwrap().value)
    }

    /// A spring, for which two ripples were taken, drag between them.
    #[test]
    fn a_spring_takes_the_place_of_two_ripples_and_nothing_takes_that_of_a_spring() {
        let Shown { context, problem } = shown(&format!("{SPRING}stiffness = 0.5\nrest = 0.2\n"));
        let drag = "[[effect]]\neffect = \"quadratic_drag\"\nat = \"q1\"\nquadratic = 0.0\n";
        let two = problem.fitted(&format!("{}{drag}{}", ripple(1.0), ripple(2.0)), 15);
        let mut added = vec![
            problem.added("torque_ripple", "q1", 1000.0, Vec::new()),
            problem.added("quadratic_drag", "q1", 500.0, Vec::new()),
            problem.added("torque_ripple", "q1", 100.0, Vec::new()),
        ];
        let key = |name, min, max| Key { name, min, max, log: false };
        let keys = vec![key("stiffness", 0.0, 10.0), key("rest", -2.0, 2.0)];
        let library = [Candidate { keys, ..problem.candidate("parallel_spring", "q1") }];
        let one = exchange_laws(two, &mut added, &library, &context, &mut |_| {});
        assert_eq!(added.iter().map(|a| a.candidate.effect).collect::<Vec<_>>(), ["parallel_spring", "quadratic_drag"]);
        assert_eq!(one.rig.effects.len(), context.given + 2);
        let [stiffness, rest] = spring(&one, context.given);
        assert!((stiffness / 0.5 - 1.0).abs() < 0.05 && (rest - 0.2).abs() < 0.02, "{stiffness} {rest}");
        let text = format!("{drag}{SPRING}stiffness = 0.5\nrest = 0.2\n");
        let (spring, mut added) = (
            problem.fitted(&text, 15),
            vec![
                problem.added("quadratic_drag", "q1", 500.0, Vec::new()),
                problem.added("parallel_spring", "q1", 1000.0, Vec::new()),
            ],
        );
        let same = exchange_laws(spring.clone(), &mut added, &library, &context, &mut |_| {});
        assert_eq!((same.rig, added.len()), (spring.rig, 2));
    }
}
