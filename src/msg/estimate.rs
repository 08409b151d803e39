//! What the accumulator and the estimator say. RT: yes.

use super::reflect::message;
use super::{ImuSample, Leg, TOES};
use crate::base::time::{Span, Stamp};
use iceoryx2::prelude::ZeroCopySend;

message! {
    /// The newest of each sensor in joint units, with ages. An age of a source that never spoke is [`Span`]'s maximum.
    pub struct Snapshot {
        /// The tick's time.
        pub stamp: Stamp,
        /// Newest IMU sample.
        pub imu: ImuSample,
        /// Its age.
        pub imu_age: Span,
        /// Absolute angle of the leg that carries the IMU (inner), from the vertical, rad.
        pub leg_angle_rad: f64,
        /// Its rate by the gyro, rad/s.
        pub leg_rate_rad_s: f64,
        /// Hip angle inner - outer at the joint, rad.
        pub hip_angle_rad: f64,
        /// Torque at the hip as the drive reports it, + on inner, joint side, Nm.
        pub hip_torque_nm: f64,
        /// Age of the hip's reading.
        pub hip_age: Span,
        /// Toe lengths as the drives report them, m, 0 = retracted.
        pub toe_position_m: [f64; TOES],
        /// Compression of the toes' springs, m.
        pub toe_spring_m: [f64; TOES],
        /// Oldest of the toes' ages.
        pub toe_age: Span,
        /// Age of the operator's last sign of life.
        pub operator_age: Span,
        /// The dead-man switch is held.
        pub dead_man: bool,
        /// Ticks came late: terms that need the right phase (friction compensation, feed-forward) shall be off.
        pub late: bool,
        /// Walking speed that the operator's stick asks for, m/s; 0 from a hand that lets go, is not heard of, or says what
        /// no stick can say.
        pub asked_m_s: f64,
    }
}

message! {
    /// State of the robot, stance leg first as in the model notes: angles absolute from the vertical.
    pub struct Estimate {
        /// Time that it holds for.
        pub stamp: Stamp,
        /// False until the estimator has started from fresh sensors.
        pub valid: bool,
        /// The leg that stands.
        pub stance: Leg,
        /// Stance leg angle, rad.
        pub theta_stance_rad: f64,
        /// Swing leg angle, rad.
        pub theta_swing_rad: f64,
        /// Stance leg rate, rad/s.
        pub theta_stance_rad_s: f64,
        /// Swing leg rate, rad/s.
        pub theta_swing_rad_s: f64,
        /// Measured minus estimated stance angle, rad.
        pub innovation_stance_rad: f64,
        /// Measured minus estimated swing angle, rad.
        pub innovation_swing_rad: f64,
        /// Hip angle inner - outer as measured at the encoder, rad.
        pub hip_angle_rad: f64,
        /// Rotor angle (through the gear) minus the angle between the legs, stance - swing, rad; 0 if the model's hip
        /// is rigid.
        pub hip_twist_rad: f64,
        /// Its rate, rad/s.
        pub hip_twist_rad_s: f64,
        /// What the IMU's attitude is believed to read too much beside `Terrain::zero_rad`, rad: the moment of gravity
        /// about the toe tells.
        pub attitude_bias_rad: f64,
        /// Number of stance changes seen.
        pub steps: u32,
        /// Share of the weight that the foot carries which is not taken to stand: 0 = none, 1 = all.
        pub weight_elsewhere: f64,
        /// Doubt about the stance leg, by which torque fades: 0 = none, 1 = no torque.
        pub stance_doubt: f64,
        /// Toes whose spring sensor is stuck and no longer asked, by bit: inner A, inner B, outer A, outer B.
        pub stuck_pots: u8,
    }
}
