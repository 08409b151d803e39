//! The tree as a file: what `compass plan tree` writes and a controller reads before arming. RT: no.
#![expect(clippy::disallowed_types, clippy::disallowed_macros, clippy::disallowed_methods, reason = "before arming")]

use super::{Branch, Node, Place};
use crate::control::tables::{PlanError, model_hash};
use crate::model::compass_gait::params::Params;
use crate::msg::Leg;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// First word of every tree file: format and version.
pub const FORMAT: &str = "compass-tree-1";

/// Numbers of a node: state, accelerations, torque, gain, upper triangle of S, level.
pub const COLUMNS: usize = 22;

/// A tree file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TreeFile {
    /// [`FORMAT`].
    pub format: String,
    /// The command that grew it.
    pub command: String,
    /// [`model_hash`] of the model that it holds for.
    pub model_hash: String,
    /// Everything that the growth depends on, as text: a file is gone on with only by the same.
    pub terms: String,
    /// Seed of the samples.
    pub seed: u64,
    /// Motor torque that it was grown with, Nm.
    pub hip_torque_nm: f64,
    /// Forms of balance, inner and outer leg: upper triangles.
    pub goal: [[f64; 10]; 2],
    /// Balance recovers from `x' S x` up to this.
    pub goal_level: f64,
    /// What became of the samples so far.
    pub counts: Counts,
    /// The branches.
    pub branches: Vec<BranchRow>,
}

/// What became of samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Counts {
    /// Samples drawn.
    pub samples: u64,
    /// Brought upright by the tree as it stood.
    pub covered: u64,
    /// Of these, in the basin of balance at once.
    pub balanced: u64,
    /// Refused without a solve: no torque within its limits leads upright or to a foothold (proven).
    pub refused: u64,
    /// No states of the robot: the swing foot in the floor, its toe drawn in.
    pub impossible: u64,
    /// The planner found no way.
    pub infeasible: u64,
    /// Led to a branch.
    pub grown: u64,
    /// A way was planned, but the feedback does not hold on it.
    pub unstable: u64,
    /// Uncovered, and not planned for because the tree is full.
    pub full: u64,
    /// Levels that were cut down.
    pub cuts: u64,
    /// Problems given to the planner.
    pub solves: u64,
}

/// One branch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BranchRow {
    /// The inner leg stands.
    pub inner_stands: bool,
    /// How long it is, s.
    pub duration_s: f32,
    /// It ends at a touchdown.
    pub touchdown: bool,
    /// Where it goes on; none: in the basin of balance.
    pub next: Option<Link>,
    /// Its nodes, [`COLUMNS`] numbers each. Single precision: seven digits of a plan that no robot follows to three.
    pub nodes: Vec<[f32; COLUMNS]>,
}

/// A place in another branch.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Link {
    /// Which.
    pub branch: u32,
    /// Its mirror image.
    pub mirrored: bool,
    /// When, s.
    pub at_s: f32,
}

impl TreeFile {
    /// Reads a tree for a model.
    ///
    /// # Errors
    /// [`PlanError`]: not readable, not a tree, or grown for another model.
    pub fn read(path: &Path, model: &Params<f64>) -> Result<Self, PlanError> {
        let file = path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|cause| PlanError::Read { file: file.clone(), cause })?;
        Self::parse(&file, &text, model)
    }

    /// Reads a tree from its text, `file` being what errors call it.
    ///
    /// # Errors
    /// [`PlanError`]: not a tree, or grown for another model.
    pub fn parse(file: &str, text: &str, model: &Params<f64>) -> Result<Self, PlanError> {
        let wrong = |cause: String| PlanError::Format { file: file.to_owned(), form: "tree", cause };
        let tree: Self = serde_json::from_str(text).map_err(|cause| wrong(cause.to_string()))?;
        if tree.format != FORMAT {
            return Err(wrong(format!("format `{}`, expected `{FORMAT}`", tree.format)));
        }
        if let Some(k) = (0..tree.branches.len()).find(|k| !tree.is_sound(*k)) {
            return Err(wrong(format!(
                "branch {k}: needs two nodes, a positive duration, finite numbers, positive levels and an end in the tree"
            )));
        }
        let ours = model_hash(model);
        if tree.model_hash != ours {
            return Err(PlanError::OtherModel { file: file.to_owned(), theirs: tree.model_hash, ours });
        }
        Ok(tree)
    }

    /// Holds only for the toes that it was grown for: travel (m), speed (m/s), acceleration (m/s²).
    ///
    /// # Errors
    /// [`PlanError`]: its terms tell of other ones.
    pub fn check_toe(&self, file: &str, toe: [f64; 3]) -> Result<(), PlanError> {
        for (name, ours) in ["retract_m", "rate_m_s", "acceleration_m_s2"].into_iter().zip(toe) {
            let told = self.terms.split_once(&format!("{name}: ")).and_then(|(_, rest)| rest.split([',', ' ']).next());
            // As it was written, so it compares to the bit.
            if let Some(theirs) = told.filter(|theirs| *theirs != format!("{ours:?}")) {
                let cause = format!("grown for other toes: {name} = {theirs}, here {ours:?}");
                return Err(PlanError::Format { file: file.to_owned(), form: "tree", cause });
            }
        }
        Ok(())
    }

    fn is_sound(&self, k: usize) -> bool {
        let Some(row) = self.branches.get(k) else { return false };
        let link = |link: &Link| {
            self.branches.get(link.branch as usize).is_some_and(|to| {
                let leg = to.inner_stands == (row.inner_stands != row.touchdown);
                leg && link.at_s >= 0.0 && link.at_s <= to.duration_s
            })
        };
        let numbers = row.nodes.iter().flatten().all(|x| x.is_finite());
        let levels = row.nodes.iter().all(|node| node.last().is_some_and(|level| *level > 0.0));
        let lasts = row.duration_s.is_finite() && row.duration_s > 0.0;
        row.nodes.len() >= 2 && lasts && numbers && levels && row.next.as_ref().is_none_or(link)
    }

    /// Text of the file: one line per branch.
    ///
    /// # Errors
    /// Only if a number is not finite.
    pub fn to_text(&self) -> Result<String, serde_json::Error> {
        Ok(serde_json::to_string(self)?.replace("{\"inner_stands\"", "\n{\"inner_stands\"") + "\n")
    }
}

impl BranchRow {
    /// Ready for use.
    #[must_use]
    pub fn branch(&self) -> Branch {
        let place = |link: Link| Place { branch: link.branch, mirrored: link.mirrored, at_s: f64::from(link.at_s) };
        Branch {
            stance: if self.inner_stands { Leg::Inner } else { Leg::Outer },
            duration_s: f64::from(self.duration_s),
            touchdown: self.touchdown,
            next: self.next.map(place),
            nodes: self.nodes.iter().map(node).collect(),
        }
    }
}

/// A node from its row.
#[must_use]
pub fn node(row: &[f32; COLUMNS]) -> Node {
    let [a, b, c, d, stance, swing, torque, g0, g1, g2, g3, s @ .., level] = row.map(f64::from);
    Node { state: [a, b, c, d], rate: [c, d, stance, swing], torque, gain: [g0, g1, g2, g3], cost: s, level }
}

/// The row of a node.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "single precision is the format")]
pub fn row(node: &Node) -> [f32; COLUMNS] {
    let [a, b, c, d] = node.state;
    let [_, _, stance, swing] = node.rate;
    let [g0, g1, g2, g3] = node.gain;
    let [s0, s1, s2, s3, s4, s5, s6, s7, s8, s9] = node.cost;
    let all =
        [a, b, c, d, stance, swing, node.torque, g0, g1, g2, g3, s0, s1, s2, s3, s4, s5, s6, s7, s8, s9, node.level];
    all.map(|x| x as f32)
}
