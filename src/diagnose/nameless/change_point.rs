//! A machine that is another one from some instant on: a load picked up or lost, a part that came loose.
//!
//! No effect of the library says it, and whatever the library has mimics it in part: a push at that instant, a limit, friction
//! that drifts. Chow's test (Econometrica 28, 1960) over all instants, linear around the base, proposes the instant; then the
//! base is fitted to what was before and to what is after, each with numbers of its own.
//! RT: no.

use crate::diagnose::judge::criterion::Context;
use crate::diagnose::judge::estimates::estimates;
use crate::diagnose::judge::exchange::is_clear;
use crate::diagnose::judge::nameless::change_is_ahead;
use crate::diagnose::judge::numbers::DEVIATIONS;
use crate::diagnose::judge::verdict::{Estimate, Place};
use crate::diagnose::robustness::held_out::{Confirmation, cut_elsewhere, quiet_noise};
use crate::diagnose::screen::linearise::ltv_windows;
use crate::diagnose::screen::ltv::LtvWindow;
use crate::diagnose::screen::scan::change;
use crate::diagnose::screen::score_test::ScoreTest;
use crate::identify::fit::{FreeRuns, Limits, Point, Series};
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::{Residuals, blocks, colours, is_misfit, white};
use crate::identify::noise::Colour;
use crate::identify::problem::Problem;
use rayon::prelude::*;

/// Most effort of the fits: a base fit that starts near its end takes a tenth of it.
const CHANGE_EFFORT: u64 = 50_000_000;

/// Steps of the search for the instant, in parts of the recording.
const INSTANT_STEPS: [f64; 3] = [0.05, 0.02, 0.01];

/// The base with other numbers before and after an instant of one recording; the other recordings are as before.
pub struct ChangePoint {
    /// Of the problem's recordings.
    pub recording: usize,
    /// From when on the machine is another one, s.
    pub from_s: f64,
    to_s: f64,
    /// Fitted to what was before, other recordings included.
    pub before: FittedModel,
    /// Fitted to what is after.
    pub after: FittedModel,
    noise: Vec<Colour>,
    likelihood: f64,
}

impl ChangePoint {
    /// The two fits at the instant that the linear test prefers. `None` if a run fails.
    #[must_use]
    pub fn fitted(base: &FittedModel, context: &Context) -> Option<Self> {
        let (recording, from_s) = proposed(base, &ltv_windows(base)?)?;
        Self::at(base, (recording, from_s), context)
    }

    /// The same at an instant nearby that is more likely: what changes by a third is not linear.
    #[must_use]
    pub fn nearby(self, base: &FittedModel, context: &Context) -> Self {
        let times = &base.problem.recordings[self.recording].times;
        let length_s = times.last().zip(times.first()).map_or(0.0, |(to, from)| to - from);
        let noise = self.noise.clone();
        // Each judged by the noise that it leaves itself, slow noise would stand for what a wrong instant leaves.
        let total = |one: &Self| -> f64 { blocks(&together(&one.before, &one.after), &noise).iter().sum() };
        let mut best = self;
        for step_s in INSTANT_STEPS.map(|part| part * length_s) {
            for way in [-step_s, step_s] {
                while let Some(other) = Self::at(base, (best.recording, best.from_s + way), context)
                    && is_clear(total(&other) - total(&best))
                {
                    best = other;
                }
            }
        }
        best
    }

    fn at(base: &FittedModel, (recording, from_s): (usize, f64), context: &Context) -> Option<Self> {
        let to_s = base.problem.spans.iter().zip(&base.problem.windows).rfind(|(_, w)| w.0 == recording)?.0.end;
        let to_s = base.problem.recordings[recording].times[to_s - 1];
        let (split, point, row) = split(&base.problem, &base.point, recording, from_s)?;
        let is_after = |w: &usize| split.windows[*w].0 == recording && split.spans[*w].start >= row;
        let (after, before): (Vec<usize>, Vec<usize>) = (0..split.windows.len()).partition(is_after);
        if after.is_empty() || before.is_empty() {
            return None;
        }
        let noise = white(&base.residuals, &context.floors);
        let fit = |kept: &[usize]| {
            let states = kept.iter().map(|w| point.states[*w].clone()).collect();
            let start = Point { parameters: point.parameters.clone(), states };
            let (floors, limits) = (&context.floors, Limits { iterations: 15, tolerance: 1e-5 });
            let problem = split.on_windows(kept).with_allowance(CHANGE_EFFORT);
            let first = FittedModel::fitted(problem, start, &noise, floors, limits)?;
            Some(first.polished(&first.noise, floors, limits).unwrap_or(first))
        };
        let (before, after) = rayon::join(|| fit(&before), || fit(&after));
        let (before, after) = (before?, after?);
        let both = together(&before, &after);
        let noise = colours(&both, &context.floors, &base.rig, base.problem.longest_memory);
        let likelihood = blocks(&both, &noise).iter().sum();
        Some(Self { recording, from_s, to_s, before, after, noise, likelihood })
    }

    /// How far it is ahead of another model, in twice the log-likelihood under the noise that it leaves.
    #[must_use]
    pub fn ahead_of(&self, other: &FittedModel) -> f64 {
        self.likelihood - other.blocks(&self.noise).iter().sum::<f64>()
    }

    /// True if the two machines hold in their recording cut at other instants, and leave but noise there.
    #[must_use]
    pub fn holds(&self, base: &FittedModel, context: &Context) -> bool {
        let name = &self.after.problem.recordings[self.recording].name;
        let own = |of: &FittedModel| cut_elsewhere(of, |r| r.name == *name, None, &context.floors);
        let base_in = |part: &FittedModel| {
            let point = Point { parameters: base.point.parameters.clone(), states: part.point.states.clone() };
            own(&FittedModel { problem: part.problem.clone(), point, ..base.clone() })
        };
        let both = |before: Option<FittedModel>, after: Option<FittedModel>| Some(together(&before?, &after?));
        let Some(with) = both(own(&self.before), own(&self.after)) else { return false };
        let Some(without) = both(base_in(&self.before), base_in(&self.after)) else { return true };
        let noise = quiet_noise(&self.before, |r| r.name == *name, &context.floors);
        Confirmation::of_event(&with, &without, &noise, &context.floors).holds()
    }

    /// True if it leaves but noise and is clearly ahead of `found`, its numbers paid for.
    #[must_use]
    pub fn says_more_than(&self, found: &FittedModel, base: &FittedModel, context: &Context) -> bool {
        if is_misfit(&together(&self.before, &self.after), &context.floors) || self.numbers().is_empty() {
            return false;
        }
        let listed = self.ahead_of(base) - self.ahead_of(found);
        let numbers = self.after.point.parameters.len() + self.after.point.states.first().map_or(0, Vec::len);
        change_is_ahead(self.ahead_of(found), listed, numbers, context)
    }

    /// The numbers that changed, the surest first: name, before, after.
    #[must_use]
    pub fn numbers(&self) -> Vec<(String, f64, f64)> {
        let [before, after] = [&self.before, &self.after].map(|h| estimates(&h.clone().with_intervals()));
        let sure = |(b, a): (&(String, Estimate), &(String, Estimate))| {
            let apart = (a.1.value - b.1.value).abs() / libm::hypot(a.1.std, b.1.std);
            (apart > DEVIATIONS).then(|| (apart, (b.0.clone(), b.1.value, a.1.value)))
        };
        let mut all: Vec<_> = before.iter().zip(&after).filter_map(sure).collect();
        all.sort_by(|a, b| b.0.total_cmp(&a.0));
        all.into_iter().map(|(_, number)| number).collect()
    }

    /// Where the other machine is seen.
    #[must_use]
    pub fn place(&self, channel: &str) -> Place {
        Place {
            recording: self.after.problem.recordings[self.recording].name.clone(),
            channel: channel.to_owned(),
            from_s: self.from_s,
            to_s: self.to_s,
            share: 1.0,
            phase: None,
            region: None,
            band_hz: None,
        }
    }
}

/// Recording and instant that the linear test prefers.
fn proposed(base: &FittedModel, windows: &[LtvWindow]) -> Option<(usize, f64)> {
    let one = |w: usize| base.problem.run(w, &base.point.parameters, &base.point.states[w], true);
    let runs: Vec<Vec<Series>> = (0..windows.len()).into_par_iter().map(one).collect::<Option<_>>()?;
    let screen = ScoreTest::new(&base.problem, &base.point, &base.noise)?;
    Some(change(&screen, windows, &runs, base.point.parameters.len())?.at)
}

/// The problem with a window of `recording` that starts at `from_s`, in the state in which the window before arrives there; and
/// the row at which it starts. A window that starts or ends nearby is not cut.
fn split(problem: &Problem, at: &Point, recording: usize, from_s: f64) -> Option<(Problem, Point, usize)> {
    let (mut problem, mut point) = (problem.clone(), at.clone());
    let row = problem.recordings[recording].times.partition_point(|t| *t < from_s);
    let holds = |w: &usize| problem.windows[*w].0 == recording && problem.spans[*w].contains(&row);
    let w = (0..problem.windows.len()).find(holds)?;
    let span = problem.spans[w].clone();
    if row < span.start + LEAST_ROWS {
        return Some((problem, point, span.start));
    }
    if row + LEAST_ROWS > span.end {
        return Some((problem, point, span.end));
    }
    problem.windows.insert(w + 1, problem.windows[w]);
    problem.spans.insert(w + 1, row..span.end);
    problem.spans[w].end = row;
    let arrived = problem.arrived(w, &point.parameters, &point.states[w])?;
    point.states.insert(w + 1, arrived);
    Some((problem, point, row))
}

/// Fewest rows of a window.
const LEAST_ROWS: usize = 10;

/// The residuals of two parts, one after the other.
fn together(a: &FittedModel, b: &FittedModel) -> Residuals {
    a.residuals.iter().zip(&b.residuals).map(|(a, b)| a.iter().chain(b).cloned().collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::evidence::Ledger;
    use crate::identify::experiment::Recording;
    use crate::identify::synthesis::record;
    use crate::model::rig::Rig;

    const PUSH: &str = "[[effect]]\neffect = \"external_push\"\nat = \"q1\"\nimpulse = ";

    /// A pendulum with `effects`; its weight and inertia, each in a tenth of a unit, are to be fitted.
    fn pendulum(inertia: f64, gravity: f64, effects: &str) -> String {
        format!(
            "schema = 1\nmechanism = \"pendulum\"\n[parameters]\n\
             inertia_kg_m2 = {{ value = {inertia}, min = 0.001, max = 0.02 }}\n\
             gravity_nm = {{ value = {gravity}, min = 0.0, max = 1.0 }}\n\
             [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.3\n\
             [[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\nnoise_std = 0.001\n{effects}"
        )
    }

    const AT_S: f64 = 1.0;

    /// 1 s of a pendulum, then another 1 s, perhaps of a heavier one, perhaps with a push of so much at that instant.
    fn recorded(heavier: f64, push: f64) -> Vec<f64> {
        let text = pendulum(0.01, 0.4, "");
        let whole = Problem::shaken(&text, None, vec![0.0; 200]);
        let recording = whole.recordings[0].clone();
        let first = record(&whole.rig, &recording, &[0.3, 0.0], Some(7)).unwrap().measured.swap_remove(0);
        let (_, at, row) =
            split(&whole, &Point { parameters: whole.vector(), states: vec![vec![0.3, 0.0]] }, 0, AT_S).unwrap();
        let inputs = vec![recording.inputs[0][row..].to_vec()];
        let rest = Recording::new("b.csv", recording.times[row..].to_vec(), inputs, Vec::new());
        let rig = Rig::parse(&pendulum(0.01 * heavier, 0.4 * heavier, ""), "rig.toml").unwrap();
        let mut start = at.states[1].clone();
        start[1] += push / 0.01;
        let second = record(&rig, &rest, &start, Some(8)).unwrap().measured.swap_remove(0);
        [first[..row].to_vec(), second].concat()
    }

    fn fitted(measured: &[f64], effects: &str) -> (FittedModel, Context) {
        let problem = Problem::shaken(&pendulum(0.011, 0.38, effects), None, measured.to_vec());
        let context = Context {
            floors: vec![1e-5],
            samples: 200,
            given: 0,
            is_trapped: false,
            seed: 1,
            ledger: Ledger::default(),
            held_out: None,
        };
        let (start, limits) = (problem.start(), Limits { iterations: 30, tolerance: 1e-8 });
        (FittedModel::fitted(problem, start, &[Colour::white(0.001)], &context.floors, limits).unwrap(), context)
    }

    #[test]
    fn a_load_picked_up_is_found_with_its_instant_and_what_it_changes() {
        let (base, context) = fitted(&recorded(1.3, 0.0), "");
        let changed = ChangePoint::fitted(&base, &context).unwrap().nearby(&base, &context);
        assert!((changed.from_s - AT_S).abs() < 0.05, "{}", changed.from_s);
        assert!(changed.says_more_than(&base, &base, &context));
        for (name, before, after) in changed.numbers() {
            assert!((after / before - 1.3).abs() < 0.03, "{name} {before} {after}");
        }
        assert_eq!(changed.numbers().len(), 2);
    }

    #[test]
    fn a_machine_that_stays_the_same_is_not_another_one() {
        let (base, context) = fitted(&recorded(1.0, 0.0), "");
        assert!(!ChangePoint::fitted(&base, &context).unwrap().says_more_than(&base, &base, &context));
    }

    #[test]
    fn a_push_is_said_better_by_a_push() {
        let measured = recorded(1.0, 0.02);
        let ((base, context), (found, _)) = (
            fitted(&measured, ""),
            fitted(&measured, &format!("{PUSH}{{ value = 0.015, min = -1.0, max = 1.0 }}\ntime = 1.0\n")),
        );
        assert!(found.likelihood - base.likelihood > 100.0);
        assert!(!ChangePoint::fitted(&base, &context).unwrap().says_more_than(&found, &base, &context));
    }
}
