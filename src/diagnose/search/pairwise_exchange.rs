//! Two effects exchanged at once.
//!
//! RT: no.

use crate::diagnose::judge::accept::is_at_bound;
use crate::diagnose::judge::criterion::{Context, compare, detection_threshold};
use crate::diagnose::judge::exchange::is_clear;
use crate::diagnose::judge::simplicity::LIMITS_OF;
use crate::diagnose::library::candidate_fit::{CandidateFit, REFIT, SelectedEffect};
use crate::diagnose::search::budget::{MOST_EFFORT, allowance, within};
use crate::diagnose::search::exchange::{NEAR, in_its_place};
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::is_misfit;
use rayon::prelude::*;

/// Two effects exchanged at once where the last round left more than chance: of two wrong effects that make up for each other,
/// neither can be exchanged alone (two ripples for a spring and a ripple of order 12), and what is then found too late (a
/// push, after two that stand for a limit of the torque) has no place.
#[must_use]
pub fn exchange_pairs(
    mut found: FittedModel,
    added: &mut [SelectedEffect],
    last: &[CandidateFit],
    context: &Context,
    said: &mut dyn FnMut(&str),
) -> FittedModel {
    let counts = |t: &&CandidateFit| t.gain > detection_threshold(context, t.candidate.keys.len());
    let late: Vec<&CandidateFit> = last.iter().filter(counts).take(OF_LAST_ROUND).collect();
    if late.is_empty() || found.problem.effort.spent() > MOST_EFFORT / 5 * 4 {
        return found;
    }
    let most = allowance(&found);
    for j in 1..added.len() {
        for i in 0..j {
            let stays =
                |k: usize| CandidateFit { candidate: added[k].candidate.clone(), hypothesis: found.clone(), gain: 0.0 };
            let (first, second) = (rivals(&added[i]), rivals(&added[j]));
            let firsts: Vec<CandidateFit> = [vec![stays(i)], first].concat();
            let seconds: Vec<CandidateFit> = [vec![stays(j)], second, late.iter().copied().cloned().collect()].concat();
            let pairs = firsts.iter().flat_map(|a| seconds.iter().map(move |b| [a, b])).skip(1);
            let different = |[a, b]: &[&CandidateFit; 2]| !a.candidate.is_same_as(&b.candidate);
            let pairs: Vec<[&CandidateFit; 2]> = pairs.filter(different).collect();
            let fitted = |[a, b]: [&CandidateFit; 2]| {
                let rig = in_its_place(&found.rig, a, context.given + i)?;
                let (problem, start) = found.extended(in_its_place(&rig, b, context.given + j)?);
                let fit = within(most, &found, problem, start, (&found.noise, REFIT), context)?;
                let cut_off = [i, j].map(|k| fit.rig.effects.get(context.given + k).is_some_and(is_at_bound));
                let ahead = compare(&fit, &found, context).total;
                // Where misfit stays no form is the true one, and a swap tells nothing.
                let exact = !is_misfit(&fit.residuals, &context.floors);
                (exact && cut_off == [false; 2]).then(|| (ahead, fit, [a.candidate.clone(), b.candidate.clone()]))
            };
            let fits: Vec<_> = pairs.into_par_iter().filter_map(fitted).collect();
            let best = fits.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(ahead, ..)| is_clear(*ahead));
            let Some((ahead, better, candidates)) = best else { continue };
            let names = candidates.each_ref().map(|c| c.effect);
            said(&format!("   {} and {} instead of two: {ahead:.0} better", names[0], names[1]));
            let old = std::mem::replace(&mut found, better);
            for (k, candidate) in [i, j].into_iter().zip(candidates) {
                if candidate.is_same_as(&added[k].candidate) {
                    continue;
                }
                let before = std::mem::replace(&mut added[k].candidate, candidate);
                added[k].others.insert(
                    0,
                    CandidateFit { candidate: before, hypothesis: old.clone(), gain: added[k].gain - ahead },
                );
            }
        }
    }
    found
}

/// The rivals of `added` that are tried in pairs, one for each effect and place.
fn rivals(added: &SelectedEffect) -> Vec<CandidateFit> {
    let richer = |t: &CandidateFit| LIMITS_OF.contains(&(added.candidate.effect, t.candidate.effect));
    let close =
        |t: &&CandidateFit| t.gain > HALF * added.gain && !t.candidate.is_same_as(&added.candidate) && !richer(t);
    let mut out: Vec<CandidateFit> = Vec::new();
    for trial in added.others.iter().filter(close) {
        let alike =
            |t: &CandidateFit| t.candidate.effect == trial.candidate.effect && t.candidate.at == trial.candidate.at;
        if out.len() < IN_PAIRS && (trial.gain > NEAR * added.gain || !out.iter().any(alike)) {
            out.push(trial.clone());
        }
    }
    out
}

/// Part of an effect's gain from which a rival is tried in a pair.
const HALF: f64 = 0.5;

/// Rivals of each of two effects that are tried together, and what the last round adds to those of the second.
const IN_PAIRS: usize = 4;
const OF_LAST_ROUND: usize = 3;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::worked::{Shown, shown};

    const DRAG: &str = "[[effect]]\neffect = \"quadratic_drag\"\nat = \"q1\"\nquadratic = ";
    const SPRING: &str = "[[effect]]\neffect = \"parallel_spring\"\nat = \"q1\"\n";
    const COULOMB: &str =
        "[[effect]]\neffect = \"coulomb_friction\"\nat = \"q1\"\ncoulomb = { value = 0.01, min = 0.0, max = 0.2 }\n";
    const RIPPLE: &str = "[[effect]]\neffect = \"torque_ripple\"\nat = \"q1\"\namplitude = { value = 0.01, min = 0.0, max = \
                          0.3 }\norder = 2\nphase = { value = 0.1, min = -4.0, max = 4.0 }\n";

    /// Drag and a spring, for which dry friction and a ripple were taken.
    #[test]
    fn two_wrong_effects_go_together_and_one_found_late_comes_in() {
        let spring =
            "stiffness = { value = 0.3, min = 0.0, max = 2.0 }\nrest = { value = 0.1, min = -1.0, max = 1.0 }\n";
        let truth = format!("{DRAG}0.004\n{SPRING}stiffness = 0.5\nrest = 0.2\n");
        let drag = format!("{DRAG}{{ value = 0.001, min = 0.0, max = 0.1 }}\n");
        let spring = format!("{SPRING}{spring}");
        let Shown { context, problem } = shown(&truth);
        let found = problem.fitted(&format!("{COULOMB}{RIPPLE}"), 12);
        let rival = |effect, text: &str, gain| problem.trial(effect, "q1", text, 1, gain);
        let first = problem.added("coulomb_friction", "q1", 1000.0, vec![rival("quadratic_drag", &drag, 900.0)]);
        let second = problem.added("torque_ripple", "q1", 800.0, Vec::new());
        // The spring shows only once both stand.
        let late = [rival("parallel_spring", &spring, 500.0)];
        let mut added = [first, second];
        let silent = |_: &str| {};
        let same = exchange_pairs(found.clone(), &mut added, &[], &context, &mut silent.clone());
        assert_eq!(same.rig, found.rig, "nothing is left over: nothing is tried");
        let better = exchange_pairs(found, &mut added, &late, &context, &mut silent.clone());
        assert_eq!(added.map(|a| a.candidate.effect), ["quadratic_drag", "parallel_spring"]);
        let value = |e: usize, k: usize| better.rig.effects[context.given + e].values[k].value;
        assert!(
            (value(0, 0) / 0.004 - 1.0).abs() < 0.05 && (value(1, 0) / 0.5 - 1.0).abs() < 0.05,
            "{:?}",
            better.rig.effects
        );
    }
}
