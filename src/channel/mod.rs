//! L2: channels between threads and processes: fixed size, nobody waits.
//!
//! [`ring`] is between the real-time threads of this process. [`topic`] and [`port`] are for everybody, also in other
//! processes: named channels in shared memory (iceoryx2). Ports belong to the thread that opened them.
//! [`socket_file`] is for whom shared memory shuts out.
//! Wake-ups do not go through here: see `rt::wake`.
//!
//! RT: `ring`. A port does not wait either, but it allocates.

pub mod port;
pub mod ring;
pub mod socket_file;
pub mod topic;
