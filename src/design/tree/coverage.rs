//! How much of what can be recovered the tree recovers: fresh states, against a planner that tries hard. RT: no.

use super::connect::plan;
use super::refuse::{is_impossible, is_lost};
use super::simulate::run;
use super::{Ground, State, sample};
use crate::control::tree::Tree;
use crate::design::solve::Effort;
use crate::msg::Leg;
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// What became of fresh states.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Coverage {
    /// States.
    pub states: u64,
    /// The tree's law brings them upright.
    pub recovered: u64,
    /// It does not, and the planner finds a way.
    pub missed: u64,
    /// Proven lost, or no state of the robot.
    pub lost: u64,
    /// Neither the tree nor the planner finds a way.
    pub open: u64,
}

impl Coverage {
    /// Share of the states with a known way that the tree recovers.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "thousands")]
    pub fn share(&self) -> f64 {
        self.recovered as f64 / (self.recovered + self.missed) as f64
    }
}

/// Knots per phase and first guesses that the planner goes through, again and again with other guesses of the time.
const EFFORTS: [usize; 4] = [8, 12, 16, 24];

/// Checks `count` states of another seed; the planner has `patience` for each that the tree misses.
#[must_use]
pub fn check(ground: &Ground, tree: &Tree, seed: u64, count: u64, patience: Duration) -> Coverage {
    let seen = (0..count).into_par_iter().map(|k| look(ground, tree, sample(seed, k), patience));
    seen.reduce(Coverage::default, |a, b| Coverage {
        states: a.states + b.states,
        recovered: a.recovered + b.recovered,
        missed: a.missed + b.missed,
        lost: a.lost + b.lost,
        open: a.open + b.open,
    })
}

fn look(ground: &Ground, tree: &Tree, (x, stance): (State, Leg), patience: Duration) -> Coverage {
    let mut out = Coverage { states: 1, ..Coverage::default() };
    if is_impossible(ground, &x) {
        out.lost = 1;
    } else if run(ground, tree, (x, stance), None, &mut Vec::new()).upright {
        out.recovered = 1;
    } else if is_lost(ground, &x, stance) {
        out.lost = 1;
    } else if has_way(ground, &x, stance, patience) {
        out.missed = 1;
    } else {
        out.open = 1;
    }
    out
}

/// The planner finds a way within its patience: finer and finer, from other and other guesses of the time to touchdown.
#[must_use]
pub fn has_way(ground: &Ground, x: &State, stance: Leg, patience: Duration) -> bool {
    let x = if ground.fall(x, stance) > 0.0 { x.map(|x| -x) } else { *x };
    let begin = Instant::now();
    for first_s in [0.35, 0.2, 0.5, 0.12, 0.7, 0.28, 0.42, 0.06, 0.9] {
        for coarse in EFFORTS {
            if plan(ground, &x, stance, Effort { coarse, fine: None }, first_s).0.is_some() {
                return true;
            }
            if begin.elapsed() > patience {
                return false;
            }
        }
    }
    false
}
