//! Warnings about a case on stderr: those of the input before the work, the others after it. RT: no.

use crate::identify::experiment::Recording;
use std::io::{self, Write};

/// What is odd in these recordings; said at once, because the work may take long.
pub(crate) fn of_input(recordings: &[Recording]) -> io::Result<()> {
    recordings.iter().flat_map(|r| &r.warnings).try_for_each(|text| writeln!(io::stderr(), "warning: {text}"))
}

/// What else was found odd.
pub(crate) fn further(all: &[String], recordings: &[Recording]) -> io::Result<()> {
    let said = |text: &String| recordings.iter().any(|r| r.warnings.contains(text));
    all.iter().filter(|text| !said(text)).try_for_each(|text| writeln!(io::stderr(), "warning: {text}"))
}
