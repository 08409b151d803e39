//! Records of runs on disk: one line each, appended and flushed as soon as a run ends. RT: no.
//!
//! A killed experiment goes on where it was: a line that was cut short is dropped, a run whose identity (configuration,
//! stopping rule, build of the program) is there is not run again. Every shard has a file of its own; all files of the folder
//! count, so merging is reading.

use super::plan::Stop;
use super::trial_run::RunRecord;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::HashMap;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Why the records of a folder cannot be gone on with.
#[derive(Debug, thiserror::Error)]
pub enum LedgerError {
    /// The disk.
    #[error(transparent)]
    Disk(#[from] io::Error),
    /// Some were made by another build, which may walk differently.
    #[error(
        "{file}: holds runs of another build of compass (binary_sha256 {theirs}, here {ours}); use that build, or \
         another folder"
    )]
    OtherBuild {
        /// Which file.
        file: String,
        /// SHA-256 of the executable that made them.
        theirs: String,
        /// SHA-256 of this one.
        ours: String,
    },
}

/// Identity of a run: SHA-256 of all that decides it, hexadecimal.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct RunId(String);

impl RunId {
    /// Of a configuration (by its hash) under a stopping rule, in a build of the program (by its executable's hash).
    #[must_use]
    pub fn new(config_hash: &str, stop: &Stop, build: &str) -> Self {
        let text = format!("{config_hash} {stop:?} {build}");
        Self(Sha256::digest(text.as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect())
    }
}

#[derive(Serialize, Deserialize)]
struct Line {
    id: RunId,
    /// SHA-256 of the executable that ran it.
    #[serde(default = "unknown")]
    binary_sha256: String,
    run: RunRecord,
}

/// Records of before builds were told apart do not say theirs.
fn unknown() -> String {
    "unknown".into()
}

/// The records of a folder, and a file to append to.
#[derive(Debug)]
pub struct Ledger {
    folder: PathBuf,
    build: String,
    file: Option<File>,
    done: HashMap<RunId, RunRecord>,
}

impl Ledger {
    /// All records in the folder, which is made if it is not there. All must be of this build (hash of its executable).
    ///
    /// # Errors
    /// [`LedgerError`].
    pub fn open(folder: &Path, build: &str) -> Result<Self, LedgerError> {
        fs::create_dir_all(folder)?;
        let mut done = HashMap::new();
        let mut files: Vec<PathBuf> = fs::read_dir(folder)?.filter_map(|f| Some(f.ok()?.path())).collect();
        files.sort();
        for file in files.iter().filter(|f| is_ledger(f)) {
            for line in fs::read_to_string(file)?.lines() {
                // A line that was cut short by a kill is no record.
                let Ok(Line { id, binary_sha256: theirs, run }) = serde_json::from_str(line) else { continue };
                if theirs != build {
                    let file = file.display().to_string();
                    return Err(LedgerError::OtherBuild { file, theirs, ours: build.to_owned() });
                }
                done.insert(id, run);
            }
        }
        Ok(Self { folder: folder.to_owned(), build: build.to_owned(), file: None, done })
    }

    /// Record of a run, if it was done.
    #[must_use]
    pub fn find(&self, id: &RunId) -> Option<&RunRecord> {
        self.done.get(id)
    }

    /// Appends a record to the file of `shard` (1-based, of so many) and makes sure that it is on the disk.
    ///
    /// # Errors
    /// The disk's.
    pub fn append(&mut self, shard: [usize; 2], id: RunId, run: RunRecord) -> io::Result<()> {
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(begin(&self.folder.join(format!("runs-{}-of-{}.jsonl", shard[0], shard[1])))?),
        };
        let line = Line { id, binary_sha256: self.build.clone(), run };
        let mut text = serde_json::to_string(&line)?;
        text.push('\n');
        file.write_all(text.as_bytes())?;
        file.sync_data()?;
        self.done.insert(line.id, line.run);
        Ok(())
    }
}

fn is_ledger(path: &Path) -> bool {
    path.file_name().and_then(|n| n.to_str()).is_some_and(|n| n.starts_with("runs") && n.ends_with(".jsonl"))
}

/// Opens for appending; what a kill left without its end of line gets one, so that it spoils no other.
fn begin(path: &Path) -> io::Result<File> {
    let torn = fs::read(path).is_ok_and(|bytes| bytes.last().is_some_and(|last| *last != b'\n'));
    let mut file = OpenOptions::new().create(true).append(true).open(path)?;
    if torn {
        file.write_all(b"\n")?;
    }
    Ok(file)
}

/// Writes a whole file, or leaves the old one: through a temporary one beside it.
///
/// # Errors
/// The disk's.
pub fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let beside = path.with_extension(format!("{}.part", std::process::id()));
    let mut file = File::create(&beside)?;
    file.write_all(bytes)?;
    file.sync_all()?;
    fs::rename(&beside, path)
}

#[cfg(test)]
mod tests {
    use super::super::results::tests::run;
    use super::super::trial_run::Ended;
    use super::*;

    #[test]
    fn runs_of_another_build_are_not_taken_for_runs_of_this_one() {
        let folder = tempfile::tempdir().unwrap();
        let stop = Stop { steps: None, time_s: 1.0 };
        let mut ledger = Ledger::open(folder.path(), "aa").unwrap();
        let id = RunId::new("0", &stop, "aa");
        assert_ne!(id, RunId::new("0", &stop, "bb"));
        ledger.append([1, 1], id.clone(), run(0, "walk", 0.0, 9, Ended::Completed)).unwrap();
        assert!(Ledger::open(folder.path(), "aa").unwrap().find(&id).is_some(), "the same build goes on");
        let error = Ledger::open(folder.path(), "bb").unwrap_err().to_string();
        assert!(error.contains("runs-1-of-1.jsonl") && error.contains("binary_sha256 aa, here bb"), "{error}");
    }

    #[test]
    fn runs_that_do_not_tell_their_build_are_of_another_one() {
        let folder = tempfile::tempdir().unwrap();
        let mut ledger = Ledger::open(folder.path(), "aa").unwrap();
        let id = RunId::new("0", &Stop { steps: None, time_s: 1.0 }, "aa");
        ledger.append([1, 1], id, run(0, "walk", 0.0, 9, Ended::Completed)).unwrap();
        let file = folder.path().join("runs-1-of-1.jsonl");
        let text = fs::read_to_string(&file).unwrap().replace("\"binary_sha256\":\"aa\",", "");
        fs::write(&file, text).unwrap();
        assert!(matches!(Ledger::open(folder.path(), "aa"), Err(LedgerError::OtherBuild { .. })));
    }
}
