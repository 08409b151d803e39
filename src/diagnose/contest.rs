//! The contest after the selection: every effect that was added is exchanged for its close rivals, and left out.
//!
//! RT: no.

use crate::diagnose::belief::{ENOUGH, LIMITS_OF, is_piece};
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::tried::{Added, Context, Trial, compare, left_out, worth};
use crate::identify::fit::Limits;

/// Swap and backward: every effect of `found` is exchanged for its close rivals in the company of the others, and
/// left out; what is better stays. `first` is the index of the first added effect in the rig.
#[must_use]
pub fn contested(
    found: Hypothesis,
    mut added: Vec<Added>,
    first: usize,
    context: &Context,
) -> (Hypothesis, Vec<Added>) {
    let mut found = found;
    if added.len() < 2 {
        return (found, added);
    }
    let mut i = 0;
    while i < added.len() {
        let Some(without) = left_out(&found, first + i, context) else { break };
        let kept = compare(&found, &without, context);
        if kept.total < worth(context, added[i].candidate.keys.len()) || kept.low <= 0.0 {
            found = without;
            added.remove(i);
            continue;
        }
        added[i].gain = kept.total;
        let rivals = exchanged(&found, &added[i], first + i, context);
        if let Some(better) = rivals.first().filter(|r| is_better(&found, r, &added[i], kept.total, context)) {
            let old = Trial { candidate: added[i].candidate.clone(), hypothesis: found, gain: kept.total };
            (found, added[i].candidate) = (better.hypothesis.clone(), better.candidate.clone());
            added[i].others = [vec![old], rivals[1..].to_vec()].concat();
        } else {
            added[i].others = rivals;
        }
        i += 1;
    }
    (found, added)
}

/// True if `rival` should stand in the place of `added`, whose gain is `kept`.
fn is_better(found: &Hypothesis, rival: &Trial, added: &Added, kept: f64, context: &Context) -> bool {
    let richer = LIMITS_OF.contains(&(added.candidate.effect, rival.candidate.effect));
    let least = if richer { (1.0 - ENOUGH) * kept } else { 0.0 };
    compare(found, &rival.hypothesis, context).total < -least.max(10.0)
}

/// The close rivals of effect `e`, fitted in its place; best first, gains relative to leaving it out.
fn exchanged(found: &Hypothesis, added: &Added, e: usize, context: &Context) -> Vec<Trial> {
    let admitted = added.others.iter().filter(|t| !is_piece(found, t, context));
    let close = admitted.filter(|t| t.gain > 0.4 * added.others.first().map_or(0.0, |o| o.gain)).take(4);
    let one = |trial: &Trial| {
        let mut rig = found.rig.clone();
        rig.effects[e] = trial.hypothesis.rig.effects.last()?.clone();
        if trial.candidate.motor_sensor.is_some() {
            rig.sensors.clone_from(&trial.hypothesis.rig.sensors);
        }
        let (problem, point) = found.extended(rig);
        let limits = Limits { iterations: 10, tolerance: 1e-5 };
        let hypothesis = Hypothesis::fitted(problem, point, &found.noise, &context.floors, limits)?;
        let behind = compare(found, &hypothesis, context).total;
        Some(Trial { candidate: trial.candidate.clone(), hypothesis, gain: added.gain - behind })
    };
    let mut out: Vec<Trial> = close.filter_map(one).collect();
    out.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    out
}
