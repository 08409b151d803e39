//! What the controller is doing. RT: yes.

use super::reflect::{message, wire_enum};
use crate::base::time::Stamp;
use iceoryx2::prelude::ZeroCopySend;

wire_enum! {
    /// A control law.
    pub enum LawName {
        /// Zero torque.
        Idle = 0,
        /// Spring and damper at the hip.
        Hold = 1,
        /// LQR on one leg.
        Balance = 2,
        /// Hand-made walking: foot placement by speed error.
        FootPlacement = 3,
        /// Virtual constraints (thesis 4.1).
        VirtualConstraint = 4,
        /// TVLQR along a plan (thesis 4.5).
        Tvlqr = 5,
        /// Transverse stabilisation of an orbit (thesis 4.7).
        Transverse = 6,
        /// Hybrid LQR-tree (thesis 4.6).
        Tree = 7,
    }
}

wire_enum! {
    /// What the robot is about.
    pub enum Motion {
        /// Nothing, or balance on one leg.
        Stand = 0,
        /// The first step out of balance.
        StepIn = 1,
        /// Walking.
        Walk = 2,
        /// The last steps.
        Stop = 3,
        /// At rest on both feet: the hip is held for some seconds, then no torque.
        Rest = 4,
        /// Back to the orbit after a disturbance.
        Recover = 5,
        /// Out of rest: the toes push the robot over its front foot, no torque.
        Lean = 6,
    }
}

impl Motion {
    /// Both feet are on the ground, and either may bear the weight.
    #[must_use]
    pub const fn is_on_both_feet(self) -> bool {
        matches!(self, Self::Rest | Self::Lean)
    }
}

message! {
    /// What the controller is doing in a tick.
    pub struct ControlState {
        /// The tick that it holds for.
        pub stamp: Stamp,
        /// The law that chose the torque.
        pub law: LawName,
        /// What the robot is about.
        pub motion: Motion,
        /// Progress through the present step or plan, 0 to 1.
        pub phase: f64,
        /// Steps since walking began.
        pub steps: u32,
        /// Speed that is asked for, m/s.
        pub speed_m_s: f64,
        /// Swing leg angle that is aimed at, rad.
        pub swing_goal_rad: f64,
    }
}
