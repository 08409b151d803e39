//! From the configuration to the equations' parameters. RT: before arming only.

use super::checked::{Config, HipElasticity, Model};
use crate::model::compass_gait::params::{Elasticity, Params};

impl Config {
    /// The simulated robot's own body: `sim.body`, or the controller's model if that is all there is.
    #[must_use]
    pub fn body(&self) -> &Model {
        self.simulation.body.as_ref().unwrap_or(&self.robot.model)
    }
}

impl Model {
    /// Parameters of the equations, inner leg standing.
    #[must_use]
    pub fn params(&self) -> Params<f64> {
        Params {
            c: std::array::from_fn(|i| self.c[i].value),
            leg_length_m: self.leg_length_m.value,
            total_mass_kg: self.total_mass_kg.value,
            gravity_m_s2: self.gravity_m_s2.value,
            viscous_nm_s_rad: self.viscous_nm_s_rad.value,
            coulomb_nm: self.coulomb_nm.value,
        }
    }
}

impl HipElasticity {
    /// For the equations. The rotor's own friction is not told apart from the hip's.
    #[must_use]
    pub const fn elasticity(&self) -> Elasticity<f64> {
        Elasticity {
            stiffness_nm_rad: self.stiffness_nm_rad,
            damping_nm_s_rad: self.damping_nm_s_rad,
            rotor_inertia_kg_m2: self.rotor_inertia_kg_m2,
            rotor_damping_nm_s_rad: 0.0,
        }
    }
}
