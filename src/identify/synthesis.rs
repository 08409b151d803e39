//! Recordings made from a rig: the machine under given inputs, with the sensors' noise and resolution. RT: no.

use super::experiment::Recording;
use crate::model::machine::{Machine, MachineError};
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
