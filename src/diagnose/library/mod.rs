//! Every effect that may be missing: its places, bounds and starts.
//!
//! RT: no.

pub mod candidates;
pub mod initial_guesses;
