//! L2: named channels between threads and processes (iceoryx2): fixed size, shared memory, nobody waits.
//!
//! [`topic`] holds names, types and buffer sizes; [`port`] publishes and subscribes. Ports belong to the thread that
//! opened them. Wake-ups do not go through here: see `rt::wake`.
//!
//! RT: publishing and receiving; opening is before arming only.

pub mod port;
pub mod topic;
