//! Where a tick's input comes from. RT: yes, no allocation.
//!
//! [`ThreadFeed`]: a thread per bus and for the IMU receives and hands over through rings. [`InlineFeed`]: the
//! control thread itself sleeps on the descriptors (or spins on them), so that between a frame on the wire and the
//! command there is one wake-up, or none.

use super::awaited::Awaited;
use super::clock;
use super::io::{FRAMES_WAITING, ImuPort, Inbox};
use super::poll;
use crate::base::time::Stamp;
use crate::bus::Receive;
use crate::channel::ring::Ring;
use crate::msg::{BUSES, BusFrame, FrameBatch, ImuBatch, MAX_FRAMES, MAX_IMU, TickInput};
use std::hint;
use std::sync::Arc;

/// A tick takes so much, and of what waits the newest: the older ones are thrown away and counted. Returns their number.
fn skip<T: Copy + Default>(ring: &Ring<T>, most: usize) -> u32 {
    let too_many = ring.waiting().saturating_sub(most);
    let skipped = (0..too_many).filter(|_| ring.pop().is_some()).count();
    u32::try_from(skipped).unwrap_or(u32::MAX)
}

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
    /// Thrown away here since start.
    frames_skipped: [u32; BUSES],
    samples_skipped: u32,
}

impl ThreadFeed {
    /// Takes from this inbox.
    #[must_use]
    pub const fn new(inbox: Arc<Inbox>, awaited: Arc<Awaited>) -> Self {
        Self { inbox, awaited, frames_skipped: [0; BUSES], samples_skipped: 0 }
    }
}

impl Feed for ThreadFeed {
    fn wait(&mut self, until: Stamp) {
        self.awaited.wait(until);
    }

    fn collect(&mut self, input: &mut TickInput) {
        (input.heard_until, input.imu_heard_until) = self.inbox.heard_until();
        let rings = self.inbox.frames.iter().zip(&mut self.frames_skipped).zip(self.inbox.frames_lost());
        for (((ring, skipped), lost), batch) in rings.zip(&mut input.received) {
            *skipped = skipped.saturating_add(skip(ring, MAX_FRAMES));
            *batch = FrameBatch { dropped: lost.saturating_add(*skipped), ..FrameBatch::default() };
            for _ in 0..MAX_FRAMES {
                let Some(frame) = ring.pop() else { break };
                batch.push(frame);
            }
        }
        self.samples_skipped = self.samples_skipped.saturating_add(skip(&self.inbox.imu, MAX_IMU));
        input.imu.count = 0;
        for _ in 0..MAX_IMU {
            let Some(sample) = self.inbox.imu.pop() else { break };
            input.imu.push(sample);
        }
        input.imu.dropped = self.inbox.imu_lost().saturating_add(self.samples_skipped);
        input.bus_health = self.inbox.health();
    }
}

/// The control thread reads the descriptors itself.
pub struct InlineFeed {
    buses: [Box<dyn Receive + Send>; BUSES],
    imu: ImuPort,
    awaited: Arc<Awaited>,
    busy: bool,
    frames: [Ring<BusFrame>; BUSES],
    /// Frames thrown away here since start.
    skipped: [u32; BUSES],
    samples: ImuBatch,
    heard_until: [Stamp; BUSES],
    imu_heard_until: Stamp,
}

impl InlineFeed {
    /// Reads from these. `busy`: spins instead of sleeping.
    #[must_use]
    pub fn new(buses: [Box<dyn Receive + Send>; BUSES], imu: ImuPort, awaited: Arc<Awaited>, busy: bool) -> Self {
        let frames = std::array::from_fn(|_| Ring::new(FRAMES_WAITING));
        let samples = ImuBatch::default();
        let (heard_until, imu_heard_until) = ([Stamp::NEVER; BUSES], Stamp::NEVER);
        Self { buses, imu, awaited, busy, frames, skipped: [0; BUSES], samples, heard_until, imu_heard_until }
    }

    fn drain(&mut self) {
        let now = clock::now();
        let buses = self.buses.iter_mut().zip(&mut self.frames).zip(&mut self.heard_until);
        for (bus, ((wire, batch), until)) in buses.enumerate() {
            *until = wire.complete_until(now);
            while let Some(frame) = wire.receive() {
                batch.push_newest(&frame);
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
        let rings = self.frames.iter().zip(&self.buses).zip(&mut self.skipped);
        for (((ring, wire), skipped), taken) in rings.zip(&mut input.received) {
            *skipped = skipped.saturating_add(skip(ring, MAX_FRAMES));
            let lost = u32::try_from(ring.lost()).unwrap_or(u32::MAX).saturating_add(wire.lost());
            *taken = FrameBatch { dropped: lost.saturating_add(*skipped), ..FrameBatch::default() };
            for _ in 0..MAX_FRAMES {
                let Some(frame) = ring.pop() else { break };
                taken.push(frame);
            }
        }
        input.imu = self.samples;
        self.samples.count = 0;
        (input.heard_until, input.imu_heard_until) = (self.heard_until, self.imu_heard_until);
        input.bus_health = self.buses.each_ref().map(|wire| wire.health());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;
    use crate::msg::{CanFrame, ImuSample};

    /// A wire that has lost so many frames before they could be received.
    struct Leaky(u32);

    impl Receive for Leaky {
        fn receive(&mut self) -> Option<BusFrame> {
            None
        }
        fn health(&self) -> crate::msg::BusHealth {
            crate::msg::BusHealth::Active
        }
        fn readable_fd(&self) -> std::os::fd::RawFd {
            -1
        }
        fn lost(&self) -> u32 {
            self.0
        }
    }

    /// No IMU.
    struct Silence;

    impl crate::rt::io::ByteLine for Silence {
        fn read(&mut self, _buffer: &mut [u8]) -> Option<usize> {
            Some(0)
        }
        fn write(&mut self, _bytes: &[u8]) -> bool {
            true
        }
        fn readable_fd(&self) -> std::os::fd::RawFd {
            -1
        }
    }

    #[test]
    fn what_a_wire_lost_before_it_could_be_received_is_told_in_the_tick() {
        let robot = config::load(None, &[]).unwrap().config.robot;
        let awaited = Arc::new(Awaited::new(&robot));
        let mut input = TickInput::default();
        let inbox = Arc::new(Inbox::default());
        crate::rt::io::serve_bus(1, &mut Leaky(7), &inbox, &awaited, crate::base::time::Span::ZERO);
        ThreadFeed::new(inbox, Arc::clone(&awaited)).collect(&mut input);
        assert_eq!(input.received.map(|batch| batch.dropped), [0, 7], "by a thread");
        let imu = ImuPort::new(crate::sensor::imu::ImuReader::new(&robot.imu), Box::new(Silence));
        InlineFeed::new([Box::new(Leaky(3)), Box::new(Leaky(0))], imu, awaited, false).collect(&mut input);
        assert_eq!(input.received.map(|batch| batch.dropped), [3, 0], "by the control thread itself");
    }

    #[test]
    fn after_a_stall_the_newest_frames_and_samples_are_taken_and_every_loss_is_counted() {
        let robot = config::load(None, &[]).unwrap().config.robot;
        let inbox = Arc::new(Inbox::default());
        let mut feed = ThreadFeed::new(Arc::clone(&inbox), Arc::new(Awaited::new(&robot)));
        for k in 0..100_u8 {
            inbox.frames[1].push_newest(&BusFrame::theirs(Stamp(i64::from(k)), CanFrame::new(0x181, &[k])));
            inbox.imu.push_newest(&ImuSample { device_ticks: u32::from(k), ..ImuSample::default() });
        }
        let mut input = TickInput::default();
        feed.collect(&mut input);
        let bytes: Vec<u8> = input.received[1].iter().map(|f| f.frame.data[0]).collect();
        assert_eq!(bytes, (76..100).collect::<Vec<u8>>(), "24 of 100, the newest");
        assert_eq!((input.received[1].dropped, input.received[0].dropped), (76, 0));
        let ticks: Vec<u32> = input.imu.as_slice().iter().map(|s| s.device_ticks).collect();
        assert_eq!((ticks, input.imu.dropped), ((92..100).collect(), 92));
        feed.collect(&mut input);
        assert_eq!((input.received[1].count, input.received[1].dropped), (0, 76), "counts stay");
    }
}
