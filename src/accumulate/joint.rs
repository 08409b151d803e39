//! From drive and device units to joint units. RT: yes.

use crate::config::checked::Robot;
use crate::msg::{DriveFeedback, ImuSample};
use std::f64::consts::TAU;

/// Index of the pitch axis in the IMU's vectors (roll, pitch, yaw).
const PITCH: usize = 1;

/// Factors and offsets, computed once.
#[derive(Clone, Copy, Debug)]
pub(super) struct Joints {
    hip_rad_per_count: f64,
    hip_offset_rad: f64,
    hip_nm_per_permille: f64,
    toe_m_per_count: f64,
    spring_m_per_count: f64,
    imu_sign: f64,
    imu_offset_rad: f64,
}

impl Joints {
    /// Factors of this robot.
    pub(super) fn new(robot: &Robot) -> Self {
        let hip = &robot.hip;
        let [hip_drive, ..] = &robot.drives;
        let rated_nm = hip_drive.rated_torque_nm;
        Self {
            hip_rad_per_count: TAU / hip.encoder_counts_per_turn,
            hip_offset_rad: hip.encoder_offset_rad,
            hip_nm_per_permille: 1e-3 * rated_nm * hip.gear_ratio * hip.gear_efficiency * hip.motor_sign,
            toe_m_per_count: 1.0 / robot.toe.counts_per_m,
            spring_m_per_count: 1.0 / robot.toe.pot_counts_per_m,
            imu_sign: robot.imu.sign,
            imu_offset_rad: robot.imu.offset_rad,
        }
    }

    /// Hip angle inner - outer, rad.
    pub(super) fn hip_angle_rad(&self, hip: &DriveFeedback) -> f64 {
        self.hip_offset_rad + self.hip_rad_per_count * f64::from(hip.position_counts)
    }

    /// Hip torque at the joint, + on inner, Nm.
    pub(super) fn hip_torque_nm(&self, hip: &DriveFeedback) -> f64 {
        self.hip_nm_per_permille * f64::from(hip.torque_permille)
    }

    /// Toe length, m, 0 = retracted.
    pub(super) fn toe_position_m(&self, toe: &DriveFeedback) -> f64 {
        self.toe_m_per_count * f64::from(toe.position_counts)
    }

    /// Compression of the toe's spring, m.
    pub(super) fn toe_spring_m(&self, toe: &DriveFeedback) -> f64 {
        self.spring_m_per_count * f64::from(toe.analog_counts)
    }

    /// Inner leg from the vertical, rad. Only meaningful if the sample carries the device's attitude.
    pub(super) fn leg_angle_rad(&self, imu: &ImuSample) -> f64 {
        self.imu_offset_rad + self.imu_sign * imu.euler_rad[PITCH]
    }

    /// Its rate by the gyro, rad/s.
    pub(super) fn leg_rate_rad_s(&self, imu: &ImuSample) -> f64 {
        self.imu_sign * imu.rate_rad_s[PITCH]
    }
}
