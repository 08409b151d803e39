//! `compass score`: one command that diagnoses all cases, compares with what is known and prints the table. RT: no.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, bail};

use super::output::{files_in, is_same, spare_inputs};
use super::{MOST_JOBS, Outcome, Run, UsageError, from_one, progress};
use crate::trial::score::{CaseMark, Row, RunEnd, Runner, case_table, row, totals_table};

/// Diagnose every case of a folder, compare with the truth, print the table.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass score CASES --truth DIR
  compass score CASES --truth DIR --answers /tmp/answers --reuse --only pendulum")]
pub(crate) struct Args {
    /// Folder of case folders, or one case folder.
    cases: PathBuf,
    /// Folder with CASE.json (truth of a trial) or CASE.toml (facts about hardware).
    #[arg(long)]
    truth: PathBuf,
    /// Cases at the same time.
    #[arg(long, default_value_t = 2, value_parser = from_one::<usize>(MOST_JOBS))]
    jobs: usize,
    /// Write the table here as well (text).
    #[arg(long)]
    out: Option<PathBuf>,
    /// Keep the answers here (default: a temporary folder, removed).
    #[arg(long)]
    answers: Option<PathBuf>,
    /// Do not repeat diagnoses whose answer is already in --answers.
    #[arg(long, requires = "answers")]
    reuse: bool,
    /// Only cases whose name contains this.
    #[arg(long)]
    only: Option<String>,
    /// Stop a diagnosis after so many seconds.
    #[arg(long, default_value_t = 180)]
    limit_s: u64,
}

impl Run for Args {
    /// A finding if a case is not right in every respect.
    fn run(self) -> anyhow::Result<Outcome> {
        let cases = find_cases(&self.cases, self.only.as_deref())?;
        let scratch = std::env::temp_dir().join(format!("compass-score-{}", std::process::id()));
        let runner = Runner {
            program: std::env::current_exe().context("path of this program")?,
            answers: self.answers.clone().unwrap_or_else(|| scratch.clone()),
            jobs: self.jobs,
            limit: Duration::from_secs(self.limit_s),
            reuse: self.reuse,
        };
        spare_cases(&runner, &cases)?;
        spare_inputs("--out", &self.out, &inputs(&cases, &self.truth))?;
        must_know(&self.truth, &cases)?;
        let rows = score(&runner, &cases, &diagnose(&runner, &cases), &self.truth);
        if self.answers.is_none() {
            // A folder that stays behind is no reason to lose the table.
            std::fs::remove_dir_all(&scratch).unwrap_or_default();
        }
        print(&rows, self.out.as_deref())
    }
}

/// Refuses a folder in which nothing is known of any case, before hours of diagnoses; tells of which cases nothing is.
fn must_know(truth: &Path, cases: &[PathBuf]) -> anyhow::Result<()> {
    let names = cases.iter().map(|case| case.file_name().unwrap_or_default().to_string_lossy().into_owned());
    let is_known = |name: &String| ["json", "toml"].iter().any(|end| truth.join(format!("{name}.{end}")).is_file());
    let unknown: Vec<String> = names.filter(|name| !is_known(name)).collect();
    if unknown.len() == cases.len() {
        let what = "must be a folder with CASE.json or CASE.toml of the cases; there is none of";
        let text = format!("--truth: {}: {what} {}", truth.display(), unknown.join(", "));
        return Err(UsageError(text).into());
    }
    for name in unknown {
        writeln!(std::io::stderr(), "warning: {}: nothing is known of {name}", truth.display())?;
    }
    Ok(())
}

/// All files that are read: those of the cases and what is known of them.
pub(super) fn inputs(cases: &[PathBuf], truth: &Path) -> Vec<PathBuf> {
    cases.iter().map(PathBuf::as_path).chain([truth]).flat_map(files_in).collect()
}

/// No answer may go into the folder of its case.
fn spare_cases(runner: &Runner, cases: &[PathBuf]) -> Result<(), UsageError> {
    let is_hit = |case: &&PathBuf| runner.answer_of(case).parent().is_some_and(|answer| is_same(answer, case));
    cases.iter().find(is_hit).map_or(Ok(()), |case| {
        let what = "the answer would go into the case; must be a folder without cases";
        Err(UsageError(format!("--answers: {}: {}: {what}", runner.answers.display(), case.display())))
    })
}

/// Diagnoses all cases, telling of failures on stderr.
pub(super) fn diagnose(runner: &Runner, cases: &[PathBuf]) -> Vec<RunEnd> {
    let bar = progress::bar(cases.len() as u64, "diagnosing");
    let ends = runner.run_all(cases, |case, end| {
        if let RunEnd::Failed(why) = end {
            bar.println(format!("{}: {why}", case.display()));
        }
        bar.inc(1);
    });
    bar.finish_and_clear();
    ends
}

/// Marks all cases.
pub(super) fn score(runner: &Runner, cases: &[PathBuf], ends: &[RunEnd], truth: &Path) -> Vec<Row> {
    cases.iter().zip(ends).map(|(case, end)| row(case, &runner.answer_of(case), truth, end)).collect()
}

/// Prints the tables; `Fine` if every case is right.
pub(super) fn print(rows: &[Row], out: Option<&Path>) -> anyhow::Result<Outcome> {
    let text = format!("{}\n{}", case_table(rows).to_text(), totals_table(rows).to_text());
    std::io::stdout().write_all(text.as_bytes()).context("standard output")?;
    if let Some(path) = out {
        std::fs::write(path, &text).with_context(|| path.display().to_string())?;
    }
    let right = rows.iter().all(|row| match &row.mark {
        CaseMark::Simulated(mark) => mark.right(),
        CaseMark::Hardware(mark) => mark.right(),
        CaseMark::Unknown(_) => false,
    });
    Ok(if right { Outcome::Fine } else { Outcome::Finding })
}

/// Case folders in order of their names: `folder` itself if it holds a rig, else its children that do.
pub(super) fn find_cases(folder: &Path, only: Option<&str>) -> anyhow::Result<Vec<PathBuf>> {
    if folder.join("rig.toml").exists() {
        // An answer is named like its case; `.` has no name.
        let named = if folder.file_name().is_some() { folder.to_path_buf() } else { folder.canonicalize()? };
        return Ok(vec![named]);
    }
    let mut cases = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.join("rig.toml").exists() && only.is_none_or(|only| name.contains(only)) {
            cases.push(path);
        }
    }
    if cases.is_empty() {
        bail!("{}: no case here (a case is a folder with rig.toml)", folder.display());
    }
    cases.sort();
    Ok(cases)
}
