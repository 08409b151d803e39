//! Room 5: joint torque and toe lengths → five drive commands.
//!
//! The hip motor's sign is fixed to the legs (+ on inner); the change of sign with the stance leg happens in `control`,
//! which alone knows the stance-first convention. Here are only gear, sign, rated torque, rounding and saturation.
//! Any input gives a command within limits: what is not finite becomes zero torque, or a toe that holds.
//! RT: yes, no allocation; `new` precomputes the factors.
#![cfg_attr(
    not(test),
    deny(
        clippy::disallowed_methods,
        clippy::disallowed_types,
        clippy::disallowed_macros,
        clippy::expect_used,
        clippy::indexing_slicing
    )
)]

use crate::config::checked::{Robot, Toe};
use crate::msg::{
    DRIVES, Drive, DriveCommand, DriveCommands, DriveFeedbacks, DriveGoal, DriveState, JointCommand, TOES,
};

/// Splits joint commands over the drives.
#[derive(Clone, Debug)]
pub struct Dispatch {
    /// Motor torque in 1/1000 of rated per Nm at the joint, with the motor's sign.
    permille_per_nm: f64,
    max_permille: f64,
    toe: Toe,
}

/// Index of the first toe among the drives.
const FIRST_TOE: usize = Drive::InnerToeA as usize;

impl Dispatch {
    /// Factors of this robot.
    #[must_use]
    pub fn new(robot: &Robot) -> Self {
        let [hip, ..] = &robot.drives;
        let joint_nm_at_rated = hip.rated_torque_nm * robot.hip.gear_ratio * robot.hip.gear_efficiency;
        Self {
            permille_per_nm: robot.hip.motor_sign * 1000.0 / joint_nm_at_rated,
            max_permille: f64::from(hip.max_torque_permille.min(i16::MAX.unsigned_abs())),
            toe: robot.toe,
        }
    }

    /// The commands of all drives. Unless the goal is enabled, and until a toe is, torque is zero and toes hold.
    #[must_use]
    pub fn split(&self, joints: &JointCommand, goal: DriveGoal, feedbacks: &DriveFeedbacks) -> DriveCommands {
        let mut drives = [DriveCommand { goal, hold: true, ..DriveCommand::default() }; DRIVES];
        if goal == DriveGoal::Enabled {
            let (hip, toes) = drives.split_at_mut(FIRST_TOE);
            for drive in hip {
                drive.torque_permille = self.torque_permille(joints.hip_torque_nm);
                drive.hold = false;
            }
            let feedbacks = feedbacks.drives.iter().skip(FIRST_TOE);
            for ((drive, feedback), length_m) in toes.iter_mut().zip(feedbacks).zip(joints.toe_position_m) {
                if feedback.state == DriveState::Enabled && length_m.is_finite() {
                    drive.position_counts = self.toe_counts(length_m);
                    drive.hold = false;
                }
            }
        }
        DriveCommands { stamp: joints.stamp, drives }
    }

    /// Hip torque at the joint as the drive takes it.
    #[expect(clippy::cast_possible_truncation, reason = "clamped to i16")]
    fn torque_permille(&self, joint_nm: f64) -> i16 {
        let permille = joint_nm * self.permille_per_nm;
        if permille.is_nan() {
            return 0;
        }
        libm::round(permille.clamp(-self.max_permille, self.max_permille)) as i16
    }

    /// Toe length as the drive takes it.
    #[expect(clippy::cast_possible_truncation, reason = "saturates; a checked stroke has few counts")]
    fn toe_counts(&self, length_m: f64) -> i32 {
        libm::round(length_m.clamp(0.0, self.toe.stroke_m) * self.toe.counts_per_m) as i32
    }
}

const _: () = assert!(FIRST_TOE + TOES == DRIVES);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::time::Stamp;
    use crate::config;
    use proptest::prelude::*;

    fn robot() -> Robot {
        config::load(None, &[]).unwrap().config.robot
    }

    fn enabled() -> DriveFeedbacks {
        let mut feedbacks = DriveFeedbacks::default();
        feedbacks.drives.iter_mut().for_each(|d| d.state = DriveState::Enabled);
        feedbacks
    }

    fn joints(hip_torque_nm: f64, toe_position_m: [f64; TOES]) -> JointCommand {
        JointCommand { stamp: Stamp(7), hip_torque_nm, toe_position_m }
    }

    #[test]
    #[expect(clippy::float_cmp, reason = "whole numbers")]
    fn torque_and_lengths_come_out_in_drive_units() {
        let robot = robot();
        let joint_nm_at_rated = robot.drives[0].rated_torque_nm * robot.hip.gear_ratio * robot.hip.gear_efficiency;
        let half = joint_nm_at_rated / 2.0;
        let toes = [0.01, 0.02, 0.03, 0.0];
        let out = Dispatch::new(&robot).split(&joints(half, toes), DriveGoal::Enabled, &enabled());
        assert_eq!(f64::from(out.drives[0].torque_permille), 500.0 * robot.hip.motor_sign);
        for (drive, length_m) in out.drives[1..].iter().zip(toes) {
            assert_eq!(f64::from(drive.position_counts), (length_m * robot.toe.counts_per_m).round());
            assert!(!drive.hold);
        }
        assert_eq!(out.stamp, Stamp(7));
    }

    #[test]
    fn opposite_torque_gives_opposite_command_whatever_the_motor_sign() {
        for sign in [1.0, -1.0] {
            let mut robot = robot();
            robot.hip.motor_sign = sign;
            let dispatch = Dispatch::new(&robot);
            let at =
                |nm| dispatch.split(&joints(nm, [0.0; 4]), DriveGoal::Enabled, &enabled()).drives[0].torque_permille;
            assert_eq!(at(7.3), -at(-7.3));
            assert!(f64::from(at(7.3)) * sign > 0.0);
        }
    }

    #[test]
    fn unless_enabled_torque_is_zero_and_toes_hold() {
        let dispatch = Dispatch::new(&robot());
        for goal in [DriveGoal::Disabled, DriveGoal::Ready] {
            let out = dispatch.split(&joints(20.0, [0.02; 4]), goal, &enabled());
            assert!(out.drives.iter().all(|d| d.torque_permille == 0 && d.hold && d.goal == goal));
        }
        let mut feedbacks = enabled();
        feedbacks.drives[2].state = DriveState::SwitchedOn;
        let out = dispatch.split(&joints(20.0, [0.02; 4]), DriveGoal::Enabled, &feedbacks);
        assert!(out.drives[2].hold && !out.drives[1].hold, "a toe that is not enabled holds");
    }

    #[test]
    fn what_is_not_a_number_becomes_zero_torque_and_a_held_toe() {
        let command = joints(f64::NAN, [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.01]);
        let out = Dispatch::new(&robot()).split(&command, DriveGoal::Enabled, &enabled());
        assert_eq!(out.drives[0].torque_permille, 0);
        assert!(out.drives[1..4].iter().all(|d| d.hold));
        assert!(!out.drives[4].hold);
    }

    proptest! {
        #[test]
        fn limits_hold_for_any_input(hip in any::<f64>(), toes in any::<[f64; 4]>()) {
            let robot = robot();
            let out = Dispatch::new(&robot).split(&joints(hip, toes), DriveGoal::Enabled, &enabled());
            prop_assert!(out.drives[0].torque_permille.unsigned_abs() <= robot.drives[0].max_torque_permille);
            for drive in &out.drives[1..] {
                let length_m = f64::from(drive.position_counts) / robot.toe.counts_per_m;
                prop_assert!((0.0..=robot.toe.stroke_m + 1e-9).contains(&length_m));
            }
        }
    }
}
