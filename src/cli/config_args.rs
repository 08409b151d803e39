//! The configuration on the command line, alike in every subcommand: `--config F`, `--set key=value`. RT: no.

use super::output::files_in;
use crate::config::fault::Place;
use crate::config::{self, Choice, Errors, Resolved, Setting};
use std::fmt::Display;
use std::io::{self, Write};
use std::path::PathBuf;

/// Which configuration.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct ConfigArgs {
    /// Folder with robot.toml, rt.toml, control.toml, sim.toml, or a file with these as tables and `[set]`.
    /// Sections that are not there come whole from the embedded default
    #[arg(long = "config", value_name = "F")]
    pub path: Option<PathBuf>,
    /// Model file, as `compass diagnose` writes it: what observer and controller shall believe. The simulated robot
    /// stays as it is
    #[arg(long, value_name = "MODEL.toml")]
    pub model: Option<PathBuf>,
    /// Changes one value, such as robot.bus0.backend=socketcan:can0. May be given often
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
    /// What other options of the command say about keys; goes after `--set`.
    #[arg(skip)]
    pub options: Vec<Setting>,
}

impl ConfigArgs {
    /// Reads and checks it; warnings go to stderr.
    ///
    /// # Errors
    /// Everything that is wrong, at once.
    pub fn load(&self) -> Result<Resolved, Errors> {
        self.load_choice(&[], None)
    }

    /// With faults of the command line; these and those of the files can all be injected in this place.
    ///
    /// # Errors
    /// Everything that is wrong, at once.
    pub fn load_with_faults(&self, faults: &[String], place: Place) -> Result<Resolved, Errors> {
        self.load_choice(faults, Some(place))
    }

    /// An option of the command that stands for a key.
    pub(super) fn set_by(&mut self, option: &str, key: &str, value: Option<impl Display>) {
        self.options.extend(value.map(|value| Setting::of_option(option, format!("{key}={value}"))));
    }

    /// All single values in the order in which they go.
    pub(super) fn settings(&self) -> Vec<Setting> {
        let set = self.overrides.iter().map(|text| Setting::of_option("--set", text));
        set.chain(self.options.iter().cloned()).collect()
    }

    /// The files that it comes from.
    pub(super) fn files(&self) -> Vec<PathBuf> {
        let of_path = |path: &PathBuf| if path.is_dir() { files_in(path) } else { vec![path.clone()] };
        self.path.iter().flat_map(of_path).chain(self.model.clone()).collect()
    }

    fn load_choice(&self, faults: &[String], place: Option<Place>) -> Result<Resolved, Errors> {
        let resolved = config::load_choice(Choice {
            path: self.path.as_deref(),
            model: self.model.as_deref(),
            overrides: &self.settings(),
            faults,
            place,
            // The simulated robot itself, on real buses, needs nobody's hand and no real IMU.
            plays_robot: place == Some(Place::Plant),
        })?;
        for warning in &resolved.warnings {
            // Nobody to tell when stderr is gone.
            drop(writeln!(io::stderr(), "warning: {warning}"));
        }
        Ok(resolved)
    }
}

#[cfg(test)]
mod tests {
    use crate::cli::tests::usage_error;

    #[test]
    fn what_an_option_says_of_a_key_is_told_by_the_name_of_the_option() {
        for command in ["run", "sim"] {
            let error = usage_error(&[command, "--controller", "wlak"]);
            assert!(error.contains("--controller: control.controller = \"wlak\": must be one of"), "{error}");
        }
        let error = usage_error(&["sim", "--seed", "18446744073709551615"]);
        assert!(error.contains("--seed: sim.seed = 18446744073709551615: "), "{error}");
    }
}
