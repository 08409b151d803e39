//! How much better one fitted model is than another, and from when on that counts.
//!
//! RT: no.

use super::evidence::Ledger;
use super::numbers::{GREATER_PART, LEAST_GAIN, LEAST_GAIN_PER_SAMPLE, LONGEST_MEMORY};
use crate::diagnose::robustness::held_out::HeldOut;
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::{Difference, difference, memory};
use std::sync::Arc;

/// What every comparison needs to know of the case.
#[derive(Clone, Debug)]
pub struct Context {
    /// Smallest standard deviation of each channel's residual; infinite: the channel has no weight.
    pub floors: Vec<f64>,
    /// Samples that carry weight.
    pub samples: usize,
    /// Effects of the rig as given.
    pub given: usize,
    /// The base stands at bounds: one step then promises nothing, whatever is missing.
    pub is_trapped: bool,
    /// Seed of the bootstraps.
    pub seed: u64,
    /// What was compared, for `--trace`.
    pub ledger: Ledger,
    /// Recordings that no fit saw, if there are any.
    pub held_out: Option<Arc<HeldOut>>,
}

/// Rise of twice the log-likelihood from which `numbers` more numbers are worth calling a mismatch: a penalised likelihood
/// (Schwarz 1978), with a floor for the search over the library and for the error of form, which grows with the samples.
#[must_use]
pub fn detection_threshold(context: &Context, numbers: usize) -> f64 {
    let samples = context.samples as f64;
    (LEAST_GAIN_PER_SAMPLE * samples).max(LEAST_GAIN) + numbers as f64 * libm::log(samples.max(2.0))
}

/// True if the best promise of a linear step is too little for a round of fits: a healthy machine is not worth a dozen.
#[must_use]
pub fn promises_little(most: f64, context: &Context) -> bool {
    !context.is_trapped && most < GREATER_PART * detection_threshold(context, 1)
}

/// True if what `of` leaves passes for noise that is slower than a healthy machine's.
#[must_use]
pub fn leaves_slow_noise(of: &FittedModel) -> bool {
    of.noise.iter().any(|colour| memory(colour) > LONGEST_MEMORY)
}

/// How much better `a` is than `b` under the noise that `a` leaves.
#[must_use]
pub fn compare(a: &FittedModel, b: &FittedModel, context: &Context) -> Difference {
    difference(&a.blocks(&a.noise), &b.blocks(&a.noise), context.seed)
}

/// Part of the misfit energy above the noise that `after` removes.
#[must_use]
pub fn explained_part(before: &FittedModel, after: &FittedModel, context: &Context) -> f64 {
    let energy = |h: &FittedModel| -> f64 {
        let runs = h.residuals.iter().zip(&after.noise).zip(&context.floors).filter(|(_, f)| f.is_finite());
        runs.map(|((r, c), _)| r.iter().flatten().map(|x| (x / c.sigma).powi(2)).sum::<f64>()).sum()
    };
    let (had, has) = (energy(before), energy(after));
    if had > 0.0 { (1.0 - has / had).clamp(0.0, 1.0) } else { 0.0 }
}

/// True if `after` removes the greater part of the misfit of `before`.
#[must_use]
pub fn explains_most(before: &FittedModel, after: &FittedModel, context: &Context) -> bool {
    explained_part(before, after, context) > GREATER_PART
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::worked::{Shown, shown};

    fn context(samples: usize, is_trapped: bool) -> Context {
        Context {
            floors: vec![1e-3],
            samples,
            given: 0,
            is_trapped,
            seed: 1,
            ledger: Ledger::default(),
            held_out: None,
        }
    }

    #[test]
    fn the_threshold_has_a_floor_grows_with_the_samples_and_with_each_number() {
        let at = |samples, numbers| detection_threshold(&context(samples, false), numbers);
        assert!((at(1000, 0) - LEAST_GAIN).abs() < 1e-12);
        assert!((at(6000, 0) / at(3000, 0) - 2.0).abs() < 1e-12, "from 3000 samples on by sample");
        assert!((at(1000, 3) - at(1000, 0) - 3.0 * libm::log(1000.0)).abs() < 1e-12);
    }

    #[test]
    fn a_base_at_its_bounds_is_searched_whatever_a_step_promises() {
        assert!(promises_little(10.0, &context(1000, false)) && !promises_little(10.0, &context(1000, true)));
        assert!(!promises_little(40.0, &context(1000, false)));
    }

    #[test]
    fn drag_explains_most_of_what_drag_left_and_a_hundredth_of_it_does_not() {
        let drag = |value: f64| format!("[[effect]]\neffect = \"quadratic_drag\"\nat = \"q1\"\nquadratic = {value}\n");
        let Shown { context, problem } = shown(&drag(0.004));
        let of = |value: f64| problem.fitted(&drag(value), 20);
        let without = problem.fitted("", 20);
        assert!(explains_most(&without, &of(0.004), &context) && !explains_most(&without, &of(0.00004), &context));
    }
}
