//! A Hokuyo scanner: gets its scans going, finds the floor in each, names what it refuses, and starts over when it falls
//! silent.
//!
//! ```text
//!  Quit ─100 ms→ TM2 → PP → TM0 → TM1 x 8 → TM2 → BM → MD → Streaming
//!   ↑                │ 300 ms without an answer: Silent      │ 140 ms without a byte: Silent, a new connection
//!   │                │ another status: named                 │ 500 ms of damaged scans only: Damaged
//!   └─after a pause──┴───────────────────────────────────────┘ a status instead of a scan: named
//! ```
//! Times: the device's clock (24 bits of milliseconds) is read eight times, and the quickest answer counts; from then on
//! the lower envelope of the scans' delays follows its drift ([`super::clock_fit`]).
//! RT: no, in an ordinary thread; [`link`] is that thread's.

pub mod floor_line;
pub mod link;

use crate::base::time::{Span, Stamp};
use crate::config::checked::Lidar;
use crate::msg::{FloorVerdict, LidarSample, LidarState};
use crate::sensor::clock_fit::ClockFit;
use crate::sensor::scip::{self, Parameters, Reply};
use floor_line::Fitter;

/// After QT whatever still comes is thrown away for so long.
const DRAIN: Span = Span::from_ms(100);
/// A request that is not answered in this time starts the dialogue over.
const ANSWER_TIMEOUT: Span = Span::from_ms(300);
/// A stream without a reply for so long is dead, or its connection half open: five scans and some.
const SILENCE: Span = Span::from_ms(140);
/// A stream without a sound scan for so long starts the dialogue over.
const DAMAGE: Span = Span::from_ms(500);
/// After a refusal it is asked again so much later.
const PAUSE: Span = Span::from_ms(200);
/// Times that the clock is read.
const CLOCK_READINGS: u8 = 8;
/// Scans after which the envelope of the delays has settled.
const SETTLED_SCANS: u32 = 40;
/// Ticks of [`ClockFit`]: the device's milliseconds in the upper 24 of 32 bits, so that both wrap together.
const TICKS_PER_S: u32 = 1000 << 8;

/// Commands in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    LeaveAdjusting,
    Parameters,
    EnterAdjusting,
    Clock(u8),
    EndAdjusting,
    LaserOn,
    Stream,
}

impl Step {
    const fn request(self) -> &'static [u8] {
        match self {
            Self::LeaveAdjusting | Self::EndAdjusting => scip::LEAVE_ADJUSTING,
            Self::Parameters => scip::PARAMETERS,
            Self::EnterAdjusting => scip::ENTER_ADJUSTING,
            Self::Clock(_) => scip::CLOCK,
            Self::LaserOn => scip::LASER_ON,
            Self::Stream => scip::STREAM,
        }
    }

    const fn next(self) -> Option<Self> {
        Some(match self {
            Self::LeaveAdjusting => Self::Parameters,
            Self::Parameters => Self::EnterAdjusting,
            Self::EnterAdjusting => Self::Clock(1),
            Self::Clock(CLOCK_READINGS) => Self::EndAdjusting,
            Self::Clock(n) => Self::Clock(n + 1),
            Self::EndAdjusting => Self::LaserOn,
            Self::LaserOn => Self::Stream,
            Self::Stream => return None,
        })
    }

    /// It does not matter what is answered: there may be nothing to leave, its clock may not be told, the laser be on.
    const fn may_be_refused(self) -> bool {
        !matches!(self, Self::Parameters | Self::Stream)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// QT is due from this time on.
    Quit(Stamp),
    /// QT was sent; what comes until then is old.
    Drain(Stamp),
    /// This request is due, or was sent then and is not answered.
    Ask(Step, Option<Stamp>),
    /// Last reply of any kind, last sound scan.
    Streaming { heard: Stamp, sound: Stamp },
}

/// What was not as it should be, since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LidarCounters {
    /// Times that the dialogue began.
    pub starts: u32,
    /// Scans.
    pub scans: u32,
    /// Replies with a wrong check or length.
    pub damaged: u32,
    /// Scans missing by the device's clock.
    pub missing: u32,
    /// New connections that were asked for.
    pub reconnects: u32,
}

/// Maps the device's clock to ours.
#[derive(Clone, Copy, Debug)]
struct Times {
    fit: ClockFit,
    /// The device's clock, and ours in the middle of the quickest answer, with how long that took.
    read: Option<(u32, Stamp, Span)>,
    /// From a scan's beginning to what the envelope takes for it.
    delay: Span,
    scans: u32,
    last_ms: Option<u32>,
}

impl Times {
    fn new(delay: Span) -> Self {
        Self { fit: ClockFit::new(TICKS_PER_S), read: None, delay, scans: 0, last_ms: None }
    }

    fn note_reading(&mut self, time_ms: u32, asked: Stamp, now: Stamp) {
        let took = now.since(asked);
        if self.read.is_none_or(|(_, _, least)| took < least) {
            self.read = Some((time_ms, asked + Span(took.0 / 2), took));
        }
    }

    /// When a scan began whose last byte arrived at `now`.
    fn begin(&mut self, time_ms: u32, now: Stamp) -> Stamp {
        let envelope = self.fit.map(time_ms << 8, now);
        self.scans = self.scans.saturating_add(1);
        if let Some((read_ms, read_at, _)) = self.read.filter(|_| self.scans <= SETTLED_SCANS) {
            let since_ms = i64::from((time_ms << 8).wrapping_sub(read_ms << 8) >> 8);
            self.delay = envelope.since(read_at + Span::from_ms(since_ms));
        }
        envelope - self.delay
    }

    /// Scans missing since the one before.
    fn missing(&mut self, time_ms: u32, period: Span) -> u32 {
        let Some(last) = self.last_ms.replace(time_ms) else { return 0 };
        let step = Span::from_ms(i64::from((time_ms << 8).wrapping_sub(last << 8) >> 8));
        let scans = (step.0 + period.0 / 2) / period.0.max(1);
        // More than ten seconds: it was switched off.
        if step > Span::from_ms(10_000) { 0 } else { u32::try_from(scans - 1).unwrap_or(0) }
    }
}

/// Reads one scanner.
#[derive(Debug)]
pub struct LidarReader {
    bytes: scip::Reader,
    parameters: Parameters,
    sound_parameters: bool,
    clock_ms: Option<u32>,
    phase: Phase,
    times: Times,
    fitter: Box<Fitter>,
    state: LidarState,
    status: u16,
    wants_connection: bool,
    counters: LidarCounters,
}

impl LidarReader {
    /// For a scanner that is mounted so; the dialogue begins with the first [`Self::transmit`].
    #[must_use]
    #[expect(clippy::disallowed_methods, reason = "before arming")]
    pub fn new(lidar: &Lidar) -> Self {
        Self {
            bytes: scip::Reader::default(),
            parameters: Parameters::default(),
            sound_parameters: true,
            clock_ms: None,
            phase: Phase::Quit(Stamp::NEVER),
            times: Times::new(Span::ZERO),
            fitter: Box::new(Fitter::new(lidar)),
            state: LidarState::Nothing,
            status: 0,
            wants_connection: false,
            counters: LidarCounters::default(),
        }
    }

    /// What was not as it should be.
    #[must_use]
    pub const fn counters(&self) -> &LidarCounters {
        &self.counters
    }

    /// What the scanner has told of itself.
    #[must_use]
    pub const fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// The request that is due now, if any, and what there is to tell. To be called every few milliseconds.
    pub fn transmit(&mut self, now: Stamp, mut each: impl FnMut(&LidarSample)) -> Option<&'static [u8]> {
        match self.phase {
            Phase::Quit(at) if now >= at => {
                self.phase = Phase::Drain(now + DRAIN);
                self.counters.starts = self.counters.starts.saturating_add(1);
                if self.state == LidarState::Nothing {
                    self.tell(now, LidarState::Connecting, &mut each);
                }
                Some(scip::QUIT)
            }
            Phase::Drain(until) if now >= until => {
                self.bytes = scip::Reader::default();
                self.ask(now, Step::LeaveAdjusting)
            }
            Phase::Ask(step, None) => self.ask(now, step),
            Phase::Ask(_, Some(asked)) if now.since(asked) > ANSWER_TIMEOUT => {
                self.fall_silent(now, &mut each);
                None
            }
            Phase::Streaming { heard, .. } if now.since(heard) > SILENCE => {
                self.fall_silent(now, &mut each);
                None
            }
            Phase::Streaming { sound, .. } if now.since(sound) > DAMAGE => {
                self.tell(now, LidarState::Damaged, &mut each);
                self.phase = Phase::Quit(now);
                None
            }
            _ => None,
        }
    }

    /// True once after each time that the connection should be made anew.
    pub const fn takes_new_connection(&mut self) -> bool {
        std::mem::replace(&mut self.wants_connection, false)
    }

    /// There is a new connection: the dialogue begins.
    pub const fn connected(&mut self, now: Stamp) {
        self.phase = Phase::Quit(now);
    }

    /// There is nobody to talk to.
    pub fn gone(&mut self, now: Stamp, mut each: impl FnMut(&LidarSample)) {
        self.phase = Phase::Quit(now + PAUSE);
        self.tell(now, LidarState::Gone, &mut each);
    }

    /// Takes bytes that arrived at `now`; tells what is in them.
    pub fn receive(&mut self, now: Stamp, bytes: &[u8], mut each: impl FnMut(&LidarSample)) {
        for byte in bytes {
            if matches!(self.phase, Phase::Quit(_) | Phase::Drain(_)) {
                return;
            }
            let (parameters, sound, clock) = (&mut self.parameters, &mut self.sound_parameters, &mut self.clock_ms);
            let reply = self.bytes.push(*byte, |line| {
                *sound &= parameters.take(line);
                if line.len() == 4 {
                    *clock = scip::decode(line);
                }
            });
            if let Some(reply) = reply {
                self.take(now, reply, &mut each);
            }
        }
    }

    fn take(&mut self, now: Stamp, reply: Reply, each: &mut impl FnMut(&LidarSample)) {
        if reply == Reply::Damaged {
            self.counters.damaged = self.counters.damaged.saturating_add(1);
        }
        match self.phase {
            Phase::Ask(step, Some(asked)) => self.answered(now, step, asked, reply, each),
            Phase::Streaming { sound, .. } => self.streamed(now, sound, reply, each),
            Phase::Ask(_, None) | Phase::Quit(_) | Phase::Drain(_) => {}
        }
    }

    fn answered(&mut self, now: Stamp, step: Step, asked: Stamp, reply: Reply, each: &mut impl FnMut(&LidarSample)) {
        let accepted = match reply {
            Reply::Lines => true,
            Reply::Status(status) => status == *b"00",
            // A scan of before, or a broken answer: the time-out decides.
            Reply::Scan | Reply::Damaged => return,
        };
        if let Reply::Status(status) = reply
            && !accepted
            && !step.may_be_refused()
        {
            return self.refuse(now, status, each);
        }
        match (step, self.clock_ms.take()) {
            (Step::Parameters, _) if !(self.sound_parameters && self.parameters.is_sound()) => {
                return self.refuse(now, *b"00", each);
            }
            (Step::Parameters, _) => self.times = Times::new(self.parameters.delay(self.parameters.last)),
            (Step::Clock(_), Some(time_ms)) => self.times.note_reading(time_ms, asked, now),
            _ => {}
        }
        self.phase = match step.next() {
            Some(next) => Phase::Ask(next, None),
            None => Phase::Streaming { heard: now, sound: now },
        };
    }

    fn streamed(&mut self, now: Stamp, sound: Stamp, reply: Reply, each: &mut impl FnMut(&LidarSample)) {
        match reply {
            Reply::Scan => {
                self.phase = Phase::Streaming { heard: now, sound: now };
                self.scan(now, each);
            }
            Reply::Damaged | Reply::Lines => self.phase = Phase::Streaming { heard: now, sound },
            // Its motor comes back to speed: the stream goes on by itself.
            Reply::Status(status) if status == *b"98" => self.phase = Phase::Streaming { heard: now, sound },
            Reply::Status(status) => self.refuse(now, status, each),
        }
    }

    fn scan(&mut self, now: Stamp, each: &mut impl FnMut(&LidarSample)) {
        let (scan, parameters) = (self.bytes.scan(), self.parameters);
        let line = self.fitter.fit(scan, &parameters);
        let missing = self.times.missing(scan.time_ms, parameters.delay(parameters.steps_per_turn));
        let begin = self.times.begin(scan.time_ms, now);
        self.counters.scans = self.counters.scans.saturating_add(1);
        self.counters.missing = self.counters.missing.saturating_add(missing);
        (self.state, self.status) = (LidarState::Streaming, u16::from_be_bytes(*b"99"));
        let [lean_rad, lean_sigma_rad] = line.lean_rad;
        let [height_m, height_sigma_m] = line.height_m;
        each(&LidarSample {
            stamp: begin + parameters.delay(line.step),
            verdict: line.verdict,
            lean_rad,
            lean_sigma_rad,
            height_m,
            height_sigma_m,
            roughness_m: line.roughness_m,
            points: line.points,
            used: line.used,
            ..self.sample(now)
        });
    }

    fn ask(&mut self, now: Stamp, step: Step) -> Option<&'static [u8]> {
        if step == Step::Parameters {
            (self.parameters, self.sound_parameters) = (Parameters::default(), true);
        }
        self.clock_ms = None;
        self.phase = Phase::Ask(step, Some(now));
        Some(step.request())
    }

    fn fall_silent(&mut self, now: Stamp, each: &mut impl FnMut(&LidarSample)) {
        self.phase = Phase::Quit(now);
        self.wants_connection = true;
        self.counters.reconnects = self.counters.reconnects.saturating_add(1);
        self.tell(now, LidarState::Silent, each);
    }

    fn refuse(&mut self, now: Stamp, status: [u8; 2], each: &mut impl FnMut(&LidarSample)) {
        self.phase = Phase::Quit(now + PAUSE);
        self.status = u16::from_be_bytes(status);
        self.tell(now, state_of(status), each);
    }

    /// Tells another state; the same one again is no news.
    fn tell(&mut self, now: Stamp, state: LidarState, each: &mut impl FnMut(&LidarSample)) {
        if self.state != state {
            self.state = state;
            each(&self.sample(now));
        }
    }

    fn sample(&self, now: Stamp) -> LidarSample {
        let LidarCounters { starts, scans, damaged, missing, .. } = self.counters;
        LidarSample {
            stamp: now,
            arrived: now,
            state: self.state,
            status: self.status,
            verdict: FloorVerdict::None,
            scans,
            damaged,
            missing,
            starts,
            ..LidarSample::default()
        }
    }
}

/// What a status means that is no yes.
fn state_of(status: [u8; 2]) -> LidarState {
    match &status {
        b"0E" => LidarState::NotReady,
        b"10" => LidarState::LaserOff,
        [b'5'..=b'8', _] | [b'9', b'0'..=b'7'] => LidarState::Hardware,
        _ => LidarState::Refused,
    }
}

#[cfg(test)]
mod tests;
