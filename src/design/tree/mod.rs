//! Growth of hybrid LQR-trees by simulation. Thesis 4.6; Reist and Tedrake 2010. RT: no.
//!
//! A random state is given to the tree. If the tree brings it upright in simulation, good; where it claims to and does not,
//! the tubes that were left are cut down. A state that no tube holds is given to the planner: to upright directly, or by
//! one or two steps. The motion found becomes a branch as far as the first tube of the tree that it enters: so its end is
//! free to move along the tree.
//!
//! | file | what |
//! |---|---|
//! | [`simulate`] | the tree's law on the rigid robot, torque limited, touchdowns included |
//! | [`refuse`] | a proof that a state can neither stay up nor step, by enclosing all motions |
//! | [`connect`] | a state to a planned motion, a motion to branches |
//! | [`grow`] | samples in batches on all cores, the same tree whatever their number |
//! | [`journal`] | the file on the way: whole at any time, gone on with |
//! | [`coverage`] | fresh states against the planner |

pub mod connect;
pub mod coverage;
pub mod grow;
pub mod journal;
pub mod refuse;
pub mod simulate;

#[cfg(test)]
mod tests;

use super::file::upright;
use super::problem::{Clearance, State};
use super::tvlqr::Weights;
use crate::base::riccati::RiccatiError;
use crate::model::compass_gait::params::{Normalised, Params};
use crate::msg::Leg;
use nalgebra::{Matrix4, RowVector4};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Half widths of the box that samples come from. Section 8 of the notes.
pub const BOX: State = [0.3, 0.5, 1.0, 2.0];

/// Everything that a growth depends on, the samples' number aside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Terms {
    /// The robot, inner leg standing.
    pub robot: Params<f64>,
    /// Motor torque, friction compensation included, Nm.
    pub hip_torque_nm: f64,
    /// Share of the friction that is compensated.
    pub compensation: f64,
    /// Friction of foot on floor.
    pub friction: f64,
    /// Shortest and longest step, m.
    pub step_m: [f64; 2],
    /// Slowest fall of the swing toe at a touchdown, m/s.
    pub descent_m_s: f64,
    /// Balance recovers from a cost up to this.
    pub goal_level: f64,
    /// Time between nodes, s.
    pub spacing_s: f64,
    /// The swing toe goes in with the swing, and is out again at the planned touchdown. At the start it is in.
    pub toe: Clearance,
    /// Largest swing angle of a plan, rad.
    pub swing_rad: f64,
    /// The tree is full with so many nodes.
    pub most_nodes: usize,
    /// Seed of the samples.
    pub seed: u64,
}

impl Terms {
    /// The box and the limits of section 8 of the notes: 30 Nm, μ = .6, steps of 50 to 600 mm.
    #[must_use]
    pub const fn notes(robot: Params<f64>) -> Self {
        Self {
            robot,
            hip_torque_nm: 30.0,
            compensation: 1.0,
            friction: 0.6,
            step_m: [0.05, 0.6],
            descent_m_s: 0.05,
            goal_level: 2.5,
            spacing_s: 0.06,
            toe: Clearance { height_m: 0.005, until_s: 0.03, begun_s: 1.0, ..Clearance::TOES },
            swing_rad: 0.9,
            most_nodes: 6000,
            seed: 1,
        }
    }

    /// As text: what a file must have in common with a growth that goes on with it.
    #[must_use]
    pub fn text(&self) -> String {
        format!("{self:?}")
    }
}

/// The robot as the growth needs it: both stances, balance, limits, all normalised.
#[derive(Clone, Debug)]
pub struct Ground {
    /// What it was made from.
    pub terms: Terms,
    /// Equations with friction for either stance.
    models: [Normalised<f64>; 2],
    /// Balance: cost and gain for either stance.
    balance: [(Matrix4<f64>, RowVector4<f64>); 2],
    /// Left eigenvector of the unstable mode of upright, by stance: which way the robot falls.
    falls: [State; 2],
}

impl Ground {
    /// # Errors
    /// [`RiccatiError`] when the robot cannot be balanced.
    pub fn new(terms: &Terms) -> Result<Self, RiccatiError> {
        let stances = [terms.robot, terms.robot.swapped()];
        let balance = |robot: &Params<f64>| {
            upright(robot, &Weights::THESIS)
                .map(|solution| (solution.cost, RowVector4::from_row_slice(solution.gain.as_slice())))
        };
        Ok(Self {
            terms: *terms,
            models: stances.map(|robot| robot.normalised()),
            balance: [balance(&stances[0])?, balance(&stances[1])?],
            falls: stances.map(|robot| unstable_mode(&robot)),
        })
    }

    /// Equations with friction, `stance` standing.
    #[must_use]
    pub const fn model(&self, stance: Leg) -> &Normalised<f64> {
        &self.models[side(stance)]
    }

    /// Cost of balance.
    #[must_use]
    pub const fn balance_cost(&self, stance: Leg) -> &Matrix4<f64> {
        &self.balance[side(stance)].0
    }

    /// Gain of balance.
    #[must_use]
    pub const fn balance_gain(&self, stance: Leg) -> &RowVector4<f64> {
        &self.balance[side(stance)].1
    }

    /// The unstable mode's size: negative when it falls forward.
    #[must_use]
    pub fn fall(&self, x: &State, stance: Leg) -> f64 {
        self.falls[side(stance)].iter().zip(x).map(|(a, b)| a * b).sum()
    }

    /// Largest motor torque, normalised.
    #[must_use]
    pub fn torque_limit(&self) -> f64 {
        self.terms.hip_torque_nm / self.terms.robot.inertia_kg_m2()
    }
}

pub(super) const fn side(stance: Leg) -> usize {
    match stance {
        Leg::Inner => 0,
        Leg::Outer => 1,
    }
}

/// Left eigenvector of the one unstable eigenvalue, first component 1, by power iteration on the exponential.
fn unstable_mode(robot: &Params<f64>) -> State {
    let linear = crate::model::compass_gait::linear::rigid(&robot.normalised().frictionless(), &[0.0; 4], 0.0);
    let a = Matrix4::from_fn(|i, j| linear.a[i][j]);
    let mut step = Matrix4::identity() + a * 0.01 + a * a * 0.5e-4;
    for _ in 0..9 {
        step *= step;
        step /= step.norm();
    }
    let row = RowVector4::new(1.0, 0.0, 0.0, 0.0) * step;
    (row / row[0]).transpose().into()
}

/// Sample number `k`: a state of the box and the leg that stands.
#[must_use]
pub fn sample(seed: u64, k: u64) -> (State, Leg) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(k);
    let x = BOX.map(|half| half * (2.0 * rng.random::<f64>() - 1.0));
    (x, if rng.random::<bool>() { Leg::Inner } else { Leg::Outer })
}
