//! A device that speaks MIP: gets its stream going, turns packets into samples, and starts over when it falls silent.
//!
//! ```text
//!   Idle ─100 ms of silence→ Info → BaseRate → Format → Stream → Streaming
//!    ↑                         │ 300 ms without its acknowledge     │ 500 ms without data
//!    └─────────────────────────┴────────────────────────────────────┘
//! ```
//! RT: yes, no allocation.

use super::stream::Stream;
use super::{ANSWER_TIMEOUT, DRAIN, ImuCounters, SILENCE, line_time};
use crate::base::bytes::{BigEndian, padded};
use crate::base::time::Stamp;
use crate::config::checked::{Imu, ImuMessage};
use crate::msg::{ImuBatch, ImuSample};
use crate::sensor::mip::{Command, Measurement, Packet, Parser, Request, field};

/// Our ticks of the device's time of week: microseconds, which wrap after 71 minutes.
const TICKS_PER_S: u32 = 1_000_000;
/// A data packet: head, three fields of 14 bytes, check.
pub const DATA_BYTES: usize = 4 + 3 * 14 + 2;
/// Answer to [`Command::Info`]: firmware and five names of 16 characters.
const INFO: u8 = 0x81;
/// Answer to [`Command::BaseRate`].
const BASE_RATE: u8 = 0x83;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// This command is due, or was sent and is not acknowledged.
    Ask(Step, Option<Stamp>),
    Streaming {
        heard: Stamp,
    },
}

/// The commands in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Idle,
    Info,
    BaseRate,
    Format,
    Stream,
}

/// Reads one.
#[derive(Clone, Debug)]
pub(super) struct Mip {
    message: ImuMessage,
    rate_hz: u32,
    decimation: u16,
    phase: Phase,
    parser: Parser,
    stream: Stream,
    model: [u8; 16],
}

impl Mip {
    pub(super) fn new(imu: &Imu) -> Self {
        let ticks = TICKS_PER_S / imu.rate_hz.max(1);
        Self {
            message: imu.message,
            rate_hz: imu.rate_hz.max(1),
            decimation: 1,
            phase: Phase::Ask(Step::Idle, None),
            parser: Parser::default(),
            stream: Stream::new(TICKS_PER_S, ticks, line_time(DATA_BYTES, imu.baud)),
            model: [0; 16],
        }
    }

    fn command(&self, step: Step) -> Command {
        let angle = match self.message {
            ImuMessage::EulerRate => field::EULER,
            ImuMessage::AccelRate => field::ACCEL,
        };
        match step {
            Step::Idle => Command::Idle,
            Step::Info => Command::Info,
            Step::BaseRate => Command::BaseRate,
            Step::Format => {
                Command::Format { fields: [angle, field::RATE, field::TIME_OF_WEEK], decimation: self.decimation }
            }
            Step::Stream => Command::Stream,
        }
    }

    pub(super) fn transmit(&mut self, now: Stamp) -> Option<Request> {
        self.check_deadline(now);
        let Phase::Ask(step, asked @ None) = &mut self.phase else { return None };
        *asked = Some(now);
        let step = *step;
        if step == Step::Idle {
            self.stream.counters.starts = self.stream.counters.starts.saturating_add(1);
        }
        Some(self.command(step).packet())
    }

    pub(super) fn receive(&mut self, now: Stamp, bytes: &[u8], batch: &mut ImuBatch) {
        // The parser lends its packets, so it is taken out meanwhile.
        let mut parser = std::mem::take(&mut self.parser);
        for byte in bytes {
            parser.push(*byte, |packet| self.take(now, packet, batch));
        }
        self.parser = parser;
    }

    pub(super) fn lost(&self) -> u32 {
        self.stream.lost(self.parser.failures)
    }

    pub(super) const fn is_streaming(&self) -> bool {
        matches!(self.phase, Phase::Streaming { .. })
    }

    pub(super) const fn model(&self) -> &[u8; 16] {
        &self.model
    }

    pub(super) const fn counters(&self) -> &ImuCounters {
        &self.stream.counters
    }

    fn check_deadline(&mut self, now: Stamp) {
        match self.phase {
            Phase::Ask(Step::Idle, Some(at)) if now.since(at) > DRAIN => self.phase = Phase::Ask(Step::Info, None),
            Phase::Ask(step, Some(at)) if step != Step::Idle && now.since(at) > ANSWER_TIMEOUT => self.start_over(),
            Phase::Streaming { heard } if now.since(heard) > SILENCE => self.start_over(),
            _ => {}
        }
    }

    fn start_over(&mut self) {
        self.phase = Phase::Ask(Step::Idle, None);
        self.stream.restart();
    }

    fn take(&mut self, now: Stamp, packet: Packet<'_>, batch: &mut ImuBatch) {
        match self.phase {
            Phase::Streaming { .. } => {
                if let Some(measured) = packet.measurement() {
                    self.phase = Phase::Streaming { heard: now };
                    self.take_measurement(now, &measured, batch);
                }
            }
            // What was under way when we said idle.
            Phase::Ask(Step::Idle, _) | Phase::Ask(_, None) => {}
            Phase::Ask(step, Some(_)) => self.take_answer(now, step, packet),
        }
    }

    fn take_answer(&mut self, now: Stamp, step: Step, packet: Packet<'_>) {
        match packet.acknowledges(self.command(step)) {
            None => return,
            Some(0) => {}
            Some(_) => {
                // Asked again from the start when the time is over.
                self.stream.counters.refused = self.stream.counters.refused.saturating_add(1);
                return;
            }
        }
        for (descriptor, data) in packet.fields() {
            match (step, descriptor) {
                (Step::Info, INFO) => self.model = padded(data.get(2..18).unwrap_or(&[])),
                (Step::BaseRate, BASE_RATE) => self.set_base_rate(BigEndian(data).u16()),
                _ => {}
            }
        }
        self.phase = match step {
            Step::Idle | Step::Info => Phase::Ask(Step::BaseRate, None),
            Step::BaseRate => Phase::Ask(Step::Format, None),
            Step::Format => Phase::Ask(Step::Stream, None),
            Step::Stream => Phase::Streaming { heard: now },
        };
    }

    /// The next lower rate that the device has, if it does not have ours.
    fn set_base_rate(&mut self, base_hz: u16) {
        let base_hz = u32::from(base_hz).max(1);
        let decimation = base_hz.div_ceil(self.rate_hz).max(1);
        self.decimation = u16::try_from(decimation).unwrap_or(u16::MAX);
        self.stream.set_ticks_per_sample(TICKS_PER_S.saturating_mul(decimation) / base_hz);
    }

    fn take_measurement(&mut self, now: Stamp, measured: &Measurement, batch: &mut ImuBatch) {
        // A packet without rate or time is one of another format.
        let (Some(rate), Some(time_s)) = (measured.rate_rad_s, measured.time_s) else { return };
        let sample = ImuSample {
            device_ticks: ticks(time_s),
            has_attitude: measured.euler_rad.is_some(),
            euler_rad: measured.euler_rad.unwrap_or_default().map(f64::from),
            rate_rad_s: rate.map(f64::from),
            accel_g: measured.accel_g.unwrap_or_default().map(f64::from),
            ..ImuSample::default()
        };
        self.stream.take(now, sample, batch);
    }
}

/// Microseconds that wrap. What is no time is 0.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "it saturates, and then it wraps")]
fn ticks(time_s: f64) -> u32 {
    (libm::round(time_s * f64::from(TICKS_PER_S)) as u64) as u32
}
