//! What is in a recording: streams, rates, gaps, drops, faults. RT: no.

use super::cdr::decode;
use super::reader::{About, ReadError, Reader};
use super::scan::Ending;
use super::stream::Stream;
use crate::base::time::{Span, Stamp};
use crate::msg::{Fault, FaultCode, Mode, RecorderStatus, Status, TickHead};
use std::path::Path;

/// Figures of one stream.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StreamFigures {
    /// Messages.
    pub count: u64,
    /// First and last time of validity.
    pub span: Option<(Stamp, Stamp)>,
    /// Longest time between two messages.
    pub longest_gap: Span,
    /// When that gap began.
    pub gap_at: Stamp,
}

impl StreamFigures {
    fn add(&mut self, stamp: Stamp) {
        self.count += 1;
        let Some((first, last)) = self.span else {
            self.span = Some((stamp, stamp));
            return;
        };
        let gap = stamp.since(last);
        if gap > self.longest_gap {
            self.longest_gap = gap;
            self.gap_at = last;
        }
        self.span = Some((first, last.max(stamp)));
    }

    /// Messages per second over its whole span.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "a rate to show")]
    pub fn rate_hz(&self) -> Option<f64> {
        let (first, last) = self.span?;
        let seconds = last.since(first).as_s();
        (seconds > 0.0).then(|| (self.count - 1) as f64 / seconds)
    }
}

/// Something that happened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// The mode changed.
    Mode(Mode),
    /// A new fault was latched.
    Fault(Fault),
    /// Ticks are missing in the recording: the one expected, the one that came.
    MissingTicks(u64, u64),
    /// Periods were skipped in the loop.
    Overrun(u32),
}

/// Most events that are kept; a robot that stutters for an hour would fill the memory.
const MOST_EVENTS: usize = 10_000;

/// What is in a recording.
#[derive(Debug, Default)]
pub struct Inspection {
    /// What it says of itself.
    pub about: About,
    /// Figures by stream, in their order.
    pub streams: [StreamFigures; Stream::ALL.len()],
    /// First and last tick.
    pub ticks: Option<(u64, u64)>,
    /// Ticks missing between them.
    pub missing_ticks: u64,
    /// Events with their times.
    pub events: Vec<(Stamp, Event)>,
    /// Events beyond those kept.
    pub more_events: u64,
    /// Last word of the recorder.
    pub recorder: Option<RecorderStatus>,
    /// The longest time that its disk took to make something safe.
    pub longest_sync: Span,
    /// Last status.
    pub status: Option<Status>,
    /// Frames and IMU messages lost before the tick, since start.
    pub input_drops: u64,
    /// How the file ends.
    pub ending: Option<Ending>,
    now: Stamp,
}

/// Reads a whole recording.
///
/// # Errors
/// When it cannot be read.
pub fn inspect(path: &Path) -> Result<Inspection, ReadError> {
    let mut reader = Reader::open(path)?;
    let mut found = Inspection::default();
    reader.messages(|message| {
        let stamp = Stamp(i64::try_from(message.log_time_ns).unwrap_or(i64::MAX));
        found.streams[message.stream as usize].add(stamp);
        match message.stream {
            Stream::Tick => decode(message.bytes).into_iter().for_each(|head| found.head(&head)),
            Stream::Status => decode(message.bytes).into_iter().for_each(|status| found.take_status(status)),
            Stream::Recorder => decode(message.bytes).into_iter().for_each(|word| found.take_recorder(word)),
            _ => {}
        }
        None::<()>
    })?;
    found.ending = reader.ending();
    found.about = reader.about().clone();
    Ok(found)
}

impl Inspection {
    fn head(&mut self, head: &TickHead) {
        self.now = head.now;
        if let Some((first, last)) = self.ticks {
            if head.index != last + 1 {
                self.missing_ticks += head.index.saturating_sub(last + 1);
                self.event(Event::MissingTicks(last + 1, head.index));
            }
            self.ticks = Some((first, head.index));
        } else {
            self.ticks = Some((head.index, head.index));
        }
        if head.skipped > 0 {
            self.event(Event::Overrun(head.skipped));
        }
        self.input_drops =
            head.received_dropped.iter().map(|d| u64::from(*d)).sum::<u64>() + u64::from(head.imu_dropped);
    }

    fn take_status(&mut self, status: Status) {
        let before = self.status.replace(status);
        if before.is_none_or(|b| b.mode != status.mode) {
            self.event(Event::Mode(status.mode));
        }
        let fault = status.first_fault;
        if fault.code != FaultCode::None
            && before.is_none_or(|b| b.first_fault.stamp != fault.stamp || b.first_fault.code != fault.code)
        {
            self.event(Event::Fault(fault));
        }
    }

    fn take_recorder(&mut self, word: RecorderStatus) {
        self.longest_sync = self.longest_sync.max(word.flush_time);
        self.recorder = Some(word);
    }

    fn event(&mut self, event: Event) {
        if self.events.len() < MOST_EVENTS {
            self.events.push((self.now, event));
        } else {
            self.more_events += 1;
        }
    }

    /// True if a person should look: torn, damaged, ticks missing or dropped, a fault other than an ordinary end.
    #[must_use]
    pub fn has_findings(&self) -> bool {
        self.ending != Some(Ending::Whole)
            || self.missing_ticks > 0
            || self.recorder.is_some_and(|r| r.dropped > 0)
            || self.more_events > 0
            || self.events.iter().any(|(_, event)| is_trouble(event))
    }
}

fn is_trouble(event: &Event) -> bool {
    matches!(event, Event::Fault(fault) if !fault.code.is_ordinary_end())
}
