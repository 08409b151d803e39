//! L6: what physics is missing in a simulation, from recordings (diagnosis contract, schema 1).
//!
//! The walk: noise floor → base fit and detection → where → which of the candidates, alone and together → proof on
//! recordings that were never fitted → [`judge::verdict`].
//! RT: no.

mod allowance;
pub mod at_rest;
pub mod attribute;
pub mod base;
pub mod candidates;
pub mod carry;
pub mod changed;
pub mod contest;
pub mod disagreement;
pub mod flexible;
pub mod folds;
pub mod free_curve;
pub mod headline;
pub mod hypothesis;
pub mod identification;
pub mod interest;
pub mod judge;
pub mod laws;
pub mod likelihood;
pub mod linearise;
pub mod lines;
pub mod localise;
pub mod narrow;
pub mod own;
pub mod pairs;
pub mod pipeline;
pub mod propose;
pub mod prove;
pub mod ridge;
pub mod round;
pub mod scales;
pub mod scan;
pub mod screen;
pub mod sentence;
pub mod sets;
pub mod spikes;
pub mod stragglers;
pub mod supposed;
pub mod suspicion;
pub mod tables;
pub mod tangent;
pub mod thin;
pub mod tried;
pub mod unlisted;
pub mod valley;
