//! The answer in sets, numbers, curves and words.
//!
//! RT: no.

pub mod answer_sets;
pub mod headline;
pub mod interest;
pub mod laws;
pub mod localise;
pub mod narrow;
pub mod sentence;
pub mod tables;
