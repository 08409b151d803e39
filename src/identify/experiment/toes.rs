//! How recorded toes move: lengths, rates and accelerations by a local parabola, because a screw has no jumps and an
//! encoder's counts do. RT: no.

use crate::model::machine::ToeMotion;
use std::ops::Range;

/// Half of the span that a parabola is fitted to, s: a screw under 5 m/s² turns round within twice that.
const HALF_SPAN_S: f64 = 0.015;

/// The motion of both legs' toes at each row: `short_m` is what a leg is shorter than its length, m. Nothing is taken
/// over from one of the `windows` into the next. The acceleration brings each row's rate to that of the next.
#[must_use]
pub(super) fn motions(times: &[f64], short_m: [&[f64]; 2], windows: &[Range<usize>]) -> Vec<[ToeMotion<f64>; 2]> {
    let mut all = vec![[ToeMotion::default(); 2]; times.len()];
    for rows in windows {
        for (leg, samples) in short_m.iter().enumerate() {
            for row in rows.clone() {
                let (short_m, rate_m_s) = parabola(times, samples, rows, row);
                all[row][leg] = ToeMotion { short_m, rate_m_s, acceleration_m_s2: 0.0 };
            }
            for row in rows.start + 1..rows.end {
                let change = all[row][leg].rate_m_s - all[row - 1][leg].rate_m_s;
                all[row - 1][leg].acceleration_m_s2 = change / (times[row] - times[row - 1]);
            }
        }
    }
    all
}

/// Value and slope at `row` of the least-squares parabola through the samples around it.
fn parabola(times: &[f64], samples: &[f64], rows: &Range<usize>, row: usize) -> (f64, f64) {
    let at = times[row];
    let near = rows.start + times[rows.clone()].partition_point(|t| *t < at - HALF_SPAN_S)
        ..rows.start + times[rows.clone()].partition_point(|t| *t <= at + HALF_SPAN_S);
    if near.len() < 4 {
        return (samples[row], 0.0);
    }
    let (mut square, mut right) = (nalgebra::Matrix3::zeros(), nalgebra::Vector3::zeros());
    for k in near {
        // In parts of the span, so that the equations are well scaled.
        let t = (times[k] - at) / HALF_SPAN_S;
        let basis = nalgebra::Vector3::new(1.0, t, t * t);
        square += basis * basis.transpose();
        right += basis * (samples[k] - samples[row]);
    }
    let line = square.cholesky().map_or_else(nalgebra::Vector3::zeros, |c| c.solve(&right));
    (samples[row] + line[0], line[1] / HALF_SPAN_S)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1 kHz, counts of 5 µm, a toe that comes in at 5 m/s² from rest.
    #[test]
    fn counts_become_a_smooth_motion() {
        let times: Vec<f64> = (0..100).map(|k| 1e-3 * f64::from(k)).collect();
        let counts = |t: &f64| (2.5 * t * t / 5e-6).round() * 5e-6;
        let short: Vec<f64> = times.iter().map(counts).collect();
        let got = motions(&times, [&short, &short], &[0..50, 50..100]);
        for (t, [inner, outer]) in times.iter().zip(&got) {
            assert_eq!(inner, outer);
            assert!((inner.short_m - 2.5 * t * t).abs() < 5e-6, "{t}: {inner:?}");
            assert!((inner.rate_m_s - 5.0 * t).abs() < 2e-3, "{t}: {inner:?}");
        }
    }

    #[test]
    fn a_window_knows_nothing_of_the_one_before() {
        let times: Vec<f64> = (0..60).map(|k| 1e-3 * f64::from(k)).collect();
        let short: Vec<f64> = (0..60).map(|k| if k < 30 { 0.0 } else { 0.02 }).collect();
        let got = motions(&times, [&short, &short], &[0..30, 30..60]);
        assert!(got.iter().all(|[inner, _]| inner.rate_m_s.abs() < 1e-9));
    }
}
