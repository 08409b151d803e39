//! The estimator's stance leg against the true one. RT: no.

use super::fall::Irregularity;
use crate::base::time::Span;
use crate::msg::{Leg, Mode, TickRecord};
use std::collections::VecDeque;

/// A change of stance that is seen so much later, or earlier, was not seen: the torque has been the wrong leg's for long.
const WINDOW_S: f64 = 0.06;
/// Below this the wrong leg gets no torque to speak of, Nm.
const SOME_TORQUE_NM: f64 = 0.5;
/// For longer than this the wrong leg must not get torque (s).
const WRONG_TORQUE_S: f64 = 0.02;

/// Counts what was missed and invented.
#[derive(Clone, Debug)]
pub struct Agreement {
    period_s: f64,
    stances: Option<[Leg; 2]>,
    /// Changes without their counterpart: true ones, believed ones.
    open: [VecDeque<(f64, Leg)>; 2],
    missed: u32,
    invented: u32,
    wrong_ticks: u64,
    wrong_torque_s: f64,
    longest_wrong_torque_s: f64,
}

impl Agreement {
    /// Nothing seen yet.
    #[must_use]
    pub fn new(period: Span) -> Self {
        Self {
            period_s: period.as_s(),
            stances: None,
            open: [VecDeque::new(), VecDeque::new()],
            missed: 0,
            invented: 0,
            wrong_ticks: 0,
            wrong_torque_s: 0.0,
            longest_wrong_torque_s: 0.0,
        }
    }

    /// One tick; what turned out to be wrong, with its time in s.
    pub fn look(&mut self, now_s: f64, record: &TickRecord, truth: Leg) -> Vec<(f64, Irregularity)> {
        let believed = record.estimate.stance;
        if record.status.mode != Mode::Armed {
            self.stances = None;
            return Vec::new();
        }
        let before = self.stances.replace([truth, believed]).unwrap_or([truth, believed]);
        for (k, (was, is)) in before.into_iter().zip([truth, believed]).enumerate() {
            if was != is {
                self.changed(k, now_s, is);
            }
        }
        let mut found = self.expired(now_s);
        found.extend(self.wrong_leg(now_s, truth != believed, record.allowed.hip_torque_nm));
        found
    }

    /// A change on one side answers the oldest one of the same leg on the other.
    fn changed(&mut self, side: usize, now_s: f64, leg: Leg) {
        let other = &mut self.open[1 - side];
        if let Some(k) = other.iter().position(|(_, l)| *l == leg) {
            other.remove(k);
        } else {
            self.open[side].push_back((now_s, leg));
        }
    }

    fn expired(&mut self, now_s: f64) -> Vec<(f64, Irregularity)> {
        let mut found = Vec::new();
        for (side, what) in [(0, Irregularity::MissedTouchdown), (1, Irregularity::InventedTouchdown)] {
            while let Some((at_s, _)) = self.open[side].front().copied().filter(|(at_s, _)| now_s - at_s > WINDOW_S) {
                self.open[side].pop_front();
                found.push((at_s, what));
                *(if side == 0 { &mut self.missed } else { &mut self.invented }) += 1;
            }
        }
        found
    }

    fn wrong_leg(&mut self, now_s: f64, wrong: bool, torque_nm: f64) -> Option<(f64, Irregularity)> {
        self.wrong_ticks += u64::from(wrong);
        if !wrong || torque_nm.abs() <= SOME_TORQUE_NM {
            self.wrong_torque_s = 0.0;
            return None;
        }
        let before_s = self.wrong_torque_s;
        self.wrong_torque_s += self.period_s;
        self.longest_wrong_torque_s = self.longest_wrong_torque_s.max(self.wrong_torque_s);
        let crossed = before_s <= WRONG_TORQUE_S && self.wrong_torque_s > WRONG_TORQUE_S;
        crossed.then_some((now_s - self.wrong_torque_s, Irregularity::WrongStance))
    }

    /// True changes of stance that the estimator did not see in time.
    #[must_use]
    pub const fn missed(&self) -> u32 {
        self.missed
    }

    /// Changes of stance that only the estimator saw.
    #[must_use]
    pub const fn invented(&self) -> u32 {
        self.invented
    }

    /// Armed ticks in which the estimator stood on the other leg.
    #[must_use]
    pub const fn wrong_ticks(&self) -> u64 {
        self.wrong_ticks
    }

    /// Longest time without a break in which it did and there was torque, s.
    #[must_use]
    pub const fn longest_wrong_torque_s(&self) -> f64 {
        self.longest_wrong_torque_s
    }
}
