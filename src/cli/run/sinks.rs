//! Where ticks go: the recording, and the ticks around a fault. RT: no.

use crate::config::Resolved;
use crate::msg::{Fault, FaultCode, RecorderStatus, TickRecord};
use crate::record::Recorder;
use crate::record::log_file::{Identity, LogFile};
use crate::record::storage::{Folder, Shelf};
use crate::rt::relay::Sinks;
use anyhow::Context;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// The recording, if there is one, and the flight recorder's files.
pub(super) struct Archive {
    recorder: Option<Arc<Recorder>>,
    flight: PathBuf,
    identity: Resolved,
    notices: Arc<Mutex<Vec<String>>>,
}

impl Archive {
    /// Begins the recording. Without one, the ticks around a fault go to the system's folder for temporary files.
    pub(super) fn open(folder: Option<&Path>, resolved: &Resolved) -> anyhow::Result<Self> {
        let recorder = folder.map(|folder| Recorder::start(folder, resolved)).transpose().context("--record")?;
        let flight = folder.map_or_else(|| std::env::temp_dir().join("compass-flight"), |f| f.join("flight"));
        let notices = Arc::default();
        Ok(Self { recorder: recorder.map(Arc::new), flight, identity: resolved.clone(), notices })
    }

    /// What the relay calls.
    pub(super) fn sinks(&self) -> Sinks {
        let recorder = self.recorder.clone();
        let (folder, resolved, notices) = (self.flight.clone(), self.identity.clone(), self.notices.clone());
        let dump = move |event: &Fault, ticks: &VecDeque<TickRecord>| {
            if event.code == FaultCode::Stopping {
                return;
            }
            let line = match write_flight(&folder, &resolved, ticks) {
                Ok(path) => {
                    format!("{}: the {} ticks around it are in {}", event.code.name(), ticks.len(), path.display())
                }
                Err(error) => format!("{}: the ticks around it could not be written: {error:#}", event.code.name()),
            };
            notices.lock().unwrap_or_else(PoisonError::into_inner).push(line);
        };
        let each = move |record: &TickRecord| {
            if let Some(recorder) = &recorder {
                recorder.push(record);
            }
        };
        Sinks { each: Box::new(each), dump: Box::new(dump) }
    }

    /// How the recording is.
    pub(super) fn status(&self) -> Option<RecorderStatus> {
        self.recorder.as_ref().map(|recorder| recorder.status())
    }

    /// News; each once.
    pub(super) fn take_notices(&self) -> Vec<String> {
        let mut news = std::mem::take(&mut *self.notices.lock().unwrap_or_else(PoisonError::into_inner));
        news.extend(self.recorder.iter().flat_map(|recorder| recorder.take_notices()));
        news
    }

    /// Closes the recording: where it is, and how it went.
    pub(super) fn finish(self) -> Option<(PathBuf, RecorderStatus)> {
        let recorder = self.recorder.and_then(Arc::into_inner)?;
        Some((recorder.path(), recorder.finish()))
    }
}

fn write_flight(folder: &Path, resolved: &Resolved, ticks: &VecDeque<TickRecord>) -> anyhow::Result<PathBuf> {
    let (path, storage) = Folder::new(folder)?.open(1)?;
    let mut file = LogFile::create(storage, &Identity::new(resolved))?;
    for tick in ticks {
        file.write(tick)?;
    }
    file.finish()?;
    Ok(path)
}
