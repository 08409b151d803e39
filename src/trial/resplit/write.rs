//! Variants of a case on disk. RT: no.

use std::path::{Path, PathBuf};

use super::change::{Change, leave_one_out, of_number, split};
use super::rig_file::{Entry, RigFile};
use super::table::{Table, scatter};
use crate::trial::dice::Dice;

/// Why a variant could not be made.
#[derive(Debug, thiserror::Error)]
pub enum ResplitError {
    /// The disk.
    #[error("{path}: {source}")]
    Io {
        /// Which file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Not what it should be.
    #[error("{path}: {reason}")]
    Form {
        /// Which file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
}

pub(super) fn io<T>(path: &Path, result: std::io::Result<T>) -> Result<T, ResplitError> {
    result.map_err(|source| ResplitError::Io { path: path.to_path_buf(), source })
}

/// One variant of a case.
#[derive(Debug, Clone)]
pub struct Variant {
    /// Its folder; the name says of which case and the how manieth.
    pub folder: PathBuf,
    /// The case.
    pub case: String,
    /// What was changed.
    pub change: Change,
    /// For people: the change and the split.
    pub note: String,
}

/// A variant in the making.
struct Draft {
    rig: RigFile,
    entries: Vec<Entry>,
    tables: Vec<Table>,
}

/// Writes `count` variants of the case in `folder` into `out`. `more`: a folder with further recordings of the same
/// machine; those that have every column of the rig and are one run join the draws.
///
/// The same seed gives the same variants. Of a case with one recording all variants are made of its halves.
///
/// # Errors
/// A file that cannot be read or written.
pub fn write_variants(
    folder: &Path,
    more: Option<&Path>,
    out: &Path,
    (count, seed): (usize, u64),
) -> Result<Vec<Variant>, ResplitError> {
    let case = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let given = read(folder)?;
    let wide = more.map(|more| joined(&given, more)).transpose()?;
    let one = |number: usize| {
        let mut dice = Dice::new(seed, number as u64);
        // Every other variant draws from all recordings there are.
        let from = wide.as_ref().filter(|_| number % 2 == 1).unwrap_or(&given);
        let change = of_number(number, &mut dice);
        let variant = out.join(format!("{case}-{:02}", number + 1));
        let draft = changed(from, change, &mut dice);
        let note = draft.write(&variant, change)?;
        Ok(Variant { folder: variant, case: case.clone(), change, note })
    };
    (0..count).map(one).collect()
}

fn read(folder: &Path) -> Result<Draft, ResplitError> {
    let rig = RigFile::read(&folder.join("rig.toml"))?;
    let entries = rig.recordings();
    let tables = entries.iter().map(|e| Table::read(&folder.join(e.file()))).collect::<Result<_, _>>()?;
    Ok(Draft { rig, entries, tables })
}

/// `given` with the recordings of a folder that fit its rig.
fn joined(given: &Draft, folder: &Path) -> Result<Draft, ResplitError> {
    let mut out = Draft { rig: given.rig.clone(), entries: given.entries.clone(), tables: given.tables.clone() };
    let mut files: Vec<PathBuf> =
        io(folder, std::fs::read_dir(folder))?.filter_map(|entry| Some(entry.ok()?.path())).collect();
    files.retain(|path| path.extension().is_some_and(|e| e == "csv"));
    files.sort();
    let columns = given.rig.columns();
    for path in files {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let table = Table::read(&path)?;
        let is_new = given.entries.iter().all(|e| e.file() != name);
        if is_new && table.is_one_run() && columns.iter().all(|c| table.column(c).is_some()) {
            let mut entry = given.entries[0].clone();
            entry.table.insert("file".to_owned(), toml::Value::from(name));
            out.entries.push(entry);
            out.tables.push(table);
        }
    }
    Ok(out)
}

/// A draft with another split (every other time as given, unless the split is all that changes) and one change.
fn changed(given: &Draft, change: Change, dice: &mut Dice) -> Draft {
    let mut draft = Draft { rig: given.rig.clone(), entries: given.entries.clone(), tables: given.tables.clone() };
    if draft.entries.len() == 1 {
        draft.halve(0);
        draft.entries[1].is_heldout = true;
    }
    if change == Change::Split || dice.chance(0.5) {
        draft.split_anew(dice);
    }
    match change {
        Change::Split => {}
        Change::OneFewer => draft.shorten(dice),
        Change::Window(factor) => draft.scale_windows(factor),
        Change::EverySecond(from) => draft.tables.iter_mut().for_each(|t| *t = t.every_second(from)),
        Change::Half { second } => draft.tables.iter_mut().for_each(|t| *t = t.half(second)),
        Change::Noise => draft.disturb(dice),
    }
    draft
}

impl Draft {
    /// Recording `i` as two: its halves.
    fn halve(&mut self, i: usize) {
        let (entry, table) = (self.entries[i].clone(), self.tables[i].clone());
        let stem = entry.file().trim_end_matches(".csv").to_owned();
        for (place, (name, second)) in [("a", false), ("b", true)].into_iter().enumerate() {
            let mut half = entry.clone();
            half.table.insert("file".to_owned(), toml::Value::from(format!("{stem}_{name}.csv")));
            if place == 0 {
                (self.entries[i], self.tables[i]) = (half, table.half(second));
            } else {
                self.entries.insert(i + 1, half);
                self.tables.insert(i + 1, table.half(second));
            }
        }
    }

    /// Another split than the one it has, if there is another.
    fn split_anew(&mut self, dice: &mut Dice) {
        let before: Vec<bool> = self.entries.iter().map(|e| e.is_heldout).collect();
        for _ in 0..MOST_DRAWS {
            split(&mut self.entries, dice);
            if self.entries.iter().map(|e| e.is_heldout).ne(before.iter().copied()) {
                return;
            }
        }
    }

    /// One fit recording fewer, or half of the only one.
    fn shorten(&mut self, dice: &mut Dice) {
        let before = self.entries.clone();
        if leave_one_out(&mut self.entries, dice) {
            let left = |e: &Entry| self.entries.iter().any(|kept| kept.file() == e.file());
            let kept: Vec<Table> =
                before.iter().zip(&self.tables).filter(|(e, _)| left(e)).map(|(_, t)| t.clone()).collect();
            self.tables = kept;
        } else if let Some(i) = self.entries.iter().position(|e| !e.is_heldout) {
            let second = dice.chance(0.5);
            self.tables[i] = self.tables[i].half(second);
        }
    }

    /// Windows of another length; a recording without windows is one, and is cut in two where they shall be shorter.
    fn scale_windows(&mut self, factor: f64) {
        for (entry, table) in self.entries.iter_mut().zip(&self.tables) {
            let window_s = factor * entry.window_s().unwrap_or(table.duration_s());
            entry.table.insert("window_s".to_owned(), toml::Value::from(window_s));
        }
    }

    /// Adds white noise to every sensor, as large as what it has: declared, or rounding, or what is white in the readings,
    /// whichever is largest. Readings are rounded again, as the sensor would.
    fn disturb(&mut self, dice: &mut Dice) {
        for channel in self.rig.channels() {
            let columns: Vec<(usize, usize)> =
                self.tables.iter().enumerate().filter_map(|(i, t)| Some((i, t.column(&channel.column)?))).collect();
            let seen = columns.iter().map(|(i, c)| scatter(&self.tables[*i].numbers(*c))).fold(0.0, f64::max);
            let std = channel.noise_std.unwrap_or(0.0).max(seen).max(channel.quantum / libm::sqrt(12.0));
            for (i, column) in columns {
                self.tables[i].change(column, |x| {
                    let y = x + std * dice.normal();
                    if channel.quantum > 0.0 { channel.quantum * (y / channel.quantum).round() } else { y }
                });
            }
            let both = channel.noise_std.map(|own| libm::hypot(own, std));
            if let Some(both) = both {
                self.rig = self.rig.with_noise(&channel.column, both);
            }
        }
    }

    /// Writes it; what was done, for people.
    fn write(&self, folder: &Path, change: Change) -> Result<String, ResplitError> {
        io(folder, std::fs::create_dir_all(folder))?;
        let path = folder.join("rig.toml");
        io(&path, std::fs::write(&path, self.rig.with_recordings(&self.entries).text()))?;
        for (entry, table) in self.entries.iter().zip(&self.tables) {
            table.write(&folder.join(entry.file()))?;
        }
        let files = |heldout: bool| {
            let chosen = self.entries.iter().filter(|e| e.is_heldout == heldout);
            chosen.map(|e| e.file().trim_end_matches(".csv")).collect::<Vec<_>>().join(" ")
        };
        Ok(format!("{}; fit {}; kept back {}", change.name(), files(false), files(true)))
    }
}

/// Draws after which a split that is not the given one is taken not to exist.
const MOST_DRAWS: usize = 50;
