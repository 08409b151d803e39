//! One run: robot and controller in lockstep until it falls or has done enough. RT: no.

use super::plan::Stop;
use crate::base::time::{Span, Stamp};
use crate::config::Resolved;
use crate::sim::lockstep::{Lockstep, LockstepError};
use crate::sim::outcome::Watch;
use crate::sim::outcome::fall::Cause;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A robot that walks makes a step within this, s; one that has made some and then none for so long stands.
const STALLED_S: f64 = 10.0;

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ended {
    /// All steps made, or the whole time on its feet if no steps were asked for.
    Completed,
    /// On its feet, but it stopped walking, or time ran out before the steps were made.
    Stalled,
    /// It never got torque.
    NotArmed,
    /// It fell, or lost its power.
    #[serde(untagged)]
    Fell(Cause),
}

impl Ended {
    /// As in `results.json`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::Stalled => "stalled",
            Self::NotArmed => "not_armed",
            Self::Fell(cause) => cause.name(),
        }
    }
}

/// A run in figures; the names are columns of `results.json` and are explained in `docs/experiments.md`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "docs/experiments.md explains the columns, units are in the names")]
pub struct RunRecord {
    pub index: usize,
    pub axes: BTreeMap<String, String>,
    pub controller: String,
    pub speed_m_s: Option<f64>,
    pub floor_m: f64,
    pub impulse_ns: Option<f64>,
    pub delta_v_m_s: Option<f64>,
    pub seed: u64,
    pub steps: u32,
    pub end: Ended,
    pub first_fault: String,
    /// Records of earlier versions lack it.
    #[serde(default)]
    pub not_armed_by: Option<String>,
    pub time_s: f64,
    pub distance_m: f64,
    /// Records of earlier versions lack it.
    #[serde(default)]
    pub first_step_s: Option<f64>,
    pub mean_speed_m_s: Option<f64>,
    pub cost_of_transport: Option<f64>,
    pub hip_work_j: f64,
    pub toe_work_j: f64,
    pub peak_torque_nm: f64,
    pub pushes: u32,
    pub missed_touchdowns: u32,
    pub invented_touchdowns: u32,
    pub wrong_leg_ticks: u64,
    pub longest_wrong_torque_ms: f64,
    pub worst_angle_error_rad: f64,
    pub worst_rate_error_rad_s: f64,
    pub law_share: BTreeMap<String, f64>,
    pub redraws: u32,
    pub config_hash: String,
    pub digest: String,
    pub set: Vec<String>,
}

/// What of a run is known before it: its place in the plan.
#[derive(Clone, Debug)]
pub struct Place {
    /// Number in the plan.
    pub index: usize,
    /// Axis → label.
    pub axes: BTreeMap<String, String>,
    /// Seed.
    pub seed: u64,
    /// Draws thrown away because no robot can start there.
    pub redraws: u32,
    /// All keys, drawn ones included.
    pub set: Vec<String>,
}

/// Runs it; `look` sees the part done now and then, and may stop it by `false`.
///
/// # Errors
/// [`LockstepError`] when there is nothing to step. `None` when `look` stopped it.
pub fn run(
    resolved: &Resolved,
    place: Place,
    stop: &Stop,
    mut look: impl FnMut(f64) -> bool,
) -> Result<Option<RunRecord>, LockstepError> {
    const LOOK_TICKS: u64 = 1000;
    let config = &resolved.config;
    let mut lockstep = Lockstep::new(config)?;
    let mut watch = Watch::new(config);
    let mut laws: BTreeMap<&'static str, u64> = BTreeMap::new();
    let end = Stamp::default() + Span::from_s(stop.time_s);
    let mut ticks = 0_u64;
    let ended = loop {
        if let Some(ended) = how_it_ended(&watch, stop, lockstep.now(), end) {
            break ended;
        }
        lockstep.step();
        let (record, plant) = lockstep.seen();
        watch.look(record, plant);
        if record.status.mode == crate::msg::Mode::Armed {
            *laws.entry(record.control.law.name()).or_default() += 1;
        }
        ticks += 1;
        if ticks.is_multiple_of(LOOK_TICKS) && !look(part_done(&watch, stop, lockstep.now())) {
            return Ok(None);
        }
    };
    Ok(Some(record(resolved, place, &lockstep, &watch, ended, &laws)))
}

fn how_it_ended(watch: &Watch, stop: &Stop, now: Stamp, end: Stamp) -> Option<Ended> {
    if let Some(cause) = watch.fall() {
        return Some(Ended::Fell(cause));
    }
    if stop.steps.is_some_and(|wanted| watch.footsteps.steps() >= wanted) {
        return Some(Ended::Completed);
    }
    let now_s = now.since(Stamp::default()).as_s();
    if stop.steps.is_some() && watch.footsteps.last_s().is_some_and(|last_s| now_s - last_s > STALLED_S) {
        return Some(Ended::Stalled);
    }
    (now >= end).then_some(match (watch.was_armed(), stop.steps) {
        (false, _) => Ended::NotArmed,
        (true, None) => Ended::Completed,
        (true, Some(_)) => Ended::Stalled,
    })
}

fn part_done(watch: &Watch, stop: &Stop, now: Stamp) -> f64 {
    let by_time = now.since(Stamp::default()).as_s() / stop.time_s;
    stop.steps
        .map_or(by_time, |wanted| (f64::from(watch.footsteps.steps()) / f64::from(wanted.max(1))).max(0.0))
        .min(1.0)
}

fn record(
    resolved: &Resolved,
    place: Place,
    lockstep: &Lockstep,
    watch: &Watch,
    end: Ended,
    laws: &BTreeMap<&'static str, u64>,
) -> RunRecord {
    let config = &resolved.config;
    let armed: u64 = laws.values().sum();
    let (_, plant) = lockstep.seen();
    let impulse_ns =
        config.simulation.random_pushes.map(|p| p.impulse_ns).or_else(|| plant.pushes().last().map(|p| p.1));
    let [hip_work_j, toe_work_j] = watch.effort.work_j();
    let [worst_angle_error_rad, worst_rate_error_rad_s] = watch.worst_error();
    let stretch_m = watch.footsteps.stretch().map(|(_, m)| m);
    #[expect(clippy::cast_precision_loss, reason = "ticks of some weeks")]
    let share = |n: u64| n as f64 / armed.max(1) as f64;
    RunRecord {
        index: place.index,
        axes: place.axes,
        controller: text_of(resolved, "control.controller").unwrap_or_default(),
        speed_m_s: text_of(resolved, "control.walk.speed_m_s").and_then(|t| t.parse().ok()),
        floor_m: text_of(resolved, "sim.floor.half_width_m").and_then(|t| t.parse().ok()).unwrap_or(0.0),
        impulse_ns,
        delta_v_m_s: impulse_ns.map(|p| p / config.body().total_mass_kg.value),
        seed: place.seed,
        steps: watch.footsteps.steps(),
        end,
        first_fault: lockstep.seen().0.status.first_fault.code.name().to_owned(),
        not_armed_by: watch.held_back_by().map(|blocker| config.robot.limits.told_at_arming(&blocker)),
        time_s: lockstep.now().since(Stamp::default()).as_s(),
        distance_m: watch.footsteps.distance_m(),
        first_step_s: watch.first_step_s(),
        mean_speed_m_s: watch.footsteps.mean_speed_m_s(),
        cost_of_transport: stretch_m.and_then(|m| watch.effort.cost_of_transport(m)),
        hip_work_j,
        toe_work_j,
        peak_torque_nm: watch.effort.peak_torque_nm(),
        pushes: watch.pushes(),
        missed_touchdowns: watch.agreement.missed(),
        invented_touchdowns: watch.agreement.invented(),
        wrong_leg_ticks: watch.agreement.wrong_ticks(),
        longest_wrong_torque_ms: 1e3 * watch.agreement.longest_wrong_torque_s(),
        worst_angle_error_rad,
        worst_rate_error_rad_s,
        law_share: laws.iter().map(|(law, n)| ((*law).to_owned(), share(*n))).collect(),
        redraws: place.redraws,
        config_hash: resolved.hash.clone(),
        digest: format!("{:016x}", lockstep.digest()),
        set: place.set,
    }
}

/// Value of a key in the canonical text, without quotes.
fn text_of(resolved: &Resolved, key: &str) -> Option<String> {
    let line = resolved.text.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(" = "))?;
    Some(line.trim_matches('"').to_owned())
}
