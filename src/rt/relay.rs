//! The relay: takes finished ticks from the control thread and serves everybody else. RT: no.
//!
//! Recorder, terminal and other processes hang on the relay, so that none of them, coming, going or slow, is ever felt
//! in the loop. It also keeps the statistics and the flight recorder.

use super::flight::FlightRecorder;
use super::stats::LoopStats;
use crate::base::time::Stamp;
use crate::channel::port::{ChannelError, Endpoint, Publisher};
use crate::channel::ring::Ring;
use crate::channel::topic;
use crate::msg::{Fault, MocapSample, RecorderStatus, TickRecord};
use crate::safety::HeldBack;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

/// Sleep when nothing waits: a wake-up by the loop would cost the loop a system call.
const POLL: Duration = Duration::from_millis(2);
/// Faults kept for the summary.
const MOST_FAULTS: usize = 20;

/// Writes the ticks around an event somewhere.
pub type Dump = dyn FnMut(&Fault, &VecDeque<TickRecord>) + Send;

/// What stands beside the ticks: no tick knows of it.
#[derive(Clone, Copy, Debug)]
pub enum Beside {
    /// How the recording is.
    Recorder(RecorderStatus),
    /// A pose of motion capture.
    Pose(MocapSample),
}

/// What the assembly hangs on the relay.
pub struct Sinks {
    /// Sees every tick: the recorder.
    pub each: Box<dyn FnMut(&TickRecord) + Send>,
    /// The next of what stands beside the ticks, for other processes.
    pub beside: Box<dyn FnMut() -> Option<Beside> + Send>,
    /// Sees the ticks around an event.
    pub dump: Box<Dump>,
}

/// What the relay saw.
#[derive(Debug, Default)]
pub struct Observed {
    /// Histograms.
    pub stats: LoopStats,
    /// The first faults, in order.
    pub faults: Vec<Fault>,
    /// When the first tick was.
    pub began: Option<Stamp>,
    /// The last tick.
    pub last: Box<TickRecord>,
    /// What kept it from being armed.
    pub held_back: HeldBack,
    /// Something was latched that is no ordinary end: neither a stop nor the switch let go.
    pub faulted: bool,
    /// Ticks that had no room on their way to the relay, or came after it had ended by a panic.
    pub missed: u64,
    /// The relay ended by a panic: its last tick is not the loop's last.
    pub panicked: bool,
}

/// The relay.
pub(super) struct Relay {
    inlet: Arc<Ring<TickRecord>>,
    everybody: Publisher<TickRecord>,
    recorder: Publisher<RecorderStatus>,
    poses: Publisher<MocapSample>,
    sinks: Sinks,
    flight: FlightRecorder,
    observed: Observed,
}

impl Relay {
    /// Attaches; in the thread that will run it.
    pub(super) fn attach(
        channels: &Endpoint,
        inlet: Arc<Ring<TickRecord>>,
        sinks: Sinks,
        flight_ticks: usize,
    ) -> Result<Self, ChannelError> {
        Ok(Self {
            inlet,
            everybody: channels.publisher(&topic::TICK)?,
            recorder: channels.publisher(&topic::RECORDER)?,
            poses: channels.publisher(&topic::MOCAP)?,
            sinks,
            flight: FlightRecorder::new(flight_ticks),
            observed: Observed::default(),
        })
    }

    /// Serves until `done` says that the loop has ended and nothing waits. A panic of a sink, which the hook has told, ends
    /// the serving but not what is known of the run so far.
    pub(super) fn run(mut self, done: impl Fn() -> bool) -> Observed {
        let served = catch_unwind(AssertUnwindSafe(|| self.serve_until(&done)));
        self.observed.panicked = served.is_err();
        self.observed
    }

    fn serve_until(&mut self, done: impl Fn() -> bool) {
        loop {
            let last_round = done();
            while let Some(record) = self.inlet.pop() {
                self.serve(&record);
            }
            if last_round {
                break;
            }
            thread::sleep(POLL);
        }
        self.dump_now();
    }

    fn serve(&mut self, record: &TickRecord) {
        self.everybody.publish(record);
        self.observe(record);
        (self.sinks.each)(record);
        while let Some(beside) = (self.sinks.beside)() {
            match beside {
                Beside::Recorder(status) => self.recorder.publish(&status),
                Beside::Pose(pose) => self.poses.publish(&pose),
            }
        }
        if let Some(event) = self.flight.observe(record) {
            (self.sinks.dump)(&event, self.flight.ticks());
        }
    }

    fn observe(&mut self, record: &TickRecord) {
        self.observed.began.get_or_insert(record.input.now);
        self.observed.stats.observe(record);
        self.observed.held_back.look(&record.status);
        let new_fault = record.status.faults > self.observed.last.status.faults;
        self.observed.faulted |= new_fault && !record.status.first_fault.code.is_ordinary_end();
        if new_fault && self.observed.faults.len() < MOST_FAULTS {
            self.observed.faults.push(record.status.first_fault);
        }
        *self.observed.last = *record;
    }

    fn dump_now(&mut self) {
        if let Some(event) = self.flight.take_event() {
            (self.sinks.dump)(&event, self.flight.ticks());
        }
    }
}
