//! Where ticks go: the recording, and the ticks around a fault. RT: no.

use crate::config::Resolved;
use crate::msg::{Fault, FaultCode, MocapSample, RecorderStatus, TickRecord};
use crate::record::Recorder;
use crate::record::live::Window;
use crate::record::log_file::{Identity, LogFile};
use crate::record::storage::{Folder, Shelf};
use crate::record::stream::Stream;
use crate::rt::relay::{Beside, Sinks};
use anyhow::Context;
use std::collections::VecDeque;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{Builder, JoinHandle};

/// News for the terminal.
type Notices = Arc<Mutex<Vec<String>>>;

/// Ticks between two words about the recording to who reads along.
const STATUS_TICKS: u64 = 100;

/// The recording, if there is one, and the flight recorder's files.
pub(super) struct Archive {
    recorder: Option<Arc<Recorder>>,
    /// Poses on their way to who reads along.
    poses: Sender<MocapSample>,
    poses_out: Mutex<Option<Receiver<MocapSample>>>,
    flight: FlightWriter,
    notices: Notices,
}

/// What is left when everything is written.
pub(super) struct Closed {
    /// Where the recording is, and how it went.
    pub(super) recorded: Option<(PathBuf, RecorderStatus)>,
    /// News that nobody has taken.
    pub(super) notices: Vec<String>,
}

impl Archive {
    /// Begins the recording. Without one, the ticks around a fault go to the system's folder for temporary files.
    pub(super) fn open(folder: Option<&Path>, keep: Option<u64>, resolved: &Resolved) -> anyhow::Result<Self> {
        let start = |folder| Recorder::start_keeping(folder, resolved, keep);
        let recorder = folder.map(start).transpose().context("--record")?;
        let flight = folder.map_or_else(|| std::env::temp_dir().join("compass-flight"), |f| f.join("flight"));
        let notices = Arc::default();
        let flight = FlightWriter::start(flight, keep, resolved.clone(), Arc::clone(&notices))?;
        let (poses, poses_out) = mpsc::channel();
        let poses_out = Mutex::new(Some(poses_out));
        Ok(Self { recorder: recorder.map(Arc::new), poses, poses_out, flight, notices })
    }

    /// What the relay calls. `window`: who reads along from outside. The poses go to the first who asks for them.
    pub(super) fn sinks(&self, mut window: Option<Window>) -> Sinks {
        let recorder = self.recorder.clone();
        let poses = self.poses_out.lock().unwrap_or_else(PoisonError::into_inner).take();
        let (beside, news) = mpsc::channel();
        let each = move |record: &TickRecord| {
            let mut all: Vec<Beside> = poses.iter().flat_map(Receiver::try_iter).map(Beside::Pose).collect();
            if let Some(recorder) = &recorder {
                recorder.push(record);
                let due = record.input.index.is_multiple_of(STATUS_TICKS);
                all.extend(due.then(|| Beside::Recorder(recorder.status())));
            }
            for word in all {
                if let Some(window) = &mut window {
                    match word {
                        Beside::Recorder(status) => window.put_beside(Stream::Recorder, status.stamp, &status),
                        Beside::Pose(pose) => window.put_beside(Stream::Mocap, pose.stamp, &pose),
                    }
                }
                // The relay takes them in the same turn.
                let _taken = beside.send(word);
            }
            if let Some(window) = &mut window {
                window.serve(record);
            }
        };
        let beside = move || news.try_recv().ok();
        Sinks { each: Box::new(each), beside: Box::new(beside), dump: Box::new(self.flight.sink()) }
    }

    /// Where poses of motion capture go; nowhere without a recording.
    pub(super) fn poses(&self) -> Option<impl FnMut(&MocapSample) + Send + 'static> {
        let (recorder, readers) = (self.recorder.clone()?, self.poses.clone());
        Some(move |pose: &MocapSample| {
            recorder.push_pose(pose);
            // Nobody takes them once the run is over.
            let _taken = readers.send(*pose);
        })
    }

    /// Where news of other threads go, for the terminal.
    pub(super) fn news(&self) -> impl FnMut(String) + Send + 'static {
        let notices = Arc::clone(&self.notices);
        move |line| notices.lock().unwrap_or_else(PoisonError::into_inner).push(line)
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

    /// Writes what waits and closes.
    pub(super) fn finish(&self) -> Closed {
        self.flight.finish();
        if let Some(recorder) = &self.recorder {
            recorder.close();
        }
        let recorded = self.recorder.as_ref().map(|recorder| (recorder.path(), recorder.status()));
        Closed { recorded, notices: self.take_notices() }
    }
}

/// An event and the ticks around it; `None` ends the thread.
type Dump = Option<(Fault, Vec<TickRecord>)>;

/// Writes the ticks around a fault, in a thread of its own: on a slow processor that takes seconds, and the relay's ticks
/// would be lost to the recording meanwhile.
struct FlightWriter {
    queue: Sender<Dump>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

impl FlightWriter {
    fn start(folder: PathBuf, keep: Option<u64>, resolved: Resolved, notices: Notices) -> io::Result<Self> {
        let (queue, dumps) = mpsc::channel::<Dump>();
        let body = move || {
            for (event, ticks) in dumps.into_iter().map_while(|dump| dump) {
                let name = event.code.name();
                let line = match write_flight(&folder, keep, &resolved, &ticks) {
                    Ok(path) => format!("{name}: the {} ticks around it are in {}", ticks.len(), path.display()),
                    Err(error) => format!("{name}: the ticks around it could not be written: {error:#}"),
                };
                notices.lock().unwrap_or_else(PoisonError::into_inner).push(line);
            }
        };
        let thread = Builder::new().name("flight".into()).spawn(body)?;
        Ok(Self { queue, thread: Mutex::new(Some(thread)) })
    }

    /// What the relay calls; a copy of the ticks is all that it waits for.
    fn sink(&self) -> impl FnMut(&Fault, &VecDeque<TickRecord>) + Send + 'static {
        let queue = self.queue.clone();
        move |event, ticks| {
            if event.code != FaultCode::Stopping {
                // The thread ends before its time only if it panics, and its hook has told that.
                drop(queue.send(Some((*event, ticks.iter().copied().collect()))));
            }
        }
    }

    fn finish(&self) {
        drop(self.queue.send(None));
        if let Some(thread) = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take() {
            drop(thread.join());
        }
    }
}

/// The ticks around faults may take a tenth of what the recordings may, beside them.
fn write_flight(
    folder: &Path,
    keep: Option<u64>,
    resolved: &Resolved,
    ticks: &[TickRecord],
) -> anyhow::Result<PathBuf> {
    let mut shelf = Folder::new(folder)?;
    let (path, storage) = shelf.open(1)?;
    let mut file = LogFile::create(storage, &Identity::new(resolved))?;
    for tick in ticks {
        file.write(tick)?;
    }
    file.finish()?;
    if let Some(keep) = keep {
        shelf.prune(keep / 10, 0, &path);
    }
    Ok(path)
}
