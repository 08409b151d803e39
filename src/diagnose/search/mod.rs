//! Finds models that fit better, and decides nothing: each step asks the judge.
//!
//! RT: no.

pub mod basin_hopping;
pub(in crate::diagnose) mod budget;
pub mod converge_rivals;
pub mod exchange;
pub(in crate::diagnose) mod joint_pair;
pub mod kept_back_exchange;
pub mod law_exchange;
pub mod numerics;
pub mod pairwise_exchange;
pub mod ridge_restarts;
pub mod round;
pub mod runners_up;
mod screening;
pub mod stepwise;
pub mod subsample;
