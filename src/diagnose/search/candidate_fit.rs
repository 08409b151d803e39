//! What the attribution works with: candidates that were fitted, effects that were added.
//!
//! RT: no.

use crate::diagnose::judge::criterion::Context;
use crate::diagnose::library::candidates::Candidate;
use crate::identify::fit::Limits;
use crate::identify::fitted_model::FittedModel;
use crate::model::effect::EffectKind;
use crate::model::rig::{Effect, Rig, Side, Value};

/// A search should end within this effort: some 30 s on two cores. Counted effort gives the same answer on any computer.
pub const MOST_EFFORT: u64 = 800_000_000;

/// A candidate, fitted.
#[derive(Clone, Debug)]
pub struct CandidateFit {
    /// What was added.
    pub candidate: Candidate,
    /// Where that led.
    pub hypothesis: FittedModel,
    /// Gain of twice the log-likelihood over what it was added to, under the noise that the best of its round leaves.
    pub gain: f64,
}

/// An effect that was added, with the other candidates of its round.
#[derive(Clone, Debug)]
pub struct SelectedEffect {
    /// What was added.
    pub candidate: Candidate,
    /// The others that were fitted in its round, best first.
    pub others: Vec<CandidateFit>,
    /// Gain over the model before it.
    pub gain: f64,
    /// Part of the misfit energy that it removed.
    pub removed: f64,
}

/// `rig` with `candidate` added at `values`.
#[must_use]
pub fn with_effect(rig: &Rig, candidate: &Candidate, values: &[f64]) -> Rig {
    let mut out = rig.clone();
    let Some(kind) = EffectKind::from_id(candidate.effect) else { return out };
    let value =
        |name: &str| {
            let found = candidate.keys.iter().zip(values).find(|(k, _)| k.name == name);
            found.map_or(Value::known(0.0), |(k, v)| {
                if k.max > k.min { Value::free(*v, k.min, k.max) } else { Value::known(*v) }
            })
        };
    let values = kind.keys().iter().map(|k| value(k.name)).collect();
    let mut effect = Effect::new(kind, &candidate.at, values);
    effect.recordings = candidate.only.iter().cloned().collect();
    effect.side = candidate.side;
    out.effects.push(effect);
    for sensor in out.sensors.iter_mut().filter(|s| candidate.motor_sensor.as_ref() == Some(&s.column)) {
        sensor.side = Side::Motor;
    }
    out
}

/// Of a fit without what it had before.
pub const REFIT: Limits = Limits { iterations: 10, tolerance: 1e-5 };

/// `found` without its effect number `e`, everything else fitted again.
#[must_use]
pub fn refit_without(found: &FittedModel, e: usize, context: &Context) -> Option<FittedModel> {
    let mut rig = found.rig.clone();
    rig.effects.remove(e);
    let (problem, point) = found.extended(rig);
    FittedModel::fitted(problem, point, &found.noise, &context.floors, REFIT)
}

/// For tests: a pendulum shaken for 2 s that hides something, and fits of what may stand for it.
#[cfg(test)]
pub(crate) mod worked {
    use super::{CandidateFit, SelectedEffect};
    use crate::diagnose::judge::criterion::Context;
    use crate::diagnose::judge::evidence::Ledger;
    use crate::diagnose::library::candidates::Candidate;
    use crate::identify::fit::Limits;
    use crate::identify::fitted_model::FittedModel;
    use crate::identify::noise::Colour;
    use crate::identify::problem::Problem;
    use crate::identify::synthesis::record;
    use crate::model::rig::{Rig, Side};

    const RIG: &str = "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = 0.01\ngravity_nm = 0.4\n\
        [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.3\n[[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\nnoise_std = 0.001\n\
        [[effect]]\neffect = \"viscous_friction\"\nat = \"q1\"\nviscous = { value = 0.02, min = 0.0, max = 0.2 }\n";

    /// What is worked on.
    pub(crate) struct Shown {
        pub context: Context,
        pub problem: Hidden,
    }

    /// Samples of a machine that hides something.
    pub(crate) struct Hidden(Vec<f64>);

    /// The samples of a machine with `hidden` effects, noise of a milliradian on top.
    pub(crate) fn shown(hidden: &str) -> Shown {
        let blank = Problem::shaken(RIG, None, vec![0.0; 200]).recordings[0].clone();
        let truth = Rig::parse(&format!("{RIG}{hidden}"), "truth").unwrap();
        let measured = record(&truth, &blank, &[0.3, 0.0], Some(7)).unwrap().measured.swap_remove(0);
        let context = Context {
            floors: vec![1e-5],
            samples: 200,
            given: 1,
            is_trapped: false,
            seed: 1,
            ledger: Ledger::default(),
            held_out: None,
        };
        Shown { context, problem: Hidden(measured) }
    }

    impl Hidden {
        /// The machine with `effects` beside its own, fitted for so many steps.
        pub(crate) fn fitted(&self, effects: &str, iterations: usize, context: &Context) -> FittedModel {
            let problem = Problem::shaken(&format!("{RIG}{effects}"), None, self.0.clone());
            let (start, limits) = (problem.start(), Limits { iterations, tolerance: 1e-7 });
            FittedModel::fitted(problem, start, &[Colour::white(0.001)], &context.floors, limits).unwrap()
        }

        pub(crate) fn candidate(&self, effect: &'static str, at: &str) -> Candidate {
            let (keys, starts) = (Vec::new(), Vec::new());
            Candidate { effect, at: at.into(), keys, starts, only: None, motor_sensor: None, side: Side::Link }
        }

        pub(crate) fn trial(
            &self,
            effect: &'static str,
            at: &str,
            text: &str,
            iterations: usize,
            gain: f64,
            context: &Context,
        ) -> CandidateFit {
            CandidateFit {
                candidate: self.candidate(effect, at),
                hypothesis: self.fitted(text, iterations, context),
                gain,
            }
        }

        pub(crate) fn added(
            &self,
            effect: &'static str,
            at: &str,
            gain: f64,
            others: Vec<CandidateFit>,
        ) -> SelectedEffect {
            SelectedEffect { candidate: self.candidate(effect, at), others, gain, removed: 0.5 }
        }
    }
}
