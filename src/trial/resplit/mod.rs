//! The exam for hardware: the same machine, split, cut and disturbed in other ways, must get the same answer.
//!
//! ```text
//! case on hardware ── change (drawn by seed) ──> variant: rig.toml and recordings of its own
//! variant ── compass identify --add ──> settle: can these recordings tell the truth from its rivals at all?
//! variant ── compass diagnose ──> mark: is what is expected named, nothing forbidden, the error as with the truth?
//! ```
//! One given split of a recording is one draw: that a diagnosis is right on it says little (seen: 8 of 8 on the given
//! split, 77 % on others of the same recordings).
//! - [`table`], [`rig_file`]: recordings and rigs as text that is cut and edited; [`change`]: what is changed;
//!   [`mod@write`]: a variant on disk; [`settle`]: what the truth and its rivals are worth there; [`mod@mark`]: right or not;
//!   [`board`]: the table and the JSON
//!
//! RT: no.

mod board;
mod change;
mod mark;
mod rig_file;
mod settle;
mod table;
mod write;

pub use board::{Report, Row};
pub use change::Change;
pub use mark::{VariantMark, mark};
pub use settle::{Settled, Settler};
pub use write::{ResplitError, Variant, write_variants};
