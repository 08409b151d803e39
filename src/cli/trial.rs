//! `compass trial`: hides physics in simulated recordings, diagnoses them without access to the truth, scores. RT: no.

use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use anyhow::{Context, bail};

use super::output::must_be_folder;
use super::resplit::Plan;
use super::score::{diagnose, find_cases, print, score};
use super::{MOST_JOBS, Outcome, Run, UsageError, from_one, progress, seed};
use crate::trial::generator::Recipe;
use crate::trial::score::Runner;
use crate::trial::seal::{Key, TrialFolder, hex, key_of};

/// Cases of a trial, or variants of a case.
const MOST_CASES: u32 = 100_000;

/// How often the generator's progress is looked at.
const LOOK: Duration = Duration::from_millis(200);

/// Prove the diagnosis on concealed physics: draw, seal, diagnose, open, score.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass trial --cases 12 --seed 7 --out /tmp/trial           a few minutes
  compass trial --cases 12 --seed 7 --out /tmp/trial --resume  after an interruption: the same truth, answers kept
  compass trial --write-only --healthy --cases 100 --seed 1 --out /tmp/healthy   (cases and open truth, for calibration)
  compass trial --resplit CASES --truth DIR --variants 6 --out /tmp/hardware
                                                               the same call again goes on after an interruption")]
pub(crate) struct Args {
    /// Number of cases.
    #[arg(long, default_value_t = 30, value_parser = from_one::<usize>(MOST_CASES))]
    cases: usize,
    /// Seed of everything that is drawn.
    #[arg(long, default_value_t = 1, value_parser = seed)]
    seed: u64,
    /// Where cases, answers and truth go.
    #[arg(long, default_value = "trial")]
    out: PathBuf,
    /// Diagnoses at the same time.
    #[arg(long, default_value_t = 2, value_parser = from_one::<usize>(MOST_JOBS))]
    jobs: usize,
    /// Length of every recording, s.
    #[arg(long, default_value_t = 6.0)]
    seconds: f64,
    /// Only healthy cases.
    #[arg(long, conflicts_with = "ill")]
    healthy: bool,
    /// Only cases with hidden effects.
    #[arg(long)]
    ill: bool,
    /// Write cases and their truth in the open, diagnose nothing.
    #[arg(long)]
    write_only: bool,
    /// Go on with an interrupted trial: the same arguments draw the same truth, and its hash must be the one published
    /// then; answers that are there are kept.
    #[arg(long, conflicts_with = "write_only")]
    resume: bool,
    /// Stop a diagnosis after so many seconds.
    #[arg(long, default_value_t = 180)]
    limit_s: u64,
    /// Write the table here as well.
    #[arg(long)]
    table: Option<PathBuf>,
    /// Split, cut and disturb the hardware cases of this folder instead, and ask for the same answers
    #[arg(long, value_name = "CASES", requires = "truth", conflicts_with_all = ["healthy", "ill", "write_only", "resume"])]
    resplit: Option<PathBuf>,
    /// What is known of the hardware cases (CASE.toml)
    #[arg(long, requires = "resplit", value_name = "DIR")]
    truth: Option<PathBuf>,
    /// Further recordings of the same machines, in folders named like the cases
    #[arg(long, requires = "resplit", value_name = "DIR")]
    recordings: Option<PathBuf>,
    /// Variants of each hardware case
    #[arg(long, requires = "resplit", default_value_t = 30, value_parser = from_one::<usize>(MOST_CASES))]
    variants: usize,
    /// Only hardware cases whose name contains this
    #[arg(long, requires = "resplit")]
    only: Option<String>,
    /// Do not fit the forbidden effects to settle what a variant can decide: quicker, and less is known
    #[arg(long, requires = "resplit")]
    no_rivals: bool,
    /// Be the generating process: the key comes on standard input.
    #[arg(long, hide = true)]
    generate: bool,
}

impl Run for Args {
    fn run(self) -> anyhow::Result<Outcome> {
        must_be_folder("--out", &self.out)?;
        if let Some((cases, truth)) = self.resplit.as_deref().zip(self.truth.as_deref()) {
            return self.resplit_plan(cases, truth).run();
        }
        let trial = TrialFolder::new(&self.out);
        if self.generate {
            return self.generate(&trial, read_key()?);
        }
        let key = fresh_key()?;
        // A truth that was published is never exchanged for another: it is drawn again beside the first.
        let drawn = if self.resume { self.out.join("redrawn") } else { self.out.clone() };
        let sealed = TrialFolder::new(&drawn);
        let before = if self.resume { Some(trial.published_hash().context("--resume: no trial here")?) } else { None };
        self.spawn_generator(&sealed, &drawn, key)?;
        let published = sealed.published_hash()?;
        if let Some(before) = before.filter(|before| *before != published) {
            bail!("--resume: other arguments or another version drew another truth (published then: {before})");
        }
        if self.write_only {
            sealed.open(key, &published)?;
            writeln!(std::io::stdout(), "{} cases in {}", self.cases, trial.cases().display())?;
            return Ok(Outcome::Fine);
        }
        writeln!(std::io::stdout(), "sha256 of the sealed truth: {published}")?;
        let cases = find_cases(&trial.cases(), None)?;
        let runner = Runner {
            program: std::env::current_exe().context("path of this program")?,
            answers: trial.answers(),
            jobs: self.jobs,
            limit: Duration::from_secs(self.limit_s),
            reuse: self.resume,
        };
        // All answers exist before the seal is opened.
        let ends = diagnose(&runner, &cases);
        sealed.open(key, &published)?;
        print(&score(&runner, &cases, &ends, &sealed.truth()), self.table.as_deref())
    }
}

impl Args {
    fn resplit_plan<'a>(&'a self, cases: &'a Path, truth: &'a Path) -> Plan<'a> {
        Plan {
            cases,
            truth,
            recordings: self.recordings.as_deref(),
            variants: self.variants,
            seed: self.seed,
            out: &self.out,
            only: self.only.as_deref(),
            with_rivals: !self.no_rivals,
            jobs: self.jobs,
            limit: Duration::from_secs(self.limit_s),
            table: self.table.as_deref(),
        }
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "seconds were checked")]
    fn recipe(&self) -> anyhow::Result<Recipe> {
        if !(2.0..=600.0).contains(&self.seconds) {
            return Err(UsageError(format!("--seconds {}: must be 2 to 600 s", self.seconds)).into());
        }
        let healthy = match (self.healthy, self.ill) {
            (true, _) => Some(true),
            (_, true) => Some(false),
            _ => None,
        };
        Ok(Recipe { rows: (self.seconds / 0.0025) as usize, healthy })
    }

    fn generate(&self, trial: &TrialFolder, key: Key) -> anyhow::Result<Outcome> {
        trial.make(self.cases, self.seed, self.recipe()?, key)?;
        Ok(Outcome::Fine)
    }

    /// A process of its own draws the truth: this one learns it when the seal is opened.
    fn spawn_generator(&self, trial: &TrialFolder, folder: &Path, key: Key) -> anyhow::Result<()> {
        if !self.resume && self.out.exists() && self.out.read_dir()?.next().is_some() {
            bail!("{}: not empty; a trial wants a folder of its own, or --resume", self.out.display());
        }
        self.recipe()?;
        let mut command = Command::new(std::env::current_exe().context("path of this program")?);
        command.args(["trial", "--generate", "--cases", &self.cases.to_string(), "--seed", &self.seed.to_string()]);
        command.args(["--seconds", &self.seconds.to_string(), "--out"]).arg(folder);
        command.args(self.healthy.then_some("--healthy")).args(self.ill.then_some("--ill"));
        let bar = progress::bar(self.cases as u64, "drawing and simulating");
        let mut child = command.stdin(Stdio::piped()).spawn().context("starting the generator")?;
        child.stdin.take().context("the generator's input")?.write_all(hex(&key).as_bytes())?;
        let status = loop {
            match child.try_wait()? {
                Some(status) => break status,
                None => bar.set_position(trial.drawn()),
            }
            std::thread::sleep(LOOK);
        };
        bar.finish_and_clear();
        if !status.success() {
            bail!("the generator ended with {status}");
        }
        Ok(())
    }
}

fn read_key() -> anyhow::Result<Key> {
    let mut digits = String::new();
    std::io::stdin().read_to_string(&mut digits)?;
    key_of(digits.trim()).context("a key of 64 hexadecimal digits")
}

fn fresh_key() -> anyhow::Result<Key> {
    let mut key = [0; 32];
    std::fs::File::open("/dev/urandom").and_then(|mut file| file.read_exact(&mut key)).context("/dev/urandom")?;
    Ok(key)
}
