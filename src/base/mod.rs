//! L0: what every other layer stands on. Knows no robot and does no I/O.
//!
//! RT: all of it, but `riccati` (before arming only) and `spectrum` (no).

pub mod bytes;
pub mod can_time;
pub mod jet;
pub mod linalg;
pub mod listening;
pub mod ode;
pub mod riccati;
pub mod scalar;
pub mod spectrum;
pub mod time;
