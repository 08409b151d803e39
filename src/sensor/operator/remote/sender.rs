//! The person's end of a remote hand, as a function of datagrams and their times. RT: no.

use super::VIEW_EVERY;
use super::packet::{Datagram, Key, NEVER_US, Nonce, Packet, State, View};
use super::receiver::microseconds;
use crate::base::time::{Span, Stamp};

/// Between two hellos.
const HELLO_EVERY: Span = Span::from_ms(100);
/// A robot that showed nothing for so long may have begun anew: 30 views, of which at 30 % loss all are lost once in 10^15 s.
const LOST_AFTER: Span = Span::from_ms(3_000);

/// A robot that has our session still shows something within this of a welcome: only its words were lost, and the switch stays held.
const VIEW_COMES_WITHIN: Span = Span(5 * VIEW_EVERY.0);

/// The person's end.
#[derive(Debug)]
pub struct Sender {
    secret: Key,
    person: Nonce,
    session: Option<Key>,
    next_hello: Stamp,
    /// When the robot was heard last.
    heard: Stamp,
    /// The key of a session that the robot offers while it may still have ours, and when it did.
    offered: Option<(Key, Stamp)>,
    /// The newest view and when it came.
    view: Option<(View, Stamp)>,
    number: u64,
    zeroings: u32,
    zero_angle_rad: f64,
}

impl Sender {
    /// `person`: bytes of chance, new for each run.
    #[must_use]
    pub fn new(secret: Key, person: Nonce) -> Self {
        Self {
            secret,
            person,
            session: None,
            next_hello: Stamp::NEVER,
            heard: Stamp::NEVER,
            offered: None,
            view: None,
            number: 0,
            zeroings: 0,
            zero_angle_rad: 0.0,
        }
    }

    /// A greeting, if one is due: without a session, or when the robot may have begun anew.
    pub fn hello(&mut self, now: Stamp) -> Option<Datagram> {
        let in_session = self.session.is_some() && now.since(self.heard) <= LOST_AFTER;
        if in_session || now < self.next_hello {
            return None;
        }
        self.next_hello = now + HELLO_EVERY;
        Some(Packet::Hello(self.person).sealed(&self.secret))
    }

    /// The person confirms the hip's zero at this angle.
    pub const fn confirm_zero(&mut self, angle_rad: f64) {
        self.zeroings = self.zeroings.wrapping_add(1);
        self.zero_angle_rad = angle_rad;
    }

    /// The next state, of the switch and of the stick if there is one (0 to 1); send it twice. `None` without a session.
    pub fn state(&mut self, now: Stamp, held: bool, stick: Option<f64>) -> Option<Datagram> {
        if let Some((key, _)) = self.offered.take_if(|(_, at)| now.since(*at) > VIEW_COMES_WITHIN) {
            self.begin(now, key);
        }
        let key = self.session.as_ref()?;
        self.number += 1;
        let (echo_us, echo_age_us) = self.view.map_or((0, NEVER_US), |(view, came)| {
            (view.time_us, u32::try_from(now.since(came).0 / 1_000).unwrap_or(NEVER_US))
        });
        let state = State {
            number: self.number,
            time_us: microseconds(now),
            echo_us,
            echo_age_us,
            held,
            zeroings: self.zeroings,
            zero_angle_rad: self.zero_angle_rad,
            stick,
        };
        Some(Packet::State(self.person, state).sealed(key))
    }

    /// Takes a datagram. True if it was an authentic one of the robot that brought something new.
    pub fn take(&mut self, now: Stamp, bytes: &[u8]) -> bool {
        match Packet::parse(bytes) {
            Some(Packet::Welcome(person, robot)) if person == self.person && self.secret.is_authentic(bytes) => {
                let in_session = self.session.is_some();
                if in_session && now.since(self.heard) <= LOST_AFTER {
                    return false;
                }
                let Some(key) = self.secret.of_session(&person, &robot) else { return false };
                if in_session {
                    self.offered = Some((key, self.offered.as_ref().map_or(now, |(_, since)| *since)));
                } else {
                    self.begin(now, key);
                }
                true
            }
            Some(Packet::View(person, view)) if person == self.person => {
                let authentic = self.session.as_ref().is_some_and(|key| key.is_authentic(bytes));
                let is_new = self.view.is_none_or(|(newest, _)| view.number > newest.number);
                if authentic && is_new {
                    (self.view, self.heard, self.offered) = (Some((view, now)), now, None);
                }
                authentic && is_new
            }
            _ => false,
        }
    }

    fn begin(&mut self, now: Stamp, key: Key) {
        self.session = Some(key);
        (self.view, self.number, self.heard) = (None, 0, now);
    }

    /// How the robot is, and how long ago that was heard.
    #[must_use]
    pub fn robot(&self, now: Stamp) -> Option<(View, Span)> {
        self.view.map(|(view, came)| (view, now.since(came)))
    }
}
