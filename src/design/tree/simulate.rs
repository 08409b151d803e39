//! The tree's law on the rigid robot: is a state brought upright? RT: no.
//!
//! The torque is held for a step and limited as the motor's is, friction is compensated as the law will; the swing foot
//! lands when its toe is out, which the law decides. Integration: RK4, 4 ms, about the robot's own delay.

use super::{Ground, State, side};
use crate::control::tree::cone::bearable;
use crate::control::tree::follow::{Action, Follower, Rule};
use crate::control::tree::{Place, Tree, cost};
use crate::model::compass_gait::dynamics::{acceleration_without_friction, friction};
use crate::model::compass_gait::impact;
use crate::msg::Leg;

/// Step, s.
pub const STEP_S: f64 = 0.004;
/// Longest time to upright, s.
const LONGEST_S: f64 = 5.0;
/// Share of the floor's friction that the law counts on, its plans on all of it.
const BEARS: f64 = 0.9;
/// Most touchdowns.
const MOST_STEPS: u32 = 4;
/// The stance leg leans so far: it has fallen, rad.
pub const FALLEN_RAD: f64 = 0.5;
/// The trailing foot leaves the floor for so long after a touchdown, s.
const LEAVES_S: f64 = 0.1;
/// No step with the feet nearer than this, rad between the legs.
const LEAST_SPREAD_RAD: f64 = 0.04;

/// How a simulation ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct End {
    /// In the basin of balance.
    pub upright: bool,
    /// When, s.
    pub after_s: f64,
    /// Touchdowns.
    pub steps: u32,
}

/// A node that was passed, and at what cost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passed {
    /// Branch.
    pub branch: u32,
    /// Node in it.
    pub node: u32,
    /// Least cost while it was the nearest one.
    pub cost: f64,
}

/// From `x` by the tree's law; `at`: from this place, else looked up. `passed` takes the nodes on the way.
#[must_use]
pub fn run(ground: &Ground, tree: &Tree, from: (State, Leg), at: Option<Place>, passed: &mut Vec<Passed>) -> End {
    let (mut x, mut stance) = from;
    let mut follower = Follower::default();
    follower.reset();
    if let Some(place) = at {
        follower = Follower::at(place);
    }
    let mut end = End { upright: false, after_s: 0.0, steps: 0 };
    let (mut dt_s, mut swings_s) = (0.0, ground.terms.toe.begun_s);
    while end.after_s < LONGEST_S && x[0].abs() < FALLEN_RAD && x[1].abs() < 1.5 && end.steps <= MOST_STEPS {
        let (wanted, left_s) = match follower.step(tree, &x, stance, dt_s, &Rule::ALONE) {
            Action::Balance => {
                end.upright = true;
                return end;
            }
            Action::Lost => return end,
            Action::Follow(step) => {
                note(tree, &step.place, &x, passed);
                (step.torque, step.lands_in_s.unwrap_or(LONGEST_S))
            }
        };
        let torque = limited(ground, &x, stance, wanted);
        let toe = &ground.terms.toe;
        let drawn_m = toe.travelled(swings_s).min(toe.travelled(left_s));
        let may_land = swings_s > LEAVES_S;
        let (to, took_s) = advance(ground, &x, stance, torque, may_land.then_some(drawn_m));
        (x, dt_s) = (to, took_s.abs());
        end.after_s += dt_s;
        swings_s += dt_s;
        if took_s < 0.0 {
            let Some(after) = impact::step(ground.model(stance), &x) else { return end };
            (x, stance) = (after, stance.other());
            end.steps += 1;
            swings_s = 0.0;
        }
    }
    end
}

fn note(tree: &Tree, place: &Place, x: &State, passed: &mut Vec<Passed>) {
    let Some(branch) = tree.branches.get(place.branch as usize) else { return };
    let at = branch.at(place.at_s);
    let mirrored = x.map(|x| if place.mirrored { -x } else { x });
    let off = std::array::from_fn(|i| mirrored[i] - at.state[i]);
    let cost = cost(&at.cost, &off);
    let node = branch.nearest(place.at_s) as u32;
    match passed.last_mut() {
        Some(last) if last.branch == place.branch && last.node == node => last.cost = last.cost.min(cost),
        _ => passed.push(Passed { branch: place.branch, node, cost }),
    }
}

/// Net torque that the foot and the motor's limit leave of the one wanted.
fn limited(ground: &Ground, x: &State, stance: Leg, wanted: f64) -> f64 {
    let most = ground.torque_limit();
    let compensation = -ground.terms.compensation * friction(ground.model(stance), x[2] - x[3]);
    let mu = BEARS * ground.terms.friction;
    let borne = bearable(ground.model(stance), x, mu, wanted);
    (borne + compensation).clamp(-most, most) - compensation
}

/// One step, or less of it if the swing foot lands: then the time is negative. `drawn_m`: the toe is in by so much, and
/// the foot may land.
fn advance(ground: &Ground, x: &State, stance: Leg, torque: f64, drawn_m: Option<f64>) -> (State, f64) {
    let to = rk4(ground, x, stance, torque, STEP_S);
    let Some(drawn_m) = drawn_m else { return (to, STEP_S) };
    let height = |x: &State| {
        let toe = drawn_m / ground.terms.robot.leg_length_m;
        libm::cos(x[0]) - (1.0 - toe) * libm::cos(x[1])
    };
    let (h0, h1) = (height(x), height(&to));
    if (to[0] - to[1]).abs() < LEAST_SPREAD_RAD || h1 > 0.0 || h1 >= h0 {
        return (to, STEP_S);
    }
    if h0 <= 0.0 {
        // The toe came out onto the floor: it stands at once.
        return (*x, -1e-9);
    }
    let share = STEP_S * h0 / (h0 - h1);
    (rk4(ground, x, stance, torque, share), -share)
}

fn rk4(ground: &Ground, x: &State, stance: Leg, torque: f64, h: f64) -> State {
    let model = ground.models[side(stance)];
    let flow = |x: &State| {
        let a = acceleration_without_friction(&model, [x[0], x[1]], [x[2], x[3]], torque);
        [x[2], x[3], a[0], a[1]]
    };
    let add = |d: &State, s: f64| -> State { std::array::from_fn(|i| x[i] + s * d[i]) };
    let k1 = flow(x);
    let k2 = flow(&add(&k1, 0.5 * h));
    let k3 = flow(&add(&k2, 0.5 * h));
    let k4 = flow(&add(&k3, h));
    std::array::from_fn(|i| x[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]))
}

/// Balance alone from `x`: is it upright after `seconds`? The same robot and limits, friction compensated.
#[must_use]
pub fn balances(ground: &Ground, x: &State, stance: Leg, seconds: f64) -> bool {
    let mut x = *x;
    let mut t = 0.0;
    while t < seconds {
        let wanted = -(0..4).map(|i| ground.balance_gain(stance)[i] * x[i]).sum::<f64>();
        let torque = limited(ground, &x, stance, wanted);
        x = rk4(ground, &x, stance, torque, STEP_S);
        if x[0].abs() > FALLEN_RAD || x[1].abs() > 1.5 {
            return false;
        }
        t += STEP_S;
    }
    x.iter().all(|x| x.abs() < 0.05)
}
