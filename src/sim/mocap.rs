//! A simulated server of motion capture: NatNet 4.1 (or 3.0) or Vicon's UDP objects, its clock, latency and datagrams.
//! The room: x forward along the mean ground, y up from it, z across; the origin is where the world has its own. RT: no.

use super::noise::Noise;
use super::{Place, Reading};
use crate::base::bytes::padded;
use crate::base::time::{Span, Stamp};
use crate::config::checked::{Mocap, MocapServer, MocapSource};
use crate::config::fault::{FaultName, Injection};
use crate::sensor::natnet::Version;
use std::collections::VecDeque;

/// The server's clock, ticks per second.
const CLOCK_HZ: u64 = 10_000_000;
/// What it shows when we switch on.
const CLOCK_START: u64 = 987_654_321;
/// It jumps by so much.
const JUMP_S: u64 = 3600;
/// A frame that is overtaken comes so many frames later.
const OVERTAKEN_FRAMES: i64 = 3;
/// A plain server: as many frames as the cameras of such rooms make, at once.
const PLAIN: MocapServer = MocapServer { rate_hz: 100, latency: Span::ZERO, noise_m: 0.0 };
/// Versions that it can speak.
const VERSIONS: [Version; 2] = [Version { major: 4, minor: 1 }, Version { major: 3, minor: 0 }];

/// The server.
#[derive(Clone, Debug)]
pub struct SimMocap {
    source: MocapSource,
    server: MocapServer,
    noise: Noise,
    next: Stamp,
    frame: u32,
    version: Version,
    /// Somebody has asked for frames; Vicon asks nobody.
    has_client: bool,
    clock_offset: u64,
    pose: Pose,
    line: VecDeque<(Stamp, Vec<u8>)>,
    trouble: Trouble,
}

#[derive(Clone, Copy, Debug, Default)]
struct Pose {
    position_m: [f64; 3],
    angle_rad: f64,
}

#[derive(Clone, Debug)]
struct Trouble {
    untracked: bool,
    frozen: bool,
    gaps: Option<f64>,
    reordered: Option<f64>,
    section: bool,
    draws: Noise,
}

impl SimMocap {
    /// Switched on at time zero.
    #[must_use]
    pub fn new(mocap: &Mocap, server: Option<&MocapServer>, seed: u64) -> Self {
        Self {
            source: mocap.source.clone(),
            server: server.copied().unwrap_or(PLAIN),
            noise: Noise::new(seed ^ 0x6D63_6101),
            next: Stamp::default(),
            frame: 0,
            version: VERSIONS[0],
            has_client: matches!(mocap.source, MocapSource::Vicon { .. }),
            clock_offset: CLOCK_START,
            pose: Pose::default(),
            line: VecDeque::new(),
            trouble: Trouble {
                untracked: false,
                frozen: false,
                gaps: None,
                reordered: None,
                section: false,
                draws: Noise::new(seed ^ 0x6D63_6102),
            },
        }
    }

    /// Something breaks, or is whole again.
    pub(super) fn suffer(&mut self, fault: &Injection, on: bool) {
        let trouble = &mut self.trouble;
        match fault.entry.fault {
            FaultName::MocapUntracked => trouble.untracked = on,
            FaultName::MocapFrozen => trouble.frozen = on,
            FaultName::MocapGaps => trouble.gaps = on.then_some(fault.share),
            FaultName::MocapReordered => trouble.reordered = on.then_some(fault.share),
            FaultName::MocapSection => trouble.section = on,
            FaultName::MocapVersion => self.version = VERSIONS[usize::from(on)],
            FaultName::MocapClockJump if on => self.clock_offset += JUMP_S * CLOCK_HZ,
            _ => {}
        }
    }

    /// Switched on at another time.
    pub(super) const fn start_at(&mut self, now: Stamp) {
        self.next = now;
    }

    /// When the cameras look next.
    #[must_use]
    pub const fn next_measurement(&self) -> Stamp {
        self.next
    }

    /// The cameras look, and the server sends.
    pub fn measure(&mut self, now: Stamp, reading: &Reading, place: &Place) {
        let period = Span(1_000_000_000 / i64::from(self.server.rate_hz.max(1)));
        self.next = now + period;
        self.frame += 1;
        let sees = !self.trouble.untracked && !self.trouble.frozen;
        if sees {
            let [x, y] = place.hip_m;
            let [inner, outer] = reading.leg_angle_rad;
            let position_m = [x, y, 0.0].map(|p| p + self.server.noise_m * self.noise.normal());
            self.pose = Pose { position_m, angle_rad: 0.5 * (inner + outer) + place.slope_rad };
        }
        if !self.has_client || self.trouble.gaps.is_some_and(|share| self.trouble.draws.uniform() < share) {
            return;
        }
        let bytes = match &self.source {
            MocapSource::NatNet { body, .. } => self.natnet(now, *body),
            MocapSource::Vicon { body } => self.vicon(body),
        };
        let late = self.trouble.reordered.is_some_and(|share| self.trouble.draws.uniform() < share);
        let by = if late { OVERTAKEN_FRAMES * period.0 + period.0 / 2 } else { 0 };
        let at = now + self.server.latency + Span(by);
        let place = self.line.partition_point(|(other, _)| *other <= at);
        self.line.insert(place, (at, bytes));
    }

    /// A datagram from the host.
    pub fn hear(&mut self, now: Stamp, datagram: &[u8]) {
        if !matches!(self.source, MocapSource::NatNet { .. }) {
            return;
        }
        self.has_client = true;
        if datagram.first() == Some(&0) {
            let mut payload = padded::<260>(b"simulated server").to_vec();
            payload.extend([self.version.major, self.version.minor, 0, 0]);
            payload.extend(CLOCK_HZ.to_le_bytes());
            let place = self.line.partition_point(|(other, _)| *other <= now);
            self.line.insert(place, (now, message(1, &payload)));
        }
    }

    /// A datagram that has arrived at the host by now.
    pub fn take(&mut self, now: Stamp) -> Option<Vec<u8>> {
        self.line.front().filter(|(at, _)| *at <= now)?;
        self.line.pop_front().map(|(_, bytes)| bytes)
    }

    /// A frame (docs/protocols.md, section 10): our body, a marker beside it, nothing else.
    fn natnet(&self, now: Stamp, body: u32) -> Vec<u8> {
        let mut out = self.frame.to_le_bytes().to_vec();
        let section = |out: &mut Vec<u8>, count: u32, items: &[u8]| {
            out.extend(count.to_le_bytes());
            if self.version.major >= 4 {
                out.extend(u32::try_from(items.len()).unwrap_or(u32::MAX).to_le_bytes());
            }
            out.extend(items);
        };
        section(&mut out, 0, &[]);
        section(&mut out, 1, &[0; 12]);
        let (sin, cos) = libm::sincos(0.5 * self.pose.angle_rad);
        let numbers = self.pose.position_m.into_iter().chain([0.0, 0.0, sin, cos, 0.0005]);
        let mut item = body.to_le_bytes().to_vec();
        numbers.for_each(|x| item.extend(single(x).to_le_bytes()));
        item.extend(u16::from(!self.trouble.untracked).to_le_bytes());
        section(&mut out, 1, &item);
        section(&mut out, 0, &[]);
        if self.version.major >= 4 {
            section(&mut out, 0, &[]);
        }
        for _ in 0..3 {
            section(&mut out, 0, &[]);
        }
        if self.trouble.section {
            section(&mut out, 2, &[0xA5; 24]);
        }
        out.extend([0; 16]);
        out.extend(self.ticks(now).to_le_bytes());
        out.extend([0; 16]);
        out.extend([0; 6]);
        message(7, &out)
    }

    fn ticks(&self, now: Stamp) -> u64 {
        self.clock_offset + u64::try_from(now.0).unwrap_or(0) / (1_000_000_000 / CLOCK_HZ)
    }

    /// A block (docs/protocols.md, section 11).
    fn vicon(&self, body: &str) -> Vec<u8> {
        let mut out = self.frame.to_le_bytes().to_vec();
        out.extend([1, u8::from(self.trouble.section), 72, 0]);
        out.extend(padded::<24>(body.as_bytes()));
        let [x, y, z] = self.pose.position_m.map(|m| 1e3 * m);
        let numbers = if self.trouble.untracked { [0.0; 6] } else { [x, y, z, 0.0, 0.0, self.pose.angle_rad] };
        numbers.iter().for_each(|x| out.extend(x.to_le_bytes()));
        out.resize(256, 0);
        out
    }
}

fn message(id: u16, payload: &[u8]) -> Vec<u8> {
    [&id.to_le_bytes()[..], &u16::try_from(payload.len()).unwrap_or(u16::MAX).to_le_bytes(), payload].concat()
}

#[expect(clippy::cast_possible_truncation, reason = "the wire carries single precision")]
const fn single(x: f64) -> f32 {
    x as f32
}
