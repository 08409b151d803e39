//! L6: system identification by simulation error: rigs, recordings, free runs with sensitivities, fits.
//!
//! RT: no.

pub mod fit;
pub mod identifiability;
pub mod noise;
