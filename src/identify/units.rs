//! Readings in degrees or deg/s where the rig means rad or rad/s: suspected by their size, convicted by a simulation.
//! RT: no.

use crate::identify::experiment::Recording;
use crate::identify::rollout::{Pooled, free_run};
use crate::model::rig::{MechanismKind, Rig, Sensor};

/// Free runs over spans this short follow right readings whatever the parameters are.
const SPAN_S: f64 = 0.25;

/// Fewest rows of such a span.
const SPAN_ROWS: f64 = 20.0;

/// Readings whose conversion lowers the error of these runs below this part of it are in the wrong unit.
const CONVICTED: f64 = 0.3;

/// Errors below this part of the readings' spread ask for nothing.
const SMALL_ERROR: f64 = 0.02;

/// A unit that people record in, and how a message says it.
struct Unit {
    /// The rig's unit per recorded one.
    factor: f64,
    name: &'static str,
    right: &'static str,
    /// Readings beyond this are worth a try, in the rig's unit.
    suspicious: f64,
}

const DEGREES: Unit = Unit { factor: std::f64::consts::PI / 180.0, name: "degrees", right: "rad", suspicious: 3.2 };
const DEGREES_PER_S: Unit =
    Unit { factor: std::f64::consts::PI / 180.0, name: "deg/s", right: "rad/s", suspicious: 20.0 };

fn unit_of(sensor: &Sensor) -> &'static Unit {
    if sensor.is_rate { &DEGREES_PER_S } else { &DEGREES }
}

/// One line per column of `recording` that is in the wrong unit: where its largest reading is, and the remedy.
#[must_use]
pub fn wrong_units(rig: &Rig, recording: &Recording) -> Vec<String> {
    let suspects: Vec<usize> = (0..rig.sensors.len()).filter(|c| is_suspect(rig, recording, *c)).collect();
    if suspects.is_empty() || rig.mechanism == MechanismKind::Slider {
        return Vec::new();
    }
    let before = error(rig, recording);
    let mut tries: Vec<Vec<usize>> = suspects.iter().map(|c| vec![*c]).collect();
    if suspects.len() > 1 {
        tries.push(suspects);
    }
    let best = tries.into_iter().map(|columns| (error(rig, &converted(rig, recording, &columns)), columns));
    let Some((after, columns)) = best.min_by(|a, b| a.0.total_cmp(&b.0)) else { return Vec::new() };
    if !is_convicted(before, after) {
        return Vec::new();
    }
    columns.iter().map(|c| line(rig, recording, *c, before / after)).collect()
}

/// True if the error `before`, with the columns as they are, and `after`, with them converted, speak for another unit. A simulation that
/// runs away tells no more than one that follows nothing, which errs by the spread of the readings: converted, the motion is small,
/// and there the same simulation stays finite.
fn is_convicted(before: f64, after: f64) -> bool {
    let before = if before.is_finite() { before } else { 1.0 };
    before > SMALL_ERROR && after < CONVICTED * before
}

fn line(rig: &Rig, recording: &Recording, column: usize, times: f64) -> String {
    let (sensor, unit) = (&rig.sensors[column], unit_of(&rig.sensors[column]));
    let (row, most) = largest(&recording.measured[column]);
    let closer = if times.is_finite() { format!("{times:.0} times closer") } else { "where it ran away".to_owned() };
    format!(
        "{}: row {}, column `{}`: reads {most}; the column is in {}: converted, the simulation follows it {closer}; \
         multiply it by {:.9} to have {}",
        recording.name,
        // As an editor counts: the header is row 1.
        row + 2,
        sensor.column,
        unit.name,
        unit.factor,
        unit.right
    )
}

fn largest(samples: &[f64]) -> (usize, f64) {
    let present = samples.iter().copied().enumerate().filter(|(_, y)| !y.is_nan());
    present.fold((0, 0.0), |most: (usize, f64), now| if now.1.abs() > most.1.abs() { now } else { most })
}

fn is_suspect(rig: &Rig, recording: &Recording, column: usize) -> bool {
    largest(&recording.measured[column]).1.abs() > unit_of(&rig.sensors[column]).suspicious
}

fn converted(rig: &Rig, recording: &Recording, columns: &[usize]) -> Recording {
    let mut out = recording.clone();
    for c in columns {
        let factor = unit_of(&rig.sensors[*c]).factor;
        out.measured[*c].iter_mut().for_each(|y| *y *= factor);
    }
    out
}

/// Mean error of short free runs of the rig as given, in spreads of the channels; infinite where they run away.
fn error(rig: &Rig, recording: &Recording) -> f64 {
    let (first, last) = (recording.times.first().copied(), recording.times.last().copied());
    let step_s = last.zip(first).map_or(0.0, |(b, a)| b - a) / recording.len().max(2) as f64;
    let span_s = SPAN_S.max(SPAN_ROWS * step_s);
    let window_s = Some(recording.window_s.map_or(span_s, |w| w.min(span_s)));
    let short = Recording { window_s, ..recording.clone() };
    let Ok(run) = free_run(rig, &short, &Pooled::of(rig, std::iter::once(&short))) else { return f64::INFINITY };
    let errors: Vec<f64> = run.nrmse.into_iter().flatten().collect();
    let squares: f64 = errors.iter().map(|e| e * e).sum();
    libm::sqrt(squares / errors.len().max(1) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::synthesis::record;

    fn rig(inertia: f64) -> Rig {
        let text = format!(
            "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = {inertia}\ngravity_nm = 0.35\n\
             [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.05\n[[sensor]]\nmeasures = \"q1\"\n\
             column = \"q_deg\"\nnoise_std = 0.001\n[[sensor]]\nmeasures = \"q1_rate\"\ncolumn = \"gyro\"\n\
             noise_std = 0.02\n[[recording]]\nfile = \"a.csv\"\nuse = \"fit\"\n"
        );
        Rig::parse(&text, "rig.toml").unwrap()
    }

    /// Four seconds of a large swing.
    fn swing() -> Recording {
        let times: Vec<f64> = (0..400).map(|k| f64::from(k) * 0.01).collect();
        let input = times.iter().map(|t| libm::sin(5.0 * t)).collect();
        let mut recording = Recording::new("a.csv", times, vec![input], Vec::new());
        recording.measured = record(&rig(0.010), &recording, &[1.0], Some(3)).unwrap().measured;
        recording
    }

    fn scaled(columns: &[usize]) -> Recording {
        let mut recording = swing();
        for c in columns {
            recording.measured[*c].iter_mut().for_each(|y| *y *= 180.0 / std::f64::consts::PI);
        }
        recording
    }

    #[test]
    fn a_simulation_that_runs_away_convicts_no_unit_unless_it_follows_the_converted_column() {
        assert!(is_convicted(2.0, 1.9 * CONVICTED) && !is_convicted(2.0, 2.1 * CONVICTED));
        assert!(!is_convicted(0.5 * SMALL_ERROR, 0.0));
        assert!(is_convicted(f64::INFINITY, 0.9 * CONVICTED) && !is_convicted(f64::INFINITY, 1.1 * CONVICTED));
    }

    #[test]
    fn columns_in_degrees_are_told_by_name_though_the_rig_is_a_third_off() {
        let guess = rig(0.0133);
        assert_eq!(wrong_units(&guess, &swing()), Vec::<String>::new());
        for columns in [vec![0], vec![1], vec![0, 1]] {
            let said = wrong_units(&guess, &scaled(&columns));
            assert_eq!(said.len(), columns.len(), "{said:?}");
            for (c, line) in columns.iter().zip(&said) {
                assert!(line.contains(["`q_deg`", "`gyro`"][*c]) && line.contains("0.017453293"), "{line}");
            }
        }
    }

    #[test]
    fn a_rotor_that_turns_on_and_on_is_in_rad() {
        let mut recording = swing();
        let spun = rig(0.010);
        recording.measured = record(&spun, &recording, &[1.0, 40.0], Some(3)).unwrap().measured;
        assert!(recording.measured[0].iter().any(|q| *q > 50.0));
        assert_eq!(wrong_units(&rig(0.0133), &recording), Vec::<String>::new());
    }
}
