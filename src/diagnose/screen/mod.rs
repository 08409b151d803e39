//! Cheap bounds on what an effect would gain: the base made linear, and signals tested against what it leaves.
//!
//! RT: no.

pub mod linearise;
pub mod ltv;
pub mod modes;
pub mod scales;
pub mod scan;
pub mod score_test;
pub mod spectral_peaks;
pub mod subsample;
