//! What must hold in every tick, whatever happens to wires, devices, operator and host. RT: no.
//!
//! 1. No torque unless armed: neither let through, nor commanded, nor in a frame to the hip's drive, and no goal `Enabled`
//!    but while armed, arming, or (toes only) homing.
//! 2. Torque is finite and within its limit; toe lengths are finite and within their stroke.
//! 3. What goes out was decided in this tick: no hip command is older than one period, no toe command older than one
//!    round.
//! 4. A fault stays latched, the same one, until the switch was seen open and is pressed again.

use crate::bus::canopen::{Message, Node};
use crate::config::checked::{Config, DriveProtocol};
use crate::msg::{BUSES, Drive, DriveGoal, Fault, Mode, TOES, TickRecord};

/// An invariant that does not hold.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Breach {
    /// See 1.
    #[error("torque without being armed, in mode {0:?}: {1}")]
    TorqueUnarmed(Mode, &'static str),
    /// See 2.
    #[error("out of its limits: {0} = {1}")]
    OutOfLimits(&'static str, f64),
    /// See 3.
    #[error("an old command: {0}")]
    Old(&'static str),
    /// See 4.
    #[error("the latched fault {0:?} was left for {1:?} without a fresh press")]
    Unlatched(Fault, Mode),
}

/// Looks at each tick.
#[derive(Clone, Debug)]
pub struct Invariants {
    torque_limit_nm: f64,
    stroke_m: f64,
    max_permille: i32,
    hip_node: Option<Node>,
    hip_bus: usize,
    mode: Mode,
    first_fault: Fault,
    held: bool,
}

impl Invariants {
    /// For this robot, from before its first tick.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let hip = &config.robot.drives[Drive::Hip as usize];
        let canopen = matches!(hip.protocol, DriveProtocol::Cia402(_));
        Self {
            torque_limit_nm: config.robot.limits.hip_torque_nm,
            stroke_m: config.robot.toe.stroke_m,
            max_permille: i32::from(hip.max_torque_permille),
            hip_node: Node::new(hip.node).filter(|_| canopen),
            hip_bus: hip.bus.min(BUSES - 1),
            mode: Mode::Starting,
            first_fault: Fault::default(),
            held: false,
        }
    }

    /// Looks at the next tick.
    ///
    /// # Errors
    /// The first invariant that does not hold.
    pub fn look(&mut self, record: &TickRecord) -> Result<(), Breach> {
        let (mode, first_fault) = (record.status.mode, record.status.first_fault);
        let held = record.input.operator.dead_man;
        let result = unarmed(record)
            .and_then(|()| self.limits(record))
            .and_then(|()| self.wire(record))
            .and_then(|()| self.latch(mode, &first_fault, held));
        (self.mode, self.first_fault, self.held) = (mode, first_fault, held);
        result
    }

    fn limits(&self, record: &TickRecord) -> Result<(), Breach> {
        let torque_nm = record.allowed.hip_torque_nm;
        if !torque_nm.is_finite() || torque_nm.abs() > self.torque_limit_nm {
            return Err(Breach::OutOfLimits("hip torque, Nm", torque_nm));
        }
        let permille = record.drives.drives[Drive::Hip as usize].torque_permille;
        if i32::from(permille).abs() > self.max_permille {
            return Err(Breach::OutOfLimits("hip torque, 1/1000 of rated", f64::from(permille)));
        }
        let toes: [f64; TOES] = record.allowed.toe_position_m;
        match toes.into_iter().find(|length| !(0.0..=self.stroke_m).contains(length)) {
            Some(length) => Err(Breach::OutOfLimits("toe length, m", length)),
            None => Ok(()),
        }
    }

    /// What is in the frames is what was decided now.
    fn wire(&self, record: &TickRecord) -> Result<(), Breach> {
        if record.allowed.stamp != record.input.now || record.drives.stamp != record.input.now {
            return Err(Breach::Old("decided in another tick"));
        }
        let decided = record.drives.drives[Drive::Hip as usize].torque_permille;
        for frame in &record.output.send[self.hip_bus] {
            let Ok(Message::Rpdo(1, node, pdo)) = Message::parse(&frame.frame) else { continue };
            if Some(node) != self.hip_node {
                continue;
            }
            let sent = i16::from_le_bytes([pdo.data[2], pdo.data[3]]);
            if sent != 0 && record.status.mode != Mode::Armed {
                return Err(Breach::TorqueUnarmed(record.status.mode, "in a frame"));
            }
            if sent != 0 && sent != decided {
                return Err(Breach::Old("torque in a frame is not the one decided"));
            }
        }
        Ok(())
    }

    fn latch(&self, mode: Mode, first_fault: &Fault, held: bool) -> Result<(), Breach> {
        let pressed = held && !self.held;
        let same = same_fault(first_fault, &self.first_fault);
        let left = self.mode == Mode::Faulted && (mode != Mode::Faulted || !same);
        if left && !(pressed && matches!(mode, Mode::Arming | Mode::Homing)) {
            return Err(Breach::Unlatched(self.first_fault, mode));
        }
        Ok(())
    }
}

fn unarmed(record: &TickRecord) -> Result<(), Breach> {
    let mode = record.status.mode;
    if mode == Mode::Armed {
        return Ok(());
    }
    let breach = |what| Err(Breach::TorqueUnarmed(mode, what));
    if record.allowed.hip_torque_nm != 0.0 {
        return breach("let through");
    }
    let [hip, toes @ ..] = &record.drives.drives;
    if hip.torque_permille != 0 {
        return breach("commanded");
    }
    let hip_may = mode == Mode::Arming;
    if hip.goal == DriveGoal::Enabled && !hip_may {
        return breach("the hip is enabled");
    }
    let toes_may = matches!(mode, Mode::Arming | Mode::Homing);
    if toes.iter().any(|toe| toe.goal == DriveGoal::Enabled) && !toes_may {
        return breach("a toe is enabled");
    }
    Ok(())
}

/// The same by its bits: a value may be no number.
fn same_fault(a: &Fault, b: &Fault) -> bool {
    (a.code, a.index, a.stamp, a.value.to_bits()) == (b.code, b.index, b.stamp, b.value.to_bits())
}
