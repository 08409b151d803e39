//! Does what is still to do of an experiment, on some threads. RT: no.
//!
//! Each run is deterministic by itself, so neither the number of threads nor the order matters.

use super::ledger::{Ledger, RunId};
use super::plan::{Plan, RunPlan};
use super::results::is_of;
use super::trial_run::{self, Place, RunRecord};
use crate::config::{self, Choice, Errors, Problem, Resolved, Setting, fault};
use crate::record::log_file::binary_hash;
use crate::sim::lockstep::LockstepError;
use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc;

/// Draws of one seed until a robot can start from one.
const MOST_REDRAWS: u32 = 200;

/// Why an experiment cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum CampaignError {
    /// The configuration of some runs is wrong.
    #[error("{0}")]
    Config(Errors),
    /// There is nothing to step.
    #[error("run {index}: {cause}")]
    Lockstep {
        /// Number of the run.
        index: usize,
        /// Why.
        cause: LockstepError,
    },
    /// The disk.
    #[error("records: {0}")]
    Disk(#[from] io::Error),
}

/// What beside the file decides a run.
#[derive(Clone, Debug, Default)]
pub struct Base {
    /// Folder or file of the configuration.
    pub config: Option<PathBuf>,
    /// What observer and controller believe.
    pub model: Option<PathBuf>,
    /// Keys from the command line: go last.
    pub overrides: Vec<Setting>,
}

/// How to run.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Threads.
    pub jobs: usize,
    /// This shard, from 1, and how many there are.
    pub shard: [usize; 2],
}

/// What has happened, for the progress bar.
#[derive(Clone, Copy, Debug)]
pub enum Progress {
    /// So much more of all runs of this shard is done, in thousandths of a run.
    Part(u64),
    /// A run ended.
    Ended(trial_run::Ended),
}

/// A run and its configuration.
struct Ready {
    resolved: Resolved,
    place: Place,
    id: RunId,
}

/// An experiment with all that decides its runs.
#[derive(Debug)]
pub struct Campaign {
    plan: Plan,
    base: Base,
    runs: Vec<RunPlan>,
}

impl Campaign {
    /// Of a plan.
    #[must_use]
    pub fn new(plan: Plan, base: Base) -> Self {
        let runs = plan.runs();
        Self { plan, base, runs }
    }

    /// The plan.
    #[must_use]
    pub const fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Number of runs.
    #[must_use]
    pub fn len(&self) -> usize {
        self.runs.len()
    }

    /// No runs at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.runs.is_empty()
    }

    /// Configuration of a run. What was drawn and gives no configuration is drawn again.
    fn ready(&self, run: &RunPlan) -> Result<Ready, Errors> {
        let mut redraws = 0;
        loop {
            let mut set = run.overrides.clone();
            set.extend(run.drawn(redraws));
            set.extend(self.base.overrides.iter().cloned());
            let choice = Choice {
                path: self.base.config.as_deref(),
                model: self.base.model.as_deref(),
                overrides: &set,
                faults: &[],
                place: Some(fault::Place::Sim),
                plays_robot: false,
            };
            match config::load_choice(choice) {
                Ok(resolved) => {
                    let id = RunId::new(&resolved.hash, &self.plan.stop, binary_hash());
                    let set = set.into_iter().map(|setting| setting.text).collect();
                    let place = Place { index: run.index, axes: run.axes.clone(), seed: run.seed, redraws, set };
                    return Ok(Ready { resolved, place, id });
                }
                Err(_) if run.draws() && redraws < MOST_REDRAWS => redraws += 1,
                Err(errors) => return Err(errors),
            }
        }
    }

    /// Configurations of some runs, or everything that is wrong with any of them.
    fn ready_all<'a>(&'a self, runs: impl Iterator<Item = &'a RunPlan>) -> Result<Vec<Ready>, CampaignError> {
        let (mut all, mut wrong) = (Vec::new(), Wrong::default());
        for run in runs {
            if wrong.has(run) {
                continue;
            }
            match self.ready(run) {
                Ok(ready) => all.push(ready),
                Err(errors) => wrong.add(run, errors),
            }
        }
        if wrong.problems.is_empty() { Ok(all) } else { Err(CampaignError::Config(Errors(wrong.problems))) }
    }

    /// Runs of a shard that the ledger does not have.
    fn open_runs(&self, ledger: &Ledger, shard: [usize; 2]) -> Result<Vec<Ready>, CampaignError> {
        let mine = self.runs.iter().filter(|run| is_of(shard, run.index));
        let mut open = self.ready_all(mine)?;
        open.retain(|ready| ledger.find(&ready.id).is_none());
        Ok(open)
    }

    /// How many runs of a shard are still to do.
    ///
    /// # Errors
    /// A configuration that is wrong.
    pub fn open(&self, ledger: &Ledger, shard: [usize; 2]) -> Result<usize, CampaignError> {
        Ok(self.open_runs(ledger, shard)?.len())
    }

    /// Does what is missing of a shard; every record is on the disk before the next is looked at. How many there were.
    ///
    /// # Errors
    /// The first [`CampaignError`]; what was done stays done.
    pub fn go(
        &self,
        ledger: &mut Ledger,
        effort: Effort,
        mut tell: impl FnMut(Progress),
    ) -> Result<usize, CampaignError> {
        let open = self.open_runs(ledger, effort.shard)?;
        let (next, stop) = (AtomicUsize::new(0), AtomicBool::new(false));
        let (to_us, from_threads) = mpsc::channel();
        std::thread::scope(|scope| {
            for _ in 0..effort.jobs.clamp(1, open.len().max(1)) {
                let (to_us, open, next, stop) = (to_us.clone(), &open, &next, &stop);
                scope.spawn(move || {
                    while let Some(ready) = open.get(next.fetch_add(1, Ordering::Relaxed)) {
                        if stop.load(Ordering::Relaxed) || self.one(ready, stop, &to_us).is_err() {
                            return;
                        }
                    }
                });
            }
            drop(to_us);
            let result = keep(ledger, effort.shard, from_threads, &mut tell);
            stop.store(true, Ordering::Relaxed);
            result
        })?;
        Ok(open.len())
    }

    /// One run on its thread. An error when nobody listens any more.
    fn one(
        &self,
        ready: &Ready,
        stop: &AtomicBool,
        to_us: &mpsc::Sender<Report>,
    ) -> Result<(), mpsc::SendError<Report>> {
        let mut told = 0;
        let look = |part: f64| {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 1000")]
            let now = (part * 1000.0) as u64;
            let more = now.saturating_sub(told);
            told = told.max(now);
            to_us.send(Report::Part(more)).is_ok() && !stop.load(Ordering::Relaxed)
        };
        let result = trial_run::run(&ready.resolved, ready.place.clone(), &self.plan.stop, look);
        match result {
            Ok(None) => Ok(()),
            Ok(Some(run)) => to_us.send(Report::Run(Box::new((ready.id.clone(), run, 1000 - told)))),
            Err(cause) => to_us.send(Report::Failed(ready.place.index, cause)),
        }
    }

    /// Records of all runs of the plan that the ledger has, in the plan's order.
    ///
    /// # Errors
    /// A configuration that is wrong.
    pub fn records(&self, ledger: &Ledger) -> Result<Vec<RunRecord>, CampaignError> {
        let mut records = Vec::new();
        for (run, ready) in self.runs.iter().zip(self.ready_all(self.runs.iter())?) {
            if let Some(record) = ledger.find(&ready.id) {
                // The same run may stand at another place of another plan.
                records.push(RunRecord { index: run.index, axes: run.axes.clone(), ..record.clone() });
            }
        }
        Ok(records)
    }
}

/// What is wrong with the configurations of runs, each thing once.
#[derive(Default)]
struct Wrong {
    problems: Vec<Problem>,
    axes: BTreeSet<BTreeMap<String, String>>,
}

impl Wrong {
    /// A run with the same axes was wrong: another seed tells nothing new, and may take many draws.
    fn has(&self, run: &RunPlan) -> bool {
        self.axes.contains(&run.axes)
    }

    fn add(&mut self, run: &RunPlan, errors: Errors) {
        for mut problem in errors.0 {
            let place = |p: &Problem| (p.file.clone(), p.line, p.key.clone(), p.value.clone());
            let is_known = |known: &Problem| place(known) == place(&problem) && known.what.starts_with(&problem.what);
            if self.problems.iter().any(is_known) {
                continue;
            }
            if problem.value.is_none() && !run.axes.is_empty() {
                // It is about several keys: the axes tell which values do not go together.
                let axes: Vec<String> = run.axes.iter().map(|(key, label)| format!("{key}={label}")).collect();
                problem.what = format!("{} (run {}: {})", problem.what, run.index, axes.join(", "));
            }
            self.problems.push(problem);
        }
        self.axes.insert(run.axes.clone());
    }
}

enum Report {
    Part(u64),
    Run(Box<(RunId, RunRecord, u64)>),
    Failed(usize, LockstepError),
}

fn keep(
    ledger: &mut Ledger,
    shard: [usize; 2],
    reports: mpsc::Receiver<Report>,
    tell: &mut impl FnMut(Progress),
) -> Result<(), CampaignError> {
    for report in reports {
        match report {
            Report::Part(part) => tell(Progress::Part(part)),
            Report::Run(done) => {
                let (id, run, rest) = *done;
                tell(Progress::Part(rest));
                tell(Progress::Ended(run.end));
                ledger.append(shard, id, run)?;
            }
            Report::Failed(index, cause) => return Err(CampaignError::Lockstep { index, cause }),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_wrong_with_any_run_is_told_once_with_its_line_in_the_file() {
        let text = "about = \"t\"\nseeds = \"1..3\"\n[set]\nsim.on_blocks = true\ncontrol.controllr = \"walk\"\n\
            [axes]\ncontrol.controller = [\"idle\", \"wlak\", \"balnce\"]\n\
            [draw]\nsim.release_after_s = [1.0, 2.0]\n[stop]\ntime_s = 1.0\n";
        let base = Base { overrides: vec![Setting::of_option("--set", "rt.core=-1")], ..Base::default() };
        let campaign = Campaign::new(Plan::parse("ex.toml", text).unwrap(), base);
        let folder = tempfile::tempdir().unwrap();
        let ledger = Ledger::open(folder.path(), binary_hash()).unwrap();
        let error = campaign.open(&ledger, [1, 1]).unwrap_err().to_string();
        assert!(error.contains("4 errors"), "{error}");
        for told in [
            "\n  ex.toml:5: control.controllr = \"walk\": unknown key",
            "\n  ex.toml:7: control.controller = \"wlak\": must be one of",
            "\n  ex.toml:7: control.controller = \"balnce\": must be one of",
            "\n  --set: rt.core = -1: ",
        ] {
            assert!(error.contains(told), "{told}: {error}");
        }
    }

    #[test]
    fn values_that_do_not_go_together_are_told_with_the_axes_of_the_run() {
        let text = "about = \"t\"\nseeds = \"1\"\n[axes]\nrobot.limits.overruns_per_s = [10]\n\
            robot.drives.inner_toe_a.node = [4, 1]\n[stop]\ntime_s = 1.0\n";
        let campaign = Campaign::new(Plan::parse("ex.toml", text).unwrap(), Base::default());
        let folder = tempfile::tempdir().unwrap();
        let error =
            campaign.open(&Ledger::open(folder.path(), binary_hash()).unwrap(), [1, 1]).unwrap_err().to_string();
        assert!(error.contains("robot.drives.inner_toe_a.node=1, robot.limits.overruns_per_s=10)"), "{error}");
    }
}
