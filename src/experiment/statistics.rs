//! What counts of runs and falls say, and how surely. RT: no.

use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Two-sided 95 % of the normal distribution.
const Z_95: f64 = 1.959_963_984_540_054;

/// A share of successes with its 95 % interval (Wilson 1927, (2)-(3)): sensible at 0 and at all as well.
#[must_use]
pub fn wilson(successes: u32, runs: u32) -> [f64; 2] {
    if runs == 0 {
        return [0.0, 1.0];
    }
    let (n, p) = (f64::from(runs), f64::from(successes) / f64::from(runs));
    let z2 = Z_95 * Z_95;
    let centre = p + z2 / (2.0 * n);
    let half = Z_95 * libm::sqrt(p * (1.0 - p) / n + z2 / (4.0 * n * n));
    let scale = 1.0 + z2 / n;
    [((centre - half) / scale).max(0.0), ((centre + half) / scale).min(1.0)]
}

/// Mean first-passage time in steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstPassage {
    /// Steps per fall; none if there was no fall.
    pub mean_steps: Option<f64>,
    /// 95 % confidence: two-sided, or a lower bound alone (N / 3) if there was no fall.
    pub low_steps: f64,
    /// The upper end, if there was a fall.
    pub high_steps: Option<f64>,
}

/// Mean steps to a fall from runs of together `steps` steps with `falls` falls; runs that were ended are censored.
///
/// A robust walk forgets its start within a few steps and then falls with the same small probability in every one, so the
/// number of steps to a fall is exponential (Byl and Tedrake 2009, metastable walking). Then `2 N / mean` is χ²: with
/// `2 k + 2` degrees of freedom at the low end and `2 k` at the high end (Epstein 1954, time-censored).
#[must_use]
pub fn first_passage(steps: u64, falls: u32) -> FirstPassage {
    #[expect(clippy::cast_precision_loss, reason = "steps of some weeks")]
    let (n, k) = (steps as f64, f64::from(falls));
    if falls == 0 {
        return FirstPassage { mean_steps: None, low_steps: 2.0 * n / quantile(0.95, 2.0), high_steps: None };
    }
    FirstPassage {
        mean_steps: Some(n / k),
        low_steps: 2.0 * n / quantile(0.975, 2.0 * k + 2.0),
        high_steps: Some(2.0 * n / quantile(0.025, 2.0 * k)),
    }
}

fn quantile(p: f64, freedom: f64) -> f64 {
    ChiSquared::new(freedom).map_or(f64::NAN, |d| d.inverse_cdf(p))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilson_agrees_with_published_figures() {
        // Newcombe 1998, table I, method 3: 81 of 263, 15 of 148, 0 of 20, 1 of 29.
        for (r, n, low, high) in
            [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)]
        {
            let [a, b] = wilson(r, n);
            assert!((a - low).abs() < 1e-4 && (b - high).abs() < 1e-4, "{r}/{n}: {a} {b}");
        }
        assert!((wilson(20, 20)[1] - 1.0).abs() < 1e-12);
    }

    #[test]
    fn no_fall_in_n_steps_means_a_third_of_them_at_95_percent() {
        let f = first_passage(3000, 0);
        assert!(f.mean_steps.is_none() && f.high_steps.is_none());
        // -ln .05 = 2.9957.
        assert!((f.low_steps - 3000.0 / 2.995_732).abs() < 0.1, "{f:?}");
    }

    #[test]
    fn band_of_first_passage_covers_the_truth_in_95_of_100_experiments() {
        use rand::{Rng, SeedableRng};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        let mut uniform = || ((rng.next_u64() >> 11) + 1) as f64 / 9_007_199_254_740_992.0;
        // Ten runs to a fall of mean 300, ended at 500 steps.
        let covered = (0..2000).filter(|_| {
            let (mut steps, mut falls) = (0.0, 0);
            for _ in 0..10 {
                let life = -300.0 * libm::log(uniform());
                falls += u32::from(life < 500.0);
                steps += life.min(500.0);
            }
            let f = first_passage(steps as u64, falls);
            f.low_steps <= 300.0 && f.high_steps.is_none_or(|high| high >= 300.0)
        });
        let covered = covered.count();
        assert!((1880..=1960).contains(&covered), "{covered} of 2000");
    }
}
