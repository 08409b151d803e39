//! L6: the exam of the diagnosis: what it must answer and does not see.
//!
//! - [`generator`] draws machines with hidden physics and writes their recordings; [`seal`] hides the truth until all
//!   answers exist; [`score`] marks answers against what is known
//! - [`resplit`] asks the same of hardware: its recordings split, cut and disturbed in other ways
//!
//! The exam shares no code with what it examines: it imports neither `model` nor `identify` nor `diagnose`
//! (`tests/architecture.rs` holds that), simulates with equations and integrators of its own, and meets the diagnosis
//! only as a program that reads a case and writes an answer.
//! RT: no.

mod dice;
pub mod generator;
pub mod resplit;
pub mod score;
pub mod seal;
