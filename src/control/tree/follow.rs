//! Along a branch: which place of it belongs to a state, over touchdowns, and to another branch when it is left.
//!
//! ```text
//!           share ≤ 1 of some node            in the basin of balance
//!   lost ───────────────────────────> branch ─────────────────────────> balance
//!    ^                                  │ ^                                │
//!    └──── no tube holds the state ─────┘ └──── look-up when it is left ───┘
//! ```
//! Time along the branch is not the clock's: each tick it moves to where the state costs least, so that a touchdown that
//! is early or late, or a slower robot, is the same branch at another time. RT: yes.

use super::{Node, Place, State, Tree, form_times};
use crate::base::linalg::{add_scaled, dot};
use crate::msg::Leg;

/// Where the robot is in the tree.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Follower {
    place: Option<Place>,
    balances: bool,
    /// Time since the last look-up, s.
    looked_s: f64,
}

/// What to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Action {
    /// Balance: the goal's own feedback.
    Balance,
    /// Follow a branch.
    Follow(Step),
    /// No tube holds the state.
    Lost,
}

/// A place on a branch, and what it asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Where.
    pub place: Place,
    /// Net torque, divided by `m_t l²`, not limited.
    pub torque: f64,
    /// Cost over level.
    pub share: f64,
    /// Time left to the branch's touchdown, s; `None`: none is planned.
    pub lands_in_s: Option<f64>,
    /// Swing angle at the end of the branch, rad.
    pub swing_goal_rad: f64,
}

/// Where one law gives over to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rule {
    /// A tube is taken below this share of its level, and left beyond its level; infinite: the nearest one is followed from
    /// however far.
    tube_share: f64,
    /// Balance is taken below the first share of its level, and left beyond the second.
    balance_shares: [f64; 2],
}

impl Rule {
    /// There is nothing but the tree.
    pub const ALONE: Self = Self { tube_share: f64::INFINITY, balance_shares: [1.0, 1.2] };

    /// There is a law for states that no tube holds. It goes on further into the basin of balance: measured on the full
    /// simulated robot (26 November 2026, 160 starts and pushes), 133 stand with .5, 128 with .8, 126 with .2.
    #[must_use]
    pub const fn beside_another(tube_share: f64) -> Self {
        Self { tube_share, balance_shares: [0.5, 1.0] }
    }
}

/// Another branch must be better by this factor: two that are about as far would take turns.
const BETTER: f64 = 0.5;
/// Shortest time between two look-ups, s.
const LOOK_EVERY_S: f64 = 0.02;
/// A place moves by so much of the clock's pace at most, against it too.
const PACE: f64 = 3.0;

impl Follower {
    /// Forgets where it was.
    pub const fn reset(&mut self) {
        *self = Self { place: None, balances: false, looked_s: LOOK_EVERY_S };
    }

    /// Forgets where it was, and stands until balance is left.
    pub const fn stand(&mut self) {
        *self = Self { place: None, balances: true, looked_s: LOOK_EVERY_S };
    }

    /// Begins at a place.
    #[must_use]
    pub const fn at(place: Place) -> Self {
        Self { place: Some(place), balances: false, looked_s: 0.0 }
    }

    /// What to do in state `x` with `stance` standing, `dt_s` after the last call.
    pub fn step(&mut self, tree: &Tree, x: &State, stance: Leg, dt_s: f64, rule: &Rule) -> Action {
        let goal = tree.goal_share(x, stance);
        let [taken, left] = rule.balance_shares;
        self.balances = goal <= if self.balances { left } else { taken };
        if self.balances {
            self.place = None;
            self.looked_s = LOOK_EVERY_S;
            return Action::Balance;
        }
        self.looked_s += dt_s;
        self.advance(tree, x, stance, dt_s);
        let here = self.place.and_then(|place| Some((place, tree.at(&place)?)));
        let share = here.map_or(f64::INFINITY, |(_, node)| node.share(x));
        if (share > 1.0 || share.is_nan()) && self.looked_s >= LOOK_EVERY_S {
            self.looked_s = 0.0;
            let better = (BETTER * share).min(rule.tube_share);
            // Rounding can leave the form of a state on the branch below zero.
            if let Some(found) = tree.scan(stance).best(x).filter(|found| found.share.max(0.0) < better) {
                self.place = tree.branches.get(found.branch as usize).map(|branch| Place {
                    branch: found.branch,
                    mirrored: found.mirrored,
                    at_s: f64::from(found.node) * branch.spacing_s(),
                });
            }
        }
        let Some(place) = self.place else { return Action::Lost };
        let Some(node) = tree.at(&place) else { return Action::Lost };
        let step = ask(tree, &place, &node, x);
        if step.share > rule.tube_share.max(1.0) {
            self.place = None;
            return Action::Lost;
        }
        Action::Follow(step)
    }

    /// Moves the place on: with time, to where the state is, over the end of a branch.
    fn advance(&mut self, tree: &Tree, x: &State, stance: Leg, dt_s: f64) {
        let Some(mut place) = self.place else { return };
        let Some(branch) = tree.branches.get(place.branch as usize) else { return };
        if branch.stance != stance {
            // A touchdown: the planned one leads to the planned branch, another one has to be looked up.
            self.looked_s = LOOK_EVERY_S;
            self.place = branch.next.filter(|_| branch.touchdown).map(|next| after(&place, next));
            return;
        }
        place.at_s += dt_s + correction(tree, &place, x).clamp(-PACE * dt_s, PACE * dt_s);
        place.at_s = place.at_s.clamp(0.0, branch.duration_s);
        if place.at_s >= branch.duration_s && !branch.touchdown {
            match branch.next {
                Some(next) => place = after(&place, next),
                // The end is the basin of balance, and the state is not in it.
                None => self.looked_s = self.looked_s.max(LOOK_EVERY_S),
            }
        }
        self.place = Some(place);
    }
}

const fn after(place: &Place, next: Place) -> Place {
    Place { mirrored: place.mirrored != next.mirrored, ..next }
}

/// Gauss-Newton step of the time along the branch to where the state costs least, s.
fn correction(tree: &Tree, place: &Place, x: &State) -> f64 {
    let Some(node) = tree.at(place) else { return 0.0 };
    let weighted = form_times(&node.cost, &node.rate);
    let step = dot(&weighted, &add_scaled(x, -1.0, &node.state)) / dot(&weighted, &node.rate);
    if step.is_finite() { step } else { 0.0 }
}

fn ask(tree: &Tree, place: &Place, node: &Node, x: &State) -> Step {
    let error = add_scaled(x, -1.0, &node.state);
    let branch = tree.branches.get(place.branch as usize);
    let lands_in_s = branch.filter(|b| b.touchdown).map(|b| b.duration_s - place.at_s);
    let end = branch.and_then(|b| b.nodes.last()).map_or(0.0, |node| node.state[1]);
    Step {
        place: *place,
        torque: node.torque - dot(&node.gain, &error),
        share: node.share(x),
        lands_in_s,
        swing_goal_rad: if place.mirrored { -end } else { end },
    }
}
