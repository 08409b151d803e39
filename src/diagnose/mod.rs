//! L6: what physics is missing in a simulation, from recordings (diagnosis contract, schema 1).
//!
//! The walk: noise floor → base fit and detection → where → which of the candidates, alone and together → proof on
//! recordings that were never fitted → [`verdict`].
//! RT: no.

pub mod candidates;
pub mod generator;
pub mod score;
pub mod screen;
pub mod sentence;
pub mod trial;
pub mod verdict;
