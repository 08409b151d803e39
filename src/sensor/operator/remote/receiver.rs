//! The robot's end of a remote hand, as a function of datagrams and their times. RT: no.

use super::packet::{Datagram, Key, NEVER_US, Nonce, Packet, State, View};
use super::{Refused, VIEW_EVERY};
use crate::base::time::{Span, Stamp};
use crate::msg::{OperatorSample, Status};
use crate::sensor::clock_fit::ClockFit;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

/// A hand that was silent for so long is gone, and another may come.
const HANDOVER: Span = Span::from_ms(1_000);
/// A welcome is good for so long: what is begun with it later was held back on its way.
pub const WELCOME_HOLDS: Span = Span::from_ms(2_000);
/// Welcomes are not sent more often, whoever asks.
const WELCOME_EVERY: Span = Span::from_ms(20);
/// A round trip that was measured longer ago says nothing any more.
const ROUND_TRIP_HOLDS: Span = Span::from_ms(1_000);

/// Who has the switch.
#[derive(Debug)]
struct Session {
    person: Nonce,
    key: Key,
    peer: SocketAddr,
    newest: u64,
    clock: ClockFit,
    heard: Stamp,
    /// When a short round trip was measured last.
    near: Stamp,
    zeroings: u32,
    views: u64,
}

/// The robot's end.
#[derive(Debug)]
pub struct Receiver {
    secret: Key,
    /// The number for the next session, and since when it is told.
    nonce: Nonce,
    told: Stamp,
    next_welcome: Stamp,
    session: Option<Session>,
    operator_age: Span,
    /// What a stick asks for at its end, m/s; none if no stick is wanted.
    highest_m_s: Option<f64>,
    sample: OperatorSample,
    next_view: Stamp,
    refused: Arc<Refused>,
}

impl Receiver {
    /// A round trip beyond `operator_age` is no hand that may press. A hand with a stick is for a robot that wants one, with
    /// its `highest_m_s`: any other would walk by its schedule, whatever the stick says.
    #[must_use]
    pub fn new(secret: Key, operator_age: Span, highest_m_s: Option<f64>) -> Self {
        Self {
            secret,
            nonce: Nonce::default(),
            told: Stamp::NEVER,
            next_welcome: Stamp::NEVER,
            session: None,
            operator_age,
            highest_m_s,
            sample: OperatorSample { stamp: Stamp::NEVER, ..OperatorSample::default() },
            next_view: Stamp::NEVER,
            refused: Arc::default(),
        }
    }

    /// What was not taken.
    #[must_use]
    pub fn refused(&self) -> Arc<Refused> {
        Arc::clone(&self.refused)
    }

    /// How the hand is.
    #[must_use]
    pub const fn sample(&self) -> OperatorSample {
        self.sample
    }

    /// Takes a datagram that arrived at `now`. `chance` gives the number of a session to come. Returns the answer, if any.
    pub fn take(
        &mut self,
        now: Stamp,
        from: SocketAddr,
        bytes: &[u8],
        chance: impl FnOnce() -> Option<Nonce>,
    ) -> Option<Datagram> {
        match Packet::parse(bytes) {
            Some(Packet::Hello(person)) if self.secret.is_authentic(bytes) => self.welcome(now, person, chance),
            Some(Packet::State(_, state)) if state.stick.is_some() && self.highest_m_s.is_none() => {
                self.count(|refused| &refused.unwanted_stick)
            }
            Some(Packet::State(person, state)) => {
                self.hear(now, from, bytes, (person, state));
                None
            }
            Some(Packet::Hello(_)) => self.count(|refused| &refused.not_authentic),
            // Nobody sends these to a robot.
            Some(Packet::Welcome(..) | Packet::View(..)) | None => self.count(|refused| &refused.malformed),
        }
    }

    fn count(&self, which: impl FnOnce(&Refused) -> &AtomicU32) -> Option<Datagram> {
        which(&self.refused).fetch_add(1, Ordering::Relaxed);
        None
    }

    fn welcome(&mut self, now: Stamp, person: Nonce, chance: impl FnOnce() -> Option<Nonce>) -> Option<Datagram> {
        if now < self.next_welcome {
            return None;
        }
        if now.since(self.told) > WELCOME_HOLDS {
            (self.nonce, self.told) = (chance()?, now);
        }
        self.next_welcome = now + WELCOME_EVERY;
        Some(Packet::Welcome(person, self.nonce).sealed(&self.secret))
    }

    fn hear(&mut self, now: Stamp, from: SocketAddr, bytes: &[u8], (person, state): (Nonce, State)) {
        let is_ours = |session: &Session| session.person == person && session.key.is_authentic(bytes);
        let ours = self.session.as_ref().is_some_and(is_ours);
        if !ours && !self.begin(now, from, bytes, (person, state)) {
            return;
        }
        let age = self.operator_age;
        let Some(session) = &mut self.session else { return };
        // The second sending, or something old. The first of a session is newer than none.
        if state.number <= session.newest {
            return;
        }
        if now.since(session.heard) >= HANDOVER {
            // A laptop that slept: its clock stood still, and the switch must be seen open again.
            (session.clock, session.near) = (sender_clock(), Stamp::NEVER);
            self.sample.dead_man = false;
        }
        session.newest = state.number;
        (session.heard, session.peer) = (now, from);
        if round_trip(now, &state).is_some_and(|trip| trip <= age) {
            session.near = now;
        }
        let may_press = session.near != Stamp::NEVER && now.since(session.near) <= ROUND_TRIP_HOLDS;
        let sent = session.clock.map(state.time_us, now);
        let confirmed = state.zeroings != session.zeroings;
        session.zeroings = state.zeroings;
        self.sample = OperatorSample {
            stamp: sent,
            dead_man: state.held && (self.sample.dead_man || may_press),
            sequence: self.sample.sequence.wrapping_add(1),
            zeroings: self.sample.zeroings.wrapping_add(u32::from(confirmed)),
            zero_angle_rad: if confirmed { state.zero_angle_rad } else { self.sample.zero_angle_rad },
            speed_m_s: self.highest_m_s.zip(state.stick).map_or(0.0, |(highest_m_s, share)| highest_m_s * share),
        };
    }

    /// Begins the session of a person who was welcomed lately, if nobody else has the switch.
    fn begin(&mut self, now: Stamp, from: SocketAddr, bytes: &[u8], (person, state): (Nonce, State)) -> bool {
        let key = self.secret.of_session(&person, &self.nonce).filter(|key| key.is_authentic(bytes));
        let Some(key) = key.filter(|_| now.since(self.told) <= WELCOME_HOLDS) else {
            self.count(|refused| &refused.not_authentic);
            return false;
        };
        // Used, whether it begins something or not: nothing can be begun with it again.
        self.told = Stamp::NEVER;
        if self.session.as_ref().is_some_and(|session| now.since(session.heard) < HANDOVER) {
            self.count(|refused| &refused.second_hand);
            return false;
        }
        self.sample.dead_man = false;
        self.session = Some(Session {
            person,
            key,
            peer: from,
            newest: 0,
            clock: sender_clock(),
            heard: now,
            near: Stamp::NEVER,
            zeroings: state.zeroings,
            views: 0,
        });
        true
    }

    /// What the person shall see of the robot, when that is due.
    pub fn view(&mut self, now: Stamp, robot: &Status) -> Option<(SocketAddr, Datagram)> {
        let session = self.session.as_mut().filter(|_| now >= self.next_view)?;
        self.next_view = now + VIEW_EVERY;
        session.views += 1;
        let view = View {
            number: session.views,
            time_us: microseconds(now),
            mode: robot.mode,
            first_fault: robot.first_fault.code,
            arm_blockers: robot.arm_blockers,
            faults: robot.faults,
        };
        Some((session.peer, Packet::View(session.person, view).sealed(&session.key)))
    }
}

/// Of the person's end, in microseconds.
fn sender_clock() -> ClockFit {
    ClockFit::new(1_000_000)
}

/// A clock in microseconds that wraps.
#[expect(clippy::cast_possible_truncation, reason = "it wraps")]
#[must_use]
pub fn microseconds(now: Stamp) -> u32 {
    (now.0 / 1_000).cast_unsigned() as u32
}

/// From a view of ours to the state that told of it, without the time that the person's end sat on it.
fn round_trip(now: Stamp, state: &State) -> Option<Span> {
    let there = microseconds(now).wrapping_sub(state.echo_us).checked_sub(state.echo_age_us)?;
    (state.echo_age_us != NEVER_US).then(|| Span(i64::from(there) * 1_000))
}
