//! Does a drive make the torque that it was asked for? RT: yes.
//!
//! What it shows must lie between the lowest and the highest torque commanded of late, with a margin: so neither the
//! lag of its current loop nor the delay of the bus is blamed. And where all of them push one way, it must not show
//! nothing or the opposite, however little they ask.

/// Commands that are looked back at: more than lag and delay of any drive that this control works with.
const WINDOW: usize = 16;
/// Margin, 1/1000 of rated torque: ripple and error of its current measurement.
const MARGIN_PERMILLE: i16 = 300;
/// Answers in a row that must be wrong: 50 ms at 1 kHz.
const PATIENCE: u8 = 50;
/// All commands of the window have one sign and are at least this: there is something to follow, 1/1000 of rated.
const WORTH_FOLLOWING: i16 = 30;
/// Less than this part of the smallest of them is no torque.
const NO_PART: i16 = 4;

/// The torques commanded of late.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Agreement {
    commanded: [i16; WINDOW],
    wrong: u8,
    absent: u8,
}

impl Agreement {
    /// A command went out, 1/1000 of rated.
    pub(super) fn note(&mut self, permille: i16) {
        self.commanded.rotate_right(1);
        let [newest, ..] = &mut self.commanded;
        *newest = permille;
    }

    /// The drive shows this torque. True if it has disagreed for too long.
    pub(super) fn is_broken_by(&mut self, shown_permille: i16) -> bool {
        let lowest = self.commanded.iter().copied().min().unwrap_or(0);
        let highest = self.commanded.iter().copied().max().unwrap_or(0);
        let (low, high) = (lowest.saturating_sub(MARGIN_PERMILLE), highest.saturating_add(MARGIN_PERMILLE));
        self.wrong = if (low..=high).contains(&shown_permille) { 0 } else { self.wrong.saturating_add(1) };
        let absent = (lowest >= WORTH_FOLLOWING && shown_permille < lowest / NO_PART)
            || (highest <= -WORTH_FOLLOWING && shown_permille > highest / NO_PART);
        self.absent = if absent { self.absent.saturating_add(1) } else { 0 };
        self.wrong >= PATIENCE || self.absent >= PATIENCE
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answers_until_broken(command: impl Fn(i16) -> i16, shown: impl Fn(i16) -> i16) -> Option<i16> {
        let mut agreement = Agreement::default();
        (0..1000).find(|k| {
            agreement.note(command(*k));
            agreement.is_broken_by(shown(*k))
        })
    }

    #[test]
    fn a_drive_that_lags_or_ripples_agrees() {
        let ramp = |k: i16| if k / 20 % 2 == 0 { 1500 } else { -1500 };
        assert_eq!(answers_until_broken(ramp, |k| ramp((k - 8).max(0)) + 200), None);
    }

    #[test]
    fn a_drive_that_makes_no_torque_or_the_opposite_one_is_found() {
        assert_eq!(answers_until_broken(|_| 1000, |_| 0), Some(64), "once zero has left the window");
        assert_eq!(answers_until_broken(|_| -60, |_| 0), Some(64), "however little is asked");
        assert_eq!(answers_until_broken(|k| if k / 40 % 2 == 0 { 60 } else { -60 }, |_| 0), None, "to and fro");
        assert_eq!(answers_until_broken(|_| 1000, |_| -1000), Some(49));
        assert_eq!(answers_until_broken(|_| 0, |_| 400), Some(49));
    }
}
