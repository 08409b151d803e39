//! CiA 402: the power state machine of a drive, seen from both ends. RT: yes.
//!
//! ```text
//!   start ─0→ NotReady ─1→ SwitchOnDisabled ─2 shutdown→ Ready ─3 switch on→ SwitchedOn ─4 enable→ Enabled
//!                              ↑   ↑   ↑  ←─7 disable voltage─┘ ←─6 shutdown──────┘ ←─5 switch on──┘  │
//!                              │   │   └────────────── 9, 10, 12 disable voltage ─────────────────────┤
//!                              │   └──────────── 12 ── QuickStop ←──────────── 11 quick stop ─────────┤
//!                              └─15 fault reset (edge)── Fault ←14─ FaultReaction ←13 any state ──────┘
//! ```
//! The master takes one step per answer of the drive and never skips one, although some drives would allow it.

use crate::msg::{DriveGoal, DriveState};

/// Power state of a drive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum State {
    /// Initialising.
    #[default]
    NotReady,
    /// No voltage, may be set up.
    SwitchOnDisabled,
    /// Voltage may come.
    Ready,
    /// Voltage is there, no torque.
    SwitchedOn,
    /// Follows commands.
    Enabled,
    /// Braking on command.
    QuickStop,
    /// Stopping because of a fault.
    FaultReaction,
    /// Stopped because of a fault.
    Fault,
}

/// Controlword: disable voltage.
pub const DISABLE_VOLTAGE: u16 = 0x0000;
/// Controlword: shutdown, towards ready.
pub const SHUTDOWN: u16 = 0x0006;
/// Controlword: switch on, or disable operation.
pub const SWITCH_ON: u16 = 0x0007;
/// Controlword: enable operation.
pub const ENABLE: u16 = 0x000F;
/// Controlword: quick stop.
pub const QUICK_STOP: u16 = 0x0002;
/// Controlword: fault reset, acts on its rising edge.
pub const FAULT_RESET: u16 = 0x0080;

impl State {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::NotReady,
        Self::SwitchOnDisabled,
        Self::Ready,
        Self::SwitchedOn,
        Self::Enabled,
        Self::QuickStop,
        Self::FaultReaction,
        Self::Fault,
    ];

    /// The state that a statusword tells; `None` if its bits are none of the profile's.
    #[must_use]
    pub const fn from_statusword(word: u16) -> Option<Self> {
        match (word & 0x4F, word & 0x6F) {
            (0x00, _) => Some(Self::NotReady),
            (0x40, _) => Some(Self::SwitchOnDisabled),
            (0x0F, _) => Some(Self::FaultReaction),
            (0x08, _) => Some(Self::Fault),
            (_, 0x21) => Some(Self::Ready),
            (_, 0x23) => Some(Self::SwitchedOn),
            (_, 0x27) => Some(Self::Enabled),
            (_, 0x07) => Some(Self::QuickStop),
            _ => None,
        }
    }

    /// The state bits of its statusword.
    #[must_use]
    pub const fn statusword(self) -> u16 {
        match self {
            Self::NotReady => 0x00,
            Self::SwitchOnDisabled => 0x40,
            Self::Ready => 0x21,
            Self::SwitchedOn => 0x23,
            Self::Enabled => 0x27,
            Self::QuickStop => 0x07,
            Self::FaultReaction => 0x0F,
            Self::Fault => 0x08,
        }
    }

    /// The drive's end: the state after a controlword, given the one before (a fault reset acts on its edge).
    #[must_use]
    pub const fn after(self, controlword: u16, before: u16) -> Self {
        let reset_edge = controlword & FAULT_RESET != 0 && before & FAULT_RESET == 0;
        let disable = controlword & 0x02 == 0;
        let quick_stop = controlword & 0x06 == 0x02;
        let shutdown = controlword & 0x07 == 0x06;
        let switch_on = controlword & 0x0F == 0x07;
        let enable = controlword & 0x0F == 0x0F;
        match self {
            Self::Fault if reset_edge => Self::SwitchOnDisabled,
            Self::NotReady | Self::FaultReaction | Self::Fault => self,
            _ if disable => Self::SwitchOnDisabled,
            Self::SwitchOnDisabled if shutdown => Self::Ready,
            Self::Ready | Self::SwitchedOn if quick_stop => Self::SwitchOnDisabled,
            Self::Ready if switch_on || enable => Self::SwitchedOn,
            Self::SwitchedOn | Self::Enabled if shutdown => Self::Ready,
            Self::SwitchedOn if enable => Self::Enabled,
            Self::Enabled if switch_on => Self::SwitchedOn,
            Self::Enabled if quick_stop => Self::QuickStop,
            _ => self,
        }
    }

    /// The master's end: the controlword that takes a drive in this state one step towards the goal.
    /// A fault is not reset here, because that needs an edge in time.
    #[must_use]
    pub const fn controlword_towards(self, goal: DriveGoal) -> u16 {
        match (goal, self) {
            (DriveGoal::Disabled, _) | (_, Self::NotReady | Self::QuickStop | Self::FaultReaction | Self::Fault) => {
                DISABLE_VOLTAGE
            }
            (DriveGoal::Ready, Self::SwitchedOn | Self::Enabled) | (DriveGoal::Enabled, Self::Ready) => SWITCH_ON,
            (_, Self::SwitchOnDisabled) | (DriveGoal::Ready, Self::Ready) => SHUTDOWN,
            (DriveGoal::Enabled, Self::SwitchedOn | Self::Enabled) => ENABLE,
        }
    }

    /// The same as a message.
    #[must_use]
    pub const fn as_message(self) -> DriveState {
        match self {
            Self::NotReady => DriveState::NotReady,
            Self::SwitchOnDisabled => DriveState::SwitchOnDisabled,
            Self::Ready => DriveState::Ready,
            Self::SwitchedOn => DriveState::SwitchedOn,
            Self::Enabled => DriveState::Enabled,
            Self::QuickStop => DriveState::QuickStop,
            Self::FaultReaction | Self::Fault => DriveState::Fault,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn statuswords_name_their_states() {
        for state in State::ALL {
            assert_eq!(State::from_statusword(state.statusword()), Some(state));
        }
        // As captured: enabled, voltage, remote, target reached, follows the command.
        assert_eq!(State::from_statusword(0x1637), Some(State::Enabled));
        assert_eq!(State::from_statusword(0x0250), Some(State::SwitchOnDisabled));
        assert_eq!(State::from_statusword(0x0218), Some(State::Fault));
    }

    #[test]
    fn master_takes_a_healthy_drive_to_each_goal_in_three_steps() {
        let healthy = [State::SwitchOnDisabled, State::Ready, State::SwitchedOn, State::Enabled, State::QuickStop];
        for start in healthy {
            for (goal, ends) in [
                (DriveGoal::Disabled, &[State::SwitchOnDisabled][..]),
                (DriveGoal::Ready, &[State::Ready, State::SwitchedOn]),
                (DriveGoal::Enabled, &[State::Enabled]),
            ] {
                let mut state = start;
                for _ in 0..4 {
                    state = state.after(state.controlword_towards(goal), 0);
                }
                assert!(ends.contains(&state), "{start:?} to {goal:?} ends in {state:?}");
            }
        }
    }

    #[test]
    fn no_controlword_enables_from_switch_on_disabled_at_once() {
        for word in 0..=0xFFFF {
            assert_ne!(State::SwitchOnDisabled.after(word, 0), State::Enabled);
            assert_ne!(State::Ready.after(word, 0), State::Enabled);
        }
    }

    #[test]
    fn a_fault_ends_only_at_the_rising_edge_of_the_reset_bit() {
        assert_eq!(State::Fault.after(FAULT_RESET, FAULT_RESET), State::Fault);
        assert_eq!(State::Fault.after(ENABLE, 0), State::Fault);
        assert_eq!(State::Fault.after(FAULT_RESET, 0), State::SwitchOnDisabled);
    }

    proptest! {
        #[test]
        fn every_controlword_without_the_voltage_bit_ends_torque(word: u16, before: u16) {
            for state in State::ALL {
                prop_assert_ne!(state.after(word & !2, before), State::Enabled);
            }
        }

        #[test]
        fn random_statuswords_never_panic(word: u16) {
            if let Some(state) = State::from_statusword(word) {
                prop_assert!(matches!(word & 0x6F, w if State::from_statusword(w) == Some(state)));
            }
        }
    }
}
