//! The simulated toes: screws that travel as drives move them, one-sided preloaded springs that give way. Thesis 2.2.1.
//!
//! A screw's motor is limited in speed, acceleration and force: a screw that would have to push a pair of toes out with more
//! than `robot.toe.force_limit_n` gets no faster. Its motion enters that of the legs with rate and acceleration
//! ([`crate::model::machine::ToeMotion`]).
//! A blow is over at once for the legs (the impact map), but the spring shows it: it takes up the blow's energy against
//! preload and stiffness and gives the stroke back, both along a parabola, as under the mean of its force. Under a load
//! that lasts, a spring is as short as the force along its leg makes it; the weight alone is less than the preload.
//! Both toes of a leg carry the same load; the longer one makes the leg's length.
//! Limits: the potentiometers show the springs' strokes, the legs' lengths do not follow them (some 2 mm for 20 ms). RT: no.

use crate::config::checked::Config;
use crate::model::compass_gait::toe::Toe;
use crate::model::machine::ToeMotion;
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

/// A screw: place and speed, + out.
#[derive(Clone, Copy, Debug, Default)]
struct Screw {
    position_m: f64,
    rate_m_s: f64,
    acceleration_m_s2: f64,
}

/// The four toes.
#[derive(Clone, Debug)]
pub(super) struct Toes {
    toe: Toe<f64>,
    acceleration_limit_m_s2: f64,
    force_limit_n: f64,
    /// The legs' length holds for toes that are out so far, m.
    nominal_m: f64,
    springs: bool,
    screws: [Screw; TOES],
    load_n: [f64; 2],
    blow: [Blow; 2],
}

impl Toes {
    /// As configured.
    pub(super) fn new(config: &Config) -> Self {
        let (t, sim) = (&config.robot.toe, &config.simulation);
        Self {
            toe: Toe {
                stroke_m: t.stroke_m,
                rate_limit_m_s: t.rate_limit_m_s,
                spring_n_m: t.spring_n_m,
                preload_n: t.preload_n,
            },
            acceleration_limit_m_s2: t.acceleration_limit_m_s2,
            force_limit_n: t.force_limit_n,
            nominal_m: t.extended_m,
            springs: sim.toe_springs,
            screws: sim.initial_toe_m.map(|position_m| Screw { position_m, ..Screw::default() }),
            load_n: [0.0; 2],
            blow: [Blow::default(); 2],
        }
    }

    /// Screws set out for the next `dt_s`: the motion of each leg's toes over that time. Call [`Self::advance`] after it.
    pub(super) fn set_out(&mut self, target_m: [f64; TOES], dt_s: f64) -> [ToeMotion<f64>; 2] {
        for (k, target) in target_m.into_iter().enumerate() {
            let wanted = self.toe.acceleration_towards(
                (self.screws[k].position_m, self.screws[k].rate_m_s),
                target,
                self.acceleration_limit_m_s2,
                dt_s,
            );
            let stalls = self.load_n[k / PAIR] >= self.force_limit_n && self.screws[k].rate_m_s >= 0.0;
            self.screws[k].acceleration_m_s2 = if stalls { wanted.min(0.0) } else { wanted };
        }
        self.motion()
    }

    /// Screws travel, springs swing back.
    pub(super) fn advance(&mut self, dt_s: f64) {
        for screw in &mut self.screws {
            screw.position_m += dt_s * (screw.rate_m_s + 0.5 * dt_s * screw.acceleration_m_s2);
            screw.rate_m_s += dt_s * screw.acceleration_m_s2;
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
    pub(super) fn position_m(&self) -> [f64; TOES] {
        self.screws.map(|screw| screw.position_m)
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

    /// The screw that makes the leg's length.
    fn longest(&self, leg: usize) -> Screw {
        let [a, b] = [self.screws[PAIR * leg], self.screws[PAIR * leg + 1]];
        if b.position_m > a.position_m { b } else { a }
    }

    /// What each leg is shorter than its length, and how that changes.
    pub(super) fn motion(&self) -> [ToeMotion<f64>; 2] {
        std::array::from_fn(|leg| {
            let screw = self.longest(leg);
            ToeMotion {
                short_m: self.nominal_m - screw.position_m,
                rate_m_s: -screw.rate_m_s,
                acceleration_m_s2: -screw.acceleration_m_s2,
            }
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
            t.advance(1e-3);
            most = most.max(t.compression_m()[3]);
        }
        let stored_j = 300.0 * most + 20_000.0 * most * most;
        assert!((stored_j - 0.5 * 5.73 * 0.5).abs() < 0.01, "{most} m, {stored_j} J");
        assert!(t.compression_m()[3] <= 0.0, "over after a tenth of a second");
    }

    #[test]
    fn a_leg_is_as_short_as_its_longer_toe_leaves_it() {
        let t = toes(&["sim.initial_toe_m=[0.03, 0.03, 0.01, 0.02]"]);
        assert!((t.motion()[1].short_m - 0.01).abs() < 1e-12 && t.motion()[0].short_m.abs() < 1e-12);
    }

    #[test]
    fn screws_travel_within_speed_and_acceleration_and_arrive_without_overshoot() {
        let mut t = toes(&["sim.initial_toe_m=[0.0, 0.0, 0.01, 0.01]"]);
        let (mut rates, mut most) = (vec![0.0], 0.0_f64);
        for _ in 0..500 {
            t.set_out([0.04; TOES], 1e-3);
            t.advance(1e-3);
            rates.push(t.screws[0].rate_m_s);
            most = most.max(t.position_m()[0]);
        }
        assert!((t.position_m()[0] - 0.04).abs() < 1e-6 && most < 0.04 + 1e-4, "{most}");
        assert!(rates.windows(2).all(|w| (w[1] - w[0]).abs() <= 5.0 * 1e-3 + 1e-12));
        let fastest = rates.iter().copied().fold(0.0, f64::max);
        assert!((fastest - 0.25).abs() < 1e-9, "{fastest}");
        // .25 m/s at 5 m/s²: 50 ms and 6.25 mm at each end, the rest at full speed: .21 s.
        // The position loop's last millimetres take some 1/60 s each e-fold.
        let slow = rates.iter().rposition(|r| r.abs() > 0.05).unwrap();
        assert!((180..=230).contains(&slow), "{slow}");
    }

    #[test]
    fn a_screw_beyond_its_force_gets_no_faster() {
        let mut t = toes(&[]);
        t.load([400.0, 0.0]);
        for _ in 0..50 {
            t.set_out([0.04; TOES], 1e-3);
            t.advance(1e-3);
        }
        assert!((t.position_m()[0] - 0.03).abs() < 1e-12 && t.position_m()[2] > 0.015, "{:?}", t.position_m());
    }
}
