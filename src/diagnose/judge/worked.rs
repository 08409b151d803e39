//! For tests of the judge: a fitted candidate of which only what is asked matters.
#![cfg(test)]

use crate::diagnose::library::candidates::{Candidate, Key};
use crate::diagnose::search::candidate_fit::CandidateFit;
use crate::identify::fitted_model::FittedModel;
use crate::identify::problem::Problem;
use crate::model::rig::Side;

const RIG: &str = "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = 0.01\ngravity_nm = 0.4\n\
    [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.3\n[[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\n";

/// A candidate with so many free numbers that gains so much over a pendulum.
pub(crate) fn trial(effect: &'static str, numbers: usize, gain: f64) -> CandidateFit {
    let problem = Problem::shaken(RIG, None, vec![0.0; 200]);
    let start = problem.start();
    let hypothesis = FittedModel::at(problem, start, nalgebra::DMatrix::zeros(0, 0), &[1e-3]).unwrap();
    let key = Key { name: "x", min: 0.0, max: 1.0, log: false };
    let candidate = Candidate {
        effect,
        at: "q1".into(),
        keys: vec![key; numbers],
        starts: Vec::new(),
        only: None,
        motor_sensor: None,
        side: Side::Link,
    };
    CandidateFit { candidate, hypothesis, gain }
}
