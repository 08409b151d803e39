//! L4: the corridor. The one place that sees all rooms, and what it needs from the machine to walk in time.
//!
//! | file | what |
//! |---|---|
//! | [`tick`] | the walk: a pure function of [`crate::msg::TickInput`] |
//! | [`cycle`] | absolute wake-ups that keep the phase and skip whole periods |
//! | [`clock`], [`wake`] | CLOCK_MONOTONIC; one futex to wake the control thread |
//! | [`thread`], [`memory`] | priority, core, stack; locked memory; what was not granted |
//! | [`allocation`] | counts allocations of each thread |
//! | [`stop`] | stop frames on every way out, the panic's first |
//! | [`stats`] | histograms |
//!
//! RT: tick, cycle, clock, wake. The rest runs before arming or beside the loop, as each file says.

pub mod allocation;
pub mod clock;
pub mod cycle;
pub mod memory;
pub mod stats;
pub mod stop;
pub mod thread;
pub mod tick;
pub mod wake;
