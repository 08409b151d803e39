//! Looks after a bus that is dead, from a thread of its own. RT: no, and nothing real-time waits for it.

use super::Shared;
use super::link_report::may_change_links;
use crate::base::time::{Span, Stamp};
use crate::bus::link;
use crate::msg::BusHealth;
use socketcan::CanInterface;
use socketcan::nl::CanState;
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
    let shared = Arc::downgrade(shared);
    std::thread::Builder::new().name("can-keeper".into()).spawn(move || keep(&interface, &shared))?;
    Ok(())
}

#[expect(clippy::disallowed_methods, reason = "an ordinary thread may sleep")]
fn keep(interface: &CanInterface, shared: &Weak<Shared>) {
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
                revive(interface, &shared, may_flap);
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
        shared.forget_frames_out();
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
        shared.forget_frames_out();
    }
    shared.set_state(health);
}
