//! What the residual of one channel is made of: coloured noise with a scale, and how to take the colour out.
//!
//! A residual is whitened by an autoregressive (AR) model before it is squared, so that twice the log-likelihood may be
//! compared between models: a smooth mismatch and a slowly correlated noise then count for what they are worth.
//! Gaps (missing samples) shorten the series; a step over a gap is treated like any other.
//! RT: no.

/// Highest order of the AR model of a residual. 8 lags at 250 Hz to 1 kHz cover the correlation of filtered sensors.
pub const MAX_ORDER: usize = 8;

/// Degrees of freedom of the Student density of innovations: 97 % efficient for Gauss noise, and an outlier of any size
/// counts for no more than about three standard deviations in the spread.
const NU: f64 = 10.0;

/// Noise of one channel: AR coefficients and the standard deviation of what drives them.
#[derive(Clone, Debug, PartialEq)]
pub struct Colour {
    /// `e_k = r_k - sum a_j r_(k-j)`; empty for white noise.
    pub ar: Vec<f64>,
    /// Standard deviation of `e`, in the unit of the channel. 0 or infinite: the channel has no weight.
    pub sigma: f64,
}

impl Colour {
    /// White noise of standard deviation `sigma`.
    #[must_use]
    pub const fn white(sigma: f64) -> Self {
        Self { ar: Vec::new(), sigma }
    }

    /// Innovations of `series` in units of `sigma`, in place; missing samples (NaN in `valid`'s sense) stay untouched.
    ///
    /// In: `present`, rows that carry a sample. The first `order` rows of a run are only scaled by the marginal spread.
    pub fn whiten(&self, series: &mut [f64], present: &[usize]) {
        let order = self.ar.len();
        let scale = 1.0 / self.sigma;
        let head = self.head_scale() * scale;
        for n in (0..present.len()).rev() {
            let k = present[n];
            if n < order {
                series[k] *= head;
            } else {
                let past: f64 = self.ar.iter().enumerate().map(|(j, a)| a * series[present[n - 1 - j]]).sum();
                series[k] = (series[k] - past) * scale;
            }
        }
    }

    /// Independent samples per sample, for a slow quantity: variance over spectrum at zero frequency; at most 1.
    #[must_use]
    pub fn independent_part(&self) -> f64 {
        let rest = 1.0 - self.ar.iter().sum::<f64>();
        let marginal = 1.0 / self.head_scale();
        (rest * marginal * rest * marginal).min(1.0)
    }

    /// Ratio of innovation to marginal standard deviation: `sqrt(prod (1 - k_j^2))` of the reflection coefficients.
    fn head_scale(&self) -> f64 {
        reflections(&self.ar).iter().map(|k| (1.0 - k * k).max(1e-6)).product::<f64>().sqrt()
    }
}

/// Reflection coefficients of an AR model (step-down recursion).
fn reflections(ar: &[f64]) -> Vec<f64> {
    let mut a = ar.to_vec();
    let mut out = vec![0.0; ar.len()];
    for m in (0..ar.len()).rev() {
        let k = a[m].clamp(-0.9999, 0.9999);
        out[m] = k;
        let scale = 1.0 - k * k;
        let lower: Vec<f64> = (0..m).map(|j| (a[j] + k * a[m - 1 - j]) / scale).collect();
        a.truncate(m);
        a.copy_from_slice(&lower);
    }
    out
}

/// Student's loss of a whitened residual: `e^2` near zero, logarithmic far out; -2 log likelihood but for a constant.
#[must_use]
pub fn loss(e: f64) -> f64 {
    (NU + 1.0) * libm::log1p(e * e / NU)
}

/// Weight of a whitened residual in iteratively re-weighted least squares: the derivative of [`loss`] over `2 e`.
#[must_use]
pub fn weight(e: f64) -> f64 {
    (NU + 1.0) / (NU + e * e)
}

/// How fast the slope of [`loss`] grows with `e`, over 2: 1.1 near zero, negative for outliers.
#[must_use]
pub fn loss_bend(e: f64) -> f64 {
    let square = e * e;
    (NU + 1.0) * (NU - square) / ((NU + square) * (NU + square))
}

/// Autocovariances of lag 0 to `MAX_ORDER`, summed over the runs of one channel (runs are not joined).
#[must_use]
pub fn autocovariance(runs: &[Vec<f64>]) -> [f64; MAX_ORDER + 1] {
    let mut sums = [0.0; MAX_ORDER + 1];
    let count: usize = runs.iter().map(Vec::len).sum();
    for run in runs {
        for (lag, sum) in sums.iter_mut().enumerate() {
            *sum += run.iter().skip(lag).zip(run).map(|(a, b)| a * b).sum::<f64>();
        }
    }
    sums.map(|s| s / count.max(1) as f64)
}

/// The AR model that Akaike's criterion with Schwarz' penalty prefers (Levinson-Durbin), with `sigma` from a robust
/// spread of its innovations. `floor` is the smallest standard deviation that the channel can have (quantisation).
#[must_use]
pub fn estimate(runs: &[Vec<f64>], floor: f64) -> Colour {
    let count: usize = runs.iter().map(Vec::len).sum();
    let clipped = clip(runs);
    let c = autocovariance(&clipped);
    if count < 8 * MAX_ORDER || c[0] <= floor * floor {
        return Colour::white(libm::sqrt(c[0]).max(floor));
    }
    let (mut a, mut variance) = (Vec::new(), c[0] * (1.0 + 1e-9));
    let (mut best, mut best_score) = (Vec::new(), count as f64 * libm::log(variance));
    for m in 0..MAX_ORDER {
        let past: f64 = a.iter().enumerate().map(|(j, x): (usize, &f64)| x * c[m - j]).sum();
        let k = (c[m + 1] - past) / variance;
        let next: Vec<f64> = (0..m).map(|j| a[j] - k * a[m - 1 - j]).chain([k]).collect();
        variance *= (1.0 - k * k).max(1e-9);
        a = next;
        let score = count as f64 * libm::log(variance) + (m + 1) as f64 * libm::log(count as f64);
        if score < best_score {
            (best, best_score) = (a.clone(), score);
        }
    }
    let sigma = spread(&innovations(&best, runs)).max(floor);
    Colour { ar: best, sigma }
}

/// Residuals with anything beyond five robust standard deviations pulled in, so that outliers do not set the colour.
fn clip(runs: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let all: Vec<f64> = runs.iter().flatten().copied().collect();
    let rms = libm::sqrt(all.iter().map(|x| x * x).sum::<f64>() / all.len().max(1) as f64);
    let limit = 5.0 * median_abs(&all).max(0.2 * rms) / 0.6745;
    runs.iter().map(|run| run.iter().map(|x| x.clamp(-limit, limit)).collect()).collect()
}

fn innovations(ar: &[f64], runs: &[Vec<f64>]) -> Vec<f64> {
    let unit = Colour { ar: ar.to_vec(), sigma: 1.0 };
    let mut out = Vec::new();
    for run in runs {
        let mut e = run.clone();
        let rows: Vec<usize> = (0..e.len()).collect();
        unit.whiten(&mut e, &rows);
        out.append(&mut e);
    }
    out
}

/// The `sigma` that minimises `2 n log sigma + sum loss(e / sigma)`: maximum likelihood for Student's density.
#[must_use]
pub fn spread(e: &[f64]) -> f64 {
    let n = e.len().max(1) as f64;
    let mut sigma = (median_abs(e) / 0.6745).max(libm::sqrt(e.iter().map(|x| x * x).sum::<f64>() / n) * 0.05);
    for _ in 0..30 {
        if sigma <= 0.0 {
            break;
        }
        let next = libm::sqrt(e.iter().map(|x| weight(x / sigma) * x * x).sum::<f64>() / n);
        let done = (next - sigma).abs() < 1e-6 * sigma;
        sigma = next;
        if done {
            break;
        }
    }
    sigma
}

/// Median of the absolute values.
#[must_use]
pub fn median_abs(e: &[f64]) -> f64 {
    let mut a: Vec<f64> = e.iter().map(|x| x.abs()).filter(|x| x.is_finite()).collect();
    if a.is_empty() {
        return 0.0;
    }
    let middle = a.len() / 2;
    *a.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Ljung and Box' portmanteau statistic over the first [`MAX_ORDER`] lags: chi-square with that many degrees if white.
#[must_use]
pub fn portmanteau(runs: &[Vec<f64>]) -> f64 {
    let n: usize = runs.iter().map(Vec::len).sum();
    let c = autocovariance(runs);
    if c[0] <= 0.0 || n <= MAX_ORDER {
        return 0.0;
    }
    let n = n as f64;
    (1..=MAX_ORDER).map(|lag| (c[lag] / c[0]).powi(2) / (n - lag as f64)).sum::<f64>() * n * (n + 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn gauss(rng: &mut ChaCha8Rng) -> f64 {
        (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
    }

    fn coloured(pole: f64, n: usize) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut x = 0.0;
        let mut next = || {
            x = pole * x + gauss(&mut rng);
            x
        };
        (0..n).map(|_| next()).collect()
    }

    #[test]
    fn coloured_noise_is_whitened() {
        let r = coloured(0.9, 4000);
        assert!(portmanteau(std::slice::from_ref(&r)) > 1000.0);
        let colour = estimate(std::slice::from_ref(&r), 0.0);
        assert!((colour.ar[0] - 0.9).abs() < 0.05 && (colour.sigma - 1.0).abs() < 0.1, "{colour:?}");
        let mut e = r.clone();
        colour.whiten(&mut e, &(0..r.len()).collect::<Vec<_>>());
        assert!(portmanteau(&[e]) < 30.0); // 99.98 % point of chi-square with 8 degrees
    }

    #[test]
    fn white_noise_stays_white() {
        assert!(estimate(&[coloured(0.0, 4000)], 0.0).ar.is_empty());
    }

    #[test]
    fn outliers_hardly_move_the_spread() {
        let mut r = coloured(0.0, 4000);
        for k in (0..r.len()).step_by(200) {
            r[k] = 50.0;
        }
        assert!((spread(&r) - 1.0).abs() < 0.1, "{}", spread(&r));
    }
}
