//! The real tick and the simulated robot in step: the clock is a number, nobody waits, every byte goes over the wires.
//!
//! Deterministic to the bit: same configuration, same hash of all that the rooms said. RT: no (but the tick inside is
//! the one of the robot).

use super::lidar::SimLine;
use super::mocap::SimMocap;
use super::outcome::Watch;
use super::plant::Plant;
use super::trouble::outside::Outside;
use super::world::{self, WorldError};
use crate::base::time::{Span, Stamp};
use crate::config::checked::{Config, Lidar, Mocap};
use crate::msg::{
    BUSES, BusHealth, Element, FrameBatch, LidarSample, MocapSample, TerrainState, TickInput, TickRecord, Value,
};
use crate::rt::tick::{Tick, TickError};
use crate::sensor::imu::ImuReader;
use crate::sensor::lidar::{LidarReader, link};
use crate::sensor::mocap::{MocapNews, MocapReader};
use crate::sensor::operator::SimulatedHand;

/// Why there is nothing to step.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LockstepError {
    /// No controller.
    #[error(transparent)]
    Tick(#[from] TickError),
    /// No robot.
    #[error(transparent)]
    World(#[from] WorldError),
}

/// A robot and its controller, stepped together.
pub struct Lockstep {
    tick: Tick,
    plant: Plant,
    imu: ImuReader,
    lidar: Option<LidarHost>,
    mocap: Option<MocapHost>,
    hand: SimulatedHand,
    outside: Outside,
    input: TickInput,
    record: Box<TickRecord>,
    bytes: Vec<u8>,
    period: Span,
    digest: u64,
    watch: Watch,
}

impl Lockstep {
    /// Both switched on at time zero. The operator is the simulated one, whatever the configuration names.
    ///
    /// # Errors
    /// [`LockstepError`] when a room cannot be furnished, or the world not built, as configured.
    pub fn new(config: &Config) -> Result<Self, LockstepError> {
        Ok(Self {
            tick: Tick::new(config)?,
            plant: Plant::with_world(config, world::build(config)?),
            imu: ImuReader::new(&config.robot.imu),
            lidar: config.robot.lidar.as_ref().map(LidarHost::new),
            mocap: config.robot.mocap.as_ref().map(MocapHost::new),
            hand: SimulatedHand::new(config),
            outside: Outside::new(&config.simulation.faults),
            input: TickInput { bus_health: [BusHealth::Active; BUSES], ..TickInput::default() },
            record: Box::default(),
            bytes: Vec::new(),
            period: config.real_time.period,
            digest: FNV_OFFSET,
            watch: Watch::new(config),
        })
    }

    /// The same, with an operator who presses again after a fault.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_rearming_hand(config: &Config) -> Result<Self, LockstepError> {
        Ok(Self { hand: SimulatedHand::new(config).rearming(), ..Self::new(config)? })
    }

    /// Time of the tick to come.
    #[must_use]
    pub const fn now(&self) -> Stamp {
        self.input.now
    }

    /// The robot, to look at or to disturb.
    pub const fn plant(&mut self) -> &mut Plant {
        &mut self.plant
    }

    /// An observer of this robot that has seen nothing yet.
    #[must_use]
    pub fn watch(&self) -> Watch {
        self.watch.clone()
    }

    /// What the last tick said, and the robot as it is.
    #[must_use]
    pub const fn seen(&self) -> (&TickRecord, &Plant) {
        (&self.record, &self.plant)
    }

    /// Hash of what the rooms have said so far.
    #[must_use]
    pub const fn digest(&self) -> u64 {
        self.digest
    }

    /// Poses of motion capture since the call before, for the recording beside the ticks.
    pub fn take_poses(&mut self) -> Vec<MocapSample> {
        self.mocap.as_mut().map(|mocap| std::mem::take(&mut mocap.poses)).unwrap_or_default()
    }

    /// What the reader of motion capture had to tell in the last tick.
    #[must_use]
    pub fn mocap_news(&self) -> Option<MocapNews> {
        self.mocap.as_ref().and_then(|mocap| mocap.news)
    }

    /// The lidar's reader, if there is one.
    #[must_use]
    pub fn lidar_reader(&self) -> Option<&LidarReader> {
        self.lidar.as_ref().map(|host| &host.reader)
    }

    /// One period: the robot moves up to the tick's time, the tick runs, its frames go out.
    pub fn step(&mut self) -> &TickRecord {
        self.outside.come_late(&mut self.input, self.period);
        self.plant.advance_to(self.input.now);
        self.collect();
        self.act()
    }

    /// The same with an input that somebody has tampered with on its way to the tick.
    pub fn step_with(&mut self, tamper: impl FnOnce(&mut TickInput)) -> &TickRecord {
        self.plant.advance_to(self.input.now);
        self.collect();
        self.input.operator = self.hand.poll(self.input.now, &self.record.status);
        let mut input = self.input;
        tamper(&mut input);
        self.walk(&input)
    }

    fn act(&mut self) -> &TickRecord {
        let hand = self.hand.poll(self.input.now, &self.record.status);
        self.input.operator = self.outside.hand(hand);
        let input = self.input;
        self.walk(&input)
    }

    fn walk(&mut self, input: &TickInput) -> &TickRecord {
        self.tick.step(input, &mut self.record);
        for (bus, frames) in self.record.output.send.iter().enumerate() {
            for frame in frames {
                // A full queue before the wire shows as a stalled bus, as on the robot.
                let _accepted = self.plant.deliver(bus, &frame.frame);
            }
        }
        self.digest = digest(self.digest, &self.record);
        self.input.index += 1;
        self.input.now += self.period;
        &self.record
    }

    /// What has arrived since the last tick.
    fn collect(&mut self) {
        let (now, input) = (self.input.now, &mut self.input);
        for (bus, batch) in input.received.iter_mut().enumerate() {
            *batch = FrameBatch { dropped: batch.dropped, ..FrameBatch::default() };
            self.plant.take_frames(bus, batch);
        }
        input.bus_health = self.plant.bus_health();
        input.heard_until = [now; BUSES];
        input.imu_heard_until = now;
        input.imu.count = 0;
        self.bytes.clear();
        self.plant.take_imu_bytes(&mut self.bytes);
        self.imu.receive(now, &self.bytes, &mut input.imu);
        if let Some(request) = self.imu.transmit(now) {
            self.plant.deliver_imu_bytes(request.as_slice());
        }
        self.collect_lidar();
        if let (Some(host), Some(server)) = (&mut self.mocap, self.plant.mocap()) {
            host.serve(now, server);
        }
    }

    /// What the thread of the lidar does on a robot.
    fn collect_lidar(&mut self) {
        let (now, word) = (self.input.now, &mut self.input.lidar);
        *word = LidarSample::default();
        let (Some(host), Some(device)) = (&mut self.lidar, self.plant.lidar()) else { return };
        let mut line = SimLine { device, open: &mut host.open, now, bytes: &mut host.bytes };
        link::serve(&mut host.reader, &mut line, now, |newest| *word = *newest);
    }
}

/// The lidar's reader and the host's end of its line.
struct LidarHost {
    reader: LidarReader,
    open: bool,
    bytes: Vec<u8>,
}

impl LidarHost {
    fn new(lidar: &Lidar) -> Self {
        Self { reader: LidarReader::new(lidar), open: false, bytes: Vec::new() }
    }
}

/// The reader of motion capture and what it has read.
struct MocapHost {
    reader: MocapReader,
    next_word: Stamp,
    poses: Vec<MocapSample>,
    news: Option<MocapNews>,
}

/// Nobody who does not take them wants to keep more poses.
const MOST_POSES: usize = 1024;
/// Between two words to the server.
const SPEAK_EVERY: Span = Span::from_ms(1000);

impl MocapHost {
    fn new(mocap: &Mocap) -> Self {
        Self { reader: MocapReader::new(mocap), next_word: Stamp::NEVER, poses: Vec::new(), news: None }
    }

    fn serve(&mut self, now: Stamp, server: &mut SimMocap) {
        self.news = None;
        let due = self.reader.takes_question() || now >= self.next_word;
        if let Some(request) = self.reader.request().filter(|_| due) {
            self.next_word = now + SPEAK_EVERY;
            server.hear(now, request);
        }
        while let Some(datagram) = server.take(now) {
            let pose = self.reader.take(now, &datagram);
            self.poses.extend(pose.filter(|_| self.poses.len() < MOST_POSES));
            self.news = self.reader.news(now).or(self.news);
        }
        self.news = self.reader.news(now).or(self.news);
    }
}

const FNV_OFFSET: u64 = 0xCBF2_9CE4_8422_2325;
const FNV_PRIME: u64 = 0x0000_0100_0000_01B3;

/// FNV-1a over the words of what the rooms said. The frames are left out: what they carry is in the drives' commands.
fn digest(seed: u64, record: &TickRecord) -> u64 {
    let mut hash = seed;
    let mut sink = |value: Value| hash = (hash ^ word(value)).wrapping_mul(FNV_PRIME);
    record.feedback.put(&mut sink);
    record.snapshot.put(&mut sink);
    if record.terrain.state != TerrainState::Off {
        record.terrain.put(&mut sink);
    }
    record.estimate.put(&mut sink);
    record.control.put(&mut sink);
    record.allowed.put(&mut sink);
    record.drives.put(&mut sink);
    record.status.put(&mut sink);
    hash
}

const fn word(value: Value) -> u64 {
    match value {
        Value::Bool(v) => v as u64,
        Value::U8(v) => v as u64,
        Value::U16(v) => v as u64,
        Value::U32(v) => v as u64,
        Value::U64(v) => v,
        Value::I16(v) => v.cast_unsigned() as u64,
        Value::I32(v) => v.cast_unsigned() as u64,
        Value::I64(v) => v.cast_unsigned(),
        Value::F64(v) => v.to_bits(),
    }
}

#[cfg(test)]
#[path = "lockstep_tests.rs"]
mod tests;

#[cfg(test)]
#[path = "example_tests.rs"]
mod example_tests;
