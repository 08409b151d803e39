//! A simulated Hokuyo UTM-30LX-EW: its own clock, errors, refusals and bytes. It sees the floor of the simulated world, 40
//! times a second, step by step while the robot moves. RT: no.
//!
//! Limits: it sees the floor and nothing else of the robot or the room; what stands in its way is drawn by chance
//! (`sim.lidar.clutter_share`). Edges of tiles less than [`MARCH_M`] apart may be missed.

use super::noise::Noise;
use super::{Place, Reading, World};
use crate::base::time::{Span, Stamp};
use crate::config::checked::{Lidar, LidarErrors, LidarMount};
use crate::config::fault::{FaultName, Injection};
use crate::sensor::lidar::link::{LidarWire, Opened};
use crate::sensor::scip::{self, Parameters, STEPS};
use std::collections::VecDeque;
use std::f64::consts::FRAC_PI_2;

/// A turn of the mirror.
const TURN: Span = Span::from_ms(25);
/// From a scan's beginning to the beam of the middle step.
const MIDDLE: Span = Span::from_us(9_375);
/// From the end of a turn to the last byte at the host.
const LATENCY: Span = Span::from_ms(1);
/// An answer comes after this time.
const ANSWER: Span = Span::from_us(300);
/// When we switch on its clock shows this, ms.
const CLOCK_START_MS: u32 = 71_234;
/// Characters of a data line.
const LINE: usize = 64;
/// What it answers a beam without return.
const NO_RETURN_MM: u32 = 1;
/// A host that got no connection tries again after this time.
const ATTEMPT_EVERY: Span = Span::from_ms(500);
/// Steps in which a beam is followed over an uneven floor, m.
const MARCH_M: f64 = 0.005;
/// Halvings that find where it meets the floor: 5 mm / 2^12 is a micrometre.
const HALVINGS: usize = 12;
/// Beyond this a beam meets nothing, m.
const FARTHEST_M: f64 = 8.0;
/// Makes what the line suffers another stream than the device's noise.
const TROUBLE_STREAM: u64 = 0x6C69_6400;

/// What a UTM-30LX-EW says of itself.
pub const UTM_30LX: Parameters = Parameters {
    nearest_mm: 23,
    farthest_mm: 60_000,
    steps_per_turn: 1440,
    first: 0,
    last: 1080,
    front: 540,
    turns_per_min: 2400,
};

/// The device.
#[derive(Clone, Debug)]
pub struct SimLidar {
    mount: LidarMount,
    sense: f64,
    down_rad: f64,
    errors: LidarErrors,
    noise: Noise,
    heard: Vec<u8>,
    streams: bool,
    adjusting: bool,
    /// The middle of the scan to come.
    next: Stamp,
    /// What is on its way to the host.
    line: VecDeque<(Stamp, Vec<u8>)>,
    connected: bool,
    next_attempt: Stamp,
    /// When its clock began.
    start: Stamp,
    clock_start_ms: u32,
    trouble: Trouble,
}

/// What is wrong with it or its line.
#[derive(Clone, Debug)]
struct Trouble {
    /// Share of scans with a wrong check.
    check: Option<f64>,
    split: bool,
    /// Status instead of scans.
    status: Option<&'static [u8; 2]>,
    half_open: bool,
    draws: Noise,
}

impl SimLidar {
    /// A device fresh from the shelf.
    #[must_use]
    pub fn new(lidar: &Lidar, errors: Option<&LidarErrors>, seed: u64) -> Self {
        let none = LidarErrors { noise_m: 0.0, offset_m: 0.0, lost_share: 0.0, clutter_share: 0.0 };
        Self {
            mount: lidar.mount,
            sense: lidar.sense,
            down_rad: lidar.down_rad,
            errors: errors.copied().unwrap_or(none),
            noise: Noise::new(seed ^ 0x6C69_6401),
            heard: Vec::new(),
            streams: false,
            adjusting: false,
            next: Stamp::default(),
            line: VecDeque::new(),
            connected: false,
            next_attempt: Stamp::NEVER,
            start: Stamp::default(),
            clock_start_ms: CLOCK_START_MS,
            trouble: Trouble {
                check: None,
                split: false,
                status: None,
                half_open: false,
                draws: Noise::new(seed ^ TROUBLE_STREAM),
            },
        }
    }

    /// A clock that shall wrap at a time has to start in time.
    pub(super) fn prepare(&mut self, faults: &[Injection]) {
        if let Some(wrap) = faults.iter().find(|fault| fault.entry.fault == FaultName::LidarTimeWrap) {
            self.clock_start_ms = 0_u32.wrapping_sub(milliseconds(wrap.at));
        }
    }

    /// Switched on at another time.
    pub(super) const fn start_at(&mut self, now: Stamp) {
        self.start = now;
    }

    /// Something breaks, or is whole again.
    pub(super) fn suffer(&mut self, fault: &Injection, on: bool) {
        let trouble = &mut self.trouble;
        match fault.entry.fault {
            FaultName::LidarCheck => trouble.check = on.then_some(fault.share),
            FaultName::LidarSplit => trouble.split = on,
            FaultName::LidarNotReady => trouble.status = on.then_some(b"0E"),
            FaultName::LidarLaserOff => trouble.status = on.then_some(b"10"),
            FaultName::LidarHardware => trouble.status = on.then_some(b"50"),
            FaultName::LidarHalfOpen => {
                trouble.half_open = on;
                // The device notices sooner than the host that nobody acknowledges, and forgets the connection.
                (self.streams, self.connected) = (false, self.connected && !on);
                self.line.clear();
            }
            _ => {}
        }
    }

    /// When it looks next, if it streams.
    #[must_use]
    pub fn next_measurement(&self) -> Option<Stamp> {
        self.streams.then_some(self.next)
    }

    /// Looks around, and sends.
    pub fn measure(&mut self, now: Stamp, reading: &Reading, world: &dyn World) {
        self.next = now + TURN;
        let begin = now - MIDDLE;
        let arrives = begin + TURN + LATENCY;
        if let Some(status) = self.trouble.status {
            self.streams = false;
            return self.send(arrives, reply(trimmed(scip::STREAM), status, &[]));
        }
        let (place, mut values) = (world.place(), [0; STEPS]);
        for (value, step) in values.iter_mut().zip(0..) {
            *value = self.look(step, reading, &place, world);
        }
        let mut bytes = scan_bytes(self.clock_ms(begin), &values);
        if self.trouble.check.is_some_and(|share| self.trouble.draws.uniform() < share) {
            // The last character of the first data line is its check.
            bytes[16 + 4 + 6 + LINE] ^= 1;
        }
        self.send(arrives, bytes);
    }

    /// Distance along the beam of a step, as the device tells it, mm.
    fn look(&mut self, step: u32, reading: &Reading, place: &Place, world: &dyn World) -> u32 {
        // From the middle of the scan, where the robot was read.
        let off_s = UTM_30LX.delay(step).as_s() - MIDDLE.as_s();
        let [[inner, outer], [inner_rate, outer_rate]] = [reading.leg_angle_rad, reading.leg_rate_rad_s];
        let (angle, rate) = match self.mount {
            LidarMount::InnerLeg => (inner, inner_rate),
            LidarMount::Body => (0.5 * (inner + outer), 0.5 * (inner_rate + outer_rate)),
        };
        let [x, y] = place.hip_m;
        let [vx, vy] = place.hip_m_s;
        let from_m = [x + vx * off_s, y + vy * off_s];
        let beam = self.sense * (UTM_30LX.angle_rad(step) - self.down_rad);
        let direction = angle + rate * off_s + place.slope_rad + beam - FRAC_PI_2;
        let drawn = self.noise.uniform();
        let LidarErrors { noise_m, offset_m, lost_share, clutter_share } = self.errors;
        let Some(range_m) = distance(from_m, direction, world).filter(|_| drawn > lost_share) else {
            return NO_RETURN_MM;
        };
        let range_m = if drawn > 1.0 - clutter_share { range_m * self.noise.uniform() } else { range_m };
        let told_mm = 1000.0 * (range_m + offset_m + noise_m * self.noise.normal());
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let told_mm = libm::round(told_mm).clamp(0.0, 65_000.0) as u32;
        told_mm
    }

    /// Bytes from the host.
    pub fn hear(&mut self, now: Stamp, bytes: &[u8]) {
        if self.trouble.half_open || !self.connected {
            return;
        }
        self.heard.extend_from_slice(bytes);
        while let Some(end) = self.heard.iter().position(|byte| *byte == b'\n') {
            let request: Vec<u8> = self.heard.drain(..=end).collect();
            self.obey(now, trimmed(&request));
        }
    }

    fn obey(&mut self, now: Stamp, request: &[u8]) {
        let refused = self.trouble.status;
        let (status, lines): (&[u8; 2], Vec<Vec<u8>>) = match (request, refused) {
            (b"QT", _) => {
                self.streams = false;
                (b"00", Vec::new())
            }
            (b"TM2", _) => {
                self.adjusting = false;
                (b"00", Vec::new())
            }
            (_, Some(status)) => (status, Vec::new()),
            (b"PP", _) => (b"00", information()),
            (b"TM0", _) => {
                self.adjusting = true;
                (b"00", Vec::new())
            }
            (b"TM1", _) if self.adjusting => (b"00", vec![checked(&encode(self.clock_ms(now), 4))]),
            (b"BM", _) if !self.adjusting => (b"00", Vec::new()),
            (b"MD0000108001000", _) if !self.adjusting => {
                self.streams = true;
                self.next = now + TURN;
                (b"00", Vec::new())
            }
            _ => (b"0E", Vec::new()),
        };
        self.send(now + ANSWER, reply(request, status, &lines));
    }

    /// Bytes that have arrived at the host by now.
    pub fn take(&mut self, now: Stamp, out: &mut Vec<u8>) {
        while self.line.front().is_some_and(|(at, _)| *at <= now) {
            if let Some((_, bytes)) = self.line.pop_front() {
                out.extend(bytes);
            }
        }
    }

    /// Somebody is connected, as far as the device knows.
    #[must_use]
    pub const fn is_connected(&self) -> bool {
        self.connected
    }

    /// Somebody connects. False: nobody answers.
    pub fn connect(&mut self) -> bool {
        self.connected = !self.trouble.half_open;
        (self.streams, self.adjusting) = (false, false);
        self.heard.clear();
        self.line.clear();
        self.connected
    }

    fn send(&mut self, at: Stamp, mut bytes: Vec<u8>) {
        let mut at = at.max(self.line.back().map_or(at, |(last, _)| *last));
        while self.trouble.split && bytes.len() > 1 {
            let draws = &mut self.trouble.draws;
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to 200")]
            let piece = (1.0 + 199.0 * draws.uniform()) as usize;
            let rest = bytes.split_off(piece.min(bytes.len() - 1));
            self.line.push_back((at, std::mem::replace(&mut bytes, rest)));
            at += Span::from_s(3e-4 * draws.uniform());
        }
        self.line.push_back((at, bytes));
    }

    fn clock_ms(&self, now: Stamp) -> u32 {
        milliseconds(now.since(self.start)).wrapping_add(self.clock_start_ms) & 0x00FF_FFFF
    }
}

/// The host's end of the line in lockstep: nobody waits, and a connection is a word.
#[derive(Debug)]
pub(super) struct SimLine<'a> {
    pub(super) device: &'a mut SimLidar,
    pub(super) open: &'a mut bool,
    pub(super) now: Stamp,
    /// Bytes that have come.
    pub(super) bytes: &'a mut Vec<u8>,
}

impl LidarWire for SimLine<'_> {
    fn open(&mut self, now: Stamp) -> Opened {
        if *self.open || now < self.device.next_attempt {
            return Opened::Nothing;
        }
        self.device.next_attempt = now + ATTEMPT_EVERY;
        *self.open = self.device.connect();
        if *self.open { Opened::Anew } else { Opened::Refused }
    }

    fn is_open(&self) -> bool {
        *self.open
    }

    fn close(&mut self) {
        *self.open = false;
    }

    fn read(&mut self, buffer: &mut [u8]) -> usize {
        self.device.take(self.now, self.bytes);
        let count = self.bytes.len().min(buffer.len());
        for (slot, byte) in buffer.iter_mut().zip(self.bytes.drain(..count)) {
            *slot = byte;
        }
        count
    }

    fn write(&mut self, bytes: &[u8]) {
        self.device.hear(self.now, bytes);
    }
}

/// Distance from a point along a direction to the floor, m; axes along and normal to the mean ground.
fn distance([x, y]: [f64; 2], direction_rad: f64, world: &dyn World) -> Option<f64> {
    let (sin, cos) = libm::sincos(direction_rad);
    // The highest and the lowest floor there may be.
    let [low, high] = world.floor_range_m();
    let reach = |height: f64| (height - y) / sin;
    if sin > -1e-3 {
        return None;
    }
    let (mut near, far) = (reach(high).max(0.0), reach(low).min(FARTHEST_M));
    let above = |r: f64| y + r * sin - world.floor_height_m(x + r * cos);
    if high - low < 1e-12 {
        return (near < FARTHEST_M).then_some(near);
    }
    while near < far && above(near + MARCH_M) > 0.0 {
        near += MARCH_M;
    }
    let (mut from, mut to) = (near, near + MARCH_M);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (from + to);
        if above(middle) > 0.0 { from = middle } else { to = middle }
    }
    (to < FARTHEST_M).then_some(to)
}

/// Whole milliseconds; wraps.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "wraps, as the device's does")]
const fn milliseconds(time: Span) -> u32 {
    (time.0 / 1_000_000) as u32
}

/// A value in so many characters of six bits.
#[must_use]
pub fn encode(value: u32, characters: u32) -> Vec<u8> {
    (0..characters).rev().map(|k| (value >> (6 * k) & 0x3F).to_le_bytes()[0] + 0x30).collect()
}

/// A line with its check character.
fn checked(text: &[u8]) -> Vec<u8> {
    [text, &[scip::check(text)], b"\n"].concat()
}

fn reply(request: &[u8], status: &[u8; 2], lines: &[Vec<u8>]) -> Vec<u8> {
    [request, b"\n", &checked(status)[..], &lines.concat()[..], b"\n"].concat()
}

/// A scan of the stream.
#[must_use]
pub fn scan_bytes(time_ms: u32, values_mm: &[u32]) -> Vec<u8> {
    let data: Vec<u8> = values_mm.iter().flat_map(|value| encode(*value, 3)).collect();
    let lines: Vec<Vec<u8>> =
        std::iter::once(checked(&encode(time_ms, 4))).chain(data.chunks(LINE).map(checked)).collect();
    reply(trimmed(scip::STREAM), b"99", &lines)
}

/// Reply to PP.
fn information() -> Vec<Vec<u8>> {
    let p = UTM_30LX;
    let numbers = [
        ("DMIN", p.nearest_mm),
        ("DMAX", p.farthest_mm),
        ("ARES", p.steps_per_turn),
        ("AMIN", p.first),
        ("AMAX", p.last),
        ("AFRT", p.front),
        ("SCAN", p.turns_per_min),
    ];
    let line = |text: String| [text.as_bytes(), b";", &[scip::check(text.as_bytes())], b"\n"].concat();
    let model = std::iter::once(line("MODL:UTM-30LX-EW".into()));
    model.chain(numbers.map(|(key, value)| line(format!("{key}:{value}")))).collect()
}

fn trimmed(line: &[u8]) -> &[u8] {
    line.strip_suffix(b"\n").unwrap_or(line)
}

#[cfg(test)]
#[path = "lidar_tests.rs"]
mod tests;
