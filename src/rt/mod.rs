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
//! | [`feed`], [`io`], [`awaited`], [`poll`] | where input comes from; what a cycle waits for |
//! | [`control_loop`], [`process`] | the control thread; all threads |
//! | [`relay`], [`stats`], [`flight`] | ticks for everybody else; histograms; the last ticks before a fault |
//!
//! RT: tick, cycle, clock, wake, feed, io, awaited, control_loop. The rest runs before arming or beside the loop, as each file says.

pub mod allocation;
pub mod awaited;
pub mod clock;
pub mod control_loop;
pub mod cycle;
pub mod feed;
pub mod flight;
pub mod io;
pub mod memory;
pub mod poll;
pub mod process;
pub mod relay;
pub mod stats;
pub mod stop;
pub mod thread;
pub mod tick;
pub mod wake;
