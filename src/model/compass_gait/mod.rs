//! Compass gait with a bisecting body: one folder is the whole robot.
//!
//! Written for "leg 1 stands"; the other mode is the same code with [`params::Params::swapped`]. Normalised: torques
//! and energies divided by `m_t l²`, forces by `m_t l`, lengths by `l`; time in seconds ([`si`] converts).
//!
//! | file | what |
//! |---|---|
//! | [`params`] | parameters, their meaning, consistency |
//! | [`kinematics`] | where hip, toes and body are |
//! | [`dynamics`] | pinned: H, C, G, friction, accelerations |
//! | [`floating`] | toe free: mass matrix, ground force, airborne, sliding |
//! | [`impact`] | touchdown: inelastic, restitution, Coulomb cone; exchange of legs |
//! | [`elastic`] | harmonic drive with a spring: six states |
//! | [`toe`] | lead screw with a preloaded one-sided spring |
//! | [`linear`] | Jacobians by dual numbers |
//! | [`si`] | the same in Nm, J, N and m |
//!
//! Cannot do: legs of changing length (a retracted toe moves 20 mm of a light part), three dimensions, knees.
//! RT: yes, no allocation.

pub mod dynamics;
pub mod elastic;
pub mod floating;
pub mod impact;
pub mod kinematics;
pub mod linear;
pub mod params;
pub mod si;
pub mod toe;

#[cfg(test)]
mod laws;
#[cfg(test)]
mod reference;
