//! A case from the robot's own recordings: what the controller believed stands in the recording and becomes the rig.
//!
//! | of the configuration inside | becomes |
//! |---|---|
//! | `robot.model` c1..c6 | parameters; the free ones that the motion shows are uncertain by [`SHAPE_SPREAD`] |
//! | `robot.model` viscous, coulomb | friction effects at `hip`, uncertain by the factor [`WRONG_BY`] |
//! | `robot.model.hip_elasticity` | a `joint_elasticity` at `hip` that the simulation has already |
//! | `robot.hip` encoder | sensor `hip_angle_rad` with its quantum |
//! | `robot.imu` | sensor `leg_rate_rad_s`: the gyro |
//! | torque that the hip drive reports | actuator at `hip`, gain 1 (gear and sign are in the column) |
//! | `estimate.stance` | the set-up; in walking, the leg that stands in each row |
//! | `snapshot.toe_position_m` | in walking, what the legs are shorter than their length |
//!
//! Of a walk the rows of single support are taken, from [`LANDED_S`] after a touchdown to [`AHEAD_S`] before the next: a
//! blow, two feet on the ground and the hip's ringing after them are no part of the model's free run. A stretch knows
//! nothing of the one before (`window_column`); the toes move as the drives reported.
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
    Actuator, Bounds, Effect, MechanismKind, Numerics, RecordingEntry, Rig, Sensor, Setup, Side, Use, Value,
};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// Free runs restart this often, s.
pub const WINDOW_S: f64 = 0.5;
/// Share of a recording that is fitted.
const FIT_SHARE: f64 = 0.7;
/// Shortest part that tells anything, s.
const SHORTEST_S: f64 = 4.0;
/// After so long a landed foot has come to rest and the other one is clear of the ground, s.
const LANDED_S: f64 = 0.08;
/// A touchdown is noticed so late at most, s.
const AHEAD_S: f64 = 0.03;
/// Single support shorter than this tells less than its initial state takes, s.
const SHORTEST_STRETCH_S: f64 = 0.15;
/// More doubt about the leg that stands, and the row is not used.
const MOST_DOUBT: f64 = 0.5;
/// Column of the number of a stretch, in the files that are written.
const STRETCH: &str = "stretch";
/// In balance, which tells the six shape numbers apart only so far, one may be wrong by this share of itself, at least by
/// [`LEAST_SPREAD`].
const SHAPE_SPREAD: f64 = 0.2;
/// For shape numbers near zero (c3, c6).
const LEAST_SPREAD: f64 = 0.01;
/// Friction may be wrong by this factor, and in walking the legs' numbers.
const WRONG_BY: f64 = 3.0;

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
        let (mut case, model, _) = case.ok_or(OwnError::Nothing)?;
        case.free_what_shows(&model);
        Ok(case)
    }

    /// With one stance leg only: c's that its balance does not move are taken as known. A walk shows them all, far from
    /// upright.
    fn free_what_shows(&mut self, model: &Model) {
        let stands = |setup| self.rig.recordings.iter().any(|r| r.setup == Some(setup));
        let walks = stands(Setup::Walk);
        let hidden: &[&str] = match (walks || stands(Setup::InnerStance), walks || stands(Setup::OuterStance)) {
            (true, false) => &["c1", "c3", "c4", "c6"],
            (false, true) => &["c2", "c3", "c5", "c6"],
            _ => &[],
        };
        for (name, parameter) in ["c1", "c2", "c3", "c4", "c5", "c6"].into_iter().zip(&model.c) {
            let index = self.rig.mechanism.parameter_index(name);
            if let Some(value) = index.and_then(|i| self.rig.parameters.get_mut(i)) {
                if hidden.contains(&name) {
                    value.bounds = None;
                } else if walks {
                    *value = in_walking(parameter);
                }
            }
        }
    }

    /// Cuts a recording in two and enters both parts.
    fn add(&mut self, path: &Path, number: usize, table: &Table) -> Result<(), OwnError> {
        let name = || path.display().to_string();
        let setup = setup(table)?;
        let walk = if setup == Setup::Walk { Some(single_support(table)?) } else { None };
        let table = walk.as_ref().unwrap_or(table);
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
                stance_column: walk.as_ref().map(|_| "stance".to_owned()),
                toe_columns: walk.as_ref().map(|_| ["inner_short_m", "outer_short_m"].map(str::to_owned)),
                window_column: walk.as_ref().map(|_| STRETCH.to_owned()),
                parameters: Vec::new(),
                effects: Vec::new(),
            });
            self.files.push((file, table.to_csv(rows)));
        }
        Ok(())
    }
}

/// The set-up of a recording: one leg stands throughout, or the robot walks.
fn setup(table: &Table) -> Result<Setup, ExperimentError> {
    let stance = table.column("stance", None).map_err(ExperimentError::Table)?;
    Ok(match (stance.iter().all(|s| *s < 0.5), stance.iter().all(|s| *s > 0.5)) {
        (true, _) => Setup::InnerStance,
        (_, true) => Setup::OuterStance,
        (false, false) => Setup::Walk,
    })
}

/// The rows in which one foot carries for certain, with the number of their stretch.
fn single_support(table: &Table) -> Result<Table, ExperimentError> {
    let column = |name: &str| table.column(name, None).map_err(ExperimentError::Table);
    let (times, steps, doubt) = (column("t_s")?, column("steps")?, column("doubt")?);
    let mut numbers = vec![0.0; times.len()];
    let (mut number, mut row) = (0.0, 0);
    for step in steps.chunk_by(|a, b| a.to_bits() == b.to_bits()) {
        let (begin, end) = (row, row + step.len());
        row = end;
        // Before the first and after the last row nothing lands.
        let from_s = if begin == 0 { f64::MIN } else { times[begin] + LANDED_S };
        let to_s = if end == times.len() { f64::MAX } else { times[end] - AHEAD_S };
        let carries = |row: &usize| (from_s..to_s).contains(&times[*row]) && doubt[*row] < MOST_DOUBT;
        let rows: Vec<usize> = (begin..end).filter(carries).collect();
        for stretch in rows.chunk_by(|a, b| b - a == 1) {
            let (first, last) = (stretch[0], stretch[stretch.len() - 1]);
            if times[last] - times[first] >= SHORTEST_STRETCH_S {
                number += 1.0;
                numbers[first..=last].fill(number);
            }
        }
    }
    let kept: Vec<usize> = (0..times.len()).filter(|row| numbers[*row] > 0.0).collect();
    let names: Vec<&str> = table.names().iter().map(String::as_str).chain([STRETCH]).collect();
    let mut columns = Vec::new();
    for name in table.names() {
        let all = table.column(name, Some(f64::NAN)).map_err(ExperimentError::Table)?;
        columns.push(kept.iter().map(|row| all[*row]).collect());
    }
    columns.push(kept.iter().map(|row| numbers[*row]).collect());
    Ok(Table::of_columns("single support", &names, columns))
}

/// The rig that the controller believes in.
fn rig(config: &Config) -> Rig {
    let model = &config.robot.model;
    let known = [&model.leg_length_m, &model.total_mass_kg, &model.gravity_m_s2].map(|p| Value::known(p.value));
    let mut effects = vec![
        Effect::new(EffectKind::ViscousFriction, "hip", vec![by_a_factor(&model.viscous_nm_s_rad)]),
        Effect::new(EffectKind::CoulombFriction, "hip", vec![by_a_factor(&model.coulomb_nm)]),
    ];
    effects.extend(model.hip_elasticity.as_ref().map(elasticity));
    Rig {
        name: "the robot's own recording against the model of its controller".to_owned(),
        mechanism: MechanismKind::CompassGait,
        numerics: Numerics::default(),
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

/// What may have either sign is within what `robot.model` allows.
fn in_walking(p: &Parameter) -> Value {
    if p.min < 0.0 { uncertain(p, p.min, p.max) } else { by_a_factor(p) }
}

fn by_a_factor(p: &Parameter) -> Value {
    uncertain(p, p.value / WRONG_BY, p.value * WRONG_BY)
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
        case.free_what_shows(&load(None, &[]).unwrap().config.robot.model);
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
        let walking = self::case(&[walk()]).unwrap();
        assert_eq!(Rig::parse(&walking.rig.to_toml(), "written").unwrap(), walking.rig);
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
    fn short_recordings_are_refused_with_a_remedy() {
        let short = Table::of_columns("x.mcap", &COLUMNS, vec![vec![0.0, 0.001]; COLUMNS.len()]);
        assert!(case(&[short]).unwrap_err().to_string().contains("record longer"));
        assert!(OwnCase::of(&[]).unwrap_err().to_string().contains("at least one"));
    }

    /// A touchdown each .5 s, and a moment of doubt.
    fn walk() -> Table {
        let rows = 10_000;
        let column = |name: &str| -> Vec<f64> {
            let of = |k: usize| match name {
                "t_s" => 1e-3 * k as f64,
                "steps" => (k / 500) as f64,
                "stance" => (k / 500 % 2) as f64,
                "doubt" if (2_250..2_260).contains(&k) => 1.0,
                _ => 0.0,
            };
            (0..rows).map(of).collect()
        };
        Table::of_columns("x.mcap", &COLUMNS, COLUMNS.iter().map(|name| column(name)).collect())
    }

    #[test]
    fn a_walk_becomes_stretches_of_single_support() {
        let case = case(&[walk()]).unwrap();
        let entry = &case.rig.recordings[0];
        assert_eq!((entry.setup, entry.window_column.as_deref()), (Some(Setup::Walk), Some("stretch")));
        assert_eq!(free(&case).len(), 6);
        let rows = single_support(&walk()).unwrap();
        let [times, stretch, stance] = ["t_s", "stretch", "stance"].map(|name| rows.column(name, None).unwrap());
        // 20 steps, one of them cut in two by the doubt; nothing close to a touchdown.
        assert_eq!(stretch.last().copied(), Some(21.0));
        for (t, stance) in times.iter().zip(stance) {
            let since_s = t % 0.5;
            assert!(*t < 0.5 || (LANDED_S - 1e-9..).contains(&since_s), "{t}");
            assert!(*t > 9.5 || (..0.5 - AHEAD_S + 1e-9).contains(&since_s), "{t}");
            assert!((stance - libm::floor(t / 0.5 + 1e-9) % 2.0).abs() < 1e-12, "{t}");
        }
    }

    #[test]
    fn what_the_controller_knows_of_its_drive_stands_in_the_rig() {
        let key = "robot.model.hip_elasticity={ stiffness_nm_rad = 377.0, damping_nm_s_rad = 0.2, rotor_inertia_kg_m2 = 0.09 }";
        let rig = rig(&load(None, &[key.to_owned()]).unwrap().config);
        let known = rig.effects.iter().find(|e| e.kind == EffectKind::JointElasticity).unwrap();
        assert!((known.values[0].value - 377.0).abs() < 1e-12 && known.values[0].is_free());
    }
}
