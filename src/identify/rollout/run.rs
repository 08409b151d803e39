//! One window: recorded inputs in, predicted samples out. RT: no.

use super::{Rollout, RolloutError};
use crate::base::scalar::Scalar;
use crate::model::machine::Machine;
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
        let times = &self.recording.times;
        machine.set_stance(self.stance(rows.start));
        machine.reset(times[rows.start], initial);
        self.recall(machine, rows.start);
        for row in rows.clone() {
            machine.advance_to(times[row]).map_err(|e| self.error(&e))?;
            for channel in 0..machine.sensors() {
                if !machine.is_sensor_shifted(channel) {
                    sink(channel, row - rows.start, machine.read(channel));
                }
            }
            self.command(machine, row);
        }
        self.read_shifted(machine, rows, sink)
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
        let first = times[..start].partition_point(|t| *t < oldest).saturating_sub(1);
        for (i, input) in self.recording.inputs.iter().enumerate() {
            // For the backward run: the command just before the window.
            machine.settle_drive(i, input[start.saturating_sub(1)]);
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
