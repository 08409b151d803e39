//! Whether hidden states are those of one machine that is not started again at each window.
//!
//! RT: no.

use super::numbers::GREATER_PART;
use crate::diagnose::robustness::state_continuity::{Ringing, gain_ratio_with_continuous_states};
use crate::identify::fitted_model::FittedModel;

/// True if the inner states that `richer` adds to `plain`, if any, may go on from window to window.
#[must_use]
pub fn has_continuous_states(plain: &FittedModel, richer: &FittedModel, floors: &[f64]) -> bool {
    is_continuous(gain_ratio_with_continuous_states(plain, richer, floors))
}

/// True if effect `e` of `of` is a mode of a link that does not die away within a recording and owes most of what it explains
/// to how it rings at the start: what sustains it is no motion of the link but something that shakes the machine.
#[must_use]
pub fn is_externally_driven(of: &FittedModel, e: usize, floors: &[f64]) -> bool {
    Ringing::of_mode(of, e, floors).is_some_and(is_shaken_from_elsewhere)
}

/// True if an effect keeps enough of its gain when its inner states go on from window to window; `kept`: that part, `None` if it
/// has none that could.
fn is_continuous(kept: Option<f64>) -> bool {
    kept.is_none_or(|kept| kept >= GREATER_PART)
}

/// True if a mode owes most of what it explains to how it rings at the start of a recording, not to the motion of its link.
fn is_shaken_from_elsewhere(mode: Ringing) -> bool {
    let Ringing { as_fitted, from_rest, without } = mode;
    as_fitted > without && from_rest - without < GREATER_PART * (as_fitted - without)
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
        let is_shaken =
            |as_fitted: f64, from_rest: f64| is_shaken_from_elsewhere(Ringing { as_fitted, from_rest, without: 0.0 });
        assert!(!is_shaken(100.0, 80.0) && is_shaken(100.0, 20.0));
        assert!(!is_shaken(-1.0, -2.0), "a mode that explains nothing is not judged here");
    }
}
