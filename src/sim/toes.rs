//! The simulated toes: screws that travel, one-sided preloaded springs that give way. Thesis 2.2.1.
//!
//! Quasi-static. While a foot stands, a spring is as short as the force along its leg makes it. A blow is over at once
//! for the legs (the impact map), but the spring shows it: it takes up the blow's energy against preload and stiffness
//! and gives the stroke back, both along a parabola, as under the mean of its force. The legs' length follows the
//! springs; the speed of that change does not enter the motion.
//! Both toes of a leg carry the same load; the longer one makes the leg's length. RT: no.

use crate::config::checked::Config;
use crate::model::compass_gait::toe::Toe;
use crate::msg::TOES;

/// Toes of a leg.
const PAIR: usize = TOES / 2;

/// The spring's answer to a blow.
#[derive(Clone, Copy, Debug, Default)]
struct Blow {
    since_s: f64,
    stroke_m: f64,
    lasts_s: f64,
}

impl Blow {
    /// Of an impulse along the leg that stopped a foot of this speed, on springs of together `preload_n`, `spring_n_m`.
    fn new(impulse_ns: f64, speed_m_s: f64, preload_n: f64, spring_n_m: f64) -> Self {
        let energy_j = 0.5 * impulse_ns.max(0.0) * speed_m_s.max(0.0);
        // preload x + spring x^2 / 2 = energy
        let root = libm::sqrt(preload_n * preload_n + 2.0 * spring_n_m * energy_j);
        let stroke_m = (root - preload_n) / spring_n_m;
        let mean_n = preload_n + 0.5 * spring_n_m * stroke_m;
        let lasts_s = if mean_n > 0.0 { 2.0 * impulse_ns.max(0.0) / mean_n } else { 0.0 };
        Self { since_s: 0.0, stroke_m, lasts_s }
    }

    fn compression_m(&self) -> f64 {
        if self.since_s >= self.lasts_s {
            return 0.0;
        }
        let part = self.since_s / self.lasts_s;
        4.0 * self.stroke_m * part * (1.0 - part)
    }
}

/// The four toes.
#[derive(Clone, Debug)]
pub(super) struct Toes {
    toe: Toe<f64>,
    /// The legs' length holds for toes that are out so far, m.
    nominal_m: f64,
    springs: bool,
    position_m: [f64; TOES],
    load_n: [f64; 2],
    blow: [Blow; 2],
}

impl Toes {
    /// As configured.
    pub(super) fn new(config: &Config) -> Self {
        let t = &config.robot.toe;
        Self {
            toe: Toe {
                stroke_m: t.stroke_m,
                rate_limit_m_s: t.rate_limit_m_s,
                spring_n_m: t.spring_n_m,
                preload_n: t.preload_n,
            },
            nominal_m: t.extended_m,
            springs: config.simulation.toe_springs,
            position_m: config.simulation.initial_toe_m,
            load_n: [0.0; 2],
            blow: [Blow::default(); 2],
        }
    }

    /// Screws travel, springs swing back.
    pub(super) fn advance(&mut self, target_m: [f64; TOES], dt_s: f64) {
        for (at, target) in self.position_m.iter_mut().zip(target_m) {
            *at = self.toe.advance(*at, target, dt_s);
        }
        for blow in &mut self.blow {
            blow.since_s += dt_s;
        }
    }

    /// Force of the ground along each leg, N.
    pub(super) const fn load(&mut self, force_n: [f64; 2]) {
        self.load_n = force_n;
    }

    /// The foot of this leg hit the ground.
    pub(super) fn strike(&mut self, leg: usize, impulse_ns: f64, speed_m_s: f64) {
        let pair = PAIR as f64;
        self.blow[leg] = Blow::new(impulse_ns, speed_m_s, pair * self.toe.preload_n, pair * self.toe.spring_n_m);
    }

    /// Lengths at the screws, m.
    pub(super) const fn position_m(&self) -> [f64; TOES] {
        self.position_m
    }

    fn compression_of_leg_m(&self, leg: usize) -> f64 {
        if !self.springs {
            return 0.0;
        }
        self.toe.compression_m(self.load_n[leg] / PAIR as f64).max(self.blow[leg].compression_m())
    }

    /// What the potentiometers show without error, m.
    pub(super) fn compression_m(&self) -> [f64; TOES] {
        std::array::from_fn(|toe| self.compression_of_leg_m(toe / PAIR))
    }

    /// What each leg is shorter than its length, m.
    pub(super) fn shortening_m(&self) -> [f64; 2] {
        std::array::from_fn(|leg| {
            let longest = self.position_m[PAIR * leg..][..PAIR].iter().copied().fold(0.0, f64::max);
            self.nominal_m - longest + self.compression_of_leg_m(leg)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::load;

    fn toes(keys: &[&str]) -> Toes {
        Toes::new(&load(None, &keys.iter().map(|k| (*k).to_owned()).collect::<Vec<_>>()).unwrap().config)
    }

    #[test]
    fn standing_still_does_not_move_the_springs_and_twice_the_preload_does() {
        let mut t = toes(&[]);
        t.load([149.0, 0.0]);
        assert!(t.compression_m().iter().all(|x| *x <= 0.0), "thesis 2.1.4");
        t.load([500.0, 0.0]);
        assert!((t.compression_m()[0] - 0.005).abs() < 1e-12 && t.compression_m()[2] <= 0.0);
        let mut rigid = toes(&["sim.toe_springs=false"]);
        rigid.load([500.0, 0.0]);
        assert!(rigid.compression_m().iter().all(|x| *x <= 0.0));
    }

    #[test]
    fn blow_stores_its_energy_in_the_springs_and_ends() {
        let mut t = toes(&[]);
        // Section 10 of the notes: 5.73 N s, 1.43 J, hence .5 m/s.
        t.strike(1, 5.73, 0.5);
        let mut most = 0.0_f64;
        for _ in 0..100 {
            t.advance([0.03; TOES], 1e-3);
            most = most.max(t.compression_m()[3]);
        }
        let stored_j = 300.0 * most + 20_000.0 * most * most;
        assert!((stored_j - 0.5 * 5.73 * 0.5).abs() < 0.01, "{most} m, {stored_j} J");
        assert!(t.compression_m()[3] <= 0.0, "over after a tenth of a second");
    }

    #[test]
    fn a_leg_is_as_short_as_its_longer_toe_leaves_it() {
        let mut t = toes(&["sim.initial_toe_m=[0.03, 0.03, 0.01, 0.02]"]);
        assert!((t.shortening_m()[1] - 0.01).abs() < 1e-12 && t.shortening_m()[0].abs() < 1e-12);
        t.load([340.0, 0.0]);
        assert!((t.shortening_m()[0] - 0.001).abs() < 1e-12);
    }
}
