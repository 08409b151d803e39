//! One window: recorded inputs in, predicted samples out. RT: no.

use super::{Rollout, RolloutError};
use crate::base::scalar::Scalar;
use crate::identify::effort::Effort;
use crate::identify::experiment::Recording;
use crate::model::machine::{Machine, ToeMotion};
use std::ops::Range;

impl Rollout<'_> {
    /// Runs `machine` over the rows `rows` from `initial` and hands every prediction to `sink(channel, row, value)`.
    pub(super) fn run<S: Scalar>(
        &self,
        machine: &mut Machine<S>,
        rows: Range<usize>,
        initial: &[S],
        sink: &mut dyn FnMut(usize, usize, S),
    ) -> Result<(), RolloutError> {
        let (before, _) = machine.steps();
        let end = self.follow(machine, rows, initial, sink);
        if let Some(effort) = self.effort {
            let (steps, coordinates) = machine.steps();
            effort.add_run(steps - before, coordinates, size_of::<S>() / size_of::<f64>() - 1);
        }
        end
    }

    fn follow<S: Scalar>(
        &self,
        machine: &mut Machine<S>,
        rows: Range<usize>,
        initial: &[S],
        sink: &mut dyn FnMut(usize, usize, S),
    ) -> Result<(), RolloutError> {
        let times = &self.recording.times;
        let (begun, _) = machine.steps();
        machine.set_stance(self.stance(rows.start));
        self.start_toes(machine, rows.start)?;
        machine.reset(times[rows.start], initial);
        self.recall(machine, rows.start);
        let mut steps = Steps::new(self.recording, rows.start);
        for row in rows.clone() {
            machine.advance_to(times[row]).map_err(|e| self.error(&e))?;
            self.within_patience(machine, begun)?;
            steps.follow(machine, row);
            self.move_toes(machine, row);
            for channel in 0..machine.sensors() {
                if !machine.is_sensor_shifted(channel) {
                    sink(channel, row - rows.start, machine.read(channel));
                }
            }
            self.command(machine, row);
        }
        self.read_shifted(machine, rows, sink)
    }

    fn within_patience<S: Scalar>(&self, machine: &Machine<S>, begun: u64) -> Result<(), RolloutError> {
        let (steps, coordinates) = machine.steps();
        let cost = Effort::of_run(steps - begun, coordinates, size_of::<S>() / size_of::<f64>() - 1);
        if self.effort.is_some_and(|effort| effort.is_beyond(cost)) { Err(RolloutError::TooCostly) } else { Ok(()) }
    }

    /// Gives the legs the toes that the recording has.
    fn start_toes<S: Scalar>(&self, machine: &mut Machine<S>, row: usize) -> Result<(), RolloutError> {
        let Some(toes) = self.recording.toes.get(row) else { return Ok(()) };
        machine.give_toes(toes.map(|toe| S::constant(toe.short_m))).map_err(|e| self.error(&e))
    }

    /// From `row` on the toes move as recorded.
    fn move_toes<S: Scalar>(&self, machine: &mut Machine<S>, row: usize) {
        let Some(toes) = self.recording.toes.get(row) else { return };
        machine.set_toes(toes.map(|toe| ToeMotion {
            short_m: S::constant(toe.short_m),
            rate_m_s: S::constant(toe.rate_m_s),
            acceleration_m_s2: S::constant(toe.acceleration_m_s2),
        }));
    }

    /// The stance leg that the recording says, inner if it does not.
    fn stance(&self, row: usize) -> usize {
        self.recording.stance.get(row).map_or(0, |leg| usize::from(*leg))
    }

    fn enabled(&self, actuator: usize, row: usize) -> bool {
        self.recording.enabled[actuator].get(row).copied().unwrap_or(true)
    }

    fn command<S: Scalar>(&self, machine: &mut Machine<S>, row: usize) {
        for (i, input) in self.recording.inputs.iter().enumerate() {
            machine.command(i, input[row], self.enabled(i, row));
        }
    }

    /// Commands and motion before the window, as far as lags and delays remember them.
    fn recall<S: Scalar>(&self, machine: &mut Machine<S>, start: usize) {
        let times = &self.recording.times;
        let oldest = times[start] - machine.memory_s();
        let known = self.recording.begin_of_stretch(start);
        let first = times[..start].partition_point(|t| *t < oldest).saturating_sub(1).max(known);
        for (i, input) in self.recording.inputs.iter().enumerate() {
            // For the backward run: the command just before the window.
            machine.settle_drive(i, input[start.saturating_sub(1).max(known)]);
        }
        let earliest = (0..machine.sensors())
            .filter(|c| machine.is_sensor_shifted(*c))
            .map(|c| machine.taken_at_s(c, times[start]))
            .fold(times[start], f64::min);
        if earliest < times[start] {
            machine.rewind_to(earliest);
        }
        for (i, input) in self.recording.inputs.iter().enumerate() {
            machine.settle_drive(i, input[first]);
            for row in first..start {
                machine.command_past(i, input[row], self.enabled(i, row), times[row]);
            }
        }
    }

    /// Readings of delayed sensors and of sensors with their own clock, from the whole run.
    fn read_shifted<S: Scalar>(
        &self,
        machine: &mut Machine<S>,
        rows: Range<usize>,
        sink: &mut dyn FnMut(usize, usize, S),
    ) -> Result<(), RolloutError> {
        let times = &self.recording.times;
        let shifted: Vec<usize> = (0..machine.sensors()).filter(|c| machine.is_sensor_shifted(*c)).collect();
        let Some(last) = rows.clone().last() else { return Ok(()) };
        let latest = shifted.iter().map(|c| machine.taken_at_s(*c, times[last])).fold(times[last], f64::max);
        let mut row = rows.end;
        while machine.now_s() < latest {
            let next = times.get(row).copied().unwrap_or(latest).min(latest);
            machine.advance_to(next).map_err(|e| self.error(&e))?;
            if row < times.len() {
                self.command(machine, row);
            }
            row += 1;
        }
        for channel in shifted {
            for row in rows.clone() {
                sink(channel, row - rows.start, machine.read_labelled(channel, S::constant(times[row])));
            }
        }
        Ok(())
    }
}

/// A model's touchdown may come this much before or after the recorded change of legs, s. Measured on walks of another
/// simulator with its true parameters: 0 leaves up to 10 times the noise, .03 none; beyond, scuffing would count.
const SLACK_S: f64 = 0.03;

/// The changes of legs that a recording tells.
struct Steps<'r> {
    recording: &'r Recording,
    /// Row of the next change, the first row on the other leg.
    next: Option<usize>,
}

impl<'r> Steps<'r> {
    fn new(recording: &'r Recording, start: usize) -> Self {
        let mut steps = Self { recording, next: None };
        steps.next = steps.change_after(start);
        steps
    }

    /// The next change in the stretch of `row`.
    fn change_after(&self, row: usize) -> Option<usize> {
        let stance = &self.recording.stance;
        let within = (row + 1..stance.len()).take_while(|r| !self.recording.is_fresh(*r));
        within.into_iter().find(|r| stance[*r] != stance[*r - 1])
    }

    /// At `row`, the machine being there: puts a late foot down, arms the next touchdown.
    fn follow<S: Scalar>(&mut self, machine: &mut Machine<S>, row: usize) {
        if self.recording.stance.is_empty() {
            return;
        }
        let times = &self.recording.times;
        let Some(change) = self.next else {
            machine.expect_stance(None);
            return;
        };
        let leg = usize::from(self.recording.stance[change]);
        if row >= change && machine.stance() != leg && times[row] >= times[change] + SLACK_S {
            machine.touch_down_now();
        }
        if row >= change && machine.stance() == leg {
            self.next = self.change_after(change);
            machine.expect_stance(None);
            self.arm(machine, row);
        } else {
            self.arm(machine, row);
        }
    }

    fn arm<S: Scalar>(&self, machine: &mut Machine<S>, row: usize) {
        let Some(change) = self.next else { return };
        let times = &self.recording.times;
        let due = row + 1 >= change || times[row] >= times[change - 1] - SLACK_S;
        machine.expect_stance(due.then(|| usize::from(self.recording.stance[change])));
    }
}
