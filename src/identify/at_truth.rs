//! What is left where a case of another simulator is run with its own truth: our model's own error.
//!
//! Three fits from the truth: initial states only; base parameters too; the hidden effect's numbers too. Where the first
//! leaves much more than noise, or the others gain much and move far, our effect is not the one that was hidden.
//! Tests only. `COMPASS_CASE=dev-011 cargo test --lib at_truth -- --nocapture` looks at one case.

use crate::identify::fit::{Bound, Fit, Limits, Point, fit};
use crate::identify::noise::Colour;
use crate::identify::problem::Problem;
use crate::identify::rollout::{Fidelity, Rollout};
use crate::identify::true_case::{TrueCase, shared};
use crate::model::effect::EffectKind;
use crate::model::rig::{Rig, Side, Use, Value};
use rayon::prelude::*;

/// What one case leaves.
struct Left {
    family: String,
    /// RMS over noise per channel, initial states fitted only.
    ratios: Vec<f64>,
    /// Sum of losses there; about one per sample if only Gauss noise is left.
    cost: f64,
    samples: f64,
    /// What was hidden is no effect of the library.
    is_unlisted: bool,
    text: String,
}

/// `rig` with every number known.
fn known(rig: &Rig) -> Rig {
    let mut rig = rig.clone();
    for slot in rig.slots() {
        if let Some(value) = rig.value_mut(slot) {
            value.bounds = None;
        }
    }
    rig
}

/// `rig` with the numbers of the hidden effects free as far as the catalogue allows.
fn freed(case: &TrueCase) -> Rig {
    let mut rig = case.rig.clone();
    for effect in &mut rig.effects[case.hidden()] {
        for (value, key) in effect.values.iter_mut().zip(effect.kind.keys()) {
            let wide = 10.0 * value.value.abs() + 1.0;
            // An order is a whole number that nobody fits.
            if key.name != "order" {
                *value = Value::free(value.value, key.min.max(-wide), key.max.min(wide));
            }
        }
    }
    rig
}

fn problem(case: &TrueCase, rig: Rig) -> Problem {
    Problem::new(rig, case.experiment.of_use(Use::Fit).cloned().collect())
}

fn fitted(problem: &Problem, states: Vec<Vec<f64>>, noise: &[Colour]) -> Fit {
    let start = Point { parameters: problem.vector(), states };
    let bounds: Vec<Bound> = problem.bounds();
    fit(problem, start, &bounds, noise, Limits { iterations: 60, tolerance: 1e-7 })
}

/// Initial states of least squares for the rig of `problem`.
fn first_states(problem: &Problem, sigma: &[f64]) -> Vec<Vec<f64>> {
    let one = |&(r, w): &(usize, usize)| {
        let rollout = Rollout::new(&problem.rig, &problem.recordings[r], Fidelity::default()).unwrap();
        let weights: Vec<f64> = sigma.iter().map(|s| 1.0 / s).collect();
        rollout.fit_initial(w, &weights, &rollout.guess(w)).unwrap()
    };
    problem.windows.par_iter().map(one).collect()
}

/// RMS of each channel over its noise.
fn ratios(problem: &Problem, at: &Point, sigma: &[f64]) -> Vec<f64> {
    let residuals = problem.residuals(at).unwrap_or_default();
    let one = |(windows, sigma): (&Vec<Vec<f64>>, &f64)| {
        let all: Vec<f64> = windows.iter().flatten().copied().collect();
        (all.iter().map(|x| x * x).sum::<f64>() / all.len() as f64).sqrt() / sigma
    };
    residuals.iter().zip(sigma).map(one).collect()
}

/// Which numbers moved from the truth, and how far.
fn moved(problem: &Problem, at: &Point) -> String {
    let (from, to) = (problem.values(&problem.vector()), problem.values(&at.parameters));
    let moves = problem.theta.entries.iter().zip(from.iter().zip(&to));
    moves.map(|(entry, (a, b))| format!(" {} {a:.5}->{b:.5}", entry.name)).collect()
}

fn look(case: &TrueCase) -> Left {
    let sigma = case.noise();
    let noise: Vec<Colour> = sigma.iter().map(|s| Colour::white(*s)).collect();
    let bare = problem(case, known(&case.rig));
    let states = first_states(&bare, &sigma);
    let first = fitted(&bare, states, &noise);
    let base = problem(case, case.rig.clone());
    let second = fitted(&base, first.point.states.clone(), &noise);
    let all = problem(case, freed(case));
    let third = fitted(&all, first.point.states.clone(), &noise);
    let ratios = ratios(&bare, &first.point, &sigma);
    let samples = case.truth["samples"].as_f64().unwrap();
    let shown: Vec<String> = ratios.iter().map(|r| format!("{r:.3}")).collect();
    let text = format!(
        "{} {:18} left {} | cost {:.0} base {:.1} all {:.1}\n    base:{}\n    all:{}",
        case.id,
        case.family(),
        shown.join(" "),
        first.cost,
        second.cost - first.cost,
        third.cost - first.cost,
        moved(&base, &second.point),
        moved(&all, &third.point),
    );
    Left { family: case.family().to_owned(), ratios, cost: first.cost, samples, is_unlisted: case.is_unlisted(), text }
}

/// The better of what a load friction leaves on either side of its joint: no truth tells which torque it follows.
fn look_at_both_sides(mut case: TrueCase) -> Left {
    let left = look(&case);
    let hidden = case.hidden();
    let loads = case.rig.effects[hidden].iter_mut().filter(|e| e.kind == EffectKind::LoadFriction);
    if loads.map(|e| e.side = Side::Motor).count() == 0 {
        return left;
    }
    let other = look(&case);
    if other.cost < left.cost { other } else { left }
}

#[test]
fn true_physics_leaves_nothing_but_noise() {
    let Some(shared) = shared() else { return };
    let wanted = std::env::var("COMPASS_CASE").unwrap_or_default();
    let ids: Vec<String> = TrueCase::ids(&shared).into_iter().filter(|id| id.contains(&wanted)).collect();
    let left: Vec<Left> = ids.par_iter().map(|id| look_at_both_sides(TrueCase::load(&shared, id))).collect();
    for case in &left {
        println!("{}", case.text);
    }
    for case in left.iter().filter(|c| c.family.starts_with("null_")) {
        assert!(case.cost < 1.1 * case.samples && case.ratios.iter().all(|r| *r < 2.0), "{}", case.text);
    }
    // The rest has outliers in it, which cost, or a form that the contract leaves open: the shape of a push, how a bristle
    // is damped, the weight of a structure.
    let listed: Vec<&Left> = left.iter().filter(|c| !c.is_unlisted).collect();
    let at_noise = listed.iter().filter(|c| c.cost < 1.2 * c.samples).count();
    assert!(!wanted.is_empty() || at_noise * 10 >= listed.len() * 9, "{at_noise} of {}", listed.len());
}
