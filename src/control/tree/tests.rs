use super::file::{COLUMNS, FORMAT, TreeFile};
use super::scan::{Isa, Scan};
use super::*;
use crate::control::tables::model_hash;
use crate::model::compass_gait::params::Params;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn uniform(rng: &mut ChaCha8Rng, half: f64) -> f64 {
    half * (2.0 * rng.random::<f64>() - 1.0)
}

/// A branch of random nodes whose forms are as badly conditioned as real ones: 1 to 10⁴.
fn branch(rng: &mut ChaCha8Rng, stance: Leg, nodes: usize) -> Branch {
    let node = |rng: &mut ChaCha8Rng| {
        let axes: [[f64; 4]; 4] = std::array::from_fn(|_| std::array::from_fn(|_| uniform(rng, 1.0)));
        let weights = [1e4, 300.0, 20.0, 1.0];
        let entry = |i: usize, j: usize| (0..4).map(|k| weights[k] * axes[k][i] * axes[k][j]).sum::<f64>();
        let mut cost = [0.0; 10];
        let mut at = 0;
        for i in 0..4 {
            for j in i..4 {
                cost[at] = entry(i, j);
                at += 1;
            }
        }
        Node {
            state: [uniform(rng, 0.3), uniform(rng, 0.5), uniform(rng, 1.0), uniform(rng, 2.0)],
            rate: std::array::from_fn(|_| uniform(rng, 2.0)),
            torque: uniform(rng, 1.8),
            gain: std::array::from_fn(|_| uniform(rng, 50.0)),
            cost,
            level: 0.1 + 20.0 * rng.random::<f64>(),
        }
    };
    let nodes = (0..nodes).map(|_| node(rng)).collect();
    Branch { stance, duration_s: 0.5, touchdown: false, next: None, nodes }
}

fn forest(nodes: usize) -> Vec<Branch> {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let leg = |k: usize| if k.is_multiple_of(3) { Leg::Outer } else { Leg::Inner };
    (0..nodes / 7).map(|k| branch(&mut rng, leg(k), 7)).collect()
}

#[test]
fn look_up_is_the_linear_scan_on_every_instruction_set() {
    let branches = forest(3000);
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    for leg in [Leg::Inner, Leg::Outer] {
        let scans: Vec<Scan> = Isa::available().into_iter().map(|isa| Scan::new(&branches, leg, isa)).collect();
        for _ in 0..200 {
            let x = [uniform(&mut rng, 0.3), uniform(&mut rng, 0.5), uniform(&mut rng, 1.0), uniform(&mut rng, 2.0)];
            // One node after the other, both images, from the definition.
            let mut best = (f64::INFINITY, 0, 0, false);
            for (b, branch) in branches.iter().enumerate().filter(|(_, branch)| branch.stance == leg) {
                for (k, node) in branch.nodes.iter().enumerate() {
                    for (mirrored, node) in [(false, *node), (true, node.mirrored())] {
                        let share = node.share(&x);
                        if share < best.0 {
                            best = (share, b, k, mirrored);
                        }
                    }
                }
            }
            let first = scans[0].best(&x).unwrap();
            assert_eq!((first.branch as usize, first.node as usize, first.mirrored), (best.1, best.2, best.3));
            assert!((first.share - best.0).abs() < 1e-9 * (1.0 + best.0));
            for scan in &scans {
                let found = scan.best(&x).unwrap();
                assert_eq!(found.share.to_bits(), first.share.to_bits(), "the same bits on every instruction set");
                assert_eq!(found, first);
            }
            assert_eq!(scans[0].nearest(&x, 3)[0], first);
        }
    }
}

#[test]
fn look_up_of_nothing_or_of_no_number_finds_nothing() {
    assert!(Scan::default().best(&[0.0; 4]).is_none());
    let scan = Scan::new(&forest(70), Leg::Inner, Isa::detect());
    assert!(scan.best(&[f64::NAN, 0.0, 0.0, 0.0]).is_none());
    // Not a multiple of the lanes: what fills them up is never found.
    assert_ne!(scan.len() % scan::LANES, 0);
    assert!(scan.best(&[1e3, -1e3, 1e3, 1e3]).unwrap().share.is_finite());
}

fn tree_file() -> TreeFile {
    let row = |k: f32| {
        let mut row = [0.0; COLUMNS];
        (row[0], row[2], row[6], row[21]) = (0.1 - 0.1 * k, -0.1, k, 2.0);
        for diagonal in [11, 15, 18, 20] {
            row[diagonal] = 1.0;
        }
        row
    };
    let branch = |inner_stands, touchdown, next| file::BranchRow {
        inner_stands,
        duration_s: 3.0,
        touchdown,
        next,
        nodes: vec![row(0.0), row(1.0), row(2.0), row(3.0)],
    };
    let link = file::Link { branch: 1, mirrored: false, at_s: 1.0 };
    TreeFile {
        format: FORMAT.into(),
        command: "test".into(),
        model_hash: model_hash(&Params::sysid()),
        terms: "test".into(),
        seed: 1,
        hip_torque_nm: 30.0,
        goal: [[1e6, 0.0, 0.0, 0.0, 1e6, 0.0, 0.0, 1e6, 0.0, 1e6]; 2],
        goal_level: 1.0,
        counts: file::Counts::default(),
        branches: vec![branch(true, true, Some(link)), branch(false, false, None)],
    }
}

#[test]
fn tree_comes_back_to_the_bit_and_a_broken_one_is_refused_by_name() {
    let tree = tree_file();
    let text = tree.to_text().unwrap();
    assert_eq!(TreeFile::parse("f", &text, &Params::sysid()).unwrap(), tree);
    let mut other = Params::sysid();
    other.c[3] += 1e-6;
    assert!(TreeFile::parse("my.tree", &text, &other).unwrap_err().to_string().contains("another model"));
    // The end of branch 0 lies on the leg that does not stand after a touchdown.
    let odd = text.replace("\"touchdown\":true", "\"touchdown\":false");
    let error = TreeFile::parse("my.tree", &odd, &Params::sysid()).unwrap_err().to_string();
    assert!(error.contains("my.tree") && error.contains("branch 0"), "{error}");
    assert!(TreeFile::parse("f", &text.replace("\"branch\":1", "\"branch\":9"), &Params::sysid()).is_err());
}

#[test]
fn follower_goes_with_the_state_and_over_a_touchdown() {
    let tree = Tree::new(&tree_file());
    let mut follower = follow::Follower::default();
    follower.reset();
    // Slower than the clock: the state stays at the place of t = 1, and so does the follower.
    let x = [0.0, 0.0, -0.1, 0.0];
    for _ in 0..400 {
        let follow::Action::Follow(step) = follower.step(&tree, &x, Leg::Inner, 0.01, &follow::Rule::ALONE) else {
            panic!("lost")
        };
        assert!((step.place.at_s - 1.0).abs() < 0.02 && (step.torque - 1.0).abs() < 0.02, "{step:?}");
        assert!(step.lands_in_s.is_some_and(|left| (left - 2.0).abs() < 0.02));
    }
    // The other leg stands: the branch that the touchdown leads to.
    let follow::Action::Follow(step) = follower.step(&tree, &x, Leg::Outer, 0.01, &follow::Rule::ALONE) else {
        panic!("lost")
    };
    assert!(step.place.branch == 1 && step.lands_in_s.is_none());
    // The mirrored state is answered by the mirrored torque.
    let mut mirrored = follow::Follower::default();
    mirrored.reset();
    let ahead = [-0.05, 0.02, 0.1, 0.3];
    let mut plain = mirrored;
    let (a, b) = (
        mirrored.step(&tree, &ahead, Leg::Inner, 0.0, &follow::Rule::ALONE),
        plain.step(&tree, &ahead.map(|x| -x), Leg::Inner, 0.0, &follow::Rule::ALONE),
    );
    let (follow::Action::Follow(a), follow::Action::Follow(b)) = (a, b) else { panic!("lost") };
    assert!(a.place.mirrored != b.place.mirrored && (a.torque + b.torque).abs() < 1e-12);
}

#[test]
fn a_share_of_zero_takes_no_tube_even_for_a_state_on_a_branch() {
    let tree = Tree::new(&tree_file());
    let (never, always) = (follow::Rule::beside_another(0.0), follow::Rule::beside_another(1.0));
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let mut below_zero = false;
    for k in 0..1000 {
        let node = tree.branches[0].nodes[k % 4];
        let x = node.state.map(|x| x + uniform(&mut rng, 1e-9));
        below_zero |= tree.scan(Leg::Inner).best(&x).is_some_and(|found| found.share < 0.0);
        let action = |rule| follow::Follower::default().step(&tree, &x, Leg::Inner, 0.03, rule);
        assert_eq!(action(&never), follow::Action::Lost);
        assert!(matches!(action(&always), follow::Action::Follow(_)));
    }
    assert!(below_zero, "what it is about");
}

#[test]
fn branch_meets_its_nodes_and_its_rate_between_them() {
    let tree = Tree::new(&tree_file());
    let branch = &tree.branches[0];
    for k in 0..4u8 {
        let t = f64::from(k);
        assert!((branch.at(t).state[0] - (0.1 - 0.1 * t)).abs() < 1e-7 && branch.nearest(t) == usize::from(k));
    }
    let slope = (branch.at(1.5 + 1e-4).state[0] - branch.at(1.5 - 1e-4).state[0]) / 2e-4;
    assert!((slope + 0.1).abs() < 1e-6 && (branch.at(9.0).state[0] + 0.2).abs() < 1e-7);
}
