//! What a simulated walk came to, judged by the true world beside what the robot believed. RT: no.
//!
//! | file | what |
//! |---|---|
//! | [`footsteps`] | true changes of stance, distance, speed |
//! | [`agreement`] | the estimator's stance against the true one: missed, invented, wrong leg |
//! | [`effort`] | work and torque |
//! | [`fall`] | why a run ended |
//!
//! [`Watch`] looks at every tick and feeds them all.

pub mod agreement;
pub mod effort;
pub mod fall;
pub mod footsteps;
#[cfg(test)]
mod tests;

use super::Reading;
use super::plant::Plant;
use crate::base::time::Stamp;
use crate::config::checked::Config;
use crate::msg::{Fault, FaultCode, Leg, Mode, Motion, TickRecord};
use crate::safety::HeldBack;
use agreement::Agreement;
use effort::Effort;
use fall::{Cause, Happening, History, Irregularity};
use footsteps::Footsteps;

/// A stance leg that leans by more is falling, whatever the robot still does, rad.
const FALLS_RAD: f64 = 0.7;
/// A lean below this is still walking: what happens beyond is the fall, not its cause, rad.
const WALKS_RAD: f64 = 0.35;
/// Torque so near to the limit is at it.
const AT_LIMIT: f64 = 0.98;
/// Longer than this in the air, s: no mere rebound.
const FLIGHT_S: f64 = 0.015;
/// Longer than this sliding, s.
const SLIDE_S: f64 = 0.03;
/// The estimate is off by so much, rad and rad/s, for so long, s.
const ESTIMATE_OFF: [f64; 3] = [0.1, 1.5, 0.03];
/// A foot that lands less far ahead than this part of the usual stride did not mean to.
const SCUFFED_STRIDE: f64 = 0.25;

/// Looks at every tick of a run.
#[derive(Clone, Debug)]
pub struct Watch {
    /// Steps, distance, speed.
    pub footsteps: Footsteps,
    /// The estimator's stance against the true one.
    pub agreement: Agreement,
    /// Work and torque.
    pub effort: Effort,
    history: History,
    torque_limit_nm: f64,
    held_back: HeldBack,
    ended: Option<Cause>,
    /// Since when it makes its first step, s.
    steps_since_s: Option<f64>,
    first_step_s: Option<f64>,
    flight: Lasting,
    slide: Lasting,
    estimate_off: Lasting,
    pushes: u32,
    /// Largest errors of the estimate while the stance was right: stance angle, rad; its rate, rad/s.
    worst_error: [f64; 2],
    ticks: u64,
}

/// How long a condition has held.
#[derive(Clone, Copy, Debug, Default)]
struct Lasting {
    since_s: Option<f64>,
    told: bool,
}

impl Lasting {
    /// Its start, once, when it has held for `least_s`.
    fn look(&mut self, now_s: f64, holds: bool, least_s: f64) -> Option<f64> {
        if !holds {
            *self = Self::default();
            return None;
        }
        let since_s = *self.since_s.get_or_insert(now_s);
        let due = !self.told && now_s - since_s >= least_s;
        self.told |= due;
        due.then_some(since_s)
    }
}

impl Watch {
    /// Nothing has happened yet.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let limit_nm = config.robot.limits.hip_torque_nm;
        Self {
            footsteps: Footsteps::new(config),
            agreement: Agreement::new(config.real_time.period),
            effort: Effort::new(config),
            history: History::default(),
            torque_limit_nm: config.simulation.torque_limit_nm.map_or(limit_nm, |nm| nm.min(limit_nm)),
            held_back: HeldBack::default(),
            ended: None,
            steps_since_s: None,
            first_step_s: None,
            flight: Lasting::default(),
            slide: Lasting::default(),
            estimate_off: Lasting::default(),
            pushes: 0,
            worst_error: [0.0; 2],
            ticks: 0,
        }
    }

    /// One tick, the robot as it is at its time.
    pub fn look(&mut self, record: &TickRecord, plant: &Plant) {
        let (now, reading) = (record.input.now, plant.reading());
        self.ticks += 1;
        if self.ended.is_some() {
            return;
        }
        let now_s = now.since(Stamp::default()).as_s();
        self.held_back.look(&record.status);
        if record.control.motion == Motion::StepIn {
            self.steps_since_s.get_or_insert(now_s);
        }
        self.look_at_steps(now_s, record.control.motion.is_on_both_feet(), &reading);
        self.effort.look(now_s, &reading, plant.hip_torque_nm());
        self.look_at_pushes(plant);
        if self.was_armed() {
            self.look_at_motion(now_s, record, &reading);
            self.judge(now_s, record, &reading);
        }
    }

    fn look_at_steps(&mut self, now_s: f64, rests: bool, reading: &Reading) {
        let usual_m = self.footsteps.usual_stride_m();
        let Some(step) = self.footsteps.look(now_s, reading, rests) else { return };
        self.history.step();
        self.effort.step();
        if let Some(since_s) = self.steps_since_s {
            self.first_step_s.get_or_insert(now_s - since_s);
        }
        if step.stride_m * self.footsteps.direction() < SCUFFED_STRIDE * usual_m {
            self.note(now_s, Irregularity::Scuff);
        }
    }

    fn look_at_pushes(&mut self, plant: &Plant) {
        let given = plant.pushes().given();
        if given != self.pushes {
            self.pushes = given;
            if let Some((at, _)) = plant.pushes().last() {
                self.note(at.since(Stamp::default()).as_s(), Irregularity::Push);
            }
        }
    }

    fn look_at_motion(&mut self, now_s: f64, record: &TickRecord, reading: &Reading) {
        for (at_s, what) in self.agreement.look(now_s, record, reading.stance) {
            self.note(at_s, what);
        }
        let [angle, rate] = self.estimate_error(record, reading);
        let off = angle > ESTIMATE_OFF[0] || rate > ESTIMATE_OFF[1];
        let found = [
            (self.flight.look(now_s, reading.airborne, FLIGHT_S), Irregularity::LiftOff),
            (self.slide.look(now_s, reading.slides, SLIDE_S), Irregularity::Slip),
            (self.estimate_off.look(now_s, off, ESTIMATE_OFF[2]), Irregularity::Estimate),
        ];
        for (at_s, what) in found {
            if let Some(at_s) = at_s {
                self.note(at_s, what);
            }
        }
        let saturated = record.allowed.hip_torque_nm.abs() > AT_LIMIT * self.torque_limit_nm;
        let lean_rad = stance_lean_rad(reading);
        self.history.tick(now_s, saturated, lean_rad.abs() < WALKS_RAD);
    }

    /// Errors of the stance angle and its rate; none while the leg itself is in dispute.
    fn estimate_error(&mut self, record: &TickRecord, reading: &Reading) -> [f64; 2] {
        if record.estimate.stance != reading.stance || !record.estimate.valid {
            return [0.0; 2];
        }
        let stance = reading.stance as usize;
        let error = [
            (record.estimate.theta_stance_rad - reading.leg_angle_rad[stance]).abs(),
            (record.estimate.theta_stance_rad_s - reading.leg_rate_rad_s[stance]).abs(),
        ];
        if record.status.mode == Mode::Armed {
            for (worst, now) in self.worst_error.iter_mut().zip(error) {
                *worst = worst.max(now);
            }
        }
        error
    }

    fn judge(&mut self, now_s: f64, record: &TickRecord, reading: &Reading) {
        let lean_rad = stance_lean_rad(reading);
        let fault = record.status.first_fault.code;
        let let_go = matches!(fault, FaultCode::DeadManReleased | FaultCode::Stopping | FaultCode::None);
        let lost_power = record.status.mode != Mode::Armed && !let_go;
        if lean_rad.abs() < FALLS_RAD && !lost_power {
            return;
        }
        // Forwards is where the hip goes: to negative angles (model notes, section 2).
        let backward = lean_rad * self.footsteps.direction() > 0.0;
        let fault = if lost_power { fault } else { FaultCode::None };
        self.ended = Some(fall::cause(&self.history, now_s, backward, fault));
    }

    fn note(&mut self, at_s: f64, what: Irregularity) {
        self.history.note(Happening { at_s, what });
    }

    /// Why the robot fell or lost its power, if it did.
    #[must_use]
    pub const fn fall(&self) -> Option<Cause> {
        self.ended
    }

    /// From the beginning of the first step to its true touchdown, s.
    #[must_use]
    pub const fn first_step_s(&self) -> Option<f64> {
        self.first_step_s
    }

    /// Torque reached the motors at some time.
    #[must_use]
    pub fn was_armed(&self) -> bool {
        self.held_back.by().is_none()
    }

    /// What kept it from that, as [`HeldBack::by`].
    #[must_use]
    pub fn held_back_by(&self) -> Option<Fault> {
        self.held_back.by()
    }

    /// Largest errors of the estimate while the stance was right: stance angle, rad; its rate, rad/s.
    #[must_use]
    pub const fn worst_error(&self) -> [f64; 2] {
        self.worst_error
    }

    /// Blows given.
    #[must_use]
    pub const fn pushes(&self) -> u32 {
        self.pushes
    }
}

fn stance_lean_rad(reading: &Reading) -> f64 {
    match reading.stance {
        Leg::Inner => reading.leg_angle_rad[0],
        Leg::Outer => reading.leg_angle_rad[1],
    }
}
