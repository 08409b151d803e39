//! L5: plots, tables and pages. Data in, files out; it computes nothing.
//!
//! RT: no.

pub mod animation;
pub mod experiment;
pub mod findings;
pub mod identified;
pub mod interval;
pub mod motion;
pub mod page;
pub mod plot;
pub mod recorded;
pub mod table;
