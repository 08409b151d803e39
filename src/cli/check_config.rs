//! `compass check-config`: is this configuration valid, and what does it say in the end? RT: no.

use super::config_args::ConfigArgs;
use super::{Outcome, Run, refused};
use std::io::{self, Write};
use std::path::PathBuf;

/// Checks a configuration and tells every error at once, with file, line, value, unit and allowed range.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass check-config                 the embedded default
  compass check-config config/         the files of a folder
  compass check-config my.toml --set robot.imu.rate_hz=250
  compass check-config --print > all.toml    the resolved configuration, usable as --config

Exit codes: 0 valid, 2 not valid.")]
pub(crate) struct Args {
    /// Folder or file; the embedded default if left out
    #[arg(value_name = "F", conflicts_with = "path")]
    file: Option<PathBuf>,
    #[command(flatten)]
    config: ConfigArgs,
    /// Prints the canonical text of the resolved configuration
    #[arg(long)]
    print: bool,
}

impl Run for Args {
    fn run(mut self) -> anyhow::Result<Outcome> {
        self.config.path = self.file.or(self.config.path);
        let resolved = self.config.load()?;
        refused::check(&resolved)?;
        let mut out = io::stdout().lock();
        if self.print {
            out.write_all(resolved.text.as_bytes())?;
            return Ok(Outcome::Fine);
        }
        for (section, source) in &resolved.sources {
            writeln!(out, "{section:8} {source}")?;
        }
        writeln!(out, "valid, {} warnings, sha256 {}", resolved.warnings.len(), resolved.hash)?;
        Ok(Outcome::Fine)
    }
}
