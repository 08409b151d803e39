//! One law in the place of those that stand at a joint. What was found follows the machine, so the force that its laws make along
//! its run is nearly the missing one, by whatever names: there starts the law that is nearest to it, which from nothing ended in a
//! false minimum (a spring, for which one ripple was taken, or four).
//!
//! RT: no.

use crate::diagnose::judge::criterion::{Context, compare};
use crate::diagnose::judge::exchange::{Lead, takes_its_place};
use crate::diagnose::judge::simplicity::stands_for_several;
use crate::diagnose::library::candidate_fit::{CandidateFit, SelectedEffect, with_effect};
use crate::diagnose::library::candidates::Candidate;
use crate::diagnose::library::laws::{self, Form, form, nearest};
use crate::diagnose::screen::linearise::ltv_windows;
use crate::diagnose::search::budget::{allowance, is_spent, within};
use crate::diagnose::search::converge_rivals::is_admitted;
use crate::identify::fit::Limits;
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::is_misfit;
use crate::model::effect::EffectKind;
use crate::model::rig::{Effect, Side, Value};
use rayon::prelude::*;

/// Laws that are fitted in the place of those that stand, the nearest first.
const ASKED: usize = 2;

const FIT: Limits = Limits { iterations: 10, tolerance: 1e-5 };

/// Where misfit stays, or several laws stand at one joint, each joint's are exchanged for one that is better, or for one alone that is as
/// good. `library`: what may stand there.
#[must_use]
pub fn exchange_laws(
    mut found: FittedModel,
    added: &mut Vec<SelectedEffect>,
    library: &dyn Fn(&FittedModel) -> Vec<Candidate>,
    context: &Context,
    said: &mut dyn FnMut(&str),
) -> FittedModel {
    let places: Vec<(Form, String)> = places(added);
    for (form, at) in places {
        let stand: Vec<usize> = (0..added.len()).filter(|i| place(&added[*i].candidate) == Some((form, &at))).collect();
        let is_open = stand.len() > 1 || is_misfit(&found.residuals, &context.floors);
        if !is_open || is_spent(&found) {
            continue;
        }
        let Some(best) = best_in_their_place(&found, (added, &stand), &library(&found), context) else { continue };
        let names: Vec<&str> = stand.iter().map(|i| added[*i].candidate.effect).collect();
        said(&format!("   {}@{at} in the place of {}", best.candidate.effect, names.join(", ")));
        found = put_in_their_place(found, added, &stand, best);
    }
    found
}

/// Forms and joints of the laws that were added.
fn places(added: &[SelectedEffect]) -> Vec<(Form, String)> {
    let mut out: Vec<(Form, String)> = Vec::new();
    for (form, at) in added.iter().filter_map(|a| place(&a.candidate)) {
        if !out.iter().any(|(f, a)| (*f, a.as_str()) == (form, at)) {
            out.push((form, at.to_owned()));
        }
    }
    out
}

/// Form and joint of a candidate that is a law of forces over a coordinate or its rate.
fn place(candidate: &Candidate) -> Option<(Form, &str)> {
    let form = EffectKind::from_id(candidate.effect).and_then(form);
    let is_plain = candidate.only.is_none() && candidate.motor_sensor.is_none() && candidate.side == Side::Link;
    form.filter(|f| is_plain && matches!(f, Form::Friction | Form::Force)).map(|f| (f, candidate.at.as_str()))
}

/// The best law in the place of those of `added` that `stand`, if the judge lets it stand there.
fn best_in_their_place(
    found: &FittedModel,
    (added, stand): (&[SelectedEffect], &[usize]),
    library: &[Candidate],
    context: &Context,
) -> Option<CandidateFit> {
    let first = context.given;
    let (form, at) = place(&added[*stand.first()?].candidate)?;
    let laws: Vec<&Effect> = stand.iter().filter_map(|i| found.rig.effects.get(first + i)).collect();
    let points = forces(found, (form, at), &laws)?;
    let gain: f64 = stand.iter().map(|i| added[*i].gain).sum();
    let stands = |c: &Candidate| stand.len() == 1 && c.effect == added[stand[0]].candidate.effect;
    let others = library.iter().filter(|c| place(c) == Some((form, at)) && !stands(c));
    let mut starts: Vec<(f64, &Candidate, Vec<f64>)> =
        others.filter_map(|c| nearest(c, &points).map(|values| (left(c, &values, &points), c, values))).collect();
    starts.sort_by(|a, b| a.0.total_cmp(&b.0));
    let fitted = |(_, candidate, values): &(f64, &Candidate, Vec<f64>)| {
        let mut rig = with_effect(&found.rig, candidate, values);
        let effect = rig.effects.pop()?;
        stand.iter().rev().for_each(|i| {
            rig.effects.remove(first + i);
        });
        rig.effects.insert(first + stand[0], effect);
        let (problem, start) = found.extended(rig);
        let hypothesis = within(allowance(found), found, problem, start, (&found.noise, FIT), context)?;
        let gain = gain - compare(found, &hypothesis, context).total;
        Some(CandidateFit { candidate: (*candidate).clone(), hypothesis, gain })
    };
    let stands = |trial: &CandidateFit| {
        let better = match stand {
            [one] => takes_its_place(found, trial, &added[*one], (gain, Lead::Clear), context),
            _ => stands_for_several(found, trial, gain, context),
        };
        better && is_admitted(found, trial, first + stand[0], context)
    };
    let fits: Vec<CandidateFit> = starts.par_iter().take(ASKED).filter_map(fitted).collect();
    fits.into_iter().filter(stands).max_by(|a, b| a.gain.total_cmp(&b.gain))
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
        let library =
            |_: &FittedModel| vec![Candidate { keys: keys.clone(), ..problem.candidate("parallel_spring", "q1") }];
        let one = exchange_laws(two, &mut added, &library, &context, &mut |_| {});
        assert_eq!(added.iter().map(|a| a.candidate.effect).collect::<Vec<_>>(), ["parallel_spring", "quadratic_drag"]);
        assert_eq!(one.rig.effects.len(), context.given + 2);
        let [stiffness, rest] = spring(&one, context.given);
        assert!((stiffness / 0.5 - 1.0).abs() < 0.05 && (rest - 0.2).abs() < 0.02, "{stiffness} {rest}");
        let same = exchange_laws(one.clone(), &mut added, &library, &context, &mut |_| {});
        assert_eq!((same.rig, added.len()), (one.rig, 2));
    }
}
