//! The answer in sets, numbers and curves; the words for it are in [`sentence`](crate::diagnose::sentence).
//!
//! RT: no.

pub mod answer_sets;
pub mod headline;
pub mod interest;
pub mod laws;
pub mod localise;
pub mod narrow;
pub mod tables;
