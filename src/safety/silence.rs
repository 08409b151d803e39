//! For how long each drive has been silent in our own time: the time in which we were there to ask. RT: yes.
//!
//! Drives answer to our SYNC. After a stall of ours their last word is old, and no drive is to blame: the age beyond
//! which a drive counts as silent leaves our stalls out, or one late tick would drop the robot. What is old stays
//! unfit for torque, whoever is to blame ([`super::health::outdated`]).

use crate::base::time::{Span, Stamp};
use crate::msg::{DRIVES, DriveFeedbacks};

/// A drive's newest word.
#[derive(Clone, Copy, Debug)]
struct Word {
    stamp: Stamp,
    age: Span,
    /// Our stalls since the word before.
    stalled: Span,
}

/// The silence of every drive.
#[derive(Clone, Copy, Debug)]
pub(super) struct Silence {
    period: Span,
    last: Stamp,
    words: [Word; DRIVES],
}

impl Silence {
    pub(super) const fn new(period: Span) -> Self {
        let never = Word { stamp: Stamp::NEVER, age: Span(i64::MAX), stalled: Span::ZERO };
        Self { period, last: Stamp::NEVER, words: [never; DRIVES] }
    }

    /// Takes note of a tick.
    pub(super) fn observe(&mut self, now: Stamp, feedback: &DriveFeedbacks) {
        let since_last = if self.last == Stamp::NEVER { self.period } else { now.since(self.last) };
        let stall = Span(since_last.0.saturating_sub(self.period.0).max(0));
        self.last = now;
        for (word, drive) in self.words.iter_mut().zip(&feedback.drives) {
            let stalled = Span(word.stalled.0.saturating_add(stall.0));
            *word = if drive.stamp == word.stamp {
                let age = Span(word.age.0.saturating_add(since_last.0.saturating_sub(stall.0)));
                Word { age, stalled, ..*word }
            } else {
                Word { stamp: drive.stamp, age: without(now.since(drive.stamp), stalled), stalled: Span::ZERO }
            };
        }
    }

    /// Age of each drive's newest word, our stalls left out.
    pub(super) fn ages(&self) -> [Span; DRIVES] {
        self.words.map(|word| word.age)
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
            silence.observe(Stamp(now * MS), &feedback);
        }
        silence.ages()[0].as_s() * 1e3
    }

    #[test]
    fn a_drive_that_never_spoke_is_silent_for_ever() {
        let mut silence = Silence::new(Span::from_ms(1));
        let mut feedback = DriveFeedbacks::default();
        feedback.drives[0].stamp = Stamp::NEVER;
        silence.observe(Stamp(5 * MS), &feedback);
        assert_eq!(silence.ages()[0], Span(i64::MAX));
    }

    #[test]
    fn without_stalls_it_is_the_age() {
        assert!((age_ms(&[(10, 9), (11, 9), (12, 9)]) - 3.0).abs() < 1e-9);
        assert!((age_ms(&[(10, 9), (11, 2)]) - 9.0).abs() < 1e-9, "a word that comes late is late");
    }

    #[test]
    fn our_stall_is_not_the_drives_silence() {
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
