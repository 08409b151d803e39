//! The hand that carries the legs into a walk: it holds them still at first, then moves them back and forward again, so that
//! they come to their initial angles with their initial rates at the time when it lets go.
//!
//! A robot that is let go out of rest with rates shows them to gyro and encoder when it is armed already, and the observer
//! learns them too late to walk on. Limits: the floor is not met on the way. RT: no.

use crate::config::checked::Simulation;

/// The hand's motion takes so long, s.
const TAKES_S: f64 = 0.6;

/// The motion of the hand, and where it is in it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Carry {
    angle_rad: [f64; 2],
    rate_rad_s: [f64; 2],
    until_s: f64,
    now_s: f64,
}

/// Both legs in the hand: angles, rates and accelerations, inner and outer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Carried {
    pub(super) angle_rad: [f64; 2],
    pub(super) rate_rad_s: [f64; 2],
    pub(super) acceleration_rad_s2: [f64; 2],
}

impl Carry {
    /// As configured; none if the hand holds still.
    pub(super) fn new(sim: &Simulation) -> Option<Self> {
        let until_s = sim.carried_until_s?;
        Some(Self { angle_rad: sim.initial_angle_rad, rate_rad_s: sim.initial_rate_rad_s, until_s, now_s: 0.0 })
    }

    /// Time goes on; false once the hand has let go.
    pub(super) fn advance(&mut self, dt_s: f64) -> bool {
        self.now_s += dt_s;
        self.now_s < self.until_s
    }

    /// Where the legs are.
    pub(super) fn now(&self) -> Carried {
        // f(0) = f'(0) = f(1) = f''(1) = 0, f'(1) = 1: it starts at rest and ends at a steady rate.
        let s = ((self.now_s - self.until_s) / TAKES_S + 1.0).clamp(0.0, 1.0);
        let moved_s = TAKES_S * s * s * (-3.0 + s * (5.0 - 2.0 * s));
        let share = s * (-6.0 + s * (15.0 - 8.0 * s));
        let share_1_s = if s > 0.0 { (-6.0 + s * (30.0 - 24.0 * s)) / TAKES_S } else { 0.0 };
        Carried {
            angle_rad: std::array::from_fn(|k| self.angle_rad[k] + moved_s * self.rate_rad_s[k]),
            rate_rad_s: self.rate_rad_s.map(|rate| share * rate),
            acceleration_rad_s2: self.rate_rad_s.map(|rate| share_1_s * rate),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::load;

    #[test]
    fn the_hand_moves_the_legs_smoothly_from_rest_to_the_initial_state_and_rates_are_those_of_the_angles() {
        let keys = [
            "sim.on_blocks=false",
            "sim.initial_angle_rad=[0.15, -0.14]",
            "sim.initial_rate_rad_s=[-0.6, -0.9]",
            "sim.initial_toe_m=[0.03, 0.03, 0.0, 0.0]",
            "sim.carried_until_s=2.0",
        ];
        let sim = load(None, &keys.map(str::to_owned)).unwrap().config.simulation;
        let mut carry = Carry::new(&sim).unwrap();
        let dt_s = 1e-4;
        let mut before = carry.now();
        assert_eq!((before.angle_rad, before.rate_rad_s), ([0.15, -0.14], [0.0; 2]));
        while carry.advance(dt_s) {
            let now = carry.now();
            for leg in 0..2 {
                let mean = 0.5 * (now.rate_rad_s[leg] + before.rate_rad_s[leg]);
                assert!((now.angle_rad[leg] - before.angle_rad[leg] - dt_s * mean).abs() < 1e-6);
                let mean = 0.5 * (now.acceleration_rad_s2[leg] + before.acceleration_rad_s2[leg]);
                // The acceleration jumps as the motion begins.
                let begins = before.acceleration_rad_s2[leg].abs() < 1e-12;
                assert!(begins || (now.rate_rad_s[leg] - before.rate_rad_s[leg] - dt_s * mean).abs() < 1e-6);
            }
            before = now;
        }
        let end = carry.now();
        let bits = |x: [f64; 2]| x.map(f64::to_bits);
        assert_eq!(bits(end.angle_rad), bits(sim.initial_angle_rad));
        assert_eq!(bits(end.rate_rad_s), bits(sim.initial_rate_rad_s));
        assert!(end.acceleration_rad_s2.iter().all(|a| a.abs() < 1e-9));
    }
}
