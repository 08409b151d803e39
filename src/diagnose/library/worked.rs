//! For tests: a pendulum shaken for 2 s that hides something, and fits of what may stand for it.
#![cfg(test)]

use crate::diagnose::library::candidate_fit::{CandidateFit, SelectedEffect};
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

/// Smallest standard deviation of the one channel.
pub(crate) const FLOORS: [f64; 1] = [1e-5];

/// Samples of a machine that hides something.
pub(crate) struct Hidden(Vec<f64>);

/// The samples of a machine with `hidden` effects, noise of a milliradian on top.
pub(crate) fn hiding(hidden: &str) -> Hidden {
    let blank = Problem::shaken(RIG, None, vec![0.0; 200]).recordings[0].clone();
    let truth = Rig::parse(&format!("{RIG}{hidden}"), "truth").unwrap();
    let measured = record(&truth, &blank, &[0.3, 0.0], Some(7)).unwrap().measured.swap_remove(0);
    Hidden(measured)
}

impl Hidden {
    /// The machine with `effects` beside its own, fitted for so many steps.
    pub(crate) fn fitted(&self, effects: &str, iterations: usize) -> FittedModel {
        let problem = Problem::shaken(&format!("{RIG}{effects}"), None, self.0.clone());
        let (start, limits) = (problem.start(), Limits { iterations, tolerance: 1e-7 });
        FittedModel::fitted(problem, start, &[Colour::white(0.001)], &FLOORS, limits).unwrap()
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
    ) -> CandidateFit {
        CandidateFit { candidate: self.candidate(effect, at), hypothesis: self.fitted(text, iterations), gain }
    }

    pub(crate) fn added(&self, effect: &'static str, at: &str, gain: f64, others: Vec<CandidateFit>) -> SelectedEffect {
        SelectedEffect { candidate: self.candidate(effect, at), others, gain, removed: 0.5 }
    }
}
