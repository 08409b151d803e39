//! `results.json`: every run, and what the runs of each combination of the axes say together. RT: no.

use super::statistics::{first_passage, wilson};
use super::trial_run::{Ended, RunRecord};
use crate::record::log_file::binary_hash;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Version of the layout of `results.json`.
const SCHEMA: u32 = 1;

/// What an experiment came to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// Layout of this file.
    pub schema: u32,
    /// What it is about.
    pub about: String,
    /// SHA-256 of the experiment's file.
    pub file_sha256: String,
    /// Version of the program.
    pub version: String,
    /// SHA-256 of its executable.
    pub binary_sha256: String,
    /// Runs that the plan asks for; fewer in `runs` = some are still to do.
    pub planned: usize,
    /// All runs, in the plan's order.
    pub runs: Vec<RunRecord>,
    /// Runs that differ by the seed alone, together.
    pub groups: Vec<Group>,
}

/// Runs that differ by the seed alone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Group {
    /// Axis → label.
    pub axes: BTreeMap<String, String>,
    /// Law that was asked for.
    pub controller: String,
    /// Commanded speed.
    pub speed_m_s: Option<f64>,
    /// Half width of the floor's heights.
    pub floor_m: f64,
    /// Impulse of the pushes; none where it is drawn, so that the runs differ.
    pub impulse_ns: Option<f64>,
    /// The same as change of the speed of the centre of mass, impulse over mass.
    pub delta_v_m_s: Option<f64>,
    /// Runs.
    pub runs: u32,
    /// Runs that did all that was asked.
    pub completed: u32,
    /// Their share, 95 % (Wilson).
    pub completed_interval: [f64; 2],
    /// Steps of all runs.
    pub steps: u64,
    /// Runs that ended before their time while walking.
    pub falls: u32,
    /// Steps per fall; none without a fall.
    pub mean_steps_to_fall: Option<f64>,
    /// 95 %: lower end, or N / 3 without a fall.
    pub steps_to_fall_low: f64,
    /// Upper end.
    pub steps_to_fall_high: Option<f64>,
    /// Pushes given, and those that no fall followed.
    pub pushes: u32,
    /// See `pushes`.
    pub pushes_survived: u32,
    /// Mean over the runs that walked.
    pub mean_speed_m_s: Option<f64>,
    /// Mean over the runs that walked.
    pub cost_of_transport: Option<f64>,
    /// Largest of all runs.
    pub peak_torque_nm: f64,
    /// How runs ended: cause → runs.
    pub ends: BTreeMap<String, u32>,
}

/// Runs that were not armed, told one by one.
const MOST_NOT_ARMED: usize = 5;

impl Results {
    /// Of the records of a plan with so many runs.
    #[must_use]
    pub fn new(about: &str, file_sha256: &str, planned: usize, runs: Vec<RunRecord>) -> Self {
        let mut groups: Vec<Vec<&RunRecord>> = Vec::new();
        for run in &runs {
            match groups.iter_mut().find(|group| group[0].axes == run.axes) {
                Some(group) => group.push(run),
                None => groups.push(vec![run]),
            }
        }
        Self {
            schema: SCHEMA,
            about: about.to_owned(),
            file_sha256: file_sha256.to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            binary_sha256: binary_hash().to_owned(),
            planned,
            groups: groups.iter().map(|runs| group(runs)).collect(),
            runs,
        }
    }

    /// Why runs were never armed, a sentence each; beyond some only how many more there are.
    #[must_use]
    pub fn not_armed(&self) -> Vec<String> {
        let told = self.runs.iter().filter_map(|run| {
            let why = run.not_armed_by.as_ref()?;
            Some(format!("Run {}, seed {}, was not armed: {why}.", run.index, run.seed))
        });
        let mut all: Vec<String> = told.collect();
        if all.len() > MOST_NOT_ARMED {
            let more = all.len() - MOST_NOT_ARMED;
            all.truncate(MOST_NOT_ARMED);
            all.push(format!("So were {more} more: not_armed_by in results.json."));
        }
        all
    }

    /// All that was planned for a shard (from 1, of so many) is there and every run of it completed.
    #[must_use]
    pub fn all_completed(&self, shard: [usize; 2]) -> bool {
        let planned = (0..self.planned).filter(|index| is_of(shard, *index)).count();
        let runs: Vec<&RunRecord> = self.runs.iter().filter(|run| is_of(shard, run.index)).collect();
        runs.len() == planned && runs.iter().all(|run| run.end == Ended::Completed)
    }
}

/// Whether a shard (from 1, of so many) does the run with this number.
pub(super) const fn is_of(shard: [usize; 2], index: usize) -> bool {
    index % shard[1] == shard[0] - 1
}

fn group(runs: &[&RunRecord]) -> Group {
    let first = runs[0];
    let count = |holds: &dyn Fn(&RunRecord) -> bool| {
        u32::try_from(runs.iter().filter(|r| holds(r)).count()).unwrap_or(u32::MAX)
    };
    let all = count(&|_| true);
    let completed = count(&|r| r.end == Ended::Completed);
    let falls = count(&|r| !matches!(r.end, Ended::Completed | Ended::NotArmed));
    let fell_by_push = count(&|r| r.end.name() == "push");
    let steps: u64 = runs.iter().map(|r| u64::from(r.steps)).sum();
    let passage = first_passage(steps, falls);
    let pushes: u32 = runs.iter().map(|r| r.pushes).sum();
    let mut ends = BTreeMap::new();
    for run in runs {
        *ends.entry(run.end.name().to_owned()).or_default() += 1;
    }
    Group {
        axes: first.axes.clone(),
        controller: first.controller.clone(),
        speed_m_s: first.speed_m_s,
        floor_m: first.floor_m,
        impulse_ns: common(runs.iter().map(|r| r.impulse_ns)),
        delta_v_m_s: common(runs.iter().map(|r| r.delta_v_m_s)),
        runs: all,
        completed,
        completed_interval: wilson(completed, all),
        steps,
        falls,
        mean_steps_to_fall: passage.mean_steps,
        steps_to_fall_low: passage.low_steps,
        steps_to_fall_high: passage.high_steps,
        pushes,
        pushes_survived: pushes.saturating_sub(fell_by_push),
        mean_speed_m_s: mean(runs.iter().filter_map(|r| r.mean_speed_m_s)),
        cost_of_transport: mean(runs.iter().filter_map(|r| r.cost_of_transport)),
        peak_torque_nm: runs.iter().map(|r| r.peak_torque_nm).fold(0.0, f64::max),
        ends,
    }
}

/// The value of all, if they agree.
fn common(mut values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let first = values.next()??;
    let is_first = |value: Option<f64>| value.is_some_and(|value| value.to_bits() == first.to_bits());
    values.all(is_first).then_some(first)
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, n) = values.fold((0.0, 0_u32), |(sum, n), x| (sum + x, n + 1));
    (n > 0).then(|| sum / f64::from(n))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::sim::outcome::fall::Cause;

    /// A run of a controller on a floor, as the lockstep might have told it.
    pub(in crate::experiment) fn run(
        index: usize,
        controller: &str,
        floor_m: f64,
        steps: u32,
        end: Ended,
    ) -> RunRecord {
        let axes = [("control.controller", controller.to_owned()), ("sim.floor.half_width_m", format!("{floor_m:?}"))];
        RunRecord {
            index,
            axes: axes.map(|(key, label)| (key.to_owned(), label)).into(),
            controller: controller.to_owned(),
            speed_m_s: Some(0.4),
            floor_m,
            impulse_ns: None,
            delta_v_m_s: None,
            seed: index as u64,
            steps,
            end,
            first_fault: "None".into(),
            not_armed_by: None,
            time_s: 0.6 * f64::from(steps),
            distance_m: 0.25 * f64::from(steps),
            first_step_s: Some(0.6),
            mean_speed_m_s: Some(0.41),
            cost_of_transport: Some(0.08),
            hip_work_j: 10.0,
            toe_work_j: 2.0,
            peak_torque_nm: 30.0,
            pushes: 0,
            missed_touchdowns: 0,
            invented_touchdowns: 0,
            wrong_leg_ticks: 3,
            longest_wrong_torque_ms: 4.0,
            worst_angle_error_rad: 0.02,
            worst_rate_error_rad_s: 0.3,
            law_share: [(controller.to_owned(), 1.0)].into(),
            redraws: 0,
            config_hash: "0".into(),
            digest: "0".into(),
            set: Vec::new(),
        }
    }

    #[test]
    fn a_group_counts_falls_and_censored_runs() {
        let runs = vec![
            run(0, "walk", 0.01, 1000, Ended::Completed),
            run(1, "walk", 0.01, 400, Ended::Fell(Cause::Scuff)),
            run(2, "walk", 0.02, 10, Ended::NotArmed),
        ];
        let results = Results::new("test", "0", 4, runs);
        let [rough, worst] = &results.groups[..] else { unreachable!("two groups") };
        assert_eq!((rough.runs, rough.completed, rough.falls, rough.steps), (2, 1, 1, 1400));
        assert_eq!(rough.mean_steps_to_fall, Some(1400.0));
        assert_eq!(rough.ends["scuff"], 1);
        assert_eq!((worst.falls, worst.completed), (0, 0));
        assert!(!results.all_completed([1, 1]));
    }

    #[test]
    fn an_impulse_is_told_only_where_all_runs_have_it() {
        let pushed = |impulse_ns: f64| RunRecord {
            impulse_ns: Some(impulse_ns),
            delta_v_m_s: Some(impulse_ns / 15.2),
            ..run(0, "walk", 0.0, 1, Ended::Completed)
        };
        let told = |runs: Vec<RunRecord>| {
            let group = &Results::new("test", "0", 2, runs).groups[0];
            (group.impulse_ns, group.delta_v_m_s.is_some())
        };
        assert_eq!(told(vec![pushed(2.0), pushed(2.0)]), (Some(2.0), true));
        assert_eq!(told(vec![pushed(2.0), pushed(-5.5)]), (None, false), "drawn by the seed");
        assert_eq!(told(vec![pushed(2.0), run(0, "walk", 0.0, 1, Ended::Completed)]), (None, false));
    }

    #[test]
    fn a_shard_is_judged_by_its_own_runs() {
        let fell = run(2, "walk", 0.01, 10, Ended::Fell(Cause::Scuff));
        let runs = vec![run(0, "walk", 0.01, 1000, Ended::Completed), fell, run(3, "walk", 0.01, 9, Ended::Completed)];
        let results = Results::new("test", "0", 6, runs);
        assert!(results.all_completed([1, 3]), "runs 0 and 3 are there and completed");
        assert!(!results.all_completed([2, 3]), "runs 1 and 4 are not there");
        assert!(!results.all_completed([3, 3]), "run 2 fell");
        assert!(!results.all_completed([1, 1]));
    }

    #[test]
    fn results_read_back_as_written() {
        let runs = vec![run(0, "walk", 0.01, 400, Ended::Fell(Cause::LiftOff)), run(1, "walk", 0.0, 9, Ended::Stalled)];
        let results = Results::new("test", "0", 2, runs);
        let text = serde_json::to_string(&results).unwrap();
        assert!(text.contains("\"end\":\"lift_off\"") && text.contains("\"end\":\"stalled\""));
        assert_eq!(serde_json::from_str::<Results>(&text).unwrap(), results);
    }
}
