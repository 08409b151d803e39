//! `compass plan tree`: grows an LQR-tree, and measures what it covers. RT: no.

use super::super::config_args::ConfigArgs;
use super::super::output::spare_inputs;
use super::super::{Outcome, UsageError, from_one, progress, seed};
use crate::config::checked::Config;
use crate::design::tree::coverage::{Coverage, check};
use crate::design::tree::grow::Grower;
use crate::design::tree::{Terms, journal};
use std::io::{self, Write};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// An LQR-tree: from random states upright, by up to two steps
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass plan tree --samples 20000 --out recovery.tree
  compass plan tree --samples 306422 --out recovery.tree    goes on with the same file
  compass plan tree --samples 0 --check 2000 --out recovery.tree")]
pub(super) struct Args {
    /// The tree; if the file exists, it is gone on with
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Samples in all, those in the file included; more to the end of a batch (2048 at most)
    #[arg(long, value_name = "N", default_value_t = 20_000)]
    samples: u64,
    /// Seed of the samples; the same seed gives the same tree, on any number of cores
    #[arg(long, default_value_t = 1, value_parser = seed)]
    seed: u64,
    /// The tree is full with so many nodes: uncovered samples are counted, but not planned for
    #[arg(long, value_name = "N", default_value_t = 6000, value_parser = from_one::<usize>(MOST_NODES))]
    nodes: usize,
    /// Fresh states to check the tree with afterwards
    #[arg(long, value_name = "N", default_value_t = 0)]
    check: u64,
    /// Time that the planner has for each state that the tree misses, s
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    patience: f64,
    /// Friction of foot on floor
    #[arg(long, value_name = "MU", default_value_t = 0.6)]
    friction: f64,
    #[command(flatten)]
    config: ConfigArgs,
}

/// Most nodes of a tree: a look-up takes some 0.1 ms then, and the text still fits into what `watch --socket` reads.
const MOST_NODES: u32 = 40_000;
/// The file is written this often.
const EVERY: Duration = Duration::from_secs(10);
/// The check's states are of another seed: this far from the growth's.
const CHECK_SEED: u64 = 1 << 32;

impl Args {
    pub(super) fn run(&self) -> anyhow::Result<Outcome> {
        let patience = Duration::try_from_secs_f64(self.patience)
            .map_err(|_| UsageError(format!("--patience {}: must be 0 or more", self.patience)))?;
        if !(self.friction.is_finite() && self.friction > 0.0) {
            return Err(UsageError(format!("--friction {}: must be positive", self.friction)).into());
        }
        // The tree itself is gone on with.
        spare_inputs("--out", [&self.out], &self.config.files())?;
        let config = self.config.load()?.config;
        let terms = self.terms(&config);
        let command: Vec<String> = std::env::args().skip(1).collect();
        let mut grower = journal::open(&self.out, &terms, &format!("compass {}", command.join(" ")))?;
        let (before, begin) = (grower.file().counts.samples, Instant::now());
        self.grow(&mut grower)?;
        let mut out = io::stdout().lock();
        tell(&mut out, &grower, before, begin.elapsed())?;
        if self.check > 0 {
            let begin = Instant::now();
            let spinner = progress::spinner("checking fresh states");
            let coverage = check(grower.ground(), grower.tree(), self.seed + CHECK_SEED, self.check, patience);
            spinner.finish_and_clear();
            tell_coverage(&mut out, &coverage, patience, begin.elapsed())?;
        }
        writeln!(out, "{}", self.out.display())?;
        Ok(Outcome::Fine)
    }

    fn terms(&self, config: &Config) -> Terms {
        let notes = Terms::notes(config.robot.model.params());
        let toe = &config.robot.toe;
        Terms {
            hip_torque_nm: config.robot.limits.hip_torque_nm,
            compensation: config.control.friction_compensation,
            friction: self.friction,
            toe: notes.toe.with_toe(toe.extended_m, toe.rate_limit_m_s, toe.acceleration_limit_m_s2),
            most_nodes: self.nodes,
            seed: self.seed,
            ..notes
        }
    }

    fn grow(&self, grower: &mut Grower) -> Result<(), journal::JournalError> {
        let bar = progress::bar(self.samples, "samples");
        let mut written = Instant::now();
        while grower.file().counts.samples < self.samples {
            grower.batch();
            bar.set_position(grower.file().counts.samples);
            if written.elapsed() > EVERY {
                journal::write(&self.out, grower.file())?;
                written = Instant::now();
            }
        }
        bar.finish_and_clear();
        journal::write(&self.out, grower.file())
    }
}

fn tell(out: &mut impl Write, grower: &Grower, before: u64, took: Duration) -> io::Result<()> {
    let c = &grower.file().counts;
    writeln!(out, "samples      {:>8}", c.samples)?;
    for (what, count) in [
        ("covered", c.covered),
        ("  at once", c.balanced),
        ("refused", c.refused),
        ("impossible", c.impossible),
        ("infeasible", c.infeasible),
        ("grown", c.grown),
        ("unstable", c.unstable),
        ("full", c.full),
    ] {
        #[expect(clippy::cast_precision_loss, reason = "a share in per cent")]
        let share = 100.0 * count as f64 / c.samples.max(1) as f64;
        writeln!(out, "{what:<12} {count:>8}  {share:5.1} %")?;
    }
    let (branches, nodes) = (grower.file().branches.len(), grower.tree().nodes());
    writeln!(out, "{branches} branches, {nodes} nodes; {} solves, {} tubes cut", c.solves, c.cuts)?;
    writeln!(out, "{} samples in {:.1} s", c.samples - before, took.as_secs_f64())
}

fn tell_coverage(out: &mut impl Write, c: &Coverage, patience: Duration, took: Duration) -> io::Result<()> {
    writeln!(out, "check        {:>8}  fresh states, planner given {} s each", c.states, patience.as_secs_f64())?;
    writeln!(out, "recovered    {:>8}", c.recovered)?;
    writeln!(out, "missed       {:>8}  the planner finds a way", c.missed)?;
    writeln!(out, "lost         {:>8}  proven, or no state of the robot", c.lost)?;
    writeln!(out, "open         {:>8}  no way found, none excluded", c.open)?;
    writeln!(out, "coverage     {:>8.1} %  in {:.1} s", 100.0 * c.share(), took.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        tree: Args,
    }

    fn terms(more: &[&str]) -> Terms {
        let args = Line::parse_from([&["test", "--out", "no.tree"], more].concat()).tree;
        args.terms(&args.config.load().unwrap().config)
    }

    #[test]
    fn a_tree_is_grown_for_the_toe_that_the_robot_has_and_its_terms_tell() {
        let built_in = include_str!("../../../config/plans/recovery.tree");
        let ours = terms(&[]).text();
        assert!(built_in.contains(&format!("\"terms\":\"{ours}\"")), "the tree in the program is gone on with: {ours}");
        for (key, told) in [
            ("robot.toe.acceleration_limit_m_s2=2.0", "acceleration_m_s2: 2.0"),
            ("robot.toe.rate_limit_m_s=0.3", "rate_m_s: 0.3,"),
            ("robot.toe.extended_m=0.025", "retract_m: 0.025"),
        ] {
            let other = terms(&["--set", key]).text();
            assert!(other.contains(told) && other != ours, "{other}");
        }
    }
}
