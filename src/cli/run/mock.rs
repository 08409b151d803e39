//! The simulated robot in this process, in real time on its own thread. RT: no, though it runs at real-time priority
//! where granted, as the hardware that it stands for would not wait either.

use crate::base::listening::Pulse;
use crate::base::time::{Span, Stamp};
use crate::bus::Receive;
use crate::bus::loopback::{Loopback, LoopbackRx, LoopbackTx};
use crate::config::checked::Config;
use crate::msg::{BUSES, FrameBatch};
use crate::rt::clock::{self, Monotonic, Timer};
use crate::rt::stop::Stop;
use crate::rt::thread;
use crate::sim::World;
use crate::sim::plant::Plant;
use crate::sim::served::lidar::LidarPort;
use crate::sim::world;
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::thread::{Builder, JoinHandle};

/// The plant looks at its wires so often: a frame waits half of this on average, as in an adapter.
const STEP: Span = Span::from_us(100);

/// What the simulated robot is made of.
pub(super) struct MockParts {
    pub(super) config: Config,
    /// The far end of each bus that is simulated.
    pub(super) ends: [Option<Loopback>; BUSES],
    /// The far end of the IMU's line, if that is simulated.
    pub(super) serial: Option<UnixStream>,
    /// The far end of the lidar's line, if that is simulated.
    pub(super) scanner: Option<UnixStream>,
    /// How far the robot has lived, for those who wait for its answers.
    pub(super) pulse: Arc<Pulse>,
}

/// A running simulated robot; dropping it switches it off.
pub(super) struct MockRobot {
    stop: Stop,
    thread: Option<JoinHandle<()>>,
}

impl MockRobot {
    /// Switches it on.
    pub(super) fn start(parts: MockParts) -> anyhow::Result<Self> {
        let stop = Stop::default();
        let asked = stop.clone();
        let schedule = parts.config.real_time.simulated_robot();
        let world = world::build(&parts.config)?;
        let body = move || {
            // Without priority the simulated robot is only less punctual.
            thread::enter(&schedule);
            Body::new(parts, world).run(&asked);
        };
        let thread = Builder::new().name("plant".into()).stack_size(2 * schedule.stack_bytes).spawn(body)?;
        Ok(Self { stop, thread: Some(thread) })
    }
}

impl Drop for MockRobot {
    fn drop(&mut self) {
        self.stop.request();
        if let Some(thread) = self.thread.take() {
            // A panic of it was told by the hook.
            drop(thread.join());
        }
    }
}

struct Body {
    plant: Plant,
    ends: [Option<(LoopbackTx, LoopbackRx)>; BUSES],
    serial: Option<UnixStream>,
    scanner: Option<LidarPort>,
    pulse: Arc<Pulse>,
    batch: FrameBatch,
    bytes: Vec<u8>,
}

impl Body {
    fn new(parts: MockParts, world: Box<dyn World>) -> Self {
        let mut plant = Plant::with_world(&parts.config, world);
        plant.start_at(clock::now());
        let ends = parts.ends.map(|end| end.map(Loopback::split));
        let (batch, bytes) = (FrameBatch::default(), Vec::with_capacity(4096));
        let scanner = parts.scanner.map(LidarPort::on_pair);
        Self { plant, ends, serial: parts.serial, scanner, pulse: parts.pulse, batch, bytes }
    }

    fn run(mut self, stop: &Stop) {
        let mut next = clock::now();
        while !stop.is_requested() {
            next = (next + STEP).max(clock::now() - STEP);
            Monotonic.sleep_until(next);
            self.step(clock::now());
        }
    }

    /// Takes what the controller sent, lives up to `now`, hands over what came of it.
    fn step(&mut self, now: Stamp) {
        self.hear();
        self.plant.advance_to(now);
        for (bus, end) in self.ends.iter_mut().enumerate() {
            self.batch.clear();
            self.plant.take_frames(bus, &mut self.batch);
            let Some((tx, _)) = end else { continue };
            // A controller that does not read loses frames, as on any adapter.
            let _lost = self.batch.iter().filter(|frame| tx.send_stamped(*frame).is_err()).count();
        }
        self.bytes.clear();
        self.plant.take_imu_bytes(&mut self.bytes);
        if let Some(serial) = &mut self.serial {
            // A full line drops bytes; the reader resynchronises.
            drop(serial.write(&self.bytes));
        }
        if let (Some(scanner), Some(lidar)) = (&mut self.scanner, self.plant.lidar()) {
            scanner.turn(lidar, now);
        }
        self.pulse.beat(now);
    }

    fn hear(&mut self) {
        for (bus, end) in self.ends.iter_mut().enumerate() {
            while let Some(frame) = end.as_mut().and_then(|(_, rx)| rx.receive()) {
                self.plant.deliver(bus, &frame.frame);
            }
        }
        let mut bytes = [0; 256];
        if let Some(count) = self.serial.as_mut().and_then(|serial| serial.read(&mut bytes).ok()) {
            self.plant.deliver_imu_bytes(&bytes[..count]);
        }
    }
}
