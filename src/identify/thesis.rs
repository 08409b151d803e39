//! The experiments of thesis 4.2.3, simulated: five set-ups of the robot whose parameters are those of Table 4.1.
//!
//! Each leg as the stance leg, held up by springs; each leg fixed upright while the other swings; both legs parallel on
//! the springs. Ten seconds each, hip torque of six sines; errors of .3° on the stance angle and .1° on the hip, slowly
//! correlated (model notes §9). What comes out is a case that `compass identify` reads.
//! RT: no.

use crate::identify::experiment::Recording;
use crate::identify::synthesis::record;
use crate::model::machine::MachineError;
use crate::model::rig::{Rig, RigErrors, Setup};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;
use std::fmt::Write as _;

/// One row of Table 4.1, friction in SI (model notes §2).
#[derive(Clone, Copy, Debug)]
pub struct Truth {
    /// Name as `compass identify` prints it.
    pub name: &'static str,
    /// Column "SysID": what the simulated robot has.
    pub value: f64,
    /// Expected relative spread with all five set-ups (model notes §9).
    pub spread: f64,
    /// Column "Calculated", c1 as it must have been meant; friction from a data sheet.
    pub cad: f64,
    /// Bounds.
    bounds: [f64; 2],
}

/// Table 4.1.
pub const TABLE_4_1: [Truth; 8] = [
    Truth { name: "c1", value: 0.1007, spread: 0.001, cad: 0.1207, bounds: [0.01, 0.3] },
    Truth { name: "c2", value: 0.1434, spread: 0.001, cad: 0.1101, bounds: [0.01, 0.3] },
    // The rotor may turn c3 negative (model notes §2).
    Truth { name: "c3", value: 0.000_596, spread: 0.65, cad: 0.0017, bounds: [-0.02, 0.02] },
    Truth { name: "c4", value: 0.1151, spread: 0.0025, cad: 0.1382, bounds: [0.02, 0.3] },
    Truth { name: "c5", value: 0.1264, spread: 0.0025, cad: 0.0987, bounds: [0.02, 0.3] },
    Truth { name: "c6", value: 0.0026, spread: 0.08, cad: 0.0329, bounds: [-0.05, 0.1] },
    Truth { name: "viscous_friction@hip.viscous", value: 0.694, spread: 0.005, cad: 0.3, bounds: [0.0, 5.0] },
    Truth { name: "coulomb_friction@hip.coulomb", value: 1.841, spread: 0.002, cad: 1.0, bounds: [0.0, 10.0] },
];

/// What a person starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Guess {
    /// Column "Calculated" of Table 4.1.
    Cad,
    /// The same with c1 as printed, .0207: no leg can have it.
    Printed,
    /// The truth, every other number a fifth more, the rest a fifth less.
    Near,
    /// The truth.
    True,
}

impl Guess {
    fn of(self, row: &Truth) -> f64 {
        match self {
            Self::True => row.value,
            Self::Near => row.value * if row.name.as_bytes()[1].is_multiple_of(2) { 1.2 } else { 0.8 },
            Self::Printed if row.name == "c1" => 0.0207,
            Self::Cad | Self::Printed => row.cad,
        }
    }
}

/// A file of the case.
#[derive(Clone, Debug)]
pub struct File {
    /// Its name.
    pub name: String,
    /// What is in it.
    pub text: String,
}

/// Why the experiments could not be simulated.
#[derive(Debug, thiserror::Error)]
pub enum ThesisError {
    /// The rig of this file is wrong.
    #[error(transparent)]
    Rig(#[from] RigErrors),
    /// It does not run.
    #[error(transparent)]
    Run(#[from] MachineError),
}

const SETUPS: [(&str, &str); 5] = [
    ("inner_stance.csv", "inner_stance"),
    ("outer_stance.csv", "outer_stance"),
    ("inner_fixed.csv", "inner_fixed"),
    ("outer_fixed.csv", "outer_fixed"),
    ("parallel.csv", "parallel"),
];

/// How long and how densely each experiment is recorded.
#[derive(Clone, Copy, Debug)]
pub struct Length {
    /// Rows.
    pub rows: usize,
    /// Time between them, s.
    pub step_s: f64,
}

/// Ten seconds at 200 Hz.
pub const TEN_SECONDS: Length = Length { rows: 2000, step_s: 0.005 };

/// Standard deviations of the readings, rad (.3° and .1°), and how long an error lasts, s.
const STANCE_RAD: f64 = 0.3 * TAU / 360.0;
const HIP_RAD: f64 = 0.1 * TAU / 360.0;
const ERROR_S: f64 = 0.05;

/// Simulates all five and writes them as a case with this guess in its rig.
///
/// # Errors
/// See [`ThesisError`].
pub fn case(guess: Guess, length: Length, seed: u64) -> Result<Vec<File>, ThesisError> {
    let truth = Rig::parse(&rig_text(Guess::True), "Table 4.1")?;
    let mut dice = ChaCha8Rng::seed_from_u64(seed);
    let mut files = vec![File { name: "rig.toml".into(), text: rig_text(guess) }];
    for (index, (name, _)) in SETUPS.iter().enumerate() {
        files.push(File { name: (*name).into(), text: experiment(&truth, index, length, &mut dice)? });
    }
    Ok(files)
}

fn rig_text(guess: Guess) -> String {
    let mut text = String::from(
        "# The experiments of thesis 4.2.3, simulated with the parameters of Table 4.1 (column SysID).\nschema = 1\n\
         name = \"compass gait robot, identification\"\nmechanism = \"compass_gait\"\n\n[parameters]\n\
         leg_length_m = 1.045\ntotal_mass_kg = 15.2\ngravity_m_s2 = 9.81\n",
    );
    let free =
        |row: &Truth| format!("{{ value = {}, min = {}, max = {} }}", guess.of(row), row.bounds[0], row.bounds[1]);
    // Writing into a string cannot fail.
    for row in TABLE_4_1.iter().filter(|r| r.name.len() == 2) {
        writeln!(text, "{} = {}", row.name, free(row)).unwrap_or_default();
    }
    text += "\n[[actuator]]\njoint = \"hip\"\ncolumn = \"torque_nm\"\ngain = { value = 1.0 }\n";
    for leg in ["inner", "outer", "hip"] {
        write!(text, "\n[[sensor]]\nmeasures = \"{leg}\"\ncolumn = \"{leg}_rad\"\n").unwrap_or_default();
    }
    for row in TABLE_4_1.iter() {
        let Some((effect, key)) = row.name.split_once("@hip.") else { continue };
        write!(text, "\n[[effect]]\neffect = \"{effect}\"\nat = \"hip\"\n{key} = {}\n", free(row)).unwrap_or_default();
    }
    for (setup, leg) in [("inner_stance", "inner"), ("outer_stance", "outer"), ("parallel", "inner")] {
        // Identified to high accuracy in a separate experiment (thesis 4.2.3): known.
        write!(
            text,
            "\n[[effect]]\neffect = \"parallel_spring\"\nat = \"{leg}\"\nsetup = \"{setup}\"\n\
             stiffness = {{ value = 250.0 }}\nrest = {{ value = 0.0 }}\n"
        )
        .unwrap_or_default();
    }
    for (file, setup) in SETUPS {
        write!(text, "\n[[recording]]\nfile = \"{file}\"\nuse = \"fit\"\nsetup = \"{setup}\"\n").unwrap_or_default();
    }
    text
}

/// Hip torque of a row, Nm: six sines between .15 and 4 Hz.
struct Excitation(Vec<[f64; 3]>);

impl Excitation {
    fn drawn(dice: &mut ChaCha8Rng) -> Self {
        let line = |i: i32| {
            let hz = 0.15 * libm::pow(4.0 / 0.15, (f64::from(i) + dice.random::<f64>()) / 6.0);
            [HIP_NM, hz, TAU * dice.random::<f64>()]
        };
        Self((0..6).map(line).collect())
    }

    fn at(&self, t: f64) -> f64 {
        let sum: f64 = self.0.iter().map(|[a, hz, phase]| a * libm::sin(TAU * hz * t + phase)).sum();
        // The drive takes hundredths of a newton metre.
        libm::round(sum * 100.0) / 100.0
    }
}

/// Amplitude of each sine, Nm.
const HIP_NM: f64 = 4.0;

fn experiment(truth: &Rig, index: usize, length: Length, dice: &mut ChaCha8Rng) -> Result<String, MachineError> {
    let entry = &truth.recordings[index];
    let sines = Excitation::drawn(dice);
    let times: Vec<f64> = (0..length.rows).map(|k| k as f64 * length.step_s).collect();
    let torque: Vec<f64> = times.iter().map(|t| sines.at(*t)).collect();
    let recording = Recording::new(&entry.file, times, vec![torque.clone()], vec![Vec::new(); truth.sensors.len()]);
    let recording = Recording { index, setup: entry.setup, ..recording };
    let clean = record(truth, &recording, &released(entry.setup), None)?.measured;
    let noisy: Vec<Option<Vec<f64>>> = clean
        .into_iter()
        .zip([STANCE_RAD, STANCE_RAD, HIP_RAD])
        .enumerate()
        .map(|(channel, (signal, std))| {
            is_read(entry.setup, channel).then(|| with_errors(signal, std, length.step_s, dice))
        })
        .collect();
    Ok(csv(&recording.times, &torque, &noisy))
}

/// Where the robot is let go, rad: off the rest of its springs; the legs at rest.
fn released(setup: Option<Setup>) -> [f64; 2] {
    match setup {
        Some(Setup::Parallel) => [0.1, 0.1],
        Some(Setup::InnerFixed) => [0.0, 0.4],
        Some(Setup::OuterFixed) => [0.4, 0.0],
        Some(Setup::OuterStance) => [-0.3, 0.08],
        _ => [0.08, -0.3],
    }
}

/// The IMU tells of the leg that stands, the encoder of the hip always.
fn is_read(setup: Option<Setup>, channel: usize) -> bool {
    let stands = match setup {
        Some(Setup::OuterStance | Setup::OuterFixed) => 1,
        _ => 0,
    };
    channel == 2 || channel == stands
}

/// Adds errors of this deviation that fade over [`ERROR_S`].
fn with_errors(signal: Vec<f64>, std: f64, step_s: f64, dice: &mut ChaCha8Rng) -> Vec<f64> {
    let keep = libm::exp(-step_s / ERROR_S);
    let fresh = std * libm::sqrt(1.0 - keep * keep);
    let mut error = std * gaussian(dice);
    let add = |y: f64| {
        error = keep * error + fresh * gaussian(dice);
        y + error
    };
    signal.into_iter().map(add).collect()
}

/// Box and Muller 1958.
fn gaussian(dice: &mut ChaCha8Rng) -> f64 {
    let (u, v): (f64, f64) = (dice.random(), dice.random());
    libm::sqrt(-2.0 * libm::log(1.0 - u)) * libm::cos(TAU * v)
}

fn csv(times: &[f64], torque: &[f64], channels: &[Option<Vec<f64>>]) -> String {
    let mut text = String::from("t_s,torque_nm,inner_rad,outer_rad,hip_rad\n");
    for (k, (t, u)) in times.iter().zip(torque).enumerate() {
        write!(text, "{t:.3},{u:.2}").unwrap_or_default();
        for channel in channels {
            match channel {
                Some(signal) => write!(text, ",{:.6}", signal[k]).unwrap_or_default(),
                None => text.push(','),
            }
        }
        text.push('\n');
    }
    text
}
