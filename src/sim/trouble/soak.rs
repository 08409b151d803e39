//! Many seeded runs with random faults: the invariants must hold in every tick of all of them. RT: no.

use super::invariants::{Breach, Invariants};
use crate::base::time::{Span, Stamp};
use crate::config::checked::Config;
use crate::config::fault::{CATALOGUE, Injection, Place};
use crate::msg::{DRIVES, Drive, Mode};
use crate::sim::lockstep::{Lockstep, LockstepError};
use crate::sim::noise::Noise;
use crate::sim::plant::Waited;

/// Makes the draws another stream than the robot's noise.
const STREAM: u64 = 0x736F_616B;
/// Most faults of a run.
const MOST_FAULTS: f64 = 4.0;
/// Shortest and longest fault, s.
const SHORTEST_S: f64 = 0.002;
const LONGEST_S: f64 = 1.5;

/// What came of a run.
#[derive(Clone, Debug)]
pub struct Soaked {
    /// What was injected.
    pub faults: Vec<Injection>,
    /// The first invariant that did not hold, and when.
    pub breach: Option<(Stamp, Breach)>,
    /// Ticks run, and those with torque.
    pub ticks: u64,
    /// Ticks armed.
    pub armed_ticks: u64,
    /// Times that it was armed.
    pub armings: u32,
    /// Faults latched.
    pub latched: u32,
    /// How long commands had waited that each drive took from the wire while it was enabled.
    pub waited: [Waited; DRIVES],
}

/// Faults drawn by a seed, for a robot and so long a run.
#[must_use]
pub fn draw(config: &Config, seed: u64, length: Span) -> Vec<Injection> {
    let mut noise = Noise::new(seed ^ STREAM);
    let count = pick(&mut noise, MOST_FAULTS) + 1;
    let mut faults = Vec::new();
    while faults.len() < count {
        let entry = &CATALOGUE[pick(&mut noise, CATALOGUE.len() as f64)];
        let at = Span::from_s(noise.uniform() * length.as_s());
        let Ok(mut fault) = Injection::parse(&format!("{}@{}", entry.name, at.as_s())) else { continue };
        if let [_, ..] = entry.kinds {
            fault.kind = entry.kinds[pick(&mut noise, entry.kinds.len() as f64)];
        }
        fault.bus = pick(&mut noise, 2.0);
        fault.drive = Drive::ALL[pick(&mut noise, Drive::ALL.len() as f64)];
        fault.share = libm::pow(10.0, -3.0 * noise.uniform());
        let lasts_s = SHORTEST_S * libm::pow(LONGEST_S / SHORTEST_S, noise.uniform());
        fault.lasts = fault.lasts.map(|_| Span::from_s(lasts_s));
        if entry.is_for(Place::Sim) && fault.check(&config.robot).is_ok() {
            faults.push(fault);
        }
    }
    faults
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small index")]
fn pick(noise: &mut Noise, count: f64) -> usize {
    ((1.0 - noise.uniform()) * count) as usize
}

/// One run: random faults, and an operator who presses again whenever he can.
///
/// # Errors
/// [`LockstepError`] when the robot cannot be built.
pub fn run(config: &Config, seed: u64, length: Span) -> Result<Soaked, LockstepError> {
    let mut config = config.clone();
    config.simulation.seed = seed;
    config.simulation.faults = draw(&config, seed, length);
    // Every other robot is held, so that it can be armed again after a fault: one that has fallen cannot.
    if seed.is_multiple_of(2) {
        config.simulation.release_torque_nm = 1e6;
        config.simulation.release_after = Span::ZERO;
    }
    let mut lockstep = Lockstep::with_rearming_hand(&config)?;
    let mut invariants = Invariants::new(&config);
    let mut soaked = Soaked {
        faults: config.simulation.faults.clone(),
        breach: None,
        ticks: 0,
        armed_ticks: 0,
        armings: 0,
        latched: 0,
        waited: [Waited::default(); DRIVES],
    };
    let mut mode = Mode::Starting;
    while lockstep.now() < Stamp::default() + length && soaked.breach.is_none() {
        let now = lockstep.now();
        let record = lockstep.step();
        let looked = invariants.look(record);
        let status = record.status;
        soaked.waited = lockstep.plant().waited();
        let looked = looked.and_then(|()| invariants.look_at_ages(&soaked.waited));
        let looked = looked.and_then(|()| invariants.look_at_torque(now, lockstep.plant().hip_torque_nm()));
        soaked.breach = looked.err().map(|breach| (now, breach));
        soaked.ticks += 1;
        soaked.armed_ticks += u64::from(status.mode == Mode::Armed);
        soaked.armings += u32::from(status.mode == Mode::Armed && mode != Mode::Armed);
        soaked.latched = status.faults;
        mode = status.mode;
    }
    Ok(soaked)
}

/// The outer leg's toes are MIT motors, which no example has: small and fast, at their spindles.
#[cfg(test)]
pub(super) const MIT_TOES: &str = r#"
[set.robot.drives.outer_toe_a]
protocol = "mit"
dialect = "mini_cheetah"
node = 4
reply_id = 84
position_range_rad = 95.5
velocity_range_rad_s = 200.0
torque_range_nm = 1.0
stiffness_range_nm_rad = 5.0
damping_range_nm_s_rad = 1.0
stiffness_nm_rad = 0.2
damping_nm_s_rad = 0.001
counts_per_turn = 2000.0
heartbeat_ms = 20.0
[set.robot.drives.outer_toe_b]
protocol = "mit"
dialect = "mini_cheetah"
node = 5
reply_id = 85
position_range_rad = 95.5
velocity_range_rad_s = 200.0
torque_range_nm = 1.0
stiffness_range_nm_rad = 5.0
damping_range_nm_s_rad = 1.0
stiffness_nm_rad = 0.2
damping_nm_s_rad = 0.001
counts_per_turn = 2000.0
heartbeat_ms = 20.0
"#;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;
    use crate::config::fault::Device;
    use crate::sim::trouble::table::robot_for;

    /// Runs of 4 s of this robot with seeds from 1 on: how often something was latched, and how often it was armed.
    fn soak(name: &str, text: &str, runs: u64) -> [u32; 2] {
        let config = config::load_text(name, text, &[]).unwrap().config;
        let (mut latched, mut armings) = (0, 0);
        for seed in 1..=runs {
            let soaked = run(&config, seed, Span::from_ms(4000)).unwrap();
            assert_eq!(soaked.breach, None, "{name}, seed {seed}: {:?}", soaked.faults);
            latched += soaked.latched;
            armings += soaked.armings;
        }
        println!("{name}: {latched} faults latched, {armings} times armed");
        [latched, armings]
    }

    /// Full size is `compass sim --soak 5000`; the result stands in `docs/faults.md`.
    #[test]
    fn a_hundred_runs_with_random_faults_keep_the_invariants() {
        let [latched, armings] = soak("default", "", 100);
        // So that the runs are worth something: with the same faults another controller falls more or less often.
        assert!(latched > 50 && armings > 50, "{latched} faults, {armings} armings");
    }

    #[test]
    fn robots_with_other_devices_keep_the_invariants() {
        let mixed = ("mixed.toml", include_str!("../../../config/examples/mixed.toml"));
        let asked = ("myactuator.toml", include_str!("../../../config/examples/myactuator.toml"));
        let devices = [Device::Mit, Device::Odrive, Device::Moteus, Device::Lidar].map(robot_for);
        for (name, text) in devices.into_iter().chain([mixed, asked, ("MIT toes", MIT_TOES)]) {
            let [latched, armings] = soak(name, text, 20);
            assert!(latched > 10 && armings > 10, "{name}: {latched} faults, {armings} armings");
        }
    }

    #[test]
    fn the_same_seed_draws_the_same_faults() {
        let config = config::load(None, &[]).unwrap().config;
        let drawn = |seed| draw(&config, seed, Span::from_ms(4000));
        assert_eq!(drawn(7), drawn(7));
        assert_ne!(drawn(7), drawn(8));
    }
}
