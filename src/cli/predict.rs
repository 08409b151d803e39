//! `compass predict MODEL.toml [RECORDING.csv]`: free runs of a model, as the diagnosis contract defines them. RT: no.

use super::output::{must_be_folder, spare_inputs};
use super::{Outcome, Run, UsageError, warn};
use crate::identify::experiment::{ExperimentError, Recording, load_rig};
use crate::identify::outliers::clean;
use crate::identify::rollout::{FreeRun, Pooled, free_run};
use crate::model::rig::{MechanismKind, RecordingEntry, Rig, Sensor, Setup, Use};
use crate::report::plot::comparison;
use crate::report::table::{Align, Table};
use anyhow::Context;
use std::fmt::Write as _;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Runs a model freely against a recording and prints how far they are apart.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass predict cases/pendulum/rig.toml            all recordings beside the rig
  compass predict model.toml run_c.csv --out run_c_predicted.csv       one; a plot goes beside: run_c_predicted.svg
  compass predict answer/model.toml --case cases/pendulum              a model that a diagnosis wrote: all of its case
  compass predict answer/model.toml REC.mcap --setup inner_stance --window-s 0.5      a recording of the robot itself

A free run follows the recorded inputs; only the initial state of each window is fitted. NRMSE: error over the
standard deviation of the channel, pooled over the recordings of the same use. Single samples that stick out like
transmission errors are left out, as in the report of a diagnosis; stderr tells how many.
Exit codes: 0 done, 2 usage, 3 bad input.")]
pub(crate) struct Args {
    /// Model or rig file
    model: PathBuf,
    /// Recording; without it every recording that the file names, beside it or in --case
    recording: Option<PathBuf>,
    /// Folder of the recordings that the file names, if they do not lie beside it
    #[arg(long, value_name = "DIR", conflicts_with = "recording")]
    case: Option<PathBuf>,
    /// Where the prediction goes: a CSV file (a folder if no recording is named)
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Free runs restart this often, s (instead of what the file says)
    #[arg(long, value_name = "S")]
    window_s: Option<f64>,
    /// Set-up of a recording that the file does not name (compass gait)
    #[arg(long)]
    setup: Option<String>,
    /// Stance column of a recording that the file does not name
    #[arg(long, value_name = "COLUMN")]
    stance_column: Option<String>,
}

impl Run for Args {
    fn run(self) -> anyhow::Result<Outcome> {
        if let Some(window_s) = self.window_s.filter(|window_s| !(window_s.is_finite() && *window_s > 0.0)) {
            return Err(UsageError(format!("--window-s {window_s}: must be above 0 s")).into());
        }
        let mut rig = load_rig(&self.model)?;
        let targets = self.targets(&mut rig)?;
        self.spare_inputs(&rig, &targets)?;
        let mut table = Table::new(&[
            ("recording", Align::Left),
            ("use", Align::Left),
            ("channel", Align::Left),
            ("RMSE", Align::Right),
            ("unit", Align::Left),
            ("NRMSE", Align::Right),
        ]);
        for (index, path) in targets {
            let recording = Recording::load(&rig, index, &path).map_err(|error| self.with_place(error))?;
            warn::of_input(std::slice::from_ref(&recording))?;
            // As the report has it: compared without transmission errors, which no model explains.
            let (same_use, _) = clean(&rig, self.of_same_use(&rig, &recording, &path));
            let compared = same_use.iter().find(|r| r.index == recording.index).unwrap_or(&recording);
            left_out(&recording, compared)?;
            let pooled = Pooled::of(&rig, same_use.iter());
            let run = free_run(&rig, compared, &pooled)?;
            for (sensor, (error, std)) in rig.sensors.iter().zip(run.nrmse.iter().zip(&pooled.std)) {
                let usage = if recording.usage == Use::Fit { "fit" } else { "heldout" };
                let text = |x: Option<f64>| x.map_or("-".to_owned(), |x| format!("{x:.5}"));
                table.push([
                    recording.name.clone(),
                    usage.to_owned(),
                    sensor.column.clone(),
                    text(error.map(|e| e * std)),
                    unit(&rig, sensor),
                    text(*error),
                ]);
            }
            self.write(&rig, &recording, &run)?;
        }
        writeln!(io::stdout().lock(), "{}", table.to_text())?;
        Ok(Outcome::Fine)
    }
}

impl Args {
    /// Index in the rig and path of what shall be run.
    fn targets(&self, rig: &mut Rig) -> anyhow::Result<Vec<(usize, PathBuf)>> {
        if let Some(window_s) = self.window_s {
            rig.recordings.iter_mut().for_each(|r| r.window_s = Some(window_s));
        }
        let Some(path) = &self.recording else {
            let folder = self.case.as_deref().or(self.model.parent()).unwrap_or(Path::new("."));
            return Ok(rig.recordings.iter().map(|r| folder.join(&r.file)).enumerate().collect());
        };
        let file = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let index = match rig.recording_index(&file) {
            Some(index) => index,
            None => {
                rig.recordings.push(self.entry(rig, file)?);
                rig.recordings.len() - 1
            }
        };
        Ok(vec![(index, path.clone())])
    }

    /// Neither the model nor a recording may be replaced by a prediction or its plot.
    fn spare_inputs(&self, rig: &Rig, targets: &[(usize, PathBuf)]) -> Result<(), UsageError> {
        let Some(out) = &self.out else { return Ok(()) };
        if self.recording.is_none() {
            must_be_folder("--out", out)?;
        }
        let beside = |path: &PathBuf| rig.recordings.iter().map(|r| path.with_file_name(&r.file)).collect::<Vec<_>>();
        let recordings = targets.iter().flat_map(|(_, path)| [beside(path), vec![path.clone()]].concat());
        let inputs: Vec<PathBuf> = recordings.chain([self.model.clone()]).collect();
        for (index, _) in targets {
            let name = rig.recordings.get(*index).map_or("", |r| &r.file);
            let (file, plot) = self.files(out, name);
            if file == plot {
                let what = "is where the plot goes; must end in another way, such as .csv";
                return Err(UsageError(format!("--out: {}: {what}", file.display())));
            }
            spare_inputs("--out", [file, plot], &inputs)?;
        }
        Ok(())
    }

    /// Where the prediction of a recording goes, and its plot.
    fn files(&self, out: &Path, recording: &str) -> (PathBuf, PathBuf) {
        let file = if self.recording.is_some() { out.to_owned() } else { out.join(recording) };
        let plot = file.with_extension("svg");
        (file, plot)
    }

    /// Where a recording that is not there was looked for, and what else there is: a model that a diagnosis wrote names
    /// the recordings as its case does, and lies elsewhere.
    fn with_place(&self, error: ExperimentError) -> anyhow::Error {
        let is_named = self.recording.is_none() && self.case.is_none();
        let is_gone = matches!(&error, ExperimentError::File { cause, .. } if cause.kind() == io::ErrorKind::NotFound);
        let error = anyhow::Error::from(error);
        if !(is_named && is_gone) {
            return error;
        }
        let model = self.model.display();
        error.context(format!(
            "{model} names recordings that do not lie beside it; say where by --case DIR, or name one"
        ))
    }

    /// A recording that the file does not name.
    fn entry(&self, rig: &Rig, file: String) -> anyhow::Result<RecordingEntry> {
        let setup = setup_of(self.setup.as_deref(), rig.mechanism)?;
        if rig.mechanism.has_ground() && setup.is_none() {
            return Err(
                UsageError(format!("`{file}` is not in the model file: say how it was set up (--setup)")).into()
            );
        }
        Ok(RecordingEntry {
            file,
            usage: Use::Heldout,
            window_s: self.window_s,
            setup,
            stance_column: self.stance_column.clone(),
            toe_columns: None,
            window_column: None,
            parameters: Vec::new(),
            effects: Vec::new(),
        })
    }

    /// This recording, and those of the same use that lie beside it: channels are weighed by their spread over all.
    fn of_same_use(&self, rig: &Rig, recording: &Recording, path: &Path) -> Vec<Recording> {
        let folder = path.parent().unwrap_or(Path::new("."));
        let same =
            rig.recordings.iter().enumerate().filter(|(i, r)| r.usage == recording.usage && *i != recording.index);
        let mut all: Vec<Recording> =
            same.filter_map(|(i, r)| Recording::load(rig, i, &folder.join(&r.file)).ok()).collect();
        all.push(recording.clone());
        all.sort_by_key(|r| r.index);
        all
    }

    /// The prediction as CSV, and a plot of measured against simulated beside it.
    fn write(&self, rig: &Rig, recording: &Recording, run: &FreeRun) -> anyhow::Result<()> {
        let Some(out) = &self.out else { return Ok(()) };
        if self.recording.is_none() {
            fs::create_dir_all(out).with_context(|| out.display().to_string())?;
        }
        let (file, plot) = self.files(out, &recording.name);
        let names: Vec<&str> = rig.sensors.iter().map(|s| s.column.as_str()).collect();
        fs::write(&file, csv(&recording.times, &names, &run.predicted)).with_context(|| file.display().to_string())?;
        let channels = names.iter().zip(recording.measured.iter().zip(&run.predicted));
        let channels: Vec<(&str, &[f64], &[f64])> =
            channels.map(|(name, (y, p))| (*name, y.as_slice(), p.as_slice())).collect();
        fs::write(&plot, comparison(&recording.times, &channels)).with_context(|| plot.display().to_string())
    }
}

/// The set-up that `--setup` names, if this mechanism has any.
pub(super) fn setup_of(id: Option<&str>, mechanism: MechanismKind) -> Result<Option<Setup>, UsageError> {
    let Some(id) = id else { return Ok(None) };
    if !mechanism.has_ground() {
        let what = "only the compass gait has set-ups, the mechanism of this rig is";
        return Err(UsageError(format!("--setup {id}: {what} `{}`", mechanism.id())));
    }
    let known: Vec<&str> = Setup::ALL.iter().map(|setup| setup.id()).collect();
    let setup = Setup::from_id(id);
    setup.map(Some).ok_or_else(|| UsageError(format!("--setup {id}: must be one of {}", known.join(", "))))
}

/// In what a sensor reads.
fn unit(rig: &Rig, sensor: &Sensor) -> String {
    let per = if sensor.is_rate { "/s" } else { "" };
    format!("{}{per}", rig.mechanism.coordinate_unit())
}

/// Says how many samples the comparison leaves out.
fn left_out(recording: &Recording, compared: &Recording) -> io::Result<()> {
    let samples = |r: &Recording| r.measured.iter().flatten().filter(|y| y.is_finite()).count();
    let count = samples(recording) - samples(compared);
    if count > 0 {
        writeln!(
            io::stderr(),
            "{}: {count} single samples stick out like transmission errors; left out of the comparison",
            recording.name
        )?;
    }
    Ok(())
}

/// Columns as CSV text; numbers read back to the same bits, NaN is an empty cell.
pub(super) fn csv(times: &[f64], names: &[&str], columns: &[Vec<f64>]) -> String {
    let mut text = format!("t_s,{}\n", names.join(","));
    for (row, t) in times.iter().enumerate() {
        // Writing to a string cannot fail.
        write!(text, "{t}").unwrap_or_default();
        for column in columns {
            match column.get(row) {
                Some(x) if x.is_finite() => write!(text, ",{x}").unwrap_or_default(),
                _ => text.push(','),
            }
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        args: Args,
    }

    fn run(line: &[&str]) -> anyhow::Result<Outcome> {
        Line::try_parse_from(["predict"].iter().chain(line)).unwrap().args.run()
    }

    #[test]
    fn a_model_that_lies_elsewhere_than_its_recordings_is_told_where_they_are() {
        let case = Path::new(env!("CARGO_MANIFEST_DIR")).join("cases/pendulum");
        let folder = tempfile::tempdir().unwrap();
        let model = folder.path().join("model.toml");
        fs::copy(case.join("rig.toml"), &model).unwrap();
        let model = model.to_str().unwrap();
        let error = format!("{:#}", run(&[model]).unwrap_err());
        assert!(
            error.contains("model.toml names recordings that do not lie beside it; say where by --case DIR"),
            "{error}"
        );
        assert!(error.contains("run_a.csv: is not there"), "{error}");
        assert_eq!(run(&[model, "--case", case.to_str().unwrap()]).unwrap(), Outcome::Fine);
    }

    #[test]
    fn an_error_has_the_unit_of_its_sensor() {
        let rig = |mechanism: &str, parameters: &str| {
            let head = format!("schema = 1\nmechanism = \"{mechanism}\"\n[parameters]\n{parameters}\n");
            let sensors =
                ["q1", "q1_rate"].map(|what| format!("[[sensor]]\nmeasures = \"{what}\"\ncolumn = \"{what}\"\n"));
            Rig::parse(&(head + &sensors.concat()), "rig.toml").unwrap()
        };
        let units = |rig: &Rig| rig.sensors.iter().map(|sensor| unit(rig, sensor)).collect::<Vec<_>>();
        assert_eq!(units(&rig("pendulum", "inertia_kg_m2 = 0.01\ngravity_nm = 0.4")), ["rad", "rad/s"]);
        assert_eq!(units(&rig("slider", "mass_kg = 1.0")), ["m", "m/s"]);
    }
}
