//! LQR-trees: planned branches that lead to upright on one leg, each with a tube that its feedback recovers from.
//! Thesis 4.6; Tedrake 2009, Reist 2010.
//!
//! A branch is one phase: one leg stands. It goes on in another branch (after a touchdown, or by joining it on the way)
//! or ends in the basin of balance. The robot is symmetric in front and back, so every branch holds for the mirrored state
//! with mirrored torque too, and stands in the tree once.
//!
//! | file | what |
//! |---|---|
//! | [`cone`] | the torque that the stance foot can bear |
//! | [`mod@file`] | the tree as a file |
//! | [`scan`] | the nearest node among thousands: exact, by all of a processor's lanes |
//! | [`follow`] | along a branch, over touchdowns, and back to a node when it is left |
//!
//! States are `[θs, θw, θ̇s, θ̇w]`, stance leg first, torques net and divided by `m_t l²`.
//! RT: look-up and following yes, no allocation; reading before arming only.

pub mod cone;
pub mod file;
pub mod follow;
pub mod scan;

#[cfg(test)]
mod tests;

use crate::base::linalg::add_scaled;
use crate::msg::Leg;
use file::TreeFile;
use scan::{Isa, Scan};

/// A state.
pub type State = [f64; 4];

/// Everything at a place of a branch.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Node {
    /// Planned state.
    pub state: State,
    /// Its derivative.
    pub rate: State,
    /// Planned torque.
    pub torque: f64,
    /// Feedback: `torque - gain (x - state)`.
    pub gain: State,
    /// Cost-to-go of being off: upper triangle of S by rows.
    pub cost: [f64; 10],
    /// Largest cost that the feedback recovers from, as far as it was not shown otherwise.
    pub level: f64,
}

/// A place in the tree.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// Which branch.
    pub branch: u32,
    /// The robot falls the other way than the branch.
    pub mirrored: bool,
    /// Time along it, s.
    pub at_s: f64,
}

/// A branch, ready for use.
#[derive(Clone, Debug)]
#[expect(clippy::disallowed_types, reason = "filled before arming")]
pub struct Branch {
    /// The leg that stands.
    pub stance: Leg,
    /// How long it is, s.
    pub duration_s: f64,
    /// It ends at a touchdown.
    pub touchdown: bool,
    /// Where it goes on; `None`: in the basin of balance.
    pub next: Option<Place>,
    /// Equally spaced nodes, two at least.
    pub nodes: Vec<Node>,
}

/// A tree, ready for use.
#[derive(Clone, Debug)]
#[expect(clippy::disallowed_types, reason = "filled before arming")]
pub struct Tree {
    /// The branches.
    pub branches: Vec<Branch>,
    /// Basins of balance, inner and outer leg: `x' S x` at most `goal_level`.
    pub goal: [[f64; 10]; 2],
    /// Its level.
    pub goal_level: f64,
    scans: [Scan; 2],
}

impl Tree {
    /// From a file. Before arming only.
    #[must_use]
    #[expect(clippy::disallowed_types, reason = "before arming")]
    pub fn new(file: &TreeFile) -> Self {
        let branches: Vec<Branch> = file.branches.iter().map(file::BranchRow::branch).collect();
        let mut out =
            Self { branches, goal: file.goal, goal_level: file.goal_level, scans: [Scan::default(), Scan::default()] };
        out.index();
        out
    }

    /// Builds the look-up tables anew after branches or levels have changed. Before arming only.
    pub fn index(&mut self) {
        let isa = Isa::detect();
        self.scans = [Leg::Inner, Leg::Outer].map(|leg| Scan::new(&self.branches, leg, isa));
    }

    /// Adds branches. Before arming only.
    #[expect(clippy::disallowed_types, reason = "before arming")]
    pub fn extend(&mut self, branches: Vec<Branch>) {
        let first = self.branches.len();
        for (k, branch) in branches.iter().enumerate() {
            let [inner, outer] = &mut self.scans;
            let scan = match branch.stance {
                Leg::Inner => inner,
                Leg::Outer => outer,
            };
            scan.add(first + k, branch);
        }
        self.branches.extend(branches);
    }

    /// Nodes of all branches.
    #[must_use]
    pub fn nodes(&self) -> usize {
        self.branches.iter().map(|branch| branch.nodes.len()).sum()
    }

    /// Look-up table of a leg.
    #[must_use]
    pub const fn scan(&self, stance: Leg) -> &Scan {
        let [inner, outer] = &self.scans;
        match stance {
            Leg::Inner => inner,
            Leg::Outer => outer,
        }
    }

    /// Cost of balancing from `x` over the largest that balance recovers from.
    #[must_use]
    pub fn goal_share(&self, x: &State, stance: Leg) -> f64 {
        let [inner, outer] = &self.goal;
        let form = match stance {
            Leg::Inner => inner,
            Leg::Outer => outer,
        };
        cost(form, x) / self.goal_level
    }

    /// The branch's numbers at a place, mirrored as the place is.
    #[must_use]
    pub fn at(&self, place: &Place) -> Option<Node> {
        let branch = self.branches.get(place.branch as usize)?;
        let node = branch.at(place.at_s);
        Some(if place.mirrored { node.mirrored() } else { node })
    }
}

impl Branch {
    /// Time between nodes, s.
    #[must_use]
    pub fn spacing_s(&self) -> f64 {
        #[expect(clippy::cast_precision_loss, reason = "a few hundred nodes")]
        let intervals = self.nodes.len().saturating_sub(1) as f64;
        self.duration_s / intervals
    }

    /// Between the nodes: cubic for the state, linear for the rest; held at the ends.
    #[must_use]
    pub fn at(&self, t_s: f64) -> Node {
        let h = self.spacing_s();
        let last = self.nodes.len().saturating_sub(2);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let k = ((t_s / h).max(0.0) as usize).min(last);
        let (Some(a), Some(b)) = (self.nodes.get(k), self.nodes.get(k + 1)) else { return Node::default() };
        #[expect(clippy::cast_precision_loss, reason = "a few hundred nodes")]
        let s = (t_s / h - k as f64).clamp(0.0, 1.0);
        a.between(b, s, h)
    }

    /// The node nearest in time.
    #[must_use]
    pub fn nearest(&self, t_s: f64) -> usize {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let k = (t_s / self.spacing_s() + 0.5).max(0.0) as usize;
        k.min(self.nodes.len().saturating_sub(1))
    }
}

impl Node {
    fn between(&self, next: &Self, s: f64, h: f64) -> Self {
        let (s2, s3) = (s * s, s * s * s);
        let [a, b, c, d] = [2.0 * s3 - 3.0 * s2 + 1.0, s3 - 2.0 * s2 + s, 3.0 * s2 - 2.0 * s3, s3 - s2];
        let states = add_scaled(&add_scaled(&[0.0; 4], a, &self.state), c, &next.state);
        let rates = add_scaled(&add_scaled(&[0.0; 4], b * h, &self.rate), d * h, &next.rate);
        Self {
            state: add_scaled(&states, 1.0, &rates),
            rate: mix(&self.rate, &next.rate, s),
            torque: self.torque + s * (next.torque - self.torque),
            gain: mix(&self.gain, &next.gain, s),
            cost: mix(&self.cost, &next.cost, s),
            level: self.level + s * (next.level - self.level),
        }
    }

    /// For the mirrored state.
    #[must_use]
    pub fn mirrored(&self) -> Self {
        Self { state: self.state.map(|x| -x), rate: self.rate.map(|x| -x), torque: -self.torque, ..*self }
    }

    /// Cost of a state over the largest that is recovered from.
    #[must_use]
    pub fn share(&self, x: &State) -> f64 {
        cost(&self.cost, &add_scaled(x, -1.0, &self.state)) / self.level
    }
}

fn mix<const N: usize>(a: &[f64; N], b: &[f64; N], s: f64) -> [f64; N] {
    let mut out = *a;
    out.iter_mut().zip(b).for_each(|(a, b)| *a += s * (b - *a));
    out
}

/// `e' S e`, S by its upper triangle.
#[must_use]
pub fn cost(s: &[f64; 10], e: &State) -> f64 {
    let [a, b, c, d] = *e;
    let [aa, ab, ac, ad, bb, bc, bd, cc, cd, dd] = *s;
    aa * a * a
        + bb * b * b
        + cc * c * c
        + dd * d * d
        + 2.0 * (ab * a * b + ac * a * c + ad * a * d + bc * b * c + bd * b * d + cd * c * d)
}

/// `S e`, S by its upper triangle.
#[must_use]
pub fn form_times(s: &[f64; 10], e: &State) -> State {
    let [a, b, c, d] = *e;
    let [aa, ab, ac, ad, bb, bc, bd, cc, cd, dd] = *s;
    [
        aa * a + ab * b + ac * c + ad * d,
        ab * a + bb * b + bc * c + bd * d,
        ac * a + bc * b + cc * c + cd * d,
        ad * a + bd * b + cd * c + dd * d,
    ]
}
