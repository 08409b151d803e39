//! The recorder: a bounded queue and a thread that writes it to disk. RT: [`Recorder::push`] only.
//!
//! The disk never touches the loop: `push` copies the tick into a ring that was allocated at the start and returns,
//! without a lock and without a system call; when the ring is full the tick is counted as lost.
//! Every [`FLUSH_PERIOD`] the chunk is closed and `fdatasync` awaited, so a kill -9 or a power cut costs at most that,
//! plus the time of one sync. When the disk refuses (full, gone), the torn end is cut off, the loss counted and told,
//! and a new file begun, if there is room for some seconds, after a pause that doubles from [`RETRY_FIRST`] to [`RETRY_LONGEST`].

use super::log_file::{Identity, LogFile};
use super::storage::{Folder, Shelf};
use crate::base::time::{Span, Stamp};
use crate::config::Resolved;
use crate::msg::{MocapSample, RecorderState, RecorderStatus, TickRecord};
use crossbeam::queue::ArrayQueue;
use mcap::McapError;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Ticks that may wait: 4 s at 1 kHz, 17 MB. A laptop's disk was seen to stop for about 1 s now and then.
const QUEUE_TICKS: usize = 4096;
/// Poses of motion capture that may wait: 2 s at 500 Hz.
const QUEUE_POSES: usize = 1024;
/// From one flush to the next. Together with one sync it must stay below 1 s.
const FLUSH_PERIOD: Duration = Duration::from_millis(500);
/// Sleep of the thread when nothing waits; a wake-up by the loop would cost the loop a system call.
const POLL: Duration = Duration::from_millis(5);
/// A folder with a cap holds at least so many files, so that the oldest can go.
const PAGES: u64 = 8;
/// A disk that takes no more than this counts as full: 8 s of recording.
const ROOM_BYTES: u64 = 16 << 20;
/// First pause after trouble with the disk.
const RETRY_FIRST: Duration = Duration::from_secs(2);
/// Longest pause.
const RETRY_LONGEST: Duration = Duration::from_secs(64);

/// Recording cannot start.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The folder cannot be made or written.
    #[error("cannot record to {folder}")]
    Folder {
        /// Which.
        folder: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The first file cannot be begun.
    #[error("cannot begin the recording in {folder}")]
    Begin {
        /// Which.
        folder: PathBuf,
        /// Why.
        source: McapError,
    },
    /// No thread.
    #[error("cannot start the recorder's thread")]
    Thread(#[from] io::Error),
}

/// What the pushing side and the thread share.
struct Shared {
    queue: ArrayQueue<TickRecord>,
    /// Ground truth that stands beside the ticks.
    poses: ArrayQueue<MocapSample>,
    overflowed: AtomicU64,
    stop: AtomicBool,
    told: Mutex<Told>,
}

/// What the thread tells.
#[derive(Clone, Default)]
struct Told {
    status: RecorderStatus,
    path: PathBuf,
    notices: Vec<String>,
}

/// A running recording. Dropping it closes the file.
pub struct Recorder {
    shared: Arc<Shared>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

impl Recorder {
    /// Begins a file in `folder` and starts the thread. Fails at once when the folder cannot be written.
    ///
    /// # Errors
    /// See [`RecordError`].
    pub fn start(folder: &Path, resolved: &Resolved) -> Result<Self, RecordError> {
        Self::start_keeping(folder, resolved, None)
    }

    /// The same; with `keep_bytes` a new file is begun whenever the present one has an eighth of that, and the oldest
    /// recordings of the folder are removed until all of them take no more.
    ///
    /// # Errors
    /// See [`RecordError`].
    pub fn start_keeping(folder: &Path, resolved: &Resolved, keep_bytes: Option<u64>) -> Result<Self, RecordError> {
        let place = || folder.to_owned();
        let shelf = Folder::new(folder).map_err(|source| RecordError::Folder { folder: place(), source })?;
        Self::start_on(Box::new(shelf), Identity::new(resolved), keep_bytes).map_err(|error| match error {
            StartError::Begin(McapError::Io(source)) => RecordError::Folder { folder: place(), source },
            StartError::Begin(source) => RecordError::Begin { folder: place(), source },
            StartError::Thread(source) => RecordError::Thread(source),
        })
    }

    fn start_on(shelf: Box<dyn Shelf>, identity: Identity, keep_bytes: Option<u64>) -> Result<Self, StartError> {
        let shared = Arc::new(Shared {
            queue: ArrayQueue::new(QUEUE_TICKS),
            poses: ArrayQueue::new(QUEUE_POSES),
            overflowed: AtomicU64::new(0),
            stop: AtomicBool::new(false),
            told: Mutex::default(),
        });
        let mut worker = Worker { keep_bytes, ..Worker::new(shared.clone(), shelf, identity) };
        worker.prune();
        worker.begin().map_err(StartError::Begin)?;
        worker.tell();
        let thread =
            thread::Builder::new().name("recorder".into()).spawn(move || worker.run()).map_err(StartError::Thread)?;
        Ok(Self { shared, thread: Mutex::new(Some(thread)) })
    }

    /// Hands a tick over. Never waits; a full queue costs the tick, which is counted.
    pub fn push(&self, record: &TickRecord) {
        if self.shared.queue.push(*record).is_err() {
            self.shared.overflowed.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Hands a pose over, to be written beside the ticks. Never waits; a full queue costs the oldest.
    pub fn push_pose(&self, pose: &MocapSample) {
        // Their frame numbers tell which are missing.
        let _oldest = self.shared.poses.force_push(*pose);
    }

    /// True while at least one more tick fits into the queue: for a loop that may wait, such as a simulation.
    #[must_use]
    pub fn has_room(&self) -> bool {
        !self.shared.queue.is_full()
    }

    /// How it is, at most a few milliseconds old.
    #[must_use]
    pub fn status(&self) -> RecorderStatus {
        self.shared.told().status
    }

    /// The present file.
    #[must_use]
    pub fn path(&self) -> PathBuf {
        self.shared.told().path.clone()
    }

    /// What a person should know, such as a full disk; each line once.
    #[must_use]
    pub fn take_notices(&self) -> Vec<String> {
        std::mem::take(&mut self.shared.told().notices)
    }

    /// Writes what waits, closes the file, and says how it went.
    #[must_use]
    pub fn finish(self) -> RecorderStatus {
        self.close();
        self.status()
    }

    /// The same while others still look at it.
    pub fn close(&self) {
        self.shared.stop.store(true, Ordering::Release);
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(thread) = thread
            && thread.join().is_err()
        {
            self.shared.told().notices.push("recorder: its thread failed (a bug)".into());
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.close();
    }
}

enum StartError {
    Begin(McapError),
    Thread(io::Error),
}

impl Shared {
    fn told(&self) -> std::sync::MutexGuard<'_, Told> {
        // Plain data: a panic elsewhere cannot leave it half-written in a way that matters.
        self.told.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The thread's side.
struct Worker {
    shared: Arc<Shared>,
    shelf: Box<dyn Shelf>,
    identity: Identity,
    file: Option<LogFile>,
    path: PathBuf,
    /// The file before, and the ticks that were safe then.
    before: (PathBuf, u64),
    status: RecorderStatus,
    notices: Vec<String>,
    /// Ticks in the file that are not yet safe.
    unsafe_ticks: u64,
    /// Ticks lost because there was no file, or because it failed.
    lost: u64,
    flush_due: Instant,
    retry_due: Instant,
    pause: Duration,
    /// What the folder's recordings may take.
    keep_bytes: Option<u64>,
}

impl Worker {
    fn new(shared: Arc<Shared>, shelf: Box<dyn Shelf>, identity: Identity) -> Self {
        Self {
            shared,
            shelf,
            identity,
            file: None,
            path: PathBuf::new(),
            before: (PathBuf::new(), 0),
            status: RecorderStatus::default(),
            notices: Vec::new(),
            unsafe_ticks: 0,
            lost: 0,
            flush_due: Instant::now() + FLUSH_PERIOD,
            retry_due: Instant::now(),
            pause: RETRY_FIRST,
            keep_bytes: None,
        }
    }

    fn run(mut self) {
        loop {
            // Read the flag first: what was pushed before the stop is then in the queue.
            let stop = self.shared.stop.load(Ordering::Acquire);
            let idle = self.drain() == 0;
            if stop && idle {
                break;
            }
            self.look_after_file();
            self.tell();
            if idle {
                thread::sleep(POLL);
            }
        }
        self.finish();
        self.tell();
    }

    /// Writes what waits, but not for longer than a flush period.
    fn drain(&mut self) -> usize {
        let waiting = self.shared.queue.len();
        self.status.queue_peak = self.status.queue_peak.max(u32::try_from(waiting).unwrap_or(u32::MAX));
        for _ in 0..waiting {
            let Some(record) = self.shared.queue.pop() else { break };
            self.status.stamp = record.input.now;
            self.write(&record);
        }
        self.write_poses();
        waiting
    }

    fn write(&mut self, record: &TickRecord) {
        let Some(file) = &mut self.file else {
            self.lost += 1;
            return;
        };
        self.unsafe_ticks += 1;
        if let Err(error) = file.write(record) {
            self.fail(&error);
        }
    }

    fn write_poses(&mut self) {
        while let Some(pose) = self.shared.poses.pop() {
            if let Some(file) = &mut self.file
                && let Err(error) = file.write_pose(&pose)
            {
                self.fail(&error);
            }
        }
    }

    fn look_after_file(&mut self) {
        let now = Instant::now();
        if self.file.is_none() && now >= self.retry_due {
            self.try_again();
        } else if self.file.is_some() && now >= self.flush_due {
            self.flush_due = now + FLUSH_PERIOD;
            if let Err(error) = self.flush().and_then(|()| self.turn_page()) {
                self.fail(&error);
            }
        }
    }

    /// Begins another file when the present one is large, and removes the oldest ones.
    fn turn_page(&mut self) -> Result<(), McapError> {
        let Some(keep_bytes) = self.keep_bytes else { return Ok(()) };
        if self.status.bytes >= keep_bytes / PAGES {
            self.file.take().map(LogFile::finish).transpose()?;
            self.begin()?;
        }
        self.prune();
        Ok(())
    }

    /// Leaves room for the file that grows, if the folder has a cap: in the cap, and on the disk.
    fn prune(&mut self) {
        let Some(keep_bytes) = self.keep_bytes else { return };
        let removed = self.shelf.prune(keep_bytes - keep_bytes / PAGES, ROOM_BYTES, &self.path);
        if removed > 0 {
            self.notices.push(format!("recorder: {removed} of the oldest recordings removed, as --keep asks"));
        }
    }

    fn flush(&mut self) -> Result<(), McapError> {
        self.count_drops();
        let Some(file) = &mut self.file else { return Ok(()) };
        // Before the first tick there is no time to put it at.
        if self.status.stamp > Stamp(0) {
            file.write_status(&self.status)?;
        }
        let start = Instant::now();
        file.flush()?;
        self.status.flush_time = Span(i64::try_from(start.elapsed().as_nanos()).unwrap_or(i64::MAX));
        self.status.written += self.unsafe_ticks;
        self.status.bytes = file.safe_bytes();
        self.unsafe_ticks = 0;
        self.pause = RETRY_FIRST;
        Ok(())
    }

    /// Opens the next file and makes sure that the disk takes it.
    fn begin(&mut self) -> Result<(), McapError> {
        let (path, storage) = self.shelf.open(self.status.files + 1)?;
        self.before = (std::mem::replace(&mut self.path, path), self.status.written);
        let result = LogFile::create(storage, &self.identity).and_then(|file| {
            self.file = Some(file);
            self.flush()
        });
        if let Err(error) = result {
            if let Some(file) = self.file.take() {
                file.abandon();
            }
            self.discard();
            return Err(error);
        }
        self.status.files += 1;
        self.status.state = RecorderState::Recording;
        self.flush_due = Instant::now() + FLUSH_PERIOD;
        Ok(())
    }

    /// Nothing of use is in the present file: the one before is the recording that is told.
    fn discard(&mut self) {
        self.shelf.discard(&self.path);
        self.path = std::mem::take(&mut self.before.0);
    }

    fn try_again(&mut self) {
        self.prune();
        if self.shelf.free_bytes() < ROOM_BYTES {
            return self.wait_longer();
        }
        match self.begin() {
            Ok(()) => {
                let lost = self.status.dropped;
                self.notices.push(format!("recorder: goes on in {}, {lost} ticks lost so far", self.path.display()));
            }
            Err(_) => self.wait_longer(),
        }
    }

    fn fail(&mut self, error: &McapError) {
        self.status.state = match error {
            McapError::Io(io) if matches!(io.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded) => {
                RecorderState::DiskFull
            }
            _ => RecorderState::DiskError,
        };
        let safe = self.status.written;
        // The library's own words for it name everything but the cause.
        let cause = match error {
            McapError::Io(io) => io.to_string(),
            other => other.to_string(),
        };
        self.notices.push(format!("recorder: {}: {cause}; {safe} ticks are safe, trying again", self.path.display()));
        self.give_up_file();
        self.wait_longer();
    }

    fn give_up_file(&mut self) {
        self.lost += std::mem::take(&mut self.unsafe_ticks);
        if let Some(file) = self.file.take() {
            self.status.bytes = file.abandon();
            // The first stays, whatever is in it: it is what was asked for.
            if self.status.files > 1 && self.status.written == self.before.1 {
                self.discard();
                self.status.files -= 1;
            }
        }
    }

    fn wait_longer(&mut self) {
        self.retry_due = Instant::now() + self.pause;
        self.pause = (self.pause * 2).min(RETRY_LONGEST);
    }

    fn finish(&mut self) {
        let result = self.flush().and_then(|()| self.file.take().map(LogFile::finish).transpose());
        match result {
            Ok(Some(bytes)) => {
                self.status.bytes = bytes;
                self.status.state = RecorderState::Finished;
            }
            Ok(None) => {}
            Err(error) => self.fail(&error),
        }
    }

    fn count_drops(&mut self) {
        self.status.dropped = self.lost + self.shared.overflowed.load(Ordering::Relaxed);
    }

    fn tell(&mut self) {
        self.count_drops();
        let mut told = self.shared.told();
        told.status = self.status;
        if told.path != self.path {
            told.path.clone_from(&self.path);
        }
        told.notices.append(&mut self.notices);
    }
}

#[cfg(test)]
mod tests;
