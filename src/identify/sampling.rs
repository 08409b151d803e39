//! What a recording leaves open about time: when a command acted and when a reading was taken, to a sample.
//!
//! Two simulators of one machine that hold a command, step and read in another order differ by a part of a sample, and so
//! do a drive and its logger. No residual shows it: lags, frictions and masses take it along. Here is by how much.
//! RT: no.

use crate::identify::covariance::Change;
use crate::identify::experiment::Recording;
use crate::identify::fit::Point;
use crate::identify::problem::Problem;
use rayon::prelude::*;
use std::sync::Arc;

/// Changes of the predictions at `at` when all commands act a row later, and when each sensor reads a row later. Empty if a
/// run leaves the finite numbers.
#[must_use]
pub fn one_row_later(problem: &Problem, at: &Point) -> Vec<Change> {
    let Some(plain) = readings(problem, at) else { return Vec::new() };
    let sensors = problem.rig.sensors.len();
    let reading = |sensor: usize| -> Change {
        let of_window = |window: &Vec<Vec<f64>>| {
            let zeros = |c: usize| vec![0.0; window[c].len()];
            (0..sensors).map(|c| if c == sensor { rise(&window[c]) } else { zeros(c) }).collect()
        };
        plain.iter().map(of_window).collect()
    };
    let mut out: Vec<Change> = (0..sensors).map(reading).collect();
    if let Some(late) = readings(&commanded_later(problem), at).filter(|_| !problem.rig.actuators.is_empty()) {
        let apart = |(a, b): (&Vec<f64>, &Vec<f64>)| a.iter().zip(b).map(|(a, b)| a - b).collect();
        let window = |(a, b): (&Vec<Vec<f64>>, &Vec<Vec<f64>>)| a.iter().zip(b).map(apart).collect();
        out.push(late.iter().zip(&plain).map(window).collect());
    }
    out
}

/// Predictions of all windows.
fn readings(problem: &Problem, at: &Point) -> Option<Vec<Vec<Vec<f64>>>> {
    (0..problem.windows.len()).into_par_iter().map(|w| problem.readings(w, at)).collect()
}

/// From each row to the next; the last rises as the one before.
fn rise(y: &[f64]) -> Vec<f64> {
    let mut out: Vec<f64> = y.windows(2).map(|pair| pair[1] - pair[0]).collect();
    out.push(out.last().copied().unwrap_or(0.0));
    out
}

/// The same problem with every command a row later; the first acts twice.
fn commanded_later(problem: &Problem) -> Problem {
    let later = |column: &Vec<f64>| {
        let first = column.first().copied();
        first.into_iter().chain(column.iter().copied()).take(column.len()).collect()
    };
    let one = |r: &Recording| Recording { inputs: r.inputs.iter().map(later).collect(), ..r.clone() };
    let recordings = Arc::new(problem.recordings.iter().map(one).collect());
    Problem { recordings, ..problem.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RIG: &str = "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = 0.01\ngravity_nm = 0.4\n\
        [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.3\n[[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\n";

    #[test]
    fn a_row_later_is_as_a_delay_of_a_row() {
        let given = Problem::shaken(RIG, None, vec![0.0; 200]);
        let delayed = |effect: &str, at: &str| {
            let text = format!("{RIG}[[effect]]\neffect = \"{effect}\"\nat = \"{at}\"\ndelay = 0.01\n");
            Problem::shaken(&text, None, vec![0.0; 200])
        };
        let mut at = given.start();
        at.states[0] = vec![0.3, 0.0];
        let plain = given.readings(0, &at).unwrap().remove(0);
        let changes = one_row_later(&given, &at);
        let [reading, command] = &changes[..] else { panic!("{}", changes.len()) };
        for (change, other, sign) in
            [(reading, delayed("sensor_delay", "y"), -1.0), (command, delayed("transport_delay", "u"), 1.0)]
        {
            let late = other.readings(0, &at).unwrap().remove(0);
            let most = plain.iter().fold(0.0, |m: f64, y| m.max(y.abs()));
            for k in 2..198 {
                let expected = sign * (late[k] - plain[k]);
                assert!((change[0][0][k] - expected).abs() < 0.02 * most, "{k}: {} {expected}", change[0][0][k]);
            }
        }
    }
}
