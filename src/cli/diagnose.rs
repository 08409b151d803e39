//! `compass diagnose CASE`: what physics is missing in a simulation. RT: no.

use super::{Outcome, Run, progress};
use crate::diagnose::pipeline::{Answer, diagnose};
use crate::identify::experiment::Experiment;
use crate::report::page;
use anyhow::Context;
use std::fs;
use std::io::{self, Write};
use std::path::PathBuf;

/// Compares a simulation with recordings and says what physics is missing: the sentence on stdout, files into DIR.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass diagnose cases/real/emps
  compass diagnose my_case --out answer     diagnosis.json, model.toml and report.html in answer/

A case is a folder with rig.toml and the recordings that it names. Nothing is written into it.
Exit codes: 0 nothing found, 1 a mismatch found, 2 usage, 3 bad input.")]
pub(crate) struct Args {
    /// Folder with rig.toml and its recordings
    case: PathBuf,
    /// Folder for diagnosis.json, model.toml and report.html; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "diagnosis")]
    out: PathBuf,
    /// Seed of every random draw
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Tells each stage on stderr
    #[arg(long, short)]
    verbose: bool,
}

impl Run for Args {
    fn run(self) -> anyhow::Result<Outcome> {
        let experiment = Experiment::load(&self.case)?;
        let spinner = progress::spinner("diagnosing");
        let tell = |text: &str| {
            spinner.set_message(text.to_owned());
            if self.verbose {
                // Progress is talk; a closed stderr must not stop the work.
                writeln!(io::stderr(), "{text}").unwrap_or_default();
            }
        };
        let answer = diagnose(&experiment, self.seed, tell)?;
        spinner.finish_and_clear();
        self.write(&answer)?;
        let diagnosis = &answer.findings.diagnosis;
        let mut out = io::stdout().lock();
        writeln!(out, "{}", answer.findings.headline)?;
        if let Some(next) = &diagnosis.next_experiment {
            writeln!(out, "Next experiment: {next}")?;
        }
        for warning in &answer.findings.warnings {
            writeln!(io::stderr(), "warning: {warning}")?;
        }
        Ok(if diagnosis.verdict.is_mismatch() { Outcome::Finding } else { Outcome::Fine })
    }
}

impl Args {
    fn write(&self, answer: &Answer) -> anyhow::Result<()> {
        fs::create_dir_all(&self.out).with_context(|| self.out.display().to_string())?;
        let json = serde_json::to_string_pretty(&answer.findings.diagnosis)? + "\n";
        let files = [
            ("diagnosis.json", json),
            ("model.toml", answer.model.to_toml()),
            ("report.html", page::html(&answer.findings)),
        ];
        for (name, text) in files {
            let path = self.out.join(name);
            fs::write(&path, text).with_context(|| path.display().to_string())?;
        }
        Ok(())
    }
}
