//! Every effect that may be missing: its places, bounds and starts, and what a fit of it led to.
//!
//! RT: no.

pub mod candidate_fit;
pub mod candidates;
pub mod initial_guesses;
pub mod laws;
pub mod limited_fit;
pub(crate) mod worked;
