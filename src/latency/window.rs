//! Percentiles of one window of samples, and how two rivals compare over interleaved windows. RT: no.

use std::fs;

/// The percentiles told of each window, in per cent.
pub const PERCENTILES: [f64; 4] = [50.0, 90.0, 99.0, 99.9];

/// Samples of one window, sorted, us.
#[derive(Clone, Debug, Default)]
pub struct Window {
    sorted_us: Vec<f64>,
}

impl Window {
    /// Sorts the samples; not-a-numbers are left out.
    #[must_use]
    pub fn new(mut samples_us: Vec<f64>) -> Self {
        samples_us.retain(|x| x.is_finite());
        samples_us.sort_by(f64::total_cmp);
        Self { sorted_us: samples_us }
    }

    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.sorted_us.len()
    }

    /// True without samples.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.sorted_us.is_empty()
    }

    /// The smallest sample that is not below `percent` of all (nearest rank), us; NaN without samples.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a rank between 0 and the length")]
    #[expect(clippy::cast_precision_loss, reason = "fewer than 2^52 samples")]
    pub fn percentile_us(&self, percent: f64) -> f64 {
        let rank = (percent / 100.0 * self.sorted_us.len() as f64 - 1e-9).ceil() as usize;
        self.sorted_us.get(rank.saturating_sub(1)).copied().unwrap_or(f64::NAN)
    }

    /// The largest sample, us; NaN without samples.
    #[must_use]
    pub fn max_us(&self) -> f64 {
        self.sorted_us.last().copied().unwrap_or(f64::NAN)
    }

    /// All samples, ascending, us.
    #[must_use]
    pub fn samples_us(&self) -> &[f64] {
        &self.sorted_us
    }
}

/// Two rivals measured in turn.
#[derive(Clone, Debug, Default)]
pub struct Paired {
    /// Our windows.
    pub ours: Vec<Window>,
    /// Their windows, each beside ours of the same index.
    pub theirs: Vec<Window>,
}

impl Paired {
    /// Median over windows of our percentile, us.
    #[must_use]
    pub fn ours_us(&self, percent: f64) -> f64 {
        median(self.ours.iter().map(|w| w.percentile_us(percent)).collect())
    }

    /// Median over windows of their percentile, us.
    #[must_use]
    pub fn theirs_us(&self, percent: f64) -> f64 {
        median(self.theirs.iter().map(|w| w.percentile_us(percent)).collect())
    }

    /// Median over pairs of windows of the ratio ours / theirs at a percentile.
    #[must_use]
    pub fn ratio(&self, percent: f64) -> f64 {
        let ratios =
            self.ours.iter().zip(&self.theirs).map(|(a, b)| a.percentile_us(percent) / b.percentile_us(percent));
        median(ratios.collect())
    }

    /// All windows of one rival as one, for the histogram.
    #[must_use]
    pub fn pooled(windows: &[Window]) -> Window {
        Window::new(windows.iter().flat_map(|w| w.samples_us().iter().copied()).collect())
    }
}

/// Median; NaN of nothing.
#[must_use]
pub fn median(mut values: Vec<f64>) -> f64 {
    values.retain(|x| x.is_finite());
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => f64::NAN,
        n if n % 2 == 1 => values[n / 2],
        n => 0.5 * (values[n / 2 - 1] + values[n / 2]),
    }
}

/// Processor time so far, as the kernel counts it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CpuTime {
    /// All time, clock ticks.
    pub total: u64,
    /// Time that the hypervisor gave to others, clock ticks.
    pub stolen: u64,
}

impl CpuTime {
    /// Reads `/proc/stat`; zeros where there is none.
    #[must_use]
    pub fn now() -> Self {
        fs::read_to_string("/proc/stat").ok().as_deref().and_then(Self::parse).unwrap_or_default()
    }

    fn parse(stat: &str) -> Option<Self> {
        let line = stat.lines().find(|l| l.starts_with("cpu "))?;
        let fields: Vec<u64> = line.split_whitespace().skip(1).filter_map(|x| x.parse().ok()).collect();
        // user nice system idle iowait irq softirq steal; guest times are in user already.
        Some(Self { total: fields.iter().take(8).sum(), stolen: fields.get(7).copied()? })
    }

    /// Stolen share since `earlier`, 0 to 1.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "tick counts are small")]
    pub fn stolen_share_since(self, earlier: Self) -> f64 {
        let total = self.total.saturating_sub(earlier.total);
        if total == 0 { 0.0 } else { self.stolen.saturating_sub(earlier.stolen) as f64 / total as f64 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentile_is_the_nearest_rank() {
        let w = Window::new((1..=1000).map(f64::from).collect());
        for (percent, rank) in PERCENTILES.into_iter().zip([500.0, 900.0, 990.0, 999.0]) {
            assert!((w.percentile_us(percent) - rank).abs() < 1e-12, "{percent}");
        }
        assert!(Window::default().percentile_us(50.0).is_nan());
    }

    #[test]
    fn ratio_is_the_median_over_pairs_so_that_one_bad_window_does_not_count() {
        let flat = |v: f64| Window::new(vec![v; 10]);
        let pair =
            Paired { ours: vec![flat(1.0), flat(2.0), flat(900.0)], theirs: vec![flat(2.0), flat(4.0), flat(4.0)] };
        assert!((pair.ratio(50.0) - 0.5).abs() < 1e-15);
    }

    #[test]
    fn stolen_time_is_the_eighth_field() {
        let a = CpuTime::parse("cpu  10 0 10 70 0 0 0 10 5 0\ncpu0 1\n").unwrap();
        assert_eq!(a, CpuTime { total: 100, stolen: 10 });
        let b = CpuTime { total: 200, stolen: 60 };
        assert!((b.stolen_share_since(a) - 0.5).abs() < 1e-15);
    }
}
