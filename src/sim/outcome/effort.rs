//! Work of the motors, and what walking costs. RT: no.
//!
//! Positive mechanical work only: what is braked is not won back. Sampled once per tick; the hip's is torque times joint
//! rate (what the harmonic drive's spring stores comes and goes and is not counted), the toes' is the force along the
//! leg that stands times the speed with which its longer toe extends.

use super::stance_lean_rad;
use crate::config::checked::Config;
use crate::msg::TOES;
use crate::sim::Reading;

/// Toes of a leg.
const PAIR: usize = TOES / 2;

/// Sums it up.
#[derive(Clone, Debug)]
pub struct Effort {
    weight_n: f64,
    slope_rad: f64,
    before: Option<(f64, [f64; 2])>,
    hip_j: f64,
    toe_j: f64,
    peak_torque_nm: f64,
    /// Work at the first and at the last step, J.
    at_steps: Option<[f64; 2]>,
}

impl Effort {
    /// Nothing done yet.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let body = config.body().params();
        Self {
            weight_n: body.total_mass_kg * body.gravity_m_s2,
            slope_rad: config.simulation.ground_slope_rad,
            before: None,
            hip_j: 0.0,
            toe_j: 0.0,
            peak_torque_nm: 0.0,
            at_steps: None,
        }
    }

    /// One tick; `hip_torque_nm` as the motor makes it at the joint.
    pub fn look(&mut self, now_s: f64, reading: &Reading, hip_torque_nm: f64) {
        let lengths =
            [0, 1].map(|leg| reading.toe_position_m[PAIR * leg..][..PAIR].iter().copied().fold(0.0, f64::max));
        self.peak_torque_nm = self.peak_torque_nm.max(hip_torque_nm.abs());
        let Some((before_s, before_m)) = self.before.replace((now_s, lengths)) else { return };
        let rate_rad_s = reading.leg_rate_rad_s[0] - reading.leg_rate_rad_s[1];
        self.hip_j += (hip_torque_nm * rate_rad_s).max(0.0) * (now_s - before_s);
        let stance = reading.stance as usize;
        let (sin, cos) = libm::sincos(stance_lean_rad(reading) + self.slope_rad);
        let [along, normal] = reading.ground_force_n;
        self.toe_j += ((normal * cos - along * sin).max(0.0) * (lengths[stance] - before_m[stance])).max(0.0);
    }

    /// A step was made: the cost is counted from the first to the last.
    pub fn step(&mut self) {
        let work_j = self.hip_j + self.toe_j;
        let [first, _] = self.at_steps.unwrap_or([work_j; 2]);
        self.at_steps = Some([first, work_j]);
    }

    /// Largest torque of the hip motor at the joint, Nm.
    #[must_use]
    pub const fn peak_torque_nm(&self) -> f64 {
        self.peak_torque_nm
    }

    /// Positive work of hip and toes, J.
    #[must_use]
    pub const fn work_j(&self) -> [f64; 2] {
        [self.hip_j, self.toe_j]
    }

    /// Positive work per weight and distance between the first step and the last, `distance_m` apart.
    #[must_use]
    pub fn cost_of_transport(&self, distance_m: f64) -> Option<f64> {
        let [first, last] = self.at_steps?;
        (distance_m.abs() > 0.0).then(|| (last - first) / (self.weight_n * distance_m.abs()))
    }
}
