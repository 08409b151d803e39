//! When the robot is pushed. RT: no.

use super::noise::Noise;
use crate::base::time::{Span, Stamp};
use crate::config::checked::{Push, RandomPushes, Simulation};

/// Makes the times of pushes another stream than the IMU's noise.
const STREAM: u64 = 0x7075_7368;

/// The pushes to come, in order of time.
#[derive(Clone, Debug)]
pub struct Pushes {
    /// When the robot was switched on.
    start: Stamp,
    listed: std::vec::IntoIter<Push>,
    random: Option<(RandomPushes, Noise)>,
    next_listed: Option<Push>,
    next_random: Option<Push>,
    given: u32,
    last: Option<(Stamp, f64)>,
}

impl Pushes {
    /// Those of a configuration.
    #[must_use]
    pub fn new(simulation: &Simulation) -> Self {
        let mut listed = simulation.pushes.clone().into_iter();
        let mut random = simulation.random_pushes.map(|r| (r, Noise::new(simulation.seed ^ STREAM)));
        let next_listed = listed.next();
        let next_random = random.as_mut().map(|(r, noise)| drawn(r, noise, r.from_s));
        Self { start: Stamp::default(), listed, random, next_listed, next_random, given: 0, last: None }
    }

    /// Their times count from here.
    pub fn start_at(&mut self, start: Stamp) {
        self.start = start;
    }

    /// When the next one is due.
    #[must_use]
    pub fn next_time(&self) -> Option<Stamp> {
        self.earliest().map(|push| self.at(&push))
    }

    /// Takes the next one; says its impulse, N s.
    pub fn take(&mut self) -> Option<f64> {
        let push = self.earliest()?;
        if self.next_listed == Some(push) {
            self.next_listed = self.listed.next();
        } else if let Some((random, noise)) = &mut self.random {
            self.next_random = Some(drawn(random, noise, push.time_s));
        }
        self.given += 1;
        self.last = Some((self.at(&push), push.impulse_ns));
        Some(push.impulse_ns)
    }

    /// How many there were.
    #[must_use]
    pub const fn given(&self) -> u32 {
        self.given
    }

    /// The last one: when, and its impulse in N s.
    #[must_use]
    pub const fn last(&self) -> Option<(Stamp, f64)> {
        self.last
    }

    fn at(&self, push: &Push) -> Stamp {
        self.start + Span::from_s(push.time_s)
    }

    fn earliest(&self) -> Option<Push> {
        match (self.next_listed, self.next_random) {
            (Some(a), Some(b)) => Some(if b.time_s < a.time_s { b } else { a }),
            (a, b) => a.or(b),
        }
    }
}

/// The next one after `from_s`: waiting times of a Poisson process are exponential.
fn drawn(random: &RandomPushes, noise: &mut Noise, from_s: f64) -> Push {
    let wait_s = -random.interval_s * libm::log(noise.uniform());
    Push { time_s: from_s + wait_s, impulse_ns: random.impulse_ns }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::load;

    fn pushes(keys: &[&str]) -> Pushes {
        let keys: Vec<String> = keys.iter().map(|k| (*k).to_owned()).collect();
        Pushes::new(&load(None, &keys).unwrap().config.simulation)
    }

    #[test]
    fn listed_pushes_come_in_order_of_time_and_end() {
        let mut p = pushes(&["sim.pushes=[{time_s=3.0, impulse_ns=1.0}, {time_s=1.0, impulse_ns=-2.0}]"]);
        assert_eq!(p.next_time(), Some(Stamp(1_000_000_000)));
        assert_eq!([p.take(), p.take(), p.take()], [Some(-2.0), Some(1.0), None]);
        assert_eq!((p.given(), p.last()), (2, Some((Stamp(3_000_000_000), 1.0))));
    }

    /// The robot of `compass plant` lives by the computer's clock: all its pushes came at once when it was switched on.
    #[test]
    fn times_count_from_switching_on() {
        let mut p = pushes(&["sim.pushes=[{time_s=3.0, impulse_ns=1.0}]"]);
        p.start_at(Stamp(50_000_000_000));
        assert_eq!(p.next_time(), Some(Stamp(53_000_000_000)));
    }

    #[test]
    fn random_pushes_have_their_mean_interval_and_repeat_with_the_seed() {
        let keys = ["sim.random_pushes.from_s=5", "sim.random_pushes.interval_s=2", "sim.random_pushes.impulse_ns=1.5"];
        let times = |seed: &str| {
            let mut p = pushes(&[&keys[..], &[seed]].concat());
            let mut one = || p.next_time().filter(|_| p.take().is_some()).unwrap().as_s();
            (0..4000).map(|_| one()).collect::<Vec<f64>>()
        };
        let one = times("sim.seed=1");
        // 4000 waits of mean 2 s and deviation 2 s: four standard errors.
        assert!(((one[3999] - 5.0) / 4000.0 - 2.0).abs() < 4.0 * 2.0 / 4000f64.sqrt());
        assert!(one[0] > 5.0 && one.windows(2).all(|w| w[1] > w[0]));
        assert_eq!(one, times("sim.seed=1"));
        assert!((one[0] - times("sim.seed=2")[0]).abs() > 1e-9);
    }

    #[test]
    fn listed_and_random_pushes_are_merged() {
        let mut p = pushes(&[
            "sim.pushes=[{time_s=6.0, impulse_ns=9.0}]",
            "sim.random_pushes.from_s=0",
            "sim.random_pushes.interval_s=1",
            "sim.random_pushes.impulse_ns=1",
        ]);
        let mut seen = Vec::new();
        while let Some(at) = p.next_time().filter(|at| at.as_s() < 12.0) {
            seen.push((at, p.take().unwrap()));
        }
        assert!(
            seen.windows(2).all(|w| w[0].0 <= w[1].0) && seen.contains(&(Stamp(6_000_000_000), 9.0)) && seen.len() > 4
        );
    }

    /// Rates of the legs after a push of 1 N s on a robot that nobody holds, and its angles.
    fn pushed(keys: &[&str]) -> [[f64; 2]; 2] {
        let mut keys: Vec<String> = keys.iter().map(|k| (*k).to_owned()).collect();
        keys.push("sim.release_torque_nm=0.0".to_owned());
        let mut world = crate::sim::world::build(&load(None, &keys).unwrap().config).unwrap();
        world.push(1.0);
        // On the ground the reading is taken by the next step: one of a microsecond.
        world.step(0.0, world.reading().toe_position_m, Span(1000));
        let seen = world.reading();
        [seen.leg_rate_rad_s, seen.leg_angle_rad]
    }

    #[test]
    fn a_push_at_the_hip_is_an_angular_impulse_about_the_toe_and_none_about_the_hip() {
        // Without friction and elasticity H Δv = [-l cos θs p, 0]; on blocks and on the ground alike.
        let config = load(None, &[]).unwrap().config;
        let p = config.robot.model.params();
        for world in ["sim.on_blocks=true", "sim.on_blocks=false"] {
            for hip in ["sim.initial_angle_rad=[0.0349, 0.0]", "sim.initial_angle_rad=[0.02, -0.1]"] {
                let [rate, angle] = pushed(&[
                    world,
                    hip,
                    "sim.friction_scale=[0.0, 0.0]",
                    "sim.hip_elasticity.rotor_inertia_kg_m2=1e-4",
                ]);
                let mass = crate::model::compass_gait::dynamics::mass_matrix(&p.normalised(), angle);
                let unit = p.inertia_kg_m2();
                let momentum = mass.map(|row| unit * (row[0] * rate[0] + row[1] * rate[1]));
                let expected = -p.leg_length_m * libm::cos(angle[0]);
                // Gravity acts for a microsecond, the rotor has a hundred-thousandth of the inertia: 1e-3.
                assert!(
                    (momentum[0] - expected).abs() < 1e-3 && momentum[1].abs() < 1e-3,
                    "{world} {hip}: {momentum:?}"
                );
            }
        }
    }
}
