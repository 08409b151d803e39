//! What narrows a place of mismatch: the phase of the motion, a region of the state, a band of frequency.
//!
//! Each is said only where it says something: most of the energy in a small part of the rows, or of the spectrum.
//! RT: no.

use crate::base::spectrum::hann_energy;
use crate::diagnose::judge::verdict::{Place, Trace};
use crate::identify::experiment::Recording;
use crate::model::rig::Sensor;

/// Part of the energy that a region or a phase must hold to be named.
const LEAST_ENERGY: f64 = 0.65;

/// Largest part of the rows that a region may cover.
const FEW: f64 = 0.35;

/// Part of the energy that a band must hold.
const IN_BAND: f64 = 0.8;

/// A band is named if it is narrower than this part of its centre.
const NARROW_BAND: f64 = 0.6;

/// Fewer rows have no spectrum worth the name.
const LEAST_ROWS: usize = 64;

/// What follows a touchdown within this time is called by it, s.
const AFTER_TOUCHDOWN_S: f64 = 0.1;

/// `place` with all that narrows it. `mismatch`: what the simulation lacks, row by row of `trace`; with the sensor goes
/// the name of what it measures.
#[must_use]
pub fn narrowed(
    place: Place,
    trace: &Trace,
    mismatch: &[f64],
    recording: &Recording,
    (sensor, coordinate): (&Sensor, &str),
) -> Place {
    let rows: Vec<usize> =
        (0..trace.t_s.len()).filter(|k| trace.t_s[*k] >= place.from_s && trace.t_s[*k] <= place.to_s).collect();
    let seen = View { trace, mismatch, rows: &rows };
    Place {
        phase: phase(&seen, recording),
        region: region(&seen, sensor, coordinate),
        band_hz: seen.band_hz(),
        ..place
    }
}

/// The mismatch within a place.
struct View<'v> {
    trace: &'v Trace,
    mismatch: &'v [f64],
    rows: &'v [usize],
}

impl View<'_> {
    /// Parts of the energy and of the rows for which `inside` holds.
    fn parts(&self, inside: impl Fn(usize) -> bool) -> (f64, f64) {
        let (mut energy, mut count, mut total) = (0.0, 0.0, 1e-300);
        for k in self.rows {
            let e = self.mismatch[*k].powi(2);
            total += e;
            if inside(*k) {
                energy += e;
                count += 1.0;
            }
        }
        (energy / total, count / self.rows.len().max(1) as f64)
    }

    fn is_told(&self, inside: impl Fn(usize) -> bool) -> bool {
        let (energy, rows) = self.parts(inside);
        energy >= LEAST_ENERGY && rows <= FEW && rows > 0.0
    }

    /// The narrowest band with most of the energy, if it is narrow; rows must be evenly spaced.
    fn band_hz(&self) -> Option<[f64; 2]> {
        let t = |i: usize| self.trace.t_s[self.rows[i]];
        let n = self.rows.len();
        if n < LEAST_ROWS {
            return None;
        }
        let step_s = (t(n - 1) - t(0)) / (n - 1) as f64;
        if (1..n).any(|i| t(i) - t(i - 1) > 1.5 * step_s) {
            return None;
        }
        let energy = hann_energy(&self.rows.iter().map(|k| self.mismatch[*k]).collect::<Vec<_>>(), n);
        let (low, high) = narrowest(&energy)?;
        let per_bin = 1.0 / (n as f64 * step_s);
        let band = [low as f64 * per_bin, (high + 1) as f64 * per_bin];
        // Three periods at least: slower ones are a drift of the window, not a line.
        let is_narrow = low >= 3 && band[1] - band[0] <= NARROW_BAND * 0.5 * (band[0] + band[1]);
        is_narrow.then_some(band)
    }
}

/// First and last bin of the narrowest interval that holds [`IN_BAND`] of the energy.
fn narrowest(energy: &[f64]) -> Option<(usize, usize)> {
    let enough = IN_BAND * energy.iter().sum::<f64>();
    let (mut low, mut sum, mut best) = (0, 0.0, None::<(usize, usize)>);
    for high in 0..energy.len() {
        sum += energy[high];
        while low < high && sum - energy[low] >= enough {
            sum -= energy[low];
            low += 1;
        }
        if sum >= enough && sum > 0.0 && best.is_none_or(|(a, b)| high - low < b - a) {
            best = Some((low, high));
        }
    }
    best
}

fn phase(seen: &View<'_>, recording: &Recording) -> Option<String> {
    if recording.stance.is_empty() {
        return None;
    }
    let touchdowns: Vec<usize> = recording.touchdowns().collect();
    let landed = |k: usize| {
        let last = touchdowns[..touchdowns.partition_point(|row| *row <= k)].last();
        last.is_some_and(|row| recording.times[k] - recording.times[*row] < AFTER_TOUCHDOWN_S)
    };
    if seen.is_told(landed) {
        return Some("touchdown".into());
    }
    let on_outer = |k: usize| recording.stance[k] != 0;
    let (outer, rows) = seen.parts(on_outer);
    let mixed = (0.1..0.9).contains(&rows);
    match outer {
        x if mixed && x > 0.8 => Some("outer stance".into()),
        x if mixed && x < 0.2 => Some("inner stance".into()),
        _ => None,
    }
}

/// The region of position or rate with most of the energy.
fn region(seen: &View<'_>, sensor: &Sensor, coordinate: &str) -> Option<String> {
    let predicted = &seen.trace.explained;
    let rate: Vec<f64> = if sensor.is_rate { predicted.clone() } else { slopes(&seen.trace.t_s, predicted) };
    let speed: Vec<f64> = rate.iter().map(|x| x.abs()).collect();
    let mut regions = vec![(format!("abs({coordinate}_rate)"), &speed)];
    if !sensor.is_rate {
        regions.push((coordinate.to_owned(), predicted));
    }
    for (what, values) in regions {
        let mut sorted: Vec<f64> = seen.rows.iter().map(|k| values[*k]).collect();
        sorted.sort_by(f64::total_cmp);
        let at = |q: f64| sorted.get(((sorted.len() - 1) as f64 * q) as usize).copied();
        let (low, high) = (at(0.3)?, at(0.7)?);
        if seen.is_told(|k| values[k] < low) {
            return Some(format!("{what} < {low:.3}"));
        }
        if seen.is_told(|k| values[k] > high) {
            return Some(format!("{what} > {high:.3}"));
        }
    }
    None
}

/// Rate of a signal, by its neighbours.
#[must_use]
pub fn slopes(t_s: &[f64], y: &[f64]) -> Vec<f64> {
    let n = y.len();
    let one = |k: usize| {
        let (a, b) = (k.saturating_sub(1), (k + 1).min(n - 1));
        if b > a { (y[b] - y[a]) / (t_s[b] - t_s[a]) } else { 0.0 }
    };
    (0..n).map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trace(of: impl Fn(f64) -> f64) -> (Trace, Vec<f64>) {
        let t_s: Vec<f64> = (0..1000).map(|k| f64::from(k) * 0.004).collect();
        let explained = t_s.iter().map(|t| libm::sin(2.0 * t)).collect();
        let mismatch = t_s.iter().map(|t| of(*t)).collect();
        (Trace { t_s, explained, ..Trace::default() }, mismatch)
    }

    #[test]
    fn a_line_of_ten_hertz_is_named_as_a_band_around_it() {
        let (trace, mismatch) = trace(|t| libm::sin(20.0 * std::f64::consts::PI * t));
        let rows: Vec<usize> = (0..1000).collect();
        let [low, high] = View { trace: &trace, mismatch: &mismatch, rows: &rows }.band_hz().unwrap();
        assert!(low < 10.0 && high > 10.0 && high - low < 1.5, "{low} {high}");
    }

    #[test]
    fn a_slow_drift_has_no_band() {
        let (trace, mismatch) = trace(|t| t);
        let rows: Vec<usize> = (0..1000).collect();
        assert_eq!(View { trace: &trace, mismatch: &mismatch, rows: &rows }.band_hz(), None);
    }

    #[test]
    fn a_mismatch_at_reversals_is_named_by_the_small_rate() {
        // Rate 2 cos 2t: small near its zeros.
        let (trace, mismatch) = trace(|t| libm::exp(-(4.0 * libm::cos(2.0 * t)).powi(2)));
        let rows: Vec<usize> = (0..1000).collect();
        let seen = View { trace: &trace, mismatch: &mismatch, rows: &rows };
        let sensor = Sensor {
            joint: 0,
            is_rate: false,
            side: Default::default(),
            column: "q1_rad".into(),
            noise_std: None,
            quantum: 0.0,
        };
        let told = region(&seen, &sensor, "q1").unwrap();
        assert!(told.starts_with("abs(q1_rate) < "), "{told}");
    }
}
