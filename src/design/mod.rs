//! L5: offline planning: steps, gaits and their gains, for `control`.
//!
//! | file | what |
//! |---|---|
//! | [`problem`] | a planning problem as data: phases, ends, limits, cost |
//! | [`nlp`] | nonlinear programs: interior point, chain-structured linear algebra |
//! | [`collocation`] | problem → program: Hermite-Simpson, exact derivatives |
//! | [`solve`] | coarse, then fine; what blocks when there is no solution |
//! | [`trajectory`] | the result as functions of time |
//! | [`tasks`] | the problems that walking needs: gait, rebalance, step-in, change of speed, stop |
//! | [`tvlqr`] | gains by time, through impacts (saltation) |
//! | [`transverse`] | surfaces, periodic Riccati, multipliers |
//! | [`tree`] | LQR-trees: samples, planned branches, tubes cut down by simulation |
//! | [`mod@file`] | motion and gains → `control::tables` |
//!
//! RT: no.

pub mod collocation;
pub mod file;
pub mod nlp;
pub mod problem;
pub mod solve;
pub mod tasks;
pub mod trajectory;
pub mod transverse;
pub mod tree;
pub mod tvlqr;

#[cfg(test)]
mod tests;
#[cfg(test)]
mod transverse_tests;
