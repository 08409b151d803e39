//! The concealed proof: truths drawn and sealed by one process, cases diagnosed by others, opened at the end.
//!
//! ```text
//! process 1 (generator)   seed ──> cases/trial-001/…          what the diagnosis sees
//!                              └─> truth.sealed, truth.sha256  what it cannot read; the hash is printed first
//!                              └─> key, to the parent only
//! processes 2..n          compass diagnose cases/trial-001 …
//! parent                  opens truth.sealed, checks the hash, writes truth/*.json, scores
//! ```
//! The seal hides the truth from any program that merely reads the disk, and the hash shows everybody that it was not
//! changed afterwards. It is no protection against a diagnosis that would draw the same seed: it is not told the seed.
//! RT: no.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha20Rng;
use sha2::{Digest, Sha256};

use super::generator::{Recipe, write_cases};
use super::score::Simulated;

/// Why a trial could not be made or opened.
#[derive(Debug, thiserror::Error)]
pub enum TrialError {
    /// The disk.
    #[error("{path}: {source}")]
    Io {
        /// Which file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The truth is not the one whose hash was published.
    #[error("the truth in {path} does not have the hash that was published: {published}")]
    Changed {
        /// The sealed file.
        path: PathBuf,
        /// The hash that it should have.
        published: String,
    },
    /// Not a truth, or not this key.
    #[error("{path}: {reason}")]
    Form {
        /// The sealed file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
}

/// Key of a sealed truth.
pub type Key = [u8; 32];

/// The places of a trial inside its folder.
#[derive(Debug, Clone)]
pub struct TrialFolder(PathBuf);

fn io<T>(path: &Path, result: std::io::Result<T>) -> Result<T, TrialError> {
    result.map_err(|source| TrialError::Io { path: path.to_path_buf(), source })
}

impl TrialFolder {
    /// A trial in this folder.
    pub fn new(folder: &Path) -> Self {
        Self(folder.to_path_buf())
    }

    /// Case folders.
    pub fn cases(&self) -> PathBuf {
        self.0.join("cases")
    }

    /// Cases that are drawn so far.
    pub fn drawn(&self) -> u64 {
        fs::read_dir(self.cases()).map_or(0, |entries| entries.count() as u64)
    }

    /// Answers.
    pub fn answers(&self) -> PathBuf {
        self.0.join("answers")
    }

    /// Truths, once opened.
    pub fn truth(&self) -> PathBuf {
        self.0.join("truth")
    }

    fn sealed(&self) -> PathBuf {
        self.0.join("truth.sealed")
    }

    fn hash(&self) -> PathBuf {
        self.0.join("truth.sha256")
    }

    /// Draws and writes the cases, seals their truth, publishes its hash. The key is told to the caller only.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub fn make(&self, count: usize, seed: u64, recipe: Recipe, key: Key) -> Result<(), TrialError> {
        let cases = self.cases();
        io(&cases, fs::create_dir_all(&cases))?;
        let truths = io(&cases, write_cases(&cases, count, seed, recipe))?;
        let text = serde_json::to_vec_pretty(&truths)
            .map_err(|error| TrialError::Form { path: self.sealed(), reason: error.to_string() })?;
        io(&self.hash(), fs::write(self.hash(), hash_of(&text)))?;
        io(&self.sealed(), fs::write(self.sealed(), masked(text, key)))
    }

    /// The published hash.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn published_hash(&self) -> Result<String, TrialError> {
        io(&self.hash(), fs::read_to_string(self.hash()))
    }

    /// Opens the seal, checks the truth against `published`, writes `truth/*.json`.
    ///
    /// # Errors
    /// Another key, another truth, or a folder that cannot be read or written.
    pub fn open(&self, key: Key, published: &str) -> Result<(), TrialError> {
        let text = masked(io(&self.sealed(), fs::read(self.sealed()))?, key);
        if hash_of(&text) != published {
            return Err(TrialError::Changed { path: self.sealed(), published: published.to_owned() });
        }
        let truths: BTreeMap<String, Simulated> = serde_json::from_slice(&text)
            .map_err(|error| TrialError::Form { path: self.sealed(), reason: error.to_string() })?;
        io(&self.truth(), fs::create_dir_all(self.truth()))?;
        for (name, truth) in truths {
            let path = self.truth().join(format!("{name}.json"));
            let text = serde_json::to_vec_pretty(&truth)
                .map_err(|error| TrialError::Form { path: path.clone(), reason: error.to_string() })?;
            io(&path, fs::write(&path, text))?;
        }
        Ok(())
    }
}

fn hash_of(text: &[u8]) -> String {
    hex(&Sha256::digest(text))
}

/// Bytes as hexadecimal digits.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A key from its hexadecimal digits.
pub fn key_of(digits: &str) -> Option<Key> {
    let byte = |i: usize| digits.get(2 * i..2 * i + 2).and_then(|pair| u8::from_str_radix(pair, 16).ok());
    let bytes: Option<Vec<u8>> = (0..32).map(byte).collect();
    (digits.len() == 64).then_some(bytes?)?.try_into().ok()
}

/// Adds the key stream of ChaCha20; twice is nothing.
fn masked(mut text: Vec<u8>, key: Key) -> Vec<u8> {
    let mut stream = vec![0; text.len()];
    ChaCha20Rng::from_seed(key).fill_bytes(&mut stream);
    for (byte, mask) in text.iter_mut().zip(stream) {
        *byte ^= mask;
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    const RECIPE: Recipe = Recipe { rows: 400, healthy: Some(true) };

    #[test]
    fn truth_is_unreadable_until_opened_and_then_as_published() {
        let folder = tempfile::tempdir().unwrap();
        let trial = TrialFolder::new(folder.path());
        trial.make(2, 3, RECIPE, [7; 32]).unwrap();
        let sealed = fs::read(trial.sealed()).unwrap();
        assert!(!String::from_utf8_lossy(&sealed).contains("verdict") && !trial.truth().exists());
        trial.open([7; 32], &trial.published_hash().unwrap()).unwrap();
        assert!(fs::read_to_string(trial.truth().join("trial-001.json")).unwrap().contains("verdict"));
    }

    #[test]
    fn changed_truth_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let trial = TrialFolder::new(folder.path());
        trial.make(1, 3, RECIPE, [7; 32]).unwrap();
        let published = trial.published_hash().unwrap();
        trial.make(1, 4, RECIPE, [7; 32]).unwrap();
        assert!(matches!(trial.open([7; 32], &published), Err(TrialError::Changed { .. })));
    }

    #[test]
    fn a_key_survives_its_digits() {
        let key: Key = std::array::from_fn(|i| u8::try_from(7 * i).unwrap_or(1));
        assert_eq!(key_of(&hex(&key)), Some(key));
        assert_eq!(key_of("zz"), None);
    }
}
