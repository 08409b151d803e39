//! `compass doctor`: is this machine fit for real time? RT: no.

mod checks;

use super::config_args::ConfigArgs;
use super::{Outcome, Run};
use serde::Serialize;
use std::io::{self, Write};
use std::path::PathBuf;

/// Checks kernel, limits, CPU, memory, buses and disk; each line good, warn or bad, with the remedy.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass doctor
  compass doctor --config /etc/compass --record /var/lib/compass --json

Exit codes: 0 nothing bad, 1 something is bad.")]
pub(crate) struct Args {
    #[command(flatten)]
    config: ConfigArgs,
    /// Where recordings shall go: has that disk room?
    #[arg(long, value_name = "DIR", default_value = ".")]
    record: PathBuf,
    /// One JSON array instead of lines
    #[arg(long)]
    json: bool,
}

/// How a thing is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
enum Verdict {
    Good,
    Warn,
    Bad,
}

/// One line.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
struct Finding {
    verdict: Verdict,
    what: String,
    found: String,
    /// Empty when good.
    remedy: String,
}

impl Finding {
    /// `remedy` is dropped when there is nothing to remedy.
    fn new(verdict: Verdict, what: &str, found: impl Into<String>, remedy: &str) -> Self {
        let remedy = if verdict == Verdict::Good { "" } else { remedy };
        Self { verdict, what: what.into(), found: found.into(), remedy: remedy.into() }
    }
}

impl Run for Args {
    fn run(self) -> anyhow::Result<Outcome> {
        let config = self.config.load()?.config;
        let findings = checks::all(&config, &self.record);
        let mut out = io::stdout().lock();
        if self.json {
            writeln!(out, "{}", serde_json::to_string_pretty(&findings)?)?;
        } else {
            findings.iter().try_for_each(|finding| write_line(&mut out, finding))?;
        }
        let bad = findings.iter().any(|finding| finding.verdict == Verdict::Bad);
        Ok(if bad { Outcome::Finding } else { Outcome::Fine })
    }
}

fn write_line(out: &mut impl Write, finding: &Finding) -> io::Result<()> {
    let word = match finding.verdict {
        Verdict::Good => "good",
        Verdict::Warn => "warn",
        Verdict::Bad => "BAD ",
    };
    writeln!(out, "{word}  {:<22} {}", finding.what, finding.found)?;
    if finding.remedy.is_empty() { Ok(()) } else { writeln!(out, "        -> {}", finding.remedy) }
}
