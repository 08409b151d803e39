//! `compass trial --resplit`: recordings of hardware, split and disturbed in other ways, must get the same answer.
//! RT: no.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, bail};

use super::output::{is_same, spare_inputs};
use super::score::{diagnose, find_cases, inputs};
use super::{Outcome, UsageError, progress};
use crate::trial::resplit::{Report, Row, Settler, Variant, mark, write_variants};
use crate::trial::score::{Answer, Hardware, RunEnd, Runner, Truth, names};

/// What `compass trial --resplit` was told.
pub(super) struct Plan<'a> {
    /// Folder of cases, or one case.
    pub(super) cases: &'a Path,
    /// Folder of what is known of them.
    pub(super) truth: &'a Path,
    /// Folder of folders with further recordings, by name of the case.
    pub(super) recordings: Option<&'a Path>,
    /// Variants of each case.
    pub(super) variants: usize,
    /// Seed of the variants.
    pub(super) seed: u64,
    /// Where all goes.
    pub(super) out: &'a Path,
    /// Only cases with this in their names.
    pub(super) only: Option<&'a str>,
    /// Fit the forbidden effects as well, to settle what can be decided.
    pub(super) with_rivals: bool,
    /// Diagnoses at the same time.
    pub(super) jobs: usize,
    /// A diagnosis or a fit may take so long.
    pub(super) limit: Duration,
    /// Write the table here as well.
    pub(super) table: Option<&'a Path>,
}

impl Plan<'_> {
    /// Writes the variants, settles what they can decide, diagnoses and marks them. Answers and fits that are there are
    /// kept, so the same call goes on where it was interrupted.
    pub(super) fn run(&self) -> anyhow::Result<Outcome> {
        let truths = self.truths()?;
        let further = self.recordings.iter().flat_map(|more| truths.keys().map(|case| more.join(case)));
        self.spare_inputs(truths.values().map(|(folder, _)| folder.clone()).chain(further).collect())?;
        let variants = self.write(truths.keys())?;
        let program = std::env::current_exe().context("path of this program")?;
        let settler = Settler {
            program: program.clone(),
            folder: self.out.join("settled"),
            limit: self.limit,
            with_rivals: self.with_rivals,
        };
        let bar = progress::bar(variants.len() as u64, "fitting truth and rivals");
        let settled: Vec<_> = variants
            .iter()
            .map(|v| {
                let settled = settler.settle(&v.folder, &truths[&v.case].1);
                bar.inc(1);
                settled
            })
            .collect();
        bar.finish_and_clear();
        let runner =
            Runner { program, answers: self.out.join("answers"), jobs: self.jobs, limit: self.limit, reuse: true };
        let folders: Vec<PathBuf> = variants.iter().map(|v| v.folder.clone()).collect();
        let ends = diagnose(&runner, &folders);
        let rows = variants.iter().zip(ends).zip(settled).map(|((variant, end), settled)| {
            let answer = Answer::read(&runner.answer_of(&variant.folder));
            let unanswered = match (&end, &answer) {
                (RunEnd::Failed(why), _) => Some(why.clone()),
                (_, Err(error)) => Some(error.to_string()),
                _ => None,
            };
            let answer = answer.unwrap_or_else(|_| Answer::none());
            let marked = mark(&truths[&variant.case].1, &settled, &answer);
            Row {
                variant: variant.folder.file_name().unwrap_or_default().to_string_lossy().into_owned(),
                case: variant.case.clone(),
                note: variant.note.clone(),
                named: names(&answer),
                seconds: answer.seconds,
                unanswered,
                decidable: settled.is_decidable(),
                right: marked.right(),
                settled,
                mark: marked,
            }
        });
        self.tell(&Report { seed: self.seed, rows: rows.collect() })
    }

    /// Neither a case nor what is known of it may be replaced by variants or the table.
    fn spare_inputs(&self, cases: Vec<PathBuf>) -> Result<(), UsageError> {
        let variants = self.out.join("cases");
        if is_same(&variants, self.cases) {
            let what = "holds the cases themselves; the variants must go to another folder";
            return Err(UsageError(format!("--out: {}: {what}", variants.display())));
        }
        spare_inputs("--table", self.table, &inputs(&cases, self.truth))
    }

    /// Folder and truth of each case.
    fn truths(&self) -> anyhow::Result<BTreeMap<String, (PathBuf, Hardware)>> {
        let one = |folder: PathBuf| {
            let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
            match Truth::find(self.truth, &name)? {
                Truth::Hardware(truth) => Ok((name, (folder, truth))),
                Truth::Simulated(_) => bail!("{name}: --resplit is for hardware, of which {name}.toml tells"),
            }
        };
        find_cases(self.cases, self.only)?.into_iter().map(one).collect()
    }

    fn write<'c>(&self, cases: impl Iterator<Item = &'c String>) -> anyhow::Result<Vec<Variant>> {
        let mut all = Vec::new();
        for case in cases {
            let folder =
                if self.cases.join("rig.toml").exists() { self.cases.to_path_buf() } else { self.cases.join(case) };
            let more = self.recordings.map(|more| more.join(case)).filter(|more| more.is_dir());
            let out = self.out.join("cases");
            all.extend(write_variants(&folder, more.as_deref(), &out, (self.variants, self.seed))?);
        }
        Ok(all)
    }

    fn tell(&self, report: &Report) -> anyhow::Result<Outcome> {
        let text = format!("{}\n{}", report.table().to_text(), report.totals().to_text());
        std::io::stdout().write_all(text.as_bytes()).context("standard output")?;
        if let Some(path) = self.table {
            std::fs::write(path, &text).with_context(|| path.display().to_string())?;
        }
        let path = self.out.join("resplit.json");
        std::fs::write(&path, serde_json::to_string_pretty(report)?).with_context(|| path.display().to_string())?;
        Ok(if report.is_right() { Outcome::Fine } else { Outcome::Finding })
    }
}
