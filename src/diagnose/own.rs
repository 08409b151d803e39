//! A case from the robot's own recordings: what the controller believed stands in the recording and becomes the rig.
//!
//! | of the configuration inside | becomes |
//! |---|---|
//! | `robot.model` c1..c6 | parameters; the free ones that balance moves are uncertain by [`SHAPE_SPREAD`] |
//! | `robot.model` viscous, coulomb | friction effects at `hip`, uncertain by the factor [`FRICTION_SPREAD`] |
//! | `robot.model.hip_elasticity` | a `joint_elasticity` at `hip` that the simulation has already |
//! | `robot.hip` encoder | sensor `hip_angle_rad` with its quantum |
//! | `robot.imu` | sensor `leg_rate_rad_s`: the gyro |
//! | torque that the hip drive reports | actuator at `hip`, gain 1 (gear and sign are in the column) |
//! | `estimate.stance` | the set-up |
//!
//! Each recording is cut in time: the first part is fitted, the rest never touched before the proof. The robot is
//! unstable and the recordings are closed loop, so free runs restart every [`WINDOW_S`]: an error grows by
//! exp(3.2 · .5) = 5 in one (model notes, section 8), and what the controller fed back cannot add up.
//! On one leg the inertia and the moment of the leg that swings show (c2, c5 on the inner one). Those of the leg that
//! stands, c3 and c6 do not: left free they ran to their bounds, and c4 took over a part of the rotor. With recordings
//! of both legs all are free (model notes, section 9).
//! The torque is the drive's report and not its command, so that the current loop's lag, about which a model of the
//! machine says nothing, stays outside. Put `hip_torque_nm` into `case/rig.toml` to ask about the command.
//! The IMU's own attitude is left out: it errs by up to two degrees in motion (Thesis 2.1.2), the gyro does not.
//! RT: no.

use crate::config::checked::{Config, HipElasticity, Model, Parameter};
use crate::identify::experiment::mcap::Own;
use crate::identify::experiment::{ExperimentError, Table};
use crate::model::effect::EffectKind;
use crate::model::rig::{
    Actuator, Bounds, Effect, MechanismKind, RecordingEntry, Rig, Sensor, Setup, Side, Use, Value,
};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// Free runs restart this often, s.
pub const WINDOW_S: f64 = 0.5;
/// Share of a recording that is fitted.
const FIT_SHARE: f64 = 0.7;
/// Shortest part that tells anything, s.
const SHORTEST_S: f64 = 4.0;
/// A shape number may be wrong by this share of itself, at least by [`LEAST_SPREAD`].
const SHAPE_SPREAD: f64 = 0.2;
/// For shape numbers near zero (c3, c6).
const LEAST_SPREAD: f64 = 0.01;
/// Friction may be wrong by this factor.
const FRICTION_SPREAD: f64 = 3.0;

/// Why no case can be made of recordings.
#[derive(Debug, thiserror::Error)]
pub enum OwnError {
    /// A recording cannot be read.
    #[error(transparent)]
    Recording(#[from] ExperimentError),
    /// Another robot, or another model.
    #[error("{path}: was made with another robot.model than {first}; diagnose them apart")]
    OtherModel {
        /// Which.
        path: String,
        /// The one that it is compared with.
        first: String,
    },
    /// The stance leg changes.
    #[error(
        "{path}: the stance leg changes; --own takes balance on one leg. For walking write a rig with \
         setup = \"walk\" and stance_column = \"stance\" (the recording may stand in it as it is)"
    )]
    Steps {
        /// Which.
        path: String,
    },
    /// Too short.
    #[error("{path}: only {has_s:.1} s of usable motion, {needs_s:.0} s are needed; record longer")]
    Short {
        /// Which.
        path: String,
        /// Usable.
        has_s: f64,
        /// Needed.
        needs_s: f64,
    },
    /// No recordings.
    #[error("name at least one recording")]
    Nothing,
}

/// A case, ready to be written as a folder.
#[derive(Clone, Debug)]
pub struct OwnCase {
    /// What the controller believed.
    pub rig: Rig,
    /// File names and texts of the recordings that the rig names.
    pub files: Vec<(String, String)>,
}

impl OwnCase {
    /// Of the recordings at `paths`.
    ///
    /// # Errors
    /// See [`OwnError`].
    pub fn of(paths: &[PathBuf]) -> Result<Self, OwnError> {
        let mut case: Option<(Self, Model, String)> = None;
        for (number, path) in paths.iter().enumerate() {
            let own = Own::read(path)?;
            let model = own.config.robot.model.clone();
            let name = path.display().to_string();
            let (case, first_model, first) = case.get_or_insert_with(|| {
                (Self { rig: rig(&own.config), files: Vec::new() }, model.clone(), name.clone())
            });
            if *first_model != model {
                return Err(OwnError::OtherModel { path: name, first: first.clone() });
            }
            case.add(path, number, &own.table)?;
        }
        let (mut case, ..) = case.ok_or(OwnError::Nothing)?;
        case.hold_what_does_not_show();
        Ok(case)
    }

    /// With one stance leg only: c's that its balance does not move are taken as known.
    fn hold_what_does_not_show(&mut self) {
        let stands = |setup| self.rig.recordings.iter().any(|r| r.setup == Some(setup));
        let hidden: &[&str] = match (stands(Setup::InnerStance), stands(Setup::OuterStance)) {
            (true, false) => &["c1", "c3", "c4", "c6"],
            (false, true) => &["c2", "c3", "c5", "c6"],
            _ => &[],
        };
        for name in hidden {
            let index = self.rig.mechanism.parameter_index(name);
            if let Some(value) = index.and_then(|i| self.rig.parameters.get_mut(i)) {
                value.bounds = None;
            }
        }
    }

    /// Cuts a recording in two and enters both parts.
    fn add(&mut self, path: &Path, number: usize, table: &Table) -> Result<(), OwnError> {
        let name = || path.display().to_string();
        let setup = setup(table).ok_or_else(|| OwnError::Steps { path: name() })?;
        let times = table.column("t_s", None).map_err(ExperimentError::Table)?;
        let (first, last) = (times.first().copied().unwrap_or(0.0), times.last().copied().unwrap_or(0.0));
        if last - first < SHORTEST_S {
            return Err(OwnError::Short { path: name(), has_s: last - first, needs_s: SHORTEST_S });
        }
        let cut = times.partition_point(|t| *t < first + FIT_SHARE * (last - first));
        for (usage, word, rows) in [(Use::Fit, "fit", 0..cut), (Use::Heldout, "heldout", cut..times.len())] {
            let file = format!("own_{}_{word}.csv", number + 1);
            self.rig.recordings.push(RecordingEntry {
                file: file.clone(),
                usage,
                window_s: Some(WINDOW_S),
                setup: Some(setup),
                stance_column: None,
                parameters: Vec::new(),
                effects: Vec::new(),
            });
            self.files.push((file, table.to_csv(rows)));
        }
        Ok(())
    }
}

/// The set-up of a recording in which one leg stands throughout.
fn setup(table: &Table) -> Option<Setup> {
    let stance = table.column("stance", None).ok()?;
    match (stance.iter().all(|s| *s < 0.5), stance.iter().all(|s| *s > 0.5)) {
        (true, _) => Some(Setup::InnerStance),
        (_, true) => Some(Setup::OuterStance),
        (false, false) => None,
    }
}

/// The rig that the controller believes in.
fn rig(config: &Config) -> Rig {
    let model = &config.robot.model;
    let known = [&model.leg_length_m, &model.total_mass_kg, &model.gravity_m_s2].map(|p| Value::known(p.value));
    let mut effects = vec![
        Effect::new(EffectKind::ViscousFriction, "hip", vec![friction(&model.viscous_nm_s_rad)]),
        Effect::new(EffectKind::CoulombFriction, "hip", vec![friction(&model.coulomb_nm)]),
    ];
    effects.extend(model.hip_elasticity.as_ref().map(elasticity));
    Rig {
        name: "the robot's own recording against the model of its controller".to_owned(),
        mechanism: MechanismKind::CompassGait,
        parameters: known.into_iter().chain(model.c.iter().map(shape)).collect(),
        actuators: vec![Actuator {
            joint: HIP,
            column: "hip_torque_applied_nm".to_owned(),
            gain: Value::known(1.0),
            enable_column: None,
            back_emf: None,
        }],
        sensors: vec![
            sensor(HIP, false, "hip_angle_rad", TAU / config.robot.hip.encoder_counts_per_turn),
            sensor(INNER, true, "leg_rate_rad_s", 0.0),
        ],
        effects,
        recordings: Vec::new(),
    }
}

/// Coordinates of the compass gait.
const INNER: usize = 0;
const HIP: usize = 2;

fn sensor(joint: usize, is_rate: bool, column: &str, quantum: f64) -> Sensor {
    Sensor { joint, is_rate, side: Side::Link, column: column.to_owned(), noise_std: None, quantum }
}

fn shape(p: &Parameter) -> Value {
    let spread = (SHAPE_SPREAD * p.value.abs()).max(LEAST_SPREAD);
    uncertain(p, p.value - spread, p.value + spread)
}

fn friction(p: &Parameter) -> Value {
    uncertain(p, p.value / FRICTION_SPREAD, p.value * FRICTION_SPREAD)
}

/// Free within both `min..=max` and the parameter's own bounds, if the configuration lets it be free.
fn uncertain(p: &Parameter, min: f64, max: f64) -> Value {
    if !p.free {
        return Value::known(p.value);
    }
    Value { value: p.value, bounds: Some(Bounds { min: min.max(p.min), max: max.min(p.max) }) }
}

/// What the controller knows of the drive's compliance: by a factor of two.
fn elasticity(e: &HipElasticity) -> Effect {
    let twice = |x: f64| Value::free(x, 0.5 * x, 2.0 * x);
    let values = vec![twice(e.stiffness_nm_rad), twice(e.damping_nm_s_rad), twice(e.rotor_inertia_kg_m2)];
    Effect::new(EffectKind::JointElasticity, "hip", values)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::load;
    use crate::identify::experiment::mcap::COLUMNS;

    /// 10 s at 1 kHz on a leg that does not move.
    fn table(stance: impl Fn(usize) -> f64) -> Table {
        let rows = 10_000;
        let columns = COLUMNS.iter().map(|name| match *name {
            "t_s" => (0..rows).map(|k| 1e-3 * k as f64).collect(),
            "stance" => (0..rows).map(&stance).collect(),
            _ => vec![0.0; rows],
        });
        Table::of_columns("x.mcap", &COLUMNS, columns.collect())
    }

    fn case(tables: &[Table]) -> Result<OwnCase, OwnError> {
        let mut case = OwnCase { rig: rig(&load(None, &[]).unwrap().config), files: Vec::new() };
        for (number, table) in tables.iter().enumerate() {
            case.add(Path::new("x.mcap"), number, table)?;
        }
        case.hold_what_does_not_show();
        Ok(case)
    }

    fn free(case: &OwnCase) -> Vec<&str> {
        let names = case.rig.mechanism.parameters().iter().zip(&case.rig.parameters);
        names.filter(|(_, value)| value.is_free()).map(|(info, _)| info.name).collect()
    }

    #[test]
    fn the_rig_that_is_written_is_the_rig_that_was_made() {
        let case = case(&[table(|_| 0.0)]).unwrap();
        assert_eq!(Rig::parse(&case.rig.to_toml(), "written").unwrap(), case.rig);
        let files: Vec<&str> = case.files.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(files, ["own_1_fit.csv", "own_1_heldout.csv"]);
    }

    #[test]
    fn later_rows_are_held_out_and_none_is_used_twice() {
        let case = case(&[table(|_| 0.0)]).unwrap();
        let rows: Vec<usize> = case.files.iter().map(|(_, text)| text.lines().count() - 1).collect();
        assert_eq!(rows.iter().sum::<usize>(), 10_000);
        assert!((6_990..7_010).contains(&rows[0]), "{rows:?}");
    }

    #[test]
    fn one_leg_frees_what_swings_and_both_legs_free_all() {
        assert_eq!(free(&case(&[table(|_| 0.0)]).unwrap()), ["c2", "c5"]);
        assert_eq!(free(&case(&[table(|_| 1.0)]).unwrap()), ["c1", "c4"]);
        assert_eq!(free(&case(&[table(|_| 0.0), table(|_| 1.0)]).unwrap()).len(), 6);
    }

    #[test]
    fn steps_and_short_recordings_are_refused_with_a_remedy() {
        let steps = case(&[table(|k| f64::from(u8::from(k > 5000)))]).unwrap_err().to_string();
        assert!(steps.contains("x.mcap") && steps.contains("stance_column"), "{steps}");
        let short = Table::of_columns("x.mcap", &COLUMNS, vec![vec![0.0, 0.001]; COLUMNS.len()]);
        assert!(case(&[short]).unwrap_err().to_string().contains("record longer"));
        assert!(OwnCase::of(&[]).unwrap_err().to_string().contains("at least one"));
    }

    #[test]
    fn what_the_controller_knows_of_its_drive_stands_in_the_rig() {
        let key = "robot.model.hip_elasticity={ stiffness_nm_rad = 377.0, damping_nm_s_rad = 0.2, rotor_inertia_kg_m2 = 0.09 }";
        let rig = rig(&load(None, &[key.to_owned()]).unwrap().config);
        let known = rig.effects.iter().find(|e| e.kind == EffectKind::JointElasticity).unwrap();
        assert!((known.values[0].value - 377.0).abs() < 1e-12 && known.values[0].is_free());
    }
}
