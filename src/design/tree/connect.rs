//! From a state to a planned motion, and from a motion to branches. RT: no.

use super::{Ground, State};
use crate::control::tree::file::{BranchRow, COLUMNS, Link, node, row};
use crate::control::tree::{Node, Tree};
use crate::design::problem::{Cost, End, Finish, Landing, Limits, Phase, Problem, Start};
use crate::design::solve::{Effort, Failure, Solution, plan_guessed};
use crate::design::trajectory::{Arc, Trajectory};
use crate::design::tvlqr::{Weights, gains_in};
use crate::msg::Leg;
use nalgebra::Matrix4;

/// Knots per phase: for feasibility, and for the motion that becomes a branch.
pub const EFFORT: Effort = Effort { coarse: 8, fine: None };
/// The same, better.
pub const FINE: Effort = Effort { coarse: 8, fine: Some(20) };
/// Most steps of a plan.
pub const MOST_STEPS: usize = 2;
/// Direct balance is not tried beyond this size of the unstable mode: the linear bound is 0.113 (section 8 of the notes).
const DIRECT_RAD: f64 = 0.2;
/// A plan ends well inside the basin of balance: the law that follows it ends somewhere beside.
const ENDS: f64 = 0.5;
/// Durations of a phase, s.
const DURATION_S: [f64; 2] = [0.02, 1.5];
/// A motion joins the tree where it costs less than this share of a tube's level.
const JOIN: f64 = 0.25;
/// Steps of the Riccati equation between two nodes. With 6 the cost of 6 % of the nodes was indefinite.
const RICCATI_STEPS: usize = 24;

/// The problem of coming upright from `x` by so many steps, in the direction in which it falls.
#[must_use]
pub fn problem(ground: &Ground, x: &State, stance: Leg, steps: usize) -> Problem {
    let t = &ground.terms;
    let landing = Landing { step_m: t.step_m, floor_m: 0.0, descent_m_s: t.descent_m_s };
    let leg = |k: usize| if k.is_multiple_of(2) { stance } else { stance.other() };
    let phase = |k: usize, end| Phase { stance: leg(k), knots: EFFORT.coarse, duration_s: DURATION_S, end };
    let mut phases: Vec<Phase> = (0..steps).map(|k| phase(k, End::Touchdown(landing))).collect();
    let cost = ground.balance_cost(leg(steps));
    let form = std::array::from_fn(|i| std::array::from_fn(|j| cost[(i, j)]));
    phases.push(phase(steps, End::Basin { centre: [0.0; 4], form, level: ENDS * t.goal_level }));
    let limits = Limits {
        hip_torque_nm: t.hip_torque_nm,
        compensation: t.compensation,
        friction: t.friction,
        normal_force_n: 10.0,
        clearance: Some(t.toe),
        swing_rad: Some(t.swing_rad),
        impact: true,
    };
    Problem {
        robot: t.robot,
        phases,
        start: Start::State(*x),
        finish: Finish::Free,
        total_time_s: None,
        limits,
        cost: Cost { time: 0.2, ..Cost::TORQUE },
    }
}

/// A way upright from `x`, which must fall forward (or not at all), and how many problems were solved for it.
#[must_use]
pub fn plan(ground: &Ground, x: &State, stance: Leg, effort: Effort, first_s: f64) -> (Option<Solution>, u64) {
    let mut solves = 0;
    for steps in 0..=MOST_STEPS {
        if steps == 0 && ground.fall(x, stance).abs() > DIRECT_RAD {
            continue;
        }
        solves += 1;
        let problem = problem(ground, x, stance, steps);
        let guess = |phase: usize, share: f64| guess(x, steps, first_s, phase, share);
        match plan_guessed(&problem, guess, effort) {
            Ok(solution) => return (Some(solution), solves),
            // What cannot be met before the first touchdown cannot be met with more steps after it either.
            Err(Failure::Infeasible(broken)) if steps > 0 && broken.iter().all(|v| v.phase == 0) => break,
            Err(_) => {}
        }
    }
    (None, solves)
}

/// Straight lines: to a foothold of 300 mm in `first_s`, from foothold to foothold, and to upright.
fn guess(x: &State, steps: usize, first_s: f64, phase: usize, share: f64) -> (State, f64, f64) {
    const FOOT_RAD: f64 = 0.144;
    let from = if phase == 0 { [x[0], x[1]] } else { [FOOT_RAD, -FOOT_RAD] };
    let to = if phase == steps { [0.0; 2] } else { [-FOOT_RAD, FOOT_RAD] };
    let duration = if phase == 0 && steps > 0 { first_s } else { 0.7 };
    let rate = [0, 1].map(|i| (to[i] - from[i]) / duration);
    let at = [0, 1].map(|i| from[i] + share * (to[i] - from[i]));
    ([at[0], at[1], rate[0], rate[1]], 0.0, duration)
}

/// Branches of a motion, up to the first tube of the tree that it enters; `first` is the number of the first new branch.
/// `None` when an impact is singular or a cost indefinite.
#[must_use]
pub fn branches(ground: &Ground, tree: &Tree, solution: &Solution, first: usize) -> Option<Vec<BranchRow>> {
    let mut motion = solution.trajectory.clone();
    let mut joined = None;
    'arcs: for p in 0..motion.arcs.len() {
        let arc = &motion.arcs[p];
        let count = intervals(ground, arc);
        for k in 1..=count {
            let t = arc.duration_s * ratio(k, count);
            if k == count && p + 1 < motion.arcs.len() {
                continue;
            }
            let found = tree.scan(arc.stance).best(&arc.state(t)).filter(|found| found.share < JOIN);
            if let Some(found) = found {
                motion.arcs[p] = arc.until(t, 2 * count + 1);
                motion.arcs.truncate(p + 1);
                joined = Some(found);
                break 'arcs;
            }
        }
    }
    let last = motion.arcs.last()?;
    // Cost-to-go goes on over the joint, so a new tube leads into the one that it ends in with the same level.
    let (end, final_cost, level) = match joined {
        None => (None, *ground.balance_cost(last.stance), ground.terms.goal_level),
        Some(found) => {
            let branch = &tree.branches[found.branch as usize];
            let at_s = f64::from(found.node) * branch.spacing_s();
            #[expect(clippy::cast_possible_truncation, reason = "single precision is the format")]
            let link = Link {
                branch: found.branch,
                mirrored: found.mirrored,
                at_s: (at_s as f32).min(branch.duration_s as f32),
            };
            let node = &branch.nodes[found.node as usize];
            (Some(link), full(&node.cost), node.level)
        }
    };
    rows(ground, &motion, end, &final_cost, level, first)
}

fn rows(
    ground: &Ground,
    motion: &Trajectory,
    end: Option<Link>,
    final_cost: &Matrix4<f64>,
    level: f64,
    first: usize,
) -> Option<Vec<BranchRow>> {
    let counts: Vec<usize> = motion.arcs.iter().map(|arc| intervals(ground, arc)).collect();
    let gains = gains_in(motion, &Weights::THESIS, final_cost, |p| RICCATI_STEPS * counts[p])?;
    let mut out = Vec::new();
    for (p, arc) in motion.arcs.iter().enumerate() {
        let at = |k: usize| {
            let t = arc.duration_s * ratio(k, counts[p]);
            let (state, torque) = (arc.state(t), arc.torque(t));
            row(&Node {
                state,
                rate: arc.flow(&state, torque),
                torque,
                gain: gains[p].gain[RICCATI_STEPS * k].transpose().into(),
                cost: upper(&gains[p].cost[RICCATI_STEPS * k]),
                level,
            })
        };
        let last = p + 1 == motion.arcs.len();
        #[expect(clippy::cast_possible_truncation, reason = "fewer than 4 billion")]
        let next = Link { branch: (first + p + 1) as u32, mirrored: false, at_s: 0.0 };
        #[expect(clippy::cast_possible_truncation, reason = "single precision is the format")]
        out.push(BranchRow {
            inner_stands: arc.stance == Leg::Inner,
            duration_s: arc.duration_s as f32,
            touchdown: !last,
            next: if last { end } else { Some(next) },
            nodes: (0..=counts[p]).map(at).collect(),
        });
    }
    // A cost that rounding has left indefinite has a tube without end.
    let sound = |row: &[f32; COLUMNS]| row.iter().all(|x| x.is_finite()) && full(&node(row).cost).cholesky().is_some();
    out.iter().flat_map(|row| &row.nodes).all(sound).then_some(out)
}

/// Intervals of an arc.
fn intervals(ground: &Ground, arc: &Arc) -> usize {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few hundred at most")]
    let count = (arc.duration_s / ground.terms.spacing_s).ceil() as usize;
    count.max(1)
}

#[expect(clippy::cast_precision_loss, reason = "a few hundred nodes")]
fn ratio(k: usize, count: usize) -> f64 {
    k as f64 / count as f64
}

fn full(s: &[f64; 10]) -> Matrix4<f64> {
    let place = |i: usize, j: usize| [0, 4, 7, 9][i.min(j)] + i.abs_diff(j);
    Matrix4::from_fn(|i, j| s[place(i, j)])
}

/// Upper triangle by rows.
#[must_use]
pub fn upper(m: &Matrix4<f64>) -> [f64; 10] {
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
