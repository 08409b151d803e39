//! The IMU: gets its stream going, turns bytes into samples, and starts over when it falls silent. Two protocols, one
//! promise: `gx3` (single bytes) and `mip` (packets); `stream` is what both have in common.
//!
//! A sample's stamp is the device's clock mapped to ours, less the time that the message takes on the line. What the
//! device itself needs from measuring to sending cannot be seen from here and is in the stamp.
//! RT: yes, no allocation.

mod gx3;
mod mip;
mod stream;

use super::imu_codec::RequestBytes;
use crate::base::bytes::Short;
use crate::base::time::{Span, Stamp};
use crate::config::checked::{Imu, ImuProtocol};
use crate::msg::ImuBatch;
use gx3::Gx3;
use mip::Mip;

pub use mip::DATA_BYTES as MIP_DATA_BYTES;

/// After the stop request whatever still comes is thrown away for so long.
const DRAIN: Span = Span::from_ms(100);
/// A request that is not answered in this time starts the sequence over.
const ANSWER_TIMEOUT: Span = Span::from_ms(300);
/// A stream without a message for so long is dead.
const SILENCE: Span = Span::from_ms(500);

/// What went wrong or was seen since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ImuCounters {
    /// Times that the sequence began.
    pub starts: u32,
    /// Messages missing by the device's timer.
    pub missing: u32,
    /// Samples with a number that is not finite.
    pub not_finite: u32,
    /// Samples thrown away because newer ones came in the same turn.
    pub overtaken: u32,
    /// Times that the device kept other settings than asked for.
    pub refused: u32,
}

/// Time of so many bytes on the line.
fn line_time(bytes: usize, baud: u32) -> Span {
    Span(10 * 1_000_000_000 * i64::try_from(bytes).unwrap_or(0) / i64::from(baud.max(1)))
}

/// Reads one IMU.
#[derive(Clone, Debug)]
pub struct ImuReader(Talk);

#[derive(Clone, Debug)]
enum Talk {
    Gx3(Gx3),
    Mip(Mip),
}

/// The same question to whichever it is.
macro_rules! ask {
    ($self:ident, $talk:ident => $answer:expr) => {
        match &$self.0 {
            Talk::Gx3($talk) => $answer,
            Talk::Mip($talk) => $answer,
        }
    };
}

impl ImuReader {
    /// For the configured message and rate; the sequence starts with the first [`Self::transmit`].
    #[must_use]
    pub fn new(imu: &Imu) -> Self {
        Self(match imu.protocol {
            ImuProtocol::Gx3 => Talk::Gx3(Gx3::new(imu)),
            ImuProtocol::Mip => Talk::Mip(Mip::new(imu)),
        })
    }

    /// The request that is due now, if any. To be called every few milliseconds.
    pub fn transmit(&mut self, now: Stamp) -> Option<RequestBytes> {
        match &mut self.0 {
            Talk::Gx3(talk) => talk.transmit(now),
            Talk::Mip(talk) => talk.transmit(now).map(|request| Short::new(request.as_slice())),
        }
    }

    /// Takes bytes that arrived at `now`; adds the samples in them to the batch.
    pub fn receive(&mut self, now: Stamp, bytes: &[u8], batch: &mut ImuBatch) {
        match &mut self.0 {
            Talk::Gx3(talk) => talk.receive(now, bytes, batch),
            Talk::Mip(talk) => talk.receive(now, bytes, batch),
        }
        batch.dropped = batch.dropped.max(self.lost());
    }

    /// Messages lost since the start: damaged, missing or not finite.
    #[must_use]
    pub fn lost(&self) -> u32 {
        ask!(self, talk => talk.lost())
    }

    /// True while samples come.
    #[must_use]
    pub fn is_streaming(&self) -> bool {
        ask!(self, talk => talk.is_streaming())
    }

    /// The model's name as the device tells it; zero bytes before.
    #[must_use]
    pub fn model(&self) -> &[u8; 16] {
        ask!(self, talk => talk.model())
    }

    /// What went wrong or was seen since the start.
    #[must_use]
    pub fn counters(&self) -> &ImuCounters {
        ask!(self, talk => talk.counters())
    }
}

#[cfg(test)]
mod tests;
