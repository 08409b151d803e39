//! `compass identify CASE`: parameters by simulation error, and which of them the data determines. RT: no.

use super::output::{files_in, spare_case, spare_inputs};
use super::{Outcome, Run, UsageError, progress, warn};
use crate::diagnose::base_model::DiagnoseError;
use crate::diagnose::identification::{Identification, identify_with, with_offsets};
use crate::diagnose::supposed::Supposed;
use crate::identify::experiment::Experiment;
use crate::report::page;
use anyhow::Context;
use std::fs;
use std::io::{self, Write};
use std::path::PathBuf;

/// Fits the uncertain numbers of a rig to its fit recordings and says which combinations the data determines.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass identify cases/pendulum
  compass identify my_case --out fitted     model.toml, identified.json and report.html in fitted/
  compass identify my_case --add backlash@q1 --add actuator_lag      what a fit with these effects comes to

Every number of rig.toml that has bounds is fitted, to all recordings with use = \"fit\" at once, together with the
initial state of every window; the error is that of free runs. Nothing is added to the model but what
--add says; what is missing is found by `compass diagnose`. The recordings with use = \"heldout\" are only predicted.
Exit codes: 0 fitted, 2 usage, 3 bad input.")]
pub(crate) struct Args {
    /// Folder with rig.toml and its recordings
    case: PathBuf,
    /// Folder for model.toml, identified.json and report.html; made if it is not there. Not the case itself
    #[arg(long, value_name = "DIR", default_value = "identified")]
    out: PathBuf,
    /// Fit a zero offset of every angle as well (one for all recordings; for one each, write them into rig.toml)
    #[arg(long)]
    offsets: bool,
    /// Fit this effect as well: EFFECT, EFFECT@AT or EFFECT@AT#ORDER; may be given several times
    #[arg(long, value_name = "EFFECT")]
    add: Vec<Supposed>,
}

/// What goes into the folder.
const ANSWERS: [&str; 3] = ["model.toml", "identified.json", "report.html"];

impl Run for Args {
    fn run(self) -> anyhow::Result<Outcome> {
        spare_case("--out", &self.out, Some(&self.case))?;
        spare_inputs("--out", ANSWERS.map(|name| self.out.join(name)), &files_in(&self.case))?;
        let mut experiment = Experiment::load(&self.case)?;
        if self.offsets {
            experiment = with_offsets(&experiment);
        }
        warn::of_input(&experiment.recordings)?;
        let spinner = progress::spinner("fitting");
        let done = identify_with(&experiment, &self.add).map_err(usage)?;
        spinner.finish_and_clear();
        self.write(&done)?;
        tell(&done)?;
        warn::further(&done.found.warnings, &experiment.recordings)?;
        Ok(Outcome::Fine)
    }
}

/// An effect that cannot be added was asked for by the person.
fn usage(error: DiagnoseError) -> anyhow::Error {
    match error {
        DiagnoseError::NoPlace { .. } | DiagnoseError::AlreadyThere(_) => UsageError(format!("--add {error}")).into(),
        other => other.into(),
    }
}

impl Args {
    fn write(&self, done: &Identification) -> anyhow::Result<()> {
        fs::create_dir_all(&self.out).with_context(|| self.out.display().to_string())?;
        let json = serde_json::to_string_pretty(&done.found.summary())?;
        let texts = [done.model.to_toml(), json, page::identification(&done.found)];
        for (name, text) in ANSWERS.into_iter().zip(texts) {
            let path = self.out.join(name);
            fs::write(&path, text).with_context(|| path.display().to_string())?;
        }
        Ok(())
    }
}

fn tell(done: &Identification) -> io::Result<()> {
    let found = &done.found;
    let mut out = io::stdout().lock();
    writeln!(out, "{}\n\n{}", found.headline, found.parameters().to_text())?;
    writeln!(out, "Error of free runs over the channel's spread:\n{}", found.errors().to_text())?;
    for sentence in &found.undetermined {
        writeln!(out, "{sentence}")?;
    }
    Ok(())
}
