//! How strong a signal is within a band of frequencies, and per frequency. RT: no.

use rustfft::{FftPlanner, num_complex::Complex};
use std::f64::consts::TAU;

/// Energy per frequency bin of an evenly sampled `signal` without its mean, Hann's window on it, zeros after it up to
/// `length` samples: bin `k` is at `k / length` of the sampling rate, up to half of it. Bin 0 is left empty.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "a number of samples")]
pub fn hann_energy(signal: &[f64], length: usize) -> Vec<f64> {
    let n = signal.len() as f64;
    let mean = signal.iter().sum::<f64>() / n;
    let hann = |k: usize| 0.5 - 0.5 * libm::cos(TAU * k as f64 / n);
    let faded = signal.iter().enumerate().map(|(k, x)| Complex::new((x - mean) * hann(k), 0.0));
    let mut data: Vec<Complex<f64>> = faded.collect();
    data.resize(length, Complex::default());
    FftPlanner::new().plan_fft_forward(length).process(&mut data);
    data[..length / 2].iter().enumerate().map(|(k, z)| if k == 0 { 0.0 } else { z.norm_sqr() }).collect()
}

/// A long signal is cut into pieces of this length, so that the cost grows with its length alone.
const PIECE_S: f64 = 2.0;

/// Root mean square of the part of `values` between `low_hz` and `high_hz`, in the unit of the values.
///
/// `times` in s, increasing, nearly even. Each piece of 2 s is split into lines of half a hertz; a last piece that is
/// shorter is left out unless it is the only one. NaN without two samples.
#[must_use]
pub fn band_rms(times: &[f64], values: &[f64], low_hz: f64, high_hz: f64) -> f64 {
    let (Some(&first), Some(&last)) = (times.first(), times.last()) else { return f64::NAN };
    let pieces = libm::floor((last - first) / PIECE_S).max(1.0);
    let length_s = if pieces > 1.0 { PIECE_S } else { last - first };
    let mut power = 0.0;
    let mut from = 0;
    let mut k = 1.0;
    while k <= pieces {
        let to = times.partition_point(|t| *t <= first + k * length_s);
        power += band_power(&times[from..to], &values[from..to], low_hz, high_hz, length_s);
        from = to;
        k += 1.0;
    }
    libm::sqrt(power / pieces)
}

/// Mean square of the lines of one piece within the band.
#[expect(clippy::cast_precision_loss, reason = "a number of samples")]
fn band_power(times: &[f64], values: &[f64], low_hz: f64, high_hz: f64, length_s: f64) -> f64 {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let mut line = libm::ceil(low_hz * length_s);
    let mut sum = 0.0;
    while line < high_hz * length_s {
        let w = TAU * line / length_s;
        let (mut re, mut im) = (0.0, 0.0);
        for (t, x) in times.iter().zip(values) {
            let (s, c) = libm::sincos(w * t);
            re += (x - mean) * c;
            im += (x - mean) * s;
        }
        sum += 2.0 * (re * re + im * im) / (n * n);
        line += 1.0;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 10 s at 1 kHz: 3 sin at 10 Hz, 5 sin at 2 Hz, 7 constant.
    fn signal() -> (Vec<f64>, Vec<f64>) {
        let times: Vec<f64> = (0..10_000).map(|k| 1e-3 * f64::from(k)).collect();
        let one = |t: &f64| 3.0 * libm::sin(TAU * 10.0 * t) + 5.0 * libm::sin(TAU * 2.0 * t) + 7.0;
        let values = times.iter().map(one).collect();
        (times, values)
    }

    #[test]
    fn a_band_holds_the_lines_within_it_and_nothing_else() {
        let (times, values) = signal();
        let rms = |low, high| band_rms(&times, &values, low, high);
        assert!((rms(8.0, 13.0) - 3.0 / libm::sqrt(2.0)).abs() < 0.01, "{}", rms(8.0, 13.0));
        assert!((rms(1.0, 5.0) - 5.0 / libm::sqrt(2.0)).abs() < 0.01);
        assert!(rms(20.0, 40.0) < 0.02);
    }

    #[test]
    fn a_sine_is_a_peak_at_its_bin_padded_or_not() {
        let sine: Vec<f64> = (0..200).map(|k| 4.0 + libm::sin(TAU * 0.1 * f64::from(k))).collect();
        let peak = |energy: Vec<f64>| (0..energy.len()).max_by(|a, b| energy[*a].total_cmp(&energy[*b])).unwrap();
        assert_eq!((peak(hann_energy(&sine, 200)), peak(hann_energy(&sine, 400))), (20, 40));
    }

    #[test]
    fn nothing_has_no_strength() {
        assert!(band_rms(&[], &[], 1.0, 2.0).is_nan());
    }
}
