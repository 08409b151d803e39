//! The tangent of a hypothesis: its states along the free runs, and the linear system around them row by row.
//!
//! Every row is run on its own from the state it starts with, in dual numbers; products of long sensitivities, which
//! lose all digits where friction brakes, are never divided. Effects with inner states (springs, plays, lags) are left
//! out of the tangent, not of the states: the tangent only proposes, the fits decide.
//! RT: no.

use crate::base::scalar::{Dual, Scalar};
use crate::diagnose::screen::ltv::{InputMap, LtvWindow, STATES, StateMap, StateRow};
use crate::identify::experiment::Recording;
use crate::identify::fitted_model::FittedModel;
use crate::identify::rollout::{Readings, Rollout};
use crate::identify::theta::Theta;
use crate::model::effect::{EffectKind, SiteKind};
use crate::model::machine::Machine;
use crate::model::rig::{Effect, Rig, Scope, Sensor, Side, Slot, Value};
use crate::model::setting::{Number, Setting};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::ops::Range;

/// Directions of a row's run: initial state, then a force at each coordinate.
const ROW_LANES: usize = 8;

/// The tangent of all windows. `None` if a run fails.
#[must_use]
pub fn ltv_windows(of: &FittedModel) -> Option<Vec<LtvWindow>> {
    let forces = with_forces(&rigid(&of.rig));
    let probe = probing(&of.rig);
    let blank = |recording: &Recording| {
        (Setting::of(&probe, Some(recording.index), recording.setup), blanked(recording, probe.sensors.len()))
    };
    let blanks: Vec<(Setting, Recording)> = of.problem.recordings.iter().map(blank).collect();
    (0..of.problem.windows.len()).into_par_iter().map(|w| tangent(of, &blanks, &forces, w)).collect()
}

/// The tangent of one window. `blanks`: each recording without samples, with ideal sensors.
fn tangent(of: &FittedModel, blanks: &[(Setting, Recording)], forces: &Rig, window: usize) -> Option<LtvWindow> {
    let r = of.problem.windows[window].0;
    let (recording, rows) = (&of.problem.recordings[r], of.problem.spans[window].clone());
    let (setting, blank) = &blanks[r];
    let known = Theta { entries: Vec::new(), values: Vec::new() };
    let rollout = Rollout::of_window(setting, &known, blank, rows.clone(), of.problem.fidelity);
    let mut readings = Readings::default();
    rollout.simulate(0, &of.point.states[window], &mut readings).ok()?;
    let states: Vec<Vec<f64>> = (0..rows.len()).map(|k| readings.channels.iter().map(|c| c[k]).collect()).collect();
    let mut stepper = Stepper::new(forces, recording, of.problem.fidelity.refine)?;
    let (output, rates) = (stepper.outputs(), stepper.rates());
    let (phi, gamma) = stepper.steps(&rows, &states)?;
    let t_s = recording.times[rows].to_vec();
    Some(LtvWindow { recording: r, t_s, states, phi, gamma, rates, output })
}

/// Runs single rows of one recording in dual numbers.
struct Stepper<'r> {
    recording: &'r Recording,
    machine: Machine<Dual<ROW_LANES>>,
    /// Numbers of the initial state.
    states: usize,
    joints: usize,
    /// From coordinates and rates to the numbers of the initial state.
    map: DMatrix<f64>,
}

impl<'r> Stepper<'r> {
    fn new(forces: &Rig, recording: &'r Recording, refine: u32) -> Option<Self> {
        let setting = Setting::of(forces, Some(recording.index), recording.setup);
        let joints = forces.mechanism.coordinates().len();
        let plain = Machine::<f64>::new(&setting, &|n: &Number| n.value, refine).ok()?;
        let states = plain.initial_layout().len();
        if states > STATES || states + joints > ROW_LANES {
            return None;
        }
        let first = forces.effects.len() - joints;
        let lift = |n: &Number| match n.slot {
            Some(Slot::Effect(Scope::Rig, e, 0)) if e >= first => Dual::variable(n.value, states + e - first),
            _ => Dual::constant(n.value),
        };
        let machine = Machine::new(&setting, &lift, refine).ok()?;
        let mut stepper = Self { recording, machine, states, joints, map: DMatrix::zeros(0, 0) };
        stepper.place(0, &vec![0.0; states]);
        // Coordinates are linear in the numbers of an initial state: any point will do.
        stepper.map = stepper.seen(states).pseudo_inverse(1e-9).ok()?;
        Some(stepper)
    }

    /// Derivatives of coordinates and rates by the first `count` directions.
    fn seen(&self, count: usize) -> DMatrix<f64> {
        let n = self.joints;
        let value = |i: usize| if i < n { self.machine.coordinate(i) } else { self.machine.rate(i - n) };
        DMatrix::from_fn(2 * n, count, |i, j| value(i).d[j])
    }

    /// Starts at a row.
    fn place(&mut self, row: usize, initial: &[f64]) {
        let stance = self.recording.stance.get(row).map_or(0, |leg| usize::from(*leg));
        self.machine.set_stance(stance);
        let lifted: Vec<Dual<ROW_LANES>> = initial.iter().enumerate().map(|(i, x)| Dual::variable(*x, i)).collect();
        self.machine.reset(self.recording.times[row], &lifted);
    }

    /// Readings of the rig's own sensors by the initial state.
    fn outputs(&self) -> Vec<StateRow> {
        let row = |c: usize| StateRow::from_fn(|i, _| if i < self.states { self.machine.read(c).d[i] } else { 0.0 });
        (0..self.machine.sensors()).map(row).collect()
    }

    /// Rate of each coordinate by the state.
    fn rates(&self) -> Vec<StateRow> {
        let seen = self.seen(self.states);
        let row = |j: usize| StateRow::from_fn(|i, _| if i < self.states { seen[(self.joints + j, i)] } else { 0.0 });
        (0..self.joints).map(row).collect()
    }

    fn steps(&mut self, rows: &Range<usize>, states: &[Vec<f64>]) -> Option<(Vec<StateMap>, Vec<InputMap>)> {
        let last = rows.end.min(self.recording.times.len() - 1).saturating_sub(1);
        let (mut phi, mut gamma) = (Vec::with_capacity(rows.len()), Vec::with_capacity(rows.len()));
        for (k, row) in rows.clone().enumerate() {
            let initial = &self.map * DVector::from_column_slice(&states[k]);
            self.place(row.min(last), initial.as_slice());
            self.advance(row.min(last))?;
            let moved = &self.map * self.seen(self.states + self.joints);
            phi.push(StateMap::from_fn(|i, j| if i.max(j) < self.states { moved[(i, j)] } else { 0.0 }));
            let force = |i: usize, j: usize| i < self.states && j < self.joints;
            gamma.push(InputMap::from_fn(|i, j| if force(i, j) { moved[(i, self.states + j)] } else { 0.0 }));
        }
        Some((phi, gamma))
    }

    /// From `row` to the next, through a recorded change of legs if there is one.
    fn advance(&mut self, row: usize) -> Option<()> {
        let recording = self.recording;
        for (i, input) in recording.inputs.iter().enumerate() {
            let enabled = recording.enabled[i].get(row).copied().unwrap_or(true);
            self.machine.command(i, input[row], enabled);
        }
        let leg = |k: usize| recording.stance.get(k).map(|leg| usize::from(*leg));
        let due = leg(row + 1).filter(|next| leg(row) != Some(*next));
        if !recording.stance.is_empty() {
            self.machine.expect_stance(due);
        }
        self.machine.advance_to(recording.times[row + 1]).ok()?;
        if due.is_some_and(|next| self.machine.stance() != next) {
            self.machine.touch_down_now();
        }
        Some(())
    }
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

/// `rig` without the effects that carry inner states, and without those of sensors.
fn rigid(rig: &Rig) -> Rig {
    let mut out = rig.clone();
    let keep = |e: &Effect| {
        e.kind.site() != SiteKind::Sensor
            && !matches!(
                e.kind,
                EffectKind::JointElasticity
                    | EffectKind::Backlash
                    | EffectKind::LinkFlexibility
                    | EffectKind::Presliding
                    | EffectKind::ActuatorLag
                    | EffectKind::TransportDelay
                    | EffectKind::ToeCompliance
                    | EffectKind::ExternalPush
            )
    };
    out.effects.retain(keep);
    for recording in &mut out.recordings {
        recording.effects.retain(keep);
    }
    out
}

/// `rig` with no number that matters but a constant force at each coordinate, the last effects of the rig.
fn with_forces(rig: &Rig) -> Rig {
    let mut out = rig.clone();
    for name in rig.mechanism.coordinates() {
        out.effects.push(Effect::new(EffectKind::TorqueOffset, name, vec![Value::known(0.0)]));
    }
    out
}

fn blanked(recording: &Recording, sensors: usize) -> Recording {
    Recording { measured: vec![vec![f64::NAN; recording.times.len()]; sensors], ..recording.clone() }
}
