//! Laws of every controller, and those of balance.
use super::*;
use crate::config::load;
use crate::msg::Motion;

const ALL: [&str; 3] = ["idle", "hold", "balance"];
/// Laws that walk, with the plan that they need.
const WALKING: [(&str, &str); 4] = [
    ("walk", "gait_350mm_525mm_s"),
    ("virtual_constraint", "gait_350mm_525mm_s"),
    ("transverse", "gait_350mm_525mm_s"),
    ("tvlqr", "rebalance_inner_300mm"),
];

fn config(keys: &[&str]) -> Config {
    load(None, &keys.iter().map(|k| (*k).to_owned()).collect::<Vec<_>>()).unwrap().config
}

fn controller(name: &str) -> Controller {
    Controller::new(&config(&[&format!("control.controller={name}")])).unwrap()
}

fn torque(c: &mut Controller, e: &Estimate) -> f64 {
    c.step(Stamp(0), e, &Snapshot::default()).hip_torque_nm
}

fn state(stance: Leg, [ts, tw, vs, vw]: [f64; 4]) -> Estimate {
    let sign = if stance == Leg::Inner { 1.0 } else { -1.0 };
    Estimate {
        valid: true,
        stance,
        theta_stance_rad: ts,
        theta_swing_rad: tw,
        theta_stance_rad_s: vs,
        theta_swing_rad_s: vw,
        hip_angle_rad: sign * (ts - tw),
        ..Estimate::default()
    }
}

/// A fixed set of states over and beyond all that can happen.
fn states() -> impl Iterator<Item = [f64; 4]> {
    let values = [-1e3, -1.0, -0.02, 0.0, 0.3, 1e6];
    values.into_iter().flat_map(move |a| values.into_iter().map(move |b| [a, b, -b, a]))
}

#[test]
fn finite_state_gives_finite_torque() {
    for name in ALL {
        let mut c = controller(name);
        for x in states() {
            for leg in [Leg::Inner, Leg::Outer] {
                assert!(torque(&mut c, &state(leg, x)).is_finite(), "{name} {x:?}");
            }
        }
    }
}

#[test]
fn nothing_is_asked_for_at_the_upright_equilibrium() {
    for name in ALL {
        let mut c = controller(name);
        let upright = state(Leg::Outer, [0.0; 4]);
        c.reset(Stamp(0), &upright);
        assert!(torque(&mut c, &upright).abs() < 1e-15, "{name}");
    }
}

#[test]
fn same_input_gives_the_same_bits() {
    for name in ALL {
        let (mut a, mut b) = (controller(name), controller(name));
        for x in states() {
            let e = state(Leg::Inner, x);
            assert_eq!(torque(&mut a, &e).to_bits(), torque(&mut b, &e).to_bits());
            assert_eq!(torque(&mut a, &e).to_bits(), torque(&mut b, &e).to_bits());
        }
    }
}

#[test]
fn a_state_that_is_not_finite_shows_in_the_torque() {
    // Safety turns it into a fault; the controller must not hide it.
    assert!(!torque(&mut controller("balance"), &state(Leg::Inner, [f64::NAN, 0.0, 0.0, 0.0])).is_finite());
}

#[test]
fn mirrored_state_gives_the_opposite_torque() {
    for name in ALL {
        let mut c = controller(name);
        c.reset(Stamp(0), &state(Leg::Inner, [0.0; 4]));
        for x in states() {
            for leg in [Leg::Inner, Leg::Outer] {
                let (one, other) = (torque(&mut c, &state(leg, x)), torque(&mut c, &state(leg, x.map(|v| -v))));
                assert!((one + other).abs() <= 1e-12 * one.abs());
            }
        }
    }
}

#[test]
fn balance_torque_is_the_gain_of_the_leg_that_stands_with_its_sign() {
    let mut c = controller("balance");
    let unit = config(&[]).robot.model.params().inertia_kg_m2();
    for (leg, k, sign) in [(Leg::Inner, 95.014_623, 1.0), (Leg::Outer, 119.920_818, -1.0)] {
        let got = torque(&mut c, &state(leg, [0.01, 0.0, 0.0, 0.0]));
        assert!((got + sign * unit * k * 0.01).abs() < 1e-5, "{leg:?} {got}");
    }
}

#[test]
fn friction_is_compensated_by_its_share_and_not_when_ticks_are_late() {
    let extra = |share: f64, late: bool| {
        let mut c = Controller::new(&config(&[&format!("control.friction_compensation={share:?}")])).unwrap();
        let still = Snapshot { late, ..Snapshot::default() };
        let mut at = |r: f64| c.step(Stamp(0), &state(Leg::Inner, [0.0, 0.0, r, 0.0]), &still).hip_torque_nm;
        // Even part: LQR is linear, so what is left at two rates is friction (1.841 Nm + .694 Nm s/rad).
        at(0.2) - 2.0 * at(0.1)
    };
    assert!((extra(1.0, false) + 1.841).abs() < 1e-3);
    assert!((extra(0.5, false) + 0.5 * 1.841).abs() < 1e-3);
    assert!(extra(0.0, false).abs() < 1e-12);
    assert!(extra(1.0, true).abs() < 1e-12);
}

#[test]
fn hold_pushes_back_from_where_it_was_reset() {
    for leg in [Leg::Inner, Leg::Outer] {
        let mut c = controller("hold");
        c.reset(Stamp(0), &state(leg, [0.1, -0.2, 0.0, 0.0]));
        let sign = if leg == Leg::Inner { 1.0 } else { -1.0 };
        assert!((torque(&mut c, &state(leg, [0.11, -0.2, 0.0, 0.0])) + sign * 200.0 * 0.01).abs() < 1e-9);
        assert!((torque(&mut c, &state(leg, [0.1, -0.2, 0.3, 0.0])) + sign * 20.0 * 0.3).abs() < 1e-9);
    }
}

#[test]
fn toes_are_out_on_the_leg_that_stands() {
    let mut c = controller("idle");
    let toe = config(&[]).robot.toe;
    let lengths = c.step(Stamp(0), &state(Leg::Outer, [0.0; 4]), &Snapshot::default()).toe_position_m;
    let want = [toe.retracted_m, toe.retracted_m, toe.extended_m, toe.extended_m];
    assert_eq!(lengths.map(f64::to_bits), want.map(f64::to_bits));
}

#[test]
fn stiff_spring_in_the_model_leaves_the_gain_of_the_rigid_robot() {
    let spring = |k: f64| {
        let key = format!(
            "robot.model.hip_elasticity={{ stiffness_nm_rad = {k:?}, damping_nm_s_rad = 2.0, rotor_inertia_kg_m2 = 0.09 }}"
        );
        balance_gain(&config(&[&key]), Leg::Inner).unwrap().0
    };
    // Rigid: the angle between the legs is the rotor's, so gains on both add up.
    let rigid = balance_gain(&config(&[]), Leg::Inner).unwrap().0;
    let fold = |k: [f64; 6]| [k[0] + k[2], k[1] - k[2], k[3] + k[5], k[4] - k[5]];
    let distance = |k: f64| {
        let folded = fold(spring(k));
        fold(rigid).iter().zip(folded).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    assert!(distance(377.0) < 40.0 && distance(100_000.0) < 0.5, "{} {}", distance(377.0), distance(100_000.0));
}

/// A walking law that has just begun to step in, at time 0: before, it stood in the pose to step in from.
fn walking(name: &str, plan: &str) -> Controller {
    let keys =
        [format!("control.controller={name}"), format!("control.plan={plan}"), "control.walk.start_s=0.0".into()];
    let config = config(&keys.each_ref().map(String::as_str));
    let back_rad = if name == "tvlqr" { 0.0 } else { -config.control.foot_placement.first_back_rad };
    let stance_rad = balance::Pose::new(&config.robot.model.params().normalised(), back_rad).stance_rad;
    let pose = state(Leg::Inner, [stance_rad, back_rad, 0.0, 0.0]);
    let stand = |from_ms: i64| {
        let mut c = Controller::new(&config).unwrap();
        c.reset(Stamp(-1_000_000 * from_ms), &pose);
        let stood = (0..5000).take_while(|k| {
            c.step(Stamp(1_000_000 * (k - from_ms)), &pose, &Snapshot::default());
            c.state().motion == Motion::Stand
        });
        (stood.count() as i64, c)
    };
    let (stood_ms, _) = stand(0);
    assert!(stood_ms < 3000, "{name} does not step in");
    stand(stood_ms).1
}

/// States of steps: each lasts half a second, and ends near the next one's beginning, which is near the gait's.
fn steps(c: &mut Controller, ticks: u32, mut see: impl FnMut(u32, &JointCommand, &ControlState)) {
    let mut seen = Snapshot::default();
    for k in 0..ticks {
        let (step, s) = (k / 500, f64::from(k % 500) / 500.0);
        let stance = if step % 2 == 0 { Leg::Inner } else { Leg::Outer };
        let mut e = state(stance, [0.18 - 0.36 * s, -0.18 + 0.4 * s, -0.7, 0.7 - 1.2 * (s - 0.5)]);
        e.steps = step;
        let now = Stamp(i64::from(k) * 1_000_000);
        let command = c.step(now, &e, &seen);
        seen.toe_position_m = command.toe_position_m.map(|m| m.clamp(0.0, 0.04));
        see(k, &command, c.state());
    }
}

#[test]
fn walking_laws_answer_finite_states_with_finite_torque_and_toes_within_reach() {
    for (name, plan) in WALKING {
        let mut c = walking(name, plan);
        steps(&mut c, 3000, |k, command, _| {
            assert!(command.hip_torque_nm.abs() < 30.0 * 50.0, "{name} {k} {}", command.hip_torque_nm);
            assert!(command.toe_position_m.iter().all(|m| (-0.01..0.06).contains(m)), "{name} {k} {command:?}");
        });
        for x in states() {
            for leg in [Leg::Inner, Leg::Outer] {
                assert!(torque(&mut c, &state(leg, x)).is_finite(), "{name} {x:?}");
            }
        }
    }
}

#[test]
fn walking_laws_give_the_same_bits_for_the_same_input() {
    for (name, plan) in WALKING {
        let mut bits = Vec::new();
        steps(&mut walking(name, plan), 2000, |_, command, _| bits.push(command.hip_torque_nm.to_bits()));
        steps(&mut walking(name, plan), 2000, |k, command, _| {
            assert_eq!(bits[k as usize], command.hip_torque_nm.to_bits(), "{name} {k}");
        });
    }
}

#[test]
fn walking_laws_show_a_state_that_is_not_finite() {
    for (name, plan) in WALKING {
        let mut c = walking(name, plan);
        steps(&mut c, 1600, |_, _, _| {});
        let e = Estimate { steps: 3, ..state(Leg::Outer, [f64::NAN, 0.0, 0.0, 0.0]) };
        let command = c.step(Stamp(1_600_000_000), &e, &Snapshot::default());
        assert!(!command.hip_torque_nm.is_finite(), "{name}");
    }
}

#[test]
fn the_law_that_chose_the_torque_is_told() {
    for ((name, plan), own) in WALKING.into_iter().zip([
        LawName::FootPlacement,
        LawName::VirtualConstraint,
        LawName::Transverse,
        LawName::Tvlqr,
    ]) {
        let mut laws = Vec::new();
        steps(&mut walking(name, plan), 1400, |_, _, state| laws.push(state.law));
        let first = if own == LawName::Tvlqr { LawName::Tvlqr } else { LawName::FootPlacement };
        assert_eq!((laws[10], laws[1200]), (first, own), "{name}");
    }
}

#[test]
fn plan_of_another_model_or_kind_is_refused_by_name() {
    let refusal = |keys: &[&str]| Controller::new(&config(keys)).unwrap_err().to_string();
    let other = refusal(&["control.controller=transverse", "robot.model.c4.value=0.1152"]);
    assert!(other.contains("gait_350mm_525mm_s") && other.contains("another model"), "{other}");
    let kind = refusal(&["control.controller=tvlqr"]);
    assert!(kind.contains("rebalance") && kind.contains("gait"), "{kind}");
}

#[test]
fn transverse_law_on_its_orbit_asks_for_the_planned_torque_and_friction() {
    let mut c = walking("transverse", "gait_350mm_525mm_s");
    let keys = ["control.controller=transverse"];
    let plan = planned::read(&config(&keys), "gait").unwrap();
    steps(&mut c, 1001, |_, _, _| {});
    // On the inner leg from its touchdown on, along the plan.
    let phase = plan.phases.iter().find(|phase| phase.inner_stands).unwrap();
    let friction = friction::Compensation::new(&config(&[]).robot.model, 1.0);
    let unit = config(&[]).robot.model.params().inertia_kg_m2();
    for k in 1..700_u32 {
        let node = phase.at(f64::from(k) * 1e-3);
        let e = Estimate { steps: 2, ..state(Leg::Inner, node.state) };
        let got = c.step(Stamp(1_000_000_000 + i64::from(k) * 1_000_000), &e, &Snapshot::default()).hip_torque_nm;
        let want = node.torque_nm + unit * friction.torque(node.state[2] - node.state[3]);
        if k > 30 {
            assert!((got - want).abs() < 0.2 + 0.02 * want.abs(), "{k}: {got} {want}");
        }
    }
}

/// The tree alone, and the step that catches alone.
const TREE: [&str; 3] =
    ["control.controller=lqr_tree", "control.recovery.tube_share=1.0", "control.recovery.catch=false"];
const CATCH: [&str; 3] =
    ["control.controller=lqr_tree", "control.recovery.tube_share=0.0", "control.recovery.catch=true"];

fn recovery(keys: &[&str]) -> Controller {
    Controller::new(&config(keys)).unwrap()
}

/// The rigid robot under a controller, semi-implicit steps of 1 ms, touchdown when the swing toe is out and its foot comes
/// down: is it standing after 4 s, and which laws were used?
fn recovers(c: &mut Controller, leg: Leg, x: [f64; 4]) -> (bool, bool) {
    use crate::model::compass_gait::dynamics::acceleration;
    use crate::model::compass_gait::impact;
    let config = config(&[]);
    let params = config.robot.model.params();
    let (unit, most) = (params.inertia_kg_m2(), config.robot.limits.hip_torque_nm);
    let (mut x, mut leg, mut tree, mut steps) = (x, leg, false, 0);
    c.reset(Stamp(0), &state(leg, x));
    for k in 0..4000 {
        let model = if leg == Leg::Inner { params } else { params.swapped() }.normalised();
        let now = Stamp(k * 1_000_000);
        let command = c.step(now, &Estimate { steps, ..state(leg, x) }, &Snapshot::default());
        tree |= c.state().law == LawName::Tree;
        let torque = motor_sign(leg) * command.hip_torque_nm.clamp(-most, most) / unit;
        let a = acceleration(&model, [x[0], x[1]], [x[2], x[3]], torque);
        let height = |x: &[f64; 4]| libm::cos(x[0]) - libm::cos(x[1]);
        let before = height(&x);
        (x[2], x[3]) = (x[2] + 1e-3 * a[0], x[3] + 1e-3 * a[1]);
        (x[0], x[1]) = (x[0] + 1e-3 * x[2], x[1] + 1e-3 * x[3]);
        let [inner, _, outer, _] = command.toe_position_m;
        let swing_m = if leg == Leg::Inner { outer } else { inner };
        let lands = swing_m > 0.02 && (x[0] - x[1]).abs() > 0.04 && before > 0.0 && height(&x) <= 0.0;
        if lands {
            x = impact::step(&model, &x).unwrap();
            leg = leg.other();
            steps += 1;
        }
        if x[0].abs() > 0.6 || x[1].abs() > 1.6 {
            return (false, tree);
        }
    }
    (x[0].abs() < 0.05 && x[2].abs() < 0.1, tree)
}

#[test]
fn tree_law_stands_up_by_a_step_where_balance_falls_and_by_another_integrator_too() {
    let (mut tree, mut balance) = (recovery(&TREE), controller("balance"));
    // Falling forward or backward, standing still but leaning, and swinging: all beyond balance.
    let states = [
        [-0.05, 0.1, -0.5, 0.5],
        [0.05, -0.1, 0.5, -0.5],
        [-0.1, 0.2, -0.3, 0.0],
        [0.15, -0.3, 0.2, 0.5],
        [-0.05, 0.3, -0.6, 0.5],
        [0.0, 0.2, -0.6, 1.0],
    ];
    let mut stands = 0;
    for x in states {
        for leg in [Leg::Inner, Leg::Outer] {
            assert!(!recovers(&mut balance, leg, x).0, "{leg:?} {x:?}");
            let (stood, used) = recovers(&mut tree, leg, x);
            assert!(used);
            stands += usize::from(stood);
        }
    }
    // 7 with the tree in the program; it does not cover all of the box.
    assert!(stands >= 6, "{stands} of 12");
    // In its basin balance is the law, and hands over to nothing.
    let (stood, used) = recovers(&mut tree, Leg::Inner, [0.02, 0.05, -0.02, 0.1]);
    assert!(stood && !used);
}

#[test]
fn step_that_catches_goes_where_the_robot_falls_and_says_that_it_is_not_the_tree() {
    for (lean, forward) in [(-0.1, true), (0.1, false)] {
        for leg in [Leg::Inner, Leg::Outer] {
            let mut c = recovery(&CATCH);
            let e = state(leg, [lean, 0.0, 4.0 * lean, 0.0]);
            c.reset(Stamp(0), &e);
            c.step(Stamp(0), &e, &Snapshot::default());
            let ControlState { law, motion, swing_goal_rad, .. } = *c.state();
            assert!(law == LawName::FootPlacement && motion == Motion::Recover, "{leg:?} {lean}");
            // A robot that falls forward falls to negative angles, and its swing leg goes to positive ones.
            assert!(swing_goal_rad.abs() > 0.05 && (swing_goal_rad > 0.0) == forward, "{swing_goal_rad}");
        }
    }
}

#[test]
fn a_tree_of_other_toes_is_refused_where_it_is_followed() {
    let made = |share: &str| {
        let share = format!("control.recovery.tube_share={share}");
        let keys = ["control.controller=lqr_tree", "robot.toe.acceleration_limit_m_s2=2.0", &share];
        Controller::new(&config(&keys))
    };
    let error = made("1.0").unwrap_err().to_string();
    assert!(error.contains("acceleration_m_s2 = 5.0, here 2.0"), "{error}");
    assert!(made("0.0").is_ok(), "a step catches, without the tree");
}

#[test]
fn tube_is_taken_at_the_share_of_its_level_that_is_asked_for() {
    // A planned state of the tree, and one beside it.
    let tree = |c: &Config| {
        tree::Tree::new(&tree::file::TreeFile::parse("t", &c.control.tree.text, &c.robot.model.params()).unwrap())
    };
    let c = config(&TREE);
    let branch = tree(&c).branches.into_iter().find(|branch| branch.touchdown).unwrap();
    let law = |share: &str, off: f64| {
        let mut c = recovery(&["control.controller=lqr_tree", "control.recovery.catch=true", share]);
        let mut x = branch.nodes[0].state;
        x[0] += off;
        let e = state(branch.stance, x);
        c.reset(Stamp(0), &e);
        c.step(Stamp(0), &e, &Snapshot::default());
        c.state().law
    };
    assert_eq!(law("control.recovery.tube_share=1.0", 0.0), LawName::Tree);
    assert_eq!(law("control.recovery.tube_share=0.0", 0.0), LawName::FootPlacement);
    assert_eq!(law("control.recovery.tube_share=1.0", 0.6), LawName::FootPlacement);
}

#[test]
fn recovery_is_mirrored_finite_and_does_not_hide_what_is_not() {
    for keys in [TREE, CATCH] {
        let mut c = recovery(&keys);
        for x in states() {
            for leg in [Leg::Inner, Leg::Outer] {
                let mut ask = |x: [f64; 4]| {
                    c.reset(Stamp(0), &state(leg, x));
                    torque(&mut c, &state(leg, x))
                };
                let (one, other) = (ask(x), ask(x.map(|v| -v)));
                assert!(one.is_finite() && (one + other).abs() <= 1e-9 * one.abs(), "{keys:?} {x:?} {one} {other}");
            }
        }
        assert!(!torque(&mut c, &state(Leg::Inner, [f64::NAN, 0.0, 0.0, 0.0])).is_finite());
    }
}

#[test]
fn supervisor_recovers_along_the_tree_and_stands_again() {
    let keys = ["control.controller=walk", "control.walk.recover=true", "control.walk.speed_m_s=0.0"];
    let [_, share, catch] = TREE;
    let mut c = recovery(&[keys[0], keys[1], keys[2], share, catch]);
    let (stood, used) = recovers(&mut c, Leg::Inner, [-0.05, 0.1, -0.5, 0.5]);
    assert!(stood && used && c.state().motion == Motion::Stand);
}

#[test]
fn tree_of_another_model_is_refused_by_name() {
    let keys = ["control.controller=lqr_tree".to_owned(), "robot.model.c4.value=0.1152".to_owned()];
    let error = Controller::new(&load(None, &keys).unwrap().config).unwrap_err().to_string();
    assert!(error.contains("control.tree") && error.contains("another model"), "{error}");
    // The recorded configuration holds the tree.
    let one = load(None, &["control.controller=lqr_tree".to_owned()]).unwrap();
    assert!(one.text.contains("compass-tree-1") && !load(None, &[]).unwrap().text.contains("compass-tree-1"));
}

#[test]
fn a_gait_that_turns_back_before_the_vertical_is_caught_by_foot_placement() {
    for (name, own) in [("virtual_constraint", LawName::VirtualConstraint), ("transverse", LawName::Transverse)] {
        let mut c = walking(name, "gait_350mm_525mm_s");
        steps(&mut c, 1100, |_, _, _| {});
        let mut law = |k: i64, x: [f64; 4]| {
            let e = Estimate { steps: 2, ..state(Leg::Inner, x) };
            c.step(Stamp(k * 1_000_000), &e, &Snapshot::default());
            c.state().law
        };
        assert_eq!(law(1100, [0.1, 0.0, -0.5, 0.5]), own, "{name}");
        assert_eq!(law(1101, [0.1, 0.0, 0.1, 0.5]), LawName::FootPlacement, "{name}");
    }
}
