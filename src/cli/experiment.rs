//! `compass experiment`: many runs in lockstep, what they say together, as `results.json` and a page. RT: no.

use super::config_args::ConfigArgs;
use super::output::{must_be_folder, spare_inputs};
use super::{MOST_JOBS, Outcome, Run, UsageError, from_one, progress};
use crate::experiment::campaign::{Base, Campaign, CampaignError, Effort, Progress};
use crate::experiment::ledger::{Ledger, LedgerError, write_whole};
use crate::experiment::plan::{self, Plan};
use crate::experiment::results::Results;
use crate::experiment::{draw, trial_run::Ended};
use crate::record::log_file::binary_hash;
use crate::report::page;
use crate::report::plot::{Plot, sheet};
use anyhow::Context;
use sha2::{Digest, Sha256};
use std::fs;
use std::io::{self, Write};
use std::path::PathBuf;

/// Runs an experiment: every combination of its axes with every seed, in lockstep, on all cores.
///
/// Goes on where it was when it is started again in the same folder. Writes results.json, report.html
/// and plots.svg.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass experiment config/experiments/level.toml --out out/level
  compass experiment config/experiments/rough.toml --out out/rough --seeds 1..4 --jobs 2     a first look
  compass experiment config/experiments/rough.toml --out out/rough --shard 3/8               one of 8 batch jobs
  compass experiment config/experiments/rough.toml --out out/rough --merge                   what all shards have so far

Columns and page are explained in docs/experiments.md.
Exit codes: 0 every run (of the shard, with --shard) completed, 1 some did not, 2 usage or configuration, 3 a file.")]
pub(crate) struct Args {
    /// The experiment
    file: PathBuf,
    /// Folder of records, results.json, report.html and plots.svg
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Seeds instead of the file's, both included
    #[arg(long, value_name = "A..B", value_parser = plan::seeds)]
    seeds: Option<[u64; 2]>,
    /// Threads; all cores if left out
    #[arg(long, value_name = "N", value_parser = from_one::<usize>(MOST_JOBS))]
    jobs: Option<usize>,
    /// Only every n-th run, beginning with the k-th; the folder may be shared by all shards
    #[arg(long, value_name = "K/N", value_parser = shard)]
    shard: Option<[usize; 2]>,
    /// Runs nothing: writes results.json, report.html and plots.svg from the records that are there
    #[arg(long, conflicts_with = "shard")]
    merge: bool,
    #[command(flatten)]
    config: ConfigArgs,
}

/// What goes into the folder, beside the records.
const RESULTS: [&str; 3] = ["results.json", "report.html", "plots.svg"];

impl Run for Args {
    fn run(self) -> anyhow::Result<Outcome> {
        must_be_folder("--out", &self.out)?;
        let inputs = [self.config.files(), vec![self.file.clone()]].concat();
        spare_inputs("--out", RESULTS.map(|name| self.out.join(name)), &inputs)?;
        let text = fs::read_to_string(&self.file).with_context(|| self.file.display().to_string())?;
        let mut plan = Plan::parse(&self.file.display().to_string(), &text)?;
        plan.seeds = self.seeds.unwrap_or(plan.seeds);
        let base = Base {
            config: self.config.path.clone(),
            model: self.config.model.clone(),
            overrides: self.config.settings(),
        };
        let campaign = Campaign::new(plan, base);
        let ledger = self.ledger()?;
        if !self.merge {
            self.go(&campaign, ledger)?;
        }
        self.write(&campaign, &text)
    }
}

impl Args {
    /// What the folder holds at this moment.
    fn ledger(&self) -> anyhow::Result<Ledger> {
        Ledger::open(&self.out, binary_hash()).map_err(|error| match error {
            LedgerError::Disk(cause) => anyhow::Error::from(cause).context(self.out.display().to_string()),
            other @ LedgerError::OtherBuild { .. } => UsageError(format!("--out: {other}")).into(),
        })
    }

    /// All runs are the one shard of one.
    fn shard(&self) -> [usize; 2] {
        self.shard.unwrap_or([1, 1])
    }

    fn go(&self, campaign: &Campaign, mut ledger: Ledger) -> anyhow::Result<()> {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let effort = Effort { jobs: self.jobs.unwrap_or(cores), shard: self.shard() };
        let open = campaign.open(&ledger, effort.shard).map_err(usage)?;
        let bar = progress::bar(1000 * open as u64, "running");
        let (mut ended, mut completed) = (0_usize, 0_usize);
        let done = campaign.go(&mut ledger, effort, |what| match what {
            Progress::Part(part) => bar.inc(part),
            Progress::Ended(end) => {
                ended += 1;
                completed += usize::from(end == Ended::Completed);
                bar.set_message(format!("{ended} of {open} runs, {completed} completed"));
            }
        });
        bar.finish_and_clear();
        done.map(drop).map_err(usage)
    }

    fn write(&self, campaign: &Campaign, text: &str) -> anyhow::Result<Outcome> {
        // Read anew: other shards have gone on in the same folder meanwhile.
        let records = campaign.records(&self.ledger()?).map_err(usage)?;
        if records.is_empty() && self.merge {
            let text =
                format!("--merge: {}: holds no record of this experiment's runs; run it first", self.out.display());
            return Err(UsageError(text).into());
        }
        let sha256: String = Sha256::digest(text.as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect();
        let results = Results::new(&campaign.plan().about, &sha256, campaign.len(), records);
        let name = self.file.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let leg_length_m = self.config.load()?.config.body().leg_length_m.value;
        let told = draw::page(&name, &results, leg_length_m);
        let json = serde_json::to_string_pretty(&results)?;
        let [results_json, report_html, plots_svg] = RESULTS;
        write_whole(&self.out.join(results_json), json.as_bytes()).context(results_json)?;
        write_whole(&self.out.join(report_html), page::experiment(&told).as_bytes()).context(report_html)?;
        let plots: Vec<Plot> = told.chapters.iter().flat_map(|chapter| chapter.plots.clone()).collect();
        // One speed on one floor is nothing to draw over.
        let is_drawn = !plots.is_empty();
        if is_drawn {
            write_whole(&self.out.join(plots_svg), sheet(&plots).as_bytes()).context(plots_svg)?;
        }
        let mut out = io::stdout().lock();
        writeln!(out, "{}\n", told.headline)?;
        for chapter in &told.chapters {
            writeln!(out, "{}\n{}", chapter.heading, chapter.table.to_text())?;
        }
        for why in results.not_armed() {
            writeln!(out, "{why}")?;
        }
        let pages = if is_drawn { ", report.html and plots.svg" } else { " and report.html; there is nothing to draw" };
        writeln!(out, "written    {}{pages}", self.out.join("results.json").display())?;
        Ok(if results.all_completed(self.shard()) { Outcome::Fine } else { Outcome::Finding })
    }
}

/// A wrong configuration is the person's; the disk is not.
fn usage(error: CampaignError) -> anyhow::Error {
    match error {
        CampaignError::Disk(_) => error.into(),
        other => UsageError(other.to_string()).into(),
    }
}

/// `k/n`.
fn shard(text: &str) -> Result<[usize; 2], String> {
    let parsed = text.split_once('/').and_then(|(k, n)| Some([k.parse().ok()?, n.parse().ok()?]));
    parsed.filter(|[k, n]| (1..=*n).contains(k)).ok_or_else(|| format!("`{text}`: must be k/n with k from 1 to n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_count_from_one() {
        assert_eq!(shard("3/8"), Ok([3, 8]));
        for text in ["0/8", "9/8", "3", "3/0", "a/b"] {
            assert!(shard(text).is_err(), "{text}");
        }
    }

    #[test]
    fn nothing_to_merge_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let (file, out) = (folder.path().join("e.toml"), folder.path().join("out"));
        std::fs::write(&file, "about = \"a test\"\nseeds = \"1\"\n[stop]\ntime_s = 1.0\n").unwrap();
        let line = ["experiment", file.to_str().unwrap(), "--out", out.to_str().unwrap(), "--merge"];
        let error = crate::cli::tests::usage_error(&line);
        assert!(error.contains("holds no record of this experiment's runs"), "{error}");
        assert!(!out.join("results.json").exists());
    }
}
