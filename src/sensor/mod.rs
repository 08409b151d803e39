//! Room 1: bytes to messages.
//!
//! | file | what |
//! |---|---|
//! | [`imu_codec`] | 3DM-GX3 single-byte protocol as pure functions on bytes, both ends |
//! | [`mip`] | MicroStrain MIP the same way |
//! | [`clock_fit`] | the device's clock mapped to ours |
//! | [`imu`] | start-up of the stream, bytes to samples |
//! | [`operator`] | the dead-man switch: simulated, a UNIX socket, an input device, a network |
//! | [`mocap`], [`natnet`], [`vicon`] | ground truth of motion capture, for recordings |
//! | [`scip`] | Hokuyo SCIP 2: bytes of a laser scanner to scans |
//! | [`lidar`] | the dialogue with a scanner, its link, and the straight line of the floor in a scan |
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
pub mod lidar;
pub mod mip;
pub mod mocap;
pub mod natnet;
pub mod operator;
pub mod scip;
pub mod serial;
pub mod vicon;
