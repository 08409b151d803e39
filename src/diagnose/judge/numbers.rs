//! Every number that decides whether an effect exists, which one it is, or what the verdict is called.
//!
//! Each with where it comes from: *measured* (on which data), *argued* (from what), *stated* or *by definition*. One question, one number:
//! where two rules ask the same of different things they use the same one. Gains are in
//! twice the natural logarithm of a likelihood, "threshold" is [`super::criterion::detection_threshold`].
//! RT: no.

// Is it more than chance?

/// Least gain of anything over the model without it. *Measured:* a search over some 200 starts brings less than 30 on healthy cases
/// with exact noise; the double of it. Two models that differ by less are not told apart either.
pub const LEAST_GAIN: f64 = 60.0;
/// The same per sample. *Measured:* rounding and solvers of other simulators bring up to .025 on healthy cases.
pub const LEAST_GAIN_PER_SAMPLE: f64 = 0.02;
/// Lead of one model over another, in twice the log-likelihood, that is clear. *Argued:* odds of 150 to 1 (Kass and Raftery 1995: very
/// strong).
pub const CLEAR_LEAD: f64 = 10.0;
/// Standard deviations within which a number is not told from another. *By definition:* 95 %.
pub const DEVIATIONS: f64 = 1.96;
/// Gain of a free curve per number that is chance. *Argued:* three times its expectation.
pub const CHANCE_PER_NUMBER: f64 = 3.0;
/// Longest correlation of noise, in samples. *Measured:* healthy machines of other simulators come to 3.5, filtered noise (a pole
/// of .8) to 5; mismatches to 200.
pub const LONGEST_MEMORY: f64 = 6.0;
/// Residual over sample-to-sample noise from which it is no noise, and ratio of two residuals from which they differ. *Argued.*
pub const ABOVE_NOISE: f64 = 3.0;

// Is it that, or the finish of something else? No law of the library is exact.

/// Part of a gain that is the error of form of what gained it, where but noise is left. *Argued.*
pub const FORM: f64 = 0.02;
/// The same where smooth misfit stays. *Measured* on recordings of hardware: a pendulum with gears, where a ripple (.14) and a play
/// (.06) came after the Coulomb friction that explains it.
pub const ROUGH_FORM: f64 = 0.15;
/// Part of a claim from which it is borne out, and of a whole from which a rest counts. *Argued.*
pub const QUARTER: f64 = 0.25;
/// The greater part: of a gain, of a channel's spread, of a period of a swing or a wave. *By definition.*
pub const GREATER_PART: f64 = 0.5;
/// Nearly all. *Argued:* 1 in 20.
pub const NEARLY_ALL: f64 = 0.95;

// Can it be found in these recordings?

/// Effects that fit a piece of anything, from which on they are a poor man's free curve. *Argued.*
pub const LOCAL_TERMS: usize = 2;
/// How long a touchdown takes at most, s. *Stated:* soft contacts of simulators and rubber feet settle within it; what moves a robot
/// for longer is no contact's finish.
pub const TOUCHDOWN_S: f64 = 0.01;

// What is said of it?

/// Smallest part of the misfit that an effect removes when it matters; `--least` asks for another. *Measured:* 13 of 186 healthy
/// cases of other simulators were called ill for something that removes .02 to .11; the least of a true one
/// was .13 in 88 cases with effects and .10 in `blind-dev` (a drive's limit).
pub const LEAST_SHARE: f64 = 0.08;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::likelihood::memory;
    use crate::identify::noise::Colour;
    use statrs::distribution::{ChiSquared, ContinuousCDF, Normal};

    fn chi_squared(numbers: u32, above: f64) -> f64 {
        ChiSquared::new(f64::from(numbers)).unwrap().inverse_cdf(1.0 - above)
    }

    #[test]
    fn least_gain_is_the_double_of_what_the_best_of_200_starts_of_three_numbers_brings_by_chance_once_in_a_thousand() {
        let by_chance = chi_squared(3, 0.001 / 200.0);
        assert!((LEAST_GAIN / (2.0 * by_chance) - 1.0).abs() < 0.15, "{by_chance}");
    }

    #[test]
    fn a_clear_lead_are_odds_of_150_to_1_and_deviations_95_per_cent() {
        assert!((libm::exp(0.5 * CLEAR_LEAD) / 150.0 - 1.0).abs() < 0.02);
        let within = 2.0 * Normal::new(0.0, 1.0).unwrap().cdf(DEVIATIONS) - 1.0;
        assert!((within - NEARLY_ALL).abs() < 1e-4, "{within}");
    }

    #[test]
    fn a_free_curve_of_15_to_120_numbers_brings_less_by_chance_and_two_for_each_would_be_too_little() {
        let once_in_a_thousand = |numbers: u32| chi_squared(numbers, 0.001) / f64::from(numbers);
        assert!([15, 40, 120].iter().all(|n| once_in_a_thousand(*n) < CHANCE_PER_NUMBER));
        assert!(once_in_a_thousand(15) > CHANCE_PER_NUMBER - 1.0);
    }

    #[test]
    fn noise_through_a_filter_with_a_pole_of_four_fifths_is_noise_and_with_nine_tenths_is_none() {
        let of_pole = |pole: f64| memory(&Colour { ar: vec![pole], sigma: 1.0 });
        assert!(of_pole(0.8) < LONGEST_MEMORY && of_pole(0.9) > LONGEST_MEMORY, "{} {}", of_pole(0.8), of_pole(0.9));
    }
}
