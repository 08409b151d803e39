//! How the walking robot is driven: the swing leg mirrors the stance leg and runs a little ahead of it.
//!
//! `θw = -θs + b (a² - θs²)/a²` with a servo at the hip: the feet meet the ground where θs = -a, whatever the speed, so
//! the walk is its own limit cycle (own derivation; that it goes on is tested). RT: no.

use std::f64::consts::TAU;

use super::chain::Pair;
use super::dice::Dice;
use super::machine::State;

/// Limit of the hip, Nm.
const LIMIT_NM: f64 = 30.0;
/// About the swing leg's inertia about the hip, kg m².
const INERTIA: f64 = 2.3;

/// One way of walking.
#[derive(Debug, Clone)]
pub(super) struct Gait {
    /// Half the angle between the legs at touchdown.
    half: f64,
    /// How far the swing leg runs ahead in mid-step.
    ahead: f64,
    /// Stance rate at the start, rad/s.
    rate: f64,
    /// Servo's natural frequency, rad/s.
    stiff: f64,
    /// A sway of the target that excites more than walking does: amplitude, Hz, phase.
    sway: [f64; 3],
}

impl Gait {
    /// Draws one.
    pub(super) fn draw(dice: &mut Dice) -> Self {
        let half = dice.between(0.13, 0.19);
        Self {
            half,
            ahead: half * dice.between(0.3, 0.6),
            rate: -dice.between(0.65, 0.85),
            stiff: dice.between(9.0, 14.0),
            sway: [dice.between(0.0, 0.02), dice.between(1.5, 4.0), dice.between(0.0, TAU)],
        }
    }

    /// Just after a touchdown, inner leg standing: angles and rates.
    pub(super) fn start(&self) -> (Pair, Pair) {
        ([self.half, -self.half], [self.rate, -0.5 * self.rate])
    }

    /// Hip torque, + on the inner leg.
    pub(super) fn torque(&self, t: f64, state: &State) -> f64 {
        let (s, w) = (state.feet.stance, 1 - state.feet.stance);
        let (q, v) = (state.q(), state.v());
        let [amplitude, hz, phase] = self.sway;
        let share = q[s] / self.half;
        let wanted = -q[s] + self.ahead * (1.0 - share * share) + amplitude * libm::sin(TAU * hz * t + phase);
        let wanted_rate = -v[s] * (1.0 + 2.0 * self.ahead * share / self.half);
        let stiffness = INERTIA * self.stiff * self.stiff;
        let damping = 1.4 * INERTIA * self.stiff;
        let onto_swing = (stiffness * (wanted - q[w]) + damping * (wanted_rate - v[w])).clamp(-LIMIT_NM, LIMIT_NM);
        if s == 0 { -onto_swing } else { onto_swing }
    }
}
