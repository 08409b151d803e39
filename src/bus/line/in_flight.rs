//! The commands to one drive that are not known to have left the wire, oldest first. RT: yes.
//!
//! Mostly none or one. A command that takes goal or torque away may follow it; when the frames of a tick were not sent, what
//! was sent before them counts again.

use crate::base::time::Stamp;
use crate::msg::{CanFrame, DriveGoal};

/// So many are told apart: one, a lowered one, a torque of zero, and the goal's steps down.
const MOST: usize = 6;

/// A command that went out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sent {
    /// When.
    pub(super) at: Stamp,
    /// Its bytes, by which its echo is known.
    pub(super) frame: CanFrame,
    /// Torque that it asks for, 1/1000 of rated; 0 = none, or a place.
    pub(super) torque_permille: i16,
    /// The goal of the command before it.
    pub(super) goal_before: DriveGoal,
}

/// What is in flight.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct InFlight {
    sent: [Option<Sent>; MOST],
    /// The echo of a command was heard, and not yet its answer.
    echoed: bool,
}

impl InFlight {
    fn iter(&self) -> impl Iterator<Item = &Sent> {
        self.sent.iter().flatten()
    }

    /// When the oldest went out.
    pub(super) fn oldest(&self) -> Option<Stamp> {
        self.iter().next().map(|sent| sent.at)
    }

    /// A command goes out. One too many is not noted: what is noted is older.
    pub(super) fn push(&mut self, sent: Sent) {
        if let Some(free) = self.sent.iter_mut().find(|slot| slot.is_none()) {
            *free = Some(sent);
        }
    }

    /// True if a command of this torque asks for less than what is in flight, so that it may follow. Zero always may, anything
    /// smaller in the same direction once.
    pub(super) fn is_lowered_by(&self, torque_permille: i16) -> bool {
        let Some(newest) = self.iter().last().map(|sent| i32::from(sent.torque_permille)) else { return false };
        let torque = i32::from(torque_permille);
        let smaller = torque * newest >= 0 && torque.abs() < newest.abs();
        smaller && (torque == 0 || self.iter().count() == 1)
    }

    /// An echo: a queue keeps its order, so what went before it has left too. When the command went out.
    pub(super) fn hear_echo(&mut self, frame: &CanFrame) -> Option<Stamp> {
        self.echoed = true;
        let found = self.iter().position(|sent| sent.frame == *frame).unwrap_or(0);
        let at = self.iter().nth(found).map(|sent| sent.at);
        (0..=found).for_each(|_| self.pop());
        at
    }

    /// An answer, which only a command that is older than so can have caused. Without an echo (some adapters give none) it proves
    /// that one left.
    pub(super) fn hear_answer(&mut self, sent_by: Stamp) {
        if !std::mem::take(&mut self.echoed) && self.oldest().is_some_and(|at| at <= sent_by) {
            self.pop();
        }
    }

    /// What went out until then has left.
    pub(super) fn prove_departure(&mut self, until: Stamp) {
        while self.oldest().is_some_and(|at| at <= until) {
            self.pop();
        }
    }

    /// What went out at this time did not. The goal before it, if there was such a command.
    pub(super) fn take_back(&mut self, at: Stamp) -> Option<DriveGoal> {
        let unsent = self.sent.iter_mut().rev().find(|slot| slot.is_some_and(|sent| sent.at == at))?;
        unsent.take().map(|sent| sent.goal_before)
    }

    /// Nothing is known of any.
    pub(super) fn clear(&mut self) {
        *self = Self::default();
    }

    fn pop(&mut self) {
        self.sent.rotate_left(1);
        if let Some(last) = self.sent.last_mut() {
            *last = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn in_flight(torques: &[i16]) -> InFlight {
        let mut all = InFlight::default();
        for (at, torque_permille) in (1..).zip(torques) {
            let frame = CanFrame::new(0x201, &torque_permille.to_le_bytes());
            let goal_before = DriveGoal::Enabled;
            all.push(Sent { at: Stamp(at), frame, torque_permille: *torque_permille, goal_before });
        }
        all
    }

    #[test]
    fn a_smaller_torque_in_the_same_direction_follows_once_and_zero_always() {
        for (torques, next, follows) in [
            (&[100][..], 99, true),
            (&[-100], -99, true),
            (&[100], 100, false),
            (&[100], 101, false),
            (&[100], -1, false),
            (&[i16::MIN], i16::MIN + 1, true),
            (&[100, 99], 98, false),
            (&[100, 99], 0, true),
            (&[100, 99, 0], 0, false),
            (&[0], 0, false),
            (&[], 0, false),
        ] {
            assert_eq!(in_flight(torques).is_lowered_by(next), follows, "{torques:?} {next}");
        }
    }

    #[test]
    fn an_echo_proves_what_went_before_it_and_an_answer_only_what_had_no_echo() {
        let echo_of = |torque: i16| CanFrame::new(0x201, &torque.to_le_bytes());
        let mut all = in_flight(&[100, 50, 0]);
        assert_eq!((all.hear_echo(&echo_of(100)), all.oldest()), (Some(Stamp(1)), Some(Stamp(2))));
        all.hear_answer(Stamp(9));
        assert_eq!(all.oldest(), Some(Stamp(2)), "the answer to the one whose echo was heard");
        all.hear_answer(Stamp(1));
        assert_eq!(all.oldest(), Some(Stamp(2)), "too early for an answer to it");
        all.hear_answer(Stamp(2));
        assert_eq!(all.oldest(), Some(Stamp(3)));
        let mut all = in_flight(&[100, 50, 0]);
        all.hear_echo(&echo_of(50));
        assert_eq!(all.oldest(), Some(Stamp(3)), "the echo of the first was lost");
    }

    #[test]
    fn what_was_not_sent_does_not_count_and_the_goal_is_what_it_was() {
        let mut all = in_flight(&[100, 0]);
        assert!(!all.is_lowered_by(0));
        assert_eq!(all.take_back(Stamp(2)), Some(DriveGoal::Enabled));
        assert!(all.is_lowered_by(0), "100 is what is on its way");
        assert_eq!((all.take_back(Stamp(2)), all.oldest()), (None, Some(Stamp(1))));
    }
}
