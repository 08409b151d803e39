//! Compass runs a dynamic walking robot in hard real time and tells its owner why the robot does not behave like its
//! simulation. One executable, two halves, one model.
//!
//! # The walk
//! `sensor → accumulate → estimate → control → safety → dispatch → bus`. Rooms never import each other; they know only
//! the doors ([`msg`]). The corridor (`rt::tick`) is the one place that sees all rooms. The same tick runs on hardware,
//! in simulation and in replay: it is a pure function of [`msg::TickInput`], which is logged.
//!
//! # Floor plan (a module imports only lower layers, never sideways; `tests/architecture.rs` holds the table)
//! | layer | room | what it promises | RT |
//! |---|---|---|---|
//! | L0 | [`base`] | time, scalars, small linear algebra, Riccati, integrators; no robot, no I/O | yes |
//! | L1 | [`msg`] | the doors: `Copy`, `repr(C)`, fixed size, stamped with time of validity | yes |
//! | L1 | [`model`] | machines and effects as equations, generic in the scalar; no time, no I/O | yes |
//! | L2 | `config` | TOML as typed → checked, valid by construction | before arming |
//! | L2 | `channel` | names and types of the iceoryx2 services; publish and subscribe without waiting | yes |
//! | L3 | `sensor` | bytes to messages: IMU codec and serial line, operator | yes |
//! | L3 | `zero` | where each drive's zero is: toes home, a person confirms the hip | yes |
//! | L3 | `accumulate` | newest sample of each sensor → one snapshot with ages | yes |
//! | L3 | [`estimate`] | high-gain observer, attitude, impact at stance change | yes |
//! | L3 | [`control`] | state in, joint torque out; mode machine | yes |
//! | L3 | `safety` | guard at the door: dead-man, limits, latch | yes |
//! | L3 | `dispatch` | joint torque and toe lengths → five drive commands | yes |
//! | L3 | `bus` | frames on wires; CANopen line with CiA 402 drives; SocketCAN | yes |
//! | L4 | `rt` | the corridor: tick, threads, cycle, stop, statistics | yes |
//! | L4 | `record` | MCAP files: schemas, writer, reader, replay | no |
//! | L4 | `telemetry` | reads channels only; terminal view; never in the tick | no |
//! | L5 | `sim` | the simulated robot: hybrid world, drives and IMU that speak the real bytes, lockstep | no |
//! | L5 | [`design`] | offline: gains and gaits for `control` | no |
//! | L5 | `report` | plots, tables, pages: data in, files out; computes nothing | no |
//! | L6 | `identify` | rigs, recordings, free runs with sensitivities, fits, identifiability | no |
//! | L6 | `trial` | the exam of the diagnosis: concealed cases, seal, marks; shares no code with it | no |
//! | L6 | [`experiment`] | many runs in lockstep: plan, records, statistics | no |
//! | L6 | [`latency`] | the harness of `bench/` and `compass bench` | no |
//! | L7 | `diagnose` | detect, localise, attribute, prove | no |
//! | L8 | `cli` | arguments as typed → plan; one file per subcommand | no |
//!
//! # Bibliography
//! - *Thesis*: Z. J. Jackowski, *Design, Construction, and Experiments with a Compass Gait Walking Robot*, MIT, 2011;
//!   with the corrections of its errata where the code says "corrected".
//! - *CiA 301*, *CiA 402*: CANopen application layer and drive profile. *GX3*: MicroStrain 3DM-GX3 single-byte protocol.
//!   The formats as read here: `docs/protocols.md`.
//! - *Notes*, *model notes*: `docs/equations.md`, by section. *Contract*: `docs/contract.md`.

pub mod accumulate;
pub mod base;
pub mod bus;
pub mod channel;
pub mod cli;
pub mod config;
pub mod control;
pub mod design;
pub mod diagnose;
pub mod dispatch;
pub mod estimate;
pub mod experiment;
pub mod identify;
pub mod latency;
pub mod model;
pub mod msg;
pub mod record;
pub mod report;
pub mod rt;
pub mod safety;
pub mod sensor;
pub mod sim;
pub mod telemetry;
pub mod trial;
pub mod zero;
