//! A recording of our own controller (`.mcap`) as a table, so that it may stand wherever a CSV may.
//!
//! A row is one SYNC of the hip's bus: the drive samples its encoder and takes over its command at that instant, so
//! reading and command of a row hold for exactly `t_s` (time of validity, not the tick that heard of it).
//!
//! | column | what | of |
//! |---|---|---|
//! | `t_s` | the SYNC, s since the first tick of the recording | `feedback` stamp |
//! | `hip_angle_rad` | hip encoder, inner - outer, at the joint | `snapshot.hip_angle_rad` |
//! | `hip_torque_nm` | command as the drive took it, at the joint, + on inner; acts from this row to the next | `drives` |
//! | `hip_torque_applied_nm` | mean torque until the next row, by the drive's own reports | `snapshot.hip_torque_nm` |
//! | `leg_rate_rad_s` | gyro on the inner leg, brought to `t_s`; empty in rows without a new sample | `imu` |
//! | `leg_angle_rad` | attitude of the inner leg by the IMU's own filter, likewise; empty if it streams none | `imu` |
//! | `stance` | leg that stands: 0 inner, 1 outer | `estimate.stance` |
//! | `armed` | 1 while the controller's torque reaches the motor | `status.mode` |
//! | `steps` | touchdowns so far | `estimate.steps` |
//! | `doubt` | how much the stance is in doubt, 0 to 1 | `estimate.stance_doubt` |
//! | `inner_short_m`, `outer_short_m` | what the longer toe leaves of the leg's length | `snapshot.toe_position_m` |
//!
//! Of a recording that was armed only the longest armed stretch is given, less its first [`SETTLING_S`]: before it a hand
//! may hold the robot. One that never was armed is given whole.
//! RT: no.

use super::ExperimentError;
use super::csv_table::Table;
use crate::base::time::{Span, Stamp};
use crate::config::checked::Config;
use crate::config::from_canonical;
use crate::msg::{Drive, DriveState, Mode, TOES, TickRecord};
use crate::record::Reader;
use std::collections::VecDeque;
use std::path::Path;

/// After arming the torque ramps up and whoever holds the robot lets go.
pub const SETTLING_S: f64 = 0.5;
/// Longest gap between IMU samples that a straight line bridges.
const LONGEST_IMU_GAP: Span = Span::from_ms(10);
/// A hip reading later than this is a gap, not the next row.
const LONGEST_ROW: Span = Span::from_ms(20);
/// Commands that may wait for the SYNC that makes them act.
const COMMANDS_KEPT: usize = 8;

/// Names of all columns, in the order of [`Row::cells`].
pub const COLUMNS: [&str; 12] = [
    "t_s",
    "hip_angle_rad",
    "hip_torque_nm",
    "hip_torque_applied_nm",
    "leg_rate_rad_s",
    "leg_angle_rad",
    "stance",
    "armed",
    "steps",
    "doubt",
    "inner_short_m",
    "outer_short_m",
];

/// What a recording of our own controller says.
#[derive(Clone, Debug)]
pub struct Own {
    /// The configuration it was made with, the controller's model among it.
    pub config: Config,
    /// The columns above.
    pub table: Table,
}

impl Own {
    /// Reads `path`; a torn file up to its last whole tick.
    ///
    /// # Errors
    /// The file is no recording of this program, or holds nothing that a model can be run against.
    pub fn read(path: &Path) -> Result<Self, ExperimentError> {
        let file = path.display().to_string();
        let form = |what: String| ExperimentError::Form(format!("{file}: {what}"));
        let mut reader = Reader::open(path).map_err(|e| ExperimentError::Form(whole_chain(&e)))?;
        let mut first = reader.next_tick().map_err(|e| ExperimentError::Form(whole_chain(&e)))?;
        let text = reader.about().config_text.clone();
        let text = text.ok_or_else(|| form("holds no configuration, so its units are unknown; record again".into()))?;
        let config = from_canonical(&text, &[])
            .map_err(|e| form(format!("its configuration is of another version of this program:\n{e}")))?
            .config;
        let mut gather = Gather::new(&config);
        while let Some(tick) = first.take() {
            gather.take(&tick);
            first = reader.next_tick().map_err(|e| ExperimentError::Form(whole_chain(&e)))?;
        }
        let rows = gather.rows();
        if rows.is_empty() {
            return Err(form("the hip drive never answered, nothing to run a model against".into()));
        }
        let rows = usable(&rows);
        if rows.len() < 2 {
            let what = format!(
                "the robot was never armed for longer than {SETTLING_S} s at a time (see `compass inspect`), nothing to \
                 run a model against"
            );
            return Err(form(what));
        }
        let columns = (0..COLUMNS.len()).map(|c| rows.iter().map(|r| r.cells()[c]).collect()).collect();
        Ok(Self { config, table: Table::of_columns(&file, &COLUMNS, columns) })
    }
}

/// An error with its causes, in one line.
fn whole_chain(error: &dyn std::error::Error) -> String {
    let causes = std::iter::successors(error.source(), |e| e.source());
    causes.fold(error.to_string(), |text, cause| format!("{text}: {cause}"))
}

/// What holds at one SYNC.
#[derive(Clone, Copy, Debug)]
struct Row {
    at: Stamp,
    t_s: f64,
    hip_angle_rad: f64,
    command_nm: f64,
    /// As reported; then the mean until the next row.
    reported_nm: f64,
    leg_rate_rad_s: f64,
    leg_angle_rad: f64,
    stance: f64,
    armed: bool,
    steps: f64,
    doubt: f64,
    short_m: [f64; 2],
}

impl Row {
    fn cells(&self) -> [f64; COLUMNS.len()] {
        [
            self.t_s,
            self.hip_angle_rad,
            self.command_nm,
            self.reported_nm,
            self.leg_rate_rad_s,
            self.leg_angle_rad,
            self.stance,
            f64::from(u8::from(self.armed)),
            self.steps,
            self.doubt,
            self.short_m[0],
            self.short_m[1],
        ]
    }
}

/// An IMU sample of the inner leg; the angle is NaN if the device streams none.
#[derive(Clone, Copy, Debug)]
struct Sample {
    at: Stamp,
    rate_rad_s: f64,
    angle_rad: f64,
}

/// Collects rows tick by tick.
struct Gather {
    nm_per_permille: f64,
    imu_sign: f64,
    imu_offset_rad: f64,
    toe_out_m: f64,
    start: Option<Stamp>,
    /// Commands with the tick that sent them, oldest first.
    commands: VecDeque<(Stamp, f64)>,
    rows: Vec<Row>,
    samples: Vec<Sample>,
}

impl Gather {
    fn new(config: &Config) -> Self {
        let (hip, imu) = (&config.robot.hip, &config.robot.imu);
        let rated_nm = config.robot.drives[Drive::Hip as usize].rated_torque_nm;
        Self {
            nm_per_permille: 1e-3 * rated_nm * hip.gear_ratio * hip.gear_efficiency * hip.motor_sign,
            imu_sign: imu.sign,
            imu_offset_rad: imu.offset_rad,
            toe_out_m: config.robot.toe.extended_m,
            start: None,
            commands: VecDeque::new(),
            rows: Vec::new(),
            samples: Vec::new(),
        }
    }

    fn take(&mut self, tick: &TickRecord) {
        let start = *self.start.get_or_insert(tick.input.now);
        self.take_imu(tick);
        self.take_row(tick, start);
        let hip = &tick.drives.drives[Drive::Hip as usize];
        let enabled = tick.feedback.drives[Drive::Hip as usize].state == DriveState::Enabled;
        let nm = if enabled { self.nm_per_permille * f64::from(hip.torque_permille) } else { 0.0 };
        self.commands.push_back((tick.input.now, nm));
        if self.commands.len() > COMMANDS_KEPT {
            self.commands.pop_front();
        }
    }

    fn take_imu(&mut self, tick: &TickRecord) {
        for sample in tick.input.imu.as_slice() {
            let [_, pitch, _] = sample.euler_rad;
            let [_, rate, _] = sample.rate_rad_s;
            let angle = self.imu_offset_rad + self.imu_sign * pitch;
            self.samples.push(Sample {
                at: sample.stamp,
                rate_rad_s: self.imu_sign * rate,
                angle_rad: if sample.has_attitude { angle } else { f64::NAN },
            });
        }
    }

    fn take_row(&mut self, tick: &TickRecord, start: Stamp) {
        let at = tick.feedback.drives[Drive::Hip as usize].stamp;
        if at < start || self.rows.last().is_some_and(|r| at <= r.at) {
            return;
        }
        let sent = self.commands.iter().rev().find(|(now, _)| *now <= at);
        self.rows.push(Row {
            at,
            t_s: at.since(start).as_s(),
            hip_angle_rad: tick.snapshot.hip_angle_rad,
            command_nm: sent.map_or(0.0, |(_, nm)| *nm),
            reported_nm: tick.snapshot.hip_torque_nm,
            leg_rate_rad_s: f64::NAN,
            leg_angle_rad: f64::NAN,
            stance: f64::from(tick.estimate.stance as u8),
            armed: tick.status.mode == Mode::Armed,
            steps: f64::from(tick.estimate.steps),
            doubt: tick.estimate.stance_doubt,
            short_m: short_m(self.toe_out_m, &tick.snapshot.toe_position_m),
        });
    }

    /// The rows with the IMU's samples brought to their instants, and the reported torque to its mean.
    fn rows(mut self) -> Vec<Row> {
        let share = share_of_next(kept(&self.rows));
        for k in 1..self.rows.len() {
            let (now, next) = (self.rows[k - 1].reported_nm, self.rows[k].reported_nm);
            self.rows[k - 1].reported_nm = now + share * (next - now);
        }
        for pair in self.samples.windows(2) {
            let (a, b) = (pair[0], pair[1]);
            let row = self.rows.partition_point(|r| r.at < a.at);
            let gap = b.at.since(a.at);
            let Some(row) = self.rows.get_mut(row).filter(|r| r.at < b.at && gap <= LONGEST_IMU_GAP) else { continue };
            let share = row.at.since(a.at).as_s() / gap.as_s();
            row.leg_rate_rad_s = a.rate_rad_s + share * (b.rate_rad_s - a.rate_rad_s);
            row.leg_angle_rad = a.angle_rad + share * (b.angle_rad - a.angle_rad);
        }
        self.rows
    }
}

/// What each leg is shorter than with its toes out, m: its longer toe carries.
fn short_m(out_m: f64, [inner_a, inner_b, outer_a, outer_b]: &[f64; TOES]) -> [f64; 2] {
    [out_m - inner_a.max(*inner_b), out_m - outer_a.max(*outer_b)]
}

/// How much of a torque's distance to its command is left one row later: `r⁺ - c = a (r - c)`, by least squares. A
/// current loop of time constant T has `a = exp(-1 ms / T)`.
fn kept(rows: &[Row]) -> f64 {
    let (mut both, mut square) = (0.0, 0.0);
    for pair in rows.windows(2).filter(|p| p[0].armed && p[1].armed) {
        let (before, after) = (pair[0].reported_nm - pair[0].command_nm, pair[1].reported_nm - pair[0].command_nm);
        both += before * after;
        square += before * before;
    }
    if square > 0.0 { (both / square).clamp(0.0, 1.0) } else { 0.0 }
}

/// The mean of a torque that decays so between two reports, `r + β (r⁺ - r)`: β = 1/(1-a) + 1/ln a, which is 1 for a
/// current loop that is there at once and 1/2 for a slow one. The command does not enter, so a limit in the drive is seen.
fn share_of_next(kept: f64) -> f64 {
    if kept < 1e-6 {
        1.0
    } else if kept > 0.98 {
        0.5
    } else {
        1.0 / (1.0 - kept) + 1.0 / libm::log(kept)
    }
}

/// The longest stretch with torque and without a gap, less its beginning; all rows if there never was torque.
fn usable(rows: &[Row]) -> &[Row] {
    let follows = |a: &Row, b: &Row| a.armed && b.armed && b.at.since(a.at) <= LONGEST_ROW;
    let longest = rows.chunk_by(follows).filter(|c| c[0].armed).max_by_key(|c| c.len());
    longest.map_or(rows, |stretch| {
        let from_s = stretch[0].t_s + SETTLING_S;
        &stretch[stretch.partition_point(|r| r.t_s < from_s)..]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::time::Span;

    #[test]
    fn mean_torque_between_reports_is_exact_for_a_lag_and_for_none() {
        for lag_s in [1e-9, 2e-4, 1e-3, 5e-3] {
            // Commands jump each millisecond; the drive reports its torque just before it takes the next over.
            let commands = [3.0, -7.0, 11.0, 2.0, 2.0, -9.0, 4.0];
            let a = libm::exp(-1e-3 / lag_s);
            let (mut torque, mut rows, mut means) = (0.0, Vec::new(), Vec::new());
            for (k, c) in commands.into_iter().enumerate() {
                let at = Stamp(0) + Span::from_ms(i64::try_from(k).unwrap());
                rows.push(row(at, c, torque));
                means.push(c + (torque - c) * (1.0 - a) * lag_s / 1e-3);
                torque = c + (torque - c) * a;
            }
            assert!((kept(&rows) - a).abs() < 1e-9, "{lag_s}");
            let beta = share_of_next(kept(&rows));
            for (pair, mean) in rows.windows(2).zip(means) {
                let ours = pair[0].reported_nm + beta * (pair[1].reported_nm - pair[0].reported_nm);
                assert!((ours - mean).abs() < 1e-3, "{lag_s}: {ours} against {mean}");
            }
        }
    }

    fn row(at: Stamp, command_nm: f64, reported_nm: f64) -> Row {
        Row {
            at,
            t_s: at.as_s(),
            hip_angle_rad: 0.0,
            command_nm,
            reported_nm,
            leg_rate_rad_s: f64::NAN,
            leg_angle_rad: f64::NAN,
            stance: 0.0,
            armed: true,
            steps: 0.0,
            doubt: 0.0,
            short_m: [0.0; 2],
        }
    }

    #[test]
    fn the_longest_armed_stretch_is_used_less_its_beginning() {
        let armed = |ms: std::ops::Range<i64>, armed| {
            ms.map(move |k| Row { armed, ..row(Stamp(0) + Span::from_ms(k), 0.0, 0.0) })
        };
        let rows: Vec<Row> = armed(0..2000, false)
            .chain(armed(2000..3000, true))
            .chain(armed(3000..3500, false))
            .chain(armed(3500..6000, true))
            .chain(armed(6000..9000, false))
            .collect();
        let used = usable(&rows);
        assert_eq!((used.len(), used[0].at), (2000, Stamp(0) + Span::from_ms(4000)));
        let never: Vec<Row> = armed(0..100, false).collect();
        assert_eq!(usable(&never).len(), 100);
    }

    #[test]
    fn a_file_that_is_no_recording_of_ours_is_told_so() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.mcap");
        std::fs::write(&path, "no magic here").unwrap();
        let text = Own::read(&path).unwrap_err().to_string();
        assert!(text.contains("x.mcap") && text.contains("is no MCAP file"), "{text}");
    }
}
