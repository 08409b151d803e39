//! Input columns that were not measured but computed from a reading afterwards.
//!
//! `target - position`, called a torque, holds every error of the reading: its noise and its steps come back in the input,
//! in the same row and at full size. A model that is driven by it is driven by its own output, and what the diagnosis
//! then finds is a relation between two columns, no physics. A torque that was measured has noise of its own, and a
//! command that a controller made from the reading remembers earlier rows as well (its rate) or has a gain.
//! Told by what is fast in both columns: fourth differences, in which motion and targets hardly show.
//! RT: no.

use crate::identify::experiment::Recording;
use crate::model::rig::Rig;
use nalgebra::{DMatrix, DVector};

/// Rows before the present one that a controller's command would remember.
const EARLIER: usize = 2;
/// Fewest rows that tell.
const FEWEST: usize = 60;
/// Part of the rows that may be anything: steps of a target.
const STEP_ROWS: f64 = 0.05;
/// Part of the input's fast variance that the reading explains if it was computed from it. Recorded: 1.0000 for
/// `target - position` of four servos, .997 where it was rounded to a fifteenth of the encoder's count; below .97 for
/// measured torques.
const EXPLAINED: f64 = 0.99;
/// Part of the present row's factor that earlier rows have if none was used. Recorded: .002 at most; controllers with a
/// rate: .13 to .3.
const NOT_USED: f64 = 0.02;
/// How near to one the factor is if the column is a difference and no law with a gain.
const UNIT: f64 = 0.01;

/// One line per input column that is a reading subtracted from something, or something from it: what and why.
#[must_use]
pub fn computed_inputs(rig: &Rig, recording: &Recording) -> Vec<String> {
    let mut out = Vec::new();
    for (actuator, input) in rig.actuators.iter().zip(&recording.inputs) {
        for (sensor, reading) in rig.sensors.iter().zip(&recording.measured) {
            let Some(factor) = factor_of(input, reading).filter(|f| (f.abs() - 1.0).abs() < UNIT) else { continue };
            let sign = if factor < 0.0 { "minus" } else { "plus" };
            out.push(format!(
                "{}: the input `{}` was computed from the reading `{}`: it is something smooth {sign} that column, noise and \
                 rounding included, in every row. That is a control error, no torque: give the torque that was commanded \
                 or measured",
                recording.name, actuator.column, sensor.column
            ));
        }
    }
    out
}

/// The factor with which `reading` stands in `input`, if nothing else that is fast does, and no earlier row of it.
fn factor_of(input: &[f64], reading: &[f64]) -> Option<f64> {
    let (input, reading): (Vec<f64>, Vec<f64>) =
        input.iter().zip(reading).filter(|(u, y)| u.is_finite() && y.is_finite()).map(|(u, y)| (*u, *y)).unzip();
    if input.len() < FEWEST {
        return None;
    }
    let (fast_input, fast_reading) = (fourth_differences(&input), fourth_differences(&reading));
    let mut rows: Vec<usize> = (EARLIER..fast_input.len()).collect();
    let mut factors = [0.0; EARLIER + 1];
    let rest = |factors: &[f64; EARLIER + 1], k: usize| {
        fast_input[k] - factors.iter().enumerate().map(|(j, f)| f * fast_reading[k - j]).sum::<f64>()
    };
    // Least squares, then again without the rows that are farthest off.
    let kept = rows.len() - (STEP_ROWS * rows.len() as f64) as usize;
    for _ in 0..4 {
        let of = |k: &usize| std::array::from_fn::<f64, { EARLIER + 1 }, _>(|j| fast_reading[k - j]);
        let columns: Vec<f64> = rows.iter().flat_map(of).collect();
        let a = DMatrix::from_row_slice(rows.len(), EARLIER + 1, &columns);
        let b = DVector::from_iterator(rows.len(), rows.iter().map(|k| fast_input[*k]));
        let found = (a.tr_mul(&a)).cholesky()?.solve(&a.tr_mul(&b));
        factors = std::array::from_fn(|j| found[j]);
        rows = (EARLIER..fast_input.len()).collect();
        rows.sort_by(|x, y| rest(&factors, *x).abs().total_cmp(&rest(&factors, *y).abs()));
        rows.truncate(kept);
    }
    let energy = |of: &dyn Fn(usize) -> f64| rows.iter().map(|k| of(*k).powi(2)).sum::<f64>();
    let (all, left) = (energy(&|k| fast_input[k]), energy(&|k| rest(&factors, k)));
    let alone = factors[1..].iter().all(|f| f.abs() < NOT_USED * factors[0].abs());
    (all > 0.0 && left < (1.0 - EXPLAINED) * all && alone).then_some(factors[0])
}

fn fourth_differences(x: &[f64]) -> Vec<f64> {
    x.windows(5).map(|w| w[0] - 4.0 * w[1] + 6.0 * w[2] - 4.0 * w[3] + w[4]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// A target that steps, a reading with noise and counts.
    fn recorded() -> (Vec<f64>, Vec<f64>) {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let target: Vec<f64> = (0..1500).map(|k| if k % 300 < 150 { 0.5 } else { 0.1 }).collect();
        let mut q = 0.3;
        let follow = |goal: &f64| {
            q += 0.05 * (goal - q);
            (1000.0 * (q + 0.002 * (rng.random::<f64>() - 0.5))).round() / 1000.0
        };
        let reading = target.iter().map(follow).collect();
        (target, reading)
    }

    #[test]
    fn a_difference_from_the_reading_is_seen_and_its_factor_told() {
        let (target, reading) = recorded();
        let error: Vec<f64> = target.iter().zip(&reading).map(|(r, y)| r - y).collect();
        assert!((factor_of(&error, &reading).unwrap() + 1.0).abs() < 1e-6);
        let rounded: Vec<f64> = error.iter().map(|e| (1e4 * e).round() / 1e4).collect();
        assert!((factor_of(&rounded, &reading).unwrap() + 1.0).abs() < 0.01);
    }

    #[test]
    fn a_measured_torque_and_a_law_with_the_rate_are_not() {
        let (target, reading) = recorded();
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut measured = |k: usize| target[k] - reading[k] + 0.002 * (rng.random::<f64>() - 0.5);
        let measured: Vec<f64> = (0..reading.len()).map(&mut measured).collect();
        assert_eq!(factor_of(&measured, &reading), None);
        let rate = |k: usize| if k == 0 { 0.0 } else { reading[k] - reading[k - 1] };
        let law: Vec<f64> = (0..reading.len()).map(|k| target[k] - reading[k] - 0.5 * rate(k)).collect();
        assert_eq!(factor_of(&law, &reading), None);
        assert_eq!(factor_of(&target, &reading), None, "a target knows nothing of the reading");
    }
}
