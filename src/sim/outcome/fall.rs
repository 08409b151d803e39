//! Why a run ended: rules over what the true world and the records showed before. RT: no.
//!
//! A fall shows many irregularities, most of them its consequences. So:
//! 1. Nothing counts after the stance leg last leaned as in walking: that is the fall itself.
//! 2. A push within [`PUSHED_S`] before that is the cause.
//! 3. Otherwise the earliest irregularity of the last [`WINDOW_S`] is: the later ones follow from it. A kind that came in
//!    more than one of [`ORDINARY_STEPS`] steps without harm counts only when there is no other.
//! 4. Otherwise torque at its limit for most of [`SATURATED_S`]; then falling backwards (too slow to pass the vertical);
//!    then the fault that took the power.

use crate::msg::FaultCode;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// The last two steps, s.
const WINDOW_S: f64 = 1.2;
/// A robot that takes a push stumbles for some steps, s.
const PUSHED_S: f64 = 3.0;
/// Seen in more than one of so many steps: ordinary.
const ORDINARY_STEPS: f64 = 10.0;
/// The time over which torque at its limit tells, s, and the share of it.
const SATURATED_S: f64 = 0.25;
const SATURATED_SHARE: f64 = 0.8;
/// So much is remembered, s.
const MEMORY_S: f64 = 6.0;

/// What may be found before a fall.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Irregularity {
    /// Somebody pushed.
    Push,
    /// The swing foot took the stance behind or beside the other.
    Scuff,
    /// Neither foot on the ground for longer than a rebound.
    LiftOff,
    /// The stance foot slid.
    Slip,
    /// A true touchdown that the estimator did not see in time.
    MissedTouchdown,
    /// A touchdown that only the estimator saw.
    InventedTouchdown,
    /// Torque for the wrong leg for more than 20 ms.
    WrongStance,
    /// The estimate was far off although its leg was right.
    Estimate,
}

const KINDS: usize = 8;

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// The swing foot met the ground where it should not.
    Scuff,
    /// The ground lost the robot.
    LiftOff,
    /// The stance foot slid away.
    Slip,
    /// A touchdown was not seen.
    MissedTouchdown,
    /// A touchdown was invented, or the wrong leg had torque for long.
    WrongStance,
    /// There was no more torque to be had.
    TorqueLimit,
    /// The estimate was wrong.
    Estimator,
    /// It did not pass the vertical and fell backwards.
    TooSlow,
    /// A blow from outside.
    Push,
    /// A device, a bus or the loop failed.
    Fault,
    /// None of these.
    Other,
}

impl Cause {
    /// As in `results.json`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Scuff => "scuff",
            Self::LiftOff => "lift_off",
            Self::Slip => "slip",
            Self::MissedTouchdown => "missed_touchdown",
            Self::WrongStance => "wrong_stance",
            Self::TorqueLimit => "torque_limit",
            Self::Estimator => "estimator",
            Self::TooSlow => "too_slow",
            Self::Push => "push",
            Self::Fault => "fault",
            Self::Other => "other",
        }
    }
}

impl From<Irregularity> for Cause {
    fn from(what: Irregularity) -> Self {
        match what {
            Irregularity::Push => Self::Push,
            Irregularity::Scuff => Self::Scuff,
            Irregularity::LiftOff => Self::LiftOff,
            Irregularity::Slip => Self::Slip,
            Irregularity::MissedTouchdown => Self::MissedTouchdown,
            Irregularity::InventedTouchdown | Irregularity::WrongStance => Self::WrongStance,
            Irregularity::Estimate => Self::Estimator,
        }
    }
}

/// Something out of order, and when it began.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Happening {
    /// s.
    pub at_s: f64,
    /// What.
    pub what: Irregularity,
}

/// What is remembered of a run.
#[derive(Clone, Debug, Default)]
pub struct History {
    happenings: VecDeque<Happening>,
    /// How often each kind was seen in the whole run.
    seen: [u32; KINDS],
    steps: u32,
    /// Ticks: time, torque at its limit.
    ticks: VecDeque<(f64, bool)>,
    last_walking_s: f64,
}

impl History {
    /// Something was out of order.
    pub fn note(&mut self, happening: Happening) {
        self.seen[happening.what as usize] += 1;
        self.happenings.push_back(happening);
        while self.happenings.front().is_some_and(|h| happening.at_s - h.at_s > MEMORY_S) {
            self.happenings.pop_front();
        }
    }

    /// A step was made.
    pub const fn step(&mut self) {
        self.steps += 1;
    }

    /// A tick: whether the torque is at its limit, and whether the lean is one of walking.
    pub fn tick(&mut self, now_s: f64, saturated: bool, walks: bool) {
        self.ticks.push_back((now_s, saturated));
        while self.ticks.front().is_some_and(|(at_s, _)| now_s - at_s > WINDOW_S) {
            self.ticks.pop_front();
        }
        if walks {
            self.last_walking_s = now_s;
        }
    }

    /// Seen so often that it does no harm by itself.
    fn is_ordinary(&self, what: Irregularity, in_window: u32) -> bool {
        let before = self.seen[what as usize].saturating_sub(in_window);
        f64::from(before) * ORDINARY_STEPS > f64::from(self.steps.max(1))
    }

    fn was_saturated(&self, until_s: f64) -> bool {
        let near = || self.ticks.iter().filter(|(at_s, _)| *at_s <= until_s && until_s - at_s <= SATURATED_S);
        let (all, saturated) = (near().count(), near().filter(|(_, s)| *s).count());
        all > 0 && saturated as f64 >= SATURATED_SHARE * all as f64
    }
}

/// The cause of a fall at `end_s`; `backward`: against the sense of walking; `fault`: what took the power, if anything.
#[must_use]
pub fn cause(history: &History, end_s: f64, backward: bool, fault: FaultCode) -> Cause {
    let onset_s = if history.last_walking_s > 0.0 { history.last_walking_s.min(end_s) } else { end_s };
    let before =
        |within_s: f64| history.happenings.iter().filter(move |h| h.at_s <= onset_s && onset_s - h.at_s <= within_s);
    if before(PUSHED_S).any(|h| h.what == Irregularity::Push) {
        return Cause::Push;
    }
    let count =
        |what: Irregularity| u32::try_from(before(WINDOW_S).filter(|h| h.what == what).count()).unwrap_or(u32::MAX);
    let earliest = |ordinary: bool| {
        before(WINDOW_S)
            .filter(|h| history.is_ordinary(h.what, count(h.what)) == ordinary)
            .min_by(|a, b| a.at_s.total_cmp(&b.at_s))
    };
    if let Some(first) = earliest(false) {
        return first.what.into();
    }
    if history.was_saturated(onset_s) {
        return Cause::TorqueLimit;
    }
    if backward {
        return Cause::TooSlow;
    }
    if let Some(first) = earliest(true) {
        return first.what.into();
    }
    match fault {
        FaultCode::EstimateLost => Cause::Estimator,
        FaultCode::None
        | FaultCode::TiltLimit
        | FaultCode::FellForward
        | FaultCode::FellBackward
        | FaultCode::RateLimit
        | FaultCode::TorqueDemand => Cause::Other,
        _ => Cause::Fault,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A walk of 50 steps in 25 s, then these happenings; the lean leaves the ordinary at 25 s.
    fn history(happenings: &[(f64, Irregularity)]) -> History {
        let mut history = History::default();
        for k in 0..25_000_u32 {
            history.tick(f64::from(k) * 1e-3, false, true);
        }
        (0..50).for_each(|_| history.step());
        happenings.iter().for_each(|(at_s, what)| history.note(Happening { at_s: *at_s, what: *what }));
        history
    }

    fn told(happenings: &[(f64, Irregularity)], backward: bool) -> Cause {
        let fault = if backward { FaultCode::FellBackward } else { FaultCode::FellForward };
        cause(&history(happenings), 25.4, backward, fault)
    }

    #[test]
    fn the_earliest_irregularity_is_the_cause_and_the_later_ones_follow() {
        use Irregularity::{Estimate, LiftOff, MissedTouchdown, Scuff, Slip, WrongStance};
        let scuffed = [(24.6, Scuff), (24.7, MissedTouchdown), (24.75, WrongStance), (24.9, LiftOff)];
        assert_eq!(told(&scuffed, false), Cause::Scuff);
        assert_eq!(told(&scuffed[1..], false), Cause::MissedTouchdown);
        assert_eq!(told(&scuffed[2..], false), Cause::WrongStance);
        assert_eq!(told(&scuffed[3..], false), Cause::LiftOff);
        assert_eq!(told(&[(24.5, Slip), (24.6, Estimate)], true), Cause::Slip);
        assert_eq!(told(&[(24.5, Estimate)], true), Cause::Estimator);
        assert_eq!(told(&[(24.5, Irregularity::InventedTouchdown)], false), Cause::WrongStance);
    }

    #[test]
    fn what_happens_during_the_fall_or_long_before_is_no_cause() {
        assert_eq!(told(&[(25.1, Irregularity::LiftOff)], true), Cause::TooSlow);
        assert_eq!(told(&[(20.0, Irregularity::Scuff)], true), Cause::TooSlow);
        assert_eq!(told(&[], false), Cause::Other);
    }

    #[test]
    fn a_push_within_three_seconds_is_the_cause_whatever_followed() {
        let pushed = [(22.5, Irregularity::Push), (24.6, Irregularity::Scuff)];
        assert_eq!(told(&pushed, false), Cause::Push);
        assert_eq!(told(&[(20.0, Irregularity::Push), pushed[1]], false), Cause::Scuff);
    }

    #[test]
    fn a_kind_seen_in_every_other_step_gives_way_to_a_rare_one() {
        let mut slips: Vec<(f64, Irregularity)> = (0..25).map(|k| (f64::from(k), Irregularity::Slip)).collect();
        slips.push((24.3, Irregularity::Slip));
        slips.push((24.6, Irregularity::Scuff));
        assert_eq!(told(&slips, false), Cause::Scuff);
        slips.pop();
        assert_eq!(told(&slips, true), Cause::TooSlow);
        assert_eq!(told(&slips, false), Cause::Slip);
    }

    #[test]
    fn torque_at_its_limit_until_the_fall_begins_is_told() {
        let mut history = history(&[]);
        for k in 0..300_u32 {
            history.tick(25.0 + f64::from(k) * 1e-3, true, true);
        }
        assert_eq!(cause(&history, 25.5, true, FaultCode::FellBackward), Cause::TorqueLimit);
    }

    #[test]
    fn a_device_that_fails_is_no_fall() {
        assert_eq!(cause(&history(&[]), 25.0, false, FaultCode::BusUnhealthy), Cause::Fault);
        assert_eq!(cause(&history(&[]), 25.0, false, FaultCode::EstimateLost), Cause::Estimator);
    }
}
