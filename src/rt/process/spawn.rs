//! The threads of a running robot, one by one. RT: starting and ending are not.

use super::ProcessError;
use super::progress::{Progress, Vigil};
use crate::bus::{Receive, Transmit};
use crate::channel::port::Endpoint;
use crate::channel::ring::Ring;
use crate::config::checked::{RealTime, Robot, Thread};
use crate::msg::{BUSES, LidarSample, TickRecord};
use crate::rt::awaited::Awaited;
use crate::rt::control_loop::{ControlLoop, Walk};
use crate::rt::feed::Feed;
use crate::rt::io::{self, ImuPort, Inbox};
use crate::rt::relay::{Observed, Relay, Sinks};
use crate::rt::stop::{LastWords, Stop, StopGuard};
use crate::rt::thread::{self as schedule, Missing};
use crate::sensor::operator::Hand;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Barrier, mpsc};
use std::thread::{Builder, JoinHandle};

/// Ticks that wait for the relay at most: one second, 4 MB.
const TICKS_WAITING: usize = 1000;

/// What all threads share while they start and run.
#[derive(Clone)]
pub(super) struct Shared {
    pub(super) awaited: Arc<Awaited>,
    pub(super) inbox: Arc<Inbox>,
    pub(super) handover: Arc<Ring<TickRecord>>,
    pub(super) progress: Arc<Progress>,
    pub(super) stop: Stop,
    pub(super) missing: Arc<AtomicU32>,
    /// A thread could not start, so none shall run. Not the stop: that may come before the slowest thread is on its way.
    pub(super) failed: Arc<AtomicBool>,
    start: Arc<Barrier>,
    ready: mpsc::Sender<Result<(), ProcessError>>,
}

/// What the starting thread hears from the others.
pub(super) type Reports = mpsc::Receiver<Result<(), ProcessError>>;

impl Shared {
    /// For so many threads besides the starting one.
    pub(super) fn new(robot: &Robot, stop: Stop, missing: Missing, threads: usize) -> (Self, Reports) {
        let (ready, reports) = mpsc::channel();
        let shared = Self {
            awaited: Arc::new(Awaited::new(robot)),
            inbox: Arc::default(),
            handover: Arc::new(Ring::new(TICKS_WAITING)),
            progress: Arc::default(),
            stop,
            missing: Arc::new(AtomicU32::new(missing.0)),
            failed: Arc::default(),
            start: Arc::new(Barrier::new(threads + 1)),
            ready,
        };
        (shared, reports)
    }

    /// Waits until `threads` threads are ready and lets them go, or lets them end if one of them is not.
    pub(super) fn launch(&self, reports: &Reports, threads: usize) -> Result<(), ProcessError> {
        let result = (0..threads).try_for_each(|_| reports.recv().unwrap_or(Err(ProcessError::Lost("starting"))));
        if result.is_err() {
            self.failed.store(true, Ordering::Release);
            self.stop.request();
        }
        self.start.wait();
        result
    }

    /// Sets the calling thread up, tells whether it is ready, and waits for the others. `None`: none shall run.
    fn enter<T>(&self, config: &Thread, opened: Result<T, ProcessError>) -> Option<T> {
        self.missing.fetch_or(schedule::enter(config).0, Ordering::Relaxed);
        let (result, opened) = match opened {
            Ok(opened) => (Ok(()), Some(opened)),
            Err(error) => (Err(error), None),
        };
        // Nobody listens any more only if another thread has failed already.
        drop(self.ready.send(result));
        self.start.wait();
        opened.filter(|_| !self.failed.load(Ordering::Acquire))
    }

    fn running(&self) -> bool {
        !self.progress.ended.load(Ordering::Acquire)
    }
}

/// What moves into the control thread.
pub(super) struct Desk<W> {
    pub(super) walk: W,
    pub(super) words: LastWords,
    pub(super) wires: [Box<dyn Transmit + Send>; BUSES],
    pub(super) lidar: Option<Arc<Ring<LidarSample>>>,
    pub(super) hand: Hand,
    pub(super) simulated: bool,
}

/// A thread that needs no scheduling but a touched stack.
const ORDINARY: Thread = Thread { priority: 0, core: None, stack_bytes: 256 * 1024 };

pub(super) fn spawn_relay(
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

pub(super) fn spawn_io(
    shared: &Shared,
    timing: &RealTime,
    buses: [Box<dyn Receive + Send>; BUSES],
    mut imu: ImuPort,
) -> Result<Vec<JoinHandle<()>>, ProcessError> {
    let mut threads = Vec::new();
    let period = timing.period;
    for ((bus, mut wire), config) in buses.into_iter().enumerate().zip(timing.bus) {
        let turn = move |shared: &Shared| io::serve_bus(bus, wire.as_mut(), &shared.inbox, &shared.awaited, period);
        threads.push(spawn_turns(shared, &format!("bus{bus}"), config, turn)?);
    }
    let turn = move |shared: &Shared| io::serve_imu(&mut imu, &shared.inbox, period);
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

pub(super) fn spawn_control<W, F>(
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
            lidar: desk.lidar,
            handover: shared.handover.clone(),
            awaited: shared.awaited.clone(),
            stop: shared.stop.clone(),
            progress: shared.progress.clone(),
            timing,
            real_time_missing: if desk.simulated { 0 } else { missing.0 },
        };
        let mut vigil = Vigil::new(&shared.progress);
        let desk = control.run(|| vigil.look());
        // The vigil ends first: freeing the desk is no allocation of the loop.
        drop(vigil);
        drop(desk);
    };
    Ok(builder("control", &config).spawn(body)?)
}

fn builder(name: &str, config: &Thread) -> Builder {
    Builder::new().name(name.into()).stack_size(config.stack_bytes.max(ORDINARY.stack_bytes))
}
