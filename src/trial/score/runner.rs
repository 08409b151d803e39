//! Runs the diagnosis on cases as an outsider would: the binary, a folder in, a folder out. RT: no.
//!
//! A process of its own per case: the diagnosis cannot see a truth, a crash costs one case, and the time is what a user
//! waits.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// How often a running diagnosis is looked at.
const POLL: Duration = Duration::from_millis(20);

/// How to run.
#[derive(Debug, Clone)]
pub struct Runner {
    /// The `compass` binary.
    pub program: PathBuf,
    /// Answers go to `answers/<case>/`.
    pub answers: PathBuf,
    /// Cases at the same time; the cores are divided among them.
    pub jobs: usize,
    /// A diagnosis that takes longer is stopped.
    pub limit: Duration,
    /// Keep answers that are already there.
    pub reuse: bool,
}

/// How one run ended.
#[derive(Debug, Clone, PartialEq)]
pub enum RunEnd {
    /// With exit status 0 or 1, after so many seconds.
    Answered(f64),
    /// An answer was already there.
    Reused,
    /// Without an answer: what was said, or that it was stopped.
    Failed(String),
}

impl Runner {
    /// Diagnoses all cases; results in the order of the cases. `done` hears of each as it ends.
    pub fn run_all(&self, cases: &[PathBuf], done: impl Fn(&Path, &RunEnd) + Sync) -> Vec<RunEnd> {
        let next = AtomicUsize::new(0);
        let ends = Mutex::new(vec![RunEnd::Failed("never started".to_owned()); cases.len()]);
        thread::scope(|scope| {
            for _ in 0..self.jobs.max(1) {
                scope.spawn(|| {
                    while let Some((index, case)) = take(&next, cases) {
                        let end = self.run(case);
                        done(case, &end);
                        if let Ok(mut ends) = ends.lock() {
                            ends[index] = end;
                        }
                    }
                });
            }
        });
        ends.into_inner().unwrap_or_default()
    }

    /// Where the answer of a case goes.
    pub fn answer_of(&self, case: &Path) -> PathBuf {
        self.answers.join(case.file_name().unwrap_or_default()).join("diagnosis.json")
    }

    fn run(&self, case: &Path) -> RunEnd {
        let answer = self.answer_of(case);
        if self.reuse && answer.exists() {
            return RunEnd::Reused;
        }
        let start = Instant::now();
        match self.spawn(case).and_then(|child| wait(child, start, self.limit)) {
            Ok(None) => RunEnd::Answered(start.elapsed().as_secs_f64()),
            Ok(Some(complaint)) => RunEnd::Failed(complaint),
            Err(error) => RunEnd::Failed(error.to_string()),
        }
    }

    fn spawn(&self, case: &Path) -> std::io::Result<Child> {
        let (out, answer) = (self.answers.join(case.file_name().unwrap_or_default()), self.answer_of(case));
        std::fs::create_dir_all(&out)?;
        // An old answer must not pass for one of this run. Whatever else lies in the folder is not ours to remove.
        if answer.exists() {
            std::fs::remove_file(&answer)?;
        }
        let talk = std::fs::File::create(out.join("stderr.txt"))?;
        let cores = thread::available_parallelism().map_or(1, usize::from);
        Command::new(&self.program)
            .args(["diagnose".as_ref(), case.as_os_str(), "--out".as_ref(), out.as_os_str()])
            .env("RAYON_NUM_THREADS", (cores / self.jobs.max(1)).max(1).to_string())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(talk)
            .spawn()
    }

    /// Runs the program with other arguments; nothing of what it prints is kept.
    ///
    /// # Errors
    /// What went wrong, in words.
    pub fn call(program: &Path, args: &[OsString], limit: Duration) -> Result<(), String> {
        let mut command = Command::new(program);
        command.args(args).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        match command.spawn().and_then(|child| wait(child, Instant::now(), limit)) {
            Ok(None) => Ok(()),
            Ok(Some(complaint)) => Err(complaint),
            Err(error) => Err(error.to_string()),
        }
    }
}

/// Waits for the end; what went wrong, if something did.
fn wait(mut child: Child, start: Instant, limit: Duration) -> std::io::Result<Option<String>> {
    loop {
        if let Some(status) = child.try_wait()? {
            let fine = matches!(status.code(), Some(0 | 1));
            return Ok((!fine).then(|| status.to_string()));
        }
        if start.elapsed() > limit {
            child.kill()?;
            child.wait()?;
            return Ok(Some(format!("stopped after {} s", limit.as_secs())));
        }
        thread::sleep(POLL);
    }
}

fn take<'a>(next: &AtomicUsize, cases: &'a [PathBuf]) -> Option<(usize, &'a PathBuf)> {
    let index = next.fetch_add(1, Ordering::Relaxed);
    cases.get(index).map(|case| (index, case))
}
