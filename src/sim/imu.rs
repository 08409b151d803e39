//! A simulated IMU on its serial line, a 3DM-GX3-25 or one that speaks MIP: its own errors, rates, timer and bytes.
//!
//! Errors (thesis 2.1.2 and the data sheet it quotes): a static error drawn once, an error in motion that grows with
//! the rate, drift, and an attitude that lags. The rate and acceleration carry noise only. What the device refuses,
//! this one refuses: orientation above 500 Hz, anything above 1000 Hz. RT: no.

mod mip;

use crate::base::time::{Span, Stamp};
use crate::config::checked::{Imu, ImuErrors, ImuProtocol};
use crate::config::fault::{FaultName, Injection};
use crate::sensor::imu_codec::{
    FLAG_ORIENTATION, Found, Kind, MAX_ORIENTATION_HZ, MAX_RATE_HZ, MAX_REQUEST, Reply, Request, STANDARD_GRAVITY_M_S2,
    Sampling, TICKS_PER_S,
};
use crate::sensor::mip::Parser;
use crate::sim::Reading;
use crate::sim::noise::Noise;
use std::collections::VecDeque;

/// The error in motion changes its sense over about this time, s.
const DYNAMIC_CORRELATION_S: f64 = 1.0;
/// Messages that wait in the device while its line is busy; then it throws the newest away.
const LINE_QUEUE: usize = 8;
/// A USB adapter with its usual latency timer delivers so often.
const BURST: Span = Span::from_ms(16);
/// Makes what the line suffers another stream than the device's noise.
const TROUBLE_STREAM: u64 = 0x7478_6E00;
/// From switching on to the first moment that we look: the device's timer does not start with ours.
const TIMER_START: u32 = 1_234_567;

/// The device.
#[derive(Clone, Debug)]
pub struct SimImu {
    sign: f64,
    offset_rad: f64,
    errors: ImuErrors,
    noise: Noise,
    attitude: Attitude,
    byte_time: Span,
    sampling: Sampling,
    streams: Option<Kind>,
    next: Stamp,
    protocol: ImuProtocol,
    heard: Vec<u8>,
    packets: Parser,
    /// What the host wants streamed, in MIP.
    format: Option<Kind>,
    /// Messages with the time at which their last byte arrives.
    line: VecDeque<(Stamp, Vec<u8>)>,
    line_busy_until: Stamp,
    thrown_away: u32,
    trouble: Trouble,
}

/// What is wrong with the device or its line.
#[derive(Clone, Debug)]
struct Trouble {
    /// Bytes suffer: kind and share.
    bytes: Option<(&'static str, f64)>,
    /// The adapter delivers every 16 ms.
    bursts: bool,
    /// The stream stands still.
    stalled: bool,
    /// The line has another rate.
    wrong_baud: bool,
    /// Numbers are none.
    nan: bool,
    /// The adapter is gone.
    unplugged: bool,
    /// What its timer showed when we switched on.
    timer_start: u32,
    draws: Noise,
}

/// The attitude filter's state.
#[derive(Clone, Debug)]
struct Attitude {
    pitch_rad: Option<f64>,
    static_error_rad: f64,
    drift_rad: f64,
    /// Sense and share of the error in motion, -1 to 1.
    dynamic_share: f64,
    since: Stamp,
}

impl SimImu {
    /// A device fresh from the shelf: not streaming, 100 Hz.
    #[must_use]
    pub fn new(imu: &Imu, errors: &ImuErrors, seed: u64) -> Self {
        let mut noise = Noise::new(seed);
        let static_error_rad = errors.static_error_rad * noise.normal();
        let dynamic_share = noise.normal().clamp(-1.0, 1.0);
        Self {
            sign: imu.sign,
            offset_rad: imu.offset_rad,
            errors: *errors,
            noise,
            attitude: Attitude {
                pitch_rad: None,
                static_error_rad,
                drift_rad: 0.0,
                dynamic_share,
                since: Stamp::default(),
            },
            byte_time: Span(10 * 1_000_000_000 / i64::from(imu.baud.max(1))),
            sampling: Sampling::default(),
            streams: None,
            next: Stamp::default(),
            protocol: imu.protocol,
            heard: Vec::new(),
            packets: Parser::default(),
            format: None,
            line: VecDeque::new(),
            line_busy_until: Stamp::default(),
            thrown_away: 0,
            trouble: Trouble {
                bytes: None,
                bursts: false,
                stalled: false,
                wrong_baud: false,
                nan: false,
                unplugged: false,
                timer_start: TIMER_START,
                draws: Noise::new(seed ^ TROUBLE_STREAM),
            },
        }
    }

    /// A timer that shall wrap at a time has to start in time.
    pub(super) fn prepare(&mut self, faults: &[Injection]) {
        if let Some(wrap) = faults.iter().find(|fault| fault.entry.fault == FaultName::ImuTimerWrap) {
            self.trouble.timer_start = 0_u32.wrapping_sub(ticks_since(Stamp::default() + wrap.at));
        }
    }

    /// Something breaks, or is whole again.
    pub(super) fn suffer(&mut self, now: Stamp, fault: &Injection, on: bool) {
        match fault.entry.fault {
            FaultName::ImuBytes => self.trouble.bytes = on.then_some((fault.kind, fault.share)),
            FaultName::ImuBursts => self.trouble.bursts = on,
            FaultName::ImuStall => self.trouble.stalled = on,
            FaultName::ImuWrongBaud => self.trouble.wrong_baud = on,
            FaultName::ImuNan => self.trouble.nan = on,
            FaultName::ImuReplug => {
                self.trouble.unplugged = on;
                // It lost its power: as fresh from the shelf.
                self.streams = None;
                self.sampling = Sampling::default();
                self.line.clear();
                self.heard.clear();
                self.line_busy_until = now;
            }
            _ => {}
        }
    }

    /// Its adapter is plugged in.
    pub(super) const fn is_plugged(&self) -> bool {
        !self.trouble.unplugged
    }

    /// When it measures next, if it streams.
    #[must_use]
    pub fn next_measurement(&self) -> Option<Stamp> {
        self.streams.map(|_| self.next)
    }

    /// Messages that never got onto the line, which is too slow for them.
    #[must_use]
    pub const fn thrown_away(&self) -> u32 {
        self.thrown_away
    }

    /// Measures, and sends.
    pub fn measure(&mut self, now: Stamp, reading: &Reading) {
        let Some(kind) = self.streams else { return };
        let period = Span(i64::from(self.sampling.decimation) * 1_000_000_000 / i64::from(MAX_RATE_HZ));
        self.next = now + period;
        let message = self.message(kind, now, reading);
        if self.trouble.stalled {
            return;
        }
        let bytes = match self.protocol {
            ImuProtocol::Gx3 => message.emit().as_slice().to_vec(),
            ImuProtocol::Mip => mip::data(&message, now),
        };
        self.send_bytes(now + Span::from_s(self.errors.latency_s), bytes, true);
    }

    /// Bytes from the host.
    pub fn hear(&mut self, now: Stamp, bytes: &[u8], reading: &Reading) {
        if self.trouble.unplugged || self.trouble.wrong_baud {
            return;
        }
        if self.protocol == ImuProtocol::Mip {
            return self.hear_packets(now, bytes);
        }
        self.heard.extend_from_slice(bytes);
        loop {
            match Request::parse(&self.heard) {
                Found::Request(request, len) => {
                    self.heard.drain(..len);
                    self.obey(now, &request, reading);
                }
                Found::Incomplete if self.heard.len() < MAX_REQUEST => return,
                Found::Incomplete | Found::Nothing => {
                    self.heard.remove(0);
                }
            }
        }
    }

    fn hear_packets(&mut self, now: Stamp, bytes: &[u8]) {
        let mut orders = Vec::new();
        let formatted = self.format.is_some();
        for byte in bytes {
            self.packets.push(*byte, |packet| orders.push(mip::obey(packet, formatted)));
        }
        for (order, answer) in orders {
            match order {
                mip::Order::Nothing => {}
                mip::Order::Stop => self.streams = None,
                mip::Order::Format(kind, decimation) => {
                    self.format = Some(kind);
                    self.sampling.decimation = decimation;
                }
                mip::Order::Stream => (self.streams, self.next) = (self.format, now),
            }
            self.send_bytes(now, answer, false);
        }
    }

    /// Bytes that have arrived at the host by now.
    pub fn take(&mut self, now: Stamp, out: &mut Vec<u8>) {
        let until = if self.trouble.bursts { Stamp(now.0 - now.0.rem_euclid(BURST.0)) } else { now };
        while self.line.front().is_some_and(|(at, _)| *at <= until) {
            if let Some((_, bytes)) = self.line.pop_front() {
                self.spoil(&bytes, out);
            }
        }
    }

    /// What the line makes of the bytes.
    fn spoil(&mut self, bytes: &[u8], out: &mut Vec<u8>) {
        let trouble = &mut self.trouble;
        if trouble.unplugged {
            return;
        }
        if trouble.wrong_baud {
            // A line read at another rate gives bytes that have little to do with those sent.
            return out.extend(bytes.iter().map(|byte| byte.rotate_left(3) ^ draw_byte(&mut trouble.draws)));
        }
        let Some((kind, share)) = trouble.bytes else { return out.extend_from_slice(bytes) };
        for byte in bytes {
            let hit = trouble.draws.uniform() < share;
            match kind {
                "lost" if hit => {}
                "inserted" if hit => out.extend([*byte, draw_byte(&mut trouble.draws)]),
                "flipped" if hit => out.push(byte ^ 1 << (draw_byte(&mut trouble.draws) % 8)),
                _ => out.push(*byte),
            }
        }
    }

    fn obey(&mut self, now: Stamp, request: &Request, reading: &Reading) {
        let ticks = self.ticks(now);
        match *request {
            Request::StopContinuous => self.streams = None,
            Request::Identity(selector) => {
                let text = *if selector == 2 { b"      3DM-GX3-25" } else { b"       simulated" };
                self.send(now, &Reply::Identity { selector, text }, false);
            }
            Request::SetSampling(wanted) => {
                if (1..=1000).contains(&wanted.decimation) {
                    self.sampling = wanted;
                }
                self.send(now, &Reply::Sampling(self.sampling), false);
            }
            Request::SetContinuous(kind) if self.can_stream(kind) => {
                self.streams = Some(kind);
                self.next = now;
                self.send(now, &Reply::SetContinuous { kind: kind as u8, ticks }, false);
            }
            // Refused without a word, as the device does.
            Request::SetContinuous(_) => {}
            Request::Mode(_) => self.send(now, &Reply::Mode(if self.streams.is_some() { 2 } else { 1 }), false),
            Request::Poll(kind) => {
                let message = self.message(kind, now, reading);
                self.send(now, &message, false);
            }
        }
    }

    fn can_stream(&self, kind: Kind) -> bool {
        let rate_hz = MAX_RATE_HZ / u32::from(self.sampling.decimation.max(1));
        let orientation = self.sampling.flags & FLAG_ORIENTATION != 0;
        !kind.needs_orientation() || (orientation && rate_hz <= MAX_ORIENTATION_HZ)
    }

    fn send(&mut self, ready: Stamp, message: &Reply, arrives_at_once: bool) {
        self.send_bytes(ready, message.emit().as_slice().to_vec(), arrives_at_once);
    }

    /// Puts a message on the line; `arrives_at_once`: `ready` is when the last byte is there, unless the line is busy.
    fn send_bytes(&mut self, ready: Stamp, bytes: Vec<u8>, arrives_at_once: bool) {
        if self.line.len() >= LINE_QUEUE {
            self.thrown_away += 1;
            return;
        }
        let takes = Span(self.byte_time.0 * i64::try_from(bytes.len()).unwrap_or(0));
        let start = if arrives_at_once { ready - takes } else { ready };
        let end = start.max(self.line_busy_until) + takes;
        self.line_busy_until = end;
        self.line.push_back((end, bytes));
    }

    fn message(&mut self, kind: Kind, now: Stamp, reading: &Reading) -> Reply {
        let ticks = self.ticks(now);
        let pitch_rad = self.sign * (reading.leg_angle_rad[0] - self.offset_rad);
        let pitch_rate = self.sign * reading.leg_rate_rad_s[0];
        let attitude = self.attitude(now, pitch_rad, pitch_rate);
        let n = self.errors;
        let rate_rad_s = [0.0, pitch_rate, 0.0].map(|w| narrow(w + n.rate_noise_rad_s * self.noise.normal()));
        let euler_rad = [0.0, attitude, 0.0].map(|a| narrow(a + n.attitude_noise_rad * self.noise.normal()));
        let nan = if self.trouble.nan { f32::NAN } else { 0.0 };
        let (rate_rad_s, euler_rad) = (rate_rad_s.map(|w| w + nan), euler_rad.map(|a| a + nan));
        let accel_g = specific_force_g(pitch_rad, reading.imu_accel_m_s2)
            .map(|a| narrow(a + n.accel_noise_g * self.noise.normal()));
        match kind {
            Kind::Euler => Reply::Euler { euler_rad, ticks },
            Kind::EulerRate => Reply::EulerRate { euler_rad, rate_rad_s, ticks },
            Kind::AccelRateMatrix => {
                let matrix = pitch_matrix(attitude);
                Reply::AccelRateMatrix { accel_g, rate_rad_s, matrix, ticks }
            }
            _ => Reply::AccelRate { accel_g, rate_rad_s, ticks },
        }
    }

    /// The device's timer.
    fn ticks(&self, now: Stamp) -> u32 {
        ticks_since(now).wrapping_add(self.trouble.timer_start)
    }

    /// What the device's filter believes the pitch to be.
    fn attitude(&mut self, now: Stamp, pitch_rad: f64, rate_rad_s: f64) -> f64 {
        let a = &mut self.attitude;
        let dt_s = now.since(a.since).as_s().max(0.0);
        a.since = now;
        let left = if self.errors.lag_s > 0.0 { libm::exp(-dt_s / self.errors.lag_s) } else { 0.0 };
        let lagging = a.pitch_rad.map_or(pitch_rad, |p| pitch_rad + (p - pitch_rad) * left);
        a.pitch_rad = Some(lagging);
        a.drift_rad += self.errors.drift_rad_sqrt_s * libm::sqrt(dt_s) * self.noise.normal();
        let kept = libm::exp(-dt_s / DYNAMIC_CORRELATION_S);
        let fresh = libm::sqrt(1.0 - kept * kept) * self.noise.normal();
        a.dynamic_share = (a.dynamic_share * kept + fresh).clamp(-1.0, 1.0);
        let dynamic = self.errors.dynamic_error_rad * libm::tanh(rate_rad_s.abs()) * a.dynamic_share;
        lagging + a.static_error_rad + a.drift_rad + dynamic
    }
}

/// Ticks of the device's timer since time zero.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "wraps, as the device's does")]
fn ticks_since(now: Stamp) -> u32 {
    (i128::from(now.0) * i128::from(TICKS_PER_S) / 1_000_000_000) as u32
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
fn draw_byte(noise: &mut Noise) -> u8 {
    (noise.uniform() * 256.0) as u8
}

/// Specific force in the device's axes, x forward, z down, g: (0, 0, -1) when it stands level.
fn specific_force_g(pitch_rad: f64, accel_m_s2: [f64; 2]) -> [f64; 3] {
    let (sin, cos) = libm::sincos(pitch_rad);
    let forward = accel_m_s2[0] / STANDARD_GRAVITY_M_S2;
    let up = accel_m_s2[1] / STANDARD_GRAVITY_M_S2 + 1.0;
    [forward * cos + up * sin, 0.0, forward * sin - up * cos]
}

/// Rows of the orientation matrix of a pure pitch.
fn pitch_matrix(pitch_rad: f64) -> [f32; 9] {
    let (sin, cos) = libm::sincos(pitch_rad);
    [cos, 0.0, -sin, 0.0, 1.0, 0.0, sin, 0.0, cos].map(narrow)
}

#[expect(clippy::cast_possible_truncation, reason = "the wire carries single precision")]
fn narrow(x: f64) -> f32 {
    x as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{self, checked::ImuMessage};
    use crate::msg::ImuBatch;
    use crate::sensor::imu::ImuReader;

    fn quiet() -> ImuErrors {
        ImuErrors {
            static_error_rad: 0.0,
            dynamic_error_rad: 0.0,
            drift_rad_sqrt_s: 0.0,
            lag_s: 0.0,
            rate_noise_rad_s: 0.0,
            attitude_noise_rad: 0.0,
            accel_noise_g: 0.0,
            latency_s: 0.002,
        }
    }

    fn settings(message: ImuMessage, rate_hz: u32) -> Imu {
        let imu = config::load(None, &[]).unwrap().config.robot.imu;
        Imu { message, rate_hz, baud: 921_600, ..imu }
    }

    /// Device and reader for so many ms with the leg held by `reading`; all samples with their time of arrival.
    fn run(
        settings: &Imu,
        errors: &ImuErrors,
        ms: i64,
        reading: impl Fn(f64) -> Reading,
    ) -> Vec<(Stamp, crate::msg::ImuSample)> {
        let mut device = SimImu::new(settings, errors, 1);
        let mut reader = ImuReader::new(settings);
        let mut samples = Vec::new();
        for quarter in 0..4 * ms {
            let now = Stamp(quarter * 250_000);
            while device.next_measurement().is_some_and(|at| at <= now) {
                let at = device.next_measurement().unwrap();
                device.measure(at, &reading(at.as_s()));
            }
            if let Some(request) = reader.transmit(now) {
                device.hear(now, request.as_slice(), &reading(now.as_s()));
            }
            let (mut bytes, mut batch) = (Vec::new(), ImuBatch::default());
            device.take(now, &mut bytes);
            reader.receive(now, &bytes, &mut batch);
            samples.extend(batch.as_slice().iter().map(|s| (now, *s)));
        }
        samples
    }

    fn leaning(angle_rad: f64) -> impl Fn(f64) -> Reading {
        move |_| Reading { leg_angle_rad: [angle_rad, 0.0], ..Reading::default() }
    }

    #[test]
    fn reader_and_device_bring_five_hundred_attitudes_per_second() {
        let samples = run(&settings(ImuMessage::EulerRate, 500), &quiet(), 1200, leaning(0.1));
        let in_a_second = samples.iter().filter(|(at, _)| at.as_s() >= 0.2).count();
        assert!((495..=505).contains(&in_a_second), "{in_a_second}");
        assert!(samples.iter().all(|(_, s)| s.has_attitude && (s.euler_rad[1] - 0.1).abs() < 1e-6));
    }

    #[test]
    fn a_device_that_speaks_mip_brings_the_same_samples() {
        for (message, rate_hz) in [(ImuMessage::EulerRate, 500), (ImuMessage::AccelRate, 1000)] {
            let settings = Imu { protocol: ImuProtocol::Mip, ..settings(message, rate_hz) };
            let samples = run(&settings, &quiet(), 1300, |t| Reading {
                leg_angle_rad: [0.1, 0.0],
                leg_rate_rad_s: [t, 0.0],
                ..Reading::default()
            });
            let in_a_second = samples.iter().filter(|(at, _)| at.as_s() >= 0.3).count();
            assert!(in_a_second.abs_diff(rate_hz as usize) <= 5, "{in_a_second}");
            let attitude = |s: &crate::msg::ImuSample| match message {
                ImuMessage::EulerRate => s.euler_rad[1],
                ImuMessage::AccelRate => libm::atan2(s.accel_g[0], -s.accel_g[2]),
            };
            assert!(samples.iter().all(|(_, s)| (attitude(s) - 0.1).abs() < 1e-6));
            // 2 ms latency less 521 us on the line, polled every 250 us, less 1 us of rounding.
            for (_, sample) in &samples[20..] {
                let late = sample.stamp.as_s() - sample.rate_rad_s[1];
                assert!((0.00147..0.00175).contains(&late), "{late}");
            }
        }
    }

    #[test]
    fn orientation_at_a_thousand_hertz_is_refused_and_rates_are_not() {
        assert!(run(&settings(ImuMessage::EulerRate, 1000), &quiet(), 600, leaning(0.1)).is_empty());
        let samples = run(&settings(ImuMessage::AccelRate, 1000), &quiet(), 600, leaning(0.1));
        assert!(samples.len() > 350);
        let accel = samples[100].1.accel_g;
        assert!((libm::atan2(accel[0], -accel[2]) - 0.1).abs() < 1e-6, "{accel:?}");
    }

    #[test]
    fn stamps_are_those_of_measuring_up_to_the_latency_of_the_device() {
        let samples = run(&settings(ImuMessage::EulerRate, 500), &quiet(), 600, |t| Reading {
            leg_angle_rad: [t, 0.0],
            leg_rate_rad_s: [1.0, 0.0],
            ..Reading::default()
        });
        for (_, sample) in &samples[20..] {
            let late = sample.stamp.as_s() - sample.euler_rad[1];
            // 2 ms latency less 336 us on the line, polled every 250 us.
            assert!((0.0015..0.0022).contains(&late), "{late}");
        }
    }

    #[test]
    fn attitude_lags_a_step_by_the_configured_time() {
        let errors = ImuErrors { lag_s: 0.05, latency_s: 0.0005, ..quiet() };
        let step = |t: f64| Reading { leg_angle_rad: [if t < 0.3 { 0.0 } else { 1.0 }, 0.0], ..Reading::default() };
        let samples = run(&settings(ImuMessage::EulerRate, 500), &errors, 600, step);
        let at = |t: f64| samples.iter().find(|(now, _)| now.as_s() >= t).unwrap().1.euler_rad[1];
        assert!((at(0.35) - (1.0 - libm::exp(-1.0))).abs() < 0.03);
        assert!((at(0.55) - 1.0).abs() < 0.02);
    }

    #[test]
    fn a_line_too_slow_for_the_stream_loses_messages_and_says_so() {
        let slow = Imu { baud: 115_200, ..settings(ImuMessage::EulerRate, 500) };
        let mut device = SimImu::new(&slow, &quiet(), 1);
        let reading = Reading::default();
        device.hear(
            Stamp(0),
            Request::SetSampling(Sampling { decimation: 2, ..Sampling::default() }).emit().as_slice(),
            &reading,
        );
        device.hear(Stamp(0), Request::SetContinuous(Kind::EulerRate).emit().as_slice(), &reading);
        let mut bytes = Vec::new();
        for k in 0..500 {
            device.measure(Stamp(k * 2_000_000), &reading);
            device.take(Stamp(k * 2_000_000), &mut bytes);
        }
        // 31 bytes take 2.7 ms of each 2 ms.
        assert!(device.thrown_away() > 100);
    }

    #[test]
    fn the_same_seed_gives_the_same_bytes() {
        let errors = ImuErrors { rate_noise_rad_s: 0.01, static_error_rad: 0.01, ..quiet() };
        let settings = settings(ImuMessage::EulerRate, 500);
        assert_eq!(run(&settings, &errors, 300, leaning(0.1)), run(&settings, &errors, 300, leaning(0.1)));
    }
}
