//! The threads of a running robot. RT: starting and ending are not.
//!
//! ```text
//!  bus 0 ── io thread ─┐ frames                        ┌─► bus 0, bus 1 (sends itself)
//!  bus 1 ── io thread ─┼────────► control thread ──────┤
//!  IMU ──── io thread ─┘ samples   (the tick)          └─► relay ──► recorder, terminal, other processes
//! ```
//! With `input = "inline"` or `"busy"` the io threads are absent and the control thread reads the devices itself.
//! Every thread sets itself up, reports what was not granted, and waits for the common start.

mod progress;
mod spawn;

use super::control_loop::Walk;
use super::feed::{InlineFeed, ThreadFeed};
use super::io::ImuPort;
use super::memory;
use super::relay::{Observed, Sinks};
use super::stop::{LastWords, Stop};
use super::thread::{Awake, Missing};
use crate::bus::{Receive, Transmit};
use crate::channel::port::ChannelError;
use crate::channel::ring::Ring;
use crate::config::checked::{Config, Input, RealTime};
use crate::msg::{BUSES, FrameBatch, LidarSample, TickRecord};
use crate::sensor::operator::Hand;
use spawn::{Desk, Shared, spawn_control, spawn_io, spawn_relay};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;

pub use progress::Progress;

/// Why the threads did not start.
#[derive(Debug, thiserror::Error)]
pub enum ProcessError {
    /// Shared memory.
    #[error(transparent)]
    Channel(#[from] ChannelError),
    /// The system gave no thread.
    #[error("cannot start a thread")]
    Thread(#[from] std::io::Error),
    /// Real motors with a hand or an attitude that a program makes up.
    #[error(
        "the buses are real, and the operator or the IMU is simulated: refused, motors would run with nobody there"
    )]
    MadeUpSenses,
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
    /// Words of the lidar, if there is one; its thread is somebody else's.
    pub lidar: Option<Arc<Ring<LidarSample>>>,
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
    /// One of its threads ended by a panic: control, input or relay.
    pub panicked: bool,
}

/// A running robot.
pub struct Running {
    control: JoinHandle<()>,
    io: Vec<JoinHandle<()>>,
    relay: JoinHandle<Observed>,
    handover: Arc<Ring<TickRecord>>,
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
        let mut panicked = self.control.join().is_err();
        self.progress.ended.store(true, Ordering::Release);
        self.stop.request();
        for thread in self.io {
            // What it was, the hook has told.
            panicked |= thread.join().is_err();
        }
        let relay = self.relay.join();
        panicked |= relay.is_err();
        let mut observed = relay.unwrap_or_default();
        // Those that wait now came after its last look: it has ended early.
        observed.missed = self.handover.lost() + self.handover.waiting() as u64;
        panicked |= observed.panicked;
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

/// Starts all threads. Returns when each has its priority, memory and channels and the loop is on its way.
///
/// # Errors
/// [`ProcessError`]; then no thread is left.
pub fn start<W: Walk + Send + 'static>(walk: W, parts: Parts) -> Result<Running, ProcessError> {
    // The configuration refuses this already; here it is refused whatever way the parts came together.
    if parts.config.robot.has_made_up_senses() || (!parts.simulated && matches!(parts.hand, Hand::Simulated(_))) {
        return Err(ProcessError::MadeUpSenses);
    }
    let timing = parts.config.real_time.clone();
    let (awake, missing) = hold_machine(&timing);
    let threads = if timing.input == Input::Threads { BUSES + 3 } else { 2 };
    let (shared, reports) = Shared::new(&parts.config.robot, parts.stop, parts.missing | missing, threads);
    let relay = spawn_relay(&shared, parts.robot, parts.sinks, timing.flight_recorder_ticks)?;
    let [bus0, bus1] = parts.buses;
    let words = LastWords { frames: parts.stop_frames, wires: [bus0.last_words, bus1.last_words] };
    let wires = [bus0.transmit, bus1.transmit];
    let desk = Desk { walk, words, wires, lidar: parts.lidar, hand: parts.hand, simulated: parts.simulated };
    let (control, io) = spawn_loop(&shared, timing, desk, [bus0.receive, bus1.receive], parts.imu)?;
    let result = shared.launch(&reports, threads);
    let missing = Missing(shared.missing.load(Ordering::Relaxed));
    let Shared { handover, progress, stop, .. } = shared;
    let running = Running { control, io, relay, handover, progress, missing, stop, _awake: awake };
    match result {
        Ok(()) => Ok(running),
        Err(error) => {
            drop(running.wait());
            Err(error)
        }
    }
}

/// Locks the memory and keeps the processor awake, as configured; says what was not granted.
fn hold_machine(timing: &RealTime) -> (Option<Awake>, Missing) {
    let locked = !timing.lock_memory || memory::lock();
    let awake = timing.hold_cpu_awake.then(Awake::hold).flatten();
    let sleeps = timing.hold_cpu_awake && awake.is_none();
    let memory = if locked { Missing::default() } else { Missing::MEMORY };
    (awake, memory | if sleeps { Missing::AWAKE } else { Missing::default() })
}

/// A control thread, and the threads that bring its input.
type LoopThreads = (JoinHandle<()>, Vec<JoinHandle<()>>);

/// The control thread with whoever brings its input: threads of their own, or itself.
fn spawn_loop<W: Walk + Send + 'static>(
    shared: &Shared,
    timing: RealTime,
    desk: Desk<W>,
    inputs: [Box<dyn Receive + Send>; BUSES],
    imu: ImuPort,
) -> Result<LoopThreads, ProcessError> {
    let awaited = shared.awaited.clone();
    match timing.input {
        Input::Threads => {
            let io = spawn_io(shared, &timing, inputs, imu)?;
            let feed = ThreadFeed::new(shared.inbox.clone(), awaited);
            Ok((spawn_control(shared, timing, desk, feed)?, io))
        }
        Input::Inline | Input::Busy => {
            let busy = timing.input == Input::Busy;
            let feed = InlineFeed::new(inputs, imu, awaited, busy);
            Ok((spawn_control(shared, timing, desk, feed)?, Vec::new()))
        }
    }
}

#[cfg(test)]
mod tests;
