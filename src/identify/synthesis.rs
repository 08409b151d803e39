//! Recordings made from a rig: the machine under given inputs, with the sensors' noise and resolution. RT: no.

#[cfg(test)]
use super::experiment::Experiment;
use super::experiment::Recording;
use crate::model::machine::{Machine, MachineError};
#[cfg(test)]
use crate::model::rig::Use;
use crate::model::rig::{Rig, Sensor};
use crate::model::setting::{Number, Setting};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// What a simulated rig recorded.
#[derive(Clone, Debug, PartialEq)]
pub struct Synthetic {
    /// One list per sensor.
    pub measured: Vec<Vec<f64>>,
    /// Standing leg of each row, 0 inner, 1 outer; only 0 without legs.
    pub stance: Vec<u8>,
}

/// Runs `rig` as it is set up in `recording` under that recording's inputs, from `initial` (see
/// [`Machine::initial_layout`]; numbers left out are zero). `seed`: add each sensor's noise; without it only its
/// resolution shows.
///
/// # Errors
/// The rig cannot be built, or its state diverges.
pub fn record(rig: &Rig, recording: &Recording, initial: &[f64], seed: Option<u64>) -> Result<Synthetic, MachineError> {
    let setting = Setting::of(rig, Some(recording.index), recording.setup);
    let mut machine = Machine::<f64>::new(&setting, &|n: &Number| n.value, 1)?;
    let mut dice = seed.map(ChaCha8Rng::seed_from_u64);
    let mut out = Synthetic { measured: vec![Vec::new(); rig.sensors.len()], stance: Vec::new() };
    machine.set_stance(recording.stance.first().map_or(0, |leg| usize::from(*leg)));
    machine.reset(recording.times.first().copied().unwrap_or(0.0), initial);
    for (i, input) in recording.inputs.iter().enumerate() {
        machine.settle_drive(i, input.first().copied().unwrap_or(0.0));
    }
    for (row, t) in recording.times.iter().enumerate() {
        machine.advance_to(*t)?;
        for (channel, sensor) in rig.sensors.iter().enumerate() {
            out.measured[channel].push(sampled(sensor, machine.read(channel), dice.as_mut()));
        }
        out.stance.push(u8::from(machine.stance() == 1));
        for (i, input) in recording.inputs.iter().enumerate() {
            machine.command(i, input[row], recording.enabled[i].get(row).copied().unwrap_or(true));
        }
    }
    Ok(out)
}

/// How many numbers an initial state of `rig`, as it is set up in `recording`, has: see [`Machine::initial_layout`].
///
/// # Errors
/// The rig cannot be built.
pub fn initial_numbers(rig: &Rig, recording: &Recording) -> Result<usize, MachineError> {
    let setting = Setting::of(rig, Some(recording.index), recording.setup);
    Ok(Machine::<f64>::new(&setting, &|n: &Number| n.value, 1)?.initial_layout().len())
}

/// A reading with noise and in steps of the sensor's quantum.
fn sampled(sensor: &Sensor, mut y: f64, dice: Option<&mut ChaCha8Rng>) -> f64 {
    if let (Some(dice), Some(std)) = (dice, sensor.noise_std) {
        y += std * gaussian(dice);
    }
    if sensor.quantum > 0.0 { libm::round(y / sensor.quantum) * sensor.quantum } else { y }
}

/// Box and Muller 1958.
fn gaussian(dice: &mut ChaCha8Rng) -> f64 {
    let (u, v): (f64, f64) = (dice.random(), dice.random());
    libm::sqrt(-2.0 * libm::log(1.0 - u)) * libm::cos(std::f64::consts::TAU * v)
}

/// For tests: a pendulum shaken by a sine for 4 s twice, its sensor noisy by 1 mrad; `b.csv` is kept back.
#[cfg(test)]
pub(crate) fn shaken_pendulum() -> Experiment {
    let rig = Rig::parse(SHAKEN_PENDULUM, "rig.toml").unwrap();
    let times: Vec<f64> = (0..400).map(|k| f64::from(k) * 0.01).collect();
    let inputs = vec![times.iter().map(|t| libm::sin(9.0 * t)).collect()];
    let recording = |index: usize, name: &str, usage: Use| {
        let mut out = Recording { index, usage, ..Recording::new(name, times.clone(), inputs.clone(), Vec::new()) };
        out.measured = record(&rig, &out, &[0.3, 0.0], Some(index as u64)).unwrap().measured;
        out
    };
    Experiment { recordings: vec![recording(0, "a.csv", Use::Fit), recording(1, "b.csv", Use::Heldout)], rig }
}

/// Its rig.
#[cfg(test)]
pub(crate) const SHAKEN_PENDULUM: &str = "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = 0.01\ngravity_nm = 0.4\n\
    [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.3\n\
    [[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\nnoise_std = 0.001\n\
    [[recording]]\nfile = \"a.csv\"\nuse = \"fit\"\n[[recording]]\nfile = \"b.csv\"\nuse = \"heldout\"\n";
