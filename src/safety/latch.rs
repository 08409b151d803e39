//! The first fault is kept; the newest is told. RT: yes.

use crate::msg::Fault;

/// First and newest fault.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Latch {
    first: Option<Fault>,
    last: Fault,
    count: u32,
}

impl Latch {
    /// Keeps the fault if it is the first since [`Latch::clear`].
    pub(super) fn set(&mut self, fault: Fault) {
        self.first.get_or_insert(fault);
        self.last = fault;
        self.count = self.count.saturating_add(1);
    }

    /// Tells of an active limit without latching it.
    pub(super) fn tell(&mut self, limit: Fault) {
        self.last = limit;
    }

    /// Forgets the first fault: somebody pressed again.
    pub(super) fn clear(&mut self) {
        self.first = None;
    }

    /// The first fault, or none.
    pub(super) fn first(&self) -> Fault {
        self.first.unwrap_or_default()
    }

    /// The newest fault or active limit.
    pub(super) const fn last(&self) -> Fault {
        self.last
    }

    /// Faults since start.
    pub(super) const fn count(&self) -> u32 {
        self.count
    }
}
