//! The threads of a running robot. RT: starting and ending are not.
//!
//! ```text
//!  bus 0 ── io thread ─┐ frames                        ┌─► bus 0, bus 1 (sends itself)
//!  bus 1 ── io thread ─┼────────► control thread ──────┤
//!  IMU ──── io thread ─┘ samples   (the tick)          └─► relay ──► recorder, terminal, other processes
//! ```
//! With `input = "inline"` or `"busy"` the io threads are absent and the control thread reads the devices itself.
//! Every thread sets itself up, reports what was not granted, and waits for the common start.

use super::allocation;
use super::awaited::Awaited;
use super::control_loop::{ControlLoop, Walk};
use super::feed::{Feed, InlineFeed, ThreadFeed};
use super::io::{self, ImuPort, Inbox};
use super::memory;
use super::relay::{Observed, Relay, Sinks};
use super::stop::{LastWords, Stop, StopGuard};
use super::thread::{self as schedule, Awake, Missing};
use crate::bus::{Receive, Transmit};
use crate::channel::port::{ChannelError, Endpoint};
use crate::channel::ring::Ring;
use crate::config::checked::{Config, Input, RealTime, Thread};
use crate::msg::{BUSES, FrameBatch, Mode, TickRecord};
use crate::sensor::operator::Hand;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Barrier, mpsc};
use std::thread::{Builder, JoinHandle};

/// Ticks that wait for the relay at most: one second, 4 MB.
const TICKS_WAITING: usize = 1000;

/// Why the threads did not start.
#[derive(Debug, thiserror::Error)]
pub enum ProcessError {
    /// Shared memory.
    #[error(transparent)]
    Channel(#[from] ChannelError),
    /// The system gave no thread.
    #[error("cannot start a thread")]
    Thread(#[from] std::io::Error),
    /// A thread ended before it was ready.
    #[error("thread {0} failed while starting")]
    Lost(&'static str),
}

/// A bus as its wire and threads need it: three ends of the same wire.
pub struct BusPort {
    /// For the control thread.
    pub transmit: Box<dyn Transmit + Send>,
    /// For the I/O thread.
    pub receive: Box<dyn Receive + Send>,
    /// For the way out.
    pub last_words: Box<dyn Transmit + Send>,
}

/// Everything that the threads are made of.
pub struct Parts {
    /// Configuration.
    pub config: Config,
    /// Name of the robot in its channels.
    pub robot: String,
    /// The buses.
    pub buses: [BusPort; BUSES],
    /// The IMU.
    pub imu: ImuPort,
    /// The dead-man switch.
    pub hand: Hand,
    /// Stop frames of each bus.
    pub stop_frames: [FrameBatch; BUSES],
    /// What was not granted so far (bus restart).
    pub missing: Missing,
    /// True if no bus is real: then missing real time is no reason not to arm.
    pub simulated: bool,
    /// What hangs on the relay.
    pub sinks: Sinks,
    /// Asks everything to end.
    pub stop: Stop,
}

/// What others may know while the loop runs.
#[derive(Debug, Default)]
pub struct Progress {
    /// Ticks done; the watchdog is fed only while this moves.
    pub ticks: AtomicU64,
    /// Frames that a wire refused.
    pub refused_frames: AtomicU64,
    mode: AtomicU8,
    was_armed: AtomicBool,
    allocations: AtomicU64,
    page_faults: AtomicU64,
    ended: AtomicBool,
}

impl Progress {
    /// Mode after the last tick.
    #[must_use]
    pub fn mode(&self) -> Mode {
        Mode::from_u8(self.mode.load(Ordering::Relaxed)).unwrap_or_default()
    }

    /// The loop has ended.
    #[must_use]
    pub fn has_ended(&self) -> bool {
        self.ended.load(Ordering::Acquire)
    }

    pub(super) fn note(&self, record: &TickRecord) {
        self.ticks.store(record.input.index + 1, Ordering::Release);
        self.mode.store(record.status.mode as u8, Ordering::Relaxed);
        if record.status.mode == Mode::Armed {
            self.was_armed.store(true, Ordering::Relaxed);
        }
    }
}

/// Counts what a real-time thread allocates and faults after the first arming.
struct Vigil<'a> {
    progress: &'a Progress,
    baseline: Option<(u64, u64)>,
}

impl<'a> Vigil<'a> {
    const fn new(progress: &'a Progress) -> Self {
        Self { progress, baseline: None }
    }

    /// Begins to count at the first call after arming.
    fn look(&mut self) {
        if self.baseline.is_none() && self.progress.was_armed.load(Ordering::Relaxed) {
            self.baseline = Some((allocation::on_this_thread(), memory::faults_of_this_thread()));
        }
    }
}

impl Drop for Vigil<'_> {
    fn drop(&mut self) {
        let now = (allocation::on_this_thread(), memory::faults_of_this_thread());
        let since = self.baseline.unwrap_or(now);
        self.progress.allocations.fetch_add(now.0 - since.0, Ordering::Relaxed);
        self.progress.page_faults.fetch_add(now.1 - since.1, Ordering::Relaxed);
    }
}

/// How a run went.
#[derive(Debug)]
pub struct Summary {
    /// What the relay saw.
    pub observed: Observed,
    /// What real time needs and was not granted.
    pub missing: Missing,
    /// Frames that a wire refused.
    pub refused_frames: u64,
    /// Allocations of all real-time threads after arming; `None` if it never armed.
    pub allocations: Option<u64>,
    /// Page faults likewise.
    pub page_faults: Option<u64>,
    /// The control thread ended by a panic.
    pub panicked: bool,
}

/// A running robot.
pub struct Running {
    control: JoinHandle<()>,
    io: Vec<JoinHandle<()>>,
    relay: JoinHandle<Observed>,
    progress: Arc<Progress>,
    missing: Missing,
    stop: Stop,
    _awake: Option<Awake>,
}

impl Running {
    /// What may be known meanwhile.
    #[must_use]
    pub fn progress(&self) -> Arc<Progress> {
        Arc::clone(&self.progress)
    }

    /// What real time needs and was not granted.
    #[must_use]
    pub const fn missing(&self) -> Missing {
        self.missing
    }

    /// Waits for the end, which somebody else must have asked for.
    #[must_use]
    pub fn wait(self) -> Summary {
        let panicked = self.control.join().is_err();
        self.progress.ended.store(true, Ordering::Release);
        self.stop.request();
        for thread in self.io {
            // A thread that panicked was told by the hook, and its silence made the tick fault.
            drop(thread.join());
        }
        let observed = self.relay.join().unwrap_or_default();
        let after_arming = |n: &AtomicU64| {
            let counted = n.load(Ordering::Relaxed);
            self.progress.was_armed.load(Ordering::Relaxed).then_some(counted)
        };
        Summary {
            observed,
            missing: self.missing,
            refused_frames: self.progress.refused_frames.load(Ordering::Relaxed),
            allocations: after_arming(&self.progress.allocations),
            page_faults: after_arming(&self.progress.page_faults),
            panicked,
        }
    }
}

/// What all threads share while they start and run.
#[derive(Clone)]
struct Shared {
    awaited: Arc<Awaited>,
    inbox: Arc<Inbox>,
    handover: Arc<Ring<TickRecord>>,
    progress: Arc<Progress>,
    stop: Stop,
    missing: Arc<AtomicU32>,
    start: Arc<Barrier>,
    ready: mpsc::Sender<Result<(), ProcessError>>,
}

impl Shared {
    /// Sets the calling thread up, tells whether it is ready, and waits for the others. `None`: it shall not run.
    fn enter<T>(&self, config: &Thread, opened: Result<T, ProcessError>) -> Option<T> {
        self.missing.fetch_or(schedule::enter(config).0, Ordering::Relaxed);
        let (result, opened) = match opened {
            Ok(opened) => (Ok(()), Some(opened)),
            Err(error) => (Err(error), None),
        };
        // Nobody listens any more only if another thread has failed already.
        drop(self.ready.send(result));
        self.start.wait();
        opened.filter(|_| !self.stop.is_requested())
    }

    fn running(&self) -> bool {
        !self.progress.ended.load(Ordering::Acquire)
    }
}

/// Starts all threads. Returns when each has its priority, memory and channels and the loop is on its way.
///
/// # Errors
/// [`ProcessError`]; then no thread is left.
pub fn start<W: Walk + Send + 'static>(walk: W, parts: Parts) -> Result<Running, ProcessError> {
    let timing = parts.config.real_time.clone();
    let locked = !timing.lock_memory || memory::lock();
    let awake = timing.hold_cpu_awake.then(Awake::hold).flatten();
    let mut missing = parts.missing;
    missing = missing | if locked { Missing::default() } else { Missing::MEMORY };
    missing = missing | if timing.hold_cpu_awake && awake.is_none() { Missing::AWAKE } else { Missing::default() };

    let threads = if timing.input == Input::Threads { BUSES + 3 } else { 2 };
    let (ready, reports) = mpsc::channel();
    let shared = Shared {
        awaited: Arc::new(Awaited::new(&parts.config.robot)),
        inbox: Arc::default(),
        handover: Arc::new(Ring::new(TICKS_WAITING)),
        progress: Arc::default(),
        stop: parts.stop,
        missing: Arc::new(AtomicU32::new(missing.0)),
        start: Arc::new(Barrier::new(threads + 1)),
        ready,
    };
    let relay = spawn_relay(&shared, parts.robot, parts.sinks, timing.flight_recorder_ticks)?;
    let [bus0, bus1] = parts.buses;
    let words = LastWords { frames: parts.stop_frames, wires: [bus0.last_words, bus1.last_words] };
    let desk =
        Desk { walk, words, wires: [bus0.transmit, bus1.transmit], hand: parts.hand, simulated: parts.simulated };
    let inputs = [bus0.receive, bus1.receive];
    let (control, io) = match timing.input {
        Input::Threads => {
            let io = spawn_io(&shared, &timing, inputs, parts.imu)?;
            let feed = ThreadFeed::new(shared.inbox.clone(), shared.awaited.clone());
            (spawn_control(&shared, timing, desk, feed)?, io)
        }
        Input::Inline | Input::Busy => {
            let busy = timing.input == Input::Busy;
            let feed = InlineFeed::new(inputs, parts.imu, shared.awaited.clone(), busy);
            (spawn_control(&shared, timing, desk, feed)?, Vec::new())
        }
    };
    let result = (0..threads).try_for_each(|_| reports.recv().unwrap_or(Err(ProcessError::Lost("starting"))));
    if result.is_err() {
        shared.progress.ended.store(true, Ordering::Release);
        shared.stop.request();
    }
    shared.start.wait();
    let missing = Missing(shared.missing.load(Ordering::Relaxed));
    let Shared { progress, stop, .. } = shared;
    let running = Running { control, io, relay, progress, missing, stop, _awake: awake };
    match result {
        Ok(()) => Ok(running),
        Err(error) => {
            drop(running.wait());
            Err(error)
        }
    }
}

/// What moves into the control thread.
struct Desk<W> {
    walk: W,
    words: LastWords,
    wires: [Box<dyn Transmit + Send>; BUSES],
    hand: Hand,
    simulated: bool,
}

/// A thread that needs no scheduling but a touched stack.
const ORDINARY: Thread = Thread { priority: 0, core: None, stack_bytes: 256 * 1024 };

fn spawn_relay(
    shared: &Shared,
    robot: String,
    sinks: Sinks,
    flight_ticks: usize,
) -> Result<JoinHandle<Observed>, ProcessError> {
    let shared = shared.clone();
    let body = move || {
        let inlet = shared.handover.clone();
        let relay = Endpoint::join(&robot).and_then(|channels| Relay::attach(&channels, inlet, sinks, flight_ticks));
        let relay = shared.enter(&ORDINARY, relay.map_err(ProcessError::from));
        relay.map_or_else(Observed::default, |relay| relay.run(|| !shared.running()))
    };
    Ok(Builder::new().name("relay".into()).spawn(body)?)
}

fn spawn_io(
    shared: &Shared,
    timing: &RealTime,
    buses: [Box<dyn Receive + Send>; BUSES],
    mut imu: ImuPort,
) -> Result<Vec<JoinHandle<()>>, ProcessError> {
    let mut threads = Vec::new();
    for ((bus, mut wire), config) in buses.into_iter().enumerate().zip(timing.bus) {
        let turn = move |shared: &Shared| io::serve_bus(bus, wire.as_mut(), &shared.inbox, &shared.awaited);
        threads.push(spawn_turns(shared, &format!("bus{bus}"), config, turn)?);
    }
    let turn = move |shared: &Shared| io::serve_imu(&mut imu, &shared.inbox);
    threads.push(spawn_turns(shared, "imu", timing.imu, turn)?);
    Ok(threads)
}

/// A thread that does the same again and again until the loop has ended.
fn spawn_turns(
    shared: &Shared,
    name: &str,
    config: Thread,
    mut turn: impl FnMut(&Shared) + Send + 'static,
) -> Result<JoinHandle<()>, ProcessError> {
    let shared = shared.clone();
    let body = move || {
        if shared.enter(&config, Ok(())).is_some() {
            let mut vigil = Vigil::new(&shared.progress);
            while shared.running() {
                turn(&shared);
                vigil.look();
            }
        }
    };
    Ok(builder(name, &config).spawn(body)?)
}

fn spawn_control<W, F>(
    shared: &Shared,
    timing: RealTime,
    desk: Desk<W>,
    feed: F,
) -> Result<JoinHandle<()>, ProcessError>
where
    W: Walk + Send + 'static,
    F: Feed + Send + 'static,
{
    let (shared, config) = (shared.clone(), timing.control);
    let body = move || {
        let may_run = shared.enter(&config, Ok(())).is_some();
        // From here on, whatever happens, the drives are told to stop.
        let _guard = StopGuard::new(desk.words, shared.stop.clone());
        if !may_run {
            return;
        }
        let missing = Missing(shared.missing.load(Ordering::Relaxed)).needed();
        let mut control = ControlLoop {
            walk: desk.walk,
            feed,
            wires: desk.wires,
            hand: desk.hand,
            handover: shared.handover.clone(),
            awaited: shared.awaited.clone(),
            stop: shared.stop.clone(),
            progress: shared.progress.clone(),
            timing,
            real_time_missing: if desk.simulated { 0 } else { missing.0 },
        };
        let mut vigil = Vigil::new(&shared.progress);
        let desk = control.run(|| vigil.look());
        drop(vigil);
        drop(desk);
    };
    Ok(builder("control", &config).spawn(body)?)
}

fn builder(name: &str, config: &Thread) -> Builder {
    Builder::new().name(name.into()).stack_size(config.stack_bytes.max(ORDINARY.stack_bytes))
}

#[cfg(test)]
mod tests;
