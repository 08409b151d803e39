//! The recorder beside the bare `mcap` crate: the same messages to the same disk, in turn.
//!
//! Ours takes ticks: queue, thread, encoding, a sync every half second. The bare crate gets the finished bytes of the same
//! messages, one loop and one sync at the end: the most that any recorder of this format could reach. RT: no.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufWriter};
use std::path::Path;
use std::time::{Duration, Instant};

use mcap::records::MessageHeader;
use mcap::{McapError, WriteOptions, Writer};

use super::window::{Paired, Window};
use crate::config::Resolved;
use crate::msg::TickRecord;
use crate::record::{ReadError, Reader, RecordError, Recorder};
use crate::sim::lockstep::{Lockstep, LockstepError};

/// Pause while the recorder's queue is full.
const PAUSE: Duration = Duration::from_micros(200);

/// The recorder could not be measured.
#[derive(Debug, thiserror::Error)]
pub enum LoggingError {
    /// No ticks to record.
    #[error(transparent)]
    Lockstep(#[from] LockstepError),
    /// No recording.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// The recording cannot be read back.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The bare crate failed.
    #[error(transparent)]
    Mcap(#[from] McapError),
    /// The disk.
    #[error(transparent)]
    Disk(#[from] io::Error),
    /// The recorder lost ticks although it was waited for.
    #[error("{0} ticks were lost")]
    Lost(u64),
}

/// A message as it stands in the file.
struct Raw {
    header: MessageHeader,
    bytes: Vec<u8>,
}

/// Time per tick in each of `windows` windows of `ticks` ticks, us: one sample a window. `folder` must exist.
///
/// # Errors
/// [`LoggingError`].
pub fn compare(resolved: &Resolved, folder: &Path, windows: usize, ticks: usize) -> Result<Paired, LoggingError> {
    let mut run = Lockstep::new(&resolved.config)?;
    let records: Vec<TickRecord> = (0..ticks).map(|_| *run.step()).collect();
    let mut pair = Paired::default();
    for _ in 0..windows {
        let (ours, messages) = recorder(resolved, folder, &records)?;
        let theirs = bare(folder, &messages)?;
        for (time, side) in [(ours, &mut pair.ours), (theirs, &mut pair.theirs)] {
            side.push(Window::new(vec![time.as_secs_f64() * 1e6 / ticks as f64]));
        }
    }
    Ok(pair)
}

/// Records all ticks as fast as the recorder takes them; the time until they are safe, and what stands in the file.
fn recorder(resolved: &Resolved, folder: &Path, records: &[TickRecord]) -> Result<(Duration, Vec<Raw>), LoggingError> {
    let recorder = Recorder::start(folder, resolved)?;
    let path = recorder.path();
    let start = Instant::now();
    for record in records {
        while !recorder.has_room() {
            std::thread::sleep(PAUSE);
        }
        recorder.push(record);
    }
    let status = recorder.finish();
    let took = start.elapsed();
    if status.dropped > 0 {
        return Err(LoggingError::Lost(status.dropped));
    }
    let mut messages = Vec::new();
    Reader::open(&path)?.messages(|m| {
        let header = MessageHeader {
            channel_id: m.stream as u16,
            sequence: m.sequence,
            log_time: m.log_time_ns,
            publish_time: m.log_time_ns,
        };
        messages.push(Raw { header, bytes: m.bytes.to_vec() });
        None::<()>
    })?;
    fs::remove_file(path)?;
    Ok((took, messages))
}

/// Writes the same messages with the crate alone.
fn bare(folder: &Path, messages: &[Raw]) -> Result<Duration, LoggingError> {
    let path = folder.join("bare.mcap");
    let start = Instant::now();
    let options = WriteOptions::new().compression(None);
    let mut writer = Writer::with_options(BufWriter::new(File::create(&path)?), options)?;
    let mut channels = BTreeMap::new();
    for message in messages {
        let number = message.header.channel_id;
        let channel_id = match channels.get(&number) {
            Some(id) => *id,
            None => {
                let id = writer.add_channel(0, &format!("channel{number}"), "cdr", &BTreeMap::new())?;
                channels.insert(number, id);
                id
            }
        };
        writer.write_to_known_channel(&MessageHeader { channel_id, ..message.header }, &message.bytes)?;
    }
    writer.finish()?;
    writer.into_inner().into_inner().map_err(io::IntoInnerError::into_error)?.sync_data()?;
    let took = start.elapsed();
    fs::remove_file(path)?;
    Ok(took)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_write_every_message_and_leave_nothing_behind() {
        let resolved = crate::config::load(None, &[]).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let pair = compare(&resolved, folder.path(), 2, 300).unwrap();
        assert_eq!(pair.ours.iter().chain(&pair.theirs).map(Window::len).sum::<usize>(), 4);
        assert!(pair.ratio(50.0) > 0.0);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
