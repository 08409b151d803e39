//! The simulated robot: a world of rigid and elastic bodies, and devices on wires that speak the real bytes.
//!
//! Nothing of the control path knows that it is not real. RT: no.

mod carry;
pub mod drive;
pub mod ground;
pub mod imu;
pub mod lidar;
pub mod lockstep;
pub mod mocap;
pub mod noise;
mod objects;
pub mod outcome;
pub mod plant;
pub mod pushes;
pub mod scenario;
pub mod served;
mod toes;
mod torque_delay;
pub mod trouble;
pub mod wire;
pub mod world;

use crate::base::time::Span;
use crate::msg::{Leg, TOES};

/// What the world's instruments would read without any error.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reading {
    /// Absolute angles of the legs from the vertical, inner and outer, rad.
    pub leg_angle_rad: [f64; 2],
    /// Their rates, rad/s.
    pub leg_rate_rad_s: [f64; 2],
    /// Acceleration of the IMU's place, the hip: forward, up, m/s^2. The blow of an impact is not in it.
    pub imu_accel_m_s2: [f64; 2],
    /// Hip angle inner - outer at the encoder, rad.
    pub hip_encoder_rad: f64,
    /// Toe lengths at the screws, m, 0 = retracted; inner A, inner B, outer A, outer B.
    pub toe_position_m: [f64; TOES],
    /// Compression of the toes' springs, m.
    pub toe_spring_m: [f64; TOES],
    /// Ground force on the stance toe: forward, up, N.
    pub ground_force_n: [f64; 2],
    /// The leg that stands; the last one that did while in flight.
    pub stance: Leg,
    /// Neither foot touches the ground.
    pub airborne: bool,
    /// The stance foot slides.
    pub slides: bool,
}

/// Where the robot is over the floor, for what looks at it from outside or looks down from it: axes along and normal to the
/// mean ground.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// The hip, m.
    pub hip_m: [f64; 2],
    /// Its velocity, m/s.
    pub hip_m_s: [f64; 2],
    /// From a leg's angle from the vertical to that from the ground's normal, rad.
    pub slope_rad: f64,
}

/// The bodies of the robot and the ground, as the drives and the IMU meet them.
pub trait World: Send {
    /// Moves on by `dt` (any length, a few ms at most) under constant commands.
    ///
    /// `hip_torque_nm`: torque of the motor at the joint's side of the gear, + on inner. The drive has already done its
    /// part: current lag, saturation, rated torque (`actuator_lag_s`, `torque_limit_nm`); compliance, friction and
    /// rotor inertia are the world's. `toe_target_m`: lengths that the drives' position loops ask for; rate and stroke
    /// limits and the series spring are the world's. A toe without power gets its present length (the screw holds).
    fn step(&mut self, hip_torque_nm: f64, toe_target_m: [f64; TOES], dt: Span);

    /// The hand that holds the legs lets go.
    fn let_go(&mut self);

    /// A horizontal impulse at the hip, N s, + forwards; a hand that holds the legs takes it up.
    fn push(&mut self, impulse_ns: f64);

    /// What the instruments see now.
    fn reading(&self) -> Reading;

    /// Where the robot is.
    fn place(&self) -> Place {
        Place { hip_m: [0.0, 1.0], ..Place::default() }
    }

    /// Height of the floor at a place along it, m.
    fn floor_height_m(&self, _along_m: f64) -> f64 {
        0.0
    }

    /// Lowest and highest floor that there may be, m.
    fn floor_range_m(&self) -> [f64; 2] {
        [0.0; 2]
    }
}

#[cfg(test)]
mod drive_laws;
#[cfg(test)]
mod experiments;
#[cfg(test)]
mod terrain_tests;
