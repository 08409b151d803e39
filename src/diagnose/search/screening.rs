//! What one Gauss-Newton step promises from each start of each candidate, and from the starts of two together.
//!
//! Base parameters and initial states are followed along the base solution's own tangent: a start then costs one run with its few own
//! directions instead of a full linearisation.
//! RT: no.

use crate::diagnose::library::candidate_fit::with_effect;
use crate::diagnose::library::candidates::{Candidate, look_alike};
use crate::diagnose::screen::score_test::{Column, Own, ScoreTest};
use crate::diagnose::search::budget::allowance_of_a_look;
use crate::identify::fit::{FreeRuns, Point, Series};
use crate::identify::fitted_model::FittedModel;
use crate::identify::noise::Colour;
use crate::identify::problem::Problem;
use crate::model::rig::{Scope, Slot};
use rayon::prelude::*;

/// A candidate, a start and the fall of twice the log-likelihood that it promises.
pub(super) type Ranked<'c> = (&'c Candidate, &'c [f64], f64);

/// The base's misfit, and its runs.
struct Screen {
    score: ScoreTest,
    plain: Vec<Vec<Series>>,
}

impl Screen {
    /// `None` if a run of the base leaves the finite numbers.
    fn of(base: &FittedModel, noise: &[Colour]) -> Option<Self> {
        let score = ScoreTest::new(&base.problem, &base.point, noise)?;
        let run = |w: usize| base.problem.run(w, &base.point.parameters, &base.point.states[w], false);
        let plain = (0..base.problem.windows()).into_par_iter().map(run).collect::<Option<_>>()?;
        Some(Self { score, plain })
    }

    /// How the simulation answers to `candidate` from `start`; `Ok(None)` if its run leaves the finite numbers. The look may cost `most`.
    fn response(
        &self,
        base: &FittedModel,
        (candidate, start): (&Candidate, &[f64]),
        most: u64,
    ) -> Result<Option<Response>, TooCostly> {
        let (problem, point) = base.extended(with_effect(&base.rig, candidate, start));
        let limited = problem.with_allowance(most);
        let response = self.response_within(base, &limited, &point);
        let spent = limited.effort.spent().min(limited.effort.patience());
        base.problem.effort.add(spent);
        if response.is_none() && limited.is_exhausted() { Err(TooCostly) } else { Ok(response) }
    }

    fn response_within(&self, base: &FittedModel, problem: &Problem, point: &Point) -> Option<Response> {
        let e = base.rig.effects.len();
        let own = |slot: Slot| matches!(slot, Slot::Effect(Scope::Rig, i, _) if i == e);
        // Where inner states differ, those of the base are directions once more, which the projection allows for.
        let held = |w: usize| {
            let (new, old) = (point.states[w].len(), base.point.states[w].len());
            if new == old { new } else { 2 * problem.degrees() }
        };
        let runs: Vec<Vec<Series>> =
            (0..problem.windows()).map(|w| problem.run_along(w, point, own, held(w))).collect::<Option<_>>()?;
        let of_problem = problem.bounds();
        let mine = problem.theta.entries.iter().enumerate().filter(|(_, entry)| own(entry.slot));
        let bounds: Vec<(f64, f64)> = mine
            .map(|(i, _)| (of_problem[i].min - point.parameters[i], of_problem[i].max - point.parameters[i]))
            .collect();
        let mut columns: Vec<Column> = vec![moved(&runs, &self.plain)];
        columns.extend((0..bounds.len()).map(|j| slopes(&runs, j)));
        Some(Response { columns, own: inner_states(&runs, bounds.len()), bounds })
    }
}

/// How the simulation answers to a candidate at one of its starts: the move that the start itself makes, one column for each number of it,
/// and the inner states of each window.
struct Response {
    columns: Vec<Column>,
    own: Vec<Own>,
    /// How far each number may go from the start.
    bounds: Vec<(f64, f64)>,
}

/// A start that costs more than a look may.
struct TooCostly;

/// Every start of every candidate.
fn starts(library: &[Candidate]) -> Vec<(&Candidate, &[f64])> {
    library.iter().flat_map(|c| c.starts.iter().map(move |s| (c, s.as_slice()))).collect()
}

/// Every start of every candidate with the gain that one step promises, each candidate's best first: the first of all
/// candidates, then the second of all, best candidates first.
///
/// Given besides: how many starts were too costly to follow and were not tried.
pub(super) fn screened<'c>(base: &FittedModel, library: &'c [Candidate], noise: &[Colour]) -> (Vec<Ranked<'c>>, usize) {
    let Some(screen) = Screen::of(base, noise) else { return (Vec::new(), 0) };
    let most = allowance_of_a_look(base);
    let starts = starts(library);
    let one = |start: &(&Candidate, &[f64])| -> Result<f64, TooCostly> {
        let response = screen.response(base, *start, most)?;
        Ok(response.map_or(f64::NEG_INFINITY, |r| screen.score.promise(&r.columns, &r.own, &r.bounds)))
    };
    let looks: Vec<Result<f64, TooCostly>> = starts.par_iter().map(one).collect();
    let costly = looks.iter().filter(|look| look.is_err()).count();
    let gain = |look: Result<f64, TooCostly>| look.unwrap_or(f64::NEG_INFINITY);
    let mut all: Vec<Ranked<'_>> = starts.into_iter().zip(looks).map(|((c, s), look)| (c, s, gain(look))).collect();
    all.retain(|b| b.2.is_finite());
    all.sort_by(|a, b| b.2.total_cmp(&a.2));
    let place = |(i, (c, ..)): (usize, &Ranked<'c>)| all[..i].iter().filter(|b| std::ptr::eq(b.0, *c)).count();
    let places: Vec<usize> = all.iter().enumerate().map(place).collect();
    let mut order: Vec<usize> = (0..all.len()).collect();
    order.sort_by_key(|i| places[*i]);
    (order.into_iter().map(|i| all[i]).collect(), costly)
}

/// Two starts, and the gain that one step of both together promises.
pub(super) type RankedPair<'c> = ([(&'c Candidate, &'c [f64]); 2], f64);

/// Of two starts of different candidates together what one step promises, best first; of pairs of the same kinds, or of such as look
/// like them, the best. What has inner states is left out: its like without them stands for it.
pub(super) fn screened_pairs<'c>(
    base: &FittedModel,
    library: &'c [Candidate],
    noise: &[Colour],
) -> Vec<RankedPair<'c>> {
    let Some(screen) = Screen::of(base, noise) else { return Vec::new() };
    let most = allowance_of_a_look(base);
    let one = |start: (&'c Candidate, &'c [f64])| {
        let response = screen.response(base, start, most).ok().flatten()?;
        response.own.is_empty().then_some((start, response))
    };
    let all: Vec<_> = starts(library).into_par_iter().filter_map(one).collect();
    let mut columns: Vec<Column> = Vec::new();
    let mut looks = Vec::new();
    for (start, Response { columns: own, bounds, .. }) in all {
        let first = columns.len();
        columns.extend(own);
        looks.push((start, first, bounds));
    }
    let joint = screen.score.joint(&columns);
    let pairs: Vec<(usize, usize)> = (1..looks.len()).flat_map(|b| (0..b).map(move |a| (a, b))).collect();
    let promise = |(a, b): (usize, usize)| {
        let [(one, i, of_one), (other, j, of_other)] = [&looks[a], &looks[b]];
        if one.0.is_same_as(other.0) {
            return None;
        }
        let free: Vec<usize> = (i + 1..=i + of_one.len()).chain(j + 1..=j + of_other.len()).collect();
        let bounds = [&of_one[..], &of_other[..]].concat();
        Some(([*one, *other], joint.promise(&[*i, *j], &free, &bounds)))
    };
    let mut ranked: Vec<RankedPair<'c>> = pairs.into_par_iter().filter_map(promise).collect();
    ranked.retain(|pair| pair.1.is_finite());
    ranked.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut out: Vec<RankedPair<'c>> = Vec::new();
    for pair in ranked {
        if !out.iter().any(|other| is_like(&other.0, &pair.0)) {
            out.push(pair);
        }
    }
    out
}

/// True if two pairs are of the same kinds, or of such as look like them.
fn is_like(one: &[(&Candidate, &[f64]); 2], other: &[(&Candidate, &[f64]); 2]) -> bool {
    let same = |a: &Candidate, b: &Candidate| {
        (a.effect == b.effect && a.at == b.at) || a.effect != b.effect && look_alike(a.effect, b.effect)
    };
    let [[a, b], [c, d]] = [one, other].map(|pair| pair.map(|(candidate, _)| candidate));
    same(a, c) && same(b, d) || same(a, d) && same(b, c)
}

/// The inner states of each window, if there are any: every window has its own.
fn inner_states(runs: &[Vec<Series>], shared: usize) -> Vec<Own> {
    let count = |run: &Vec<Series>| run.first().map_or(0, |s| s.slopes.len());
    if runs.iter().all(|run| count(run) <= shared) {
        return Vec::new();
    }
    let own = |run: &Vec<Series>, j: usize| run.iter().map(|s| s.slopes[j].clone()).collect();
    runs.iter().map(|run| (shared..count(run)).map(|j| own(run, j)).collect()).collect()
}

/// By how much the start moves the simulation.
fn moved(runs: &[Vec<Series>], plain: &[Vec<Series>]) -> Column {
    let one = |(a, b): (&Series, &Series)| a.residual.iter().zip(&b.residual).map(|(x, y)| x - y).collect();
    runs.iter().zip(plain).map(|(a, b)| a.iter().zip(b).map(one).collect()).collect()
}

fn slopes(runs: &[Vec<Series>], j: usize) -> Column {
    runs.iter().map(|window| window.iter().map(|s| s.slopes[j].clone()).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::library::candidates::Key;
    use crate::diagnose::library::worked::hiding;
    use crate::model::rig::Side;

    const LAG: &str = "[[effect]]\neffect = \"actuator_lag\"\nat = \"u\"\ntime_constant = 0.02\n";

    fn candidate(effect: &'static str, at: &str, key: (&'static str, f64, f64), starts: &[f64]) -> Candidate {
        let key = Key { name: key.0, min: key.1, max: key.2, log: false };
        let starts = starts.iter().map(|s| vec![*s]).collect();
        Candidate { effect, at: at.into(), keys: vec![key], starts, only: None, motor_sensor: None, side: Side::Link }
    }

    #[test]
    fn a_start_is_looked_at_within_its_allowance_and_its_cost_is_counted() {
        let problem = hiding(LAG);
        let base = problem.fitted("", 20);
        let library = [candidate("actuator_lag", "u", ("time_constant", 0.0, 0.2), &[0.01, 0.03])];
        let before = base.problem.effort.spent();
        let (ranked, costly) = screened(&base, &library, &base.noise);
        assert_eq!((ranked.len(), costly), (2, 0));
        assert!(ranked[0].2 > 100.0 && base.problem.effort.spent() > before);
        let screen = Screen::of(&base, &base.noise).unwrap();
        let look = |most: u64| screen.response(&base, (&library[0], &library[0].starts[0]), most);
        assert!(look(1).is_err() && look(u64::MAX / 4).is_ok_and(|response| response.is_some()));
    }

    /// Drag and an offset: no one alone promises what both do together, and the pair comes first.
    #[test]
    fn two_that_are_missing_promise_most_together() {
        let problem = hiding(
            "[[effect]]\neffect = \"quadratic_drag\"\nat = \"q1\"\nquadratic = 0.0004\n\
             [[effect]]\neffect = \"torque_offset\"\nat = \"q1\"\ntorque = 0.01\n",
        );
        let base = problem.fitted("", 20);
        let library = [
            candidate("actuator_lag", "u", ("time_constant", 0.0, 0.2), &[0.001, 0.005]),
            candidate("torque_offset", "q1", ("torque", -1.0, 1.0), &[0.0]),
            candidate("coulomb_friction", "q1", ("coulomb", 0.0, 0.2), &[0.001]),
            candidate("quadratic_drag", "q1", ("quadratic", 0.0, 0.1), &[0.0001, 0.001]),
        ];
        let pairs = screened_pairs(&base, &library, &base.noise);
        assert_eq!(pairs.len(), 4, "one of each two kinds, and dry friction looks like drag");
        assert!(pairs.windows(2).all(|two| two[0].1 >= two[1].1));
        assert_eq!(pairs[0].0.map(|(c, _)| c.effect), ["torque_offset", "quadratic_drag"]);
        let (alone, _) = screened(&base, &library, &base.noise);
        assert!(pairs[0].1 > alone[0].2);
        // Together they promise what both of their starts and numbers do: the screen of one pair by itself.
        let screen = Screen::of(&base, &base.noise).unwrap();
        let [a, b] = pairs[0].0.map(|start| screen.response(&base, start, u64::MAX / 4).ok().flatten().unwrap());
        let both = (0..base.problem.windows()).map(|w| {
            let sum = |(x, y): (&Vec<f64>, &Vec<f64>)| x.iter().zip(y).map(|(x, y)| x + y).collect();
            a.columns[0][w].iter().zip(&b.columns[0][w]).map(sum).collect()
        });
        let columns = [vec![both.collect()], a.columns[1..].to_vec(), b.columns[1..].to_vec()].concat();
        let expected = screen.score.promise(&columns, &[], &[a.bounds, b.bounds].concat());
        assert!((pairs[0].1 / expected - 1.0).abs() < 1e-6, "{} {expected}", pairs[0].1);
    }
}
