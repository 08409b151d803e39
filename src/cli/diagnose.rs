//! `compass diagnose CASE`: what physics is missing in a simulation. RT: no.

use super::output::{files_in, is_same, spare_case, spare_inputs};
use super::{Outcome, Run, UsageError, progress, seed, warn};
use crate::diagnose::judge::evidence::Comparison;
use crate::diagnose::judge::numbers::LEAST_SHARE;
use crate::diagnose::pipeline::{Answer, Note, Options, diagnose};
use crate::identify::experiment::Experiment;
use crate::identify::own::OwnCase;
use crate::report::page;
use anyhow::Context;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Compares a simulation with recordings and says what physics is missing: the sentence on stdout, files into DIR.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass diagnose cases/pendulum
  compass diagnose my_case --out answer     diagnosis.json, model.toml and report.html in answer/
  compass diagnose --own REC.mcap --out answer
      the robot itself: recordings of `compass run` or `sim` against the model that its controller used; the case that
      is made of them goes to answer/case

A case is a folder with rig.toml and the recordings that it names. Nothing is written into it.
Exit codes: 0 nothing found, 1 a mismatch found, 2 usage, 3 bad input.")]
pub(crate) struct Args {
    /// Folder with rig.toml and its recordings
    #[arg(required_unless_present = "own", conflicts_with = "own")]
    case: Option<PathBuf>,
    /// Recordings of the robot itself, against the model that is inside them
    #[arg(long, value_name = "REC.mcap", num_args = 1..)]
    own: Vec<PathBuf>,
    /// Folder for diagnosis.json, model.toml and report.html; made if it is not there. Not the case itself
    #[arg(long, value_name = "DIR", default_value = "diagnosis")]
    out: PathBuf,
    /// Seed of every random draw
    #[arg(long, default_value_t = 0, value_parser = seed)]
    seed: u64,
    /// Smallest part of the misfit that an effect removes when it matters, 0 to 1; what is smaller is listed as seen
    #[arg(long, value_name = "PART", default_value_t = LEAST_SHARE, value_parser = part)]
    least: f64,
    /// Write what goes on in detail, then every comparison of the judge, by its rules and by the evidence that stands beside
    /// them, as lines of JSON
    #[arg(long, value_name = "FILE")]
    trace: Option<PathBuf>,
    /// Tells each stage on stderr
    #[arg(long, short)]
    verbose: bool,
}

/// What goes into the folder.
const ANSWERS: [&str; 3] = ["diagnosis.json", "model.toml", "report.html"];

/// A part between 0 and 1.
fn part(text: &str) -> Result<f64, String> {
    let part: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if (0.0..=1.0).contains(&part) { Ok(part) } else { Err("a part is from 0 to 1".to_owned()) }
}

impl Run for Args {
    fn run(self) -> anyhow::Result<Outcome> {
        self.spare_inputs()?;
        let experiment = Experiment::load(&self.case_folder()?)?;
        warn::of_input(&experiment.recordings)?;
        let spinner = progress::spinner("diagnosing");
        let mut details = String::new();
        let tell = |note: Note<'_>| {
            if self.trace.is_some() {
                details += &told(note);
            }
            if note.is_detail() {
                return;
            }
            let Note { after_s, text } = note;
            spinner.set_message(format!("{after_s:5.1} s  {text}"));
            if self.verbose {
                // Progress is talk; a closed stderr must not stop the work.
                writeln!(io::stderr(), "{after_s:5.1} s  {text}").unwrap_or_default();
            }
        };
        let options = Options { seed: self.seed, least_share: self.least };
        let answer = diagnose(&experiment, options, tell)?;
        spinner.finish_and_clear();
        self.write(&answer)?;
        if let Some(path) = &self.trace {
            fs::write(path, details + &lines(&answer.comparisons)?).with_context(|| path.display().to_string())?;
        }
        let diagnosis = &answer.findings.diagnosis;
        let mut out = io::stdout().lock();
        writeln!(out, "{}", answer.findings.headline)?;
        if let Some(next) = &diagnosis.next_experiment {
            writeln!(out, "Next experiment: {next}")?;
        }
        warn::further(&answer.findings.warnings, &experiment.recordings)?;
        Ok(if diagnosis.verdict.is_mismatch() { Outcome::Finding } else { Outcome::Fine })
    }
}

/// The file is, or would be, one of the folder's.
fn lies_in(file: &Path, folder: Option<&Path>) -> bool {
    let parent = file.parent().map(|parent| if parent.as_os_str().is_empty() { Path::new(".") } else { parent });
    parent.zip(folder).is_some_and(|(parent, folder)| is_same(parent, folder))
}

/// A line of JSON for a note.
fn told(note: Note<'_>) -> String {
    let line = serde_json::json!({ "after_s": note.after_s, "told": note.text.trim_start() });
    format!("{line}\n")
}

/// A line of JSON for each comparison.
fn lines(comparisons: &[Comparison]) -> anyhow::Result<String> {
    let lines: Vec<String> = comparisons.iter().map(serde_json::to_string).collect::<Result<_, _>>()?;
    Ok(lines.iter().map(|line| line.clone() + "\n").collect())
}

impl Args {
    /// Neither the case nor a recording of the robot may be replaced by an answer.
    fn spare_inputs(&self) -> Result<(), UsageError> {
        let case = self.case.as_deref();
        spare_case("--out", &self.out, case)?;
        if let Some(trace) = self.trace.as_deref().filter(|trace| lies_in(trace, case)) {
            let what = "lies in the case, into which nothing is written; must be elsewhere";
            return Err(UsageError(format!("--trace: {}: {what}", trace.display())));
        }
        let inputs = [self.own.clone(), case.map(files_in).unwrap_or_default()].concat();
        spare_inputs("--out", ANSWERS.map(|name| self.out.join(name)), &inputs)?;
        spare_inputs("--trace", &self.trace, &inputs)
    }

    /// The case as named, or the one that is made of our own recordings.
    fn case_folder(&self) -> anyhow::Result<PathBuf> {
        if let Some(case) = &self.case {
            return Ok(case.clone());
        }
        let (case, folder) = (OwnCase::of(&self.own)?, self.out.join("case"));
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        let rig = [("rig.toml".to_owned(), case.rig.to_toml())];
        for (name, text) in rig.iter().chain(&case.files) {
            let path = folder.join(name);
            fs::write(&path, text).with_context(|| path.display().to_string())?;
        }
        Ok(folder)
    }

    fn write(&self, answer: &Answer) -> anyhow::Result<()> {
        fs::create_dir_all(&self.out).with_context(|| self.out.display().to_string())?;
        let json = serde_json::to_string_pretty(&answer.findings.diagnosis)? + "\n";
        let texts = [json, answer.model.to_toml(), page::html(&answer.findings)];
        for (name, text) in ANSWERS.into_iter().zip(texts) {
            let path = self.out.join(name);
            fs::write(&path, text).with_context(|| path.display().to_string())?;
        }
        Ok(())
    }
}
