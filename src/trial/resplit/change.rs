//! What is changed between a case and its variant. RT: no.

use super::rig_file::Entry;
use crate::trial::dice::Dice;

/// One change besides the choice of recordings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Change {
    /// Only other recordings are fitted and kept back.
    Split,
    /// One fit recording fewer; where one is all there is, it is halved.
    OneFewer,
    /// Windows of half or twice the length.
    Window(f64),
    /// Every second sample, from this one on.
    EverySecond(usize),
    /// The first or the second half of each recording.
    Half {
        /// The second?
        second: bool,
    },
    /// White noise as large as the channel's own on every sensor.
    Noise,
}

impl Change {
    /// In a word or two.
    pub fn name(self) -> String {
        match self {
            Self::Split => "other split".to_owned(),
            Self::OneFewer => "one recording fewer".to_owned(),
            Self::Window(factor) => format!("windows x {factor}"),
            Self::EverySecond(from) => format!("every second sample from {from}"),
            Self::Half { second } => format!("{} halves", if second { "second" } else { "first" }),
            Self::Noise => "noise".to_owned(),
        }
    }
}

/// The kinds in turn, so that every kind is asked alike often.
pub(super) fn of_number(number: usize, dice: &mut Dice) -> Change {
    match number % 6 {
        0 => Change::Split,
        1 => Change::OneFewer,
        2 => Change::Window(if (number / 6).is_multiple_of(2) { 0.5 } else { 2.0 }),
        3 => Change::EverySecond(number / 6 % 2),
        4 => Change::Half { second: dice.chance(0.5) },
        _ => Change::Noise,
    }
}

/// Another choice of the recordings to fit and to keep back. As many of each kind as the case has, or as many as the
/// other has, where that is possible; at least one of each.
pub(super) fn split(entries: &mut [Entry], dice: &mut Dice) {
    let heldout = entries.iter().filter(|e| e.is_heldout).count();
    let swapped = entries.len() - heldout;
    let count = if dice.chance(0.5) { heldout } else { swapped }.clamp(1, entries.len().saturating_sub(1).max(1));
    entries.iter_mut().for_each(|e| e.is_heldout = false);
    for _ in 0..count.min(entries.len()) {
        let left: Vec<usize> = (0..entries.len()).filter(|i| !entries[*i].is_heldout).collect();
        entries[*dice.pick(&left)].is_heldout = true;
    }
}

/// Leaves one of the fit recordings out; false where there is only one.
pub(super) fn leave_one_out(entries: &mut Vec<Entry>, dice: &mut Dice) -> bool {
    let fit: Vec<usize> = (0..entries.len()).filter(|i| !entries[*i].is_heldout).collect();
    if fit.len() < 2 {
        return false;
    }
    entries.remove(*dice.pick(&fit));
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entries(fit: usize, heldout: usize) -> Vec<Entry> {
        (0..fit + heldout).map(|i| Entry { table: toml::Table::new(), is_heldout: i >= fit }).collect()
    }

    #[test]
    fn every_split_fits_something_and_keeps_something_back() {
        let mut dice = Dice::new(1, 0);
        for _ in 0..200 {
            let mut of = entries(4, 2);
            split(&mut of, &mut dice);
            let heldout = of.iter().filter(|e| e.is_heldout).count();
            assert!(heldout == 2 || heldout == 4, "{heldout}");
            let mut two = entries(1, 1);
            split(&mut two, &mut dice);
            assert_eq!(two.iter().filter(|e| e.is_heldout).count(), 1);
        }
    }

    #[test]
    fn one_fewer_never_takes_the_last() {
        let mut dice = Dice::new(1, 0);
        let (mut many, mut one) = (entries(3, 1), entries(1, 2));
        assert!(leave_one_out(&mut many, &mut dice) && many.len() == 3);
        assert!(!leave_one_out(&mut one, &mut dice) && one.len() == 3);
    }

    #[test]
    fn thirty_variants_ask_every_kind_five_times() {
        let mut dice = Dice::new(1, 0);
        let kinds: Vec<Change> = (0..30).map(|k| of_number(k, &mut dice)).collect();
        assert_eq!(kinds.iter().filter(|c| matches!(c, Change::Window(_))).count(), 5);
        assert_eq!(kinds.iter().filter(|c| **c == Change::Noise).count(), 5);
    }
}
