//! The equations in SI: Nm, J, N, m. The same parameter set, converted at the door. RT: yes.

use super::dynamics;
use super::floating;
use super::params::Params;
use crate::base::scalar::Scalar;

impl<S: Scalar> Params<S> {
    /// Mass matrix, kg m².
    #[must_use]
    pub fn mass_matrix_kg_m2(&self, q: [S; 2]) -> [[S; 2]; 2] {
        let unit = self.inertia_kg_m2();
        dynamics::mass_matrix(&self.normalised(), q).map(|row| row.map(|x| x * unit))
    }

    /// Gravity torques on the two rows, Nm.
    #[must_use]
    pub fn gravity_nm(&self, q: [S; 2]) -> [S; 2] {
        let unit = self.inertia_kg_m2();
        dynamics::gravity(&self.normalised(), q).map(|x| x * unit)
    }

    /// Accelerations, rad/s², under the hip torque `torque_nm` (+ on stance) with smoothed friction.
    #[must_use]
    pub fn acceleration_rad_s2(&self, q: [S; 2], v: [S; 2], torque_nm: S) -> [S; 2] {
        dynamics::acceleration(&self.normalised(), q, v, torque_nm / self.inertia_kg_m2())
    }

    /// Kinetic and potential energy of the pinned robot, J.
    #[must_use]
    pub fn energy_j(&self, q: [S; 2], v: [S; 2]) -> [S; 2] {
        let (p, unit) = (self.normalised(), self.inertia_kg_m2());
        [dynamics::kinetic(&p, q, v) * unit, dynamics::potential(&p, q) * unit]
    }

    /// Force of the ground on the pinned stance toe under the total hip torque `torque_nm` (friction included), N.
    #[must_use]
    pub fn ground_force_n(&self, q: [S; 2], v: [S; 2], torque_nm: S) -> [S; 2] {
        let (p, unit) = (self.normalised(), self.mass_moment_kg_m());
        let a = dynamics::acceleration_without_friction(&p, q, v, torque_nm / self.inertia_kg_m2());
        floating::ground_force(&p, q, v, a).map(|f| f * unit)
    }
}
