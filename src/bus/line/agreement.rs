//! Does a drive make the torque that it was asked for? RT: yes.
//!
//! What it shows must lie between the lowest and the highest torque commanded of late, with a margin: so neither the
//! lag of its current loop nor the delay of the bus is blamed.

/// Commands that are looked back at: more than lag and delay of any drive that this control works with.
const WINDOW: usize = 16;
/// Margin, 1/1000 of rated torque: ripple and error of its current measurement.
const MARGIN_PERMILLE: i16 = 300;
/// Answers in a row that must be wrong: 50 ms at 1 kHz.
const PATIENCE: u8 = 50;

/// The torques commanded of late.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Agreement {
    commanded: [i16; WINDOW],
    wrong: u8,
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
        let low = self.commanded.iter().copied().min().unwrap_or(0).saturating_sub(MARGIN_PERMILLE);
        let high = self.commanded.iter().copied().max().unwrap_or(0).saturating_add(MARGIN_PERMILLE);
        self.wrong = if (low..=high).contains(&shown_permille) { 0 } else { self.wrong.saturating_add(1) };
        self.wrong >= PATIENCE
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
        assert_eq!(answers_until_broken(|_| 1000, |_| -1000), Some(49));
        assert_eq!(answers_until_broken(|_| 0, |_| 400), Some(49));
    }
}
