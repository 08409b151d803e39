use super::connect::{EFFORT, plan};
use super::grow::Grower;
use super::refuse::{is_impossible, is_lost};
use super::simulate::{balances, run};
use super::*;
use crate::control::tree::Tree;
use crate::control::tree::file::TreeFile;
use crate::model::compass_gait::dynamics::{acceleration_without_friction, friction};

fn terms() -> Terms {
    Terms { most_nodes: 400, ..Terms::notes(Params::sysid()) }
}

#[test]
fn unstable_mode_is_that_of_the_notes() {
    let ground = Ground::new(&terms()).unwrap();
    // Section 8: z_u = θs - .0635 θw + .3142 θ̇s - .0199 θ̇w (inner), 1, -.0657, .3198, -.0210 (outer).
    for (leg, want) in [(Leg::Inner, [1.0, -0.0635, 0.3142, -0.0199]), (Leg::Outer, [1.0, -0.0657, 0.3198, -0.0210])] {
        let unit = |i: usize| std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 });
        for i in 0..4 {
            assert!((ground.fall(&unit(i), leg) - want[i]).abs() < 6e-5);
        }
    }
}

#[test]
fn balance_recovers_from_the_level_that_ends_a_branch() {
    let ground = Ground::new(&terms()).unwrap();
    for k in 0..60 {
        let (x, leg) = sample(11, k);
        let c = ground.balance_cost(leg);
        let v = nalgebra::Vector4::from(x);
        let scale = (ground.terms.goal_level / (v.transpose() * c * v)[0]).sqrt();
        let x = x.map(|x| scale * x);
        assert!(x[1].abs() > 1.0 || balances(&ground, &x, leg, 4.0), "{leg:?} {x:?}");
    }
}

/// Touchdowns or standing up in a crowd of motions: bang-bang torque switched at random, semi-implicit steps of 1 ms.
fn some_motion_steps(ground: &Ground, x0: &State, leg: Leg, rng: &mut ChaCha8Rng) -> bool {
    let model = ground.model(leg);
    let most = ground.torque_limit();
    let mut x = *x0;
    let mut motor = if rng.random::<bool>() { most } else { -most };
    let mut y = x[0] + x[1];
    for _ in 0..1500 {
        if rng.random::<f64>() < 0.008 {
            motor = -motor;
        }
        // Compensated friction, as the planner has it: what the motor gives beyond it is the net torque.
        let net = motor + friction(model, x[2] - x[3]);
        let a = acceleration_without_friction(model, [x[0], x[1]], [x[2], x[3]], net);
        (x[2], x[3]) = (x[2] + 1e-3 * a[0], x[3] + 1e-3 * a[1]);
        (x[0], x[1]) = (x[0] + 1e-3 * x[2], x[1] + 1e-3 * x[3]);
        let now = x[0] + x[1];
        let spread = 2.0 * 1.045 * libm::sin(-x[0]);
        if now * y <= 0.0 && (0.06..0.59).contains(&spread) {
            return true;
        }
        y = now;
        if x[0] < -0.45 || x[1].abs() > 1.3 {
            return false;
        }
    }
    // Still up after 1.5 s.
    true
}

#[test]
fn what_is_proven_lost_is_lost_to_crowds_of_motions_and_to_the_planner() {
    let ground = Ground::new(&terms()).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let (mut lost, mut saved) = (0, 0);
    for k in 0..300 {
        let (x, leg) = sample(12, k);
        let x = if ground.fall(&x, leg) > 0.0 { x.map(|x| -x) } else { x };
        let crowd = (0..40).any(|_| some_motion_steps(&ground, &x, leg, &mut rng));
        if is_lost(&ground, &x, leg) {
            lost += 1;
            assert!(!crowd, "{leg:?} {x:?}");
            assert!(k >= 60 || plan(&ground, &x, leg, EFFORT, 0.35).0.is_none(), "{leg:?} {x:?}");
        }
        saved += usize::from(crowd);
        // Mirrored states are lost together.
        assert_eq!(is_lost(&ground, &x, leg), is_lost(&ground, &x.map(|x| -x), leg));
    }
    assert!(lost > 20 && saved > 100, "{lost} {saved}");
}

#[test]
fn foot_in_the_floor_is_no_state() {
    let ground = Ground::new(&terms()).unwrap();
    // 1.045 (1 - cos 0.28) = 40.7 mm below, toe in by 30 mm; 1.045 (1 - cos 0.2) = 20.8 mm.
    assert!(is_impossible(&ground, &[0.28, 0.0, 0.0, 0.0]) && !is_impossible(&ground, &[0.2, 0.0, 0.0, 0.0]));
}

fn grown(threads: usize, stops: &[u64]) -> TreeFile {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let mut file = None;
        for stop in stops {
            let mut grower = match file {
                None => Grower::new(&terms(), "test").unwrap(),
                Some(file) => Grower::resume(&terms(), file).unwrap(),
            };
            while grower.file().counts.samples < *stop {
                grower.batch();
            }
            // As the journal has it: through the text.
            let text = grower.file().to_text().unwrap();
            file = Some(TreeFile::parse("f", &text, &Params::sysid()).unwrap());
        }
        file.unwrap()
    })
}

#[test]
fn same_seed_gives_the_same_tree_on_any_threads_and_after_a_stop() {
    let one = grown(1, &[64]);
    // Also after a stop that was asked for within a batch.
    assert_eq!(one, grown(3, &[20, 50]));
    let c = &one.counts;
    assert_eq!(c.samples, c.covered + c.refused + c.impossible + c.infeasible + c.grown + c.unstable + c.full);
    assert!(c.grown >= 2 && c.covered > 10 && c.unstable <= c.grown + 2, "{c:?}");
    // Every branch leads upright from its first state, by the law on the robot.
    let (ground, tree) = (Ground::new(&terms()).unwrap(), Tree::new(&one));
    let inner = tree.branches.iter().filter(|branch| branch.stance == Leg::Inner).count();
    assert!(inner > 0 && inner < tree.branches.len());
    let held = |(k, branch): (usize, &crate::control::tree::Branch)| {
        let place = crate::control::tree::Place { branch: k as u32, mirrored: false, at_s: 0.0 };
        run(&ground, &tree, (branch.nodes[0].state, branch.stance), Some(place), &mut Vec::new()).upright
    };
    let held = tree.branches.iter().enumerate().filter(|branch| held(*branch)).count();
    assert!(held * 10 >= tree.branches.len() * 8, "{held} of {}", tree.branches.len());
}

#[test]
fn no_tube_is_larger_than_balance_and_every_cost_is_positive() {
    let tree = Tree::new(&grown(2, &[64]));
    for node in tree.branches.iter().flat_map(|branch| &branch.nodes) {
        assert!(node.level > 0.0 && node.level <= tree.goal_level, "{node:?}");
        let [aa, ab, ac, ad, bb, bc, bd, cc, cd, dd] = node.cost;
        let cost = Matrix4::new(aa, ab, ac, ad, ab, bb, bc, bd, ac, bc, cc, cd, ad, bd, cd, dd);
        assert!(cost.cholesky().is_some(), "{node:?}");
    }
}

#[test]
fn file_is_whole_or_not_there_and_other_terms_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tree");
    let file = grown(2, &[32]);
    journal::write(&path, &file).unwrap();
    // What a kill in the middle of writing leaves behind is not looked at.
    std::fs::write(folder.path().join("a.tree.part"), "half a tr").unwrap();
    assert_eq!(*journal::open(&path, &terms(), "test").unwrap().file(), file);
    let other = Terms { friction: 0.4, ..terms() };
    let error = journal::open(&path, &other, "test").unwrap_err().to_string();
    assert!(error.contains("a.tree") && error.contains("friction: 0.4"), "{error}");
}
