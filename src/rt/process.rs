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
use super::io::{self, ImuPort, Seen};
use super::memory;
use super::relay::{Observed, Relay, Sinks};
use super::stop::{LastWords, Stop, StopGuard};
use super::thread::{self as schedule, Awake, Missing};
use crate::bus::{Receive, Transmit};
use crate::channel::port::{ChannelError, Endpoint};
use crate::channel::topic;
use crate::config::checked::{Config, Input, RealTime, Thread};
use crate::msg::{BUSES, FrameBatch, Mode, TickRecord};
use crate::sensor::operator::Hand;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Barrier, mpsc};
use std::thread::{self, Builder, JoinHandle};
use std::time::{Duration, Instant};

/// The relay gets so long to take the last ticks.
const LONGEST_LINGER: Duration = Duration::from_secs(2);

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
    /// Ticks that could not be handed over.
    pub refused_ticks: AtomicU64,
    mode: AtomicU8,
    was_armed: AtomicBool,
    allocations: AtomicU64,
    page_faults: AtomicU64,
    ended: AtomicBool,
    drained: AtomicBool,
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

    pub(super) fn note(&self, record: &TickRecord, refused: u64) {
        self.ticks.store(record.input.index + 1, Ordering::Release);
        self.refused_ticks.store(refused, Ordering::Relaxed);
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
    /// Ticks that could not be handed over.
    pub refused_ticks: u64,
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
            refused_ticks: self.progress.refused_ticks.load(Ordering::Relaxed),
            allocations: after_arming(&self.progress.allocations),
            page_faults: after_arming(&self.progress.page_faults),
            panicked,
        }
    }
}

/// What all threads share while they start and run.
#[derive(Clone)]
struct Shared {
    robot: String,
    awaited: Arc<Awaited>,
    seen: Arc<Seen>,
    progress: Arc<Progress>,
    stop: Stop,
    missing: Arc<AtomicU32>,
    start: Arc<Barrier>,
    ready: mpsc::Sender<Result<(), ProcessError>>,
}

impl Shared {
    /// Sets the calling thread up; what it needs from the channels is opened by `open`. Then waits for the others.
    fn enter<T>(
        &self,
        config: &Thread,
        open: impl FnOnce(&Endpoint) -> Result<T, ChannelError>,
    ) -> Option<(Endpoint, T)> {
        self.missing.fetch_or(schedule::enter(config).0, Ordering::Relaxed);
        let opened = Endpoint::join(&self.robot).and_then(|channels| open(&channels).map(|ports| (channels, ports)));
        let (result, opened) = match opened {
            Ok(opened) => (Ok(()), Some(opened)),
            Err(error) => (Err(error.into()), None),
        };
        // Nobody listens any more only if another thread has failed already.
        drop(self.ready.send(result));
        self.start.wait();
        opened.filter(|_| !self.stop.is_requested())
    }

    fn running(&self) -> bool {
        !self.progress.ended.load(Ordering::Acquire)
    }

    /// The loop has ended, but its last ticks live in its own publisher: keep that until the relay has them.
    fn linger(&self) {
        self.progress.ended.store(true, Ordering::Release);
        let end = Instant::now() + LONGEST_LINGER;
        while !self.progress.drained.load(Ordering::Acquire) && Instant::now() < end {
            thread::sleep(Duration::from_millis(1));
        }
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
        robot: parts.robot,
        awaited: Arc::new(Awaited::new(&parts.config.robot)),
        seen: Arc::default(),
        progress: Arc::default(),
        stop: parts.stop,
        missing: Arc::new(AtomicU32::new(missing.0)),
        start: Arc::new(Barrier::new(threads + 1)),
        ready,
    };
    let relay = spawn_relay(&shared, parts.sinks, timing.flight_recorder_ticks)?;
    let [bus0, bus1] = parts.buses;
    let words = LastWords { frames: parts.stop_frames, wires: [bus0.last_words, bus1.last_words] };
    let desk =
        Desk { walk, words, wires: [bus0.transmit, bus1.transmit], hand: parts.hand, simulated: parts.simulated };
    let inputs = [bus0.receive, bus1.receive];
    let (control, io) = match timing.input {
        Input::Threads => {
            let io = spawn_io(&shared, &timing, inputs, parts.imu)?;
            let attach =
                |channels: &Endpoint, s: &Shared| ThreadFeed::attach(channels, s.awaited.clone(), s.seen.clone());
            (spawn_control(&shared, timing, desk, attach)?, io)
        }
        Input::Inline | Input::Busy => {
            let busy = timing.input == Input::Busy;
            let attach =
                move |_: &Endpoint, s: &Shared| Ok(InlineFeed::new(inputs, parts.imu, s.awaited.clone(), busy));
            (spawn_control(&shared, timing, desk, attach)?, Vec::new())
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

fn spawn_relay(shared: &Shared, sinks: Sinks, flight_ticks: usize) -> Result<JoinHandle<Observed>, ProcessError> {
    let shared = shared.clone();
    let body = move || {
        let relay = shared.enter(&ORDINARY, |channels| Relay::attach(channels, sinks, flight_ticks));
        let observed = relay.map_or_else(Observed::default, |(_channels, relay)| relay.run(|| !shared.running()));
        shared.progress.drained.store(true, Ordering::Release);
        observed
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
        let shared = shared.clone();
        let body = move || {
            let topic = topic::RECEIVED.get(bus).unwrap_or(&topic::RECEIVED[0]);
            let Some((_channels, mut out)) = shared.enter(&config, |channels| channels.publisher(topic)) else {
                return;
            };
            let mut vigil = Vigil::new(&shared.progress);
            while shared.running() {
                io::serve_bus(bus, wire.as_mut(), &mut out, &shared.awaited, &shared.seen);
                vigil.look();
            }
        };
        threads.push(builder(&format!("bus{bus}"), &config).spawn(body)?);
    }
    let (shared, config) = (shared.clone(), timing.imu);
    let body = move || {
        let Some((_channels, mut out)) = shared.enter(&config, |channels| channels.publisher(&topic::IMU)) else {
            return;
        };
        let mut vigil = Vigil::new(&shared.progress);
        while shared.running() {
            io::serve_imu(&mut imu, &mut out, &shared.seen);
            vigil.look();
        }
    };
    threads.push(builder("imu", &config).spawn(body)?);
    Ok(threads)
}

fn spawn_control<W, F>(
    shared: &Shared,
    timing: RealTime,
    desk: Desk<W>,
    attach: impl FnOnce(&Endpoint, &Shared) -> Result<F, ChannelError> + Send + 'static,
) -> Result<JoinHandle<()>, ProcessError>
where
    W: Walk + Send + 'static,
    F: Feed,
{
    let (shared, config) = (shared.clone(), timing.control);
    let body = move || {
        let open = |channels: &Endpoint| Ok((channels.publisher(&topic::TICK_HANDOVER)?, attach(channels, &shared)?));
        let opened = shared.enter(&config, open);
        // From here on, whatever happens, the drives are told to stop.
        let guard = StopGuard::new(desk.words, shared.stop.clone());
        let Some((_channels, (handover, feed))) = opened else { return };
        let missing = Missing(shared.missing.load(Ordering::Relaxed)).needed();
        let mut control = ControlLoop {
            walk: desk.walk,
            feed,
            wires: desk.wires,
            hand: desk.hand,
            handover,
            awaited: shared.awaited.clone(),
            stop: shared.stop.clone(),
            progress: shared.progress.clone(),
            timing,
            real_time_missing: if desk.simulated { 0 } else { missing.0 },
        };
        let mut vigil = Vigil::new(&shared.progress);
        control.run(|| vigil.look());
        drop(vigil);
        drop(guard);
        shared.linger();
    };
    Ok(builder("control", &config).spawn(body)?)
}

fn builder(name: &str, config: &Thread) -> Builder {
    Builder::new().name(name.into()).stack_size(config.stack_bytes.max(ORDINARY.stack_bytes))
}

#[cfg(test)]
mod tests;
