//! The evidence of a model with an error of form, in shadow: computed beside the rules, written by `--trace`, decides nothing.
//!
//! In twice the natural logarithm, over the base:
//!
//! ```text
//! E =  z * gain                    how much better it explains the fit recordings: twice the log-likelihood
//!    - ln det(1 + z P H)           Occam: what the data had to teach; P prior variances, H reduced information
//!    - 2 ln(m / p)                 m candidates were tried; p are the prior odds of a term, one of 32
//! z =  1 / (1 + N / N0)            no form is exact: beyond N0 samples more data do not make it truer
//! ```
//! Laplace's approximation (Kass and Raftery 1995) of a coarsened likelihood (Miller and Dunson 2019). Exact where the model
//! is linear and its prior normal; the gain is then that of the most probable numbers, what the prior takes off counted.
//!
//! RT: no.

use super::numbers::{LEAST_GAIN, LEAST_GAIN_PER_SAMPLE, NEARLY_ALL};
use crate::identify::fitted_model::FittedModel;
use crate::model::effect::EffectKind;
use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use std::sync::{Arc, Mutex};

/// Why one model is preferred to another, part by part.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Evidence {
    /// What the fit gains.
    pub fit: f64,
    /// What its numbers cost (negative) beyond those of the other.
    pub occam: f64,
    /// What the search costs (negative).
    pub search: f64,
}

impl Evidence {
    /// Of `model` over `other`: it gains so much of twice the log-likelihood, and was the best of so many that were tried (0: not
    /// searched).
    #[must_use]
    pub fn over(other: &FittedModel, model: &FittedModel, gain: f64, tried: usize) -> Self {
        let part = coarsening(model.samples());
        let cost = |of: &FittedModel| occam(&of.information, &prior(of), part);
        let search = if tried == 0 { 0.0 } else { -2.0 * libm::log((tried * EffectKind::ALL.len()) as f64) };
        Self { fit: part * gain, occam: cost(other) - cost(model), search }
    }

    /// Twice the logarithm of the odds.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.fit + self.occam + self.search
    }

    /// True if the other model is within Occam's window: odds of less than 20 to 1 (Madigan and Raftery 1994).
    #[must_use]
    pub fn is_in_window(&self) -> bool {
        self.total() < -2.0 * libm::log(1.0 - NEARLY_ALL)
    }
}

/// Samples beyond which more of them make no form truer: where the two limits of the detection threshold meet.
#[must_use]
pub fn form_samples() -> f64 {
    LEAST_GAIN / LEAST_GAIN_PER_SAMPLE
}

/// Part of a likelihood of so many samples that counts.
#[must_use]
pub fn coarsening(samples: usize) -> f64 {
    1.0 / (1.0 + samples as f64 / form_samples())
}

/// `ln det(1 + z P H)`.
#[must_use]
pub fn occam(information: &DMatrix<f64>, prior: &DVector<f64>, part: f64) -> f64 {
    let root = DMatrix::from_diagonal(&prior.map(libm::sqrt));
    let n = information.nrows();
    if n != prior.len() || n == 0 {
        return 0.0;
    }
    let taught = DMatrix::identity(n, n) + (&root * information * &root) * part;
    taught.symmetric_eigenvalues().iter().map(|x| libm::log(x.max(1.0))).sum()
}

/// Variance of each number of `of` before the data: it lies evenly within its bounds.
fn prior(of: &FittedModel) -> DVector<f64> {
    let widths = of.problem.bounds().into_iter().map(|b| b.max - b.min);
    DVector::from_iterator(of.point.parameters.len(), widths.map(|w| w * w / 12.0))
}

/// One comparison, by the rule in charge and by the evidence.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// What was asked: `accept`, `exchange` or `member`.
    pub question: &'static str,
    /// Effect and place that it was asked of.
    pub effect: String,
    /// Its place.
    pub at: String,
    /// The effect that it would replace or stand beside.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub against: Option<String>,
    /// Gain of twice the log-likelihood.
    pub gain: f64,
    /// Answer of the rule.
    pub by_rule: bool,
    /// Which test an effect that is not accepted did not stand, in words.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failed: Option<&'static str>,
    /// Answer of the evidence.
    pub by_evidence: bool,
    /// Its parts.
    pub evidence: Evidence,
}

/// All comparisons of a diagnosis, in order.
#[derive(Clone, Debug, Default)]
pub struct Ledger(Arc<Mutex<Vec<Comparison>>>);

impl Ledger {
    /// Notes one.
    pub fn note(&self, one: Comparison) {
        if let Ok(mut all) = self.0.lock() {
            all.push(one);
        }
    }

    /// Which test an effect did not stand when it was asked last; none if it was accepted or not asked.
    #[must_use]
    pub fn failed(&self, effect: &str, at: &str) -> Option<&'static str> {
        let all = self.0.lock().ok()?;
        let asked =
            |one: &&Comparison| one.question == "accept" && (one.effect.as_str(), one.at.as_str()) == (effect, at);
        all.iter().rev().find(asked)?.failed
    }

    /// Everything that was noted.
    #[must_use]
    pub fn all(&self) -> Vec<Comparison> {
        self.0.lock().map(|all| all.clone()).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `y = J x + e`, `x` and `e` normal: twice the logarithm of `p(y)` over that without `x`, in closed form and by Laplace.
    #[test]
    fn the_ledger_knows_which_test_an_effect_failed_when_it_was_asked_last() {
        let ledger = Ledger::default();
        let note = |question: &'static str, failed: Option<&'static str>| {
            ledger.note(Comparison {
                question,
                effect: "backlash".into(),
                at: "q1".into(),
                against: None,
                gain: 100.0,
                by_rule: failed.is_none(),
                failed,
                by_evidence: true,
                evidence: Evidence { fit: 1.0, occam: 0.0, search: 0.0 },
            });
        };
        note("accept", Some("first"));
        note("accept", Some("last"));
        note("member", None);
        assert_eq!((ledger.failed("backlash", "q1"), ledger.failed("backlash", "q2")), (Some("last"), None));
        note("accept", None);
        assert_eq!(ledger.failed("backlash", "q1"), None, "accepted");
    }

    #[test]
    fn of_a_linear_model_with_a_normal_prior_it_is_exact() {
        let j = DMatrix::from_fn(30, 2, |r, c| libm::cos(0.3 * r as f64 * (c + 1) as f64) + 0.1 * c as f64);
        let y = DVector::from_fn(30, |r, _| 0.7 * libm::cos(0.3 * r as f64) + libm::sin(2.0 * r as f64));
        let prior = DVector::from_vec(vec![4.0, 0.25]);
        let (p, unit) = (DMatrix::from_diagonal(&prior), DMatrix::<f64>::identity(30, 30));
        let spread = &unit + &j * &p * j.transpose();
        let inverse = spread.clone().try_inverse().unwrap();
        let exact = y.dot(&y) - y.dot(&(inverse * &y)) - libm::log(spread.determinant());
        let information = j.tr_mul(&j);
        let inverse = (&information + p.try_inverse().unwrap()).try_inverse().unwrap();
        let x = inverse * j.tr_mul(&y);
        let left = &y - &j * &x;
        let gain = y.dot(&y) - left.dot(&left) - x.component_div(&prior).dot(&x);
        let laplace = gain - occam(&information, &prior, 1.0);
        assert!((exact - laplace).abs() < 1e-9, "{exact} {laplace}");
    }

    #[test]
    fn a_number_that_the_data_say_nothing_of_costs_nothing_and_one_that_they_tell_twice_as_well_costs_2_ln_2_more() {
        let of = |told: f64| {
            occam(&DMatrix::from_diagonal(&DVector::from_vec(vec![told, 0.0])), &DVector::from_vec(vec![1.0, 9.0]), 1.0)
        };
        assert!(of(0.0).abs() < 1e-12);
        assert!((of(4e8) - of(1e8) - 2.0 * libm::log(2.0)).abs() < 1e-6);
    }

    #[test]
    fn more_samples_of_the_same_never_count_for_more_than_a_given_number_of_them() {
        let fit = |samples: usize| coarsening(samples) * 0.5 * samples as f64;
        assert!((fit(10) / 5.0 - 1.0).abs() < 0.01);
        assert!(fit(100_000) < 0.5 * form_samples() && fit(10_000_000) > 0.49 * form_samples());
    }
}
