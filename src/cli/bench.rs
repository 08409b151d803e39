//! `compass bench`: our figures beside those of what one would use instead. RT: the measured threads.

mod fit_time;

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context;

use super::config_args::ConfigArgs;
use super::output::spare_inputs;
use super::{Outcome, Run, progress};
use crate::config::Resolved;
use crate::config::checked::Config;
use crate::latency::cyclictest::CyclictestError;
use crate::latency::lcm_chain::LcmChain;
use crate::latency::our_chain::{Input, OurChain, Step};
use crate::latency::page::{self, Chapter};
use crate::latency::wakeup::Wakeup;
use crate::latency::window::{CpuTime, PERCENTILES, Paired};
use crate::latency::{hop, logging, step_cost};
use crate::report::table::{Align, Table};
use crate::rt::memory;
use crate::rt::thread::Awake;

/// Measures latency and recording beside cyclictest, LCM, raw iceoryx2 and mcap, in interleaved windows; or a fit's time.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass bench latency                              five windows of four seconds each
  compass bench latency --windows 9 --html bench.html
  compass bench latency --core 3 --priority 90
  compass bench identify CASE                        time of our fit against its cost; bench/identify/compare has the rivals

Needs cyclictest (rt-tests), gcc and liblcm-dev for the rivals, and SCHED_FIFO. A rival that is missing is told and left out.
Times on a virtual machine or a busy one mean little: the ratios are medians over pairs of windows, the stolen time is told.")]
pub(crate) struct Args {
    /// What to measure
    #[arg(value_parser = ["latency", "identify"])]
    what: String,
    /// Folder with rig.toml and its recordings (identify)
    #[arg(required_if_eq("what", "identify"))]
    case: Option<PathBuf>,
    /// Only one fit, with at most so many linearisations (identify)
    #[arg(long, value_name = "N")]
    iterations: Option<usize>,
    /// Stages of a growing horizon before the fit over whole windows, s (identify)
    #[arg(long, value_delimiter = ',', value_name = "S,..")]
    horizons: Vec<f64>,
    /// Windows of each rival
    #[arg(long, default_value_t = 5)]
    windows: usize,
    /// Length of a window, s
    #[arg(long, default_value_t = 4)]
    seconds: u32,
    /// FIFO priority of all measured threads
    #[arg(long, default_value_t = 80)]
    priority: u8,
    /// Core of all measured threads
    #[arg(long, default_value_t = 1)]
    core: usize,
    /// Writes a page with histograms here
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    #[command(flatten)]
    config: ConfigArgs,
}

/// Ticks in a window of recording: more than the recorder's queue holds.
const TICKS_LOGGED: usize = 8000;

/// One comparison, and what is aimed at.
struct Row {
    title: &'static str,
    rival: &'static str,
    /// Goal of the ratio at each of [`PERCENTILES`].
    goals: [Option<f64>; 4],
    pair: Paired,
}

impl Run for Args {
    fn run(self) -> anyhow::Result<Outcome> {
        if let (Some(case), "identify") = (&self.case, self.what.as_str()) {
            return fit_time::run(case, &self.horizons, self.iterations);
        }
        spare_inputs("--html", &self.html, &self.config.files())?;
        let resolved = self.config.load()?;
        let config = &resolved.config;
        // As the robot runs, and as cyclictest does for itself.
        let held = (Awake::hold(), memory::lock());
        let before = CpuTime::now();
        let mut rows = Vec::new();
        let mut left_out = Vec::new();
        self.wakeups(config, &mut rows, &mut left_out)?;
        self.chains(config, &mut rows, &mut left_out)?;
        self.hops(&mut rows)?;
        self.logging(&resolved, &mut rows)?;
        let costs = step_cost::all(config, 20_000).context("cost of a tick")?;
        let stolen = CpuTime::now().stolen_share_since(before);
        let (table, costs) = (ratio_table(&rows), costs.table());
        let notes = notes(stolen, &left_out);
        let mut out = std::io::stdout().lock();
        writeln!(out, "{}\n{}\n{notes}", table.to_text(), costs.to_text())?;
        if let Some(path) = &self.html {
            let chapters: Vec<Chapter> =
                rows.iter().map(|r| Chapter { title: r.title, rival: r.rival, pair: &r.pair }).collect();
            let tables = format!("{}<p>{notes}</p>{}", table.to_html(), costs.to_html());
            fs::write(path, page::html("Compass latency", &tables, &chapters))
                .with_context(|| path.display().to_string())?;
        }
        drop(held);
        Ok(Outcome::Fine)
    }
}

impl Args {
    fn frames(&self) -> usize {
        self.seconds as usize * 1000
    }

    fn wakeups(&self, config: &Config, rows: &mut Vec<Row>, left_out: &mut Vec<String>) -> anyhow::Result<()> {
        let wakeup = Wakeup {
            priority: self.priority,
            core: self.core,
            period_us: 1000,
            loops: self.seconds.saturating_mul(1000),
        };
        let bar = progress::bar(self.windows as u64, "wake-up beside cyclictest");
        let measured =
            wakeup.compare(self.windows, step_cost::idle_step(config)?, |done| bar.set_position(done as u64));
        bar.finish_and_clear();
        match measured {
            Ok(pairs) => {
                let goals = [Some(1.05), Some(1.05), Some(1.10), Some(1.25)];
                let rival = "cyclictest";
                rows.push(Row { title: "wake-up of the control thread", rival, goals, pair: pairs.working });
                rows.push(Row { title: "the same without a tick to do", rival, goals, pair: pairs.resting });
            }
            Err(error @ CyclictestError::Run(_)) => left_out.push(error.to_string()),
            Err(error) => return Err(error.into()),
        }
        Ok(())
    }

    /// All our ways in beside the one LCM chain, a window of each in turn.
    fn chains(&self, config: &Config, rows: &mut Vec<Row>, left_out: &mut Vec<String>) -> anyhow::Result<()> {
        const OURS: [(Input, &str, [Option<f64>; 4]); 3] = [
            (Input::Thread, "frame in → command out, I/O thread", [Some(0.35), None, Some(0.25), None]),
            (Input::Inline, "frame in → command out, inline", [Some(0.35), None, Some(0.25), None]),
            (Input::Spin, "frame in → command out, busy polling", [Some(0.05), None, None, None]),
        ];
        let folder = std::env::temp_dir().join(format!("compass-bench-{}", std::process::id()));
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        let mut pairs = [const { None::<Paired> }; OURS.len()];
        let bar = progress::bar((self.windows * OURS.len()) as u64, "frame in → command out beside LCM");
        for _ in 0..self.windows {
            for ((input, ..), pair) in OURS.iter().zip(&mut pairs) {
                // The rival runs only in its own windows, and so do we.
                let theirs = match LcmChain::start(&folder, self.priority, self.core) {
                    Ok(chain) => chain.window(self.frames(), Duration::from_millis(1))?,
                    Err(error) => {
                        left_out.push(error.to_string());
                        fs::remove_dir_all(&folder)?;
                        return Ok(());
                    }
                };
                clear(&folder)?;
                let step: Step = step_cost::idle_output(config)?;
                let chain = OurChain::start(&folder, *input, self.priority, self.core, step)?;
                let ours = chain.window(self.frames(), Duration::from_millis(1))?;
                drop(chain);
                clear(&folder)?;
                let pair = pair.get_or_insert_default();
                pair.ours.push(ours.window);
                pair.theirs.push(theirs.window);
                bar.inc(1);
            }
        }
        bar.finish_and_clear();
        fs::remove_dir_all(&folder)?;
        for ((_, title, goals), pair) in OURS.into_iter().zip(pairs) {
            rows.extend(pair.map(|pair| Row { title, rival: "LCM, three processes", goals, pair }));
        }
        Ok(())
    }

    fn hops(&self, rows: &mut Vec<Row>) -> anyhow::Result<()> {
        let goals = [Some(1.3), None, None, None];
        let frame = hop::frame(self.windows, 20_000)?;
        rows.push(Row { title: "channel hop, one frame", rival: "raw iceoryx2", goals, pair: frame });
        let tick = hop::tick_record(self.windows, 20_000)?;
        rows.push(Row { title: "channel hop, a whole tick", rival: "raw iceoryx2", goals, pair: tick });
        Ok(())
    }

    /// Sustained: at least 0.8 of the bare crate's rate, so at most 1.25 of its time.
    fn logging(&self, resolved: &Resolved, rows: &mut Vec<Row>) -> anyhow::Result<()> {
        let folder = std::env::temp_dir().join(format!("compass-bench-log-{}", std::process::id()));
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        let pair = logging::compare(resolved, &folder, self.windows, TICKS_LOGGED).context("recording");
        fs::remove_dir_all(&folder)?;
        let goals = [Some(1.25), None, None, None];
        rows.push(Row { title: "recording, per tick", rival: "bare mcap crate", goals, pair: pair? });
        Ok(())
    }
}

/// Removes the sockets of a chain that ended.
fn clear(folder: &Path) -> anyhow::Result<()> {
    for entry in fs::read_dir(folder)? {
        fs::remove_file(entry?.path())?;
    }
    Ok(())
}

fn ratio_table(rows: &[Row]) -> Table {
    let mut table = Table::new(&[
        ("measure", Align::Left),
        ("rival", Align::Left),
        ("percentile", Align::Right),
        ("ours, us", Align::Right),
        ("theirs, us", Align::Right),
        ("ratio", Align::Right),
        ("goal", Align::Right),
        ("", Align::Left),
    ]);
    for row in rows {
        // One sample a window has no percentiles.
        let told = if row.pair.ours.iter().all(|w| w.len() == 1) { 1 } else { PERCENTILES.len() };
        for (percent, goal) in PERCENTILES.into_iter().zip(row.goals).take(told) {
            let ratio = row.pair.ratio(percent);
            table.push([
                row.title.to_owned(),
                row.rival.to_owned(),
                format!("{percent}"),
                format!("{:.2}", row.pair.ours_us(percent)),
                format!("{:.2}", row.pair.theirs_us(percent)),
                format!("{ratio:.3}"),
                goal.map_or_else(String::new, |g| format!("{g}")),
                goal.map_or("", |g| if ratio <= g { "reached" } else { "not reached" }).to_owned(),
            ]);
        }
    }
    table
}

fn notes(stolen: f64, left_out: &[String]) -> String {
    let mut text = format!("Stolen by the hypervisor during the run: {:.2} % of all processor time.", 100.0 * stolen);
    for why in left_out {
        text.push_str(&format!("\nLeft out: {why}"));
    }
    text
}
