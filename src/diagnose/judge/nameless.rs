//! Whether a force without a name says more than the effects that were found. What it is and where stands in `unlisted`.
//!
//! RT: no.

use super::criterion::{Context, compare, detection_threshold};
use super::numbers::{CHANCE_PER_NUMBER, QUARTER, ROUGH_FORM};
use crate::identify::fitted_model::FittedModel;

/// What the residual forces of base and found model say beside each other.
#[derive(Clone, Copy, Debug)]
pub struct Excess {
    /// From when on a free force counts: [`detection_threshold`].
    pub threshold: f64,
    /// Of the free force on the base alone.
    pub on_base: f64,
    /// Gain of the listed effects in the same measure.
    pub listed: f64,
}

/// Gain of a free force of so many numbers beyond what they bring by chance.
#[must_use]
pub fn beyond_chance(gain: f64, numbers: usize) -> f64 {
    gain - CHANCE_PER_NUMBER * numbers as f64
}

impl Excess {
    /// True if there is a force in the base's residual at all.
    #[must_use]
    pub fn counts(&self) -> bool {
        self.on_base > self.threshold
    }

    /// True if the force says more than any listed effects.
    #[must_use]
    pub fn beats_listed(&self) -> bool {
        self.on_base > self.threshold.max((1.0 + QUARTER) * self.listed + self.threshold)
    }

    /// True if there is another force on top of the listed effects.
    #[must_use]
    pub fn counts_on_top(&self, on_found: f64) -> bool {
        on_found > self.threshold.max(QUARTER * self.listed)
    }

    /// True if so little structure is left that what explained the rest is the explanation.
    #[must_use]
    pub fn leaves_little(&self, left: f64) -> bool {
        left < self.threshold.max(QUARTER * self.on_base)
    }
}

/// True if the listed effects remove so much of all squares that what is left is the finish of their form.
#[must_use]
pub fn is_removed(part: f64) -> bool {
    1.0 - part <= QUARTER
}

/// True if the listed effects predict recordings that no fit saw better than a force does, by how much the squares fall with each.
#[must_use]
pub fn names_predict_better(listed: f64, force: f64) -> bool {
    listed > force
}

/// True if a change of the machine with so many numbers is ahead of the listed effects, which gained `listed`.
#[must_use]
pub fn change_is_ahead(ahead: f64, listed: f64, numbers: usize, context: &Context) -> bool {
    ahead > detection_threshold(context, numbers).max(ROUGH_FORM * listed)
}

/// True if a fitted force over position is clearly ahead of `found`, its numbers paid for. `ripples`: what was found are several
/// ripples at that joint, a poor man's free curve and hardly a machine's, which need not be beaten by far.
#[must_use]
pub fn curve_is_ahead(
    curve: &FittedModel,
    found: &FittedModel,
    base: &FittedModel,
    ripples: bool,
    context: &Context,
) -> bool {
    let ahead = compare(curve, found, context);
    let numbers = curve.point.parameters.len().saturating_sub(found.point.parameters.len());
    let listed = compare(curve, base, context).total - ahead.total;
    let least = if ripples {
        CHANCE_PER_NUMBER * numbers as f64
    } else {
        detection_threshold(context, numbers).max(ROUGH_FORM * listed)
    };
    ahead.low > 0.0 && ahead.total > least
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::evidence::Ledger;

    fn context(samples: usize) -> Context {
        Context {
            floors: vec![1e-3],
            samples,
            given: 0,
            is_trapped: false,
            seed: 1,
            ledger: Ledger::default(),
            held_out: None,
        }
    }

    #[test]
    fn a_force_counts_beyond_chance() {
        assert!((beyond_chance(100.0, 10) - 70.0).abs() < 1e-12);
    }

    #[test]
    fn a_free_force_must_say_more_than_what_was_named() {
        let of = |on_base, listed| Excess { threshold: 80.0, on_base, listed };
        assert!(!of(79.0, 0.0).counts() && of(81.0, 0.0).counts());
        assert!(!of(800.0, 1000.0).beats_listed());
        assert!(of(1340.0, 1000.0).beats_listed() && !of(1320.0, 1000.0).beats_listed());
        assert!(of(0.0, 1000.0).counts_on_top(260.0) && !of(0.0, 1000.0).counts_on_top(240.0));
        assert!(of(1000.0, 0.0).leaves_little(240.0) && !of(1000.0, 0.0).leaves_little(260.0));
    }

    #[test]
    fn a_change_of_the_machine_pays_for_its_numbers_and_for_the_error_of_form() {
        assert!(change_is_ahead(110.0, 0.0, 4, &context(1000)) && !change_is_ahead(80.0, 0.0, 4, &context(1000)));
        assert!(!change_is_ahead(110.0, 2000.0, 4, &context(1000)), "15 % of what was listed");
    }
}
