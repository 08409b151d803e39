//! Makes cases with hidden physics, for trials. Shares no formula with `model` or `identify`.
//!
//! - [`chain`]: bodies on arms, projected; [`machine`]: dry friction by time-stepping, LuGre pre-sliding, drives with
//!   springs and play, 10 or 20 kHz; [`walker`]: feet, ground and impacts, 4 kHz; [`gait`]: what makes it walk
//! - [`rig`]: drawn machines; [`program`]: excitations; [`experiment`]: recordings; `dice` beside this room: seeded draws and noise
//! - [`draw`], [`effect`]: what is hidden; [`refit`]: how visible it remains; [`twins`]: what else the data allows
//! - [`case`]: five levels of concealment; [`files`]: the case and its truth on disk
//!
//! Limits: drives are rigid while walking; one flexible link per machine.
//! RT: no.

mod case;
mod chain;
mod draw;
mod effect;
mod experiment;
mod files;
mod gait;
mod machine;
mod program;
mod refit;
mod rig;
mod twins;
mod walker;

use std::collections::BTreeMap;
use std::io;
use std::path::Path;

use rayon::prelude::*;

pub use case::Recipe;

use super::dice::{self, Dice};
use super::score::Simulated;

/// Writes `count` cases into `folder` and gives their truths by name. Names say nothing: they are numbers.
///
/// # Errors
/// The folder cannot be written.
pub fn write_cases(folder: &Path, count: usize, seed: u64, recipe: Recipe) -> io::Result<BTreeMap<String, Simulated>> {
    (0..count)
        .into_par_iter()
        .map(|number| {
            let name = format!("trial-{:03}", number + 1);
            let case = case::draw(&mut Dice::new(seed, number as u64), recipe);
            files::write(&case, &name, &folder.join(&name))?;
            Ok((name, files::truth(&case)))
        })
        .collect()
}

#[cfg(test)]
mod oracle;
#[cfg(test)]
mod tests;
