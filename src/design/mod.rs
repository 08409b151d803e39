//! L5: offline planning: steps, gaits and their gains, for `control`.
//!
//! | file | what |
//! |---|---|
//! | [`problem`] | a planning problem as data: phases, ends, limits, cost |
//! | [`nlp`] | nonlinear programs: interior point, chain-structured linear algebra |
//! | [`collocation`] | problem → program: Hermite-Simpson, exact derivatives |
//!
//! RT: no.

pub mod collocation;
pub mod nlp;
pub mod problem;
