//! Recordings that no fit of the answer saw, asked whether what was found holds there.
//!
//! An effect that only bends to the recordings it was fitted to costs elsewhere: a limit of a drive on top of the friction that
//! is the truth, a bristle on top of a leg's Coulomb friction. For a prediction nothing is fitted here but how each window begins.
//!
//! A prediction judges a whole model: friction that came out better beside a ripple pays for the ripple, and where motion is sensitive
//! small errors of other numbers speak against a true effect. An effect by itself is asked whether it replicates: all other numbers
//! are fitted here too, with it as it was found and without it (a score test with nuisance parameters).
//!
//! What happens at one instant of one recording is in no other. It is asked in its own, cut at other instants, so that what the state at
//! a window's start had taken over is no longer where it was.
//! RT: no.

use crate::diagnose::library::candidates::Candidate;
use crate::diagnose::library::limited_fit::refitted;
use crate::diagnose::screen::score_test::{Column, ScoreTest};
use crate::identify::base_fit::known;
use crate::identify::experiment::{Experiment, Recording};
use crate::identify::fit::Point;
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::{Residuals, white};
use crate::identify::noise::Colour;
use crate::identify::outliers::clean;
use crate::identify::problem::Problem;
use crate::identify::rollout::{FreeRun, Pooled, free_run};
use crate::model::rig::{Effect, Rig, Use};
use nalgebra::DMatrix;
use rayon::prelude::*;
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::{Arc, Mutex};

/// The recordings that were kept back.
#[derive(Debug)]
pub struct HeldOut {
    recordings: Vec<Recording>,
    pooled: Pooled,
    /// What the last models left: one is compared with several others in turn.
    known: Mutex<VecDeque<(Rig, Option<Residuals>)>>,
}

/// Models whose predictions are remembered: those with and without each effect of an answer.
const REMEMBERED: usize = 8;

impl HeldOut {
    /// Those of `experiment`, without the samples that `rig` shows to be transmission errors. `None` if none was kept back.
    #[must_use]
    pub fn of(experiment: &Experiment, rig: &Rig) -> Option<Self> {
        let recordings: Vec<Recording> = experiment.of_use(Use::Heldout).cloned().collect();
        if recordings.is_empty() {
            return None;
        }
        let pooled = Pooled::of(rig, recordings.iter());
        Some(Self { recordings: clean(rig, recordings).0, pooled, known: Mutex::default() })
    }

    /// What the free runs of `rig` leave, window by window. `None` if it runs away on one of the recordings.
    #[must_use]
    pub fn residuals(&self, rig: &Rig) -> Option<Residuals> {
        let known = |known: &VecDeque<(Rig, Option<Residuals>)>| {
            known.iter().find(|(of, _)| of == rig).map(|(_, residuals)| residuals.clone())
        };
        if let Some(residuals) = self.known.lock().ok().and_then(|all| known(&all)) {
            return residuals;
        }
        let residuals = self.predicted(rig);
        if let Ok(mut all) = self.known.lock() {
            all.truncate(REMEMBERED - 1);
            all.push_front((rig.clone(), residuals.clone()));
        }
        residuals
    }

    fn predicted(&self, rig: &Rig) -> Option<Residuals> {
        let run = |recording: &Recording| free_run(rig, recording, &self.pooled).ok();
        let runs: Vec<FreeRun> = self.recordings.par_iter().map(run).collect::<Option<_>>()?;
        let channel = |c: usize| -> Vec<Vec<f64>> {
            let of = |(recording, run): (&Recording, &FreeRun)| {
                let error = |k: usize| run.predicted[c][k] - recording.measured[c][k];
                let window = |rows: std::ops::Range<usize>| rows.map(error).filter(|x| x.is_finite()).collect();
                recording.windows().into_iter().map(window).collect::<Vec<Vec<f64>>>()
            };
            self.recordings.iter().zip(&runs).flat_map(of).collect()
        };
        Some((0..rig.sensors.len()).map(channel).collect())
    }

    /// `of` on these recordings, its numbers as they are. `None` if it runs away on one of them.
    #[must_use]
    pub fn predicted_by(&self, of: &FittedModel, floors: &[f64]) -> Option<FittedModel> {
        let problem = Problem::new(of.rig.clone(), self.recordings.clone());
        started(problem, of, floors)
    }

    /// `rig` fitted to these recordings from the numbers that it has. `of`: the model that it comes from, with which what it costs is
    /// counted. `None` if it runs away on one of them.
    fn refitted(&self, rig: Rig, of: &FittedModel, floors: &[f64]) -> Option<FittedModel> {
        let effort = Arc::clone(&of.problem.effort);
        let problem = Problem { effort, ..Problem::new(rig, self.recordings.clone()) };
        let point = Point { parameters: problem.vector(), states: Vec::new() };
        let start = started(problem, &FittedModel { point, ..of.clone() }, floors)?;
        let noise = white(&start.residuals, floors);
        refitted(of, (start.problem, start.point), &noise, floors)
    }
}

/// `of` on the recordings that `wanted` keeps, its numbers as they are, its windows cut elsewhere ([`cuts`]) and where the machine
/// was set anew. `None` if a run leaves the finite numbers.
#[must_use]
pub fn cut_elsewhere(
    of: &FittedModel,
    wanted: impl Fn(&Recording) -> bool,
    instant_s: Option<f64>,
    floors: &[f64],
) -> Option<FittedModel> {
    let mut problem = of.problem.clone();
    (problem.windows, problem.spans) = (Vec::new(), Vec::new());
    for (r, recording) in of.problem.recordings.iter().enumerate().filter(|(_, recording)| wanted(recording)) {
        let mine = of.problem.windows.iter().zip(&of.problem.spans).filter(|((own, _), _)| *own == r);
        let rows: Vec<&Range<usize>> = mine.map(|(_, rows)| rows).collect();
        let (Some(first), Some(last)) = (rows.first(), rows.last()) else { continue };
        let breaks = (first.start + 1..last.end).filter(|row| recording.is_fresh(*row));
        let instant = instant_s.map(|at_s| recording.times.partition_point(|t| *t < at_s));
        let mut cuts: Vec<usize> =
            [first.start, last.end].into_iter().chain(cuts(&rows, instant)).chain(breaks).collect();
        cuts.sort_unstable();
        for (w, cut) in cuts.windows(2).enumerate().filter(|(_, cut)| cut[0] < cut[1]) {
            problem.windows.push((r, w));
            problem.spans.push(cut[0]..cut[1]);
        }
    }
    started(problem, of, floors)
}

/// Where in its window an event stands when windows are cut for it: so that the window shows it and what came before it.
const STANDS: [f64; 2] = [0.25, 0.5];

/// Rows at which windows begin that were fitted as `rows`: in the middles of those. Where something happened at row `instant`, windows as
/// long as the one in which it happened, such that it stands elsewhere in its own.
fn cuts(rows: &[&Range<usize>], instant: Option<usize>) -> Vec<usize> {
    let own = instant.and_then(|k| rows.iter().find(|window| window.contains(&k)).map(|window| (k, *window)));
    let (Some((k, own)), Some(first), Some(last)) = (own, rows.first(), rows.last()) else {
        return rows.iter().map(|rows| usize::midpoint(rows.start, rows.end)).collect();
    };
    let (rows_of, stood) = (own.len(), (k - own.start) as f64 / own.len() as f64);
    let far = |stands: &&f64| (**stands - stood).abs();
    let stands = STANDS.iter().max_by(|a, b| far(a).total_cmp(&far(b))).copied().unwrap_or(0.5);
    let begins = k + rows_of - (stands * rows_of as f64) as usize;
    (begins % rows_of..last.end).step_by(rows_of).filter(|row| *row > first.start).collect()
}

/// When the event `candidate` happened that `with` has and `without` has not, s. Of several of its kind in one recording it is the one
/// that is farthest from those of `without`.
fn instant_s(candidate: &Candidate, with: &FittedModel, without: &FittedModel) -> Option<f64> {
    let is_it = |effect: &&Effect| {
        let is_there = candidate.only.as_ref().is_some_and(|only| effect.recordings.contains(only));
        effect.kind.id() == candidate.effect && effect.at == candidate.at && is_there
    };
    let instants = |of: &FittedModel| -> Vec<f64> {
        of.rig.effects.iter().filter(is_it).filter_map(|effect| effect.get("time")).map(|time| time.value).collect()
    };
    let others = instants(without);
    let apart = |at_s: f64| others.iter().map(|other| (at_s - other).abs()).fold(f64::INFINITY, f64::min);
    instants(with).into_iter().max_by(|a, b| apart(*a).total_cmp(&apart(*b)))
}

/// `of` in the windows of `problem`, each from the state that suits it best.
fn started(problem: Problem, of: &FittedModel, floors: &[f64]) -> Option<FittedModel> {
    let noise = white(&of.residuals, floors);
    let at = Point { parameters: of.point.parameters.clone(), states: Vec::new() };
    let sought = |w: usize| problem.sought(w, &at, &noise);
    let states = (0..problem.windows.len()).into_par_iter().map(sought).collect::<Option<_>>()?;
    FittedModel::at(problem, Point { states, ..at }, DMatrix::zeros(0, 0), floors)
}

/// What an effect does to predictions, in squares of the noise that the better of two models leaves. What follows from it the judge
/// says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Confirmation {
    /// Squares of the change that it makes: by so much the error falls where the change is the truth, and rises where there is
    /// nothing of the kind.
    pub promised: f64,
    /// By how much the error falls.
    pub gained: f64,
    /// Of an event: what it leaves of the squares above noise where it acts, as a part of what is there without it. Nothing
    /// for what lasts.
    pub left: f64,
}

impl std::fmt::Display for Confirmation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "promises {:.0}, gains {:.0}, leaves {:.2}", self.promised, self.gained, self.left)
    }
}

impl Confirmation {
    /// Of `candidate`, which `with` has and `without` has not: by the recordings that were kept back, or, if it is an event, by
    /// its own, cut at other instants. `None` if there are none, or one of the two runs away there.
    #[must_use]
    pub fn of_candidate(
        candidate: &Candidate,
        with: &FittedModel,
        without: &FittedModel,
        held_out: Option<&HeldOut>,
        floors: &[f64],
    ) -> Option<Self> {
        let Some(only) = &candidate.only else { return Self::on_kept_back(with, without, held_out, floors) };
        let instant_s = instant_s(candidate, with, without);
        let own = |of: &FittedModel| Some(cut_elsewhere(of, |r| r.name == *only, instant_s, floors)?.residuals);
        let (happened, not) = (own(with)?, own(without)?);
        let noise = quiet_noise(with, |r| r.name == *only, floors);
        Some(Self::of_event(&happened, &not, &noise, floors))
    }

    /// Of what `with` has and `without` has not, by the recordings that were kept back. `None` if there are none, or one of the two
    /// runs away there.
    #[must_use]
    pub fn on_kept_back(
        with: &FittedModel,
        without: &FittedModel,
        held_out: Option<&HeldOut>,
        floors: &[f64],
    ) -> Option<Self> {
        let residuals = |of: &FittedModel| held_out?.residuals(&of.rig);
        Some(Self::of(&residuals(with)?, &residuals(without)?, floors))
    }

    /// Of effect `e` of `with`, which `without` lacks and which is `candidate`: whether it replicates in the recordings that were kept back, or,
    /// if it is an event, by its own, cut at other instants. `None` if there are none, or one of the two runs away there.
    #[must_use]
    pub fn of_effect(
        candidate: &Candidate,
        (with, e): (&FittedModel, usize),
        without: &FittedModel,
        held_out: Option<&HeldOut>,
        floors: &[f64],
    ) -> Option<Self> {
        match candidate.only {
            Some(_) => Self::of_candidate(candidate, with, without, held_out, floors),
            // Where a fit runs away the predictions tell.
            None => Self::replicated(known(&with.rig).effects.get(e)?.clone(), (with, e), without, held_out, floors)
                .or_else(|| Self::on_kept_back(with, without, held_out, floors)),
        }
    }

    /// Of effect `e` of `with`, which `without` lacks, its numbers as `effect` has them: held, or within bounds; all other numbers suit the
    /// recordings that were kept back. `None` if there are none, or a fit runs away there.
    #[must_use]
    pub fn replicated(
        effect: Effect,
        (with, e): (&FittedModel, usize),
        without: &FittedModel,
        held_out: Option<&HeldOut>,
        floors: &[f64],
    ) -> Option<Self> {
        let held_out = held_out?;
        let mut rig = with.rig.clone();
        *rig.effects.get_mut(e)? = effect;
        let with = held_out.refitted(rig, with, floors)?;
        let without = held_out.refitted(without.rig.clone(), without, floors)?;
        Some(Self::of(&with.residuals, &without.residuals, floors))
    }

    /// Of an event, in the recording in which it happened. `noise`: where nothing happens.
    #[must_use]
    pub fn of_event(with: &Residuals, without: &Residuals, noise: &[Colour], floors: &[f64]) -> Self {
        // A window counts by what changes in it: what misfit one before the event has says nothing of the event.
        let windows = with.iter().map(Vec::len).max().unwrap_or(0);
        let (mut stays, mut was) = (0.0, 0.0);
        for w in 0..windows {
            let own = |all: &Residuals| -> Residuals {
                all.iter().map(|channel| channel.get(w).cloned().into_iter().collect()).collect()
            };
            let (with, without) = (own(with), own(without));
            let weight = changed(&with, &without, noise);
            stays += weight * above(&with, noise);
            was += weight * above(&without, noise);
        }
        Self { left: part(stays, was), ..Self::of(with, without, floors) }
    }

    /// Of the effect that the one model has and the other has not.
    #[must_use]
    pub fn of(with: &Residuals, without: &Residuals, floors: &[f64]) -> Self {
        let mut out = Self { promised: 0.0, gained: 0.0, left: 0.0 };
        let noises = white(with, floors).into_iter().zip(white(without, floors));
        for ((with, without), (a, b)) in with.iter().zip(without).zip(noises) {
            let sigma = a.sigma.min(b.sigma);
            if !(sigma > 0.0 && sigma.is_finite()) {
                continue;
            }
            for (x, y) in with.iter().flatten().zip(without.iter().flatten()) {
                out.promised += ((x - y) / sigma).powi(2);
                out.gained += (y * y - x * x) / (sigma * sigma);
            }
        }
        out
    }
}

/// By how much the squares fall from `without` to `with`, of the same samples, in units of `noise`.
#[must_use]
pub fn fall_of_squares(with: &Residuals, without: &Residuals, noise: &[Colour]) -> f64 {
    above(without, noise) - above(with, noise)
}

/// What additions to the readings of one model promise and gain, the numbers of which follow: what they mimic is none of it.
pub struct AdditionTest {
    screen: ScoreTest,
    /// Squares above noise without an addition, if the additions are events.
    event: Option<f64>,
}

impl AdditionTest {
    /// On the runs of `of`. `quiet`: the noise where nothing happens, if the additions are events.
    #[must_use]
    pub fn new(of: &FittedModel, quiet: Option<&[Colour]>, floors: &[f64]) -> Option<Self> {
        let plain = white(&of.residuals, floors);
        let screen = ScoreTest::new(&of.problem, &of.point, quiet.unwrap_or(&plain))?;
        Some(Self { screen, event: quiet.map(|noise| above(&of.residuals, noise)) })
    }

    /// Of one addition.
    #[must_use]
    pub fn told(&self, addition: &Column) -> Confirmation {
        let (promised, gained) = self.screen.as_it_is(addition);
        let left = self.event.map_or(0.0, |without| part(without - gained, without));
        Confirmation { promised, gained, left }
    }
}

/// Noise of each channel in the recordings in which nothing `happened`, or in all, if there is no other.
#[must_use]
pub fn quiet_noise(of: &FittedModel, happened: impl Fn(&Recording) -> bool, floors: &[f64]) -> Vec<Colour> {
    let is_quiet = |w: &usize| !happened(&of.problem.recordings[of.problem.windows[*w].0]);
    let quiet: Vec<usize> = (0..of.problem.windows.len()).filter(is_quiet).collect();
    let residuals = if quiet.is_empty() { &of.residuals } else { &of.on_windows(&quiet).residuals };
    white(residuals, floors)
}

/// Squares above noise.
fn above(residuals: &Residuals, noise: &[Colour]) -> f64 {
    let excess = |(runs, colour): (&Vec<Vec<f64>>, &Colour)| -> f64 {
        let has_weight = colour.sigma > 0.0 && colour.sigma.is_finite();
        if has_weight { runs.iter().flatten().map(|x| (x / colour.sigma).powi(2) - 1.0).sum() } else { 0.0 }
    };
    residuals.iter().zip(noise).map(excess).sum()
}

/// Squares of the change between two models.
fn changed(with: &Residuals, without: &Residuals, noise: &[Colour]) -> f64 {
    let mut squares = 0.0;
    for ((a, b), colour) in with.iter().zip(without).zip(noise) {
        if colour.sigma > 0.0 && colour.sigma.is_finite() {
            let apart = a.iter().flatten().zip(b.iter().flatten()).map(|(x, y)| (x - y) / colour.sigma);
            squares += apart.map(|x| x * x).sum::<f64>();
        }
    }
    squares
}

/// What is left of `without`, which is all of it where there is nothing.
fn part(with: f64, without: f64) -> f64 {
    if without > 0.0 { (with / without).max(0.0) } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::library::worked::{FLOORS, hiding};
    use crate::identify::synthesis::{SHAKEN_PENDULUM, shaken_pendulum};

    const DRAG: &str = "[[effect]]\neffect = \"quadratic_drag\"\nat = \"q1\"\nquadratic = 0.004\n";

    #[test]
    fn what_is_not_there_predicts_worse_and_what_is_there_leaves_the_noise() {
        let experiment = shaken_pendulum();
        let held_out = HeldOut::of(&experiment, &experiment.rig).unwrap();
        let truth = held_out.residuals(&experiment.rig).unwrap();
        assert_eq!((truth.len(), truth[0].len(), truth[0][0].len()), (1, 1, 400), "the one that was kept back");
        let rms = libm::sqrt(truth[0][0].iter().map(|x| x * x).sum::<f64>() / 400.0);
        assert!((rms / 0.001 - 1.0).abs() < 0.15, "{rms}");
        let dragged =
            Rig::parse(&SHAKEN_PENDULUM.replacen("[[recording]]", &format!("{DRAG}[[recording]]"), 1), "rig.toml")
                .unwrap();
        let wrong = held_out.residuals(&dragged).unwrap();
        let Confirmation { promised, gained, .. } = Confirmation::of(&wrong, &truth, &[1e-6]);
        assert!(promised > 400.0 && (gained / promised + 1.0).abs() < 0.1, "{promised} {gained}");
        let Confirmation { promised, gained, .. } = Confirmation::of(&truth, &wrong, &[1e-6]);
        assert!((gained / promised - 1.0).abs() < 0.1, "the other way round: {promised} {gained}");
    }

    const PUSH: &str = "[[effect]]\neffect = \"external_push\"\nat = \"q1\"\nimpulse = ";

    #[test]
    fn windows_for_an_event_are_as_long_as_its_own_and_show_it_elsewhere() {
        let fitted = [0..100, 100..200, 200..300];
        let rows: Vec<&Range<usize>> = fitted.iter().collect();
        assert_eq!(cuts(&rows, None), [50, 150, 250], "in the middles");
        assert_eq!(cuts(&rows, Some(190)), [65, 165, 265], "a quarter behind the cut, not nine tenths");
        assert_eq!(cuts(&rows, Some(110)), [60, 160, 260], "half, not a tenth");
        assert_eq!(cuts(&rows, Some(5)), [55, 155, 255], "what comes before the first row is no window");
    }

    #[test]
    fn of_two_pushes_the_one_is_asked_that_the_other_model_lacks() {
        let problem = hiding("");
        let push = |at_s: f64| {
            format!("{PUSH}{{ value = 0.01, min = -1.0, max = 1.0 }}\ntime = {at_s}\nrecordings = [\"a.csv\"]\n")
        };
        let with = problem.fitted(&(push(0.6) + &push(1.4)), 1);
        let candidate = Candidate { only: Some("a.csv".into()), ..problem.candidate("external_push", "q1") };
        let asked = |kept: &str| instant_s(&candidate, &with, &problem.fitted(kept, 1)).unwrap();
        assert!((asked(&push(1.4)) - 0.6).abs() < 1e-9 && (asked(&push(0.6)) - 1.4).abs() < 1e-9);
        assert!((asked("") - 1.4).abs() < 1e-9, "the last that was added");
    }

    #[test]
    fn misfit_in_other_windows_says_nothing_of_an_event() {
        let window = |size: f64| -> Vec<f64> { (0..100).map(|k| size * libm::sin(f64::from(k))).collect() };
        let told = |before: f64| {
            let (with, without) = (vec![vec![window(before), window(0.1)]], vec![vec![window(before), window(30.0)]]);
            Confirmation::of_event(&with, &without, &[Colour::white(1.0)], &[1e-5]).left
        };
        assert!(told(0.1) < 0.01 && told(30.0) < 0.01, "{} {}", told(0.1), told(30.0));
    }

    /// Of a drag of .004 that is (not) there: what predictions say, and whether it replicates, where the viscous friction of the one model or
    /// of the other came out wrong.
    fn drag_beside_wrong_friction(is_there: bool, [with, without]: [f64; 2]) -> [Confirmation; 2] {
        let problem = hiding(if is_there { DRAG } else { "" });
        let of = |effects: &str, viscous: f64| {
            let mut of = problem.fitted(effects, 1);
            of.rig.effects[0].values[0].value = viscous;
            of
        };
        let (with, without) = (of(DRAG, with), of("", without));
        let kept_back = Recording { usage: Use::Heldout, ..with.problem.recordings[0].clone() };
        let experiment = Experiment { rig: with.rig.clone(), recordings: vec![kept_back] };
        let held_out = HeldOut::of(&experiment, &with.rig);
        let drag = problem.candidate("quadratic_drag", "q1");
        let replicated = Confirmation::of_effect(&drag, (&with, 1), &without, held_out.as_ref(), &FLOORS).unwrap();
        [Confirmation::on_kept_back(&with, &without, held_out.as_ref(), &FLOORS).unwrap(), replicated]
    }

    #[test]
    fn an_effect_replicates_by_what_it_does_itself_not_by_the_friction_beside_it() {
        let [predicted, replicated] = drag_beside_wrong_friction(true, [0.06, 0.03]);
        assert!(predicted.gained < 0.0 && replicated.promised > 100.0, "{predicted}, {replicated}");
        assert!((replicated.gained / replicated.promised - 1.0).abs() < 0.2, "it is there: {replicated}");
        let [predicted, replicated] = drag_beside_wrong_friction(false, [0.015, 0.08]);
        assert!(predicted.gained > 0.0 && replicated.promised > 100.0, "{predicted}, {replicated}");
        assert!((replicated.gained / replicated.promised + 1.0).abs() < 0.2, "it is not: {replicated}");
    }

    #[test]
    fn nothing_kept_back_says_nothing() {
        let mut experiment = shaken_pendulum();
        experiment.recordings.truncate(1);
        assert!(HeldOut::of(&experiment, &experiment.rig).is_none());
    }
}
