//! What no effect of the library says: forces without a name, a machine that changes, recordings of several machines.
//!
//! RT: no.

pub mod change_point;
pub(in crate::diagnose) mod force_patterns;
pub mod free_curve;
pub(in crate::diagnose) mod holds_elsewhere;
pub mod pooling_test;
pub mod residual_force;
