//! `compass simulate RIG --input IN.csv --out OUT.csv`: makes a recording from a rig. RT: no.

use super::output::{must_be_folder, spare_inputs};
use super::predict::{csv, setup_of};
use super::{Outcome, Run, UsageError, seed};
use crate::identify::experiment::{Recording, load_rig};
use crate::identify::synthesis::{initial_numbers, record};
use crate::identify::thesis::{self, Guess, TABLE_4_1};
use crate::model::rig::{RecordingEntry, Setup, Use};
use crate::report::table::{Align, Table, number};
use anyhow::Context;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Simulates a rig under the inputs of a CSV file and writes what its sensors read.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass simulate rig.toml --input chirp.csv --out run_a.csv --seed 1 --noise
  compass simulate walker.toml --input hip.csv --out walk.csv --setup walk --initial 0.19,-0.19,-0.74,-0.71

  compass simulate --thesis cad --out table41 && compass identify table41

IN.csv has `t_s` and the columns of the actuators; OUT.csv repeats them beside the sensors, so that it is a recording.
--thesis simulates the five identification experiments of thesis 4.2.3 (springs, fixed legs, parallel) on a robot with the
parameters of Table 4.1, and writes a case whose rig file holds a guess: `cad` (column Calculated), `printed` (with the
impossible c1 of the print), `near` (a fifth off) or `true`.
Exit codes: 0 done, 2 usage, 3 bad input.")]
pub(crate) struct Args {
    /// Rig file
    #[arg(required_unless_present = "thesis")]
    rig: Option<PathBuf>,
    /// Inputs: `t_s` and one column per actuator
    #[arg(long, value_name = "FILE", required_unless_present = "thesis")]
    input: Option<PathBuf>,
    /// The recording (a folder with --thesis)
    #[arg(long, value_name = "PATH")]
    out: PathBuf,
    /// Coordinates, then their rates, then inner states of effects; zero where left out
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true, value_name = "X,..")]
    initial: Vec<f64>,
    /// Set-up of the compass gait
    #[arg(long)]
    setup: Option<String>,
    /// Add the noise of each sensor's `noise_std`
    #[arg(long)]
    noise: bool,
    /// Seed of the noise
    #[arg(long, default_value_t = 0, value_parser = seed)]
    seed: u64,
    /// The identification experiments of thesis 4.2.3, with this guess in their rig file
    #[arg(long, value_name = "GUESS", value_parser = ["cad", "printed", "near", "true"], conflicts_with_all = ["rig", "input"])]
    thesis: Option<String>,
}

impl Run for Args {
    fn run(self) -> anyhow::Result<Outcome> {
        match (&self.thesis, &self.rig, &self.input) {
            (Some(guess), ..) => self.thesis(guess),
            (None, Some(rig), Some(input)) => self.recording(rig, input),
            _ => Err(UsageError("a rig file and --input, or --thesis".to_owned()).into()),
        }
    }
}

impl Args {
    /// The experiments of the thesis as a case, and what an identification of them should find.
    fn thesis(&self, guess: &str) -> anyhow::Result<Outcome> {
        let guess = match guess {
            "printed" => Guess::Printed,
            "near" => Guess::Near,
            "true" => Guess::True,
            _ => Guess::Cad,
        };
        must_be_folder("--out", &self.out)?;
        fs::create_dir_all(&self.out).with_context(|| self.out.display().to_string())?;
        for file in thesis::case(guess, thesis::TEN_SECONDS, self.seed)? {
            let path = self.out.join(&file.name);
            fs::write(&path, file.text).with_context(|| path.display().to_string())?;
        }
        let mut table = Table::new(&[
            ("parameter", Align::Left),
            ("truth", Align::Right),
            ("expected spread", Align::Right),
            ("±", Align::Right),
        ]);
        for row in TABLE_4_1 {
            let spread = [format!("{} %", number(100.0 * row.spread)), number(row.spread * row.value)];
            table.push([row.name.to_owned(), format!("{}", row.value)].into_iter().chain(spread));
        }
        writeln!(io::stdout(), "{}", table.to_text())?;
        Ok(Outcome::Fine)
    }

    fn recording(&self, rig: &Path, input: &Path) -> anyhow::Result<Outcome> {
        spare_inputs("--out", [&self.out], &[rig.to_owned(), input.to_owned()])?;
        let mut rig = load_rig(rig)?;
        let setup = setup_of(self.setup.as_deref(), rig.mechanism)?;
        if rig.mechanism.has_ground() && setup.is_none() {
            return Err(UsageError("the compass gait needs --setup".to_owned()).into());
        }
        // The input file is read as a recording without sensors.
        let sensors = std::mem::take(&mut rig.sensors);
        let effects = std::mem::take(&mut rig.effects);
        rig.recordings.push(RecordingEntry {
            file: self.out.display().to_string(),
            usage: Use::Fit,
            window_s: None,
            setup,
            stance_column: None,
            toe_columns: None,
            window_column: None,
            parameters: Vec::new(),
            effects: Vec::new(),
        });
        let input = Recording::load(&rig, rig.recordings.len() - 1, input)?;
        (rig.sensors, rig.effects) = (sensors, effects);
        let most = initial_numbers(&rig, &input)?;
        if self.initial.len() > most {
            let what = "coordinates, then their rates, then inner states of effects";
            return Err(UsageError(format!(
                "--initial: {} numbers, must be {most} at most: {what}",
                self.initial.len()
            ))
            .into());
        }
        let made = record(&rig, &input, &self.initial, self.noise.then_some(self.seed))?;
        let mut names: Vec<&str> = rig.actuators.iter().map(|a| a.column.as_str()).collect();
        let mut columns = input.inputs.clone();
        for (actuator, enabled) in rig.actuators.iter().zip(&input.enabled) {
            if let Some(name) = &actuator.enable_column {
                names.push(name);
                columns.push(enabled.iter().map(|on| f64::from(u8::from(*on))).collect());
            }
        }
        names.extend(rig.sensors.iter().map(|s| s.column.as_str()));
        columns.extend(made.measured);
        if setup == Some(Setup::Walk) {
            names.push("stance");
            columns.push(made.stance.iter().map(|leg| f64::from(*leg)).collect());
        }
        fs::write(&self.out, csv(&input.times, &names, &columns)).with_context(|| self.out.display().to_string())?;
        Ok(Outcome::Fine)
    }
}

#[cfg(test)]
mod tests {
    use crate::cli::tests::usage_error;

    #[test]
    fn more_initial_numbers_than_states_and_a_set_up_of_another_mechanism_are_refused() {
        let case = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("cases/pendulum");
        let (rig, input) = (case.join("rig.toml"), case.join("run_a.csv"));
        let out = tempfile::tempdir().unwrap();
        let out = out.path().join("out.csv");
        let line =
            ["simulate", rig.to_str().unwrap(), "--input", input.to_str().unwrap(), "--out", out.to_str().unwrap()];
        let told = |more: &[&str]| usage_error(&[&line, more].concat());
        let error = told(&["--initial", "1,2,3,4,5"]);
        assert!(error.contains("--initial: 5 numbers, must be 2 at most: coordinates"), "{error}");
        let error = told(&["--setup", "walk"]);
        assert!(error.contains("--setup walk: only the compass gait") && error.contains("`pendulum`"), "{error}");
        assert!(!out.exists());
    }
}
