//! What kept a robot that was never armed from it. RT: yes.

use crate::msg::{Fault, FaultCode, Mode, Status};

/// Looks at the status of every tick, and tells at the end of a run.
#[derive(Clone, Copy, Debug, Default)]
pub struct HeldBack {
    armed: bool,
    by: Fault,
}

impl HeldBack {
    /// The status after a tick.
    pub fn look(&mut self, status: &Status) {
        self.armed |= status.mode == Mode::Armed;
        let by = status.arm_blocker;
        // What ends the program came last and held nobody back.
        if by.code != FaultCode::Stopping {
            // Enabled drives that failed are told by the latch alone.
            self.by = if by.code == FaultCode::None { status.first_fault } else { by };
        }
    }

    /// What stood in the way last, its code `None` if nobody pressed; nothing of a robot that was armed.
    #[must_use]
    pub fn by(&self) -> Option<Fault> {
        (!self.armed).then_some(self.by)
    }
}
