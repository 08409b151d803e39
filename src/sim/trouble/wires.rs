//! The controller's end of a simulated bus, and whoever else sends on it. RT: no.

use crate::base::time::{Span, Stamp};
use crate::bus::Receive;
use crate::bus::canopen::{Message, Node, PdoData};
use crate::bus::faulty::{Faults, Faulty};
use crate::bus::line::SYNC_FRAME;
use crate::config::fault::Injection;
use crate::msg::{BusFrame, BusHealth, CanFrame, FrameBatch};
use crate::sim::noise::Noise;
use std::collections::VecDeque;
use std::os::fd::RawFd;

/// Frames that wait for the controller; beyond this it has stopped reading.
const HOST_QUEUE: usize = 1024;
/// Makes the draws of a bus another stream than the IMU's noise.
const STREAM: u64 = 0x6661_756C;
/// A stranger on the bus keeps so many frames waiting: more than a millisecond's worth.
const LOAD_FRAMES: usize = 20;

/// What has arrived at the controller, some of it late.
#[derive(Debug)]
struct HostQueue {
    now: Stamp,
    frames: VecDeque<(Stamp, BusFrame)>,
    health: BusHealth,
    late: Option<(f64, Span)>,
    noise: Noise,
}

impl HostQueue {
    fn push(&mut self, frame: BusFrame) {
        let late = self.late.filter(|(share, _)| self.noise.uniform() < *share).map_or(Span::ZERO, |(_, by)| by);
        let ready = frame.stamp + late;
        let place = self.frames.partition_point(|(at, _)| *at <= ready);
        self.frames.insert(place, (ready, frame));
    }
}

impl Receive for HostQueue {
    fn receive(&mut self) -> Option<BusFrame> {
        self.frames.front().filter(|(ready, _)| *ready <= self.now)?;
        self.frames.pop_front().map(|(_, frame)| frame)
    }
    fn health(&self) -> BusHealth {
        self.health
    }
    /// None: nobody polls a queue in memory.
    fn readable_fd(&self) -> RawFd {
        -1
    }
}

/// The controller's end of a bus: its CAN controller with the queues before and behind it.
#[derive(Debug)]
pub(in crate::sim) struct HostEnd {
    queue: Faulty<HostQueue>,
    /// Did not fit into the batch before.
    left_over: Option<BusFrame>,
    /// The queue before the wire takes nothing.
    pub(in crate::sim) is_full: bool,
    dropped: u32,
}

impl HostEnd {
    pub(in crate::sim) fn new(seed: u64, bus: usize) -> Self {
        let seed = seed ^ STREAM ^ (bus as u64) << 8;
        let queue = HostQueue {
            now: Stamp::default(),
            frames: VecDeque::new(),
            health: BusHealth::Active,
            late: None,
            noise: Noise::new(seed),
        };
        Self { queue: Faulty::new(queue, Faults::default(), seed), left_over: None, is_full: false, dropped: 0 }
    }

    pub(in crate::sim) fn health(&self) -> BusHealth {
        self.queue.health()
    }

    /// Off the bus, or down: hears nothing and sends nothing.
    pub(in crate::sim) fn is_deaf(&self) -> bool {
        matches!(self.health(), BusHealth::Off | BusHealth::Down)
    }

    pub(in crate::sim) fn set_health(&mut self, health: BusHealth) {
        self.queue.inner_mut().health = health;
    }

    /// A frame has arrived.
    pub(in crate::sim) fn hear(&mut self, frame: BusFrame) {
        if self.is_deaf() {
            return;
        }
        let queue = self.queue.inner_mut();
        if queue.frames.len() < HOST_QUEUE { queue.push(frame) } else { self.dropped += 1 }
    }

    /// What has arrived by now, as much as fits.
    pub(in crate::sim) fn take(&mut self, now: Stamp, batch: &mut FrameBatch) {
        self.queue.inner_mut().now = now;
        while let Some(frame) = self.left_over.take().or_else(|| self.queue.receive()) {
            if !batch.has_room(&frame.frame) {
                self.left_over = Some(frame);
                break;
            }
            batch.push(frame);
        }
        batch.dropped = batch.dropped.max(self.dropped);
    }

    /// Received frames suffer this from now on; `None` = nothing.
    pub(in crate::sim) fn spoil(&mut self, how: Option<&Injection>) {
        let (mut faults, mut late) = (Faults::default(), None);
        if let Some(how) = how {
            match how.kind {
                "doubled" => faults.double = how.share,
                "late" => late = Some((how.share, how.late)),
                "reordered" => faults.delay = how.share,
                "flipped" => faults.flip = how.share,
                _ => faults.lose = how.share,
            }
        }
        self.queue.set(faults);
        self.queue.inner_mut().late = late;
    }
}

/// Somebody else on the bus.
#[derive(Clone, Debug)]
pub(in crate::sim) struct Stranger {
    every: Span,
    next: Stamp,
    frames: Vec<CanFrame>,
    at_once: usize,
    sent: usize,
}

impl Stranger {
    /// Sends unknown identifiers, or plays master.
    pub(in crate::sim) fn talker(now: Stamp, fault: &Injection, node: u8) -> Self {
        let frames = if fault.kind == "master" {
            let zero = PdoData { len: 4, data: [0; 8] };
            let command = Node::new(node).map(|node| Message::Rpdo(1, node, zero).emit());
            std::iter::once(SYNC_FRAME).chain(command).collect()
        } else {
            [0x0A5, 0x2FF, 0x4C3, 0x6EE, 0x77F].map(|id| CanFrame::new(id, &[0xA5; 8])).to_vec()
        };
        Self { every: fault.every, next: now, frames, at_once: 1, sent: 0 }
    }

    /// Never leaves the bus alone.
    pub(in crate::sim) fn load(now: Stamp, fault: &Injection) -> Self {
        let id = if fault.kind == "high" { 0x001 } else { 0x7FF };
        let frames = vec![CanFrame::new(id, &[0x55; 8])];
        Self { every: Span::from_ms(1), next: now, frames, at_once: LOAD_FRAMES, sent: 0 }
    }

    pub(in crate::sim) const fn next_time(&self) -> Stamp {
        self.next
    }

    /// Most frames that it has waiting.
    pub(in crate::sim) const fn at_once(&self) -> usize {
        self.at_once
    }

    /// Its turn is over.
    pub(in crate::sim) fn rest(&mut self) {
        self.next += self.every;
    }

    pub(in crate::sim) fn frame(&mut self) -> CanFrame {
        self.sent += 1;
        self.frames[self.sent % self.frames.len()]
    }
}
