//! A 3DM-GX3: gets its stream going, turns bytes into samples, and starts over when it falls silent.
//!
//! ```text
//!   Stop ─FA, 100 ms of silence→ Identify ─EA→ Configure ─DB→ Begin ─C4→ Streaming
//!     ↑                             │ 300 ms       │            │           │ 500 ms without a message
//!     └─────────────────────────────┴──────────────┴────────────┴───────────┘
//! ```
//! RT: yes, no allocation.

use super::stream::Stream;
use super::{ANSWER_TIMEOUT, DRAIN, ImuCounters, SILENCE};
use crate::base::time::Stamp;
use crate::config::checked::{Imu, ImuMessage};
use crate::msg::{ImuBatch, ImuSample};
use crate::sensor::imu_codec::{
    DEFAULT_FLAGS, FLAG_ORIENTATION, Kind, MAX_RATE_HZ, Parser, Reply, Request, RequestBytes, Sampling, TICKS_PER_S,
};

/// Identity string with the model's name.
const MODEL_NAME: u8 = 2;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Stop { asked: Option<Stamp> },
    Identify { asked: Option<Stamp> },
    Configure { asked: Option<Stamp> },
    Begin { asked: Option<Stamp> },
    Streaming { heard: Stamp },
}

/// Reads one.
#[derive(Clone, Debug)]
pub(super) struct Gx3 {
    kind: Kind,
    sampling: Sampling,
    phase: Phase,
    parser: Parser,
    stream: Stream,
    model: [u8; 16],
}

impl Gx3 {
    /// For the configured message and rate; the sequence starts with the first [`Self::transmit`].
    pub(super) fn new(imu: &Imu) -> Self {
        let kind = match imu.message {
            ImuMessage::AccelRate => Kind::AccelRate,
            ImuMessage::EulerRate => Kind::EulerRate,
        };
        let decimation = u16::try_from(MAX_RATE_HZ / imu.rate_hz.max(1)).unwrap_or(u16::MAX).max(1);
        let flags = if kind.needs_orientation() { DEFAULT_FLAGS } else { DEFAULT_FLAGS & !FLAG_ORIENTATION };
        let ticks_per_sample = u32::from(decimation) * TICKS_PER_S / MAX_RATE_HZ;
        Self {
            kind,
            sampling: Sampling { decimation, flags, ..Sampling::default() },
            phase: Phase::Stop { asked: None },
            parser: Parser::new(&[]),
            stream: Stream::new(TICKS_PER_S, ticks_per_sample, super::line_time(kind.reply_bytes(), imu.baud)),
            model: [0; 16],
        }
    }

    /// The request that is due now, if any. To be called every few milliseconds.
    pub(super) fn transmit(&mut self, now: Stamp) -> Option<RequestBytes> {
        self.check_deadline(now);
        let (asked, request) = match &mut self.phase {
            Phase::Stop { asked } => (asked, Request::StopContinuous),
            Phase::Identify { asked } => (asked, Request::Identity(MODEL_NAME)),
            Phase::Configure { asked } => (asked, Request::SetSampling(self.sampling)),
            Phase::Begin { asked } => (asked, Request::SetContinuous(self.kind)),
            Phase::Streaming { .. } => return None,
        };
        if asked.is_some() {
            return None;
        }
        *asked = Some(now);
        if request == Request::StopContinuous {
            self.stream.counters.starts = self.stream.counters.starts.saturating_add(1);
        }
        Some(request.emit())
    }

    /// Takes bytes that arrived at `now`; adds the samples in them to the batch.
    pub(super) fn receive(&mut self, now: Stamp, bytes: &[u8], batch: &mut ImuBatch) {
        for byte in bytes {
            if let Some(reply) = self.parser.push(*byte) {
                self.take(now, &reply, batch);
            }
        }
    }

    /// Messages lost since the start.
    pub(super) fn lost(&self) -> u32 {
        self.stream.lost(self.parser.failures)
    }

    /// True while samples come.
    pub(super) fn is_streaming(&self) -> bool {
        matches!(self.phase, Phase::Streaming { .. })
    }

    /// The model's name as the device tells it; zero bytes before.
    pub(super) const fn model(&self) -> &[u8; 16] {
        &self.model
    }

    /// What went wrong or was seen since the start.
    pub(super) const fn counters(&self) -> &ImuCounters {
        &self.stream.counters
    }

    fn check_deadline(&mut self, now: Stamp) {
        match self.phase {
            Phase::Stop { asked: Some(at) } if now.since(at) > DRAIN => {
                self.parser.look_for(&[Kind::Identity]);
                self.phase = Phase::Identify { asked: None };
            }
            Phase::Identify { asked: Some(at) }
            | Phase::Configure { asked: Some(at) }
            | Phase::Begin { asked: Some(at) }
                if now.since(at) > ANSWER_TIMEOUT =>
            {
                self.start_over();
            }
            Phase::Streaming { heard } if now.since(heard) > SILENCE => self.start_over(),
            _ => {}
        }
    }

    fn start_over(&mut self) {
        self.phase = Phase::Stop { asked: None };
        self.parser.look_for(&[]);
        self.stream.restart();
    }

    fn take(&mut self, now: Stamp, reply: &Reply, batch: &mut ImuBatch) {
        match (self.phase, reply) {
            (Phase::Identify { .. }, Reply::Identity { text, .. }) => {
                self.model = *text;
                self.parser.look_for(&[Kind::Sampling]);
                self.phase = Phase::Configure { asked: None };
            }
            (Phase::Configure { .. }, Reply::Sampling(kept)) if *kept == self.sampling => {
                self.parser.look_for(&[Kind::SetContinuous]);
                self.phase = Phase::Begin { asked: None };
            }
            (Phase::Configure { .. }, Reply::Sampling(_)) => {
                self.stream.counters.refused = self.stream.counters.refused.saturating_add(1);
            }
            (Phase::Begin { .. }, Reply::SetContinuous { kind, .. }) if *kind == self.kind as u8 => {
                self.parser.look_for(&[self.kind]);
                self.phase = Phase::Streaming { heard: now };
            }
            (Phase::Streaming { .. }, reply) => {
                self.phase = Phase::Streaming { heard: now };
                self.take_measurement(now, reply, batch);
            }
            _ => {}
        }
    }

    fn take_measurement(&mut self, now: Stamp, reply: &Reply, batch: &mut ImuBatch) {
        let sample = match *reply {
            Reply::AccelRate { accel_g, rate_rad_s, ticks } => ImuSample {
                device_ticks: ticks,
                accel_g: accel_g.map(f64::from),
                rate_rad_s: rate_rad_s.map(f64::from),
                ..ImuSample::default()
            },
            Reply::EulerRate { euler_rad, rate_rad_s, ticks } => ImuSample {
                device_ticks: ticks,
                has_attitude: true,
                euler_rad: euler_rad.map(f64::from),
                rate_rad_s: rate_rad_s.map(f64::from),
                ..ImuSample::default()
            },
            _ => return,
        };
        self.stream.take(now, sample, batch);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::time::Span;
    use crate::config;

    fn reader() -> Gx3 {
        Gx3::new(&config::load(None, &[]).unwrap().config.robot.imu)
    }

    fn at_ms(ms: i64) -> Stamp {
        Stamp(ms * 1_000_000)
    }

    fn ticks_per_sample(reader: &Gx3) -> u32 {
        u32::from(reader.sampling.decimation) * TICKS_PER_S / MAX_RATE_HZ
    }

    /// As the reader of either protocol does it.
    fn feed(reader: &mut Gx3, now: Stamp, bytes: &[u8], batch: &mut ImuBatch) {
        reader.receive(now, bytes, batch);
        batch.dropped = batch.dropped.max(reader.lost());
    }

    /// A reader whose device answered as it should; streaming from 150 ms on.
    fn streaming() -> (Gx3, ImuBatch) {
        let mut reader = reader();
        let mut batch = ImuBatch::default();
        assert_eq!(reader.transmit(at_ms(0)).unwrap().as_slice(), Request::StopContinuous.emit().as_slice());
        feed(&mut reader, at_ms(50), &[0xCF; 40], &mut batch);
        assert!(reader.transmit(at_ms(120)).is_some());
        let identity = Reply::Identity { selector: MODEL_NAME, text: *b"      3DM-GX3-25" };
        feed(&mut reader, at_ms(130), identity.emit().as_slice(), &mut batch);
        assert!(reader.transmit(at_ms(131)).is_some());
        let kept = Reply::Sampling(reader.sampling).emit();
        feed(&mut reader, at_ms(140), kept.as_slice(), &mut batch);
        assert!(reader.transmit(at_ms(141)).is_some());
        let set = Reply::SetContinuous { kind: reader.kind as u8, ticks: 0 };
        feed(&mut reader, at_ms(150), set.emit().as_slice(), &mut batch);
        assert!(reader.is_streaming());
        (reader, batch)
    }

    fn message(ticks: u32, pitch: f32) -> Vec<u8> {
        let reply = Reply::EulerRate { euler_rad: [0.0, pitch, 0.0], rate_rad_s: [0.0; 3], ticks };
        reply.emit().as_slice().to_vec()
    }

    #[test]
    fn start_up_goes_stop_identify_configure_begin() {
        let (reader, batch) = streaming();
        assert_eq!(batch.count, 0);
        assert_eq!(reader.model(), b"      3DM-GX3-25");
        assert_eq!(reader.counters().starts, 1);
    }

    #[test]
    fn a_device_that_does_not_answer_is_asked_again_from_the_start() {
        let mut reader = reader();
        for ms in 0..2000 {
            reader.transmit(at_ms(ms));
        }
        assert!(reader.counters().starts >= 4, "{:?}", reader.counters());
    }

    #[test]
    fn a_silent_stream_starts_over() {
        let (mut reader, mut batch) = streaming();
        feed(&mut reader, at_ms(200), &message(100, 0.0), &mut batch);
        assert_eq!(reader.transmit(at_ms(600)), None);
        assert!(reader.transmit(at_ms(701)).is_some());
        assert!(!reader.is_streaming());
    }

    #[test]
    fn a_gap_in_the_device_timer_counts_as_lost_messages() {
        let (mut reader, mut batch) = streaming();
        let step = ticks_per_sample(&reader);
        for k in [0, 1, 2, 5, 6] {
            let arrival = at_ms(200) + Span::from_us(i64::from(k) * i64::from(step) * 16);
            feed(&mut reader, arrival, &message(k * step, 0.1), &mut batch);
        }
        assert_eq!(batch.count, 5);
        assert_eq!(batch.dropped, 2);
    }

    #[test]
    fn a_number_that_is_not_finite_is_lost_not_delivered() {
        let (mut reader, mut batch) = streaming();
        feed(&mut reader, at_ms(200), &message(1, f32::NAN), &mut batch);
        assert_eq!((batch.count, batch.dropped), (0, 1));
    }

    #[test]
    fn samples_of_a_burst_keep_their_own_times() {
        let (mut reader, mut batch) = streaming();
        let step = ticks_per_sample(&reader);
        feed(&mut reader, at_ms(200), &message(0, 0.0), &mut batch);
        let burst = [message(step, 0.1), message(2 * step, 0.2), message(3 * step, 0.3)].concat();
        let arrival = at_ms(200) + Span::from_us(3 * i64::from(step) * 16);
        feed(&mut reader, arrival, &burst, &mut batch);
        let stamps: Vec<i64> = batch.as_slice().iter().map(|s| s.stamp.0).collect();
        let expected = i64::from(step) * 16_000;
        for pair in stamps.windows(2) {
            assert!((pair[1] - pair[0] - expected).abs() < 1_000, "{stamps:?}");
        }
    }

    #[test]
    fn of_more_samples_than_a_tick_takes_the_newest_are_left_and_the_others_counted() {
        let (mut reader, mut batch) = streaming();
        let step = ticks_per_sample(&reader);
        let burst: Vec<u8> = (0..12).flat_map(|k| message(k * step, 0.01 * k as f32)).collect();
        feed(&mut reader, at_ms(300), &burst, &mut batch);
        assert_eq!((batch.count, batch.dropped), (8, 4));
        let ticks: Vec<u32> = batch.as_slice().iter().map(|s| s.device_ticks / step).collect();
        assert_eq!(ticks, [4, 5, 6, 7, 8, 9, 10, 11]);
    }

    #[test]
    fn a_timer_that_steps_back_by_less_than_half_a_sample_is_no_overflow() {
        let (mut reader, mut batch) = streaming();
        feed(&mut reader, at_ms(200), &message(1_000, 0.0), &mut batch);
        feed(&mut reader, at_ms(201), &message(999, 0.0), &mut batch);
        assert_eq!((batch.count, batch.dropped), (2, 0));
    }
}
