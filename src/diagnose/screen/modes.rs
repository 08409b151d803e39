//! Where a structural mode would ring: a dense scan of frequency and damping on the tangent.
//!
//! A mode of share `p` hangs on the link's inertia `J`; its deflection obeys `d'' + 2 z w d' + w^2 d = -a` with the
//! link's acceleration `a`, and the link feels `-p J d''` beyond what its whole inertia explains. To first order in `p`
//! this is a known force on the tangent, whatever the frequency; what rings from before the window is free.
//! RT: no.

use crate::diagnose::screen::ltv::LtvWindow;
use crate::diagnose::screen::scales::JointScale;
use crate::diagnose::screen::scan::Hit;
use crate::diagnose::screen::score_test::{Column, Own, ScoreTest};
use crate::diagnose::screen::spectral_peaks::{LOWEST_HZ, highest_hz};
use rayon::prelude::*;

/// Ratio of neighbouring frequencies: a mode of 4 % damping is as wide.
const RATIO: f64 = 1.05;

/// Damping ratios.
const DAMPINGS: [f64; 2] = [0.02, 0.08];

/// Damping ratios of a line in the spectrum, and where the mode is that rings there: with the hub held it is slower.
const LINE_DAMPINGS: [f64; 2] = [0.002, 0.01];
const BELOW: [f64; 5] = [1.0, 0.99, 0.97, 0.94, 0.88];

/// Starts that are handed on.
const MOST_STARTS: usize = 3;

/// Frequency and damping of the best modes at `joint`, best first, well apart; the amplitude is the share. `absolute`:
/// coordinates whose sum is the link's angle in space; `peaks_hz`: lines of the residuals, which a grid would miss.
#[must_use]
pub fn flexibility(
    screen: &ScoreTest,
    windows: &[LtvWindow],
    joint: &JointScale,
    absolute: &[usize],
    peaks_hz: &[f64],
) -> Vec<Hit<(f64, f64)>> {
    let Some(step_s) = windows.iter().find(|w| w.rows() > 2).map(|w| w.t_s[1] - w.t_s[0]) else { return Vec::new() };
    let highest = highest_hz(step_s);
    let count = (libm::log(highest / LOWEST_HZ) / libm::log(RATIO)).max(0.0) as usize;
    let even = (0..=count).flat_map(|i| DAMPINGS.map(|z| (LOWEST_HZ * libm::pow(RATIO, i as f64), z)));
    let narrow =
        peaks_hz.iter().flat_map(|f| BELOW.iter().map(move |x| x * f)).flat_map(|f| LINE_DAMPINGS.map(|z| (f, z)));
    let grid: Vec<(f64, f64)> = even.chain(narrow).collect();
    let one = |at: &(f64, f64)| {
        let (driven, free) = responses(windows, joint.inertia, absolute, *at);
        Hit { at: *at, score: screen.score_beside(&[driven], &free) }
    };
    let mut hits: Vec<Hit<(f64, f64)>> = grid.par_iter().map(one).collect();
    hits.sort_by(|a, b| b.score.gain.total_cmp(&a.score.gain));
    let mut best: Vec<Hit<(f64, f64)>> = Vec::new();
    for hit in hits {
        let apart = |other: &Hit<(f64, f64)>| (hit.at.0 / other.at.0).max(other.at.0 / hit.at.0) > 1.3;
        if best.len() < MOST_STARTS && best.iter().all(apart) {
            best.push(hit);
        }
    }
    best
}

/// Response to a mode of unit share; and the free ringing of each window, from unit deflection and from unit rate.
fn responses(windows: &[LtvWindow], inertia: f64, absolute: &[usize], (hz, damping): (f64, f64)) -> (Column, Vec<Own>) {
    let omega = 2.0 * std::f64::consts::PI * hz;
    let felt = |w: &LtvWindow, start: [f64; 2], driven: bool| {
        let force: Vec<f64> =
            ringing(w, absolute, (omega, damping), start, driven).iter().map(|a| -inertia * a).collect();
        let mut parts = absolute.iter().map(|j| w.respond(*j, |k| force[k]));
        let first = parts.next().unwrap_or_default();
        parts.fold(first, |sum, part| sum.iter().zip(&part).map(|(a, b)| added(a, b)).collect())
    };
    let free = |w: &LtvWindow| {
        if w.rows() == 0 { Own::new() } else { [[1.0, 0.0], [0.0, omega]].map(|start| felt(w, start, false)).into() }
    };
    (windows.iter().map(|w| felt(w, [0.0, 0.0], true)).collect(), windows.iter().map(free).collect())
}

fn added(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(x, y)| x + y).collect()
}

/// Second derivative of the mode's deflection, row by row; the link's acceleration is held during a row.
fn ringing(w: &LtvWindow, absolute: &[usize], (omega, damping): (f64, f64), start: [f64; 2], driven: bool) -> Vec<f64> {
    let coordinates = w.states.first().map_or(0, Vec::len) / 2;
    let rate = |k: usize| absolute.iter().map(|j| w.states[k][coordinates + j]).sum::<f64>();
    let swing = omega * libm::sqrt(1.0 - damping * damping);
    let [mut d, mut v] = start;
    let mut out = Vec::with_capacity(w.rows());
    for k in 0..w.rows() {
        let Some(next) = w.t_s.get(k + 1) else {
            out.push(out.last().copied().unwrap_or(0.0));
            break;
        };
        let dt = next - w.t_s[k];
        let push = if driven { -(rate(k + 1) - rate(k)) / dt } else { 0.0 };
        let before = v;
        // Exact for a constant push: around its rest at push / omega^2 the mode swings freely.
        let rest = push / (omega * omega);
        let (e, c, s) = (libm::exp(-damping * omega * dt), libm::cos(swing * dt), libm::sin(swing * dt));
        let x = d - rest;
        let mix = (v + damping * omega * x) / swing;
        d = rest + e * (x * c + mix * s);
        v = e * (v * c - (damping * omega * v + omega * omega * x) / swing * s);
        out.push((v - before) / dt);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::screen::ltv::tests::mass;

    #[test]
    fn an_undriven_mode_rings_at_its_frequency() {
        // 5 Hz, hardly damped, 10 ms rows: after 20 rows (0.2 s) a whole turn.
        let rows = ringing(&mass(), &[0], (10.0 * std::f64::consts::PI, 1e-4), [1.0, 0.0], false);
        assert!((rows[20] / rows[0] - 1.0).abs() < 0.01, "{} {}", rows[0], rows[20]);
        assert!(rows[10] / rows[0] < -0.99);
    }

    #[test]
    fn a_link_at_constant_rate_drives_nothing() {
        let rows = ringing(&mass(), &[0], (30.0, 0.02), [0.0, 0.0], true);
        assert!(rows.iter().all(|a| a.abs() < 1e-12));
    }
}
