//! The streams of a recording, and the way from a tick to their messages and back. RT: no.
//!
//! A tick becomes: its head with all counts, then one message per frame and sample, then what each room said, `status`
//! last. What the lidar and the terrain say is there only if there is a lidar. So a tick is whole exactly when its status is
//! there, and everything that [`crate::msg::TickInput`] holds comes back.

use super::cdr::{decode, encode};
use crate::base::time::Stamp;
use crate::msg::{
    BUSES, BusFrame, ControlState, DriveCommands, DriveFeedbacks, Element, Estimate, FrameBatch, ImuBatch, ImuSample,
    JointCommand, LidarSample, LidarState, MocapSample, OperatorSample, RecorderStatus, Shape, Snapshot, Status,
    Terrain, TerrainState, TickHead, TickRecord,
};

/// A stream of messages of one type.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[expect(missing_docs, reason = "named as in the recording; the message says what it is")]
pub enum Stream {
    Tick,
    Bus0Rx,
    Bus1Rx,
    Imu,
    Lidar,
    Operator,
    Feedback,
    Snapshot,
    Terrain,
    Estimate,
    Control,
    Wanted,
    Allowed,
    Drives,
    Bus0Tx,
    Bus1Tx,
    Status,
    Recorder,
    Mocap,
}

impl Stream {
    /// All of them; the index is the order within a tick.
    pub const ALL: [Self; 19] = [
        Self::Tick,
        Self::Bus0Rx,
        Self::Bus1Rx,
        Self::Imu,
        Self::Lidar,
        Self::Operator,
        Self::Feedback,
        Self::Snapshot,
        Self::Terrain,
        Self::Estimate,
        Self::Control,
        Self::Wanted,
        Self::Allowed,
        Self::Drives,
        Self::Bus0Tx,
        Self::Bus1Tx,
        Self::Status,
        Self::Recorder,
        Self::Mocap,
    ];

    /// Frames received, by bus.
    pub const RX: [Self; BUSES] = [Self::Bus0Rx, Self::Bus1Rx];
    /// Frames sent, by bus.
    pub const TX: [Self; BUSES] = [Self::Bus0Tx, Self::Bus1Tx];

    /// Topic in the file.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tick => "tick",
            Self::Bus0Rx => "bus0/rx",
            Self::Bus1Rx => "bus1/rx",
            Self::Imu => "imu",
            Self::Lidar => "lidar",
            Self::Operator => "operator",
            Self::Feedback => "feedback",
            Self::Snapshot => "snapshot",
            Self::Terrain => "terrain",
            Self::Estimate => "estimate",
            Self::Control => "control",
            Self::Wanted => "wanted",
            Self::Allowed => "allowed",
            Self::Drives => "drives",
            Self::Bus0Tx => "bus0/tx",
            Self::Bus1Tx => "bus1/tx",
            Self::Status => "status",
            Self::Recorder => "recorder",
            Self::Mocap => "mocap",
        }
    }

    /// What its messages are made of.
    #[must_use]
    pub const fn shape(self) -> &'static Shape {
        match self {
            Self::Tick => &TickHead::SHAPE,
            Self::Bus0Rx | Self::Bus1Rx | Self::Bus0Tx | Self::Bus1Tx => &BusFrame::SHAPE,
            Self::Imu => &ImuSample::SHAPE,
            Self::Lidar => &LidarSample::SHAPE,
            Self::Operator => &OperatorSample::SHAPE,
            Self::Feedback => &DriveFeedbacks::SHAPE,
            Self::Snapshot => &Snapshot::SHAPE,
            Self::Terrain => &Terrain::SHAPE,
            Self::Estimate => &Estimate::SHAPE,
            Self::Control => &ControlState::SHAPE,
            Self::Wanted | Self::Allowed => &JointCommand::SHAPE,
            Self::Drives => &DriveCommands::SHAPE,
            Self::Status => &Status::SHAPE,
            Self::Recorder => &RecorderStatus::SHAPE,
            Self::Mocap => &MocapSample::SHAPE,
        }
    }

    /// True for what does not travel with ticks: it stands beside them in a recording.
    #[must_use]
    pub const fn is_beside(self) -> bool {
        matches!(self, Self::Recorder | Self::Mocap)
    }

    /// True for what a tick works out itself; the rest is its input.
    #[must_use]
    pub const fn is_output(self) -> bool {
        let is_input =
            matches!(self, Self::Tick | Self::Bus0Rx | Self::Bus1Rx | Self::Imu | Self::Lidar | Self::Operator);
        !is_input && !self.is_beside()
    }
}

/// The head of a tick: everything but the batches.
fn head(record: &TickRecord) -> TickHead {
    let input = &record.input;
    TickHead {
        index: input.index,
        now: input.now,
        wake_latency: input.wake_latency,
        step_time: input.step_time,
        skipped: input.skipped,
        real_time_missing: input.real_time_missing,
        stop_requested: input.stop_requested,
        unsent: input.unsent,
        bus_health: input.bus_health,
        heard_until: input.heard_until,
        imu_heard_until: input.imu_heard_until,
        received: input.received.each_ref().map(|b| b.count),
        received_dropped: input.received.each_ref().map(|b| b.dropped),
        sent: record.output.send.each_ref().map(|b| b.count),
        sent_dropped: record.output.send.each_ref().map(|b| b.dropped),
        imu: input.imu.count,
        imu_dropped: input.imu.dropped,
    }
}

/// Takes a tick apart: hands over stream, time of validity and encoded message, in order. `buffer` saves allocations.
///
/// # Errors
/// The first error of `sink`; nothing is handed over after it.
pub fn explode<E>(
    record: &TickRecord,
    buffer: &mut Vec<u8>,
    mut sink: impl FnMut(Stream, Stamp, &[u8]) -> Result<(), E>,
) -> Result<(), E> {
    let now = record.input.now;
    let mut out = Sink { buffer, now, sink: &mut sink };
    out.put(Stream::Tick, now, &head(record))?;
    for (stream, batch) in Stream::RX.into_iter().zip(&record.input.received) {
        out.frames(stream, batch)?;
    }
    for sample in record.input.imu.as_slice() {
        out.put(Stream::Imu, sample.stamp, sample)?;
    }
    if record.input.lidar.state != LidarState::Nothing {
        out.put(Stream::Lidar, record.input.lidar.stamp, &record.input.lidar)?;
    }
    out.put(Stream::Operator, record.input.operator.stamp, &record.input.operator)?;
    out.put(Stream::Feedback, now, &record.feedback)?;
    out.put(Stream::Snapshot, record.snapshot.stamp, &record.snapshot)?;
    if record.terrain.state != TerrainState::Off {
        out.put(Stream::Terrain, record.terrain.stamp, &record.terrain)?;
    }
    out.put(Stream::Estimate, record.estimate.stamp, &record.estimate)?;
    out.put(Stream::Control, record.control.stamp, &record.control)?;
    out.put(Stream::Wanted, record.wanted.stamp, &record.wanted)?;
    out.put(Stream::Allowed, record.allowed.stamp, &record.allowed)?;
    out.put(Stream::Drives, record.drives.stamp, &record.drives)?;
    for (stream, batch) in Stream::TX.into_iter().zip(&record.output.send) {
        out.frames(stream, batch)?;
    }
    out.put(Stream::Status, now, &record.status)
}

struct Sink<'a, F> {
    buffer: &'a mut Vec<u8>,
    now: Stamp,
    sink: &'a mut F,
}

impl<E, F: FnMut(Stream, Stamp, &[u8]) -> Result<(), E>> Sink<'_, F> {
    fn put(&mut self, stream: Stream, stamp: Stamp, message: &impl Element) -> Result<(), E> {
        encode(message, self.buffer);
        // A message that says nothing yet (stamp 0 or never) is put where the tick is.
        let valid_at = if stamp > Stamp(0) { stamp } else { self.now };
        (self.sink)(stream, valid_at, self.buffer)
    }

    fn frames(&mut self, stream: Stream, batch: &FrameBatch) -> Result<(), E> {
        batch.iter().try_for_each(|frame| self.put(stream, frame.stamp, &frame))
    }
}

/// Puts ticks together again from their messages.
#[derive(Default)]
pub struct Assembly {
    record: TickRecord,
    head: Option<TickHead>,
    seen: u32,
}

/// What a message did to the assembly.
#[derive(Debug, PartialEq)]
pub enum Assembled {
    /// Not whole yet.
    Pending,
    /// This was the last message of a tick.
    Tick(Box<TickRecord>),
    /// It does not fit: bytes of another message, or parts of the tick are missing.
    Broken,
}

impl Assembly {
    /// True between the head and the last message of a tick.
    #[must_use]
    pub const fn is_open(&self) -> bool {
        self.head.is_some()
    }

    /// Takes the next message.
    pub fn take(&mut self, stream: Stream, bytes: &[u8]) -> Assembled {
        if stream.is_beside() {
            return Assembled::Pending;
        }
        if stream == Stream::Tick {
            *self = Self { head: decode(bytes), ..Self::default() };
            return if self.is_open() { Assembled::Pending } else { Assembled::Broken };
        }
        if self.head.is_none() || self.fill(stream, bytes).is_none() {
            self.head = None;
            return Assembled::Broken;
        }
        self.seen |= 1 << stream as u32;
        if stream == Stream::Status { self.close() } else { Assembled::Pending }
    }

    fn fill(&mut self, stream: Stream, bytes: &[u8]) -> Option<()> {
        let record = &mut self.record;
        match stream {
            Stream::Bus0Rx => record.input.received[0].push(decode(bytes)?).then_some(())?,
            Stream::Bus1Rx => record.input.received[1].push(decode(bytes)?).then_some(())?,
            Stream::Bus0Tx => record.output.send[0].push(decode(bytes)?).then_some(())?,
            Stream::Bus1Tx => record.output.send[1].push(decode(bytes)?).then_some(())?,
            Stream::Imu => record.input.imu.push(decode(bytes)?).then_some(())?,
            Stream::Lidar => record.input.lidar = decode(bytes)?,
            Stream::Operator => record.input.operator = decode(bytes)?,
            Stream::Feedback => record.feedback = decode(bytes)?,
            Stream::Snapshot => record.snapshot = decode(bytes)?,
            Stream::Terrain => record.terrain = decode(bytes)?,
            Stream::Estimate => record.estimate = decode(bytes)?,
            Stream::Control => record.control = decode(bytes)?,
            Stream::Wanted => record.wanted = decode(bytes)?,
            Stream::Allowed => record.allowed = decode(bytes)?,
            Stream::Drives => record.drives = decode(bytes)?,
            Stream::Status => record.status = decode(bytes)?,
            Stream::Tick | Stream::Recorder | Stream::Mocap => {}
        }
        Some(())
    }

    /// Checks that nothing is missing and hands the tick over.
    fn close(&mut self) -> Assembled {
        const ONCE: u32 = 1 << Stream::Operator as u32
            | 1 << Stream::Feedback as u32
            | 1 << Stream::Snapshot as u32
            | 1 << Stream::Estimate as u32
            | 1 << Stream::Control as u32
            | 1 << Stream::Wanted as u32
            | 1 << Stream::Allowed as u32
            | 1 << Stream::Drives as u32
            | 1 << Stream::Status as u32;
        let Some(head) = self.head.take() else { return Assembled::Broken };
        let mut record = self.record;
        let whole = self.seen & ONCE == ONCE
            && record.input.received.each_ref().map(|b| b.count) == head.received
            && record.output.send.each_ref().map(|b| b.count) == head.sent
            && record.input.imu.count == head.imu
            // The terrain says in every tick whether there was a word of the lidar.
            && record.terrain.heard == (record.input.lidar.state != LidarState::Nothing);
        if !whole {
            return Assembled::Broken;
        }
        unfold(&head, &mut record);
        Assembled::Tick(Box::new(record))
    }
}

/// Puts the head's values where they were.
fn unfold(head: &TickHead, record: &mut TickRecord) {
    let input = &mut record.input;
    input.index = head.index;
    input.now = head.now;
    input.wake_latency = head.wake_latency;
    input.step_time = head.step_time;
    input.skipped = head.skipped;
    input.real_time_missing = head.real_time_missing;
    input.stop_requested = head.stop_requested;
    input.unsent = head.unsent;
    input.bus_health = head.bus_health;
    input.heard_until = head.heard_until;
    input.imu_heard_until = head.imu_heard_until;
    let set = |batch: &mut FrameBatch, dropped: &u32| batch.dropped = *dropped;
    input.received.iter_mut().zip(&head.received_dropped).for_each(|(b, d)| set(b, d));
    record.output.send.iter_mut().zip(&head.sent_dropped).for_each(|(b, d)| set(b, d));
    record.input.imu = ImuBatch { dropped: head.imu_dropped, ..record.input.imu };
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::msg::{CanFrame, Kind, MAX_FRAMES, MAX_IMU, Value};
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use std::convert::Infallible;

    /// A tick of random bits (NaN and infinities too), with batches of random fill.
    pub(crate) fn random_record(seed: u64) -> TickRecord {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut source = |kind: Kind| {
            let bits = rng.next_u64();
            Some(match kind {
                Kind::Bool => Value::Bool(bits & 1 == 1),
                // Small, so that enumerations and counts are valid.
                Kind::U8 | Kind::Enum(_) => Value::U8((bits & 1) as u8),
                Kind::U16 => Value::U16(bits as u16),
                Kind::U32 => Value::U32(bits as u32),
                Kind::U64 => Value::U64(bits),
                Kind::I16 => Value::I16(bits as i16),
                Kind::I32 => Value::I32(bits as i32),
                Kind::I64 => Value::I64(bits as i64),
                Kind::F64 => Value::F64(f64::from_bits(bits)),
                Kind::Bytes(_) | Kind::Array(..) | Kind::Struct(_) => return None,
            })
        };
        let mut record = TickRecord::take(&mut source).unwrap();
        let mut batches = record.input.received.iter_mut().chain(&mut record.output.send);
        batches.all(|batch| fill(batch, &mut rng));
        record.input.imu.count = (rng.next_u64() % (MAX_IMU as u64 + 1)) as u8;
        let count = usize::from(record.input.imu.count);
        record.input.imu.samples[count..].fill(ImuSample::default());
        // Every other robot has a lidar, which speaks in every other tick.
        let (has_lidar, speaks) = (seed % 2 == 1, seed % 4 == 3);
        if has_lidar {
            record.terrain.state = TerrainState::Following;
        } else {
            record.terrain = Terrain::default();
        }
        record.terrain.heard = speaks;
        record.input.lidar = if speaks { record.input.lidar } else { LidarSample::default() };
        record.input.lidar.state = if speaks { LidarState::Streaming } else { LidarState::Nothing };
        record
    }

    /// Classic and CAN-FD frames, as many as are drawn or fit.
    fn fill(batch: &mut FrameBatch, rng: &mut ChaCha8Rng) -> bool {
        *batch = FrameBatch::default();
        for _ in 0..rng.next_u64() % (MAX_FRAMES as u64 + 1) {
            let (id, bytes) = (rng.next_u64(), rng.next_u64().to_le_bytes());
            let frame = match id % 4 {
                0 => CanFrame::fd(id as u32, &bytes.repeat(8)[..(id >> 32) as usize % 65], 0x50),
                _ => CanFrame::new(id as u16, &bytes[..(id >> 32) as usize % 9]),
            };
            let item = BusFrame { stamp: Stamp(rng.next_u64().cast_signed()), frame, own: id % 3 == 0 };
            if !batch.has_room(&frame) {
                break;
            }
            batch.push(item);
        }
        true
    }

    fn bytes_of(message: &impl Element) -> Vec<u8> {
        let mut bytes = Vec::new();
        encode(message, &mut bytes);
        bytes
    }

    fn messages(record: &TickRecord) -> Vec<(Stream, Vec<u8>)> {
        let mut out = Vec::new();
        let Ok(()) = explode(record, &mut Vec::new(), |stream, _, bytes| {
            out.push((stream, bytes.to_vec()));
            Ok::<(), Infallible>(())
        });
        out
    }

    #[test]
    fn any_tick_comes_back_bit_by_bit() {
        for seed in 0..200 {
            let record = random_record(seed);
            let mut assembly = Assembly::default();
            let mut back = Vec::new();
            for (stream, bytes) in messages(&record) {
                match assembly.take(stream, &bytes) {
                    Assembled::Tick(tick) => back.push(tick),
                    other => assert_eq!(other, Assembled::Pending),
                }
            }
            assert_eq!(back.len(), 1);
            assert_eq!(bytes_of(&*back[0]), bytes_of(&record), "seed {seed}");
        }
    }

    #[test]
    fn tick_with_any_message_missing_is_broken_not_wrong() {
        let all = messages(&random_record(7));
        for missing in 0..all.len() {
            let mut assembly = Assembly::default();
            let rest = all.iter().enumerate().filter(|(i, _)| *i != missing).map(|(_, m)| m);
            for (stream, bytes) in rest {
                assert!(!matches!(assembly.take(*stream, bytes), Assembled::Tick(_)), "without message {missing}");
            }
        }
    }

    #[test]
    fn stream_order_is_its_number() {
        for (i, stream) in Stream::ALL.into_iter().enumerate() {
            assert_eq!(stream as usize, i);
        }
    }
}
