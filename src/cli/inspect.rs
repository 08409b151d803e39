//! `compass inspect`: what is in a recording. RT: no.

mod page;

use super::output::spare_inputs;
use super::{Outcome, Run};
use crate::base::spectrum::band_rms;
use crate::base::time::Stamp;
use crate::identify::experiment::mcap::Own;
use crate::msg::RecorderState;
use crate::record::inspect::{Event, Inspection, inspect};
use crate::record::scan::Ending;
use crate::record::stream::Stream;
use std::f64::consts::PI;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Shows what is in a recording: streams, rates, gaps, drops, faults, configuration.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass inspect compass-2026-11-20T23-41-24Z.mcap
  compass inspect REC --page run.html          the robot in motion, its angles, torque and toes, in the browser
  compass inspect REC --animation walk.svg     the robot in motion, for a document
  compass inspect REC --band 8,13 --from 2     how much the hip shakes between 8 and 13 Hz while armed
  compass inspect REC --config > robot.toml    the recorded configuration, usable as --config

Exit codes: 0 whole and without faults, 1 torn, drops, gaps or faults, 3 not readable.")]
pub(crate) struct Args {
    /// The recording
    #[arg(value_name = "REC")]
    recording: PathBuf,
    /// Prints the configuration it was made with, nothing else
    #[arg(long)]
    config: bool,
    /// Draws the recorded run into this page: animation, legs, torque, toes, speed of each step
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
    /// Draws the robot's first 15 s of walking into this animated SVG, for a document
    #[arg(long, value_name = "FILE")]
    animation: Option<PathBuf>,
    /// Prints how strong the hip's signals are between two frequencies in Hz while armed, nothing else
    #[arg(long, value_name = "LOW,HIGH", value_parser = parse_band)]
    band: Option<Band>,
    /// Leaves out what was before this time, s since the first tick (with --band)
    #[arg(long, value_name = "S", default_value_t = 0.0, requires = "band")]
    from: f64,
    /// Most events to show
    #[arg(long, value_name = "N", default_value_t = 30)]
    events: usize,
}

impl Run for Args {
    fn run(self) -> anyhow::Result<Outcome> {
        let input = std::slice::from_ref(&self.recording);
        spare_inputs("--page", &self.page, input)?;
        spare_inputs("--animation", &self.animation, input)?;
        if let Some(band) = self.band {
            write_band(&mut io::stdout().lock(), &self.recording, band, self.from)?;
            return Ok(Outcome::Fine);
        }
        if let Some(file) = &self.page {
            page::write(&self.recording, file)?;
            writeln!(io::stdout(), "{}", file.display())?;
            return Ok(Outcome::Fine);
        }
        if let Some(file) = &self.animation {
            page::write_animation(&self.recording, file)?;
            writeln!(io::stdout(), "{}", file.display())?;
            return Ok(Outcome::Fine);
        }
        let found = inspect(&self.recording)?;
        let mut out = io::stdout().lock();
        if self.config {
            let text = found.about.config_text.as_deref();
            out.write_all(text.ok_or_else(|| anyhow::anyhow!("the recording holds no configuration"))?.as_bytes())?;
            return Ok(Outcome::Fine);
        }
        write_about(&mut out, &found)?;
        write_streams(&mut out, &found)?;
        write_losses(&mut out, &found)?;
        write_events(&mut out, &found, self.events)?;
        Ok(if found.has_findings() { Outcome::Finding } else { Outcome::Fine })
    }
}

/// A range of frequencies, Hz.
#[derive(Clone, Copy, Debug)]
struct Band {
    low_hz: f64,
    high_hz: f64,
}

fn parse_band(text: &str) -> Result<Band, String> {
    let parts = text.split_once(',').and_then(|(low, high)| Some((low.parse().ok()?, high.parse().ok()?)));
    match parts {
        Some((low_hz, high_hz)) if 0.0 < low_hz && low_hz < high_hz => Ok(Band { low_hz, high_hz }),
        _ => Err("two frequencies in Hz, such as 8,13".into()),
    }
}

/// Signals of the longest armed stretch: column, factor to the unit shown, the unit.
const SHAKING: [(&str, f64, &str); 2] = [("hip_torque_nm", 1.0, "Nm"), ("hip_angle_rad", 180.0 / PI, "deg")];

fn write_band(out: &mut impl Write, recording: &Path, band: Band, from_s: f64) -> anyhow::Result<()> {
    let own = Own::read(recording)?;
    let column = |name: &str| own.table.column(name, None).map_err(|lines| anyhow::anyhow!(lines.join("\n")));
    let times = column("t_s")?;
    let from = times.partition_point(|t| *t < from_s);
    let seconds = times.last().map_or(0.0, |last| last - times.get(from).copied().unwrap_or(*last));
    writeln!(out, "armed and after {from_s} s: {seconds:.1} s")?;
    let Band { low_hz, high_hz } = band;
    for (name, factor, unit) in SHAKING {
        let rms = factor * band_rms(&times[from..], &column(name)?[from..], low_hz, high_hz);
        writeln!(out, "{name:16} rms between {low_hz} and {high_hz} Hz: {rms:.4} {unit}")?;
    }
    Ok(())
}

fn write_about(out: &mut impl Write, found: &Inspection) -> io::Result<()> {
    let word = |name| found.about.program(name).unwrap_or("unknown");
    writeln!(out, "program   compass {}, sha256 {}", word("version"), word("binary_sha256"))?;
    writeln!(out, "config    sha256 {}", word("config_sha256"))?;
    match found.ending {
        Some(Ending::Whole) => writeln!(out, "file      whole"),
        Some(Ending::Torn { at }) => writeln!(out, "file      TORN at byte {at}: its writer {}", torn_by(found)),
        Some(Ending::Damaged { at }) => writeln!(out, "file      DAMAGED at byte {at}"),
        None => Ok(()),
    }
}

/// Why a file may have no end. What its recorder said last is inside.
fn torn_by(found: &Inspection) -> &'static str {
    match found.recorder.map(|recorder| recorder.state) {
        Some(RecorderState::DiskFull) => "found the disk full",
        Some(RecorderState::DiskError) => "was refused by the disk",
        _ => "was killed, lost power or found the disk full",
    }
}

fn write_streams(out: &mut impl Write, found: &Inspection) -> io::Result<()> {
    writeln!(out, "\nstream       messages   rate Hz   from s     to s   longest gap ms   at s")?;
    for (stream, figures) in Stream::ALL.into_iter().zip(&found.streams) {
        let Some((first, last)) = figures.span else {
            writeln!(out, "{:10} {:10}", stream.name(), 0)?;
            continue;
        };
        let rate = figures.rate_hz().map_or_else(|| "-".into(), |hz| format!("{hz:.1}"));
        let (name, count) = (stream.name(), figures.count);
        let (gap_ms, gap_s) = (figures.longest_gap.as_us() * 1e-3, since_start(found, figures.gap_at));
        let (first, last) = (since_start(found, first), since_start(found, last));
        writeln!(out, "{name:10} {count:10} {rate:>9} {first:8.3} {last:8.3} {gap_ms:16.3} {gap_s:6.3}")?;
    }
    Ok(())
}

/// Seconds since the first tick.
fn since_start(found: &Inspection, stamp: Stamp) -> f64 {
    let start = found.streams[Stream::Tick as usize].span.map_or(Stamp(0), |(first, _)| first);
    stamp.since(start).as_s()
}

fn write_losses(out: &mut impl Write, found: &Inspection) -> io::Result<()> {
    writeln!(out)?;
    if let Some((first, last)) = found.ticks {
        let (_, at) = found.streams[Stream::Tick as usize].span.unwrap_or_default();
        let missing = found.missing_ticks;
        writeln!(
            out,
            "ticks     {first} to {last}, {missing} missing, the last at {:.3} s of its computer's uptime",
            at.as_s()
        )?;
    }
    if let Some(recorder) = found.recorder {
        let state = if recorder.state == RecorderState::Recording { "" } else { recorder.state.name() };
        let (dropped, peak) = (recorder.dropped, recorder.queue_peak);
        let sync_ms = found.longest_sync.as_s() * 1e3;
        writeln!(out, "recorder  {dropped} dropped, at most {peak} waiting, longest sync {sync_ms:.1} ms {state}")?;
    }
    writeln!(out, "inputs    {} frames and IMU messages lost before the tick", found.input_drops)?;
    if let Some(status) = found.status {
        let ends = found.events.iter().filter(|(_, event)| is_ordinary_end(event)).count();
        let faults = status.faults.saturating_sub(u32::try_from(ends).unwrap_or(u32::MAX));
        writeln!(out, "loop      {} ticks, {} periods skipped, {faults} faults", status.ticks, status.overruns)?;
    }
    Ok(())
}

fn write_events(out: &mut impl Write, found: &Inspection, most: usize) -> io::Result<()> {
    writeln!(out, "\nevents")?;
    for (stamp, event) in found.events.iter().take(most) {
        writeln!(out, "{:10.3} s  {}", since_start(found, *stamp), describe(event))?;
    }
    let more = found.events.len().saturating_sub(most) as u64 + found.more_events;
    if more > 0 {
        writeln!(out, "           and {more} more")?;
    }
    Ok(())
}

fn is_ordinary_end(event: &Event) -> bool {
    matches!(event, Event::Fault(fault) if fault.code.is_ordinary_end())
}

fn describe(event: &Event) -> String {
    match event {
        Event::Mode(mode) => format!("mode {}", mode.name()),
        Event::Fault(fault) if fault.code.is_ordinary_end() => format!("ended by {}", fault.code.name()),
        Event::Fault(fault) => format!("fault {} {fault}", fault.code as u8),
        Event::MissingTicks(expected, came) => format!("recording misses ticks {expected} to {}", came - 1),
        Event::Overrun(periods) => format!("{periods} periods skipped"),
    }
}
