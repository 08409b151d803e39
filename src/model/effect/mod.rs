//! Physical effects beyond the bare mechanism: one library, which plugs into any mechanism through the
//! [machine](super::machine). Each vanishes at its zero value.
//!
//! | file | effects |
//! |---|---|
//! | [`catalogue`] | all of them as data |
//! | [`friction`] | what acts at one side of one joint |
//! | [`drive`] | joint elasticity, backlash, link flexibility |
//! | [`actuator`] | delay, lag, limit |
//! | [`sensing`] | lag, delay, bias, drift, scale, eccentricity, lost counts, clock skew |
//!
//! RT: yes; building before arming only.

pub mod actuator;
pub mod catalogue;
pub mod drive;
pub mod friction;
pub mod sensing;

pub use catalogue::{EffectKind, Key, Role, SiteKind};
