//! How a recording is excited: open loop, let go, or by a servo whose command is recorded. RT: no.

use std::f64::consts::TAU;

use super::dice::Dice;
use super::draw::{Scales, scales};
use super::gait::Gait;
use super::machine::State;
use super::rig::{Kind, Rig};

/// One joint's excitation.
#[derive(Debug, Clone)]
pub(super) enum Program {
    /// Let go from here, no torque.
    Free(f64),
    /// Sum of sines: amplitude, Hz, phase.
    Sines(Vec<[f64; 3]>),
    /// Levels, each held for so long.
    Steps(Vec<f64>, f64),
    /// Position servo: stiffness, damping, limit, and what it follows.
    Servo([f64; 3], Box<Program>),
    /// Steps over the ground.
    Walk(Gait),
}

impl Program {
    /// Where the joint starts.
    pub(super) fn start(&self) -> f64 {
        if let Self::Free(angle) = self { *angle } else { 0.0 }
    }

    /// Hip torque of a walking robot.
    pub(super) fn walk(&self, t: f64, state: &State) -> Option<f64> {
        if let Self::Walk(gait) = self { Some(gait.torque(t, state)) } else { None }
    }

    /// Torque (or, inside a servo, angle) at a time.
    pub(super) fn torque(&self, t: f64, angle: f64, rate: f64) -> f64 {
        match self {
            Self::Free(_) | Self::Walk(_) => 0.0,
            Self::Sines(sines) => sines.iter().map(|[a, hz, phase]| a * libm::sin(TAU * hz * t + phase)).sum(),
            Self::Steps(levels, hold_s) => held(levels, t / hold_s),
            Self::Servo([stiffness, damping, limit], target) => {
                let error = target.torque(t, angle, rate) - angle;
                (stiffness * error - damping * rate).clamp(-limit, *limit)
            }
        }
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "time is not negative")]
fn held(levels: &[f64], place: f64) -> f64 {
    levels[place.max(0.0) as usize % levels.len()]
}

fn sines(dice: &mut Dice, amplitude: f64, from_hz: f64, to_hz: f64) -> Program {
    let count = 5;
    let each = amplitude / libm::sqrt(f64::from(count));
    let line = |_| [each * dice.between(0.6, 1.4), dice.log_between(from_hz, to_hz), dice.between(0.0, TAU)];
    Program::Sines((0..count).map(line).collect())
}

fn steps(dice: &mut Dice, amplitude: f64) -> Program {
    let hold_s = dice.between(0.5, 1.1);
    Program::Steps((0..16).map(|_| dice.between(-amplitude, amplitude)).collect(), hold_s)
}

fn servo(dice: &mut Dice, s: &Scales, hz: f64) -> Program {
    let stiffness = s.inertia * dice.between(150.0, 400.0);
    let damping = 1.2 * libm::sqrt(stiffness * s.inertia);
    let target = match dice.chance(0.5) {
        true => sines(dice, s.angle, 0.15 * hz, 1.5 * hz),
        false => steps(dice, s.angle),
    };
    Program::Servo([stiffness, damping, 4.0 * s.torque], Box::new(target))
}

/// One program per joint. `gentle`: closed loop and a third of the amplitude.
pub(super) fn draw(dice: &mut Dice, rig: &Rig, gentle: bool) -> Vec<Program> {
    if rig.kind == Kind::Walker {
        return vec![Program::Walk(Gait::draw(dice))];
    }
    let mut s = scales(rig);
    if gentle {
        s.angle *= 0.35;
    }
    let closed = gentle || matches!(rig.kind, Kind::Rotor | Kind::Slider) || dice.chance(0.35);
    let one = |dice: &mut Dice| match (closed, dice.chance(0.4)) {
        (true, _) => servo(dice, &s, 1.0),
        (false, true) => steps(dice, 0.5 * s.torque),
        (false, false) => sines(dice, 0.7 * s.torque, 0.2, 4.0),
    };
    let mut programs: Vec<Program> = rig.joints.iter().map(|_| one(dice)).collect();
    if rig.kind == Kind::Pendulum && !gentle && dice.chance(0.25) {
        programs = vec![Program::Free(dice.sign() * dice.between(0.7, 1.5))];
    }
    programs
}
