//! Whether hidden states are those of one machine that is not started again at each window.
//!
//! RT: no.

use super::numbers::GREATER_PART;

/// True if an effect keeps enough of its gain when its inner states go on from window to window; `kept`: that part, `None` if it
/// has none that could.
#[must_use]
pub fn is_continuous(kept: Option<f64>) -> bool {
    kept.is_none_or(|kept| kept >= GREATER_PART)
}

/// True if a mode owes most of what it explains to how it rings at the start of a recording, not to the motion of its link.
/// Likelihoods: as fitted, from rest, and without the mode.
#[must_use]
pub fn is_shaken_from_elsewhere(ringing: f64, from_rest: f64, without: f64) -> bool {
    ringing > without && from_rest - without < GREATER_PART * (ringing - without)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn states_that_start_anew_in_each_window_are_none_of_a_machine() {
        assert!(is_continuous(None) && is_continuous(Some(0.9)) && !is_continuous(Some(0.2)));
    }

    #[test]
    fn a_mode_that_rings_from_rest_is_driven_by_its_link() {
        assert!(!is_shaken_from_elsewhere(100.0, 80.0, 0.0) && is_shaken_from_elsewhere(100.0, 20.0, 0.0));
        assert!(!is_shaken_from_elsewhere(-1.0, -2.0, 0.0), "a mode that explains nothing is not judged here");
    }
}
