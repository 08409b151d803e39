//! The frames that a cycle waits for: the answers of all drives that answer every SYNC. Drives without SYNC answered
//! the command of the cycle before. RT: yes.

use super::wake::Bell;
use crate::base::time::Stamp;
use crate::bus::canopen::{Message, Node};
use crate::config::checked::Robot;
use crate::msg::{BUSES, BusFrame, DRIVES};
use std::sync::atomic::{AtomicU32, Ordering};

/// A drive as seen from the wire, if it answers every SYNC.
type Answering = Option<(usize, Node)>;

/// Which answers are still out. Whoever brings the last one rings, so the control thread is woken once per cycle.
#[derive(Debug)]
pub struct Awaited {
    drives: [Answering; DRIVES],
    synced: [bool; BUSES],
    all: u32,
    open: AtomicU32,
    bell: Bell,
}

impl Awaited {
    /// The answers of this robot.
    #[must_use]
    pub fn new(robot: &Robot) -> Self {
        let drives = robot.drives.each_ref().map(|drive| {
            let node = Node::new(drive.node).filter(|_| drive.is_canopen() && drive.sync_divisor == 1)?;
            Some((drive.bus, node))
        });
        let all = drives.iter().enumerate().fold(0, |all, (i, d)| all | (u32::from(d.is_some()) << i));
        let synced = std::array::from_fn(|bus| robot.drives.iter().any(|d| d.bus == bus && d.is_canopen()));
        Self { drives, synced, all, open: AtomicU32::new(0), bell: Bell::default() }
    }

    /// Buses with drives that want SYNC.
    #[must_use]
    pub const fn synced(&self) -> [bool; BUSES] {
        self.synced
    }

    /// A cycle begins: all answers are out.
    pub fn begin(&self) {
        self.open.store(self.all, Ordering::Release);
    }

    /// A frame came in.
    pub fn arrived(&self, bus: usize, frame: &BusFrame) {
        if self.is_complete() {
            return;
        }
        let Ok(Message::Tpdo(1, node, _)) = Message::parse(&frame.frame) else { return };
        let Some(index) = self.drives.iter().position(|drive| *drive == Some((bus, node))) else { return };
        let bit = 1 << index;
        if self.open.fetch_and(!bit, Ordering::AcqRel) == bit {
            self.bell.ring();
        }
    }

    /// Nothing is out any more.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.open.load(Ordering::Acquire) == 0
    }

    /// Sleeps until nothing is out, or the clock shows `until`.
    pub fn wait(&self, until: Stamp) {
        loop {
            let seen = self.bell.count();
            if self.is_complete() || !self.bell.wait(seen, until) {
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;
    use crate::msg::CanFrame;

    fn answer(node: u16) -> BusFrame {
        BusFrame { frame: CanFrame::new(0x180 + node, &[0; 8]), ..BusFrame::default() }
    }

    #[test]
    fn only_the_right_node_on_the_right_bus_completes_a_cycle() {
        let awaited = Awaited::new(&config::load(None, &[]).unwrap().config.robot);
        assert!(awaited.is_complete(), "nothing is out before the first cycle");
        awaited.begin();
        for (bus, frame) in [(0, answer(2)), (1, answer(1)), (0, BusFrame::default())] {
            awaited.arrived(bus, &frame);
        }
        assert!(!awaited.is_complete());
        awaited.arrived(0, &answer(1));
        assert!(awaited.is_complete());
        awaited.wait(Stamp(i64::MAX));
    }
}
