//! A solved problem with its gains as the file that controllers read. RT: no.

use super::problem::{End, Problem};
use super::solve::Solution;
use super::transverse::{self, Blend, Design, TransverseError};
use super::tvlqr::{self, STEPS, TimeVarying, Weights};
use crate::base::riccati::{self, RiccatiError};
use crate::control::tables::{FORMAT, Node, PhaseEnd, PhaseTable, PlanFile, ToeTravel, model_hash};
use crate::model::compass_gait::linear;
use crate::model::compass_gait::params::Params;
use nalgebra::{Matrix1, Matrix4, SMatrix, Vector4};

/// Intervals of a table: 8 to 12 ms of a phase each.
const INTERVALS: usize = 100;

/// Why a motion got no gains.
#[derive(Clone, Copy, Debug, thiserror::Error)]
pub enum GainError {
    /// The upright LQR at the end of the motion.
    #[error("upright balance at the end of the plan: {0}")]
    Upright(#[from] RiccatiError),
    /// Transverse design.
    #[error(transparent)]
    Transverse(#[from] TransverseError),
    /// A touchdown without an impact map.
    #[error("an impact of the plan is singular")]
    SingularImpact,
}

/// Gains of a solved problem.
#[derive(Clone, Debug)]
pub struct Gains {
    /// Time-varying LQR of every phase.
    pub time: Vec<TimeVarying>,
    /// Transverse design, where every phase ends at a touchdown.
    pub transverse: Option<Design>,
}

/// Cost-to-go and gain of the LQR that balances upright, friction compensated.
///
/// # Errors
/// [`RiccatiError`] when the model cannot be stabilised.
pub fn upright(robot: &Params<f64>, weights: &Weights) -> Result<riccati::Solution<4, 1>, RiccatiError> {
    let model = linear::rigid(&robot.normalised().frictionless(), &[0.0; 4], 0.0);
    let a = SMatrix::from_fn(|i, j| model.a[i][j]);
    riccati::continuous(&a, &Vector4::from(model.b), &weights.q(), &Matrix1::new(weights.torque))
}

/// Designs the gains of a motion. One that ends upright ends with the cost of balancing there; one that ends at a
/// touchdown, with `joined` if given (cost-to-go of the motion it joins, by state after the impact), else with the weights.
///
/// # Errors
/// [`GainError`].
pub fn gains(solution: &Solution, weights: &Weights, joined: Option<&Matrix4<f64>>) -> Result<Gains, GainError> {
    let (problem, motion) = (&solution.problem, &solution.trajectory);
    let periodic = problem.start == super::problem::Start::Periodic;
    let swings = problem.phases.iter().all(|phase| matches!(phase.end, End::Touchdown(_)));
    let last = problem.phases.last().map(|phase| phase.end);
    let final_cost = match (last, joined) {
        (Some(End::State(_) | End::Basin { .. }), _) => {
            let stance = problem.phases.last().map_or(problem.robot, |phase| problem.params(phase));
            upright(&stance, weights)?.cost
        }
        (_, Some(joined)) => {
            let arc = motion.arcs.last().ok_or(GainError::SingularImpact)?;
            let jump = tvlqr::impact_jacobian(arc, &arc.state(arc.duration_s)).ok_or(GainError::SingularImpact)?;
            jump.transpose() * joined * jump
        }
        _ => weights.q(),
    };
    let transverse = match (swings, periodic) {
        (false, _) => None,
        (true, true) => Some(transverse::design(motion, weights, Blend::Best, None)?),
        (true, false) => Some(transverse::design(motion, weights, Blend::Best, Some(&final_cost))?),
    };
    let time = tvlqr::gains(motion, weights, &final_cost).ok_or(GainError::SingularImpact)?;
    Ok(Gains { time, transverse })
}

/// The file.
#[must_use]
pub fn plan_file(kind: &str, command: &str, solution: &Solution, gains: &Gains) -> PlanFile {
    let problem = &solution.problem;
    let (step_m, duration_s) = (last_step_m(solution), solution.trajectory.duration_s());
    let periodic = problem.start == super::problem::Start::Periodic;
    #[expect(clippy::cast_precision_loss, reason = "a handful of phases")]
    let speed_m_s = if periodic { problem.phases.len() as f64 * step_m / duration_s } else { 0.0 };
    PlanFile {
        format: FORMAT.to_owned(),
        kind: kind.to_owned(),
        command: command.to_owned(),
        model_hash: model_hash(&problem.robot),
        periodic,
        step_m,
        speed_m_s,
        toes: problem.limits.clearance.map(|c| ToeTravel {
            clearance_m: c.height_m,
            retract_m: c.retract_m,
            rate_m_s: c.rate_m_s,
            acceleration_m_s2: c.acceleration_m_s2,
            until_s: c.until_s,
        }),
        phases: (0..problem.phases.len()).map(|p| phase_table(problem, solution, gains, p)).collect(),
    }
}

/// Length of the last step that ends at a touchdown, m.
fn last_step_m(solution: &Solution) -> f64 {
    let landings = solution.problem.phases.iter().zip(&solution.trajectory.arcs);
    let mut landed = landings.filter(|(phase, _)| matches!(phase.end, End::Touchdown(_) | End::Rest(_)));
    landed.next_back().map_or(0.0, |(_, arc)| {
        let x = arc.state(arc.duration_s);
        solution.problem.robot.leg_length_m * (libm::sin(x[1]) - libm::sin(x[0]))
    })
}

fn phase_table(problem: &Problem, solution: &Solution, gains: &Gains, p: usize) -> PhaseTable {
    let (phase, arc) = (&problem.phases[p], &solution.trajectory.arcs[p]);
    let unit = problem.robot.inertia_kg_m2();
    let node = |i: usize| {
        let k = i * STEPS / INTERVALS;
        #[expect(clippy::cast_precision_loss, reason = "a hundred nodes")]
        let t = arc.duration_s * i as f64 / INTERVALS as f64;
        let (state, torque) = (arc.state(t), arc.torque(t));
        let row: [f64; 4] = gains.time[p].gain[k].transpose().into();
        let mut node = Node {
            state,
            rate: arc.flow(&state, torque),
            torque_nm: torque * unit,
            time_gain_nm: row.map(|x| x * unit),
            time_cost: upper(&gains.time[p].cost[k]),
            ..Node::default()
        };
        if let Some(design) = &gains.transverse {
            node.surface = design.surface(p, k);
            node.transverse_gain_nm = design.gain(p, k).map(|x| x * unit);
            node.transverse_cost = upper(&design.cost(p, k));
        }
        node
    };
    PhaseTable {
        inner_stands: phase.stance == crate::msg::Leg::Inner,
        end: match phase.end {
            End::Touchdown(_) => PhaseEnd::Touchdown,
            End::Rest(_) => PhaseEnd::Rest,
            End::State(_) | End::Basin { .. } => PhaseEnd::State,
        },
        duration_s: arc.duration_s,
        transverse: gains.transverse.is_some(),
        nodes: (0..=INTERVALS).map(node).collect(),
    }
}

fn upper(m: &Matrix4<f64>) -> [f64; 10] {
    let mut out = [0.0; 10];
    let mut k = 0;
    for i in 0..4 {
        for j in i..4 {
            out[k] = m[(i, j)];
            k += 1;
        }
    }
    out
}
