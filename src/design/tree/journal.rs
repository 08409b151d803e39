//! The tree's file on the way: written beside and renamed, so that it is whole whenever the program ends, kill -9 and
//! power included. The batches' sizes depend on the samples done alone, so going on gives the tree that would have been. RT: no.

use super::Terms;
use super::grow::Grower;
use crate::control::tables::PlanError;
use crate::control::tree::file::TreeFile;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Why a growth cannot go on with a file.
#[derive(Debug, thiserror::Error)]
pub enum JournalError {
    /// The file is no tree of this model.
    #[error(transparent)]
    Tree(#[from] PlanError),
    /// Grown on other terms.
    #[error(
        "{file}: grown on other terms, so it cannot be gone on with; write to another file\n  there {theirs}\n  here  {ours}"
    )]
    OtherTerms {
        /// Which.
        file: String,
        /// Its terms.
        theirs: String,
        /// The terms asked for.
        ours: String,
    },
    /// No balance for the robot.
    #[error("no balance: {0}")]
    Balance(#[from] crate::base::riccati::RiccatiError),
    /// Writing failed.
    #[error("{file}: {cause}")]
    Write {
        /// Which.
        file: String,
        /// Why.
        cause: io::Error,
    },
}

/// From the file if it exists, else from nothing.
///
/// # Errors
/// [`JournalError`]: the file is no tree, of another model, or grown on other terms.
pub fn open(path: &Path, terms: &Terms, command: &str) -> Result<Grower, JournalError> {
    if !path.exists() {
        return Ok(Grower::new(terms, command)?);
    }
    let file = TreeFile::read(path, &terms.robot)?;
    if file.terms != terms.text() {
        let file_name = path.display().to_string();
        return Err(JournalError::OtherTerms { file: file_name, theirs: file.terms, ours: terms.text() });
    }
    Ok(Grower::resume(terms, file)?)
}

/// Writes the whole tree, or leaves the file as it was.
///
/// # Errors
/// [`JournalError::Write`].
pub fn write(path: &Path, file: &TreeFile) -> Result<(), JournalError> {
    replace(path, file).map_err(|cause| JournalError::Write { file: path.display().to_string(), cause })
}

fn replace(path: &Path, file: &TreeFile) -> io::Result<()> {
    let text = file.to_text()?;
    let beside = beside(path);
    let mut out = File::create(&beside)?;
    out.write_all(text.as_bytes())?;
    out.sync_all()?;
    drop(out);
    fs::rename(&beside, path)?;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    File::open(folder)?.sync_all()
}

fn beside(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".part");
    path.with_file_name(name)
}
