//! Terrain zeroing (Thesis 2.1.4): what the IMU's attitude reads too much, by the floor that a lidar sees. RT: yes; a
//! search among some hundred stamps, and only in a tick with a new line.
//!
//! The filter's state is "the difference between the two raw sensor readings after being passed through a first order low
//! pass filter with a time constant on the order of several seconds". Raw: neither the learnt bias nor the state itself
//! goes into the difference, so the state depends on nothing but the two sensors. It is subtracted from the attitude, and
//! [`super::bias`] learns what is left. So the two never fight, and their sum is unique:
//! - the terrain's part is the slow one (seconds and more) whatever the learner does;
//! - the learner's part is what its own balance of momentum wants, less the terrain's; while it learns, a change of the
//!   terrain's part is taken out of its own ([`super::bias::BiasObserver::hand_over`]), so that the attitude does not move;
//! - where the learner knows nothing (disarmed, in a hand, switched off), the terrain's part alone corrects.
//!
//! While no line comes the state is held, and its uncertainty grows by the IMU's drift.
//!
//! Limits: the floor counts as level. On a slope the attitude is that against the floor until the learner has taken the
//! slope out, within its own time constant after arming.

use crate::base::time::{Span, Stamp};
use crate::config::checked::{Lidar, LidarMount};
use crate::msg::{FloorVerdict, LidarSample, LidarState, Terrain, TerrainState};

/// Attitudes that are remembered.
const KEPT: usize = 256;
/// They are at least so far apart: half a second in all.
const APART: Span = Span::from_ms(2);
/// Attitudes farther apart than this say nothing about the time between them.
const WIDEST_GAP: Span = Span::from_ms(20);
/// A line that would move the state by more is of another floor, or of none, rad.
const FARTHEST_RAD: f64 = 0.1;
/// No IMU is wrong by more, rad.
const LARGEST_RAD: f64 = 0.25;
/// After this time without a line the state is held.
const FRESH: Span = Span::from_ms(200);
/// After a gap the state comes back with its time constant, not at once, s.
const LONGEST_STEP_S: f64 = 0.1;

/// Inclination of the part that carries the lidar, by the IMU alone.
#[derive(Clone, Copy, Debug)]
struct Attitude {
    stamp: Stamp,
    lean_rad: f64,
}

const NEVER: Attitude = Attitude { stamp: Stamp::NEVER, lean_rad: 0.0 };

/// The filter, if there is a lidar.
#[derive(Clone, Debug)]
pub(super) struct TerrainZero {
    on: bool,
    /// Share of the hip angle between the inner leg and what carries the lidar.
    hip_share: f64,
    time_s: f64,
    drift_rad_sqrt_s: f64,
    past: [Attitude; KEPT],
    next: usize,
    newest: Stamp,
    zero_rad: f64,
    /// Of the drift since the lines, rad².
    drift_variance: f64,
    /// Standard deviation of the lines, filtered alike. Not averaged: a robot that stands sees the same floor in every scan.
    line_sigma_rad: f64,
    /// Time that the filter has averaged over, at most its time constant, s.
    averaged_s: f64,
    told: Terrain,
    last_line: Stamp,
    last: Stamp,
}

impl TerrainZero {
    /// Corrects nothing without a lidar.
    pub(super) fn new(lidar: Option<&Lidar>) -> Self {
        let share = |lidar: &Lidar| if lidar.mount == LidarMount::Body { 0.5 } else { 0.0 };
        Self {
            on: lidar.is_some(),
            hip_share: lidar.map_or(0.0, share),
            time_s: lidar.map_or(0.0, |lidar| lidar.zero_time.as_s()),
            drift_rad_sqrt_s: lidar.map_or(0.0, |lidar| lidar.drift_rad_sqrt_s),
            past: [NEVER; KEPT],
            next: 0,
            newest: Stamp::NEVER,
            zero_rad: 0.0,
            drift_variance: 0.0,
            line_sigma_rad: 0.0,
            averaged_s: 0.0,
            told: Terrain::default(),
            last_line: Stamp::NEVER,
            last: Stamp::NEVER,
        }
    }

    /// Forgets all.
    pub(super) const fn reset(&mut self) {
        self.past = [NEVER; KEPT];
        self.newest = Stamp::NEVER;
        (self.zero_rad, self.drift_variance, self.line_sigma_rad, self.averaged_s) = (0.0, 0.0, 0.0, 0.0);
        (self.last_line, self.last) = (Stamp::NEVER, Stamp::NEVER);
    }

    /// What the attitude reads too much, rad.
    pub(super) const fn zero_rad(&self) -> f64 {
        self.zero_rad
    }

    /// The inner leg's angle by the IMU alone, and the hip's, at this time.
    pub(super) fn remember(&mut self, stamp: Stamp, inner_rad: f64, hip_rad: f64) {
        let lean_rad = inner_rad - self.hip_share * hip_rad;
        if !self.on || stamp.since(self.newest) < APART || !lean_rad.is_finite() {
            return;
        }
        self.newest = stamp;
        if let Some(slot) = self.past.get_mut(self.next) {
            *slot = Attitude { stamp, lean_rad };
            self.next = (self.next + 1) % KEPT;
        }
    }

    /// Takes the lidar's newest word; says by how much the state has moved.
    pub(super) fn hear(&mut self, now: Stamp, word: &LidarSample) -> f64 {
        if !self.on {
            return 0.0;
        }
        if self.last != Stamp::NEVER {
            let passed_s = now.since(self.last).as_s().max(0.0);
            self.drift_variance += self.drift_rad_sqrt_s * self.drift_rad_sqrt_s * passed_s;
        }
        self.last = now;
        self.told.heard = word.state != LidarState::Nothing;
        let mut moved = 0.0;
        if self.told.heard {
            (self.told.lidar, self.told.status) = (word.state, word.status);
            if word.state == LidarState::Streaming && word.verdict == FloorVerdict::Found {
                moved = self.take_line(word);
            }
        }
        moved
    }

    fn take_line(&mut self, line: &LidarSample) -> f64 {
        let error_rad = self.at(line.stamp).map(|lean_rad| lean_rad - line.lean_rad);
        let believed = |error: &f64| {
            let far = self.told.lines > 0 && (error - self.zero_rad).abs() > FARTHEST_RAD;
            error.abs() <= LARGEST_RAD && !far
        };
        let Some(error_rad) = error_rad.filter(believed) else {
            self.told.refused = self.told.refused.saturating_add(1);
            return 0.0;
        };
        let first = self.last_line == Stamp::NEVER;
        let step_s = if first { LONGEST_STEP_S } else { line.stamp.since(self.last_line).as_s() };
        let step_s = step_s.clamp(0.0, LONGEST_STEP_S);
        // At first the mean of all lines, then the low-pass.
        let share = if first { 1.0 } else { step_s / (self.averaged_s + step_s) };
        self.averaged_s = (self.averaged_s + step_s).min(self.time_s);
        let moved = share * (error_rad - self.zero_rad);
        self.zero_rad += moved;
        let sigma_rad = line.lean_sigma_rad;
        self.line_sigma_rad += share * (sigma_rad - self.line_sigma_rad);
        self.drift_variance *= (1.0 - share) * (1.0 - share);
        self.last_line = line.stamp;
        self.told.height_m = line.height_m;
        self.told.lines = self.told.lines.saturating_add(1);
        moved
    }

    /// Inclination by the IMU alone at that time, between its neighbours.
    fn at(&self, stamp: Stamp) -> Option<f64> {
        let (mut before, mut after) = (None::<Attitude>, None::<Attitude>);
        for a in self.past.iter().filter(|a| a.stamp != Stamp::NEVER) {
            if a.stamp <= stamp {
                before = Some(before.filter(|b| b.stamp >= a.stamp).unwrap_or(*a));
            } else {
                after = Some(after.filter(|b| b.stamp <= a.stamp).unwrap_or(*a));
            }
        }
        let (before, after) = (before?, after?);
        let gap = after.stamp.since(before.stamp);
        let share = stamp.since(before.stamp).as_s() / gap.as_s();
        (gap <= WIDEST_GAP).then_some(before.lean_rad + share * (after.lean_rad - before.lean_rad))
    }

    /// What there is to tell.
    pub(super) fn tell(&self, now: Stamp) -> Terrain {
        if !self.on {
            return Terrain::default();
        }
        let never = self.last_line == Stamp::NEVER;
        let line_age = if never { Span(i64::MAX) } else { now.since(self.last_line) };
        let state = match () {
            () if never => TerrainState::Waiting,
            () if line_age <= FRESH => TerrainState::Following,
            () => TerrainState::Holding,
        };
        let variance = self.line_sigma_rad * self.line_sigma_rad + self.drift_variance;
        Terrain {
            stamp: now,
            state,
            zero_rad: self.zero_rad,
            zero_sigma_rad: libm::sqrt(variance),
            line_age,
            ..self.told
        }
    }
}
