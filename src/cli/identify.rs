//! `compass identify CASE`: parameters by simulation error, and which of them the data determines. RT: no.

use super::{Outcome, Run, progress};
use crate::diagnose::base::{as_given, drop_spikes, fit_recordings, fitted, floors};
use crate::diagnose::pipeline::{DiagnoseError, again};
use crate::diagnose::prove::{Models, proof};
use crate::diagnose::tables::{parameter_lines, undetermined_combinations};
use crate::identify::experiment::Experiment;
use crate::identify::rollout::Pooled;
use crate::model::rig::Use;
use crate::report::table::{Align, Table, number, with_deviation};
use anyhow::Context;
use std::fs;
use std::io::{self, Write};
use std::path::PathBuf;

/// Fits the uncertain numbers of a rig to its fit recordings and says which combinations the data determines.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass identify cases/real/emps
  compass identify my_case --out fitted     model.toml in fitted/

Nothing is added to the model: that is `compass diagnose`.
Exit codes: 0 fitted, 2 usage, 3 bad input.")]
pub(crate) struct Args {
    /// Folder with rig.toml and its recordings
    case: PathBuf,
    /// Folder for model.toml; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "identified")]
    out: PathBuf,
}

impl Run for Args {
    fn run(self) -> anyhow::Result<Outcome> {
        let experiment = Experiment::load(&self.case)?;
        let spinner = progress::spinner("fitting");
        let mut recordings = fit_recordings(&experiment);
        if recordings.is_empty() {
            return Err(DiagnoseError::NothingToFit.into());
        }
        let pooled = Pooled::of(&experiment.rig, experiment.of_use(Use::Fit));
        let floors = floors(&experiment.rig, &pooled, &recordings);
        let first = fitted(&experiment.rig, &recordings, &pooled, &floors).ok_or(DiagnoseError::Diverges)?;
        drop_spikes(&mut recordings, &first);
        let given = as_given(&experiment.rig, &recordings, &pooled, &floors).ok_or(DiagnoseError::Diverges)?;
        let best = again(&first, &recordings, &floors).ok_or(DiagnoseError::Diverges)?;
        let models = Models { given: &experiment.rig, refitted: &best.rig, explained: &best.rig };
        let (figures, _) = proof(&experiment, models)?;
        spinner.finish_and_clear();

        let mut parameters = Table::new(&[
            ("parameter", Align::Left),
            ("given", Align::Right),
            ("fitted", Align::Right),
            ("", Align::Left),
        ]);
        for line in parameter_lines(&given, &best, &best) {
            let bound = if line.at_bound { "at its bound" } else { "" };
            let fitted = with_deviation(line.explained.value, line.explained.std);
            parameters.push([line.name, number(line.given), fitted, bound.to_owned()]);
        }
        let heading = [
            ("recording", Align::Left),
            ("use", Align::Left),
            ("channel", Align::Left),
            ("given", Align::Right),
            ("fitted", Align::Right),
        ];
        let mut errors = Table::new(&heading);
        for f in figures {
            errors.push([f.recording, f.use_, f.channel, number(f.nrmse_given), number(f.nrmse_refitted)]);
        }
        fs::create_dir_all(&self.out).with_context(|| self.out.display().to_string())?;
        let path = self.out.join("model.toml");
        fs::write(&path, best.rig.to_toml()).with_context(|| path.display().to_string())?;
        let mut out = io::stdout().lock();
        writeln!(out, "{}\nFree-run error over the channel's spread:\n{}", parameters.to_text(), errors.to_text())?;
        for sentence in undetermined_combinations(&best) {
            writeln!(out, "{sentence}")?;
        }
        Ok(Outcome::Fine)
    }
}
