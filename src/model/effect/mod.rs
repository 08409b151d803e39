//! Physical effects beyond the bare mechanism. [`catalogue`] lists them as data.
//!
//! RT: yes.

pub mod catalogue;

pub use catalogue::{EffectKind, Key, Role, SiteKind};
