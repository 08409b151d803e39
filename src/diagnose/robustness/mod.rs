//! Whether an effect holds where it was not fitted: on other recordings, with states that go on from window to window, beside
//! instants and touchdowns that no recording tells to the last.
//!
//! Fits and runs; what follows from them the judge says.
//! RT: no.

pub mod cross_validation;
pub mod held_out;
pub mod instants;
pub mod state_continuity;
pub(in crate::diagnose) mod touchdowns;
