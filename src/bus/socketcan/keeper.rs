//! Looks after a bus that is dead, or whose adapter was plugged in again, from a thread of its own. RT: no, and nothing
//! real-time waits for it.

use super::Shared;
use super::link_report::may_change_links;
use crate::base::time::{Span, Stamp};
use crate::bus::link;
use crate::msg::BusHealth;
use socketcan::CanInterface;
use socketcan::nl::CanState;
use std::ffi::CString;
use std::os::fd::{AsRawFd, RawFd};
use std::sync::{Arc, Weak};
use std::time::Duration;

/// It looks so often.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// A dead bus is left dead for so long, so that everybody has seen it.
const PATIENCE: Span = Span::from_ms(100);
/// And is not worked on more often than this.
const WORK_EVERY: Span = Span::from_ms(1000);

/// Starts the thread; it ends when the bus is closed.
pub(super) fn start(name: &str, shared: &Arc<Shared>) -> std::io::Result<()> {
    let interface = CanInterface::open(name).map_err(|_| std::io::Error::from(std::io::ErrorKind::NotFound))?;
    let name = CString::new(name)?;
    let bound = index_of(&name);
    let shared = Arc::downgrade(shared);
    let place = Place { name, bound, interface };
    std::thread::Builder::new().name("can-keeper".into()).spawn(move || keep(place, &shared))?;
    Ok(())
}

/// Where the socket sits: an adapter that is plugged in again has its name (systemd/80-compass-can.link) but another
/// number.
struct Place {
    name: CString,
    /// Number of the interface that the socket is bound to.
    bound: Option<u32>,
    interface: CanInterface,
}

impl Place {
    /// Follows an adapter that was plugged in again: the socket, which the kernel has let go, is bound to the new
    /// interface.
    fn follow(&mut self, shared: &Shared) {
        let present = index_of(&self.name);
        if !must_rebind(self.bound, present) {
            return;
        }
        let Some((index, interface)) = present.zip(self.name.to_str().ok().and_then(|n| CanInterface::open(n).ok()))
        else {
            return;
        };
        if rebind(shared.socket.as_raw_fd(), index) {
            self.bound = present;
            self.interface = interface;
            shared.echoes.forget();
            adopt_state(&self.interface, shared);
        }
    }
}

/// The interface of this name is there, and is not the one that the socket is bound to.
fn must_rebind(bound: Option<u32>, present: Option<u32>) -> bool {
    present.is_some() && present != bound
}

fn index_of(name: &CString) -> Option<u32> {
    // SAFETY: a string that ends with a NUL.
    Some(unsafe { libc::if_nametoindex(name.as_ptr()) }).filter(|index| *index > 0)
}

/// Binds a CAN socket to another interface; the kernel allows that at any time. With the old one it has thrown the socket's filters
/// away (net/can/raw.c, NETDEV_UNREGISTER): without new ones it would send and never hear.
fn rebind(fd: RawFd, index: u32) -> bool {
    accept_all(fd) && bind(fd, index)
}

/// Every frame, whatever its identifier.
fn accept_all(fd: RawFd) -> bool {
    let all = libc::can_filter { can_id: 0, can_mask: 0 };
    let length = size_of::<libc::can_filter>() as libc::socklen_t;
    // SAFETY: one readable filter of the length told.
    unsafe { libc::setsockopt(fd, libc::SOL_CAN_RAW, libc::CAN_RAW_FILTER, (&raw const all).cast(), length) == 0 }
}

fn bind(fd: RawFd, index: u32) -> bool {
    // SAFETY: all-zero is a valid sockaddr_can.
    let mut address: libc::sockaddr_can = unsafe { std::mem::zeroed() };
    address.can_family = libc::AF_CAN as libc::sa_family_t;
    address.can_ifindex = index.cast_signed();
    let length = size_of::<libc::sockaddr_can>() as libc::socklen_t;
    // SAFETY: a readable address of the length told.
    unsafe { libc::bind(fd, (&raw const address).cast(), length) == 0 }
}

#[expect(clippy::disallowed_methods, reason = "an ordinary thread may sleep")]
fn keep(mut place: Place, shared: &Weak<Shared>) {
    let may_flap = may_change_links();
    let mut dead_since = None;
    let mut worked = Stamp::NEVER;
    while let Some(shared) = shared.upgrade() {
        let now = link::monotonic_now();
        if shared.health() == BusHealth::Active {
            dead_since = None;
        } else {
            let since = *dead_since.get_or_insert(now);
            if now.since(since) > PATIENCE && now.since(worked) > WORK_EVERY {
                worked = now;
                place.follow(&shared);
                revive(&place.interface, &shared, may_flap);
            }
        }
        drop(shared);
        std::thread::sleep(LOOK_EVERY);
    }
}

/// What helps against this kind of dead. A link that cannot be asked or changed is asked again later.
fn revive(interface: &CanInterface, shared: &Shared, may_flap: bool) {
    match shared.health() {
        // Another master is not the wire's fault, and the wire does not know of it.
        BusHealth::Active | BusHealth::Contested => {}
        BusHealth::Stalled if may_flap => flap(interface, shared),
        BusHealth::Stalled => {}
        BusHealth::Passive | BusHealth::Down => adopt_state(interface, shared),
        BusHealth::Off => {
            // Restarts by itself if restart-ms is set; vcan has no state and was never off.
            if may_flap && matches!(interface.state(), Ok(Some(CanState::BusOff))) && interface.restart().is_err() {
                flap(interface, shared);
            }
            adopt_state(interface, shared);
        }
    }
}

/// Link down and up: the only way to empty the kernel's queue.
fn flap(interface: &CanInterface, shared: &Shared) {
    if interface.bring_down().is_ok() && interface.bring_up().is_ok() {
        shared.echoes.forget();
        adopt_state(interface, shared);
    }
}

/// Takes over what the kernel says.
fn adopt_state(interface: &CanInterface, shared: &Shared) {
    let Ok(details) = interface.details() else { return };
    let health = match details.can.state {
        _ if !details.is_up => BusHealth::Down,
        None | Some(CanState::ErrorActive) => BusHealth::Active,
        Some(CanState::ErrorWarning | CanState::ErrorPassive) => BusHealth::Passive,
        Some(CanState::BusOff) => BusHealth::Off,
        Some(CanState::Stopped | CanState::Sleeping) => BusHealth::Down,
    };
    if health == BusHealth::Active && shared.health() != BusHealth::Passive {
        shared.echoes.forget();
    }
    shared.set_state(health);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_socket_follows_its_adapter_to_a_new_number_and_stays_where_it_is_otherwise() {
        assert!(!must_rebind(Some(4), Some(4)), "a bus that is only dead");
        assert!(!must_rebind(Some(4), None), "unplugged");
        assert!(must_rebind(Some(4), Some(7)), "plugged in again");
        assert!(must_rebind(None, Some(7)));
    }
}
