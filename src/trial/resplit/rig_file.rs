//! `rig.toml` as a table that is edited: which recordings, for what, in which windows. RT: no.

use std::path::Path;

use toml::{Table, Value};

use super::write::{ResplitError, io};

/// A recording as the rig names it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Entry {
    /// Its table in the rig.
    pub(super) table: Table,
    /// Kept back?
    pub(super) is_heldout: bool,
}

impl Entry {
    /// Its file.
    pub(super) fn file(&self) -> &str {
        self.table.get("file").and_then(Value::as_str).unwrap_or_default()
    }

    /// Free runs restart this often, s.
    pub(super) fn window_s(&self) -> Option<f64> {
        let value = self.table.get("window_s")?;
        value.as_float().or(value.as_integer().map(|n| n as f64))
    }
}

/// A sensor as the rig names it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Channel {
    /// Column of the recordings.
    pub(super) column: String,
    /// Declared noise, if it is.
    pub(super) noise_std: Option<f64>,
    /// Step of the reading, 0 for none.
    pub(super) quantum: f64,
}

/// A rig file.
#[derive(Debug, Clone)]
pub(super) struct RigFile(Table);

impl RigFile {
    /// Reads it.
    pub(super) fn read(path: &Path) -> Result<Self, ResplitError> {
        let text = io(path, std::fs::read_to_string(path))?;
        let parsed = text.parse::<Table>();
        parsed.map(Self).map_err(|error| ResplitError::Form { path: path.to_path_buf(), reason: error.to_string() })
    }

    /// Its recordings.
    pub(super) fn recordings(&self) -> Vec<Entry> {
        let entry = |table: &Table| Entry {
            table: table.clone(),
            is_heldout: table.get("use").and_then(Value::as_str) == Some("heldout"),
        };
        self.tables("recording").map(entry).collect()
    }

    /// Its sensors.
    pub(super) fn channels(&self) -> Vec<Channel> {
        let number =
            |table: &Table, key: &str| table.get(key).and_then(|x| x.as_float().or(x.as_integer().map(|n| n as f64)));
        let channel = |table: &Table| Channel {
            column: table.get("column").and_then(Value::as_str).unwrap_or_default().to_owned(),
            noise_std: number(table, "noise_std"),
            quantum: number(table, "quantum").unwrap_or(0.0),
        };
        self.tables("sensor").map(channel).collect()
    }

    /// Columns that a recording must have.
    pub(super) fn columns(&self) -> Vec<String> {
        let of = |kind: &'static str| self.tables(kind).filter_map(|t| t.get("column")).filter_map(Value::as_str);
        of("actuator").chain(of("sensor")).map(str::to_owned).collect()
    }

    fn tables(&self, kind: &str) -> impl Iterator<Item = &Table> {
        self.0.get(kind).and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_table)
    }

    /// The same with these recordings.
    pub(super) fn with_recordings(&self, entries: &[Entry]) -> Self {
        let one = |entry: &Entry| {
            let mut table = entry.table.clone();
            table.insert("use".to_owned(), Value::from(if entry.is_heldout { "heldout" } else { "fit" }));
            Value::Table(table)
        };
        let mut out = self.0.clone();
        out.insert("recording".to_owned(), Value::Array(entries.iter().map(one).collect()));
        Self(out)
    }

    /// The same with another declared noise of a sensor, where one is declared: the rig shall not be wrong about it.
    pub(super) fn with_noise(&self, column: &str, std: f64) -> Self {
        let mut out = self.0.clone();
        let sensors = out.get_mut("sensor").and_then(Value::as_array_mut).into_iter().flatten();
        for sensor in sensors.filter_map(Value::as_table_mut) {
            if sensor.get("column").and_then(Value::as_str) == Some(column) && sensor.contains_key("noise_std") {
                sensor.insert("noise_std".to_owned(), Value::from(std));
            }
        }
        Self(out)
    }

    /// As text.
    pub(super) fn text(&self) -> String {
        self.0.to_string()
    }
}
