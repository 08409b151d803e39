//! For tests: what a judgement of [`library::worked`](crate::diagnose::library::worked) knows, and a fitted candidate of which only
//! what is asked matters.
#![cfg(test)]

use crate::diagnose::judge::criterion::Context;
use crate::diagnose::judge::evidence::Ledger;
use crate::diagnose::library::candidate_fit::CandidateFit;
use crate::diagnose::library::candidates::{Candidate, Key};
use crate::diagnose::library::worked::{FLOORS, Hidden, hiding};
use crate::identify::fitted_model::FittedModel;
use crate::identify::problem::Problem;
use crate::model::rig::Side;

const RIG: &str = "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = 0.01\ngravity_nm = 0.4\n\
    [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.3\n[[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\n";

/// What is worked on.
pub(crate) struct Shown {
    pub context: Context,
    pub problem: Hidden,
}

/// A machine with `hidden` effects, and what is known of the case.
pub(crate) fn shown(hidden: &str) -> Shown {
    let context = Context {
        floors: FLOORS.to_vec(),
        samples: 200,
        given: 1,
        is_trapped: false,
        seed: 1,
        ledger: Ledger::default(),
        held_out: None,
    };
    Shown { context, problem: hiding(hidden) }
}

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
