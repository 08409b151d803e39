//! L8: the command line. One file per subcommand: `Args` as typed, `run` does the work and says how it ended.
//!
//! To add a subcommand: a file with `pub(crate) struct Args` (`clap::Args`, examples in `after_help`) and
//! `impl Run for Args`, a `mod` line, a variant of [`Command`], an arm in its `run`.
//! Data goes to stdout by `writeln!` (an error there travels up, a broken pipe ends quietly), talk goes to stderr.
//! RT: no.

mod bench;
mod check_config;
pub mod config_args;
mod diagnose;
mod doctor;
mod experiment;
mod faults;
mod identify;
mod imu_probe;
mod inspect;
mod operator;
mod outcome;
mod output;
mod plan;
mod plant;
mod predict;
pub mod progress;
mod refused;
mod remote;
mod replay;
mod resplit;
mod run;
mod score;
mod sim;
mod simulate;
mod trial;
mod warn;
mod watch;
mod zero;

use clap::builder::RangedU64ValueParser;
use clap::{Parser, Subcommand};
use std::process::ExitCode;

pub use outcome::{Outcome, UsageError};

/// Runs a dynamic walking robot in hard real time and tells why it does not behave like its simulation.
#[derive(Parser)]
#[command(
    version,
    arg_required_else_help = true,
    after_help = "\
Exit codes: 0 fine, 1 finding (mismatch, limit exceeded), 2 usage or configuration, 3 input or device, 70 internal."
)]
struct Cli {
    /// What to do.
    #[command(subcommand)]
    command: Command,
}

/// The subcommands, as `--help` lists them: the robot, what one does around it, then models and diagnosis.
#[derive(Subcommand)]
enum Command {
    Run(Box<run::Args>),
    Plant(plant::Args),
    Operator(operator::Args),
    Watch(watch::Args),
    Remote(remote::Args),
    Zero(zero::Args),
    Sim(sim::Args),
    Experiment(experiment::Args),
    Replay(replay::Args),
    Inspect(inspect::Args),
    Doctor(doctor::Args),
    Plan(plan::Args),
    Bench(bench::Args),
    CheckConfig(check_config::Args),
    Predict(predict::Args),
    Simulate(simulate::Args),
    Identify(identify::Args),
    Diagnose(diagnose::Args),
    Trial(trial::Args),
    Score(score::Args),
}

impl Run for Command {
    fn run(self) -> anyhow::Result<Outcome> {
        match self {
            Self::Run(args) => args.run(),
            Self::Plant(args) => args.run(),
            Self::Operator(args) => args.run(),
            Self::Watch(args) => args.run(),
            Self::Remote(args) => args.run(),
            Self::Zero(args) => args.run(),
            Self::Sim(args) => args.run(),
            Self::Experiment(args) => args.run(),
            Self::Replay(args) => args.run(),
            Self::Inspect(args) => args.run(),
            Self::Doctor(args) => args.run(),
            Self::Plan(args) => args.run(),
            Self::Bench(args) => args.run(),
            Self::CheckConfig(args) => args.run(),
            Self::Predict(args) => args.run(),
            Self::Simulate(args) => args.run(),
            Self::Identify(args) => args.run(),
            Self::Diagnose(args) => args.run(),
            Self::Trial(args) => args.run(),
            Self::Score(args) => args.run(),
        }
    }
}

/// Reads a whole number from 1 to `most`.
fn from_one<T>(most: u32) -> RangedU64ValueParser<T>
where
    T: TryFrom<u64> + Clone + Send + Sync + 'static,
    <T as TryFrom<u64>>::Error: std::error::Error + Send + Sync + 'static,
{
    RangedU64ValueParser::new().range(1..=u64::from(most))
}

/// Threads, or cases at the same time: more than any machine has use for.
const MOST_JOBS: u32 = 1024;

/// A subcommand, ready to go.
trait Run {
    /// Does it.
    fn run(self) -> anyhow::Result<Outcome>;
}

/// Parses the arguments, runs the subcommand, reports a failure once, returns the exit code.
#[must_use]
pub fn main() -> ExitCode {
    // clap prints help, version and usage errors itself and exits with 0 or 2.
    let command = Cli::parse().command;
    outcome::exit_code(|| command.run())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    /// What is said of a command line that must end with exit code 2.
    pub(super) fn usage_error(arguments: &[&str]) -> String {
        let cli = match Cli::try_parse_from(["compass"].iter().chain(arguments)) {
            Ok(cli) => cli,
            // clap itself ends with 2.
            Err(error) => return error.to_string(),
        };
        let error = cli.command.run().expect_err(&arguments.join(" "));
        assert!(outcome::is_usage(&error), "{arguments:?} would end with 3: {error:#}");
        format!("{error:#}")
    }

    #[test]
    fn command_tree_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn every_subcommand_shows_an_example() {
        for command in Cli::command().get_subcommands() {
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            assert!(
                help.contains(&format!("compass {}", command.get_name())),
                "no example in `{}`",
                command.get_name()
            );
        }
    }

    #[test]
    fn none_of_something_that_must_be_is_refused_with_what_is_allowed() {
        for line in [
            &["trial", "--cases", "0"][..],
            &["trial", "--jobs", "0"],
            &["trial", "--resplit", "c", "--truth", "t", "--variants", "0"],
            &["experiment", "e.toml", "--out", "o", "--jobs", "0"],
            &["score", "c", "--truth", "t", "--jobs", "0"],
            &["sim", "--soak", "0"],
        ] {
            let error = usage_error(line);
            assert!(error.contains("invalid value '0'") && error.contains("0 is not in 1..="), "{line:?}: {error}");
        }
        let error = usage_error(&["trial", "--seconds", "1", "--out", "/nowhere/trial"]);
        assert!(error.contains("--seconds 1: must be 2 to 600 s"), "{error}");
    }

    #[test]
    fn a_score_without_any_truth_is_refused_before_the_first_diagnosis() {
        let cases = concat!(env!("CARGO_MANIFEST_DIR"), "/cases");
        let error = usage_error(&["score", cases, "--truth", "/nowhere/truth"]);
        assert!(error.contains("--truth: /nowhere/truth: must be a folder with CASE.json or CASE.toml"), "{error}");
    }
}
