//! Input: bytes and frames from their devices into rings, one thread per device. RT: yes; waits on descriptors.

use super::awaited::Awaited;
use super::clock;
use super::poll;
use crate::base::listening::Pulse;
use crate::base::time::{Span, Stamp};
use crate::bus::Receive;
use crate::channel::ring::Ring;
use crate::msg::{BUSES, BusFrame, BusHealth, ImuBatch, ImuSample};
use crate::sensor::imu::ImuReader;
use std::os::fd::RawFd;
use std::sync::atomic::{AtomicU8, AtomicU32, Ordering};

/// Bytes read at once: 16 ms of the fastest stream (USB adapters deliver so), and some.
const CHUNK: usize = 2048;

/// Frames that wait at most: three cycles of a full bus.
pub(super) const FRAMES_WAITING: usize = 64;
/// IMU samples that wait at most.
const SAMPLES_WAITING: usize = 32;

/// What the I/O threads bring, for the control thread.
#[derive(Debug)]
pub struct Inbox {
    /// Frames of each bus.
    pub frames: [Ring<BusFrame>; BUSES],
    /// Samples of the IMU.
    pub imu: Ring<ImuSample>,
    health: [AtomicU8; BUSES],
    /// Frames that each wire lost before they could be received.
    wire_lost: [AtomicU32; BUSES],
    imu_lost: AtomicU32,
    heard: [Pulse; BUSES],
    imu_heard: Pulse,
}

impl Default for Inbox {
    fn default() -> Self {
        Self {
            frames: std::array::from_fn(|_| Ring::new(FRAMES_WAITING)),
            imu: Ring::new(SAMPLES_WAITING),
            health: Default::default(),
            wire_lost: Default::default(),
            imu_lost: AtomicU32::new(0),
            heard: Default::default(),
            imu_heard: Pulse::default(),
        }
    }
}

impl Inbox {
    /// Health of each bus.
    #[must_use]
    pub fn health(&self) -> [BusHealth; BUSES] {
        let read = |n: &AtomicU8| BusHealth::from_u8(n.load(Ordering::Relaxed)).unwrap_or(BusHealth::Down);
        self.health.each_ref().map(read)
    }

    /// Frames of each bus lost since start: by the wire's driver, and for want of room on their way.
    #[must_use]
    pub fn frames_lost(&self) -> [u32; BUSES] {
        std::array::from_fn(|bus| {
            let by_wire = self.wire_lost.get(bus).map_or(0, |n| n.load(Ordering::Relaxed));
            by_wire.saturating_add(self.frames.get(bus).map_or(0, ring_lost))
        })
    }

    /// Until when each bus, and the IMU, has been listened to. Read this before what was heard.
    #[must_use]
    pub fn heard_until(&self) -> ([Stamp; BUSES], Stamp) {
        (self.heard.each_ref().map(Pulse::last), self.imu_heard.last())
    }

    /// IMU messages lost since start.
    #[must_use]
    pub fn imu_lost(&self) -> u32 {
        self.imu_lost.load(Ordering::Relaxed).saturating_add(ring_lost(&self.imu))
    }
}

fn ring_lost<T: Copy + Default>(ring: &Ring<T>) -> u32 {
    u32::try_from(ring.lost()).unwrap_or(u32::MAX)
}

/// A line of bytes that never waits: a serial device, or a simulated one.
pub trait ByteLine: Send {
    /// Bytes that are there, 0 if none. `None`: the device is gone.
    fn read(&mut self, buffer: &mut [u8]) -> Option<usize>;
    /// Hands over a few bytes. False: gone or full.
    fn write(&mut self, bytes: &[u8]) -> bool;
    /// A descriptor that polls readable when bytes are there; negative if there is none.
    fn readable_fd(&self) -> RawFd;
    /// What was sent before this time can be read at `now`, as for a bus.
    fn complete_until(&self, now: Stamp) -> Stamp {
        now
    }
}

/// The IMU's line and its reader.
pub struct ImuPort {
    reader: ImuReader,
    line: Box<dyn ByteLine>,
    gone: bool,
}

impl ImuPort {
    /// Reads this line.
    #[must_use]
    pub fn new(reader: ImuReader, line: Box<dyn ByteLine>) -> Self {
        Self { reader, line, gone: false }
    }

    /// Sends the request that is due, adds the samples that came. Returns until when it has heard everything.
    pub fn serve(&mut self, now: Stamp, batch: &mut ImuBatch) -> Stamp {
        let until = self.line.complete_until(now);
        if let Some(request) = self.reader.transmit(now) {
            // A request that is not taken is not answered, and the reader begins anew.
            self.line.write(request.as_slice());
        }
        let mut bytes = [0; CHUNK];
        let count = self.line.read(&mut bytes);
        self.gone = count.is_none();
        self.reader.receive(now, bytes.get(..count.unwrap_or(0)).unwrap_or(&[]), batch);
        until
    }

    /// A descriptor that polls readable when bytes are there; none when the device is gone, which polls readable for
    /// ever and would make the thread spin.
    #[must_use]
    pub fn readable_fd(&self) -> RawFd {
        if self.gone { -1 } else { self.line.readable_fd() }
    }
}

/// Hands over what the bus has; one turn of its thread, once in a `period` at least.
pub fn serve_bus(bus: usize, wire: &mut dyn Receive, inbox: &Inbox, awaited: &Awaited, period: Span) {
    poll::readable([wire.readable_fd()], clock::now() + period);
    let (Some(ring), Some(health), Some(heard)) = (inbox.frames.get(bus), inbox.health.get(bus), inbox.heard.get(bus))
    else {
        return;
    };
    let until = wire.complete_until(clock::now());
    while let Some(frame) = wire.receive() {
        ring.push_newest(&frame);
        awaited.arrived(bus, &frame);
    }
    health.store(wire.health() as u8, Ordering::Relaxed);
    if let Some(lost) = inbox.wire_lost.get(bus) {
        lost.store(wire.lost(), Ordering::Relaxed);
    }
    heard.beat(until);
}

/// Hands over what the IMU has; one turn of its thread, once in a `period` at least.
pub fn serve_imu(imu: &mut ImuPort, inbox: &Inbox, period: Span) {
    poll::readable([imu.readable_fd()], clock::now() + period);
    let mut batch = ImuBatch::default();
    let until = imu.serve(clock::now(), &mut batch);
    for sample in batch.as_slice() {
        inbox.imu.push_newest(sample);
    }
    inbox.imu_lost.fetch_max(batch.dropped, Ordering::Relaxed);
    inbox.imu_heard.beat(until);
}
