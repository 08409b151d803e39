//! The whole walk of a diagnosis, stage by stage.
//!
//! RT: no.

use crate::diagnose::explain::answer_sets::{answer_sets, rejected};
use crate::diagnose::explain::headline::{costs, headline};
use crate::diagnose::explain::interest::{Kept, split_by_interest, undetermined, within_its_row};
use crate::diagnose::explain::laws;
use crate::diagnose::explain::localise::places;
use crate::diagnose::explain::tables::{parameter_lines, ranking};
use crate::diagnose::input_checks::{at_bounds, contradicted, suspicions};
use crate::diagnose::judge::criterion::{Context, compare, detection_threshold, explained_part};
use crate::diagnose::judge::estimates::{estimates, undetermined_combinations};
use crate::diagnose::judge::evidence::{Comparison, Ledger};
use crate::diagnose::judge::numbers::{LEAST_SHARE, LONGEST_MEMORY};
use crate::diagnose::judge::verdict::{
    Diagnosis, Findings, Law, Missing, Seen, Trace, Verdict, may_have_missed, refit_is_needed, verdict_of,
};
use crate::diagnose::library::candidate_fit::{CandidateFit, SelectedEffect};
use crate::diagnose::library::initial_guesses::candidates;
use crate::diagnose::nameless::pooling_test::{no_common_machine, unfollowed};
use crate::diagnose::nameless::residual_force::{Unlisted, unexplained};
use crate::diagnose::robustness::held_out::HeldOut;
use crate::diagnose::screen::linearise::ltv_windows;
use crate::diagnose::screen::scales::scales;
use crate::diagnose::screen::score_test::ScoreTest;
use crate::diagnose::search::basin_hopping::escape_local_minimum;
use crate::diagnose::search::converge_rivals::converge_rivals;
use crate::diagnose::search::exchange::exchange_and_eliminate;
use crate::diagnose::search::numerics::{with_likeliest_numerics, with_numerics};
use crate::diagnose::search::pairwise_exchange::exchange_pairs;
use crate::diagnose::search::ridge_restarts::restart_along_ridges;
use crate::diagnose::search::stepwise::{Selection, forward};
use crate::diagnose::sentence;
use crate::identify::base_fit::{as_given, fit_recordings, fitted, floors};
use crate::identify::computed::computed_inputs;
use crate::identify::experiment::{Experiment, Recording};
use crate::identify::fit::Limits;
use crate::identify::fitted_model::FittedModel;
use crate::identify::floor::complaints;
use crate::identify::likelihood::{is_misfit, memory, samples, squares, white};
use crate::identify::noise::Colour;
use crate::identify::outliers::{cleaned, drop_spikes};
use crate::identify::problem::Problem;
use crate::identify::rollout::{Pooled, RolloutError, free_run};
use crate::identify::units::wrong_units;
use crate::identify::validation::{Models, proof};
use crate::model::rig::{Numerics, Rig, Use};
use std::sync::Arc;
use std::time::Instant;

/// Why there is no answer.
#[derive(Debug, thiserror::Error)]
pub enum DiagnoseError {
    /// Nothing to fit on.
    #[error("no recording with use = \"fit\": mark at least one in rig.toml")]
    NothingToFit,
    /// No channel moves.
    #[error("no column of the fit recordings carries a signal: nothing can be told; record motion\n{0}")]
    NoSignal(String),
    /// Columns in the wrong unit.
    #[error("{}", .0.join("\n"))]
    Units(Vec<String>),
    /// Inputs that are control errors.
    #[error("{}", .0.join("\n"))]
    Computed(Vec<String>),
    /// The machine does not run.
    #[error(transparent)]
    Run(#[from] RolloutError),
    /// A supposed effect has no place in this rig.
    #[error("`{0}`: this rig has no place for it, it stands in rig.toml already, or every fit with it diverges")]
    NoPlace(String),
    /// The base model leaves the finite numbers from every start.
    #[error("the base model diverges on the fit recordings; shorten `window_s` or check units and signs in rig.toml")]
    Diverges,
}

/// The answer and the model that goes with it.
#[derive(Clone, Debug)]
pub struct Answer {
    /// Everything for `diagnosis.json` and the page.
    pub findings: Findings,
    /// The rig with fitted numbers and the effects that were found.
    pub model: Rig,
    /// What the judge compared, by the rules and by the evidence.
    pub comparisons: Vec<Comparison>,
}

/// What is asked of a diagnosis beside the case.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Seed of every random draw.
    pub seed: u64,
    /// Smallest part of the misfit that an effect removes when it matters.
    pub least_share: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { seed: 0, least_share: LEAST_SHARE }
    }
}

/// Diagnoses a case. `told` hears what is going on.
///
/// # Errors
/// See [`DiagnoseError`].
pub fn diagnose(
    experiment: &Experiment,
    options: Options,
    mut told: impl FnMut(&str),
) -> Result<Answer, DiagnoseError> {
    let began = Instant::now();
    let mut said = |text: &str| told(&format!("{:5.1} s  {text}", began.elapsed().as_secs_f64()));
    let mut start = Start::of(experiment, options, &mut said)?;
    let mut selection = searched(experiment, &start, &mut said);
    if start.takes_numerics_of(&selection, experiment, &mut said) {
        selection = searched(experiment, &start, &mut said);
    }
    let (last, cut_short) = (selection.last.clone(), selection.cut_short);
    let answer = finished(start.given.clone(), selection, options, &start.context, &mut said);
    let (clean, left_out) = cleaned(experiment, &answer.explained().rig);
    let mut warnings = warnings(experiment, start.dropped.max(left_out));
    warnings.extend(start.given.is_none().then(|| RUNS_AWAY.to_owned()));
    warnings.extend(answer.warnings(experiment, cut_short, &start.context));
    said("proof");
    let mut findings = answer.findings(&clean, &start.context, &last, warnings)?;
    findings.warnings.extend(contradicted(&findings.diagnosis.fit));
    findings.diagnosis.seconds = began.elapsed().as_secs_f64();
    Ok(Answer { findings, model: answer.model(experiment), comparisons: start.context.ledger.all() })
}

/// What a search starts from.
struct Start {
    pooled: Pooled,
    /// Samples that were left out.
    dropped: usize,
    /// With the numbers as given; none where it runs away with them.
    given: Option<FittedModel>,
    base: FittedModel,
    context: Context,
}

impl Start {
    fn of(experiment: &Experiment, options: Options, said: &mut dyn FnMut(&str)) -> Result<Self, DiagnoseError> {
        let (mut recordings, pooled, floors) = ready(experiment)?;
        said("base fit");
        let first =
            fitted(&experiment.rig, &recordings, &pooled, &floors).ok_or_else(|| runaway(experiment, &pooled))?;
        let dropped: usize = drop_spikes(&mut recordings, &first).iter().sum();
        let given = as_given(&experiment.rig, &recordings, &pooled, &floors);
        let base = again(&first, &recordings, &floors).ok_or(DiagnoseError::Diverges)?;
        let base = if let Some(given) = &given { no_worse(base, given, &floors) } else { base };
        let context = Context {
            samples: samples(&base.residuals, &floors),
            given: experiment.rig.effects.len(),
            is_trapped: is_trapped(&base, experiment),
            floors,
            seed: options.seed,
            ledger: Ledger::default(),
            held_out: HeldOut::of(experiment, &base.rig).map(Arc::new),
        };
        said(&format!("noise {:.3?}", base.noise));
        for (name, of) in estimates(&base) {
            said(&format!("   {name} {:.4}", of.value));
        }
        let mut start = Self { pooled, dropped, given, base, context };
        if let Some(base) = with_likeliest_numerics(&start.base, &start.context) {
            start.computes_as(base, experiment, said);
        }
        Ok(start)
    }

    /// True if what was selected shows other numerics of the simulation than the base alone did: then the search starts anew with these.
    fn takes_numerics_of(
        &mut self,
        selection: &Selection,
        experiment: &Experiment,
        said: &mut dyn FnMut(&str),
    ) -> bool {
        let found = Some(&selection.found).filter(|_| !selection.added.is_empty());
        let other = found.and_then(|found| with_likeliest_numerics(found, &self.context));
        let base = other.and_then(|other| with_numerics(&self.base, other.rig.numerics, &self.context));
        base.map(|base| self.computes_as(base, experiment, said)).is_some()
    }

    /// From `base`, which is fitted with other numerics.
    fn computes_as(&mut self, base: FittedModel, experiment: &Experiment, said: &mut dyn FnMut(&str)) {
        said(&numerics_told(base.rig.numerics));
        let rig = computing_as(&experiment.rig, &base);
        self.given = as_given(&rig, &base.problem.recordings, &self.pooled, &self.context.floors);
        self.base = base;
    }
}

/// Forward selection over the library.
fn searched(experiment: &Experiment, start: &Start, said: &mut dyn FnMut(&str)) -> Selection {
    let Start { pooled, given, base, context, .. } = start;
    let library = |now: &FittedModel| {
        let Some(windows) = ltv_windows(now) else { return Vec::new() };
        let scales = scales(now, &windows, pooled);
        let screen = |noise: &[Colour]| ScoreTest::new(&now.problem, &now.point, noise);
        let (Some(fine), Some(coarse)) = (screen(&now.noise), screen(&white(&now.residuals, &context.floors))) else {
            return Vec::new();
        };
        candidates(now, &scales, [&fine, &coarse], &windows)
    };
    let also = given.as_ref().filter(|_| context.is_trapped).map(|given| given.counted_with(base));
    let rig = computing_as(&experiment.rig, base);
    let all = forward((&rig, base), also.as_ref(), library, context, &mut *said);
    let strict = if all.added.is_empty() { without_slow_noise(&all.base, &all.last, context) } else { None };
    let Some(strict) = strict else { return all };
    said("what passes for noise is slower than noise: again without");
    forward((&rig, &strict), None, library, context, said)
}

/// `rig` with the numerics of `of`.
fn computing_as(rig: &Rig, of: &FittedModel) -> Rig {
    Rig { numerics: of.rig.numerics, ..rig.clone() }
}

/// What a simulator did to the recordings.
fn numerics_told(numerics: Numerics) -> String {
    let Numerics { euler_step_s, smooth_rate } = numerics;
    let steps = euler_step_s.map(|s| format!("steps by {:.3} ms (semi-implicit Euler)", 1e3 * s));
    let sign = smooth_rate.map(|r| format!("gives friction a smooth sign (tanh of the rate over {r})"));
    let what: Vec<String> = steps.into_iter().chain(sign).collect();
    if what.is_empty() {
        return "the recordings agree best with an exact integration".to_owned();
    }
    let what = what.join(" and ");
    format!("the recordings agree best with a simulator that {what}; that is no missing physics and is taken along")
}

/// What was selected, exchanged, fitted to the last digit, and judged beside a force without a name.
fn finished(
    given: Option<FittedModel>,
    selection: Selection,
    options: Options,
    context: &Context,
    said: &mut dyn FnMut(&str),
) -> Found {
    let Selection { base, found, mut added, last, .. } = selection;
    let refit = given.map(|given| compare(&base, &given, context));
    let refit_needed = refit.is_none_or(|refit| refit_is_needed(refit, base.point.parameters.len(), context));
    said(&refit.map_or_else(|| RUNS_AWAY.to_owned(), |refit| format!("re-fit gains {:.0}", refit.total)));
    let spent = |of: &FittedModel| format!("effort {:.0} M", 1e-6 * of.problem.effort.spent() as f64);
    said(&format!("pairs exchanged, {}", spent(&found)));
    let found = exchange_pairs(found, &mut added, &last, context, said);
    said(&format!("each exchanged and left out, {}", spent(&found)));
    let (found, added) = exchange_and_eliminate(found, added, context);
    said(&format!("last fit, {}", spent(&found)));
    let found = settled(restart_along_ridges(found, context), context);
    said(&format!("last fit of the rivals, {}", spent(&found)));
    let (found, added) = converge_rivals(found, added, context);
    let kept = Kept::all(found, added).without_undetermined(&base, context);
    let undetermined_only = kept.seen.len();
    // Before what is left is asked: a name that is refuted does not answer for what it stood for.
    let Kept { found, added, seen } = kept.without_refuted(&base, context);
    said(&format!("what is left, {}", spent(&found)));
    let strict = without_slow_noise(&base, &last, context).or_else(|| as_leader_hears(&base, &added, &last, context));
    let rest = unexplained(&found, strict.as_ref().unwrap_or(&base), context, said);
    let replaced = rest.as_ref().is_some_and(|(_, instead)| *instead);
    let (found, added) = if replaced { (base.clone(), Vec::new()) } else { (found, added) };
    let rest = rest.map(|(unlisted, _)| unlisted);
    let (found, added, rest) = match no_common_machine(&base, &found, &context.floors) {
        Some(unlisted) => (base.clone(), Vec::new(), Some(unlisted)),
        None => {
            let rest = rest.or_else(|| if added.is_empty() { unfollowed(&base, &context.floors) } else { None });
            (found, added, rest)
        }
    };
    let kept = Kept { found, added, seen };
    let Kept { found, added, mut seen, .. } = kept.of_interest(options.least_share, &base, context);
    // What recordings kept back refute is nothing, unless the base leaves what is no noise.
    let told = if is_misfit(&base.residuals, &context.floors) { seen.len() } else { undetermined_only };
    let rest = rest.or_else(|| undetermined(&added, &seen[..told], options.least_share));
    let (rest, small) = split_by_interest(rest, options.least_share);
    seen.extend(small);
    if added.is_empty() && rest.is_none() && seen.is_empty() {
        seen.extend(within_its_row(&base, &last, context));
    }
    seen.iter().for_each(|one| said(&one.sentence));
    Found { base: base.with_intervals(), found: found.with_intervals(), added, seen, rest, refit_needed }
}

/// True if the fit of the base ended at bounds: a number that made up for what is missing as far as it could. One step of a
/// candidate then does not move it back, and promises nothing.
fn is_trapped(base: &FittedModel, experiment: &Experiment) -> bool {
    !at_bounds(&base.clone().with_intervals(), &experiment.rig).is_empty()
}

/// `base` with slow noise taken for mismatch, if it or a trial of the last round has any. A slow mismatch with white noise on
/// top passes for noise of a long memory, and that swallows whatever would explain it (seen: nine times the noise called
/// consistent). A round is judged under the noise that its best trial leaves: of two effects that are missing the one passes for
/// such noise beside the other, and none gains.
fn without_slow_noise(base: &FittedModel, last: &[CandidateFit], context: &Context) -> Option<FittedModel> {
    let is_quick = |of: &FittedModel| of.noise.iter().all(|colour| memory(colour) <= LONGEST_MEMORY);
    if is_quick(base) && last.iter().all(|trial| is_quick(&trial.hypothesis)) {
        return None;
    }
    let problem = Problem { longest_memory: LONGEST_MEMORY, ..base.problem.clone() };
    FittedModel::at(problem, base.point.clone(), base.information.clone(), &context.floors)
}

/// `base` with the noise that the best candidate left, where none was believed though that one gained more than chance: what
/// it took away passed for coloured noise (a shaken base for a ringing link without damping).
fn as_leader_hears(
    base: &FittedModel,
    added: &[SelectedEffect],
    last: &[CandidateFit],
    context: &Context,
) -> Option<FittedModel> {
    let heard = |t: &&CandidateFit| t.gain > detection_threshold(context, t.candidate.keys.len());
    let leader = last.first().filter(heard).filter(|_| added.is_empty())?;
    Some(FittedModel { noise: leader.hypothesis.noise.clone(), ..base.clone() })
}

/// What to say of numbers as given that no run survives.
const RUNS_AWAY: &str = "with the numbers as given the simulation runs away; they may be those of no body";

/// What to say of a search that ended early.
const CUT_SHORT: &str = "the search for further effects ended at its limit of work: more may be missing than is named; \
                         shorter or fewer recordings let it go on";

/// What a fit starts from: its recordings, the spread of their channels and the smallest residuals.
pub(super) fn ready(experiment: &Experiment) -> Result<(Vec<Recording>, Pooled, Vec<f64>), DiagnoseError> {
    let recordings = fit_recordings(experiment);
    if recordings.is_empty() {
        return Err(DiagnoseError::NothingToFit);
    }
    let pooled = Pooled::of(&experiment.rig, experiment.of_use(Use::Fit));
    let floors = floors(&experiment.rig, &pooled, &recordings);
    let wrong: Vec<String> = experiment.recordings.iter().flat_map(|r| wrong_units(&experiment.rig, r)).collect();
    if !wrong.is_empty() {
        return Err(DiagnoseError::Units(wrong));
    }
    let computed: Vec<String> =
        experiment.recordings.iter().flat_map(|r| computed_inputs(&experiment.rig, r)).collect();
    if !computed.is_empty() {
        return Err(DiagnoseError::Computed(computed));
    }
    if floors.iter().any(|floor| floor.is_finite()) {
        return Ok((recordings, pooled, floors));
    }
    let why: Vec<&str> = recordings.iter().flat_map(|r| &r.warnings).map(String::as_str).collect();
    Err(DiagnoseError::NoSignal(why.join("\n")))
}

/// The base fit once more on cleaned recordings.
#[must_use]
pub fn again(first: &FittedModel, recordings: &[Recording], floors: &[f64]) -> Option<FittedModel> {
    let mut problem = first.problem.clone();
    problem.recordings = Arc::new(recordings.to_vec());
    let noise = white(&first.residuals, floors);
    let now = FittedModel::fitted(problem, first.point.clone(), &noise, floors, Limits::default())?;
    let finer = now.polished(&now.noise, floors, Limits { iterations: 8, tolerance: 1e-6 });
    Some(finer.filter(|f| f.likelihood > now.likelihood).unwrap_or(now))
}

/// `base`, or if the rig as given is better, the fit that starts from there: a fit may end in a false minimum.
fn no_worse(base: FittedModel, given: &FittedModel, floors: &[f64]) -> FittedModel {
    let total = |h: &FittedModel| -> f64 { h.blocks(&given.noise).iter().sum() };
    if total(&base) >= total(given) {
        return base;
    }
    let noise = white(&given.residuals, floors);
    let start = FittedModel::fitted(base.problem.clone(), given.point.clone(), &noise, floors, Limits::default());
    let finer = start.and_then(|h| h.polished(&h.noise, floors, Limits { iterations: 8, tolerance: 1e-6 }).or(Some(h)));
    finer.filter(|h| total(h) > total(&base)).unwrap_or(base)
}

/// The last fit of the answer, to the last digit that counts: under the noise that it leaves, or by squares where that is
/// misfit, then out of a false minimum too.
fn settled(found: FittedModel, context: &Context) -> FittedModel {
    let misfit = is_misfit(&found.residuals, &context.floors);
    let noise = if misfit { squares(&found.residuals, &context.floors) } else { found.noise.clone() };
    let total = |h: &FittedModel| -> f64 { h.blocks(&noise).iter().sum() };
    let finer = found.polished(&noise, &context.floors, Limits { iterations: 25, tolerance: 1e-7 });
    let finer = finer.filter(|f| total(f) >= total(&found)).unwrap_or(found);
    let other = if misfit { escape_local_minimum(&finer, context) } else { None };
    other.filter(|o| total(o) > total(&finer)).unwrap_or(finer)
}

/// The recording on which the rig as given runs away, and when: what a person can mend.
pub(super) fn runaway(experiment: &Experiment, pooled: &Pooled) -> DiagnoseError {
    let runs = experiment.of_use(Use::Fit).map(|recording| free_run(&experiment.rig, recording, pooled));
    runs.filter_map(Result::err).next().map_or(DiagnoseError::Diverges, DiagnoseError::Run)
}

/// What was odd in the input. `dropped`: how many samples were left out.
pub(super) fn warnings(experiment: &Experiment, dropped: usize) -> Vec<String> {
    let mut out: Vec<String> = experiment.recordings.iter().flat_map(|r| r.warnings.clone()).collect();
    if dropped > 0 {
        out.push(format!(
            "{dropped} single samples stick out of their neighbours like transmission errors; left out of fit and comparison"
        ));
    }
    out
}

/// What the stages found.
struct Found {
    base: FittedModel,
    found: FittedModel,
    added: Vec<SelectedEffect>,
    seen: Vec<Seen>,
    rest: Option<Unlisted>,
    refit_needed: bool,
}

impl Found {
    fn is_unlisted(&self) -> bool {
        self.rest.is_some()
    }

    /// What a person should know of the search and of the model that it came to.
    fn warnings(&self, experiment: &Experiment, cut_short: bool, context: &Context) -> Vec<String> {
        let explained = self.explained();
        let mut out = Vec::new();
        let rest_matters = may_have_missed(explained_part(&self.base, &self.found, context));
        out.extend((cut_short && rest_matters).then(|| CUT_SHORT.to_owned()));
        let sentence = self.rest.as_ref().map_or_else(String::new, |u| u.entry.sentence.to_lowercase());
        out.extend(
            suspicions(explained, &context.floors).into_iter().filter(|w| !sentence.contains(&w.to_lowercase())),
        );
        out.extend(at_bounds(explained, &experiment.rig));
        let numerics = explained.rig.numerics;
        out.extend((numerics != experiment.rig.numerics).then(|| numerics_told(numerics)));
        out.extend(complaints(&explained.problem, &explained.point, &explained.noise));
        out
    }

    /// The model that the answer stands for: with what was found, if that is all of it.
    fn explained(&self) -> &FittedModel {
        if self.added.is_empty() { &self.base } else { &self.found }
    }

    /// The residual force that nothing explains, then the laws that were found.
    fn laws(&self, experiment: &Experiment, traces: &[Trace]) -> Vec<Law> {
        let mut out: Vec<Law> = self.rest.as_ref().map(|u| u.laws.clone()).unwrap_or_default();
        out.extend(laws::found(self.explained(), experiment.rig.effects.len(), traces));
        out
    }

    fn model(&self, experiment: &Experiment) -> Rig {
        let keep_given = self.added.is_empty() && !self.refit_needed && !self.is_unlisted();
        if keep_given { experiment.rig.clone() } else { self.explained().rig.clone() }
    }

    fn findings(
        &self,
        experiment: &Experiment,
        context: &Context,
        last: &[CandidateFit],
        warnings: Vec<String>,
    ) -> Result<Findings, RolloutError> {
        let explained = self.explained();
        let models = Models { given: &experiment.rig, refitted: &self.base.rig, explained: &explained.rig };
        let (fit, traces) = proof(experiment, models)?;
        let mut missing: Vec<Missing> = answer_sets(explained, &self.added, context);
        missing.extend(self.rest.as_ref().map(|u| u.entry.clone()));
        let verdict = verdict_of(&missing, self.refit_needed);
        let count = explained.rig.effects.len() - experiment.rig.effects.len();
        let added = &explained.rig.effects[explained.rig.effects.len() - count..];
        let next_experiment = if verdict == Verdict::Ambiguous { sentence::next_experiment(&missing) } else { None };
        let mut places = places(experiment, &traces, &explained.rig, added);
        if !verdict.is_mismatch() {
            places.clear();
        } else if let Some(u) = self.rest.as_ref().filter(|u| !u.places.is_empty()) {
            // Where the nameless force acts says more than where its traces are seen.
            if self.added.is_empty() {
                places.clear();
            }
            places.splice(0..0, u.places.iter().cloned());
        }
        let diagnosis = Diagnosis {
            schema: 1,
            verdict,
            places,
            seen: self.seen.clone(),
            rejected: rejected(&missing, &self.added, last, context),
            missing,
            next_experiment,
            fit,
            seconds: 0.0,
            seed: context.seed,
        };
        let given = self.base.problem.with_rig(experiment.rig.clone());
        let parameters = parameter_lines(&given, &self.base, explained);
        Ok(Findings {
            rig: experiment.rig.name.clone(),
            headline: headline(&diagnosis, &parameters, &costs(&experiment.rig, &traces)),
            ranking: ranking(&self.base, &self.added, last, context),
            parameters,
            undetermined: undetermined_combinations(explained),
            laws: self.laws(experiment, &traces),
            diagnosis,
            traces,
            warnings,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::synthesis::record;

    /// Two links, the second on the first; `moment2` is free.
    fn links(moment2: f64) -> Rig {
        let text = format!(
            "schema = 1\nmechanism = \"double_pendulum\"\n[parameters]\ninertia1_kg_m2 = 0.012\ninertia2_kg_m2 = 0.055\n\
             moment1_kg_m = 0.07\nmoment2_kg_m = {{ value = {moment2}, min = 0.1, max = 0.5 }}\nmass2_kg = 1.1\n\
             length1_m = 0.25\ngravity_m_s2 = 9.81\n\
             [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 1.0\n\
             [[sensor]]\nmeasures = \"q1\"\ncolumn = \"q1_rad\"\nnoise_std = 0.001\n\
             [[sensor]]\nmeasures = \"q2\"\ncolumn = \"q2_rad\"\nnoise_std = 0.001\n\
             [[recording]]\nfile = \"a.csv\"\nuse = \"fit\"\n"
        );
        Rig::parse(&text, "rig.toml").unwrap()
    }

    #[test]
    fn numbers_as_given_of_no_body_are_fitted_again_and_told() {
        let times: Vec<f64> = (0..150).map(|k| f64::from(k) * 0.01).collect();
        let inputs = vec![times.iter().map(|t| 0.3 * libm::sin(9.0 * t)).collect()];
        let mut recording = Recording::new("a.csv", times, inputs, Vec::new());
        recording.measured = record(&links(0.22), &recording, &[0.2, -0.1], Some(1)).unwrap().measured;
        // (length1 moment2)² is more than (inertia1 + mass2 length1²) inertia2: no mass matrix.
        let experiment = Experiment { rig: links(0.28), recordings: vec![recording] };
        let start = Start::of(&experiment, Options::default(), &mut |_| {}).unwrap();
        assert!(start.given.is_none());
        let moment2 = estimates(&start.base)[0].1.value;
        assert!((moment2 / 0.22 - 1.0).abs() < 0.02, "{moment2}");
    }
}
