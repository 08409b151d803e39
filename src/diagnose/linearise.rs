//! The tangent of a hypothesis: its states along the free runs, and the linear system around them row by row.
//!
//! Every row is run on its own from the state it starts with, in dual numbers; products of long sensitivities, which
//! lose all digits where friction brakes, are never divided. Effects with inner states (springs, plays, lags) are left
//! out of the tangent, not of the states: the tangent only proposes, the fits decide.
//! RT: no.

use crate::diagnose::base::known;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::tangent::Tangent;
use crate::identify::experiment::Recording;
use crate::identify::rollout::{Linearised, Readings, Rollout};
use crate::identify::theta::Theta;
use crate::model::effect::{EffectKind, SiteKind};
use crate::model::rig::{Effect, Rig, Sensor, Side, Value};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// The tangent of all windows. `None` if a run fails.
#[must_use]
pub fn tangents(of: &Hypothesis) -> Option<Vec<Tangent>> {
    (0..of.problem.windows.len()).into_par_iter().map(|w| tangent(of, w)).collect()
}

fn tangent(of: &Hypothesis, window: usize) -> Option<Tangent> {
    let (r, w) = of.problem.windows[window];
    let recording = &of.problem.recordings[r];
    let probe = probing(&of.rig);
    let blank = blanked(recording, probe.sensors.len());
    let rollout = Rollout::new(&probe, &blank, of.problem.fidelity).ok()?;
    let rows = rollout.windows()[w].clone();
    let mut readings = Readings::default();
    rollout.simulate(w, &of.point.states[window], &mut readings).ok()?;
    let states: Vec<Vec<f64>> = (0..rows.len()).map(|k| readings.channels.iter().map(|c| c[k]).collect()).collect();
    let rigid = rigid(&probe);
    let forces = with_forces(&rigid);
    let theta = Theta::of(&forces);
    let (mut phi, mut gamma) = (Vec::new(), Vec::new());
    let first = slice(&blank, rows.start.min(blank.times.len().saturating_sub(2)));
    let map = coordinate_map(&forces, &theta, &first, of)?;
    let output = output_map(&of.rig, &rigid, &first, &(&map * coordinates(&states[0])), of)?;
    for k in 0..rows.len() {
        let last = k + 1 == rows.len();
        let piece = slice(&blank, rows.start + k - usize::from(last));
        let step = one_row(&forces, &theta, &piece, &(&map * coordinates(&states[k])), &map, of)?;
        phi.push(step.phi);
        gamma.push(step.gamma);
    }
    let t_s = recording.times[rows].to_vec();
    Some(Tangent { recording: r, t_s, states, phi, gamma, output })
}

fn coordinates(state: &[f64]) -> DVector<f64> {
    DVector::from_column_slice(state)
}

/// `rig` with ideal sensors of every coordinate, then of every rate, and no effects of sensors.
fn probing(rig: &Rig) -> Rig {
    let mut out = rig.clone();
    let names = rig.mechanism.coordinates();
    let sensor = |joint: usize, is_rate: bool| Sensor {
        joint,
        is_rate,
        side: Side::Link,
        column: format!("{}{}", names[joint], if is_rate { "_rate" } else { "" }),
        noise_std: None,
        quantum: 0.0,
    };
    out.sensors = [false, true].into_iter().flat_map(|rate| (0..names.len()).map(move |j| sensor(j, rate))).collect();
    let keep = |e: &Effect| e.kind.site() != SiteKind::Sensor;
    out.effects.retain(keep);
    for recording in &mut out.recordings {
        recording.effects.retain(keep);
    }
    out
}

/// `rig` without the effects that carry inner states.
fn rigid(rig: &Rig) -> Rig {
    let mut out = rig.clone();
    let keep = |e: &Effect| {
        !matches!(
            e.kind,
            EffectKind::JointElasticity
                | EffectKind::Backlash
                | EffectKind::LinkFlexibility
                | EffectKind::Presliding
                | EffectKind::ActuatorLag
                | EffectKind::TransportDelay
                | EffectKind::ToeCompliance
                | EffectKind::ExternalPush
                | EffectKind::SensorLag
                | EffectKind::SensorDelay
        )
    };
    out.effects.retain(keep);
    for recording in &mut out.recordings {
        recording.effects.retain(keep);
    }
    out
}

/// `rig` with nothing free but a constant force at each coordinate.
fn with_forces(rig: &Rig) -> Rig {
    let mut out = known(rig);
    for name in rig.mechanism.coordinates() {
        out.effects.push(Effect::new(EffectKind::TorqueOffset, name, vec![Value::free(0.0, -1.0, 1.0)]));
    }
    out
}

fn blanked(recording: &Recording, sensors: usize) -> Recording {
    Recording { measured: vec![vec![f64::NAN; recording.times.len()]; sensors], ..recording.clone() }
}

/// Rows `k` and `k + 1` as a recording.
fn slice(recording: &Recording, k: usize) -> Recording {
    let cut = |list: &Vec<f64>| list[k..k + 2].to_vec();
    Recording {
        name: recording.name.clone(),
        index: recording.index,
        usage: recording.usage,
        window_s: None,
        setup: recording.setup,
        times: cut(&recording.times),
        inputs: recording.inputs.iter().map(cut).collect(),
        enabled: recording
            .enabled
            .iter()
            .map(|e| if e.is_empty() { Vec::new() } else { e[k..k + 2].to_vec() })
            .collect(),
        measured: recording.measured.iter().map(cut).collect(),
        stance: if recording.stance.is_empty() { Vec::new() } else { recording.stance[k..k + 2].to_vec() },
        warnings: Vec::new(),
    }
}

/// One row in the numbers of the initial state.
struct Step {
    phi: DMatrix<f64>,
    gamma: DMatrix<f64>,
}

/// Derivatives of all probes at one of the two rows.
fn probed(lin: &Linearised, row: usize, from: usize, count: usize) -> DMatrix<f64> {
    let channels = lin.residual.len() / lin.rows.max(1);
    DMatrix::from_fn(channels, count, |c, j| lin.jacobian[(c * lin.rows + row) * lin.columns + from + j])
}

/// From coordinates and rates to the numbers of an initial state. Coordinates are linear in it: any point will do.
fn coordinate_map(forces: &Rig, theta: &Theta, piece: &Recording, of: &Hypothesis) -> Option<DMatrix<f64>> {
    let rollout = Rollout::new(forces, piece, of.problem.fidelity).ok()?;
    let n = rollout.initial_len();
    let mut lin = Linearised::default();
    rollout.linearise(theta, 0, &vec![0.0; n], &mut lin).ok()?;
    probed(&lin, 0, theta.len(), n).pseudo_inverse(1e-9).ok()
}

fn one_row(
    forces: &Rig,
    theta: &Theta,
    piece: &Recording,
    x: &DVector<f64>,
    map: &DMatrix<f64>,
    of: &Hypothesis,
) -> Option<Step> {
    let rollout = Rollout::new(forces, piece, of.problem.fidelity).ok()?;
    let (n, m) = (rollout.initial_len(), theta.len());
    let mut lin = Linearised::default();
    rollout.linearise(theta, 0, x.as_slice(), &mut lin).ok()?;
    Some(Step { phi: map * probed(&lin, 1, m, n), gamma: map * probed(&lin, 1, 0, m) })
}

/// Readings of the rig's own sensors by the initial state.
fn output_map(
    rig: &Rig,
    rigid_probe: &Rig,
    piece: &Recording,
    x: &DVector<f64>,
    of: &Hypothesis,
) -> Option<DMatrix<f64>> {
    let mut own = known(rigid_probe);
    own.sensors = rig.sensors.clone();
    let blank = blanked(piece, own.sensors.len());
    let rollout = Rollout::new(&own, &blank, of.problem.fidelity).ok()?;
    let mut lin = Linearised::default();
    rollout.linearise(&Theta::of(&own), 0, x.as_slice(), &mut lin).ok()?;
    Some(DMatrix::from_fn(own.sensors.len(), rollout.initial_len(), |c, j| {
        lin.jacobian[c * lin.rows * lin.columns + j]
    }))
}
