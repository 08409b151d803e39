//! The stepping machine: a mechanism with motors, sensors and effects, advanced exactly through its events.
//!
//! # How to drive it
//! ```text
//! let setting = Setting::of(&rig, recording, setup);           // what holds here
//! let mut machine = Machine::<f64>::new(&setting, &|n| n.value, 1)?;
//! machine.reset(t0, &initial);                                 // coordinates, rates, inner states: initial_layout()
//! loop {
//!     machine.command(0, command, enabled);                    // held until the next one, per actuator
//!     machine.advance_to(t)?;                                  // steps between events, lands on t exactly
//!     let y = machine.read(sensor);                            // or coordinate(), rate(), stance(), ground_force()
//! }
//! ```
//! With dual numbers in `lift` the same run carries exact derivatives: the instant of each event is corrected by one
//! Newton step in dual numbers, which is the saltation term.
//!
//! # How it steps
//! Fixed-step RK4 between events, or on request semi-implicit Euler, as many simulators do. The step is the shortest of [`LONGEST_STEP_S`] and fractions of the fastest rates of
//! the linearised machine. Events: friction stops, breaks away; play opens, closes; delayed commands arrive; pushes;
//! touchdown, slip, lift-off. Command and lag are exact functions of time inside a step.
//! RT: stepping allocates nothing once built, but for the history of a delayed sensor.

mod build;
mod contact;
mod events;
mod floor;
mod foot;
mod hold;
mod impulse;
mod motion;
mod second;
#[cfg(test)]
mod slope_tests;
mod solve;
mod stand;
mod start;
#[cfg(test)]
mod tests;
mod toes;
#[cfg(test)]
mod toes_oracle;

use super::effect::actuator::Drive;
use super::effect::sensing::Pickup;
use super::mechanism::{Mechanism, Row};
use crate::base::scalar::Scalar;
use std::collections::VecDeque;

pub use contact::{Contact, Strike};
pub use floor::Floor;
use motion::{FlowOf, Plant, Stages};
pub use motion::{Phase, Work};
pub use start::Inner;
use start::STABLE_DECAY;
pub use toes::ToeMotion;

/// Most bristles.
pub const MAX_BRISTLES: usize = 3;

/// RK4 at 5 ms: motions of 10 rad/s are exact to 3e-7 per period (hω = .05, error (hω)⁴/120 per rad); stiffer ones
/// shorten the step themselves.
pub const LONGEST_STEP_S: f64 = 5e-3;

/// A step may be longer by this part: times of rows are rounded.
const WHOLE_STEP: f64 = 1e-6;

/// Why a machine cannot be built or cannot go on.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MachineError {
    /// The setting asks for something that is not modelled.
    #[error("{0}")]
    Unsupported(String),
    /// The state left all bounds.
    #[error("the state diverged at t = {0:.3} s")]
    Diverged(f64),
}

/// One disturbance to come.
#[derive(Clone, Debug)]
struct Push<S> {
    row: Row,
    impulse: S,
    time: S,
    done: bool,
}

/// Mode of a rotor with play and no spring.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Play {
    /// Between its stops.
    Free,
    /// Leaning on a stop: +1 pushes the link forwards.
    Closed(f64),
    /// No play at all: one body.
    Rigid,
}

/// A point of the past: time, signal and slope of each pickup.
#[derive(Clone, Debug)]
struct Knot<S> {
    t: S,
    signals: Vec<(S, S)>,
}

/// See the module.
#[derive(Clone, Debug)]
pub struct Machine<S> {
    plant: Plant<S>,
    pickups: Vec<Pickup<S>>,
    pushes: Vec<Push<S>>,
    now: S,
    y: Phase<S>,
    end: Phase<S>,
    stages: Stages<S>,
    work: Work<S>,
    flow_of: FlowOf,
    /// Lagged signal of each pickup.
    lagged: Vec<S>,
    before: Vec<S>,
    history: VecDeque<Knot<S>>,
    keeps_history: bool,
    step_s: f64,
    /// Steps by semi-implicit Euler; none: RK4.
    euler_step_s: Option<f64>,
    refine: u32,
    /// RK4 steps since it was built, those of the search for events included.
    steps: u64,
}

impl<S: Scalar> Machine<S> {
    /// Present time, s.
    #[must_use]
    pub fn now_s(&self) -> f64 {
        self.now.value()
    }

    /// Integration steps since it was built, and the generalised coordinates that each of them moved.
    #[must_use]
    pub const fn steps(&self) -> (u64, usize) {
        (self.steps, self.plant.n)
    }

    /// True if nothing in it sticks, strikes or plays: readings then follow the initial state without an edge.
    #[must_use]
    pub fn is_smooth(&self) -> bool {
        let plant = &self.plant;
        plant.legs().is_none()
            && plant.axes.iter().all(|axis| axis.dry.as_ref().is_none_or(|dry| !dry.sticks()))
            && plant.plays.iter().all(|play| *play == Play::Rigid)
    }

    /// Number of pickups (sensors).
    #[must_use]
    pub fn sensors(&self) -> usize {
        self.pickups.len()
    }

    /// Named coordinate `joint`, link side.
    #[must_use]
    pub fn coordinate(&self, joint: usize) -> S {
        self.plant.body.row(joint).of(&self.y.q)
    }

    /// Its rate.
    #[must_use]
    pub fn rate(&self, joint: usize) -> S {
        self.plant.body.row(joint).of(&self.y.v)
    }

    /// Angle and rate of the motor of `joint` (at the joint): its rotor's, or the link's on a rigid joint.
    #[must_use]
    pub fn motor(&self, joint: usize) -> [S; 2] {
        match self.plant.rotors.iter().find(|r| r.joint == joint) {
            Some(rotor) => [self.y.q[rotor.index], self.y.v[rotor.index]],
            None => [self.coordinate(joint), self.rate(joint)],
        }
    }

    /// True if dry friction holds any axis of coordinate `joint`.
    #[must_use]
    pub fn is_stuck(&self, joint: usize) -> bool {
        let mut pairs = self.plant.axes.iter().zip(&self.plant.grips);
        pairs.any(|(axis, grip)| axis.joint == joint && !axis.slides(*grip))
    }

    /// Torque of all motors on `joint` now, Nm.
    #[must_use]
    pub fn motor_torque(&self, joint: usize) -> S {
        let mut sum = S::zero();
        for drive in self.plant.drives.iter().filter(|d| d.joint == joint) {
            sum += drive.torque(self.now, drive.row.of(&self.y.v));
        }
        sum
    }

    /// Gives actuator `index` a command that holds from now on.
    pub fn command(&mut self, index: usize, command: f64, enabled: bool) {
        let turned = self.turned_by(index).filter(|_| self.flow_of == FlowOf::Start);
        let Some(drive) = self.plant.drives.get_mut(index) else { return };
        let rate = drive.row.of(&self.y.v);
        let before = drive.torque(self.now, rate);
        drive.command(command, enabled, self.now);
        match turned {
            // The one acceleration that feels it at once; the others follow through the spring.
            Some((rotor, inertia)) => {
                let change = drive.torque(self.now, rate) - before;
                self.work.eq.force[rotor] += change;
                self.work.a[rotor] += change / inertia;
            }
            None => self.flow_of = FlowOf::Nothing,
        }
    }

    /// Coordinate and inertia of the sprung rotor that actuator `index` turns, if nothing else feels its torque at once.
    fn turned_by(&self, index: usize) -> Option<(usize, S)> {
        let row = self.plant.drives.get(index)?.row;
        let rotor = self.plant.rotors.iter().find(|rotor| row == Row::one(rotor.index, 1.0))?;
        (self.plant.stands_on_a_point() && !self.plant.is_loaded).then_some((rotor.index, rotor.inertia))
    }

    /// Tells actuator `index` of a command given at `t_s`, before the present: what is still on its way, or in its lag.
    pub fn command_past(&mut self, index: usize, command: f64, enabled: bool, t_s: f64) {
        let now = self.now.value();
        self.flow_of = FlowOf::Nothing;
        if let Some(drive) = self.plant.drives.get_mut(index) {
            drive.command(command, enabled, S::constant(t_s));
            while drive.next_arrival().is_some_and(|t| t.value() <= now) {
                drive.arrive();
            }
        }
    }

    /// Longest memory of any actuator, s: commands older than this no longer matter.
    #[must_use]
    pub fn memory_s(&self) -> f64 {
        self.plant.drives.iter().map(Drive::memory_s).fold(0.0, f64::max)
    }

    /// Puts knots before the start into the history of delayed sensors: the motion run backwards to `t_s` in its present
    /// modes. Call after [`Self::reset`], with the commands of that time set; the present state stays.
    pub fn rewind_to(&mut self, t_s: f64) {
        let (y, now) = (self.y.clone(), self.now);
        let mut past: Vec<Knot<S>> = Vec::new();
        let steps = ((now.value() - t_s) / self.step_s).ceil().max(1.0);
        let h = S::constant((t_s - now.value()) / steps);
        let mut done = 0.0;
        while done < steps {
            self.step(h);
            self.y.copy_from(&self.end, self.plant.n, self.plant.bristles);
            self.now += h;
            self.flow_of = FlowOf::Nothing;
            self.flow_at_start();
            let signal = |p: &Pickup<S>| (p.truth(&self.y.q, &self.y.v), self.slope(p));
            past.push(Knot { t: self.now, signals: self.pickups.iter().map(signal).collect() });
            done += 1.0;
        }
        for knot in past {
            self.history.push_front(knot);
        }
        self.y = y;
        self.now = now;
        self.flow_of = FlowOf::Nothing;
    }

    /// As if actuator `index` had had this command for ever.
    pub fn settle_drive(&mut self, index: usize, command: f64) {
        self.flow_of = FlowOf::Nothing;
        if let Some(drive) = self.plant.drives.get_mut(index) {
            drive.settle(command, self.now);
        }
    }

    /// What sensor `index` reads now, before quantisation and noise. Delays look into the past as far as it goes.
    #[must_use]
    pub fn read(&self, index: usize) -> S {
        self.read_labelled(index, self.now)
    }

    /// What sensor `index` reads under the label `t`; `t` may lie in the kept past (delayed sensors only).
    #[must_use]
    pub fn read_labelled(&self, index: usize, t: S) -> S {
        let pickup = &self.pickups[index];
        let signal = if pickup.is_shifted() { self.past(index, pickup.taken_at(t)) } else { self.lagged[index] };
        pickup.reading(signal, t)
    }

    /// Latest instant whose sensor readings are already decided, as a lead in s over the label: positive for clocks that
    /// run slow, whose readings are taken after their label.
    #[must_use]
    pub fn is_sensor_shifted(&self, index: usize) -> bool {
        self.pickups[index].is_shifted()
    }

    /// When sensor `index` takes the reading labelled `t`, s.
    #[must_use]
    pub fn taken_at_s(&self, index: usize, t: f64) -> f64 {
        self.pickups[index].taken_at(S::constant(t)).value()
    }

    /// Signal of pickup `index` at time `t`: cubic between knots, along the tangent outside.
    fn past(&self, index: usize, t: S) -> S {
        let after = self.history.partition_point(|k| k.t.value() <= t.value());
        let (Some(first), Some(last)) = (self.history.front(), self.history.back()) else {
            return self.lagged[index];
        };
        let along = |knot: &Knot<S>| knot.signals[index].0 + knot.signals[index].1 * (t - knot.t);
        if after == 0 {
            return along(first);
        }
        let (Some(a), Some(b)) = (self.history.get(after - 1), self.history.get(after)) else { return along(last) };
        let h = b.t - a.t;
        if h.value() <= 0.0 {
            return along(b);
        }
        let ((y0, d0), (y1, d1)) = (a.signals[index], b.signals[index]);
        let s = (t - a.t) / h;
        let (s2, s3) = (s * s, s * s * s);
        y0 * (s3 * 2.0 - s2 * 3.0 + 1.0)
            + d0 * h * (s3 - s2 * 2.0 + s)
            + y1 * (s2 * 3.0 - s3 * 2.0)
            + d1 * h * (s3 - s2)
    }

    /// Runs to time `t` exactly, through all events on the way.
    ///
    /// # Errors
    /// The state is no longer finite.
    pub fn advance_to(&mut self, t: f64) -> Result<(), MachineError> {
        let end = S::constant(t);
        while let Some(stop) = self.next_stop(end) {
            self.run(stop.1 - self.now)?;
            self.now = stop.1;
            match stop.0 {
                Stop::End => return Ok(()),
                Stop::Arrival(i) => self.plant.drives[i].arrive(),
                Stop::Push(i) => self.push(i),
            }
            self.flow_of = FlowOf::Nothing;
        }
        Ok(())
    }

    /// What comes first: a delayed command, a push, or the end.
    fn next_stop(&self, end: S) -> Option<(Stop, S)> {
        let mut first = (Stop::End, end);
        for (i, drive) in self.plant.drives.iter().enumerate() {
            if let Some(t) = drive.next_arrival()
                && t.value() <= first.1.value()
            {
                first = (Stop::Arrival(i), t);
            }
        }
        for (i, push) in self.pushes.iter().enumerate() {
            if !push.done && push.time.value() >= self.now.value() && push.time.value() < first.1.value() {
                first = (Stop::Push(i), push.time);
            }
        }
        Some(first)
    }

    /// Runs for `h` with everything outside the mechanism unchanged.
    fn run(&mut self, h: S) -> Result<(), MachineError> {
        if h.value() <= 0.0 {
            self.shift(h);
            return Ok(());
        }
        self.settle_modes();
        let steps = (h.value() * f64::from(self.refine) / self.step_s - WHOLE_STEP).ceil().max(1.0);
        let piece = h / steps;
        let mut done = 0.0;
        while done < steps {
            self.piece(piece)?;
            done += 1.0;
        }
        if self.y.is_bounded(self.plant.n) { Ok(()) } else { Err(MachineError::Diverged(self.now.value())) }
    }

    /// One step, in parts while a bristle bends over: that takes a distance, not a time.
    fn piece(&mut self, h: S) -> Result<(), MachineError> {
        if self.plant.bristles == 0 {
            return self.substep(h);
        }
        self.flow_at_start();
        let parts = self.parts_for_bristles(h.value());
        self.plant.fastest_yield_1_s = STABLE_DECAY * parts / h.value();
        let mut done = 0.0;
        while done < parts {
            self.substep(h / parts)?;
            done += 1.0;
        }
        Ok(())
    }

    /// Moves along the tangent for a time without length: the derivative of a switching instant.
    fn shift(&mut self, h: S) {
        if h.is_varied() {
            self.flow_at_start();
            self.y.drift(&self.work, h, self.plant.n, self.plant.bristles);
        }
        self.now += h;
        self.flow_of = FlowOf::Nothing;
    }

    /// The step from `y` to `end` becomes the past.
    fn accept(&mut self, h: S) {
        for (i, pickup) in self.pickups.iter().enumerate() {
            let truth = pickup.truth(&self.end.q, &self.end.v);
            self.lagged[i] = pickup.follow(self.lagged[i], self.before[i], truth, h);
            self.before[i] = truth;
        }
        self.y.copy_from(&self.end, self.plant.n, self.plant.bristles);
        self.now += h;
        self.flow_of = if self.flow_of == FlowOf::End { FlowOf::Start } else { FlowOf::Nothing };
        self.follow_second_foot();
        self.remember();
    }

    /// Keeps the present as a knot, if a delayed sensor needs it.
    fn remember(&mut self) {
        if !self.keeps_history {
            return;
        }
        self.flow_at_start();
        let signals = self.pickups.iter().zip(&self.lagged).zip(&self.before);
        let signals = signals.map(|((pickup, lagged), truth)| {
            let slope = match pickup.lag {
                Some(lag) if lag.value() > 0.0 => (*truth - *lagged) / lag,
                _ => self.slope(pickup),
            };
            (*lagged, slope)
        });
        self.history.push_back(Knot { t: self.now, signals: signals.collect() });
    }

    /// How fast the true quantity changes; [`Self::flow_at_start`] knows the accelerations.
    fn slope(&self, pickup: &Pickup<S>) -> S {
        pickup.row.of(if pickup.is_rate { &self.work.a } else { &self.y.v })
    }

    /// Forgets the past before `t_s`; a driver that runs for hours calls it now and then.
    pub fn forget_before(&mut self, t_s: f64) {
        while self.history.len() > 2 && self.history[1].t.value() < t_s {
            self.history.pop_front();
        }
    }
}

/// Why a run pauses.
#[derive(Clone, Copy, Debug)]
enum Stop {
    End,
    Arrival(usize),
    Push(usize),
}
