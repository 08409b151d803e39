//! Where a tick's input comes from. RT: yes, no allocation.
//!
//! [`ThreadFeed`]: a thread per bus and for the IMU receives and hands over through rings. [`InlineFeed`]: the
//! control thread itself sleeps on the descriptors (or spins on them), so that between a frame on the wire and the
//! command there is one wake-up, or none.

use super::awaited::Awaited;
use super::clock;
use super::io::{ImuPort, Inbox};
use super::poll;
use crate::base::time::Stamp;
use crate::bus::Receive;
use crate::msg::{BUSES, FrameBatch, ImuBatch, TickInput};
use std::hint;
use std::sync::Arc;

/// Brings what came in since the last tick.
pub trait Feed {
    /// Waits until all awaited answers are in, or until a time.
    fn wait(&mut self, until: Stamp);
    /// Puts what came in into the tick's input.
    fn collect(&mut self, input: &mut TickInput);
}

/// Fed by I/O threads through rings.
pub struct ThreadFeed {
    inbox: Arc<Inbox>,
    awaited: Arc<Awaited>,
}

impl ThreadFeed {
    /// Takes from this inbox.
    #[must_use]
    pub const fn new(inbox: Arc<Inbox>, awaited: Arc<Awaited>) -> Self {
        Self { inbox, awaited }
    }
}

impl Feed for ThreadFeed {
    fn wait(&mut self, until: Stamp) {
        self.awaited.wait(until);
    }

    fn collect(&mut self, input: &mut TickInput) {
        (input.heard_until, input.imu_heard_until) = self.inbox.heard_until();
        for (ring, batch) in self.inbox.frames.iter().zip(&mut input.received) {
            batch.clear();
            while let Some(frame) = ring.pop() {
                batch.push(frame);
            }
        }
        input.imu.count = 0;
        while let Some(sample) = self.inbox.imu.pop() {
            input.imu.push(sample);
        }
        input.imu.dropped = input.imu.dropped.max(self.inbox.imu_lost());
        input.bus_health = self.inbox.health();
    }
}

/// The control thread reads the descriptors itself.
pub struct InlineFeed {
    buses: [Box<dyn Receive + Send>; BUSES],
    imu: ImuPort,
    awaited: Arc<Awaited>,
    busy: bool,
    frames: [FrameBatch; BUSES],
    samples: ImuBatch,
    heard_until: [Stamp; BUSES],
    imu_heard_until: Stamp,
}

impl InlineFeed {
    /// Reads from these. `busy`: spins instead of sleeping.
    #[must_use]
    pub fn new(buses: [Box<dyn Receive + Send>; BUSES], imu: ImuPort, awaited: Arc<Awaited>, busy: bool) -> Self {
        let (frames, samples) = (Default::default(), ImuBatch::default());
        let (heard_until, imu_heard_until) = ([Stamp::NEVER; BUSES], Stamp::NEVER);
        Self { buses, imu, awaited, busy, frames, samples, heard_until, imu_heard_until }
    }

    fn drain(&mut self) {
        let now = clock::now();
        let buses = self.buses.iter_mut().zip(&mut self.frames).zip(&mut self.heard_until);
        for (bus, ((wire, batch), until)) in buses.enumerate() {
            *until = wire.complete_until(now);
            while let Some(frame) = wire.receive() {
                batch.push(frame);
                self.awaited.arrived(bus, &frame);
            }
        }
        self.imu_heard_until = self.imu.serve(now, &mut self.samples);
    }
}

impl Feed for InlineFeed {
    fn wait(&mut self, until: Stamp) {
        loop {
            self.drain();
            if self.awaited.is_complete() || clock::now() >= until {
                return;
            }
            if self.busy {
                hint::spin_loop();
            } else {
                let [a, b] = &self.buses;
                poll::readable([a.readable_fd(), b.readable_fd(), self.imu.readable_fd()], until);
            }
        }
    }

    fn collect(&mut self, input: &mut TickInput) {
        self.drain();
        for (batch, taken) in self.frames.iter_mut().zip(&mut input.received) {
            *taken = *batch;
            batch.clear();
        }
        input.imu = self.samples;
        self.samples.count = 0;
        (input.heard_until, input.imu_heard_until) = (self.heard_until, self.imu_heard_until);
        input.bus_health = self.buses.each_ref().map(|wire| wire.health());
    }
}
