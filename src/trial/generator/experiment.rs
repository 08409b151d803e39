//! Recordings: the machine runs finely, its sensors read rows. RT: no.

use std::ops::Range;

use super::chain::Pair;
use super::effect::{Effect, Reading};
use super::machine::{Machine, State};
use super::program::Program;
use super::rig::{Rig, Sensor};

/// Time between rows, s.
pub(super) const ROW_S: f64 = 0.0025;

/// Longer steps for what is asked of hundreds of runs: how visible an effect is, and what looks like it. Recordings are
/// compared with runs of the same step, so that the step itself is not seen.
pub(super) const COARSE: f64 = 5.0;

/// Values and effects together: a complete description of the physics.
#[derive(Debug, Clone)]
pub(super) struct Physics {
    /// Rig with the values to use.
    pub rig: Rig,
    /// What acts beyond it.
    pub effects: Vec<Effect>,
    /// Factor of the step: 1, or [`COARSE`] for an estimate.
    pub coarse: f64,
}

impl Physics {
    /// The machine in one recording; what happens once happens in the first.
    fn machine(&self, recording: usize) -> Machine {
        let rotor = self.effects.iter().map(Effect::rotor).sum();
        let mut machine = self.rig.machine(rotor);
        machine.coarse = self.coarse;
        for effect in self.acting(recording) {
            effect.apply(&mut machine);
        }
        machine
    }

    fn acting(&self, recording: usize) -> impl Iterator<Item = &Effect> {
        self.effects.iter().filter(move |effect| !effect.once || recording == 0)
    }

    fn readings(&self, recording: usize) -> Vec<Reading> {
        let mut readings = vec![Reading::default(); self.rig.sensors.len()];
        for effect in self.acting(recording) {
            for (i, reading) in readings.iter_mut().enumerate() {
                effect.read(i, reading);
            }
        }
        readings
    }
}

/// One recording, without noise.
#[derive(Debug, Clone)]
pub(super) struct Recording {
    /// Number within the case.
    pub number: usize,
    /// Never fitted.
    pub heldout: bool,
    /// Command per row, in units of the columns.
    pub commands: Vec<Pair>,
    /// Reading per sensor and row.
    pub clean: Vec<Vec<f64>>,
    /// Rows of each window.
    pub windows: Vec<Range<usize>>,
    /// Where the machine was at the start of each window.
    pub starts: Vec<State>,
    /// Rows where a torque limit acted.
    pub limited: Vec<bool>,
    /// Standing leg of each row: 0 inner, 1 outer; empty if the machine does not walk.
    pub stance: Vec<usize>,
}

/// What a run leaves behind.
struct Trail {
    /// Coordinates and rates at every fine step.
    fine: Vec<(Pair, Pair)>,
    /// States at the rows.
    states: Vec<State>,
    /// Fine steps per row.
    per_row: usize,
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a row of the recording")]
fn row_before(t: f64) -> usize {
    (t / ROW_S + 1e-9).max(0.0) as usize
}

/// Mean torques of the motors over a step from `t` on, from the rows that were commanded.
fn motor(machine: &Machine, commands: &[Pair], t: f64, h: f64) -> Pair {
    let mut torque = [0.0; 2];
    for (i, joint) in machine.joints.iter().enumerate() {
        let of_row = |row: usize| {
            let wanted = joint.gain * commands[row.min(commands.len() - 1)][i];
            if joint.limit > 0.0 { wanted.clamp(-joint.limit, joint.limit) } else { wanted }
        };
        // A late command changes within a step: a delay in whole steps could not be fitted.
        let (from_s, to_s) = (t - joint.delay_s, t + h - joint.delay_s);
        let next = row_before(from_s) + 1;
        let after = ((to_s - next as f64 * ROW_S) / h).clamp(0.0, 1.0);
        torque[i] = (1.0 - after) * of_row(next - 1) + after * of_row(next);
    }
    torque
}

/// Runs over `rows`; `command` may add the command of a row from the state there.
fn run(
    machine: &Machine,
    state: State,
    rows: Range<usize>,
    commands: &mut Vec<Pair>,
    command: impl Fn(f64, &State) -> Pair,
) -> Trail {
    run_told(machine, state, rows, commands, &[], command)
}

/// The same; a walking machine follows the legs that a recording tells, if it tells any.
fn run_told(
    machine: &Machine,
    mut state: State,
    rows: Range<usize>,
    commands: &mut Vec<Pair>,
    stance: &[usize],
    command: impl Fn(f64, &State) -> Pair,
) -> Trail {
    let h = machine.step_s();
    let per_row = row_before(ROW_S * ROW_S / h);
    let mut trail =
        Trail { fine: Vec::with_capacity(rows.len() * per_row), states: Vec::with_capacity(rows.len()), per_row };
    let mut change = next_change(stance, rows.start);
    for row in rows {
        let start_s = row as f64 * ROW_S;
        if !stance.is_empty() {
            change = follow(machine, &mut state, stance, change, row);
        }
        if row >= commands.len() {
            commands.push(command(start_s, &state));
        }
        trail.states.push(state);
        for i in 0..per_row {
            let t = start_s + i as f64 * h;
            trail.fine.push((state.q(), state.v()));
            machine.step(&mut state, motor(machine, commands, t, h), t, h);
        }
    }
    trail.fine.push((state.q(), state.v()));
    trail
}

/// A touchdown may come this many rows before or after the recorded one (30 ms).
const SLACK_ROWS: usize = 12;

/// First row after `row` that stands on another leg than the row before it.
fn next_change(stance: &[usize], row: usize) -> Option<usize> {
    (row + 1..stance.len()).find(|r| stance[*r] != stance[*r - 1])
}

/// Arms the touchdown around the recorded change of legs, makes it where the foot is late; the next change.
fn follow(machine: &Machine, state: &mut State, stance: &[usize], change: Option<usize>, row: usize) -> Option<usize> {
    let due = change?;
    let leg = stance[due];
    if row >= due + SLACK_ROWS && state.feet.stance != leg {
        machine.walker()?.touch_down(state);
    }
    let next = if row >= due && state.feet.stance == leg { next_change(stance, due) } else { Some(due) };
    state.feet.due = next.filter(|c| row + SLACK_ROWS + 1 >= *c).map(|c| stance[c]);
    next
}

fn project(row: Pair, of: Pair) -> f64 {
    row[0] * of[0] + row[1] * of[1]
}

/// What a sensor says at the rows of a run that began at `from_s`.
fn read(trail: &Trail, sensor: &Sensor, reading: &Reading, from_s: f64) -> Vec<f64> {
    let h = ROW_S / trail.per_row as f64;
    let true_signal: Vec<f64> =
        trail.fine.iter().map(|(q, v)| project(sensor.row, if sensor.is_rate { *v } else { *q })).collect();
    let signal = lagged(true_signal, reading.lag_s, h);
    let row = |k: usize| {
        let t = from_s + k as f64 * ROW_S;
        let taken = t / (1.0 + reading.skew) - reading.delay_s;
        let value = between(&signal, (taken - from_s) / h);
        let turned = reading.eccentric[0] * libm::sin(value + reading.eccentric[1]);
        let lost = if reading.lost[0] != 0.0 && t >= reading.lost[1] { reading.lost[0] } else { 0.0 };
        value * (1.0 + reading.scale) + turned + reading.bias + reading.drift * t + lost
    };
    (0..trail.states.len()).map(row).collect()
}

/// First-order lag, already following the ramp at the start.
fn lagged(signal: Vec<f64>, lag_s: f64, h: f64) -> Vec<f64> {
    if lag_s <= 0.0 || signal.len() < 2 {
        return signal;
    }
    let keep = libm::exp(-h / lag_s);
    let mut behind = lag_s * (signal[1] - signal[0]) / h;
    let mut out = vec![signal[0] - behind];
    for pair in signal.windows(2) {
        // Behind a ramp of this slope for long.
        let settled = lag_s * (pair[1] - pair[0]) / h;
        behind = settled + keep * (behind - settled);
        out.push(pair[1] - behind);
    }
    out
}

/// Between samples linearly; before the first along the first slope.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the samples")]
fn between(signal: &[f64], place: f64) -> f64 {
    let left = (place.floor().max(0.0) as usize).min(signal.len().saturating_sub(2));
    let part = (place - left as f64).min(1.0);
    signal[left] + part * (signal[left + 1] - signal[left])
}

/// Makes one recording of so many rows.
pub(super) fn record(physics: &Physics, programs: &[Program], number: usize, heldout: bool, rows: usize) -> Recording {
    let machine = physics.machine(number);
    let start = started(&machine, programs);
    let command = |t: f64, state: &State| {
        let mut u = [0.0; 2];
        for (i, (program, joint)) in programs.iter().zip(&machine.joints).enumerate() {
            let (angle, rate) = (project(joint.along, state.q()), project(joint.along, state.v()));
            // Commands leave a controller with a finite number of digits.
            let torque = program.walk(t, state).unwrap_or_else(|| program.torque(t, angle, rate));
            u[i] = (torque / joint.gain * 1e4).round() / 1e4;
        }
        u
    };
    let mut commands = Vec::with_capacity(rows);
    let trail = run(&machine, start, 0..rows, &mut commands, command);
    let readings = physics.readings(number);
    let clean = physics.rig.sensors.iter().zip(&readings).map(|(s, r)| read(&trail, s, r, 0.0)).collect();
    let windows = windows(rows, physics.rig.window_s);
    let starts = windows.iter().map(|window| trail.states[window.start]).collect();
    let limited = commands.iter().map(|u| is_limited(&machine, u)).collect();
    let stance = trail.states.iter().filter(|_| machine.ground.is_some()).map(|state| state.feet.stance).collect();
    Recording { number, heldout, commands, clean, windows, starts, limited, stance }
}

/// Where a recording begins: at rest, or in the middle of walking.
fn started(machine: &Machine, programs: &[Program]) -> State {
    let (mut q, mut v) = ([0.0; 2], [0.0; 2]);
    for (i, program) in programs.iter().enumerate() {
        q[i] = program.start();
    }
    if let Some(Program::Walk(gait)) = programs.first() {
        (q, v) = gait.start();
    }
    let mut state = machine.start(q, v);
    if let Some(walker) = machine.walker() {
        walker.stand(&mut state);
    }
    state
}

fn is_limited(machine: &Machine, command: &Pair) -> bool {
    machine.joints.iter().zip(command).any(|(joint, u)| joint.limit > 0.0 && (joint.gain * u).abs() > joint.limit)
}

/// Windows of the contract: a last piece shorter than half a window joins the one before.
fn windows(rows: usize, window_s: f64) -> Vec<Range<usize>> {
    let long = row_before(window_s);
    let count = ((rows + long / 2) / long).max(1);
    (0..count).map(|k| k * long..if k + 1 == count { rows } else { (k + 1) * long }).collect()
}

/// Free run of `physics` over one window, from a state, under the recorded commands; readings per sensor.
pub(super) fn free_run(physics: &Physics, recording: &Recording, window: usize, start: State) -> Vec<Vec<f64>> {
    let machine = physics.machine(recording.number);
    let rows = recording.windows[window].clone();
    let from_s = rows.start as f64 * ROW_S;
    let mut commands = recording.commands.clone();
    let mut start = start;
    // The drive and the bristles are those of this machine, not of the one that was recorded.
    let fresh = machine.start(start.q(), start.v());
    start.y = fresh.y;
    start.torque = motor(&machine, &commands, from_s, machine.step_s());
    if let Some(walker) = machine.walker() {
        start.feet.told = true;
        walker.stand(&mut start);
    }
    let trail = run_told(&machine, start, rows, &mut commands, &recording.stance, |_, _| [0.0; 2]);
    let readings = physics.readings(recording.number);
    physics.rig.sensors.iter().zip(&readings).map(|(s, r)| read(&trail, s, r, from_s)).collect()
}

#[cfg(test)]
mod tests {
    use super::super::rig;
    use super::*;
    use crate::trial::dice::Dice;

    #[test]
    fn a_late_command_acts_for_its_part_of_a_step() {
        let mut machine =
            Physics { rig: rig::draw(&mut Dice::new(1, 0), rig::Kind::Rotor), effects: Vec::new(), coarse: 1.0 }
                .machine(0);
        let (gain, h) = (machine.joints[0].gain, ROW_S / 10.0);
        let commands = [[0.0, 0.0], [1.0, 0.0], [3.0, 0.0]];
        let at = |machine: &Machine, t: f64| motor(machine, &commands, t, h)[0] / gain;
        assert!(at(&machine, ROW_S - h).abs() < 1e-9 && (at(&machine, ROW_S) - 1.0).abs() < 1e-9);
        machine.joints[0].delay_s = 0.25 * h;
        assert!((at(&machine, ROW_S) - 0.75).abs() < 1e-6 && (at(&machine, 2.0 * ROW_S) - 2.5).abs() < 1e-6);
    }

    #[test]
    fn a_lag_stays_behind_a_ramp_by_its_time_whatever_the_step() {
        for h in [1e-4, 1e-3, 1e-2] {
            let ramp: Vec<f64> = (0..50).map(|k| 2.0 * h * f64::from(k)).collect();
            let out = lagged(ramp.clone(), 0.003, h);
            assert!(ramp.iter().zip(&out).all(|(x, y)| (x - y - 2.0 * 0.003).abs() < 1e-12), "{h}");
        }
    }
}
