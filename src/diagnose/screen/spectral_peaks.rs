//! Narrow lines in the spectrum of what a fit leaves: something rings.
//!
//! RT: no.

use crate::base::spectrum::hann_energy;
use crate::diagnose::screen::ltv::LtvWindow;
use crate::identify::likelihood::Residuals;
use rayon::prelude::*;

/// Lowest frequency, Hz: slower modes are motions of the mechanism.
pub const LOWEST_HZ: f64 = 2.0;

/// Highest frequency in parts of the sampling rate, and at all, Hz.
const HIGHEST: f64 = 0.45;
const HIGHEST_HZ: f64 = 200.0;

/// Highest frequency worth a look with rows every `step_s`, Hz.
#[must_use]
pub fn highest_hz(step_s: f64) -> f64 {
    (HIGHEST / step_s).min(HIGHEST_HZ)
}

/// A line stands out of the spectrum on both sides of it by this factor; so many bins are it, so many are its sides.
const STANDS_OUT: f64 = 10.0;
const LINE: usize = 4;
const SIDES: usize = 24;

/// Most lines.
const MOST_LINES: usize = 3;

/// Where narrow lines stand out of the spectrum of the residuals of any one channel, Hz, strongest first: something rings.
#[must_use]
pub fn peaks_hz(residuals: &Residuals, windows: &[LtvWindow]) -> Vec<f64> {
    let Some(step_s) = windows.first().filter(|w| w.rows() > 2).map(|w| w.t_s[1] - w.t_s[0]) else { return Vec::new() };
    // Twice the longest window: a line between two bins is a line.
    let length = 2 * windows.iter().map(LtvWindow::rows).max().unwrap_or(0);
    let bin_hz = 1.0 / (length as f64 * step_s);
    let (first, last) = (libm::ceil(LOWEST_HZ / bin_hz) as usize, (highest_hz(step_s) / bin_hz) as usize);
    let of_channel = |runs: &Vec<Vec<f64>>| -> Vec<(f64, f64)> {
        let whole = runs.par_iter().zip(windows).filter(|(r, w)| r.len() == w.rows());
        let energies: Vec<Vec<f64>> = whole.map(|(r, _)| hann_energy(r, length)).collect();
        let sum = |k: usize| energies.iter().map(|e| e[k]).sum();
        let spectrum: Vec<f64> = (0..last.min(length / 2)).map(sum).collect();
        let bins = first.max(SIDES)..spectrum.len().saturating_sub(SIDES);
        bins.filter_map(|k| Some((stands_out(&spectrum, k)?, k as f64 * bin_hz))).collect()
    };
    let mut all: Vec<(f64, f64)> = residuals.iter().flat_map(of_channel).collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    all.into_iter().take(MOST_LINES).map(|(_, hz)| hz).collect()
}

/// How far bin `k` stands out of its sides, if it is a line.
fn stands_out(spectrum: &[f64], k: usize) -> Option<f64> {
    let near = &spectrum[k - LINE..=k + LINE];
    let median = |side: &[f64]| {
        let mut side = side.to_vec();
        side.sort_by(f64::total_cmp);
        side[side.len() / 2]
    };
    let sides = median(&spectrum[k - SIDES..k - LINE]).max(median(&spectrum[k + LINE + 1..k + SIDES]));
    let ratio = spectrum[k] / sides.max(1e-300);
    (ratio > STANDS_OUT && near.iter().all(|x| *x <= spectrum[k])).then_some(ratio)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::screen::ltv::tests::mass;

    #[test]
    fn a_line_is_found_in_noise_and_noise_has_none() {
        let w = mass();
        let noise = |k: usize| libm::sin(1e4 * (k as f64 + 1.7).powi(2));
        let run = |line: f64| vec![(0..100).map(|k| noise(k) + line * libm::sin(0.9 * k as f64)).collect::<Vec<f64>>()];
        // 10 ms rows: .9 rad a row is 14.3 Hz.
        let found = peaks_hz(&vec![run(3.0)], std::slice::from_ref(&w));
        assert!(found.len() == 1 && (found[0] - 14.3).abs() < 0.3, "{found:?}");
        assert!(peaks_hz(&vec![run(0.0)], &[w]).is_empty());
    }
}
