//! What the stages found, as the answer that a person reads.
//!
//! RT: no.

use super::start::{Start, numerics_told};
use crate::diagnose::explain::answer_sets::answer_sets;
use crate::diagnose::explain::headline::{costs, headline};
use crate::diagnose::explain::laws;
use crate::diagnose::explain::localise::places;
use crate::diagnose::explain::tables::{parameter_lines, ranking};
use crate::diagnose::input_checks::{at_bounds, suspicions};
use crate::diagnose::judge::confirmation::is_contradicted;
use crate::diagnose::judge::criterion::{Context, explained_part, explains_most};
use crate::diagnose::judge::estimates::undetermined_combinations;
use crate::diagnose::judge::rejected::rejected;
use crate::diagnose::judge::verdict::{
    Diagnosis, Findings, Law, Missing, Seen, Trace, Verdict, may_have_missed, verdict_of,
};
use crate::diagnose::library::candidate_fit::{CandidateFit, SelectedEffect};
use crate::diagnose::nameless::residual_force::Unlisted;
use crate::diagnose::sentence;
use crate::identify::base_fit::follows;
use crate::identify::experiment::Experiment;
use crate::identify::fitted_model::FittedModel;
use crate::identify::floor::complaints;
use crate::identify::likelihood::is_misfit;
use crate::identify::rollout::RolloutError;
use crate::identify::validation::{Models, proof};
use crate::model::rig::Rig;

/// What to say of a search that ended early.
const CUT_SHORT: &str = "the search for further effects ended at its limit of work: more may be missing than is named; \
                         shorter or fewer recordings let it go on";

/// What the stages found.
#[derive(Clone)]
pub(super) struct Found {
    pub(super) base: FittedModel,
    pub(super) found: FittedModel,
    pub(super) added: Vec<SelectedEffect>,
    pub(super) seen: Vec<Seen>,
    /// True if what stays was sought beside something that was taken out again ([`crate::diagnose::explain::interest::Kept`]).
    pub(super) is_astray: bool,
    pub(super) rest: Option<Unlisted>,
    pub(super) refit_needed: bool,
}

impl Found {
    fn is_unlisted(&self) -> bool {
        self.rest.is_some()
    }

    /// True if effects were found that remove the greater part of the misfit, and were not sought beside one that did and was taken out
    /// again.
    pub(super) fn explains(&self, context: &Context) -> bool {
        !self.added.is_empty() && !self.is_astray && explains_most(&self.base, &self.found, context)
    }

    /// True if effects were found that leave nothing without a name, which recordings kept back do not contradict, and with which the
    /// simulation misses by noise alone, or follows and they explain most of the misfit.
    pub(super) fn holds(&self, start: &Start) -> bool {
        let context = &start.context;
        let is_followed = || follows(&self.found, &start.pooled, &context.floors) && self.explains(context);
        let leaves_noise = !is_misfit(&self.found.residuals, &context.floors);
        let is_named = !self.added.is_empty() && !self.is_unlisted();
        is_named && (leaves_noise || is_followed()) && !is_contradicted(&self.found, context)
    }

    /// What a person should know of the search and of the model that it came to.
    pub(super) fn warnings(&self, experiment: &Experiment, cut_short: bool, context: &Context) -> Vec<String> {
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
    pub(super) fn explained(&self) -> &FittedModel {
        if self.added.is_empty() { &self.base } else { &self.found }
    }

    /// The residual force that nothing explains, then the laws that were found.
    fn laws(&self, experiment: &Experiment, traces: &[Trace]) -> Vec<Law> {
        let mut out: Vec<Law> = self.rest.as_ref().map(|u| u.laws.clone()).unwrap_or_default();
        out.extend(laws::found(self.explained(), experiment.rig.effects.len(), traces));
        out
    }

    pub(super) fn model(&self, experiment: &Experiment) -> Rig {
        let keep_given = self.added.is_empty() && !self.refit_needed && !self.is_unlisted();
        if keep_given { experiment.rig.clone() } else { self.explained().rig.clone() }
    }

    pub(super) fn findings(
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
        let leaves_misfit = is_misfit(&explained.residuals, &context.floors);
        Ok(Findings {
            rig: experiment.rig.name.clone(),
            headline: headline(&diagnosis, &parameters, &costs(&experiment.rig, &traces), leaves_misfit),
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
