//! The lidar beside a run: a thread that talks with it and fits the floor. RT: no; the tick takes its newest word from a
//! ring.

use crate::base::time::Span;
use crate::channel::ring::Ring;
use crate::config::checked::Lidar;
use crate::msg::LidarSample;
use crate::rt::{clock, poll};
use crate::sensor::lidar::link::{LidarLine, serve};
use crate::sensor::lidar::{LidarCounters, LidarReader};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{Builder, JoinHandle};

/// The reader looks at its timers at least so often.
const TURN: Span = Span::from_ms(5);
/// Words that wait for the tick, which takes all of them and keeps the newest.
const WAITING: usize = 8;

/// A running thread; it ends with this.
pub(super) struct Scanner {
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<LidarCounters>>,
}

/// What the tick takes.
pub(super) type Words = Arc<Ring<LidarSample>>;

impl Scanner {
    /// Talks over this line. A device that is not there may come later.
    pub(super) fn start(config: &Lidar, line: LidarLine) -> std::io::Result<(Self, Words)> {
        let (over, words) = (Arc::<AtomicBool>::default(), Arc::new(Ring::new(WAITING)));
        let (flag, ring, reader) = (Arc::clone(&over), Arc::clone(&words), LidarReader::new(config));
        let thread = Builder::new().name("lidar".into()).spawn(move || talk(reader, line, &flag, &ring))?;
        Ok((Self { over, thread: Some(thread) }, words))
    }

    /// Ends it; what was not as it should be, in words.
    pub(super) fn finish(mut self) -> Option<String> {
        self.over.store(true, Ordering::Release);
        let LidarCounters { starts, scans, damaged, missing, reconnects } = self.thread.take()?.join().ok()?;
        Some(format!(
            "lidar: {scans} scans, {damaged} damaged, {missing} missing; {starts} dialogues, {reconnects} new connections \
             asked for"
        ))
    }
}

impl Drop for Scanner {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Release);
    }
}

fn talk(mut reader: LidarReader, mut line: LidarLine, over: &AtomicBool, words: &Ring<LidarSample>) -> LidarCounters {
    while !over.load(Ordering::Acquire) {
        poll::readable([line.readable_fd()], clock::now() + TURN);
        serve(&mut reader, &mut line, clock::now(), |word| words.push_newest(word));
    }
    *reader.counters()
}
