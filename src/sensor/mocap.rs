//! Motion capture: datagrams to poses of the robot's body, with what is missing among them. Ground truth for recordings;
//! no tick looks at it. RT: no, in an ordinary thread.

use super::clock_fit::ClockFit;
use super::natnet::{self, Message, Version};
use super::vicon;
use crate::base::time::{Span, Stamp};
use crate::config::checked::{Mocap, MocapSource};
use crate::msg::MocapSample;

/// A pose that is the same to the bit for so many frames is no measurement, whatever the server says of it.
const FROZEN_FRAMES: u32 = 10;
/// A number that is lower by more than this is a server that began anew; by less, a frame that was overtaken.
const OVERTAKEN: u32 = 1000;
/// So many frames in a row that are damaged or lack our body: the server may speak another version, and is asked again.
const ASK_AGAIN: u32 = 10;
/// The server's clock and ours run apart by so much between two frames only if one of them was set.
const CLOCK_JUMP: Span = Span::from_ms(1000);
/// Without a frame for so long the server is silent.
const SILENCE: Span = Span::from_ms(500);
/// Trouble is over when the poses have been sound for so long.
const SOUND_FOR: Span = Span::from_ms(200);
/// NatNet's clock as we count it.
const TICKS_PER_S: u32 = 1_000_000;

/// What was not as it should be, since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MocapCounters {
    /// Datagrams that are no whole message.
    pub damaged: u32,
    /// Frames missing by their number.
    pub missing: u32,
    /// Frames that came after a newer one.
    pub overtaken: u32,
    /// Frames without our body.
    pub without_body: u32,
    /// Times that the server's clock was set.
    pub clock_jumps: u32,
}

/// What is wrong with the poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MocapTrouble {
    /// The server says that its cameras do not see the body.
    Untracked,
    /// The pose is the same to the bit, though the server calls it tracked.
    Frozen,
    /// Frames are missing.
    FramesMissing,
    /// Frames come out of order.
    OutOfOrder,
    /// Datagrams that cannot be read.
    Unreadable,
    /// Frames without our body.
    BodyMissing,
    /// The server's clock was set.
    ClockJumped,
    /// Nothing comes.
    Silent,
}

impl MocapTrouble {
    /// Its name as written in the code.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Untracked => "Untracked",
            Self::Frozen => "Frozen",
            Self::FramesMissing => "FramesMissing",
            Self::OutOfOrder => "OutOfOrder",
            Self::Unreadable => "Unreadable",
            Self::BodyMissing => "BodyMissing",
            Self::ClockJumped => "ClockJumped",
            Self::Silent => "Silent",
        }
    }

    /// As a person is told.
    #[must_use]
    pub const fn in_words(self) -> &'static str {
        match self {
            Self::Untracked => "the cameras do not see the robot",
            Self::Frozen => "the pose is frozen, though it is called tracked",
            Self::FramesMissing => "frames are missing",
            Self::OutOfOrder => "frames come out of order",
            Self::Unreadable => "datagrams cannot be read; another version?",
            Self::BodyMissing => "the robot's body is not in the frames; another version?",
            Self::ClockJumped => "the server's clock was set",
            Self::Silent => "nothing comes",
        }
    }
}

/// What there is to tell of the poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MocapNews {
    /// Something is wrong.
    Trouble(MocapTrouble),
    /// It is over.
    Sound,
}

/// What was told, and since when there is nothing more to tell.
#[derive(Clone, Copy, Debug)]
struct Watch {
    counters: MocapCounters,
    /// As bits, until all is sound again.
    told: u16,
    /// Trouble, or nothing yet, until then.
    bad: Stamp,
    heard: Stamp,
    /// Of the newest pose.
    unseen: Option<MocapTrouble>,
}

/// Reads one source.
#[derive(Clone, Debug)]
pub struct MocapReader {
    source: Source,
    last_frame: Option<u32>,
    /// The newest pose and for how many frames it has been the same.
    pose: ([u64; 7], u32),
    counters: MocapCounters,
    /// Frames in a row that were of no use.
    useless: u32,
    /// The server has to be asked at once who it is.
    must_ask: bool,
    watch: Watch,
}

#[derive(Clone, Debug)]
enum Source {
    NatNet { body: u32, server: Option<Server> },
    Vicon { body: [u8; 24] },
}

/// What a NatNet server has said of itself.
#[derive(Clone, Copy, Debug)]
struct Server {
    version: Version,
    clock_hz: u64,
    fit: ClockFit,
    /// The last exposure by its clock and arrival by ours.
    last: Option<(u64, Stamp)>,
}

/// A pose in a frame.
struct Seen {
    frame: u32,
    body: u32,
    exposed: Stamp,
    tracked: bool,
    position_m: [f64; 3],
    quaternion: [f64; 4],
}

impl MocapReader {
    /// For the configured body.
    #[must_use]
    pub fn new(config: &Mocap) -> Self {
        let source = match &config.source {
            MocapSource::NatNet { body, .. } => Source::NatNet { body: *body, server: None },
            MocapSource::Vicon { body } => Source::Vicon { body: crate::base::bytes::padded(body.as_bytes()) },
        };
        let counters = MocapCounters::default();
        let watch = Watch { counters, told: 0, bad: Stamp::NEVER, heard: Stamp::NEVER, unseen: None };
        Self { source, last_frame: None, pose: ([0; 7], 0), counters, useless: 0, must_ask: false, watch }
    }

    /// What a NatNet server has to hear now: it sends to single clients only as long as they speak. To be said once a second.
    #[must_use]
    pub const fn request(&self) -> Option<&'static [u8]> {
        match &self.source {
            Source::NatNet { server: None, .. } => Some(&natnet::CONNECT),
            Source::NatNet { server: Some(_), .. } => Some(&natnet::KEEP_ALIVE),
            Source::Vicon { .. } => None,
        }
    }

    /// True once after each time that the server has to be asked at once, not at the next second.
    pub const fn takes_question(&mut self) -> bool {
        std::mem::replace(&mut self.must_ask, false)
    }

    /// What was not as it should be.
    #[must_use]
    pub const fn counters(&self) -> &MocapCounters {
        &self.counters
    }

    /// What there is to tell now, each trouble once. To be asked after every datagram, and now and then without one.
    pub fn news(&mut self, now: Stamp) -> Option<MocapNews> {
        let (before, counters) = (self.watch.counters, self.counters);
        self.watch.counters = counters;
        let grown = |of: fn(&MocapCounters) -> u32, trouble| (of(&counters) > of(&before)).then_some(trouble);
        let silent = self.watch.heard != Stamp::NEVER && now.since(self.watch.heard) > SILENCE;
        let trouble = grown(|c| c.damaged, MocapTrouble::Unreadable)
            .or_else(|| grown(|c| c.without_body, MocapTrouble::BodyMissing))
            .or_else(|| grown(|c| c.clock_jumps, MocapTrouble::ClockJumped))
            .or_else(|| grown(|c| c.overtaken, MocapTrouble::OutOfOrder))
            .or_else(|| grown(|c| c.missing, MocapTrouble::FramesMissing))
            .or_else(|| silent.then_some(MocapTrouble::Silent))
            .or(self.watch.unseen);
        if let Some(trouble) = trouble {
            self.watch.bad = now;
            let (told, bit) = (self.watch.told, 1 << trouble as u16);
            self.watch.told |= bit;
            return (told & bit == 0).then_some(MocapNews::Trouble(trouble));
        }
        let is_over = self.watch.told != 0 && now.since(self.watch.bad) >= SOUND_FOR;
        is_over.then(|| {
            self.watch.told = 0;
            MocapNews::Sound
        })
    }

    /// Takes a datagram that arrived at `now`; gives the pose of our body if it holds one.
    pub fn take(&mut self, now: Stamp, datagram: &[u8]) -> Option<MocapSample> {
        let before = self.counters;
        let sample = self.read(now, datagram);
        self.watch.heard = now;
        let useless = self.counters.damaged > before.damaged || self.counters.without_body > before.without_body;
        self.useless = if useless { self.useless + 1 } else { 0 };
        if let Source::NatNet { server, .. } = &mut self.source
            && self.useless >= ASK_AGAIN
        {
            (*server, self.useless, self.must_ask) = (None, 0, true);
        }
        sample
    }

    fn read(&mut self, now: Stamp, datagram: &[u8]) -> Option<MocapSample> {
        let before = self.counters;
        let seen = match &mut self.source {
            Source::NatNet { body, server } => take_natnet(now, datagram, *body, server, &mut self.counters),
            Source::Vicon { body } => take_vicon(now, datagram, body, &mut self.counters),
        }?;
        let Some(seen) = seen else {
            self.counters.without_body = before.without_body.saturating_add(1);
            return None;
        };
        self.follow(seen.frame).then(|| self.sample(now, &seen))
    }

    /// Looks at the frame's number; false if a newer one came before.
    fn follow(&mut self, frame: u32) -> bool {
        let Some(last) = self.last_frame else {
            self.last_frame = Some(frame);
            return true;
        };
        if last.checked_sub(frame).is_some_and(|behind| behind < OVERTAKEN) {
            self.counters.overtaken = self.counters.overtaken.saturating_add(1);
            return false;
        }
        self.last_frame = Some(frame);
        let missing = frame.saturating_sub(last).saturating_sub(1);
        self.counters.missing = self.counters.missing.saturating_add(missing);
        true
    }

    fn sample(&mut self, now: Stamp, seen: &Seen) -> MocapSample {
        let [x, y, z] = seen.position_m;
        let [qx, qy, qz, qw] = seen.quaternion;
        let bits = [x, y, z, qx, qy, qz, qw].map(f64::to_bits);
        self.pose = (bits, if bits == self.pose.0 { self.pose.1.saturating_add(1) } else { 0 });
        let frozen = self.pose.1 >= FROZEN_FRAMES;
        self.watch.unseen = match (seen.tracked, frozen) {
            (false, _) => Some(MocapTrouble::Untracked),
            (true, true) => Some(MocapTrouble::Frozen),
            (true, false) => None,
        };
        MocapSample {
            stamp: seen.exposed,
            arrived: now,
            frame: seen.frame,
            body: seen.body,
            tracked: seen.tracked && !frozen,
            position_m: seen.position_m,
            quaternion: seen.quaternion,
            missing: self.counters.missing,
        }
    }
}

/// The outer `None`: no frame. The inner one: a frame without our body.
#[expect(clippy::option_option, reason = "two different things that are not there")]
fn take_natnet(
    now: Stamp,
    datagram: &[u8],
    wanted: u32,
    server: &mut Option<Server>,
    counters: &mut MocapCounters,
) -> Option<Option<Seen>> {
    // Before the server has told its layout a frame cannot be read; who it is, in any.
    let version = server.map_or(Version { major: 3, minor: 0 }, |server| server.version);
    let mut ours = None;
    let message = natnet::read(datagram, version, |body| {
        if body.id == wanted {
            ours = Some(body);
        }
    });
    match (message, server) {
        (Ok(Message::Server(info)), server) => {
            let fit = ClockFit::new(TICKS_PER_S);
            *server = Some(Server { version: info.version, clock_hz: info.clock_hz, fit, last: None });
            None
        }
        (Ok(Message::Frame(head)), Some(server)) => Some(ours.map(|body| Seen {
            frame: head.number,
            body: body.id,
            exposed: server.exposed(now, head.exposed_ticks, counters),
            tracked: body.tracked && body.position_m.iter().chain(&body.quaternion).all(|x| x.is_finite()),
            position_m: body.position_m.map(f64::from),
            quaternion: body.quaternion.map(f64::from),
        })),
        (Ok(_) | Err(_), None) | (Ok(Message::Other(_)), Some(_)) => None,
        (Err(_), Some(_)) => {
            counters.damaged = counters.damaged.saturating_add(1);
            None
        }
    }
}

impl Server {
    /// When the cameras saw it, on our clock; when it arrived if the server tells no time.
    fn exposed(&mut self, now: Stamp, ticks: u64, counters: &mut MocapCounters) -> Stamp {
        if self.clock_hz == 0 || ticks == 0 {
            return now;
        }
        if let Some((last_ticks, last_at)) = self.last.replace((ticks, now)) {
            let hz = i128::from(self.clock_hz);
            let theirs_ns = (i128::from(ticks) - i128::from(last_ticks)) * 1_000_000_000 / hz;
            let apart_ns = theirs_ns - i128::from(now.since(last_at).0);
            if apart_ns.abs() > i128::from(CLOCK_JUMP.0) {
                counters.clock_jumps = counters.clock_jumps.saturating_add(1);
                self.fit = ClockFit::new(TICKS_PER_S);
            }
        }
        let microseconds = u128::from(ticks) * u128::from(TICKS_PER_S) / u128::from(self.clock_hz);
        // It wraps after 71 minutes, as the fit knows.
        #[expect(clippy::cast_possible_truncation, reason = "it wraps")]
        self.fit.map(microseconds as u32, now)
    }
}

#[expect(clippy::option_option, reason = "two different things that are not there")]
fn take_vicon(now: Stamp, datagram: &[u8], body: &[u8; 24], counters: &mut MocapCounters) -> Option<Option<Seen>> {
    let mut ours = None;
    let frame = vicon::read(datagram, |object| {
        if object.name == *body {
            ours = Some(object);
        }
    });
    let Some(frame) = frame else {
        counters.damaged = counters.damaged.saturating_add(1);
        return None;
    };
    Some(ours.map(|object| Seen {
        frame,
        body: 0,
        exposed: now,
        tracked: object.is_seen(),
        position_m: object.position_m,
        quaternion: object.quaternion(),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::time::Span;
    use crate::config;

    fn reader(keys: &[&str]) -> MocapReader {
        let keys: Vec<String> = keys.iter().map(|key| format!("robot.mocap.{key}")).collect();
        MocapReader::new(config::load(None, &keys).unwrap().config.robot.mocap.as_ref().unwrap())
    }

    fn vicon() -> MocapReader {
        reader(&["source=vicon", "listen=\"127.0.0.1:51001\"", "body=\"robot\""])
    }

    fn natnet() -> MocapReader {
        reader(&["source=natnet", "listen=\"127.0.0.1:1511\"", "server=\"127.0.0.1:1510\"", "body=\"7\""])
    }

    fn at(ms: i64) -> Stamp {
        Stamp(1_000_000_000) + Span::from_ms(ms)
    }

    fn vicon_block(frame: u32, name: &str, x_mm: f64) -> Vec<u8> {
        let mut out = [&frame.to_le_bytes()[..], &[1, 0, 72, 0]].concat();
        out.extend(crate::base::bytes::padded::<24>(name.as_bytes()));
        [x_mm, 0.0, 0.0, 0.0, 0.0, 0.0].iter().for_each(|x| out.extend(x.to_le_bytes()));
        out
    }

    #[test]
    fn a_body_is_found_by_its_name_and_gaps_and_overtaken_frames_are_counted() {
        let mut reader = vicon();
        assert!(reader.request().is_none());
        let frames = [1, 2, 5, 4, 6];
        let got: Vec<u32> = frames
            .iter()
            .filter_map(|n| reader.take(at(i64::from(*n)), &vicon_block(*n, "robot", f64::from(*n))))
            .map(|sample| sample.frame)
            .collect();
        assert_eq!(got, [1, 2, 5, 6]);
        assert!(reader.take(at(10), &vicon_block(7, "box", 1.0)).is_none());
        assert!(reader.take(at(11), &[1, 2, 3]).is_none());
        let expected = MocapCounters { damaged: 1, missing: 2, overtaken: 1, without_body: 1, clock_jumps: 0 };
        assert_eq!(*reader.counters(), expected);
        // The server begins anew.
        let mut reader = vicon();
        reader.take(at(0), &vicon_block(90_000, "robot", 1.0));
        assert!(reader.take(at(10), &vicon_block(1, "robot", 1.0)).is_some());
    }

    #[test]
    fn a_pose_that_stays_the_same_to_the_bit_is_no_measurement() {
        let mut reader = vicon();
        let tracked: Vec<bool> = (0..40)
            .filter_map(|n| reader.take(at(n), &vicon_block(n as u32, "robot", if n < 30 { 5.0 } else { 6.0 })))
            .map(|sample| sample.tracked)
            .collect();
        assert_eq!(tracked.iter().filter(|t| **t).count(), 20, "ten of the first, ten of the second");
        assert!(tracked[..10].iter().all(|t| *t) && tracked[30..].iter().all(|t| *t));
        assert!(!vicon().take(at(0), &vicon_block(1, "robot", 0.0)).unwrap().tracked, "all zeros: occluded");
    }

    fn server_info() -> Vec<u8> {
        let mut payload = vec![0; 260];
        payload.extend([3, 1, 0, 0]);
        payload.extend(10_000_000_u64.to_le_bytes());
        [&[1, 0][..], &u16::try_from(payload.len()).unwrap().to_le_bytes(), &payload].concat()
    }

    /// A frame of version 3 with one body and nothing else.
    fn natnet_frame(frame: u32, ticks: u64, flags: u16) -> Vec<u8> {
        let mut payload = frame.to_le_bytes().to_vec();
        payload.extend([0; 8]);
        payload.extend([1, 0, 0, 0, 7, 0, 0, 0]);
        [1.0_f32, 2.0, frame as f32, 0.0, 0.0, 0.0, 1.0, 0.0].iter().for_each(|x| payload.extend(x.to_le_bytes()));
        payload.extend(flags.to_le_bytes());
        payload.extend([0; 16]);
        payload.extend([0; 16]);
        payload.extend(ticks.to_le_bytes());
        payload.extend([0; 22]);
        [&[7, 0][..], &u16::try_from(payload.len()).unwrap().to_le_bytes(), &payload].concat()
    }

    #[test]
    fn a_server_is_asked_first_and_its_clock_gives_the_times() {
        let mut reader = natnet();
        assert_eq!(reader.request(), Some(&natnet::CONNECT[..]));
        assert!(reader.take(at(0), &natnet_frame(1, 5, 1)).is_none(), "its layout is not known");
        assert!(reader.take(at(1), &server_info()).is_none());
        assert_eq!(reader.request(), Some(&natnet::KEEP_ALIVE[..]));
        // 100 Hz; each arrives 2 to 9 ms after its exposure.
        let samples: Vec<MocapSample> = (0..50)
            .map(|n| {
                let late = 2 + (n * 3) % 8;
                reader.take(at(100 + 10 * n + late), &natnet_frame(n as u32, 77 + 100_000 * n as u64, 1)).unwrap()
            })
            .collect();
        for (n, sample) in samples.iter().enumerate().skip(10) {
            let error = sample.stamp.since(at(102 + 10 * n as i64)).0.abs();
            assert!(error < 20_000, "frame {n}: {error} ns");
            assert!(
                sample.tracked
                    && sample.position_m.map(f64::to_bits) == [1.0, 2.0, n as f64].map(f64::to_bits)
                    && sample.body == 7
            );
        }
        let lost = reader.take(at(700), &natnet_frame(60, 77 + 6_000_000, 0)).unwrap();
        assert!(!lost.tracked, "the flag says that it is an old pose");
        assert_eq!(reader.counters().missing, 10);
    }
}
