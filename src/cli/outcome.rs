//! How a command ended, as exit code and as text on stderr. RT: no.

use crate::config;
use crate::control::ControllerError;
use crate::rt::tick::TickError;
use crate::sim::lockstep::LockstepError;
use crate::sim::world::WorldError;
use std::any::Any;
use std::io::{self, Write};
use std::panic::{self, AssertUnwindSafe};
use std::process::ExitCode;

/// How a command that did its work ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Nothing to complain about.
    Fine,
    /// It did its work and found something: a mismatch, a limit exceeded, a machine unfit for real time.
    Finding,
}

/// The person asked for something that cannot be: usage or configuration, exit code 2. Any other error gives 3.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct UsageError(pub String);

const FINE: u8 = 0;
const FINDING: u8 = 1;
const USAGE: u8 = 2;
const INPUT: u8 = 3;
const INTERNAL: u8 = 70;

/// Runs a command, prints the whole error chain once, and gives the exit code.
pub(super) fn exit_code(command: impl FnOnce() -> anyhow::Result<Outcome>) -> ExitCode {
    // The panic hook has told the place already (and sent the stop frames, when a robot was running).
    let code = match panic::catch_unwind(AssertUnwindSafe(command)) {
        Ok(Ok(Outcome::Fine)) => FINE,
        Ok(Ok(Outcome::Finding)) => FINDING,
        Ok(Err(error)) => report(&error),
        Err(cause) => report_panic(cause.as_ref()),
    };
    ExitCode::from(code)
}

/// Prints the chain and chooses the code.
fn report(error: &anyhow::Error) -> u8 {
    if is_broken_pipe(error) {
        // `compass inspect x | head`: the reader has seen enough.
        return FINE;
    }
    tell(&format!("compass: {error:#}"));
    if is_usage(error) { USAGE } else { INPUT }
}

/// The person can put it right on the command line or in the configuration.
pub(super) fn is_usage(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        let is_room = cause.is::<LockstepError>() || cause.is::<TickError>() || cause.is::<WorldError>();
        is_room || cause.is::<UsageError>() || cause.is::<config::Errors>() || cause.is::<ControllerError>()
    })
}

fn report_panic(cause: &(dyn Any + Send)) -> u8 {
    let text = cause.downcast_ref::<String>().map(String::as_str).or(cause.downcast_ref::<&str>().copied());
    tell(&format!("compass: internal error (a bug, please report it): {}", text.unwrap_or("panic")));
    INTERNAL
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error
        .chain()
        .filter_map(|cause| cause.downcast_ref::<io::Error>())
        .any(|cause| cause.kind() == io::ErrorKind::BrokenPipe)
}

/// A line on stderr; if even that fails there is nobody left to tell.
fn tell(line: &str) {
    drop(writeln!(io::stderr(), "{line}"));
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::{Context, anyhow};

    fn code(result: anyhow::Result<Outcome>) -> ExitCode {
        exit_code(|| result)
    }

    #[test]
    fn results_map_to_the_documented_codes() {
        assert_eq!(code(Ok(Outcome::Fine)), ExitCode::from(0));
        assert_eq!(code(Ok(Outcome::Finding)), ExitCode::from(1));
        assert_eq!(code(Err(UsageError("no such key".into())).context("reading F")), ExitCode::from(2));
        assert_eq!(code(Err(anyhow!("no such device"))), ExitCode::from(3));
    }

    #[test]
    fn panic_becomes_70() {
        assert_eq!(exit_code(|| panic!("test")), ExitCode::from(70));
    }

    #[test]
    fn broken_pipe_is_no_failure() {
        let error = io::Error::from(io::ErrorKind::BrokenPipe);
        assert_eq!(code(Err(error).context("writing the table")), ExitCode::from(0));
    }
}
