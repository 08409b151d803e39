//! One recording file being written. RT: no.

use super::cdr::encode;
use super::schema;
use super::storage::{Sink, Storage};
use super::stream::{Stream, explode};
use crate::base::time::Stamp;
use crate::config::Resolved;
use crate::msg::{Element, MocapSample, RecorderStatus, TickRecord};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, McapError, WriteOptions, Writer};
use sha2::{Digest, Sha256};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{SystemTime, UNIX_EPOCH};

/// Name of the attachment with the resolved configuration.
pub const CONFIG: &str = "config.toml";
/// Name of the metadata about the program and its configuration.
pub const PROGRAM: &str = "compass";
/// Name of the metadata that ties tick time to the calendar.
pub const CLOCK: &str = "clock";

/// A chunk is closed at this size: half a second at 1 kHz. Larger ones leave the cache before they are written.
const CHUNK_BYTES: u64 = 1 << 20;

/// What stands at the head of each file.
#[derive(Clone, Debug)]
pub struct Identity {
    config_text: String,
    config_hash: String,
    binary_hash: String,
}

impl Identity {
    /// Of this process with this configuration.
    #[must_use]
    pub fn new(resolved: &Resolved) -> Self {
        Self {
            config_text: resolved.text.clone(),
            config_hash: resolved.hash.clone(),
            binary_hash: binary_hash().to_owned(),
        }
    }
}

/// SHA-256 of the running executable: the version number alone does not tell two builds apart.
#[must_use]
pub fn binary_hash() -> &'static str {
    static HASH: OnceLock<String> = OnceLock::new();
    HASH.get_or_init(|| {
        // Not by its path: a newer build may stand there by now.
        let Ok(bytes) = fs::read("/proc/self/exe") else { return "unknown".into() };
        let mut hex = String::new();
        Sha256::digest(bytes).iter().for_each(|byte| write!(hex, "{byte:02x}").unwrap_or_default());
        hex
    })
}

/// An open file.
pub struct LogFile {
    writer: Writer<Sink>,
    channels: [u16; Stream::ALL.len()],
    buffer: Vec<u8>,
    sequence: u32,
    clock_written: bool,
    safe: Arc<AtomicU64>,
}

impl LogFile {
    /// Writes magic, configuration, metadata, schemas and channels.
    ///
    /// # Errors
    /// When the disk does not take it.
    pub fn create(storage: Box<dyn Storage>, identity: &Identity) -> Result<Self, McapError> {
        // Chunks are put together in memory and reach the file whole: at a flush, or when they outgrow the cache. No
        // compression: noise does not shrink, and the reader can go into the torn last chunk of a file.
        let options = WriteOptions::new()
            .profile("ros2")
            .library(concat!("compass ", env!("CARGO_PKG_VERSION")))
            .compression(None)
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true);
        let sink = Sink::new(storage);
        let safe = sink.safe();
        let mut writer = Writer::with_options(sink, options)?;
        write_identity(&mut writer, identity)?;
        let channels = add_channels(&mut writer)?;
        Ok(Self { writer, channels, buffer: Vec::new(), sequence: 0, clock_written: false, safe })
    }

    /// Adds a tick to the present chunk.
    ///
    /// # Errors
    /// When the disk does not take it; the file is then to be abandoned.
    pub fn write(&mut self, record: &TickRecord) -> Result<(), McapError> {
        if !self.clock_written {
            self.write_clock(record.input.now)?;
        }
        // The low bits are enough to see the order; the head holds all of them.
        self.sequence = record.input.index as u32;
        let now = record.input.now;
        let (writer, channels, sequence) = (&mut self.writer, &self.channels, self.sequence);
        explode(record, &mut self.buffer, |stream, stamp, bytes| {
            let channel_id = channels[stream as usize];
            let (log_time, publish_time) = (nanoseconds(stamp), nanoseconds(now));
            writer.write_to_known_channel(&MessageHeader { channel_id, sequence, log_time, publish_time }, bytes)
        })
    }

    /// Adds the recorder's own state.
    ///
    /// # Errors
    /// As for [`Self::write`].
    pub fn write_status(&mut self, status: &RecorderStatus) -> Result<(), McapError> {
        self.write_beside(Stream::Recorder, status.stamp, status)
    }

    /// Adds a pose of motion capture.
    ///
    /// # Errors
    /// As for [`Self::write`].
    pub fn write_pose(&mut self, pose: &MocapSample) -> Result<(), McapError> {
        self.write_beside(Stream::Mocap, pose.stamp, pose)
    }

    /// Adds what does not belong to a tick.
    fn write_beside(&mut self, stream: Stream, valid_at: Stamp, message: &impl Element) -> Result<(), McapError> {
        encode(message, &mut self.buffer);
        let log_time = nanoseconds(valid_at);
        let channel_id = self.channels[stream as usize];
        let header = MessageHeader { channel_id, sequence: self.sequence, log_time, publish_time: log_time };
        self.writer.write_to_known_channel(&header, &self.buffer)
    }

    /// Bytes that survive a power cut.
    #[must_use]
    pub fn safe_bytes(&self) -> u64 {
        self.safe.load(Ordering::Relaxed)
    }

    /// Closes the chunk and waits until it survives a power cut.
    ///
    /// # Errors
    /// As for [`Self::write`].
    pub fn flush(&mut self) -> Result<(), McapError> {
        self.writer.flush()
    }

    /// Writes summary and footer, and waits until all survives a power cut. A torn end is cut off.
    ///
    /// # Errors
    /// As for [`Self::write`].
    pub fn finish(mut self) -> Result<u64, McapError> {
        let result = self.writer.finish();
        let mut sink = self.writer.into_inner();
        match result.and_then(|_| Ok(sink.flush()?)) {
            Ok(()) => Ok(self.safe.load(Ordering::Relaxed)),
            Err(error) => {
                sink.abandon();
                Err(error)
            }
        }
    }

    /// Gives up after an error: cuts the torn end off. Returns the bytes that are safe.
    pub fn abandon(self) -> u64 {
        self.writer.into_inner().abandon()
    }

    /// Ties the time of the first tick to the calendar, as far as a queue's delay allows (milliseconds).
    fn write_clock(&mut self, now: Stamp) -> Result<(), McapError> {
        let unix_ns = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_nanos());
        let entries = [("tick_ns", now.0.to_string()), ("unix_ns", unix_ns.to_string())];
        self.writer.write_metadata(&metadata(CLOCK, &entries))?;
        self.clock_written = true;
        Ok(())
    }
}

/// MCAP counts from 0; times before that do not occur but in tests.
fn nanoseconds(stamp: Stamp) -> u64 {
    u64::try_from(stamp.0).unwrap_or(0)
}

fn metadata(name: &str, entries: &[(&str, String)]) -> Metadata {
    let metadata = entries.iter().map(|(key, value)| ((*key).to_owned(), value.clone())).collect();
    Metadata { name: name.to_owned(), metadata }
}

fn write_identity(writer: &mut Writer<Sink>, identity: &Identity) -> Result<(), McapError> {
    let entries = [
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("config_sha256", identity.config_hash.clone()),
        ("binary_sha256", identity.binary_hash.clone()),
    ];
    writer.write_metadata(&metadata(PROGRAM, &entries))?;
    writer.attach(&Attachment {
        log_time: 0,
        create_time: 0,
        name: CONFIG.into(),
        media_type: "application/toml".into(),
        data: Cow::Borrowed(identity.config_text.as_bytes()),
    })
}

fn add_channels(writer: &mut Writer<Sink>) -> Result<[u16; Stream::ALL.len()], McapError> {
    let mut channels = [0; Stream::ALL.len()];
    for (slot, stream) in channels.iter_mut().zip(Stream::ALL) {
        let shape = stream.shape();
        let schema = writer.add_schema(&schema::name(shape), "ros2msg", schema::ros2msg(shape).as_bytes())?;
        *slot = writer.add_channel(schema, stream.name(), "cdr", &BTreeMap::new())?;
    }
    Ok(channels)
}
