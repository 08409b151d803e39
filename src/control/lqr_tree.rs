//! Out of the basin of balance: along the hybrid LQR-tree (thesis 4.6), or by a step that catches. RT: yes.
//!
//! In the basin of balance it balances. Outside, `tree::follow` says which place of which branch the state belongs to, in
//! every tick and by the state alone; a touchdown, early or late, leads to the branch of the other leg. The swing toe is in
//! until the branch's touchdown is near, then reaches for the floor.
//!
//! Where no tube holds the state, foot placement makes a step in the direction in which the robot falls, to where it comes to
//! rest over its new foot; and another one. `control.recovery` says which of both there is, each tick's law which it was.

use super::ControllerError;
use super::ToeLengths;
use super::balance::Balance;
use super::catch::Catch;
use super::foot_placement::Wish;
use super::friction::Compensation;
use super::motor_sign;
use super::planned::state_of;
use super::stance_toe::{StanceToe, by_stance, in_order};
use super::tables::PlanError;
use super::tree::Tree;
use super::tree::cone::bearable;
use super::tree::file::TreeFile;
use super::tree::follow::{Action, Follower, Rule, Step};
use crate::base::linalg::add_scaled;
use crate::base::time::Stamp;
use crate::config::checked::{Config, Plan, Tvlqr as Numbers};
use crate::model::compass_gait::params::Normalised;
use crate::msg::{ControlState, Estimate, LawName, Leg, Motion, Snapshot};

/// The tree, and where the robot is in it.
#[derive(Clone, Debug)]
pub(super) struct LqrTree {
    tree: Tree,
    follower: Follower,
    rule: Rule,
    catch: Option<Catch>,
    balance: Balance,
    friction: Compensation,
    models: [Normalised<f64>; 2],
    torque_unit_nm: f64,
    numbers: Numbers,
    toe_bandwidth_rad_s: f64,
    toes: ToeLengths,
    toe: StanceToe,
    stance: Option<Leg>,
    last: Stamp,
    first_step: u32,
}

impl LqrTree {
    /// Before arming only.
    ///
    /// # Errors
    /// No gain for balance, or `control.tree` is no tree of this model.
    #[expect(clippy::disallowed_methods, reason = "before arming")]
    pub(super) fn new(config: &Config) -> Result<Self, ControllerError> {
        let control = &config.control;
        let Plan { name, text } = &control.tree;
        let params = config.robot.model.params();
        let refused = |cause: PlanError| ControllerError::Tree { cause: cause.to_string() };
        let file = TreeFile::parse(name, text, &params).map_err(refused)?;
        let (toe, recovery) = (&config.robot.toe, &control.recovery);
        // The toe decides when a swing foot clears the floor. Nothing is asked of a tree that is not followed.
        if recovery.tube_share > 0.0 || !recovery.catch {
            let toe = [toe.extended_m, toe.rate_limit_m_s, toe.acceleration_limit_m_s2];
            file.check_toe(name, toe).map_err(refused)?;
        }
        Ok(Self {
            tree: Tree::new(&file),
            follower: Follower::default(),
            rule: if control.recovery.catch { Rule::beside_another(control.recovery.tube_share) } else { Rule::ALONE },
            catch: control.recovery.catch.then(|| Catch::new(config)),
            balance: Balance::new(config)?,
            friction: Compensation::new(&config.robot.model, control.friction_compensation),
            models: [params.normalised(), params.swapped().normalised()],
            torque_unit_nm: params.inertia_kg_m2(),
            numbers: control.tvlqr,
            toe_bandwidth_rad_s: control.foot_placement.toe_bandwidth_rad_s,
            toes: ToeLengths::new(&config.robot.toe),
            toe: StanceToe::new(Stamp::NEVER, 0.0, 0.0),
            stance: None,
            last: Stamp::NEVER,
            first_step: 0,
        })
    }

    /// On arming, or when it takes over.
    pub(super) fn reset(&mut self, now: Stamp, e: &Estimate) {
        if self.catch.is_some() {
            self.follower.stand()
        } else {
            self.follower.reset()
        }
        self.let_go();
        self.stance = None;
        self.last = now;
        self.first_step = e.steps;
    }

    const fn let_go(&mut self) {
        if let Some(catch) = &mut self.catch {
            catch.reset();
        }
    }

    /// Balance does not recover from here, its legs' pose being `pose`.
    pub(super) fn is_needed(&self, e: &Estimate, pose: [f64; 2]) -> bool {
        let [stance_rad, swing_rad] = pose;
        let off = add_scaled(&state_of(e), -1.0, &[stance_rad, swing_rad, 0.0, 0.0]);
        self.tree.goal_share(&off, e.stance) > 1.0
    }

    /// Torque and toes for this state, and what it is about.
    pub(super) fn step(&mut self, now: Stamp, e: &Estimate, seen: &Snapshot) -> (Wish, ControlState) {
        if self.stance.replace(e.stance) != Some(e.stance) {
            let (stance_m, _) = by_stance(&seen.toe_position_m, e.stance);
            self.toe = StanceToe::new(now, stance_m, 0.0);
        }
        let dt_s = now.since(self.last).as_s().clamp(0.0, LONGEST_TICK_S);
        self.last = now;
        let action = self.follower.step(&self.tree, &state_of(e), e.stance, dt_s, &self.rule);
        if action != Action::Lost {
            self.let_go();
        }
        let (wish, law, motion) = match (action, &mut self.catch) {
            (Action::Follow(step), _) => (self.follow(now, e, seen, &step), LawName::Tree, Motion::Recover),
            (Action::Lost, Some(catch)) => (catch.step(now, e, seen), LawName::FootPlacement, Motion::Recover),
            (Action::Balance | Action::Lost, _) => {
                let hip_torque_nm = self.balance.torque_nm(e, seen.late, 0.0);
                let toe_position_m = self.toes.for_stance(e.stance);
                (Wish { hip_torque_nm, toe_position_m, ..Wish::default() }, LawName::Balance, Motion::Stand)
            }
        };
        let state = ControlState {
            stamp: now,
            law,
            motion,
            phase: wish.phase,
            steps: e.steps.wrapping_sub(self.first_step),
            swing_goal_rad: wish.swing_goal_rad,
            ..ControlState::default()
        };
        (wish, state)
    }

    fn follow(&mut self, now: Stamp, e: &Estimate, seen: &Snapshot, step: &Step) -> Wish {
        let hip_rate = e.theta_stance_rad_s - e.theta_swing_rad_s;
        let friction = if seen.late { 0.0 } else { self.friction.torque(hip_rate) };
        let reaches = step.lands_in_s.is_some_and(|left_s| left_s < self.numbers.toe_out_s);
        let swing_m = if reaches { self.numbers.toe_reach_m } else { 0.0 };
        let stance_m = self.toe.toward(now, self.numbers.toe_nominal_m, self.toe_bandwidth_rad_s);
        let duration_s = self.tree.branches.get(step.place.branch as usize).map_or(1.0, |branch| branch.duration_s);
        let [inner, outer] = &self.models;
        let model = if e.stance == Leg::Inner { inner } else { outer };
        let torque = bearable(model, &state_of(e), FRICTION, step.torque);
        Wish {
            hip_torque_nm: motor_sign(e.stance) * self.torque_unit_nm * (torque + friction),
            toe_position_m: in_order(e.stance, stance_m, swing_m),
            phase: step.place.at_s / duration_s,
            swing_goal_rad: step.swing_goal_rad,
        }
    }
}

/// Friction of foot on floor that the law counts on.
const FRICTION: f64 = 0.54;
/// A tick that comes later than this counts as this late, s.
const LONGEST_TICK_S: f64 = 0.02;
