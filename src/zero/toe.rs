//! A toe's zero: the retracted stop. RT: yes.
//!
//! ```text
//!  Lost ─Homing, power, torque limited→ Seek ─stands still against the stop→ Return ─back where it stood→ Strengthen
//!    ▲                                   │ no stop within the stroke           │ (or time is up)             │ full torque
//!    ├────────── switch released ────────┴─► Failed ─Homing again─► Lost       ▼                             ▼ confirmed
//!    └───────────────────── the drive is set up anew ◄──────────────────────────────────────────────────── Known
//! ```

use super::{has_forgotten, show};
use crate::base::time::{Span, Stamp};
use crate::config::checked::Toe;
use crate::msg::{DriveFeedback, DriveState, Mode, ZeroState};

/// So many answers of the drive without motion are a stop.
const STILL_ANSWERS: u32 = 5;
/// Less is no motion, m.
const STILL_M: f64 = 5e-5;
/// The target has to be so far behind the stop, m: the drive does push.
const PUSH_M: f64 = 1e-3;
/// And is never farther ahead of the toe, m: the push stays gentle whatever the drive's stiffness.
const MOST_AHEAD_M: f64 = 2e-3;
/// The stop must come within the stroke and this, m.
const MARGIN_M: f64 = 3e-3;
/// Back where it stood, m.
const BACK_M: f64 = 2e-4;
/// Longest homing, in times that the stroke takes both ways.
const PATIENCE: f64 = 4.0;

/// What a search goes by.
#[derive(Clone, Copy, Debug)]
pub(super) struct ToeRules {
    counts_per_m: f64,
    stroke_m: f64,
    step_m: f64,
    most_ticks: f64,
    homing_torque_permille: i16,
    full_torque_permille: i16,
}

impl ToeRules {
    pub(super) fn new(toe: &Toe, period: Span, [homing, full]: [i16; 2]) -> Self {
        let step_m = toe.homing_rate_m_s * period.as_s();
        Self {
            counts_per_m: toe.counts_per_m,
            stroke_m: toe.stroke_m,
            step_m,
            // A second more for enabling, at any period.
            most_ticks: PATIENCE * toe.stroke_m / step_m + 1.0 / period.as_s(),
            homing_torque_permille: homing,
            full_torque_permille: full,
        }
    }

    fn length_m(&self, from_counts: i32, to_counts: i32) -> f64 {
        (f64::from(to_counts) - f64::from(from_counts)) / self.counts_per_m
    }

    /// `length_m` beyond a count.
    #[expect(clippy::cast_possible_truncation, reason = "saturates; a stroke has few counts")]
    fn beyond(&self, counts: i32, length_m: f64) -> i32 {
        counts.saturating_add(libm::round(length_m * self.counts_per_m) as i32)
    }
}

/// On the way to the stop.
#[derive(Clone, Copy, Debug)]
struct Seek {
    /// Where it stood at the beginning, the drive's counts.
    start: i32,
    /// Commanded travel from there, m, negative inwards.
    target_m: f64,
    answered: Stamp,
    still_at: i32,
    still: u32,
}

#[derive(Clone, Copy, Debug)]
enum Phase {
    Lost,
    Seek(Seek),
    Return { start: i32, target_m: f64 },
    Strengthen { start: i32 },
    Known,
    Failed,
}

/// One toe.
#[derive(Clone, Copy, Debug)]
pub(super) struct ToeZero {
    rules: ToeRules,
    phase: Phase,
    offset: Option<i32>,
    ticks: f64,
}

impl ToeZero {
    pub(super) const fn new(rules: ToeRules) -> Self {
        Self { rules, phase: Phase::Lost, offset: None, ticks: 0.0 }
    }

    /// Takes the toe's answer, moves the search on, and puts our count into the answer.
    pub(super) fn receive(&mut self, mode: Mode, toe: &mut DriveFeedback) {
        if has_forgotten(toe) || toe.stamp == Stamp::NEVER {
            self.forget();
        } else if mode == Mode::Homing {
            self.search(toe);
        } else if !matches!(self.phase, Phase::Known | Phase::Failed) {
            self.forget();
        }
        let zero = match self.phase {
            Phase::Lost => ZeroState::Unknown,
            Phase::Seek(_) | Phase::Return { .. } | Phase::Strengthen { .. } => ZeroState::Homing,
            Phase::Known => ZeroState::Known,
            Phase::Failed => ZeroState::Failed,
        };
        show(toe, self.offset, zero);
    }

    /// Where it shall go, in our counts once they exist, in the drive's before; `None`: stay.
    pub(super) fn target(&self) -> Option<i32> {
        let ours = |counts: i32| counts.saturating_sub(self.offset.unwrap_or(0));
        match self.phase {
            Phase::Seek(seek) => Some(ours(self.rules.beyond(seek.start, seek.target_m))),
            Phase::Return { start, target_m } => Some(ours(self.rules.beyond(start, target_m))),
            Phase::Strengthen { start } => Some(ours(start)),
            Phase::Lost | Phase::Known | Phase::Failed => None,
        }
    }

    pub(super) const fn offset_counts(&self) -> Option<i32> {
        self.offset
    }

    pub(super) const fn wants_full_torque(&self) -> bool {
        matches!(self.phase, Phase::Known | Phase::Strengthen { .. })
    }

    fn forget(&mut self) {
        (self.phase, self.offset, self.ticks) = (Phase::Lost, None, 0.0);
    }

    fn search(&mut self, toe: &DriveFeedback) {
        let at = toe.position_counts;
        self.ticks += 1.0;
        let late = self.ticks > self.rules.most_ticks;
        self.phase = match self.phase {
            Phase::Failed => {
                self.forget();
                Phase::Lost
            }
            Phase::Known => Phase::Known,
            _ if late => Phase::Failed,
            Phase::Lost if self.may_begin(toe) => {
                Phase::Seek(Seek { start: at, target_m: 0.0, answered: toe.stamp, still_at: at, still: 0 })
            }
            Phase::Lost => Phase::Lost,
            Phase::Seek(seek) => self.seek(seek, toe),
            Phase::Return { start, target_m } => self.go_back(start, target_m, at),
            Phase::Strengthen { start } if toe.torque_limit_permille != self.rules.full_torque_permille => {
                Phase::Strengthen { start }
            }
            Phase::Strengthen { .. } => Phase::Known,
        };
        if matches!(self.phase, Phase::Failed) {
            self.offset = None;
        }
    }

    /// It has power, and not more torque than the stop may see.
    fn may_begin(&self, toe: &DriveFeedback) -> bool {
        toe.state == DriveState::Enabled && toe.torque_limit_permille == self.rules.homing_torque_permille
    }

    fn seek(&mut self, mut seek: Seek, toe: &DriveFeedback) -> Phase {
        let (rules, at) = (&self.rules, toe.position_counts);
        let travelled_m = rules.length_m(seek.start, at);
        seek.target_m = (seek.target_m - rules.step_m).max(travelled_m - MOST_AHEAD_M);
        if toe.stamp != seek.answered {
            seek.answered = toe.stamp;
            let moved = rules.length_m(seek.still_at, at).abs() > STILL_M;
            seek.still = if moved { 0 } else { seek.still + 1 };
            seek.still_at = if moved { at } else { seek.still_at };
        }
        if -travelled_m > rules.stroke_m + MARGIN_M {
            return Phase::Failed;
        }
        let pushes = travelled_m - seek.target_m >= PUSH_M;
        if pushes && seek.still >= STILL_ANSWERS {
            self.offset = Some(at);
            return Phase::Return { start: seek.start, target_m: travelled_m };
        }
        Phase::Seek(seek)
    }

    /// From the stop to where it stood.
    fn go_back(&self, start: i32, target_m: f64, at: i32) -> Phase {
        if self.rules.length_m(at, start).abs() <= BACK_M {
            return Phase::Strengthen { start };
        }
        Phase::Return { start, target_m: (target_m + self.rules.step_m).min(0.0) }
    }
}
