//! Room 1: bytes to messages.
//!
//! | file | what |
//! |---|---|
//! | [`imu_codec`] | 3DM-GX3 single-byte protocol as pure functions on bytes, both ends |
//! | [`clock_fit`] | the device's clock mapped to ours |
//! | [`imu`] | start-up of the stream, bytes to samples |
//! | [`operator`] | the dead-man switch: simulated, or a UNIX socket |
//! | [`serial`] | the serial line, which never waits |
//!
//! RT: yes, but opening a line is for before arming.
#![cfg_attr(
    not(test),
    deny(
        clippy::disallowed_methods,
        clippy::disallowed_types,
        clippy::disallowed_macros,
        clippy::expect_used,
        clippy::indexing_slicing
    )
)]

pub mod clock_fit;
pub mod imu;
pub mod imu_codec;
pub mod operator;
pub mod serial;
