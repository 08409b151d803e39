//! For how long each source has been silent in our own time: the time in which we were there to ask and to listen.
//! RT: yes.
//!
//! Drives answer to our SYNC, and the IMU's bytes wait until we read them. After a stall of ours their last word is old,
//! and none of them is to blame: the age beyond which a source counts as silent leaves our stalls out, or one late tick
//! would drop the robot. What is old stays unfit for torque, whoever is to blame ([`super::health::outdated`]). The
//! operator is not among them: a hand that we could not see counts as open.

use crate::base::time::{Span, Stamp};
use crate::msg::{DRIVES, DriveFeedbacks, Snapshot};

/// A source's newest word.
#[derive(Clone, Copy, Debug)]
struct Word {
    stamp: Stamp,
    age: Span,
    /// Our stalls since the word before.
    stalled: Span,
}

/// Ages of the newest words, our stalls left out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ages {
    pub(super) drives: [Span; DRIVES],
    pub(super) imu: Span,
}

/// The silence of every source.
#[derive(Clone, Copy, Debug)]
pub(super) struct Silence {
    period: Span,
    last: Stamp,
    drives: [Word; DRIVES],
    imu: Word,
}

impl Silence {
    pub(super) const fn new(period: Span) -> Self {
        let never = Word { stamp: Stamp::NEVER, age: Span(i64::MAX), stalled: Span::ZERO };
        Self { period, last: Stamp::NEVER, drives: [never; DRIVES], imu: never }
    }

    /// Takes note of a tick.
    pub(super) fn observe(&mut self, now: Stamp, feedback: &DriveFeedbacks, snapshot: &Snapshot) {
        let since_last = if self.last == Stamp::NEVER { self.period } else { now.since(self.last) };
        let tick = Tick { now, since_last, stall: Span(since_last.0.saturating_sub(self.period.0).max(0)) };
        self.last = now;
        for (word, drive) in self.drives.iter_mut().zip(&feedback.drives) {
            word.hear(drive.stamp, &tick);
        }
        let never = snapshot.imu_age == Span(i64::MAX);
        self.imu.hear(if never { Stamp::NEVER } else { now - snapshot.imu_age }, &tick);
    }

    /// For how long each source has said nothing.
    pub(super) fn ages(&self) -> Ages {
        Ages { drives: self.drives.map(|word| word.age), imu: self.imu.age }
    }
}

/// When we look, and how long we have not.
#[derive(Clone, Copy, Debug)]
struct Tick {
    now: Stamp,
    since_last: Span,
    stall: Span,
}

impl Word {
    fn hear(&mut self, stamp: Stamp, tick: &Tick) {
        let stalled = Span(self.stalled.0.saturating_add(tick.stall.0));
        *self = if stamp == self.stamp {
            let age = Span(self.age.0.saturating_add(tick.since_last.0.saturating_sub(tick.stall.0)));
            Self { age, stalled, ..*self }
        } else {
            Self { stamp, age: without(tick.now.since(stamp), stalled), stalled: Span::ZERO }
        };
    }
}

/// An age without our stalls. What is stamped ahead of us stays so: safety does not believe it.
fn without(age: Span, stalled: Span) -> Span {
    if age.0 < 0 { age } else { Span(age.0.saturating_sub(stalled.0).max(0)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    /// Ticks at the times given (ms); each with the time of the drives' newest word. The last age, ms.
    fn age_ms(ticks: &[(i64, i64)]) -> f64 {
        let mut silence = Silence::new(Span::from_ms(1));
        let mut feedback = DriveFeedbacks::default();
        for (now, word) in ticks {
            feedback.drives[0].stamp = Stamp(word * MS);
            silence.observe(Stamp(now * MS), &feedback, &Snapshot::default());
        }
        silence.ages().drives[0].as_s() * 1e3
    }

    #[test]
    fn a_source_that_never_spoke_is_silent_for_ever() {
        let mut silence = Silence::new(Span::from_ms(1));
        let mut feedback = DriveFeedbacks::default();
        feedback.drives[0].stamp = Stamp::NEVER;
        let never = Snapshot { imu_age: Span(i64::MAX), ..Snapshot::default() };
        silence.observe(Stamp(5 * MS), &feedback, &never);
        assert_eq!((silence.ages().drives[0], silence.ages().imu), (Span(i64::MAX), Span(i64::MAX)));
    }

    #[test]
    fn without_stalls_it_is_the_age() {
        assert!((age_ms(&[(10, 9), (11, 9), (12, 9)]) - 3.0).abs() < 1e-9);
        assert!((age_ms(&[(10, 9), (11, 2)]) - 9.0).abs() < 1e-9, "a word that comes late is late");
    }

    #[test]
    fn our_stall_is_not_the_sources_silence() {
        // The answer to the SYNC before the stall, read after it.
        assert!((age_ms(&[(10, 9), (31, 10)]) - 1.0).abs() < 1e-9);
        // It is read one tick later still.
        assert!((age_ms(&[(10, 9), (31, 9), (32, 10)]) - 2.0).abs() < 1e-9);
        // A word from after the stall is no younger than it is, and the silence after it counts in full.
        assert!((age_ms(&[(10, 9), (31, 31), (32, 31), (33, 31)]) - 2.0).abs() < 1e-9);
    }

    #[test]
    fn silence_after_a_stall_is_noticed_as_soon_as_ever() {
        let mut ticks = vec![(10, 9), (31, 10)];
        ticks.extend((32..38).map(|ms| (ms, 10)));
        assert!((age_ms(&ticks) - 7.0).abs() < 1e-9);
    }

    #[test]
    fn words_from_the_future_stay_there() {
        assert!(age_ms(&[(10, 9), (31, 60)]) < -28.0);
    }
}
