//! Where simulation and recording differ: recording, channel, interval, and for effects that act now and then, when.
//!
//! RT: no.

use crate::diagnose::explain::narrow::narrowed;
use crate::diagnose::judge::verdict::{Place, Trace};
use crate::identify::experiment::{Experiment, Recording};
use crate::model::effect::EffectKind;
use crate::model::rig::{Effect, Rig, Site};

/// A push by hand or by an obstacle lasts some tens of milliseconds; an instant is reported as this long.
const PUSH_S: f64 = 0.03;

/// What follows a touchdown (rebound, second contact) is over after this time.
const AFTER_TOUCHDOWN_S: f64 = 0.06;

/// Most places that are named.
const MOST_PLACES: usize = 12;

/// Places by what the found effects change in the readings, largest share first; with nothing found, by the residual
/// of the refitted model over its noise.
#[must_use]
pub fn places(experiment: &Experiment, traces: &[Trace], explained: &Rig, added: &[Effect]) -> Vec<Place> {
    let mut spans: Vec<(String, String, f64, f64)> = Vec::new();
    for effect in added {
        spans.extend(active(experiment, explained, effect));
    }
    let always = added.is_empty() || added.iter().any(|e| !is_event(e.kind));
    let busy: Vec<String> = spans.iter().map(|s| s.1.clone()).collect();
    if always {
        // Channels that an event already claims are left to it, unless there is no other.
        let free: Vec<&Trace> = traces.iter().filter(|t| t.use_ == "fit" && !busy.contains(&t.channel)).collect();
        for trace in free {
            if let Some((from, to)) = bulk(&trace.t_s, &mismatch(trace, added.is_empty())) {
                spans.push((trace.recording.clone(), trace.channel.clone(), from, to));
            }
        }
    }
    let found = ranked(spans, traces, added.is_empty());
    found.into_iter().map(|place| closer(experiment, traces, place, added.is_empty())).collect()
}

/// A place with phase, region and band where they narrow it.
fn closer(experiment: &Experiment, traces: &[Trace], place: Place, unexplained: bool) -> Place {
    let trace = traces.iter().find(|t| t.recording == place.recording && t.channel == place.channel);
    let recording = experiment.recordings.iter().find(|r| r.name == place.recording);
    let sensor = experiment.rig.sensors.iter().find(|s| s.column == place.channel);
    let (Some(trace), Some(recording), Some(sensor)) = (trace, recording, sensor) else { return place };
    let coordinate = experiment.rig.mechanism.coordinates()[sensor.joint];
    narrowed(place, trace, &mismatch(trace, unexplained), recording, (sensor, coordinate))
}

/// What is missing in the refitted simulation, row by row.
fn mismatch(trace: &Trace, unexplained: bool) -> Vec<f64> {
    let target = if unexplained { &trace.measured } else { &trace.explained };
    target.iter().zip(&trace.refitted).map(|(a, b)| if a.is_finite() { a - b } else { 0.0 }).collect()
}

/// The interval that holds the middle nine tenths of the energy.
fn bulk(t_s: &[f64], signal: &[f64]) -> Option<(f64, f64)> {
    let total: f64 = signal.iter().map(|x| x * x).sum();
    if total <= 0.0 {
        return None;
    }
    let mut sum = 0.0;
    let (mut from, mut to) = (0, signal.len() - 1);
    for (k, x) in signal.iter().enumerate() {
        sum += x * x;
        if sum < 0.05 * total {
            from = k;
        }
        if sum <= 0.95 * total {
            to = k;
        }
    }
    Some((t_s[from], t_s[(to + 1).min(t_s.len() - 1)]))
}

fn ranked(spans: Vec<(String, String, f64, f64)>, traces: &[Trace], unexplained: bool) -> Vec<Place> {
    let spread = |channel: &str| -> f64 {
        let all: Vec<f64> = traces
            .iter()
            .filter(|t| t.channel == channel)
            .flat_map(|t| &t.measured)
            .copied()
            .filter(|x| x.is_finite())
            .collect();
        let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
        (all.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / all.len().max(1) as f64).max(1e-300)
    };
    let energy = |trace: &Trace, from: f64, to: f64| -> f64 {
        let rows = mismatch(trace, unexplained);
        let inside = trace.t_s.iter().zip(&rows).filter(|(t, _)| **t >= from && **t <= to);
        inside.map(|(_, x)| x * x).sum::<f64>() / spread(&trace.channel)
    };
    let total: f64 = traces.iter().filter(|t| t.use_ == "fit").map(|t| energy(t, f64::MIN, f64::MAX)).sum();
    let mut out: Vec<Place> = spans
        .into_iter()
        .map(|(recording, channel, from_s, to_s)| {
            let trace = traces.iter().find(|t| t.recording == recording && t.channel == channel);
            let held = trace.map_or(0.0, |t| energy(t, from_s, to_s));
            let share = if total > 0.0 { (held / total).min(1.0) } else { 0.0 };
            Place { recording, channel, from_s, to_s, share, phase: None, region: None, band_hz: None }
        })
        .collect();
    out.sort_by(|a, b| b.share.total_cmp(&a.share));
    out.truncate(MOST_PLACES.max(out.iter().filter(|p| p.to_s - p.from_s < 0.5).count()));
    out
}

/// True for an effect that acts in intervals only.
#[must_use]
pub const fn is_event(kind: EffectKind) -> bool {
    matches!(
        kind,
        EffectKind::LostCounts | EffectKind::ExternalPush | EffectKind::TorqueLimit | EffectKind::ElasticImpact
    )
}

/// When an event-like effect acts: recording, channel, from, to.
fn active(experiment: &Experiment, rig: &Rig, effect: &Effect) -> Vec<(String, String, f64, f64)> {
    let Some(site) = rig.site(effect.kind, &effect.at) else { return Vec::new() };
    let channel = channel_of(rig, site);
    let value = |key: &str| effect.get(key).map_or(0.0, |v| v.value);
    let mut out = Vec::new();
    for recording in &experiment.recordings {
        let entry = &experiment.rig.recordings[recording.index];
        if !effect.acts_in(entry) {
            continue;
        }
        let end = recording.times[recording.len() - 1];
        let spans = match effect.kind {
            EffectKind::LostCounts => vec![(value("time"), end)],
            EffectKind::ExternalPush => vec![(value("time") - 0.5 * PUSH_S, value("time") + 0.5 * PUSH_S)],
            EffectKind::TorqueLimit => limited(rig, recording, site, value("limit")),
            EffectKind::ElasticImpact => touchdowns(recording),
            _ => Vec::new(),
        };
        out.extend(spans.into_iter().map(|(a, b)| (recording.name.clone(), channel.clone(), a, b)));
    }
    out
}

/// The channel that shows an effect at `site` first: the sensor itself, or one of the joint it acts on.
fn channel_of(rig: &Rig, site: Site) -> String {
    let joint = match site {
        Site::Sensor(s) => return rig.sensors[s].column.clone(),
        Site::Joint(j) => j,
        Site::Actuator(a) => rig.actuators[a].joint,
        Site::Ground => 0,
    };
    let near = rig.sensors.iter().find(|s| s.joint == joint).or_else(|| rig.sensors.first());
    near.map(|s| s.column.clone()).unwrap_or_default()
}

/// Intervals in which the command asks for more than `limit`.
fn limited(rig: &Rig, recording: &Recording, site: Site, limit: f64) -> Vec<(f64, f64)> {
    let Site::Actuator(a) = site else { return Vec::new() };
    let gain = rig.actuators[a].gain.value;
    runs(recording, |k| (gain * recording.inputs[a][k]).abs() > limit)
}

fn touchdowns(recording: &Recording) -> Vec<(f64, f64)> {
    recording.touchdowns().map(|row| (recording.times[row], recording.times[row] + AFTER_TOUCHDOWN_S)).collect()
}

/// Runs of rows where `on` holds, as times; gaps of up to three rows are bridged.
fn runs(recording: &Recording, on: impl Fn(usize) -> bool) -> Vec<(f64, f64)> {
    let mut out: Vec<(usize, usize)> = Vec::new();
    for k in (0..recording.len()).filter(|k| on(*k)) {
        match out.last_mut() {
            Some(last) if k <= last.1 + 3 => last.1 = k,
            _ => out.push((k, k)),
        }
    }
    let time = |k: usize| recording.times[k.min(recording.len() - 1)];
    out.into_iter().map(|(a, b)| (time(a), time(b + 1))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bulk_of_a_late_mismatch_is_late() {
        let t: Vec<f64> = (0..100).map(|k| f64::from(k) * 0.1).collect();
        let signal: Vec<f64> = (0..100).map(|k| if k >= 60 { 1.0 } else { 0.0 }).collect();
        let (from, to) = bulk(&t, &signal).unwrap();
        assert!((5.9..6.5).contains(&from) && (9.3..10.0).contains(&to), "{from} {to}");
    }
}
