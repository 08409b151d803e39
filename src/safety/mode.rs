//! The mode machine. RT: yes.
//!
//! ```text
//!            every source      edge and          every drive
//!              heard            healthy            enabled
//!  Starting ──────────► Disarmed ─────────► Arming ─────────► Armed
//!                                             ▲  │ fault        │ fault
//!                            edge and healthy │  ▼              │
//!                                            Faulted ◄──────────┘
//!
//!  Disarmed, Faulted ── edge, all healthy but for a toe's zero ──► Homing ── released, or all toes home ──► Disarmed
//!                                                                     └── fault ──► Faulted
//! ```
//! Torque passes in `Armed` only. A fault in `Starting` or `Disarmed` is no transition: it stands in the way of arming
//! until it is gone. Nothing leads back from `Faulted` but a fresh edge.

use crate::msg::Mode;

/// What happened in a tick.
#[derive(Clone, Copy, Debug)]
pub(super) struct Events {
    /// Every source was heard of since start.
    pub(super) heard: bool,
    /// The dead-man was pressed just now, after a release.
    pub(super) edge: bool,
    /// Nothing stands in the way.
    pub(super) healthy: bool,
    /// Something is wrong for a robot that is armed.
    pub(super) fault: bool,
    /// Every drive follows commands.
    pub(super) enabled: bool,
    /// Nothing stands in the way of homing, and a toe needs it.
    pub(super) homable: bool,
    /// The dead-man is held.
    pub(super) held: bool,
    /// Every toe has its zero.
    pub(super) homed: bool,
}

/// The mode after these events.
pub(super) const fn next(mode: Mode, events: Events) -> Mode {
    let arm = events.edge && events.healthy;
    match mode {
        Mode::Starting if events.heard => Mode::Disarmed,
        Mode::Disarmed | Mode::Faulted if arm => Mode::Arming,
        Mode::Disarmed | Mode::Faulted if events.edge && events.homable => Mode::Homing,
        Mode::Homing if events.fault => Mode::Faulted,
        Mode::Homing if !events.held || events.homed => Mode::Disarmed,
        Mode::Arming | Mode::Armed if events.fault => Mode::Faulted,
        Mode::Arming if events.enabled => Mode::Armed,
        _ => mode,
    }
}
