//! How sure a median or a mean over a few cases is. RT: no.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Resamples; their own scatter moves an end by a few per cent of the interval's width.
const RESAMPLES: usize = 2000;
/// Fewer values than this say nothing of their spread.
const FEWEST: usize = 5;

/// 95 % interval of a statistic of these values by resampling them (percentile bootstrap, Efron 1979). The same values
/// give the same interval: the draws are seeded.
pub(super) fn interval(values: &[f64], statistic: impl Fn(&[f64]) -> Option<f64>) -> Option<(f64, f64)> {
    if values.len() < FEWEST {
        return None;
    }
    let mut draws = ChaCha8Rng::seed_from_u64(0);
    let mut once = |_| {
        let resample: Vec<f64> = values.iter().map(|_| values[draws.random_range(0..values.len())]).collect();
        statistic(&resample)
    };
    let mut seen: Vec<f64> = (0..RESAMPLES).filter_map(&mut once).collect();
    seen.sort_by(f64::total_cmp);
    let last = seen.len().checked_sub(1)?;
    Some((seen[last * 25 / 1000], seen[last * 975 / 1000]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mean(values: &[f64]) -> Option<f64> {
        Some(values.iter().sum::<f64>() / values.len() as f64)
    }

    #[test]
    fn interval_of_a_mean_is_that_of_its_standard_error() {
        // 0..99: deviation 28.9, standard error 2.89, 95 % within 49.5 +- 5.66. Resampling scatters by a tenth of that.
        let values: Vec<f64> = (0..100).map(f64::from).collect();
        let (low, high) = interval(&values, mean).unwrap();
        assert!((low - 43.8).abs() < 0.8 && (high - 55.2).abs() < 0.8, "{low} {high}");
    }

    #[test]
    fn a_few_values_have_no_interval() {
        assert_eq!(interval(&[1.0, 2.0, 3.0, 4.0], mean), None);
    }
}
