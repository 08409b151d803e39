//! `compass replay`: a recording through the same tick once more. RT: no.

use super::{Outcome, Run, UsageError};
use crate::base::time::Stamp;
use crate::config::checked::Config;
use crate::config::{self, Resolved};
use crate::control::Controller;
use crate::msg::TickRecord;
use crate::record::log_file::binary_hash;
use crate::record::replay::{Comparison, Replay, first_difference, from_estimates};
use crate::record::scan::Ending;
use crate::record::{ReadError, Reader};
use crate::rt::tick::Tick;
use crate::telemetry::{self, Feed};
use anyhow::Context;
use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// Feeds a recording's inputs through the tick again and shows it, or checks that every bit comes out alike.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass replay REC --check                 every output bit by bit; names the first difference
  compass replay REC --speed 0.1             watch it in slow motion
  compass replay REC --check --from-estimates    the controller alone, on the recorded estimates
  compass replay REC --set control.friction_compensation=0    what it would have done

Exit codes: 0 alike, 1 a difference, ticks that could not be compared or a damaged file, 3 not readable.")]
pub(crate) struct Args {
    /// The recording
    #[arg(value_name = "REC")]
    recording: PathBuf,
    /// Compares as fast as it can, shows nothing else
    #[arg(long)]
    check: bool,
    /// How fast to show it; 0 = as fast as it goes
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, conflicts_with = "check")]
    speed: f64,
    /// Takes the recorded estimates; only the controller runs
    #[arg(long)]
    from_estimates: bool,
    /// Changes a value of the recorded configuration. May be given often
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
}

type Step = Box<dyn FnMut(&TickRecord, &mut TickRecord)>;

impl Run for Args {
    fn run(self) -> anyhow::Result<Outcome> {
        if !(self.speed >= 0.0 && self.speed.is_finite()) {
            return Err(UsageError(format!("--speed {}: must be 0 or more", self.speed)).into());
        }
        let resolved = self.configuration()?;
        let mut replay = Replay::new(Reader::open(&self.recording)?, self.step(&resolved.config)?);
        if self.check {
            let found = replay.compare()?;
            return Ok(report(&found, replay.ending(), replay.broken_ticks())?);
        }
        let mut feed = Paced { replay, speed: self.speed, start: None, next: None, differing: 0, error: None };
        telemetry::run(&resolved.config, &mut feed, &AtomicBool::new(false))?;
        feed.conclude()
    }
}

impl Args {
    /// The recorded configuration with overrides. It stands before the first tick.
    fn configuration(&self) -> anyhow::Result<Resolved> {
        let mut reader = Reader::open(&self.recording)?;
        reader.next_tick()?;
        let about = reader.about();
        let text = about.config_text.as_deref().context("the recording holds no configuration")?;
        let recorded = config::from_canonical(text, &[]).context("the recorded configuration")?;
        if about.program("config_sha256") != Some(recorded.hash.as_str()) {
            tell("the recorded configuration does not have the recorded hash: the file is damaged")?;
        }
        if let Some(line) = other_build(about.program("version"), about.program("binary_sha256"), binary_hash()) {
            tell(&line)?;
        }
        Ok(config::from_canonical(text, &self.overrides)?)
    }

    fn step(&self, config: &Config) -> anyhow::Result<Step> {
        if self.from_estimates {
            return Ok(Box::new(from_estimates(Controller::new(config)?)));
        }
        let mut tick = Tick::new(config)?;
        Ok(Box::new(move |recorded, replayed| tick.step(&recorded.input, replayed)))
    }
}

/// What to say where another build recorded: a difference may be its doing. The version alone does not tell builds apart.
fn other_build(version: Option<&str>, theirs: Option<&str>, ours: &str) -> Option<String> {
    let [version, theirs] = [version, theirs].map(|word| word.unwrap_or("unknown"));
    let here = env!("CARGO_PKG_VERSION");
    (theirs != ours).then(|| {
        format!("recorded by another build: version {version}, sha256 {theirs}; replayed by {here}, sha256 {ours}")
    })
}

fn tell(line: &str) -> io::Result<()> {
    writeln!(io::stderr(), "compass: {line}")
}

fn report(found: &Comparison, ending: Option<Ending>, broken: u64) -> io::Result<Outcome> {
    let mut out = io::stdout().lock();
    writeln!(out, "{} ticks alike to the bit", found.alike)?;
    if let Some(difference) = &found.difference {
        writeln!(out, "first difference: {difference}")?;
    }
    if let Some((expected, came)) = found.gap {
        writeln!(out, "tick {expected} was expected and {came} came: the state after the gap is unknown")?;
    }
    if found.not_compared > 0 {
        writeln!(out, "{} ticks not compared", found.not_compared)?;
    }
    match ending {
        Some(Ending::Whole) => {}
        Some(Ending::Torn { at }) => writeln!(out, "the file ends in the middle, at byte {at}")?,
        Some(Ending::Damaged { at }) => writeln!(out, "the file is damaged from byte {at} on")?,
        None => writeln!(out, "the file was not read to its end")?,
    }
    if broken > 0 {
        writeln!(out, "{broken} ticks could not be read")?;
    }
    let whole = ending == Some(Ending::Whole) && broken == 0;
    let fine = whole && found.difference.is_none() && found.not_compared == 0 && found.alike > 0;
    Ok(if fine { Outcome::Fine } else { Outcome::Finding })
}

/// Hands replayed ticks over at the speed of their stamps.
struct Paced {
    replay: Replay<Step>,
    speed: f64,
    start: Option<(Instant, Stamp)>,
    next: Option<TickRecord>,
    differing: u64,
    error: Option<ReadError>,
}

/// Ticks between two redraws when there is no pace to keep.
const BURST: usize = 2000;

impl Paced {
    /// The next replayed tick, if it is due.
    fn due(&mut self) -> Option<TickRecord> {
        if self.next.is_none() {
            self.next = self.replay_one();
        }
        let now = self.next?.input.now;
        let (began, first) = *self.start.get_or_insert((Instant::now(), now));
        let is_due = self.speed == 0.0 || now.since(first).as_s() <= began.elapsed().as_secs_f64() * self.speed;
        if is_due { self.next.take() } else { None }
    }

    fn replay_one(&mut self) -> Option<TickRecord> {
        match self.replay.next_pair() {
            Ok(Some(pair)) => {
                let differs = pair.comparable && first_difference(&pair.recorded, pair.replayed).is_some();
                self.differing += u64::from(differs);
                Some(*pair.replayed)
            }
            Ok(None) => None,
            Err(error) => {
                self.error = Some(error);
                None
            }
        }
    }

    fn conclude(self) -> anyhow::Result<Outcome> {
        if let Some(error) = self.error {
            return Err(error.into());
        }
        if self.differing == 0 {
            return Ok(Outcome::Fine);
        }
        writeln!(io::stdout(), "{} ticks differ from the recording (see --check)", self.differing)?;
        Ok(Outcome::Finding)
    }
}

impl Feed for Paced {
    fn poll(&mut self, each: &mut dyn FnMut(&TickRecord)) -> bool {
        for _ in 0..BURST {
            match self.due() {
                Some(tick) => each(&tick),
                None => return self.next.is_some(),
            }
        }
        true
    }
}

#[cfg(test)]
mod tests;
