//! Time of a look-up in an LQR-tree, by nodes and instruction set, beside the plain loop over nodes.
//!
//!     cargo run --release --example tree_lookup
//!
//! Each look-up is of another state. "warm": one after the other, the table stays in the cache. "in a tick": before each
//! one 4 MB of other memory are written, as other work of a millisecond would do at worst.
#![expect(clippy::print_stdout, reason = "a bench prints")]

use compass::control::tree::scan::{Isa, Scan};
use compass::control::tree::{Branch, Node, State};
use compass::msg::Leg;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::hint::black_box;
use std::time::Instant;

/// Look-ups per figure.
const COUNT: usize = 4000;

fn state(rng: &mut ChaCha8Rng) -> State {
    [0.3, 0.5, 1.0, 2.0].map(|half| half * (2.0 * rng.random::<f64>() - 1.0))
}

/// Random nodes with forms as badly conditioned as real ones.
fn branch(rng: &mut ChaCha8Rng, nodes: usize) -> Branch {
    let node = |rng: &mut ChaCha8Rng| {
        let row = state(rng);
        let mut cost = [0.0; 10];
        let mut at = 0;
        for i in 0..4 {
            for j in i..4 {
                cost[at] = 1e3 * row[i] * row[j] + if i == j { 1.0 } else { 0.0 };
                at += 1;
            }
        }
        Node { state: state(rng), cost, level: 0.1 + 20.0 * rng.random::<f64>(), ..Node::default() }
    };
    let nodes = (0..nodes).map(|_| node(rng)).collect();
    Branch { stance: Leg::Inner, duration_s: 1.0, touchdown: false, next: None, nodes }
}

/// The plain loop: every node, both images.
fn plain(branches: &[Branch], x: &State) -> f64 {
    let shares = branches.iter().flat_map(|branch| &branch.nodes);
    shares.fold(f64::INFINITY, |best, node| best.min(node.share(x)).min(node.mirrored().share(x)))
}

/// Median and 99th percentile, µs.
fn measure(states: &[State], cold: &mut [u64], is_cold: bool, look: impl Fn(&State) -> f64) -> [f64; 2] {
    let mut times: Vec<f64> = states
        .iter()
        .map(|x| {
            if is_cold {
                cold.iter_mut().step_by(8).for_each(|word| *word = word.wrapping_add(1));
                black_box(&*cold);
            }
            let begin = Instant::now();
            black_box(look(black_box(x)));
            begin.elapsed().as_secs_f64() * 1e6
        })
        .collect();
    times.sort_by(f64::total_cmp);
    [times[times.len() / 2], times[times.len() * 99 / 100]]
}

fn main() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let states: Vec<State> = (0..COUNT).map(|_| state(&mut rng)).collect();
    let mut cold = vec![0_u64; 1 << 19];
    println!("nodes   how          warm p50   p99     in a tick p50   p99   µs    plain loop over it (warm p50)");
    for nodes in [500, 5000, 50_000] {
        let branches: Vec<Branch> = (0..nodes / 10).map(|_| branch(&mut rng, 10)).collect();
        let mut told = |how: &str, of: Option<f64>, look: &dyn Fn(&State) -> f64| {
            let warm = measure(&states, &mut cold, false, look);
            let tick = measure(&states, &mut cold, true, look);
            let ratio = of.map_or(String::new(), |of| format!("{:.1}", of / warm[0]));
            println!(
                "{nodes:>6}  {how:<10} {:>10.2} {:>7.2} {:>13.2} {:>7.2}        {ratio}",
                warm[0], warm[1], tick[0], tick[1]
            );
            warm[0]
        };
        let reference = told("plain loop", None, &|x| plain(&branches, x));
        for isa in Isa::available() {
            let scan = Scan::new(&branches, Leg::Inner, Isa::Baseline).with(isa);
            told(&format!("{isa:?}"), Some(reference), &|x| scan.best(x).map_or(f64::NAN, |found| found.share));
        }
    }
}
