//! Samples in batches: each batch sees the tree as the last one left it, on all cores; what it found is put in by the order
//! of the samples. So the tree depends on the seed alone. RT: no.

use super::connect::{EFFORT, FINE, branches, plan};
use super::refuse::{is_impossible, is_lost};
use super::simulate::{Passed, run};
use super::{Ground, State, Terms, sample};
use crate::base::riccati::RiccatiError;
use crate::control::tables::model_hash;
use crate::control::tree::file::{BranchRow, Counts, FORMAT, TreeFile};
use crate::control::tree::{Place, Tree};
use crate::design::solve::Solution;
use crate::msg::Leg;
use rayon::prelude::*;

/// A tree on its way.
#[derive(Clone, Debug)]
pub struct Grower {
    ground: Ground,
    file: TreeFile,
    tree: Tree,
}

/// A tube to be cut down to a cost.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cut {
    branch: u32,
    node: u32,
    level: f64,
}

/// What became of a sample, on the tree of its batch.
struct Seen {
    fate: Fate,
    cuts: Vec<Cut>,
    solves: u64,
}

enum Fate {
    Balanced,
    Covered,
    Refused,
    Impossible,
    Infeasible,
    Full,
    /// A motion, from the state as it falls forward.
    Planned(Box<Solution>),
}

/// Ways of the tree that are tried for a state.
const TRIES: usize = 2;
/// A tube is cut down to a little below where it failed.
const BELOW: f64 = 0.98;
/// A tube is cut down to this at least: below, rounding would decide who is in it.
const LEAST_LEVEL: f32 = 1e-9;
/// Least and most samples of a batch.
const BATCH: [u64; 2] = [32, 2048];
/// First guess of the time to a touchdown, s.
const FIRST_S: f64 = 0.35;

impl Grower {
    /// Nothing but the two basins of balance.
    ///
    /// # Errors
    /// [`RiccatiError`] when the robot cannot be balanced.
    pub fn new(terms: &Terms, command: &str) -> Result<Self, RiccatiError> {
        let ground = Ground::new(terms)?;
        let goal = [Leg::Inner, Leg::Outer].map(|leg| super::connect::upper(ground.balance_cost(leg)));
        let file = TreeFile {
            format: FORMAT.to_owned(),
            command: command.to_owned(),
            model_hash: model_hash(&terms.robot),
            terms: terms.text(),
            seed: terms.seed,
            hip_torque_nm: terms.hip_torque_nm,
            goal,
            goal_level: terms.goal_level,
            counts: Counts::default(),
            branches: Vec::new(),
        };
        Ok(Self { tree: Tree::new(&file), ground, file })
    }

    /// Goes on with a file, which must have been grown on the same terms.
    ///
    /// # Errors
    /// [`RiccatiError`] when the robot cannot be balanced.
    pub fn resume(terms: &Terms, file: TreeFile) -> Result<Self, RiccatiError> {
        Ok(Self { tree: Tree::new(&file), ground: Ground::new(terms)?, file })
    }

    /// The tree as a file.
    #[must_use]
    pub const fn file(&self) -> &TreeFile {
        &self.file
    }

    /// The tree.
    #[must_use]
    pub const fn tree(&self) -> &Tree {
        &self.tree
    }

    /// The robot.
    #[must_use]
    pub const fn ground(&self) -> &Ground {
        &self.ground
    }

    /// The next batch, whole: a growth that stopped within one could not go on as if it had not.
    pub fn batch(&mut self) {
        let done = self.file.counts.samples;
        let end = batch_end(done);
        let seed = self.ground.terms.seed;
        let (ground, tree) = (&self.ground, &self.tree);
        let seen: Vec<Seen> = (done..end).into_par_iter().map(|k| look(ground, tree, sample(seed, k))).collect();
        for (k, seen) in (done..).zip(seen) {
            self.take(sample(seed, k), seen);
        }
        self.file.counts.samples = end;
        self.refresh();
    }

    fn refresh(&mut self) {
        self.tree = Tree::new(&self.file);
    }

    fn take(&mut self, from: (State, Leg), seen: Seen) {
        self.file.counts.solves += seen.solves;
        for cut in &seen.cuts {
            self.cut(cut);
        }
        let counts = &mut self.file.counts;
        match seen.fate {
            Fate::Balanced => {
                counts.balanced += 1;
                counts.covered += 1;
            }
            Fate::Covered => counts.covered += 1,
            Fate::Refused => counts.refused += 1,
            Fate::Impossible => counts.impossible += 1,
            Fate::Infeasible => counts.infeasible += 1,
            Fate::Full => counts.full += 1,
            Fate::Planned(solution) => self.grow(from, &solution),
        }
    }

    fn cut(&mut self, cut: &Cut) {
        let row = self.file.branches.get_mut(cut.branch as usize).and_then(|b| b.nodes.get_mut(cut.node as usize));
        if let Some([.., level]) = row {
            #[expect(clippy::cast_possible_truncation, reason = "single precision is the format")]
            let to = (cut.level as f32).max(LEAST_LEVEL);
            if to < *level {
                *level = to;
                self.file.counts.cuts += 1;
            }
        }
    }

    /// Adds the branches of a motion, unless an earlier one of the same batch serves already, or its feedback fails.
    fn grow(&mut self, from: (State, Leg), solution: &Solution) {
        if try_ways(&self.ground, &self.tree, from, 1).is_ok() {
            self.file.counts.covered += 1;
            return;
        }
        let from = forward(&self.ground, from);
        let first = self.file.branches.len();
        let rows = branches(&self.ground, &self.tree, solution, first);
        if rows.is_some_and(|rows| self.holds(from, first, rows)) {
            self.file.counts.grown += 1;
        } else {
            self.file.counts.unstable += 1;
        }
    }

    /// Keeps the branches if the law brings their first state upright on them.
    fn holds(&mut self, from: (State, Leg), first: usize, rows: Vec<BranchRow>) -> bool {
        let ready: Vec<_> = rows.iter().map(BranchRow::branch).collect();
        self.file.branches.extend(rows);
        self.tree.extend(ready);
        #[expect(clippy::cast_possible_truncation, reason = "fewer than 4 billion")]
        let place = Place { branch: first as u32, mirrored: false, at_s: 0.0 };
        let held = run(&self.ground, &self.tree, from, Some(place), &mut Vec::new()).upright;
        if !held {
            self.file.branches.truncate(first);
            self.refresh();
        }
        held
    }
}

/// Samples at the end of the batch that comes after so many. An older file may have stopped within a batch: its next one
/// ends where that would have.
fn batch_end(done: u64) -> u64 {
    let mut end = 0_u64;
    while end <= done {
        end += (end / 8).clamp(BATCH[0], BATCH[1]);
    }
    end
}

/// The state as the robot falls forward.
fn forward(ground: &Ground, (x, stance): (State, Leg)) -> (State, Leg) {
    (if ground.fall(&x, stance) > 0.0 { x.map(|x| -x) } else { x }, stance)
}

/// The best ways of the tree: upright (and whether at once), or what is to be cut.
fn try_ways(ground: &Ground, tree: &Tree, (x, stance): (State, Leg), tries: usize) -> Result<bool, Vec<Cut>> {
    if tree.goal_share(&x, stance) <= 1.0 {
        return Ok(true);
    }
    let mut cuts = Vec::new();
    let mut passed = Vec::new();
    for found in tree.scan(stance).nearest(&x, tries) {
        let at_s = f64::from(found.node) * tree.branches[found.branch as usize].spacing_s();
        let place = Place { branch: found.branch, mirrored: found.mirrored, at_s };
        passed.clear();
        if run(ground, tree, (x, stance), Some(place), &mut passed).upright {
            return Ok(false);
        }
        cuts.extend(passed.iter().filter_map(|passed| cut(tree, passed)));
    }
    Err(cuts)
}

fn cut(tree: &Tree, passed: &Passed) -> Option<Cut> {
    let node = tree.branches.get(passed.branch as usize)?.nodes.get(passed.node as usize)?;
    let Passed { branch, node: number, cost } = *passed;
    (cost < node.level).then_some(Cut { branch, node: number, level: BELOW * cost })
}

fn look(ground: &Ground, tree: &Tree, from: (State, Leg)) -> Seen {
    if is_impossible(ground, &from.0) {
        return Seen { fate: Fate::Impossible, cuts: Vec::new(), solves: 0 };
    }
    let cuts = match try_ways(ground, tree, from, TRIES) {
        Ok(at_once) => {
            let fate = if at_once { Fate::Balanced } else { Fate::Covered };
            return Seen { fate, cuts: Vec::new(), solves: 0 };
        }
        Err(cuts) => cuts,
    };
    let (x, stance) = forward(ground, from);
    if is_lost(ground, &x, stance) {
        return Seen { fate: Fate::Refused, cuts, solves: 0 };
    }
    if tree.nodes() >= ground.terms.most_nodes {
        return Seen { fate: Fate::Full, cuts, solves: 0 };
    }
    let (solution, mut solves) = plan(ground, &x, stance, EFFORT, FIRST_S);
    let Some(coarse) = solution else { return Seen { fate: Fate::Infeasible, cuts, solves } };
    solves += 1;
    let fine = crate::design::solve::plan_from(&coarse.problem, &coarse.trajectory, FINE).unwrap_or(coarse);
    Seen { fate: Fate::Planned(Box::new(fine)), cuts, solves }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batches_end_at_the_same_samples_wherever_a_growth_stopped() {
        let ends = |from: u64| std::iter::successors(Some(batch_end(from)), |end| Some(batch_end(*end)));
        let all: Vec<u64> = ends(0).take(60).collect();
        assert_eq!(all[..3], [32, 64, 96]);
        for stop in [0, 20, 32, 50, 333, 8000] {
            let next = all.iter().position(|end| *end > stop).unwrap();
            assert!(ends(stop).take(5).eq(all[next..next + 5].iter().copied()), "{stop}");
        }
    }
}
