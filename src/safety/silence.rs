//! For how long each source has been silent in our own time: the time in which we were there to ask and to listen.
//! RT: yes.
//!
//! Drives answer to our SYNC, and bytes wait until we read them. After a stall of ours, of this thread or of one that
//! brings input, their last word is old, and none of them is to blame: the age beyond which a source counts as silent
//! leaves our stalls out, or one late tick would drop the robot. What is old stays unfit for torque, whoever is to blame
//! ([`super::health::outdated`]). The operator is not among them: a hand that we could not see counts as open.

use crate::base::listening::Listening;
use crate::base::time::{Span, Stamp};
use crate::msg::{BUSES, DRIVES, DriveFeedbacks, Snapshot, TickInput};

/// A source's newest word.
#[derive(Clone, Copy, Debug)]
struct Word {
    stamp: Stamp,
    age: Span,
    /// Time not spent listening since the word before.
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
    /// Bus of each drive.
    buses: [usize; DRIVES],
    period: Span,
    last: Stamp,
    listening: [Listening; BUSES],
    imu_listening: Listening,
    drives: [Word; DRIVES],
    imu: Word,
}

impl Silence {
    pub(super) const fn new(period: Span, buses: [usize; DRIVES]) -> Self {
        let never = Word { stamp: Stamp::NEVER, age: Span(i64::MAX), stalled: Span::ZERO };
        let listening = Listening::new(period);
        Self {
            buses,
            period,
            last: Stamp::NEVER,
            listening: [listening; BUSES],
            imu_listening: listening,
            drives: [never; DRIVES],
            imu: never,
        }
    }

    /// Takes note of a tick.
    pub(super) fn observe(&mut self, input: &TickInput, feedback: &DriveFeedbacks, snapshot: &Snapshot) {
        let now = input.now;
        let passed = if self.last == Stamp::NEVER { self.period } else { now.since(self.last) };
        self.last = now;
        let mut ticks = [Tick { now, passed, listened: Span::ZERO }; BUSES];
        for ((tick, listening), until) in ticks.iter_mut().zip(&mut self.listening).zip(input.heard_until) {
            tick.listened = listening.advance(until);
        }
        for ((word, drive), bus) in self.drives.iter_mut().zip(&feedback.drives).zip(self.buses) {
            if let Some(tick) = ticks.get(bus) {
                word.hear(drive.stamp, tick);
            }
        }
        let never = snapshot.imu_age == Span(i64::MAX);
        let listened = self.imu_listening.advance(input.imu_heard_until);
        let stamp = if never { Stamp::NEVER } else { now - snapshot.imu_age };
        self.imu.hear(stamp, &Tick { now, passed, listened });
    }

    /// For how long each source has said nothing.
    pub(super) fn ages(&self) -> Ages {
        Ages { drives: self.drives.map(|word| word.age), imu: self.imu.age }
    }
}

/// When we look, how long after the tick before, and how much of that was spent listening.
#[derive(Clone, Copy, Debug)]
struct Tick {
    now: Stamp,
    passed: Span,
    listened: Span,
}

impl Word {
    fn hear(&mut self, stamp: Stamp, tick: &Tick) {
        let stalled = Span(self.stalled.0.saturating_add(tick.passed.0.saturating_sub(tick.listened.0)));
        *self = if stamp == self.stamp {
            Self { age: Span(self.age.0.saturating_add(tick.listened.0)), stalled, ..*self }
        } else {
            Self { stamp, age: without(tick.now.since(stamp), stalled), stalled: Span::ZERO }
        };
    }
}

/// An age without our stalls. What is stamped ahead of us stays so: safety does not believe it.
fn without(age: Span, stalled: Span) -> Span {
    if age.0 < 0 { age } else { Span(age.0.saturating_sub(stalled.0.max(0)).max(0)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    /// Ticks at the times given (ms); each with how far we have listened and the time of the drives' newest word. The
    /// last age, ms.
    fn age_heard_ms(ticks: &[(i64, i64, i64)]) -> f64 {
        let mut silence = Silence::new(Span::from_ms(1), [0; DRIVES]);
        let mut feedback = DriveFeedbacks::default();
        for (now, heard, word) in ticks {
            feedback.drives[0].stamp = Stamp(word * MS);
            let heard_until = [Stamp(heard * MS); BUSES];
            let input = TickInput { now: Stamp(now * MS), heard_until, ..TickInput::default() };
            silence.observe(&input, &feedback, &Snapshot::default());
        }
        silence.ages().drives[0].as_s() * 1e3
    }

    /// The same, always heard up to the tick.
    fn age_ms(ticks: &[(i64, i64)]) -> f64 {
        age_heard_ms(&ticks.iter().map(|(now, word)| (*now, *now, *word)).collect::<Vec<_>>())
    }

    #[test]
    fn a_source_that_never_spoke_is_silent_for_ever() {
        let mut silence = Silence::new(Span::from_ms(1), [0; DRIVES]);
        let mut feedback = DriveFeedbacks::default();
        feedback.drives[0].stamp = Stamp::NEVER;
        let never = Snapshot { imu_age: Span(i64::MAX), ..Snapshot::default() };
        silence.observe(&TickInput { now: Stamp(5 * MS), ..TickInput::default() }, &feedback, &never);
        assert_eq!((silence.ages().drives[0], silence.ages().imu), (Span(i64::MAX), Span(i64::MAX)));
    }

    #[test]
    fn a_thread_that_brings_nothing_makes_nobody_silent() {
        // It listened until 10 and comes back at 31 with all that waited.
        let stalled = (11..31).map(|ms| (ms, 10, 9));
        let ticks: Vec<_> = [(10, 10, 9)].into_iter().chain(stalled).collect();
        assert!((age_heard_ms(&ticks) - 1.0).abs() < 1e-9, "while it stalls");
        let mut back = ticks.clone();
        back.push((31, 31, 30));
        assert!((age_heard_ms(&back)).abs() < 1e-9, "a fresh word is fresh");
        // It is back, and the source says nothing: one period, then every one.
        let mut silent = ticks;
        silent.extend((31..36).map(|ms| (ms, ms, 9)));
        assert!((age_heard_ms(&silent) - 6.0).abs() < 1e-9, "{}", age_heard_ms(&silent));
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
