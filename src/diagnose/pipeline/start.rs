//! What a search starts from: the base, fitted out of false minima and with the numerics that the recordings show.
//!
//! RT: no.

use crate::diagnose::base_model::{DiagnoseError, again, ready, runaway};
use crate::diagnose::input_checks::at_bounds;
use crate::diagnose::judge::criterion::{Context, compare, detection_threshold};
use crate::diagnose::judge::estimates::estimates;
use crate::diagnose::judge::evidence::Ledger;
use crate::diagnose::library::candidate_fit::{CandidateFit, SelectedEffect};
use crate::diagnose::library::candidates::Candidate;
use crate::diagnose::library::initial_guesses::candidates;
use crate::diagnose::robustness::held_out::HeldOut;
use crate::diagnose::screen::linearise::ltv_windows;
use crate::diagnose::screen::scales::scales;
use crate::diagnose::screen::score_test::ScoreTest;
use crate::diagnose::search::exchange::in_its_place;
use crate::diagnose::search::numerics::{stepped_from_given, to_its_end, with_likeliest_numerics, with_numerics};
use crate::diagnose::search::stepwise::Selection;
use crate::identify::base_fit::{anew, as_given, fitted, follows, lands_elsewhere};
use crate::identify::experiment::{Experiment, Recording};
use crate::identify::fit::Limits;
use crate::identify::fitted_model::FittedModel;
use crate::identify::horizon::within_horizon;
use crate::identify::likelihood::{is_misfit, samples, white};
use crate::identify::noise::Colour;
use crate::identify::outliers::drop_spikes;
use crate::identify::rollout::Pooled;
use crate::model::rig::{Numerics, Rig};
use crate::report::interval::with_unit;
use crate::report::table::number;
use nalgebra::DMatrix;
use std::sync::Arc;

/// What to say of numbers as given that no run survives.
pub(super) const RUNS_AWAY: &str =
    "with the numbers as given the simulation runs away; perhaps no rigid body has such masses and inertias";

/// What a search starts from.
#[derive(Clone)]
pub(super) struct Start {
    pub(super) pooled: Pooled,
    /// Samples that were left out.
    pub(super) dropped: usize,
    /// With the numbers as given; none where it runs away with them.
    pub(super) given: Option<FittedModel>,
    pub(super) base: FittedModel,
    /// The two with the numerics of the rig, where others are taken.
    pub(super) own: Option<(Option<FittedModel>, FittedModel)>,
    pub(super) context: Context,
}

impl Start {
    pub(super) fn of(experiment: &Experiment, seed: u64, said: &mut dyn FnMut(&str)) -> Result<Self, DiagnoseError> {
        let (recordings, pooled, floors) = ready(experiment)?;
        said("fitting the parameters of the simulation");
        let first =
            fitted(&experiment.rig, &recordings, &pooled, &floors).ok_or_else(|| runaway(experiment, &pooled))?;
        Self::after(first, (recordings, pooled, floors), (experiment, seed), said)
    }

    /// Fits of the base over pieces of the windows, longer ones first, where it leaves more than noise ([`within_horizon`]); nothing elsewhere.
    /// `only_chaotic`: nor where motion is not chaotic.
    pub(super) fn closer(&self, experiment: &Experiment, only_chaotic: bool) -> Vec<FittedModel> {
        within_horizon(&experiment.rig, &self.base, only_chaotic, (&self.pooled, &self.context.floors))
    }

    /// The same on the pieces of `closer`.
    pub(super) fn in_pieces(
        &self,
        closer: &FittedModel,
        experiment: &Experiment,
        said: &mut dyn FnMut(&str),
    ) -> Option<Self> {
        let (floors, seed) = (self.context.floors.clone(), self.context.seed);
        said(&format!(
            "the simulation does not follow whole recordings: {} pieces of them are looked at",
            closer.problem.windows.len()
        ));
        let recordings = closer.problem.recordings.to_vec();
        let mut start =
            Self::after(closer.clone(), (recordings, self.pooled.clone(), floors), (experiment, seed), said).ok()?;
        // What was kept back is asked on whole windows; what is compared on pieces stands in the same list.
        start.context.held_out = None;
        start.context.ledger = self.context.ledger.clone();
        Some(start)
    }

    /// Of fits over ever shorter pieces the first that follows, or the shortest.
    pub(super) fn longest_followed<'c>(&self, closer: &'c [FittedModel]) -> Option<&'c FittedModel> {
        let follows = |of: &&FittedModel| follows(of, &self.pooled, &self.context.floors);
        closer.iter().find(follows).or_else(|| closer.last())
    }

    /// The numbers as given, if a first effect is to be sought from there too: the base is no fair start at its bounds, nor where feet land
    /// elsewhere.
    pub(super) fn other_place(&self) -> Option<FittedModel> {
        let Self { given, base, context, .. } = self;
        let is_asked = context.is_trapped || lands_elsewhere(base, &context.floors);
        given.as_ref().filter(|_| is_asked).map(|given| given.counted_with(base))
    }

    /// The same, its work counted anew.
    pub(super) fn with_own_effort(mut self) -> Self {
        for of in self.given.iter_mut().chain([&mut self.base]) {
            of.problem = of.problem.clone().with_allowance(u64::MAX);
        }
        self
    }

    /// From the first fit on.
    fn after(
        first: FittedModel,
        (mut recordings, pooled, floors): (Vec<Recording>, Pooled, Vec<f64>),
        (experiment, seed): (&Experiment, u64),
        said: &mut dyn FnMut(&str),
    ) -> Result<Self, DiagnoseError> {
        let dropped: usize = drop_spikes(&mut recordings, &first).iter().sum();
        let given = as_given(&experiment.rig, &recordings, &pooled, &floors);
        let base = again(&first, &recordings, &floors).ok_or(DiagnoseError::Diverges)?;
        let base = if let Some(given) = &given { no_worse(base, given, &floors) } else { base };
        let context = Context {
            samples: samples(&base.residuals, &floors),
            given: experiment.rig.effects.len(),
            is_trapped: is_trapped(&base, experiment),
            floors,
            seed,
            ledger: Ledger::default(),
            held_out: HeldOut::of(experiment, &base.rig).map(Arc::new),
        };
        tell(&base, said);
        let mut start = Self { pooled, dropped, given, base, own: None, context };
        let stepped = || stepped_from_given(&experiment.rig, &start.base, &start.context);
        if let Some(base) = with_likeliest_numerics(&start.base, &start.context).or_else(stepped) {
            start.computes_as(base, experiment, said);
        }
        Ok(start)
    }

    /// What may be missing on top of `now`.
    pub(super) fn library(&self, now: &FittedModel) -> Vec<Candidate> {
        let Some(windows) = ltv_windows(now) else { return Vec::new() };
        let scales = scales(now, &windows, &self.pooled);
        let screen = |noise: &[Colour]| ScoreTest::new(&now.problem, &now.point, noise);
        let (Some(fine), Some(coarse)) = (screen(&now.noise), screen(&white(&now.residuals, &self.context.floors)))
        else {
            return Vec::new();
        };
        candidates(now, &scales, [&fine, &coarse], &windows)
    }

    /// The base with other numerics, if `found` shows them: the effects that were found beside it may have stood for these. That with the rig's own
    /// too, if others gain no more than chance beside what was found: they may have stood for what is missing.
    pub(super) fn base_shown_by(&self, found: &FittedModel) -> Option<FittedModel> {
        match with_likeliest_numerics(found, &self.context) {
            Some(shown) => with_numerics(&self.base, shown.rig.numerics, &self.context),
            None => self.own_base_shown_by(found),
        }
    }

    fn own_base_shown_by(&self, found: &FittedModel) -> Option<FittedModel> {
        let (_, own) = self.own.as_ref()?;
        let plain = with_numerics(found, own.rig.numerics, &self.context)?;
        let ahead = compare(found, &plain, &self.context).total;
        (ahead <= detection_threshold(&self.context, 1)).then(|| own.counted_with(&self.base))
    }

    /// Each effect of `selection`, which was found with other numerics, alone on top of the base: what a search has found the next one
    /// need not find again.
    pub(super) fn each_alone(&self, selection: &Selection) -> Vec<CandidateFit> {
        let found = &selection.found;
        self.each_fitted(selection, |rig| {
            let (problem, point) = found.extended(rig);
            to_its_end(found, problem, point, &self.context)
        })
    }

    /// The one effect of `selection`, which was found with other numerics, as `each` has it, with its rivals, if it gains no less on top of
    /// the base now: it did not stand for the numerics.
    pub(super) fn stands_beside_numerics(&self, selection: &Selection, each: &[CandidateFit]) -> Option<Selection> {
        let ([added], [again]) = (&selection.added[..], each) else { return None };
        let gain = compare(&again.hypothesis, &self.base, &self.context).total;
        let stands = || Selection { added: vec![SelectedEffect { gain, ..added.clone() }], ..selection.clone() };
        (gain >= added.gain).then(|| self.together_on_whole_windows(stands(), again.hypothesis.clone()))
    }

    /// Each effect of `selection`, which was found in pieces of the windows, alone on the whole ones, from its numbers there.
    pub(super) fn each_on_whole_windows(&self, selection: &Selection) -> Vec<CandidateFit> {
        self.each_fitted(selection, |rig| anew(&self.base.problem, &rig, &self.context.floors))
    }

    /// The effects of `selection`, which was found in pieces of the windows or with other numerics, together on top of the base, as `found`
    /// stands there, each with its rivals in its place.
    pub(super) fn together_on_whole_windows(&self, selection: Selection, found: FittedModel) -> Selection {
        let (floors, given) = (&self.context.floors, self.context.given);
        let carried = |trial: &CandidateFit, e: usize| {
            let (problem, point) = found.extended(in_its_place(&found.rig, trial, e)?);
            let n = point.parameters.len();
            let hypothesis = FittedModel::at(problem, point, DMatrix::zeros(n, n), floors)?;
            Some(CandidateFit { hypothesis, ..trial.clone() })
        };
        let one = |(i, added): (usize, SelectedEffect)| {
            let others = added.others.iter().filter_map(|trial| carried(trial, given + i)).collect();
            SelectedEffect { others, ..added }
        };
        let added = selection.added.into_iter().enumerate().map(one).collect();
        Selection { base: self.base.clone(), found, added, last: Vec::new(), cut_short: false }
    }

    /// Each effect of `selection` alone, as `fit` fits the rig with it.
    fn each_fitted(&self, selection: &Selection, fit: impl Fn(Rig) -> Option<FittedModel>) -> Vec<CandidateFit> {
        let (found, given) = (&selection.found, self.context.given);
        let alone = |(i, added): (usize, &SelectedEffect)| {
            let mut rig = Rig { numerics: self.base.rig.numerics, ..found.rig.clone() };
            let own = rig.effects.get(given + i)?.clone();
            rig.effects.truncate(given);
            rig.effects.push(own);
            Some(CandidateFit { candidate: added.candidate.clone(), hypothesis: fit(rig)?, gain: 0.0 })
        };
        selection.added.iter().enumerate().filter_map(alone).collect()
    }

    /// From the base of `pieces`, with the numerics of a simulator that they show: fitted anew on whole windows. It stays as it is where
    /// the numerics are the same and it is the likelier one.
    pub(super) fn goes_on_from(&mut self, pieces: &Self, experiment: &Experiment, said: &mut dyn FnMut(&str)) {
        let Some(base) = anew(&self.base.problem, &pieces.base.rig, &self.context.floors) else { return };
        if base.rig.numerics != self.base.rig.numerics {
            self.computes_as(base, experiment, said);
        } else if base.likelihood > self.base.likelihood {
            self.base = base;
        }
    }

    /// True if the base alone leaves but noise.
    pub(super) fn leaves_noise(&self) -> bool {
        !is_misfit(&self.base.residuals, &self.context.floors)
    }

    /// From `base`, which is fitted with other numerics.
    pub(super) fn computes_as(&mut self, base: FittedModel, experiment: &Experiment, said: &mut dyn FnMut(&str)) {
        said(&numerics_told(base.rig.numerics));
        let rig = computing_as(&experiment.rig, &base);
        if base.rig.numerics == experiment.rig.numerics {
            self.own = None;
        } else if self.base.rig.numerics == experiment.rig.numerics {
            self.own = Some((self.given.clone(), self.base.clone()));
        }
        self.given = as_given(&rig, &base.problem.recordings, &self.pooled, &self.context.floors);
        self.base = base;
    }
}

/// Says what the fit of the base came to: the noise that it leaves, and its numbers.
fn tell(base: &FittedModel, said: &mut dyn FnMut(&str)) {
    let rig = &base.rig;
    let weighed =
        rig.sensors.iter().zip(&base.noise).filter(|(_, colour)| colour.sigma > 0.0 && colour.sigma.is_finite());
    let noise: Vec<String> = weighed
        .map(|(sensor, colour)| {
            format!("{} {}", sensor.column, with_unit(&number(colour.sigma), sensor.unit(rig.mechanism)))
        })
        .collect();
    said(&format!("left from one sample to the next (noise): {}", noise.join(", ")));
    said(&format!("   {:.3?}", base.noise));
    for (name, of) in estimates(base) {
        said(&format!("   {name} {:.4}", of.value));
    }
}

/// True if the fit of the base ended at bounds: a number that made up for what is missing as far as it could. One step of a
/// candidate then does not move it back, and promises nothing.
fn is_trapped(base: &FittedModel, experiment: &Experiment) -> bool {
    !at_bounds(&base.clone().with_intervals(), &experiment.rig).is_empty()
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

/// `rig` with the numerics of `of`.
pub(super) fn computing_as(rig: &Rig, of: &FittedModel) -> Rig {
    Rig { numerics: of.rig.numerics, ..rig.clone() }
}

/// What a simulator did to the recordings.
pub(super) fn numerics_told(numerics: Numerics) -> String {
    let Numerics { euler_step_s, smooth_rate, soft_friction_s } = numerics;
    let steps = euler_step_s.map(|s| format!("steps by {:.3} ms (semi-implicit Euler)", 1e3 * s));
    let sign = smooth_rate.map(|r| format!("gives friction a smooth sign (tanh of the rate over {r})"));
    let soft = soft_friction_s.map(|s| format!("makes friction a soft constraint of {:.0} ms", 1e3 * s));
    let what: Vec<String> = steps.into_iter().chain(sign).chain(soft).collect();
    if what.is_empty() {
        return "the recordings agree best with an exact integration".to_owned();
    }
    let what = what.join(" and ");
    format!("the recordings agree best with a simulator that {what}; that is no missing physics and is taken along")
}

#[cfg(test)]
mod tests {
    use super::super::stages::slow_noise_as_misfit;
    use super::*;
    use crate::diagnose::judge::numbers::LONGEST_MEMORY;
    use crate::identify::synthesis::record;
    use crate::model::effect::EffectKind;
    use crate::model::rig::{Bounds, Effect, Side, Value};

    /// Two links, the second on the first; `moment2` is free.
    fn links(inertia2: &str, moment2: f64) -> Rig {
        let text = format!(
            "schema = 1\nmechanism = \"double_pendulum\"\n[parameters]\ninertia1_kg_m2 = 0.012\ninertia2_kg_m2 = {inertia2}\n\
             moment1_kg_m = 0.07\nmoment2_kg_m = {{ value = {moment2}, min = 0.1, max = 0.5 }}\nmass2_kg = 1.1\n\
             length1_m = 0.25\ngravity_m_s2 = 9.81\n\
             [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 1.0\n\
             [[sensor]]\nmeasures = \"q1\"\ncolumn = \"q1_rad\"\nnoise_std = 0.001\n\
             [[sensor]]\nmeasures = \"q2\"\ncolumn = \"q2_rad\"\nnoise_std = 0.001\n\
             [[recording]]\nfile = \"a.csv\"\nuse = \"fit\"\n"
        );
        Rig::parse(&text, "rig.toml").unwrap()
    }

    /// What a search starts from where the recording is of `moment2` .22 and `inertia2` .055, and `given` is the rig.
    fn start(given: Rig) -> Start {
        let times: Vec<f64> = (0..150).map(|k| f64::from(k) * 0.01).collect();
        let inputs = vec![times.iter().map(|t| 0.3 * libm::sin(9.0 * t)).collect()];
        let mut recording = Recording::new("a.csv", times, inputs, Vec::new());
        recording.measured = record(&links("0.055", 0.22), &recording, &[0.2, -0.1], Some(1)).unwrap().measured;
        Start::of(&Experiment { rig: given, recordings: vec![recording] }, 0, &mut |_| {}).unwrap()
    }

    #[test]
    fn numbers_as_given_of_no_body_are_fitted_again_and_told() {
        // (length1 moment2)² is more than (inertia1 + mass2 length1²) inertia2: no mass matrix.
        let start = start(links("0.055", 0.28));
        assert!(start.given.is_none());
        let moment2 = estimates(&start.base)[0].1.value;
        assert!((moment2 / 0.22 - 1.0).abs() < 0.02, "{moment2}");
    }

    #[test]
    fn a_base_that_follows_is_not_searched_in_pieces() {
        let rig = links("0.055", 0.21);
        let start = start(rig.clone());
        let recordings = start.base.problem.recordings.to_vec();
        assert!(start.closer(&Experiment { rig, recordings }, false).is_empty());
    }

    #[test]
    fn where_all_numbers_times_a_factor_are_of_no_body_either_one_of_them_moves_alone() {
        let start = start(links("{ value = 0.042, min = 0.02, max = 0.1 }", 0.263));
        assert!(start.given.is_none());
        let found: Vec<f64> = estimates(&start.base).iter().map(|(_, of)| of.value).collect();
        let [inertia2, moment2] = found[..] else { panic!("{found:?}") };
        assert!((0.25 * moment2) * (0.25 * moment2) < (0.012 + 1.1 * 0.0625) * inertia2, "{found:?}");
    }

    /// A base for which a simulator's steps were taken, of a machine that an offset turns and that does not step.
    #[test]
    fn numerics_that_gain_no_more_than_chance_beside_what_was_found_are_none() {
        let rig = links("0.055", 0.22);
        let blank = start(rig.clone()).base.problem.recordings[0].clone();
        let offset = |bounds| Effect::new(EffectKind::TorqueOffset, "q2", vec![Value { value: 0.1, bounds }]);
        let of = |numerics: Numerics| {
            let truth = Rig { numerics, effects: vec![offset(None)], ..rig.clone() };
            let measured = record(&truth, &blank, &[0.2, -0.1], Some(1)).unwrap().measured;
            let experiment = Experiment { rig: rig.clone(), recordings: vec![Recording { measured, ..blank.clone() }] };
            let mut start = Start::of(&experiment, 0, &mut |_| {}).unwrap();
            let exact = with_numerics(&start.base, Numerics::default(), &start.context).unwrap();
            start.computes_as(exact, &experiment, &mut |_| {});
            let steps = Numerics { euler_step_s: Some(0.01), ..Numerics::default() };
            start.computes_as(with_numerics(&start.base, steps, &start.context).unwrap(), &experiment, &mut |_| {});
            let (problem, point) = start.base.extended(Rig {
                effects: vec![offset(Some(Bounds { min: -1.0, max: 1.0 }))],
                ..start.base.rig.clone()
            });
            let (noise, floors) = (start.base.noise.clone(), start.context.floors.clone());
            let found = FittedModel::fitted(problem, point, &noise, &floors, Limits::default()).unwrap();
            start.base_shown_by(&found).map(|base| base.rig.numerics)
        };
        assert_eq!(of(Numerics::default()), Some(Numerics::default()), "it does not step");
        assert_eq!(of(Numerics { euler_step_s: Some(0.01), ..Numerics::default() }), None, "it steps");
    }

    #[test]
    fn what_a_search_found_stands_alone_on_the_base_with_its_numerics() {
        let mut start = start(links("0.055", 0.21));
        let of = |kind, value: f64, most: f64| Effect::new(kind, "q1", vec![Value::free(value, -most, most)]);
        let mut rig = start.base.rig.clone();
        rig.effects = vec![of(EffectKind::QuadraticDrag, 1e-3, 0.1), of(EffectKind::TorqueOffset, 1e-3, 1.0)];
        let (problem, point) = start.base.extended(rig);
        let found =
            FittedModel::fitted(problem, point, &start.base.noise, &start.context.floors, Limits::default()).unwrap();
        let added = |effect: &'static str| {
            let candidate = Candidate {
                effect,
                at: "q1".into(),
                keys: Vec::new(),
                starts: Vec::new(),
                only: None,
                motor_sensor: None,
                side: Side::Link,
            };
            SelectedEffect { candidate, others: Vec::new(), gain: 100.0, removed: 0.5 }
        };
        let added = vec![added("quadratic_drag"), added("torque_offset")];
        let selection = Selection { base: start.base.clone(), found, added, last: Vec::new(), cut_short: false };
        start.base.rig.numerics.euler_step_s = Some(0.01);
        let alone = start.each_alone(&selection);
        assert_eq!(alone.len(), 2);
        let stands = |gain: f64| {
            let mut one = selection.clone();
            one.added.truncate(1);
            one.added[0].gain = gain;
            start.stands_beside_numerics(&one, &alone[..1])
        };
        let gained = compare(&alone[0].hypothesis, &start.base, &start.context).total;
        let together = stands(gained - 1.0).expect("it gains more");
        assert_eq!((together.added[0].gain, &together.found.rig), (gained, &alone[0].hypothesis.rig));
        assert!(stands(gained + 1.0).is_none(), "it gained more with the other numerics");
        assert!(start.stands_beside_numerics(&selection, &alone).is_none(), "two may stand for one another");
        let whole = start.each_on_whole_windows(&selection);
        assert_eq!(whole.len(), 2);
        let bias = CandidateFit { gain: 80.0, ..whole[1].clone() };
        let mut with_rival = selection.clone();
        with_rival.added[0].others = vec![bias];
        let together = start.together_on_whole_windows(with_rival, selection.found.clone());
        assert_eq!((together.added.len(), &together.found.rig), (2, &selection.found.rig));
        let [rival] = &together.added[0].others[..] else { panic!("its rival goes along") };
        let kinds: Vec<&str> = rival.hypothesis.rig.effects.iter().map(|e| e.kind.id()).collect();
        assert_eq!((kinds, rival.gain), (vec!["torque_offset", "torque_offset"], 80.0), "in the place of the drag");
        for trial in alone.iter().chain(&whole) {
            let [effect] = &trial.hypothesis.rig.effects[..] else { panic!("not alone") };
            assert_eq!(effect.kind.id(), trial.candidate.effect);
            assert_eq!(trial.hypothesis.rig.numerics, start.base.rig.numerics);
            let strict = slow_noise_as_misfit(&trial.hypothesis, &start.context).unwrap();
            assert_eq!((strict.problem.longest_memory, strict.point), (LONGEST_MEMORY, trial.hypothesis.point.clone()));
        }
    }
}
