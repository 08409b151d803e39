//! What looks wrong with a recording though it can be used. RT: no.

use super::Recording;
use crate::identify::noise::median_abs;
use crate::model::rig::{MechanismKind, Rig};

/// Fewer rows than this tell little.
const SHORT_ROWS: usize = 50;
/// A motion within this many times the noise of a channel is no motion.
const STILL: f64 = 8.0;
/// A gap is a step of time this many times the median one.
const GAP: f64 = 5.0;
/// An angle beyond this many turns, or a leg beyond this many rad, is likely in degrees.
const DEGREES_TURNS: f64 = 1.5;
const DEGREES_LEG_RAD: f64 = 3.2;

/// One line each: what, where, remedy.
pub(super) fn warnings(rig: &Rig, recording: &Recording) -> Vec<String> {
    let mut out = Vec::new();
    out.extend(slow_clock(recording));
    out.extend(gaps(recording));
    if recording.len() < SHORT_ROWS {
        let (name, rows) = (&recording.name, recording.len());
        out.push(format!("{name}: only {rows} rows: too short to tell parameters from noise; record some seconds"));
    }
    for (sensor, samples) in rig.sensors.iter().zip(&recording.measured) {
        let name = &sensor.column;
        let present: Vec<f64> = samples.iter().copied().filter(|x| !x.is_nan()).collect();
        let low = present.iter().copied().fold(f64::INFINITY, f64::min);
        let high = present.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if present.is_empty() && !is_leg(rig.mechanism, sensor.joint) {
            out.push(format!("{}: column `{name}` has no sample at all", recording.name));
        } else if high <= low && !present.is_empty() {
            out.push(format!("{}: column `{name}` never changes ({low}): is the sensor connected?", recording.name));
        } else if !is_leg(rig.mechanism, sensor.joint) && high - low < STILL * noise(&present) {
            out.push(format!(
                "{}: column `{name}` hardly leaves its noise: nothing excites it; record larger motion",
                recording.name
            ));
        } else if !present.is_empty() && !sensor.is_rate && looks_like_degrees(rig.mechanism, low, high) {
            out.push(format!(
                "{}: column `{name}` runs from {low} to {high}: if these are degrees, convert to rad",
                recording.name
            ));
        }
    }
    for (actuator, input) in rig.actuators.iter().zip(&recording.inputs) {
        if input.iter().all(|u| u.to_bits() == input[0].to_bits()) && input[0].abs() > 0.0 {
            out.push(format!("{}: column `{}` is constant: it excites nothing", recording.name, actuator.column));
        }
    }
    out
}

/// A leg's angle is often measured in stance only (contract section 2).
fn is_leg(mechanism: MechanismKind, joint: usize) -> bool {
    mechanism == MechanismKind::CompassGait && joint < 2
}

/// Noise by the second differences of neighbours, robustly; a grid that is coarse against the noise gives 0.
fn noise(samples: &[f64]) -> f64 {
    let bends: Vec<f64> = samples.windows(3).map(|y| y[0] - 2.0 * y[1] + y[2]).collect();
    median_abs(&bends) / (0.6745 * libm::sqrt(6.0))
}

fn looks_like_degrees(mechanism: MechanismKind, low: f64, high: f64) -> bool {
    let reach = low.abs().max(high.abs());
    match mechanism {
        MechanismKind::CompassGait => reach > DEGREES_LEG_RAD,
        // A rotor may turn on and on; a swing of many "turns" that comes back is suspicious.
        MechanismKind::Pendulum | MechanismKind::DoublePendulum => {
            low < -DEGREES_TURNS * std::f64::consts::TAU && high > DEGREES_TURNS * std::f64::consts::TAU
        }
        MechanismKind::Slider => false,
    }
}

/// Rows usually this far apart show no motion of a robot, s.
const SLOW_S: f64 = 0.5;

fn slow_clock(recording: &Recording) -> Option<String> {
    let (first, last) = (recording.times.first()?, recording.times.last()?);
    let mean = (last - first) / (recording.len().max(2) - 1) as f64;
    let name = &recording.name;
    (mean > SLOW_S)
        .then(|| format!("{name}: column `t_s` steps by {mean:.3} s: if these are milliseconds, divide by 1000"))
}

fn gaps(recording: &Recording) -> Option<String> {
    let (before, gap) = recording.row_times_s().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let usual = recording.usual_row_s()?;
    (gap > GAP * usual).then(|| {
        let t = recording.times[before];
        // As an editor counts: the header is row 1.
        let (name, row) = (&recording.name, before + 2);
        format!(
            "{name}: row {row}, column `t_s`: a gap of {gap:.4} s after t = {t:.4} s (usual step {usual:.4} s): the input \
             is held over it; if it changed meanwhile, cut the file in two there"
        )
    })
}
