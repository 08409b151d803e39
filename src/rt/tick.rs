//! The walk. RT: yes, no allocation, no clock, no wait; [`Tick::new`] before arming only.
//!
//! A pure function of [`TickInput`] and its own state: the same inputs give the same bits on hardware, in simulation
//! and in replay.

use crate::accumulate::Accumulator;
use crate::bus::line::{Line, LineError};
use crate::config::checked::Config;
use crate::control::{Controller, ControllerError};
use crate::dispatch::Dispatch;
use crate::estimate::{Estimator, EstimatorError};
use crate::msg::{BUSES, FrameBatch, JointCommand, Mode, TickInput, TickOutput, TickRecord};
use crate::safety::{Facts, Guard};
use crate::zero::Zeros;

/// Why there is no tick for a configuration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TickError {
    /// A bus cannot be run as configured.
    #[error(transparent)]
    Line(#[from] LineError),
    /// No observer.
    #[error(transparent)]
    Estimator(#[from] EstimatorError),
    /// No controller.
    #[error(transparent)]
    Controller(#[from] ControllerError),
}

/// All rooms in walking order, and the command that went out last.
#[derive(Debug)]
pub struct Tick {
    lines: [Line; BUSES],
    zeros: Zeros,
    accumulator: Accumulator,
    estimator: Estimator,
    controller: Controller,
    guard: Guard,
    dispatch: Dispatch,
    applied: JointCommand,
}

impl Tick {
    /// Furnishes the rooms.
    ///
    /// # Errors
    /// [`TickError`] when a room cannot be furnished as configured.
    pub fn new(config: &Config) -> Result<Self, TickError> {
        let line = |bus| Line::new(&config.robot, bus, &config.real_time);
        Ok(Self {
            lines: [line(0)?, line(1)?],
            zeros: Zeros::new(config),
            accumulator: Accumulator::new(&config.robot),
            estimator: Estimator::new(config)?,
            controller: Controller::new(config)?,
            guard: Guard::new(config),
            dispatch: Dispatch::new(&config.robot),
            applied: JointCommand::default(),
        })
    }

    /// Receives, looks, estimates, chooses a torque, limits it, splits it, and says what to send.
    pub fn step(&mut self, input: &TickInput, tick: &mut TickRecord) {
        tick.input = *input;
        for (line, unsent) in self.lines.iter_mut().zip(input.unsent) {
            if unsent {
                line.take_back();
            }
        }
        let heard = input.received.iter().zip(input.bus_health).zip(input.heard_until);
        for (line, ((frames, health), until)) in self.lines.iter_mut().zip(heard) {
            line.receive(input.now, until, frames, health, &mut tick.feedback);
        }
        self.zeros.receive(input.now, &input.operator, self.guard.mode(), &mut tick.feedback);
        tick.snapshot = self.accumulator.snapshot(input.now, &tick.feedback, &input.imu, &input.operator);
        tick.snapshot.late = self.guard.late(input);
        self.estimate(tick);
        self.control(tick);
        self.guard(tick);
        tick.output = TickOutput::default();
        let commands = self.zeros.to_encoders(&tick.drives);
        for (line, frames) in self.lines.iter_mut().zip(&mut tick.output.send) {
            line.transmit(input.now, &commands, frames);
        }
    }

    /// Unless armed, the state is what the sensors say, so that nothing is carried over into the first armed tick.
    fn estimate(&mut self, tick: &mut TickRecord) {
        self.estimator.hear(tick.input.now, &tick.input.lidar);
        let is_on_both_feet = self.controller.state().motion.is_on_both_feet();
        tick.estimate = match self.guard.mode() {
            Mode::Armed if is_on_both_feet => self.estimator.stand_on_both(tick.input.now, &tick.snapshot),
            Mode::Armed => self.estimator.step(tick.input.now, &tick.snapshot, &self.applied),
            _ => self.estimator.follow(tick.input.now, &tick.snapshot),
        };
        tick.terrain = self.estimator.terrain(tick.input.now);
    }

    /// Until armed, each tick is a new beginning.
    fn control(&mut self, tick: &mut TickRecord) {
        if self.guard.mode() != Mode::Armed {
            self.controller.reset(tick.input.now, &tick.estimate);
        }
        tick.wanted = self.controller.step(tick.input.now, &tick.estimate, &tick.snapshot);
        tick.control = *self.controller.state();
    }

    fn guard(&mut self, tick: &mut TickRecord) {
        let decision = self.guard.step(&Facts {
            input: &tick.input,
            feedback: &tick.feedback,
            snapshot: &tick.snapshot,
            estimate: &tick.estimate,
            wanted: &tick.wanted,
        });
        tick.status = decision.status;
        tick.allowed = decision.allowed;
        tick.drives = self.dispatch.split(&decision.allowed, decision.goal, &tick.feedback);
        self.zeros.command(decision.status.mode, &mut tick.drives);
        self.applied = decision.allowed;
    }

    /// Zero torque and disable for every drive of each bus: for the way out. They never change.
    #[must_use]
    pub fn stop_frames(&self) -> [FrameBatch; BUSES] {
        self.lines.each_ref().map(|line| {
            let mut frames = FrameBatch::default();
            line.stop_frames(&mut frames);
            frames
        })
    }
}

#[cfg(test)]
mod tests;
