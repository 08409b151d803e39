//! What the kernel says of a CAN interface, for checks before arming. RT: no.
#![expect(clippy::disallowed_types, clippy::disallowed_methods, clippy::disallowed_macros, reason = "not real-time")]

use socketcan::CanInterface;
use std::fs;

/// State and settings of an interface.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LinkReport {
    /// Is it up?
    pub is_up: bool,
    /// Bits per second; `None` on vcan.
    pub bitrate: Option<u32>,
    /// After bus-off the kernel restarts it by itself after so many ms; 0 = never; `None` on vcan.
    pub restart_ms: Option<u32>,
    /// Frames that the kernel queues.
    pub tx_queue_len: Option<u32>,
    /// Bytes of its longest frame: 16 classic, 72 CAN-FD.
    pub mtu: Option<u32>,
}

/// Bytes of a `struct canfd_frame`, which an interface takes whose MTU is so large.
pub const FD_MTU: u32 = 72;

/// Asks the kernel.
///
/// # Errors
/// No such interface, or netlink does not answer.
pub fn inspect(name: &str) -> std::io::Result<LinkReport> {
    let other = |text: String| std::io::Error::other(text);
    let interface = CanInterface::open(name).map_err(|e| other(e.to_string()))?;
    let details = interface.details().map_err(|e| other(e.to_string()))?;
    Ok(LinkReport {
        is_up: details.is_up,
        bitrate: details.can.bit_timing.map(|t| t.bitrate),
        restart_ms: details.can.restart_ms,
        tx_queue_len: attribute(name, "tx_queue_len"),
        mtu: attribute(name, "mtu"),
    })
}

/// A number that the kernel tells of an interface.
fn attribute(name: &str, attribute: &str) -> Option<u32> {
    fs::read_to_string(format!("/sys/class/net/{name}/{attribute}")).ok()?.trim().parse().ok()
}

/// Before arming: an interface for classic frames refuses those of CAN-FD one by one, and its drives would seem dead.
///
/// # Errors
/// When the interface is not set up for CAN-FD.
pub fn must_carry_fd(name: &str) -> std::io::Result<()> {
    match attribute(name, "mtu") {
        Some(mtu) if mtu < FD_MTU => Err(std::io::Error::other(format!(
            "data_bitrate_bit_s asks for CAN-FD, but {name} carries classic frames only (mtu {mtu}): take it down and \
             `ip link set {name} type can ... dbitrate N fd on`; a virtual one: `mtu {FD_MTU}`"
        ))),
        _ => Ok(()),
    }
}

/// True if this process may take links down and up (CAP_NET_ADMIN): to be known before the emergency, not in it.
#[must_use]
pub fn may_change_links() -> bool {
    const CAP_NET_ADMIN: u64 = 1 << 12;
    fs::read_to_string("/proc/self/status").is_ok_and(|text| {
        let line = text.lines().find_map(|l| l.strip_prefix("CapEff:"));
        line.and_then(|hex| u64::from_str_radix(hex.trim(), 16).ok()).is_some_and(|caps| caps & CAP_NET_ADMIN != 0)
    })
}
