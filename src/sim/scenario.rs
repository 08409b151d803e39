//! What a simulated run came to. RT: no.

use super::Reading;
use super::lockstep::Lockstep;
use super::outcome::Watch;
use super::outcome::fall::Cause;
use crate::base::time::Span;
use crate::msg::{Estimate, Fault, Leg, MocapSample, Mode, TickRecord};

/// Lowest and highest value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Lowest.
    pub low: f64,
    /// Highest.
    pub high: f64,
}

impl Default for Extent {
    fn default() -> Self {
        Self { low: f64::INFINITY, high: f64::NEG_INFINITY }
    }
}

impl Extent {
    /// Takes a value in.
    pub const fn add(&mut self, x: f64) {
        self.low = self.low.min(x);
        self.high = self.high.max(x);
    }

    /// Highest minus lowest; 0 when there was no value.
    #[must_use]
    pub const fn width(&self) -> f64 {
        if self.high < self.low { 0.0 } else { self.high - self.low }
    }

    /// Largest distance from zero; 0 when there was no value.
    #[must_use]
    pub const fn size(&self) -> f64 {
        if self.high < self.low { 0.0 } else { self.low.abs().max(self.high.abs()) }
    }
}

/// Figures of a run; angles are the true ones, stance leg first.
#[derive(Clone, Copy, Debug, Default)]
pub struct Summary {
    /// Ticks run.
    pub ticks: u64,
    /// Ticks with torque.
    pub armed_ticks: u64,
    /// Mode at the end.
    pub mode: Mode,
    /// First fault since arming.
    pub first_fault: Fault,
    /// Stance and swing leg while armed, rad.
    pub angle_rad: [Extent; 2],
    /// The same over the tail.
    pub tail_angle_rad: [Extent; 2],
    /// Torque over the tail, Nm.
    pub tail_torque_nm: Extent,
    /// Error of the estimated stance angle over the tail, while the stance leg was right, rad.
    pub tail_error_rad: Extent,
    /// Estimated bias of the attitude at the end, rad.
    pub attitude_bias_rad: f64,
    /// The robot's stance angle at the end, rad.
    pub stance_angle_rad: f64,
    /// What kept it from being armed, if it never was.
    pub held_back_by: Option<Fault>,
    /// True changes of stance.
    pub steps: u32,
    /// From the first foothold to the last, m.
    pub distance_m: f64,
    /// Mean speed between the first step and the last, m/s; none before two steps.
    pub mean_speed_m_s: Option<f64>,
    /// Positive work over weight and distance.
    pub cost_of_transport: Option<f64>,
    /// Why it fell or lost its power, if it did.
    pub fall: Option<Cause>,
}

impl Summary {
    /// Still armed and on its feet at the end. A robot that has not made a step is to be upright as well.
    #[must_use]
    pub fn stands(&self) -> bool {
        let upright = self.steps > 0 || self.stance_angle_rad.abs() < 0.2;
        self.mode == Mode::Armed && self.fall.is_none() && upright
    }

    fn take_over(&mut self, watch: &Watch) {
        self.steps = watch.footsteps.steps();
        self.distance_m = watch.footsteps.distance_m();
        self.mean_speed_m_s = watch.footsteps.mean_speed_m_s();
        let stretch_m = watch.footsteps.stretch().map(|(_, m)| m);
        self.cost_of_transport = stretch_m.and_then(|m| watch.effort.cost_of_transport(m));
        self.fall = watch.fall();
        self.held_back_by = watch.held_back_by();
    }

    fn add(&mut self, record: &TickRecord, reading: &Reading, tail: bool) {
        self.ticks += 1;
        self.mode = record.status.mode;
        self.first_fault = record.status.first_fault;
        if self.mode != Mode::Armed {
            return;
        }
        self.armed_ticks += 1;
        let angles = stance_first(reading);
        self.stance_angle_rad = angles[0];
        self.attitude_bias_rad = record.estimate.attitude_bias_rad;
        for i in 0..2 {
            self.angle_rad[i].add(angles[i]);
            if tail {
                self.tail_angle_rad[i].add(angles[i]);
            }
        }
        if tail {
            self.tail_torque_nm.add(record.allowed.hip_torque_nm);
            // A leg that is told apart some ms later is no error of its angle.
            if record.estimate.stance == reading.stance {
                self.tail_error_rad.add(error(&record.estimate, angles));
            }
        }
    }
}

/// True angles, stance leg first.
#[must_use]
pub const fn stance_first(reading: &Reading) -> [f64; 2] {
    let [inner, outer] = reading.leg_angle_rad;
    match reading.stance {
        Leg::Inner => [inner, outer],
        Leg::Outer => [outer, inner],
    }
}

fn error(estimate: &Estimate, angles: [f64; 2]) -> f64 {
    estimate.theta_stance_rad - angles[0]
}

/// Runs for `length`; `look` sees every tick. The tail is the last `tail` of it.
pub fn run(lockstep: &mut Lockstep, length: Span, tail: Span, mut look: impl FnMut(&TickRecord, &Reading)) -> Summary {
    run_with_poses(lockstep, length, tail, |record, reading, _| look(record, reading))
}

/// The same; `look` gets the poses of motion capture too.
pub fn run_with_poses(
    lockstep: &mut Lockstep,
    length: Span,
    tail: Span,
    mut look: impl FnMut(&TickRecord, &Reading, &[MocapSample]),
) -> Summary {
    let end = lockstep.now() + length;
    let tail_from = end - tail;
    let mut summary = Summary::default();
    let mut watch = lockstep.watch();
    while lockstep.now() < end {
        let in_tail = lockstep.now() >= tail_from;
        lockstep.step();
        let poses = lockstep.take_poses();
        let (record, plant) = lockstep.seen();
        let reading = plant.reading();
        summary.add(record, &reading, in_tail);
        watch.look(record, plant);
        look(record, &reading, &poses);
    }
    summary.take_over(&watch);
    summary
}
