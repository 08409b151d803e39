//! The whole walk of a diagnosis: [`start`], the search, the [`stages`] that follow it, and what was [`found`].
//!
//! RT: no.

mod found;
mod stages;
mod start;

use crate::diagnose::base_model::{DiagnoseError, warnings};
use crate::diagnose::input_checks::contradicted;
use crate::diagnose::judge::criterion::{Context, compare, detection_threshold, leaves_slow_noise};
use crate::diagnose::judge::evidence::Comparison;
use crate::diagnose::judge::numbers::LEAST_SHARE;
use crate::diagnose::judge::verdict::Findings;
use crate::diagnose::library::candidate_fit::{CandidateFit, SelectedEffect};
use crate::diagnose::robustness::held_out::Confirmation;
use crate::diagnose::search::stepwise::{Selection, forward, forward_on};
use crate::identify::base_fit::anew;
use crate::identify::experiment::Experiment;
use crate::identify::fitted_model::FittedModel;
use crate::identify::outliers::cleaned;
use crate::model::rig::Rig;
use found::Found;
use stages::{finished, slow_noise_as_misfit, without_slow_noise};
use start::{RUNS_AWAY, Start, computing_as};
use std::time::Instant;

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

/// What is told while a diagnosis runs: a stage for people, or, where the text is indented, a detail for `--trace`.
#[derive(Clone, Copy, Debug)]
pub struct Note<'t> {
    /// Time since the beginning.
    pub after_s: f64,
    /// What is going on.
    pub text: &'t str,
}

impl Note<'_> {
    /// True if it says little to who has not read the code.
    #[must_use]
    pub fn is_detail(&self) -> bool {
        self.text.starts_with(' ')
    }
}

/// Diagnoses a case. `told` hears what is going on.
///
/// # Errors
/// See [`DiagnoseError`].
pub fn diagnose(
    experiment: &Experiment,
    options: Options,
    mut told: impl FnMut(Note<'_>),
) -> Result<Answer, DiagnoseError> {
    let began = Instant::now();
    let mut said = |text: &str| told(Note { after_s: began.elapsed().as_secs_f64(), text });
    let first = Start::of(experiment, options.seed, &mut said)?;
    let mut walk = on_whole_windows(experiment, first.clone(), Stood::default(), (options, &mut said));
    // Where the simulation is far off whole windows may hide what is missing: pieces of them show it.
    let is_explained = walk.found.explains(&walk.start.context);
    let closer = if walk.found.holds(&walk.start) { Vec::new() } else { first.closer(experiment, is_explained) };
    if let Some((start, stood)) = from_pieces(experiment, (first, &walk), &closer, &mut said) {
        let again = on_whole_windows(experiment, start, stood, (options, &mut said));
        if walk.predicts_better_than(&again) {
            said("recordings kept back are predicted better without the pieces");
        } else {
            walk = again;
        }
    }
    let OnWholeWindows { start, found, last, cut_short } = walk;
    let (clean, left_out) = cleaned(experiment, &found.explained().rig);
    let mut warnings = warnings(experiment, start.dropped.max(left_out));
    warnings.extend(start.given.is_none().then(|| RUNS_AWAY.to_owned()));
    warnings.extend(found.warnings(experiment, cut_short, &start.context));
    said("free runs of the models on all recordings");
    let mut findings = found.findings(&clean, &start.context, &last, warnings)?;
    findings.warnings.extend(contradicted(&findings.diagnosis.fit));
    findings.diagnosis.seconds = began.elapsed().as_secs_f64();
    Ok(Answer { findings, model: found.model(experiment), comparisons: start.context.ledger.all() })
}

/// A search on the windows of the rig, and what of it stands.
#[derive(Clone)]
struct OnWholeWindows {
    start: Start,
    found: Found,
    /// The candidates of its last round.
    last: Vec<CandidateFit>,
    cut_short: bool,
}

impl OnWholeWindows {
    /// True if `shown`, what pieces of the windows show, is what was found, and no better on the whole ones from its numbers there, as
    /// `again` stands.
    fn is_borne_out_by(&self, shown: &Selection, again: Option<&FittedModel>) -> bool {
        let is_found = |of: &SelectedEffect| self.found.added.iter().any(|a| a.candidate.is_same_as(&of.candidate));
        let is_same = shown.added.len() == self.found.added.len()
            && shown.added.iter().all(is_found)
            && shown.found.rig.numerics == self.found.found.rig.numerics;
        is_same && !again.is_some_and(|again| self.is_behind(again))
    }

    /// True if recordings kept back speak for this answer against that of `other`.
    fn predicts_better_than(&self, other: &Self) -> bool {
        let context = &self.start.context;
        let (held_out, floors) = (context.held_out.as_deref(), &context.floors);
        let told = Confirmation::on_kept_back(self.found.explained(), other.found.explained(), held_out, floors);
        told.is_some_and(|told| told.bears_out(context))
    }

    /// True if `again` is clearly better than what was found.
    fn is_behind(&self, again: &FittedModel) -> bool {
        let context = &self.start.context;
        compare(again, &self.found.found, context).total > detection_threshold(context, 0)
    }
}

/// What an earlier search found.
#[derive(Default)]
struct Stood {
    /// Each effect alone on top of the base.
    each: Vec<CandidateFit>,
    /// All of them together, where the search goes on from these: that is better than what was found without, or gains no less.
    together: Option<Selection>,
}

/// What a walk on whole windows starts from, by what pieces of them show: base and numerics from the shortest (the numerics from longer ones
/// if these show none), and the effects that a search finds in the longest which the base follows: together where they are better there
/// than what was found, else each as a first one. No search where the base then leaves but noise, and no walk where they bear out the one
/// before. `closer`: [`Start::closer`] of `first`.
fn from_pieces(
    experiment: &Experiment,
    (first, walk): (Start, &OnWholeWindows),
    closer: &[FittedModel],
    said: &mut dyn FnMut(&str),
) -> Option<(Start, Stood)> {
    let shortest = first.in_pieces(closer.last()?, experiment, said)?;
    let numerics = first.base.rig.numerics;
    let mut start = first.with_own_effort();
    start.goes_on_from(&shortest, experiment, said);
    if start.leaves_noise() {
        return Some((start, Stood::default()));
    }
    let pieces = start.in_pieces(start.longest_followed(closer)?, experiment, said)?;
    let shown = searched(experiment, &pieces, Stood::default(), |_| false, said);
    let again = anew(&start.base.problem, &shown.found.rig, &start.context.floors);
    if walk.is_borne_out_by(&shown, again.as_ref()) {
        said("pieces of the recordings show the same");
        return None;
    }
    said("what pieces of the recordings show is fitted to the whole recordings");
    if start.base.rig.numerics == numerics {
        start.goes_on_from(&pieces, experiment, said);
    }
    let better = again.filter(|again| again.rig.numerics == start.base.rig.numerics && walk.is_behind(again));
    let stood = match better {
        Some(again) => Stood { together: Some(start.together_on_whole_windows(shown, again)), ..Stood::default() },
        None => Stood { each: start.each_on_whole_windows(&shown), together: None },
    };
    Some((start, stood))
}

/// The search on the windows of the rig; anew where a simulator's numerics stand for what was found. `stood`: as in [`searched`].
fn on_whole_windows(
    experiment: &Experiment,
    mut start: Start,
    stood: Stood,
    (options, said): (Options, &mut dyn FnMut(&str)),
) -> OnWholeWindows {
    let mut other = None;
    let shows_another = |found: &FittedModel| {
        other = start.base_shown_by(found);
        other.is_some()
    };
    let mut selection = searched(experiment, &start, stood, shows_another, said);
    let is_explained = !selection.added.is_empty();
    if let Some(base) = other.or_else(|| is_explained.then(|| start.base_shown_by(&selection.found))?) {
        start.computes_as(base, experiment, said);
        let each = start.each_alone(&selection);
        let together = start.stands_beside_numerics(&selection, &each);
        let stood = Stood { each: if together.is_some() { Vec::new() } else { each }, together };
        selection = searched(experiment, &start, stood, |_| false, said);
    }
    let (last, cut_short) = (selection.last.clone(), selection.cut_short);
    let found = finished(&start, selection, options.least_share, said);
    OnWholeWindows { start, found, last, cut_short }
}

/// Forward selection over the library. `stood`: what an earlier search found; `is_vain`: true of the fit with the first effect if the base is another one beside it.
fn searched(
    experiment: &Experiment,
    start: &Start,
    stood: Stood,
    mut is_vain: impl FnMut(&FittedModel) -> bool,
    said: &mut dyn FnMut(&str),
) -> Selection {
    let Start { base, context, .. } = start;
    let library = |now: &FittedModel| start.library(now);
    let also = start.other_place();
    let rig = computing_as(&experiment.rig, base);
    let Stood { each, together } = stood;
    let all = match together {
        Some(together) => forward_on(together, library, context, &mut *said),
        None => forward((&rig, base), (also.as_ref(), each.clone()), library, &mut is_vain, context, &mut *said),
    };
    // Slow noise beside what was found is misfit that was not sought.
    let is_open = all.added.is_empty() || leaves_slow_noise(&all.found);
    let strict = if is_open { without_slow_noise(&all.base, &all.last, context) } else { None };
    let Some(strict) = strict else { return all };
    said("what passed for noise is too slow for noise: the search begins again and explains it too");
    let stood = with_slow_noise_as_misfit([each, start.each_alone(&all)].concat(), context);
    let again = forward((&rig, &strict), (None, stood), library, &mut is_vain, context, said);
    unless_out_of_work(again, all)
}

/// The search made `again`, or the `first` one where that found something and there was no work left to ask anything again.
fn unless_out_of_work(again: Selection, first: Selection) -> Selection {
    let asked_nothing = again.cut_short && again.added.is_empty();
    if asked_nothing && !first.added.is_empty() { Selection { cut_short: true, ..first } } else { again }
}

/// `trials` of a search in which slow noise passed for noise, for one in which it does not.
fn with_slow_noise_as_misfit(trials: Vec<CandidateFit>, context: &Context) -> Vec<CandidateFit> {
    let one = |trial: CandidateFit| {
        let hypothesis = slow_noise_as_misfit(&trial.hypothesis, context)?;
        Some(CandidateFit { hypothesis, ..trial })
    };
    trials.into_iter().filter_map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::worked::{Shown, shown};
    use crate::identify::experiment::Recording;
    use crate::identify::synthesis::record;
    use crate::model::rig::Use;

    const RIG: &str = "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = { value = 0.011, min = 0.005, max = 0.02 }\n\
        gravity_nm = 0.4\n[[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.3\n\
        [[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\nnoise_std = 0.001\n[[recording]]\nfile = \"a.csv\"\nuse = \"fit\"\nwindow_s = 2.0\n";

    /// A pendulum that a constant torque turns, of which the rig knows nothing.
    fn turned() -> Experiment {
        let times: Vec<f64> = (0..600).map(|k| f64::from(k) * 0.01).collect();
        let inputs = vec![times.iter().map(|t| libm::sin(7.0 * t)).collect()];
        let blank = Recording { window_s: Some(2.0), ..Recording::new("a.csv", times, inputs, Vec::new()) };
        let truth = RIG.replace("value = 0.011", "value = 0.01")
            + "[[effect]]\neffect = \"torque_offset\"\nat = \"q1\"\ntorque = 0.05\n";
        let measured = record(&Rig::parse(&truth, "truth").unwrap(), &blank, &[0.3, 0.0], Some(1)).unwrap().measured;
        let recordings = vec![Recording { measured, ..blank }];
        Experiment { rig: Rig::parse(RIG, "rig.toml").unwrap(), recordings }
    }

    #[test]
    fn stages_are_told_for_people_and_the_rest_is_a_detail() {
        let mut told = Vec::new();
        Start::of(&turned(), 0, &mut |text| told.push(text.to_owned())).unwrap();
        let is_detail = |text: &&String| Note { after_s: 0.0, text }.is_detail();
        let stages: Vec<&String> = told.iter().filter(|text| !is_detail(text)).collect();
        assert!(stages.iter().any(|text| text.contains("(noise): y ") && text.ends_with(" rad")), "{stages:?}");
        assert!(stages.iter().all(|text| !text.contains("Colour")) && told.iter().any(|text| text.contains("Colour")));
    }

    #[test]
    fn a_walk_is_borne_out_by_the_same_effects_that_are_no_better() {
        let experiment = turned();
        let start = Start::of(&experiment, 0, &mut |_| {}).unwrap();
        let mut walk = on_whole_windows(&experiment, start, Stood::default(), (Options::default(), &mut |_| {}));
        assert_eq!(walk.found.added[0].candidate.effect, "torque_offset");
        let explains = |is_astray| Found { is_astray, ..walk.found.clone() }.explains(&walk.start.context);
        assert!(explains(false) && !explains(true), "sought beside what was taken out again");
        let Found { base, found, added, .. } = &walk.found;
        let (last, cut_short) = (Vec::new(), false);
        let shown = Selection { base: base.clone(), found: found.clone(), added: added.clone(), last, cut_short };
        let again = |walk: &OnWholeWindows| anew(&walk.found.found.problem, &shown.found.rig, &[1e-4]);
        assert!(walk.is_borne_out_by(&shown, again(&walk).as_ref()));
        // In a false minimum, which the numbers of the pieces lead out of.
        let mut astray = found.point.clone();
        astray.parameters[0] += 0.3;
        walk.found.found = FittedModel::at(found.problem.clone(), astray, found.information.clone(), &[1e-4]).unwrap();
        assert!(!walk.is_borne_out_by(&shown, again(&walk).as_ref()), "they are better");
        walk.found.found = shown.found.clone();
        walk.found.added.clear();
        assert!(!walk.is_borne_out_by(&shown, again(&walk).as_ref()), "another effect");
    }

    #[test]
    fn a_search_for_which_no_work_was_left_does_not_take_the_place_of_one_that_found_something() {
        let Shown { problem, .. } = shown("");
        let base = problem.fitted("", 1);
        let selection = |added: usize, cut_short: bool| {
            let added = vec![problem.added("torque_offset", "q1", 100.0, Vec::new()); added];
            Selection { base: base.clone(), found: base.clone(), added, last: Vec::new(), cut_short }
        };
        let stands = |again: Selection| {
            let stands = unless_out_of_work(again, selection(2, false));
            (stands.added.len(), stands.cut_short)
        };
        assert_eq!(stands(selection(0, true)), (2, true), "nothing was asked");
        assert_eq!(stands(selection(1, true)), (1, true));
        assert_eq!(stands(selection(0, false)), (0, false), "all was asked");
    }

    #[test]
    fn of_two_walks_the_one_stands_that_predicts_recordings_kept_back_better() {
        let times: Vec<f64> = (0..400).map(|k| f64::from(k) * 0.01).collect();
        let truth = RIG.replace("value = 0.011", "value = 0.01")
            + "[[effect]]\neffect = \"torque_offset\"\nat = \"q1\"\ntorque = 0.05\n";
        let recorded = |name: &str, usage: Use, rate: f64, seed: u64| {
            let inputs = vec![times.iter().map(|t| libm::sin(rate * t)).collect()];
            let blank =
                Recording { window_s: Some(2.0), usage, ..Recording::new(name, times.clone(), inputs, Vec::new()) };
            let measured =
                record(&Rig::parse(&truth, "truth").unwrap(), &blank, &[0.3, 0.0], Some(seed)).unwrap().measured;
            Recording { measured, ..blank }
        };
        let walk_of = |recordings: Vec<Recording>| {
            let experiment = Experiment { rig: Rig::parse(RIG, "rig.toml").unwrap(), recordings };
            let start = Start::of(&experiment, 0, &mut |_| {}).unwrap();
            on_whole_windows(&experiment, start, Stood::default(), (Options::default(), &mut |_| {}))
        };
        let (fitted, kept_back) = (recorded("a.csv", Use::Fit, 7.0, 1), recorded("b.csv", Use::Heldout, 9.0, 2));
        let walk = |recordings| {
            let right = walk_of(recordings);
            let mut nothing = right.clone();
            nothing.found.added.clear();
            (right, nothing)
        };
        let (right, nothing) = walk(vec![fitted.clone(), kept_back]);
        assert!(right.predicts_better_than(&nothing) && !nothing.predicts_better_than(&right));
        assert!(!right.predicts_better_than(&right), "as well");
        let (right, nothing) = walk(vec![fitted]);
        assert!(!right.predicts_better_than(&nothing), "nothing was kept back");
    }
}
