//! `compass simulate RIG --input IN.csv --out OUT.csv`: makes a recording from a rig. RT: no.

use super::predict::csv;
use super::{Outcome, Run, UsageError};
use crate::identify::experiment::{Recording, load_rig};
use crate::identify::synthesis::record;
use crate::model::rig::{RecordingEntry, Setup, Use};
use anyhow::Context;
use std::fs;
use std::path::PathBuf;

/// Simulates a rig under the inputs of a CSV file and writes what its sensors read.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass simulate rig.toml --input chirp.csv --out run_a.csv --seed 1 --noise
  compass simulate walker.toml --input hip.csv --out walk.csv --setup walk --initial 0.19,-0.19,-0.74,-0.71

IN.csv has `t_s` and the columns of the actuators; OUT.csv repeats them beside the sensors, so that it is a recording.
Exit codes: 0 done, 2 usage, 3 bad input.")]
pub(crate) struct Args {
    /// Rig file
    rig: PathBuf,
    /// Inputs: `t_s` and one column per actuator
    #[arg(long, value_name = "FILE")]
    input: PathBuf,
    /// The recording
    #[arg(long, value_name = "FILE")]
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
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

impl Run for Args {
    fn run(self) -> anyhow::Result<Outcome> {
        let mut rig = load_rig(&self.rig)?;
        let setup = match &self.setup {
            None => None,
            Some(id) => Some(Setup::from_id(id).ok_or_else(|| UsageError(format!("--setup {id}: no such set-up")))?),
        };
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
            parameters: Vec::new(),
            effects: Vec::new(),
        });
        let input = Recording::load(&rig, rig.recordings.len() - 1, &self.input)?;
        (rig.sensors, rig.effects) = (sensors, effects);
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
