//! The operator's hand on the dead-man switch.
//!
//! A hand says how it is whenever it is asked, with the time at which it was last heard of. The reader judges the age:
//! silence is neither "held" nor "released". [`socket`] hears a person's on this computer, `device` looks at a key of an
//! input device, [`remote`] hears one behind a network; [`SimulatedHand`] is a program that does what a person would. RT: [`Hand::poll`] never waits and does not allocate.

pub mod aside;
pub mod device;
pub mod evdev;
pub mod remote;
pub mod socket;

use crate::base::time::{Span, Stamp};
use crate::config::checked::{Config, Operator, Walk};
use crate::msg::{FaultCode, Mode, OperatorSample, Status};
use aside::AsideHand;
use socket::{Refusals, SocketHand};
use std::io;
use std::path::Path;
use std::sync::Arc;

/// A simulated person who sees that the robot did not arm lets go and tries again after this.
const TRY_AGAIN: Span = Span::from_ms(1_000);
/// So long the switch is open then.
const LET_GO: Span = Span::from_ms(200);
/// After homing it waits so long before it presses: the drives leave operation.
const SETTLE: Span = Span::from_ms(20);
/// It confirms the hip's zero again after this, if it was not taken.
const CONFIRM_AGAIN: Span = Span::from_ms(50);
/// So long it holds without seeing the toes home, or anything of an arming robot.
const WAIT_FOR_HOMING: Span = Span::from_ms(50);

/// A dead-man switch.
#[derive(Debug)]
pub enum Hand {
    /// Nobody: a program presses by a plan.
    Simulated(SimulatedHand),
    /// Somebody at the other end of a socket.
    Socket(SocketHand),
    /// A key of an input device.
    Device(AsideHand),
    /// Somebody behind a network, and what was refused there.
    Remote(AsideHand, Arc<remote::Refused>),
}

impl Hand {
    /// The hand of this configuration.
    ///
    /// # Errors
    /// When the socket cannot be made, the device is not there, or the secret cannot be read.
    pub fn open(config: &Config) -> io::Result<Self> {
        Ok(match &config.robot.operator {
            Operator::Simulated => Self::Simulated(SimulatedHand::new(config)),
            Operator::Socket(path) => {
                Self::Socket(SocketHand::bind(Path::new(path), config.robot.limits.operator_age, highest_m_s(config))?)
            }
            Operator::Device(at) => Self::Device(device::open(at, config.robot.operator_speed)?),
            Operator::Remote(at) => {
                let (hand, refused) = remote::open(at, config.robot.limits.operator_age, highest_m_s(config))?;
                Self::Remote(hand, refused)
            }
        })
    }

    /// What was refused, for those who tell the person.
    #[must_use]
    pub fn refused(&self) -> Refused {
        match self {
            Self::Simulated(_) | Self::Device(_) => Refused::Nothing,
            Self::Socket(hand) => Refused::Senders(hand.refusals()),
            Self::Remote(_, refused) => Refused::Datagrams(Arc::clone(refused)),
        }
    }

    /// How the hand is at `now`; `seen` is what the operator sees of the robot.
    pub fn poll(&mut self, now: Stamp, seen: &Status) -> OperatorSample {
        match self {
            Self::Simulated(hand) => hand.poll(now, seen),
            Self::Socket(hand) => hand.poll(now),
            Self::Device(hand) | Self::Remote(hand, _) => hand.poll(now, seen),
        }
    }
}

/// What the person's stick asks for when it is pushed all the way, m/s; none if the robot wants no stick.
fn highest_m_s(config: &Config) -> Option<f64> {
    config.robot.operator_speed.map(|speed| speed.highest_m_s)
}

/// What a hand's source refuses, counted while it runs.
#[derive(Clone, Debug)]
pub enum Refused {
    /// It refuses nothing.
    Nothing,
    /// Other processes at the socket.
    Senders(Arc<Refusals>),
    /// Datagrams of a network.
    Datagrams(Arc<remote::Refused>),
}

/// A person who does what the robot needs: confirms the hip's zero (the legs stand as `sim.initial_angle_rad` says), holds
/// the switch while the toes look for theirs, then presses at the planned time, as soon as nothing stands in the way, and
/// holds until the release if there is one. Tries again when the robot did not arm; after a fault it lets the robot lie.
/// A stick, if the robot wants one, it pushes as `control.walk` says.
#[derive(Clone, Debug)]
pub struct SimulatedHand {
    press: Span,
    release: Option<Span>,
    zero_angle_rad: f64,
    start: Option<Stamp>,
    next_press: Stamp,
    pressed: bool,
    /// Since when it holds for the toes.
    homing: Option<Stamp>,
    homed: bool,
    next_homing: Stamp,
    next_confirmation: Stamp,
    zeroings: u32,
    sequence: u32,
    /// After a fault it lets go and presses again.
    rearms: bool,
    since_fault: Option<Stamp>,
    /// How it pushes the stick, and the speed at the stick's end, m/s.
    stick: Option<(Walk, f64)>,
    since_armed: Option<Stamp>,
}

impl SimulatedHand {
    /// Times count from the first poll.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let sim = &config.simulation;
        let [inner, outer] = sim.initial_angle_rad;
        Self {
            press: Span::from_s(sim.operator_press_s),
            release: sim.operator_release_s.map(Span::from_s),
            zero_angle_rad: inner - outer,
            start: None,
            next_press: Stamp::NEVER,
            pressed: false,
            homing: None,
            homed: false,
            next_homing: Stamp::NEVER,
            next_confirmation: Stamp::NEVER,
            zeroings: 0,
            sequence: 0,
            rearms: false,
            since_fault: None,
            stick: highest_m_s(config).map(|highest_m_s| (config.control.walk.clone(), highest_m_s)),
            since_armed: None,
        }
    }

    /// The same hand, which after a fault lets go, presses again, and so on until the robot is armed.
    #[must_use]
    pub fn rearming(self) -> Self {
        Self { rearms: true, ..self }
    }

    /// How it is at `now`.
    pub fn poll(&mut self, now: Stamp, seen: &Status) -> OperatorSample {
        let start = *self.start.get_or_insert(now);
        if self.next_press == Stamp::NEVER {
            self.next_press = start + self.press;
        }
        let presses_anew = self.after_fault(now, seen);
        let holds_for_toes = self.look_after_zeros(now, seen);
        self.sequence = self.sequence.wrapping_add(1);
        let gone = self.release.is_some_and(|release| now.since(start) >= release);
        OperatorSample {
            stamp: now,
            dead_man: presses_anew.unwrap_or_else(|| holds_for_toes || (self.presses(now, seen) && !gone)),
            sequence: self.sequence,
            zeroings: self.zeroings,
            zero_angle_rad: self.zero_angle_rad,
            speed_m_s: self.pushes_stick(now, seen),
        }
    }

    /// Speed that it asks for while the robot is armed, m/s.
    fn pushes_stick(&mut self, now: Stamp, seen: &Status) -> f64 {
        let Some((schedule, highest_m_s)) = &self.stick else { return 0.0 };
        if seen.mode != Mode::Armed {
            self.since_armed = None;
            return 0.0;
        }
        let since = *self.since_armed.get_or_insert(now);
        schedule.speed_at_m_s(now.since(since).as_s()).min(*highest_m_s)
    }

    /// After a fault: open for a moment, then pressed for a while, and again. `None` while there is none to come back from.
    fn after_fault(&mut self, now: Stamp, seen: &Status) -> Option<bool> {
        if !self.rearms || !matches!(seen.mode, Mode::Faulted | Mode::Arming) {
            if self.since_fault.take().is_some() {
                // Armed, it goes on holding; homed, it begins anew.
                (self.pressed, self.next_press) = (seen.mode == Mode::Armed, now + LET_GO);
            }
            return None;
        }
        if seen.mode == Mode::Arming {
            return self.since_fault.map(|_| true);
        }
        let since = *self.since_fault.get_or_insert(now);
        // The hip's zero is confirmed while the switch is open.
        let missing = seen.arm_blockers & (1 << FaultCode::ZeroUnknown as u8) != 0;
        if missing && now >= self.next_confirmation {
            self.zeroings = self.zeroings.wrapping_add(1);
            self.next_confirmation = now + CONFIRM_AGAIN;
        }
        Some(now.since(since).0.rem_euclid(2 * LET_GO.0) >= LET_GO.0)
    }

    /// Confirms the hip's zero while one is missing; true while it holds the switch for the toes.
    fn look_after_zeros(&mut self, now: Stamp, seen: &Status) -> bool {
        let missing = seen.mode == Mode::Disarmed && seen.arm_blockers & (1 << FaultCode::ZeroUnknown as u8) != 0;
        if missing && now >= self.next_confirmation {
            self.zeroings = self.zeroings.wrapping_add(1);
            self.next_confirmation = now + CONFIRM_AGAIN;
        }
        if let Some(since) = self.homing {
            self.homed |= seen.mode == Mode::Homing;
            let over = if self.homed { seen.mode != Mode::Homing } else { now.since(since) >= WAIT_FOR_HOMING };
            if over {
                (self.homing, self.next_homing) = (None, now + LET_GO);
                self.next_press = self.next_press.max(now + SETTLE);
            }
        } else if missing && !self.pressed && now >= self.next_homing {
            (self.homing, self.homed) = (Some(now), false);
        }
        self.homing.is_some()
    }

    /// True while it holds the switch to arm.
    fn presses(&mut self, now: Stamp, seen: &Status) -> bool {
        let waiting = matches!(seen.mode, Mode::Starting | Mode::Disarmed);
        if self.pressed && waiting && now.since(self.next_press) >= TRY_AGAIN {
            (self.next_press, self.pressed) = (now + LET_GO, false);
        }
        if !self.pressed && self.homing.is_none() && now >= self.next_press && seen.arm_blockers == 0 {
            (self.next_press, self.pressed) = (now, true);
        }
        self.pressed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;

    fn at(ms: i64) -> Stamp {
        Stamp(5_000_000_000) + Span::from_ms(ms)
    }

    fn hand(keys: &[&str]) -> SimulatedHand {
        let keys: Vec<String> = keys.iter().map(ToString::to_string).collect();
        SimulatedHand::new(&config::load(None, &keys).unwrap().config)
    }

    fn seen(mode: Mode) -> Status {
        Status { mode, ..Status::default() }
    }

    #[test]
    fn the_simulated_hand_presses_holds_and_releases() {
        let mut hand = hand(&["sim.operator_release_s=2.0"]);
        let held: Vec<i64> = (0..3_000).filter(|ms| hand.poll(at(*ms), &seen(Mode::Armed)).dead_man).collect();
        assert_eq!((held.first(), held.last()), (Some(&500), Some(&1_999)));
    }

    #[test]
    fn the_simulated_hand_tries_again_when_the_robot_does_not_arm() {
        let mut hand = hand(&[]);
        let held: Vec<bool> = (0..3_000).map(|ms| hand.poll(at(ms), &seen(Mode::Disarmed)).dead_man).collect();
        let presses = held.windows(2).filter(|pair| pair[1] && !pair[0]).count();
        assert_eq!(presses, 3, "at 500, 1700 and 2900 ms");
    }

    #[test]
    fn the_simulated_hand_pushes_the_stick_as_the_schedule_says_while_the_robot_is_armed() {
        let keys = ["control.walk.start_s=1.0", "control.walk.speed_m_s=0.6", "control.walk.stop_s=3.0"];
        let stick = "robot.operator.speed={ highest_m_s = 0.5, rate_m_s2 = 0.2 }";
        let mut pushing = hand(&[&keys[..], &[stick]].concat());
        assert!((0..2_000).all(|ms| pushing.poll(at(ms), &seen(Mode::Arming)).speed_m_s <= 0.0));
        let asked: Vec<f64> = (0..4_000).map(|ms| pushing.poll(at(2_000 + ms), &seen(Mode::Armed)).speed_m_s).collect();
        let pushed: Vec<usize> = (0..4_000).filter(|ms| asked[*ms] > 0.0).collect();
        assert_eq!((pushed.first(), pushed.last()), (Some(&1_000), Some(&2_999)));
        assert!((asked[1_500] - 0.5).abs() < 1e-12, "no stick asks for more than its end: {}", asked[1_500]);
        let mut without = hand(&keys);
        assert!((0..4_000).all(|ms| without.poll(at(ms), &seen(Mode::Armed)).speed_m_s <= 0.0));
    }

    #[test]
    fn after_a_fault_the_simulated_hand_does_not_press_again() {
        let mut hand = hand(&["sim.operator_press_s=0.0"]);
        assert!((0..3_000).all(|ms| hand.poll(at(ms), &seen(Mode::Faulted)).dead_man));
    }

    #[test]
    fn the_simulated_hand_holds_while_the_toes_look_for_their_zero_and_confirms_the_hips() {
        let mut hand = hand(&["sim.operator_press_s=0.3"]);
        let missing = Status { arm_blockers: 1 << FaultCode::ZeroUnknown as u8, ..seen(Mode::Disarmed) };
        let first = hand.poll(at(0), &missing);
        assert!(first.dead_man && first.zeroings == 1 && (first.zero_angle_rad - 0.0349).abs() < 1e-12);
        assert!((1..300).all(|ms| hand.poll(at(ms), &seen(Mode::Homing)).dead_man));
        assert!((300..320).all(|ms| !hand.poll(at(ms), &seen(Mode::Disarmed)).dead_man), "lets go when they are home");
        assert!(hand.poll(at(320), &seen(Mode::Disarmed)).dead_man, "and presses anew to arm");
    }
}
