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
#[cfg(test)]
mod laws;
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
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
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
    let cli = Cli::from_arg_matches(&command_line().get_matches()).unwrap_or_else(|error| error.exit());
    outcome::exit_code(|| cli.command.run())
}

/// What may be typed.
fn command_line() -> clap::Command {
    with_negative_numbers(Cli::command())
}

/// Every option takes a negative number too, so that its own range is told and not that the argument is unexpected.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let options = command.mut_args(|arg| {
        let is_option = arg.get_action().takes_values() && !arg.is_positional();
        if is_option { arg.allow_negative_numbers(true) } else { arg }
    });
    options.mut_subcommands(with_negative_numbers)
}

/// Reads a seed.
fn seed(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| format!("must be a whole number, 0 to {}", u64::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is said of a command line that must end with exit code 2.
    pub(super) fn usage_error(arguments: &[&str]) -> String {
        let typed = command_line().try_get_matches_from(["compass"].iter().chain(arguments));
        let cli = match typed.and_then(|matches| Cli::from_arg_matches(&matches)) {
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
        command_line().debug_assert();
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
    fn a_negative_number_is_told_what_is_allowed() {
        let seeds = "must be a whole number, 0 to 18446744073709551615";
        for (line, told) in [
            (&["sim", "--seed", "-1"][..], seeds),
            (&["diagnose", "c", "--seed", "-1"], seeds),
            (&["simulate", "r", "--input", "i", "--out", "o", "--seed", "-1"], seeds),
            (&["trial", "--seed", "-1"], seeds),
            (&["plan", "tree", "--out", "o", "--seed", "-1"], seeds),
            (&["sim", "--for", "-5"], "'-5' for '--for <TIME>': must be 0 or more"),
            (&["run", "--for", "-5"], "'-5' for '--for <TIME>': must be 0 or more"),
            (&["plan", "gait", "--step", "-0.4", "--speed", "0.4", "--out", "o"], "--step -0.4: must be more than 0"),
            (&["predict", "r", "--window-s", "-1"], "--window-s -1: must be above 0"),
            (
                &["plan", "rebalance", "--stance", "inner", "--from", "-0.1,0", "--out", "o"],
                "--from: 4 numbers, here are 2",
            ),
        ] {
            let error = usage_error(line);
            assert!(error.contains(told), "{line:?}: {error}");
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
