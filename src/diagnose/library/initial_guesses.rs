//! The candidates of a round: the library, and what the linear scans propose (ripple orders, pushes, lost counts).
//!
//! RT: no.

use crate::diagnose::library::candidates::{Candidate, GENTLE, Key, library};
use crate::diagnose::screen::ltv::LtvWindow;
use crate::diagnose::screen::modes::flexibility;
use crate::diagnose::screen::scales::{JointScale, Scales};
use crate::diagnose::screen::scan::{Hit, jump, linear, push, ripple};
use crate::diagnose::screen::score_test::ScoreTest;
use crate::diagnose::screen::spectral_peaks::peaks_hz;
use crate::diagnose::screen::subsample::windows_of_a_first_look;
use crate::identify::fitted_model::FittedModel;
use crate::identify::noise::spread;
use crate::model::effect::EffectKind;
use crate::model::rig::{MechanismKind, Side};

/// Largest number of periods per turn (or per travel) of a torque ripple that is looked for.
const MOST_PERIODS: usize = 60;

/// A frequency, Hz, and a damping ratio at which something rings.
type Line = Hit<(f64, f64)>;

/// Every candidate on top of `now` that is not in its rig already. `fine`, `coarse`: under the noise that the residual
/// shows, and under white noise of its size. While something is missing the first takes what is slow in it for noise,
/// the second what is fast.
#[must_use]
pub fn candidates(
    now: &FittedModel,
    scales: &Scales,
    [fine, coarse]: [&ScoreTest; 2],
    windows: &[LtvWindow],
) -> Vec<Candidate> {
    let screen = fine;
    let mut all: Vec<Candidate> = library(scales).into_iter().filter(|c| !stands(now, c)).collect();
    let peaks_hz = peaks_hz(&now.residuals, windows);
    let narrow = |c: &Candidate, joint: &JointScale| {
        c.at == joint.name && ["link_flexibility", "joint_elasticity"].contains(&c.effect)
    };
    let some = windows_of_a_first_look(now, windows);
    let mut rings: Vec<(usize, Vec<Line>)> = Vec::new();
    for (j, joint) in scales.joints.iter().enumerate() {
        if all.iter().any(|c| narrow(c, joint)) {
            let lines = lines(now, scales, (screen, &some), j, &peaks_hz);
            all.iter_mut().filter(|c| narrow(c, joint)).for_each(|c| start_at_lines(c, joint, &lines));
            rings.push((j, lines));
        }
    }
    for (j, lines) in &rings {
        let elsewhere = |c: &&mut Candidate| c.effect == "link_flexibility" && c.at != scales.joints[*j].name;
        all.iter_mut().filter(elsewhere).for_each(|mode| start_at_other_lines(mode, lines));
    }
    for spring in all.iter_mut().filter(|c| c.effect == "parallel_spring") {
        if let Some(j) = scales.joints.iter().position(|joint| joint.name == spring.at) {
            start_at_line(spring, &linear(screen, windows, j).amplitudes);
        }
    }
    for (j, joint) in scales.joints.iter().enumerate() {
        if joint.borne {
            all.extend(ripple_candidates(scales, [fine, coarse], &some, j));
        }
        all.extend(push_candidate(now, scales, screen, windows, j));
    }
    for channel in 0..now.rig.sensors.len() {
        let Some(hit) = jump_of(now, scales, screen, windows, channel) else { continue };
        let of = scales.joints.iter().position(|j| {
            scales.sensors.iter().any(|s| s.joint == j.name && s.column == now.rig.sensors[channel].column)
        });
        all.extend(of.and_then(|j| kick_candidate(now, scales, windows, (j, &hit))));
        all.push(jump_candidate(now, scales, windows, (channel, &hit)));
        all.extend(sharp_jump(now, scales, channel));
    }
    all
}

/// Times the usual scatter from which a step between two rows is sharp.
const SHARP: f64 = 8.0;

/// Rows on either side of a step from which its slope is told.
const BESIDE: usize = 3;

/// Where the reading itself steps from one row to the next as no other two rows do: a base that the jump led astray shows it
/// somewhere else.
fn sharp_jump(now: &FittedModel, scales: &Scales, channel: usize) -> Option<Candidate> {
    let step = |y: &[f64]| {
        let (before, after) = (y[BESIDE] - y[0], y[2 * BESIDE + 1] - y[BESIDE + 1]);
        y[BESIDE + 1] - y[BESIDE] - 0.5 * (before + after) / BESIDE as f64
    };
    let steps: Vec<(usize, usize, f64)> = now
        .problem
        .recordings
        .iter()
        .enumerate()
        .flat_map(|(r, recording)| {
            let runs = recording.measured[channel].windows(2 * BESIDE + 2).map(step).enumerate();
            runs.map(move |(k, step)| (r, k + BESIDE + 1, step)).collect::<Vec<_>>()
        })
        .filter(|(.., step)| step.is_finite())
        .collect();
    let scatter = spread(&steps.iter().map(|(.., step)| *step).collect::<Vec<f64>>());
    let (r, k, step) = steps.into_iter().max_by(|a, b| a.2.abs().total_cmp(&b.2.abs()))?;
    let (recording, column) = (&now.problem.recordings[r], &now.rig.sensors[channel].column);
    let time = recording.times[k] - 0.5 * scales.step_s;
    let jump = single(
        "lost_counts",
        column,
        Some(recording.name.clone()),
        ("step", step),
        [time, time],
        vec![vec![step, time]],
    );
    (step.abs() > SHARP * scatter).then_some(jump)
}

/// True if the rig has this effect at this place as a free number already. A known one (a spring of the set-up) may
/// have company.
fn stands(now: &FittedModel, candidate: &Candidate) -> bool {
    let here = now.rig.effects.iter().filter(|e| e.kind.id() == candidate.effect && e.at == candidate.at);
    // A twin in motion that is already free leaves nothing to the other.
    let twin = candidate.effect == "friction_asymmetry"
        && now.rig.effects.iter().any(|e| e.kind == EffectKind::TorqueOffset && e.at == candidate.at);
    twin || here.into_iter().any(|e| e.values.iter().any(|v| v.is_free()))
}

/// Where something rings at joint `j`.
fn lines(
    now: &FittedModel,
    scales: &Scales,
    (screen, windows): (&ScoreTest, &[LtvWindow]),
    j: usize,
    peaks_hz: &[f64],
) -> Vec<Line> {
    // The second link of a chain turns by the sum of both angles.
    let chain = now.rig.mechanism == MechanismKind::DoublePendulum && j == 1;
    let absolute = if chain { vec![0, 1] } else { vec![j] };
    flexibility(screen, windows, &scales.joints[j], &absolute, peaks_hz)
}

/// Shares of the inertia that a rotor behind a ringing joint may have.
const ROTOR_SHARES: [f64; 3] = [0.05, 0.12, 0.3];

/// A mode or a spring has a narrow line, which a coarse grid would miss: it starts where a dense scan finds one.
fn start_at_lines(candidate: &mut Candidate, joint: &JointScale, lines: &[Line]) {
    let omega = |hit: &Line| 2.0 * std::f64::consts::PI * hit.at.0;
    let starts: Vec<Vec<f64>> = if candidate.effect == "link_flexibility" {
        lines.iter().map(|hit| vec![hit.at.0, hit.at.1, hit.score.amplitudes[0].clamp(0.003, 0.5)]).collect()
    } else {
        let spring = |hit: &Line, share: f64| {
            let reduced = share * (1.0 - share) * joint.inertia;
            vec![reduced * omega(hit).powi(2), 2.0 * hit.at.1 * reduced * omega(hit), share * joint.inertia]
        };
        lines.iter().take(2).flat_map(|hit| ROTOR_SHARES.map(|share| spring(hit, share))).collect()
    };
    let inside = |start: Vec<f64>| -> Vec<f64> {
        start.iter().zip(&candidate.keys).map(|(x, k)| x.clamp(k.min, k.max)).collect()
    };
    let starts: Vec<Vec<f64>> = starts.into_iter().map(inside).collect();
    if candidate.effect == "link_flexibility" && !starts.is_empty() {
        candidate.starts = starts;
    } else {
        // A stiff, well damped joint rings nowhere: its grid stays.
        candidate.starts.extend(starts);
    }
}

/// Shares of a link's inertia that a mode may have whose line another link showed better.
const MODE_SHARES: [f64; 2] = [0.03, 0.15];

/// A mode shakes the neighbours, too, and what the base has bent to may hide its line where it belongs.
fn start_at_other_lines(mode: &mut Candidate, lines: &[Line]) {
    let Some(hit) = lines.first() else { return };
    let starts = MODE_SHARES.map(|share| vec![hit.at.0, hit.at.1, share]);
    mode.starts.extend(starts.map(|s| s.iter().zip(&mode.keys).map(|(x, k)| x.clamp(k.min, k.max)).collect()));
}

/// The force of a spring is linear in its stiffness and in stiffness times rest, but bent in the two themselves: from a
/// weak spring a fit creeps along a valley of far rests. It starts at the linear solution as well.
fn start_at_line(spring: &mut Candidate, amplitudes: &[f64]) {
    let [stiffness, level] = amplitudes[..] else { return };
    let start = [stiffness, level / stiffness];
    if stiffness > 0.0 && start.iter().zip(&spring.keys).all(|(x, k)| (k.min..=k.max).contains(x)) {
        spring.starts.extend([start, [GENTLE * start[0], start[1]]].map(Vec::from));
    }
}

/// Orders worth trying: whole numbers per turn; on a rail, whole numbers per travel.
fn orders(scales: &Scales, joint: usize) -> Vec<f64> {
    let j = &scales.joints[joint];
    if j.turns {
        // Below one period per travel a ripple is a spring.
        let least = (std::f64::consts::PI / (2.0 * j.travel)).max(1.0).ceil() as usize;
        (least..=MOST_PERIODS).map(|n| n as f64).collect()
    } else {
        (2..=2 * MOST_PERIODS).map(|n| std::f64::consts::PI * n as f64 / (2.0 * j.travel)).collect()
    }
}

/// Times the amplitude of the scan from which a ripple starts: where friction holds the base, its tangent feels no force,
/// and where it follows a ripple it was mistuned for it; the scan then finds too little. A base that has made up for a
/// ripple is led astray by one of full size: a gentle one shows what the tangent promises.
const LOUDER: [f64; 3] = [1.0, 3.0, GENTLE];

/// Orders of a scan that are handed on: where the base is far from the truth, the order of a ripple is not the best.
const ORDERS: usize = 6;

fn ripple_candidates(scales: &Scales, screens: [&ScoreTest; 2], windows: &[LtvWindow], joint: usize) -> Vec<Candidate> {
    let orders = orders(scales, joint);
    let hits = screens.iter().flat_map(|screen| ripple(screen, windows, joint, &orders).into_iter().take(ORDERS));
    let mut out: Vec<Candidate> = Vec::new();
    for candidate in hits.map(|hit| ripple_candidate(scales, &hit, joint)) {
        // One order, one candidate, all starts.
        match out.iter_mut().find(|c| c.keys[1] == candidate.keys[1]) {
            Some(same) => {
                same.keys[0].max = same.keys[0].max.max(candidate.keys[0].max);
                same.starts.extend(candidate.starts);
            }
            None => out.push(candidate),
        }
    }
    out
}

fn ripple_candidate(scales: &Scales, hit: &Hit<f64>, joint: usize) -> Candidate {
    let (order, sine, cosine) = (hit.at, hit.score.amplitudes[0], hit.score.amplitudes[1]);
    let amplitude = libm::hypot(sine, cosine).max(1e-12);
    let free = |name, min, max| Key { name, min, max, log: false };
    let turns = scales.joints[joint].turns;
    let (min, max) = if turns { (order, order) } else { (0.9 * order, 1.1 * order) };
    let keys = vec![free("amplitude", 0.0, 30.0 * amplitude), free("order", min, max), free("phase", -12.0, 12.0)];
    let phase = libm::atan2(cosine, sine);
    Candidate {
        effect: "torque_ripple",
        at: scales.joints[joint].name.clone(),
        keys,
        starts: LOUDER.iter().map(|louder| vec![louder * amplitude, order, phase]).collect(),
        only: None,
        motor_sensor: None,
        side: Side::Link,
    }
}

fn file(now: &FittedModel, window: &LtvWindow) -> Option<String> {
    now.problem.recordings.get(window.recording).map(|r| r.name.clone())
}

/// Times the impulse of the scan from which a push starts.
const LOUD: [f64; 4] = [1.0, 2.0, 4.0, GENTLE];

/// A weak push in noise is seen that much too early or too late, s: seen 67 ms, where a deviation of its time was 13.
const REACH_S: f64 = 0.1;

fn push_candidate(
    now: &FittedModel,
    scales: &Scales,
    screen: &ScoreTest,
    windows: &[LtvWindow],
    joint: usize,
) -> Option<Candidate> {
    let Hit { at: (w, k), score } = push(screen, windows, joint)?;
    let (time, reach, impulse) = (windows[w].t_s[k], REACH_S.max(10.0 * scales.step_s), score.amplitudes[0]);
    // Where feet touch down the tangent feels a push too much: what it cannot follow it takes for less.
    let starts = LOUD.iter().map(|louder| vec![louder * impulse, time]).collect();
    Some(single(
        "external_push",
        &scales.joints[joint].name,
        file(now, &windows[w]),
        ("impulse", impulse),
        [time - reach, time + reach],
        starts,
    ))
}

/// A single event in one recording: how strong (its size is known to a factor) and between which times.
fn single(
    effect: &'static str,
    at: &str,
    only: Option<String>,
    (name, size): (&'static str, f64),
    [from_s, to_s]: [f64; 2],
    starts: Vec<Vec<f64>>,
) -> Candidate {
    let bound = 20.0 * size.abs().max(1e-12);
    let keys = vec![
        Key { name, min: -bound, max: bound, log: false },
        Key { name: "time", min: from_s, max: to_s, log: false },
    ];
    Candidate { effect, at: at.to_owned(), keys, starts, only, motor_sensor: None, side: Side::Link }
}

/// Where `channel` jumps and stays, if it can lose counts.
fn jump_of(
    now: &FittedModel,
    scales: &Scales,
    screen: &ScoreTest,
    windows: &[LtvWindow],
    channel: usize,
) -> Option<Hit<(usize, usize)>> {
    let sensor = &now.rig.sensors[channel];
    let counts = !sensor.is_rate && scales.sensors.iter().any(|s| s.column == sensor.column);
    if counts { jump(screen, windows, channel) } else { None }
}

/// How far from where a reading jumps a kick may lie, in rows: it comes before the joint rests again.
const KICK_ROWS: f64 = 60.0;

/// A push that moves joint `j` by as much as its reading jumps and leaves it there. The tangent of a joint that friction
/// holds feels no force, and a scan for pushes on it finds none.
fn kick_candidate(
    now: &FittedModel,
    scales: &Scales,
    windows: &[LtvWindow],
    (j, hit): (usize, &Hit<(usize, usize)>),
) -> Option<Candidate> {
    let joint = &scales.joints[j];
    let (w, k) = hit.at;
    let (step, rested_s) = (hit.score.amplitudes[0], windows[w].t_s[k]);
    // Friction takes the energy of the kick over the way.
    let impulse = libm::sqrt(2.0 * joint.inertia * joint.coulomb * step.abs()) * step.signum();
    if impulse.abs() <= 0.0 {
        return None;
    }
    let lasts_s = 2.0 * step * joint.inertia / impulse;
    let reach = KICK_ROWS * scales.step_s;
    let starts = [0.3, 0.6, 1.0].map(|part| vec![impulse, (rested_s - part * lasts_s).max(rested_s - reach)]);
    let times = [rested_s - reach, rested_s + 0.5 * reach];
    Some(single("external_push", &joint.name, file(now, &windows[w]), ("impulse", impulse), times, starts.to_vec()))
}

fn jump_candidate(
    now: &FittedModel,
    scales: &Scales,
    windows: &[LtvWindow],
    (channel, hit): (usize, &Hit<(usize, usize)>),
) -> Candidate {
    let ((w, k), step) = (hit.at, hit.score.amplitudes[0]);
    // The first row that shows it; the jump itself lies between it and the one before.
    let time = windows[w].t_s[k] - 0.5 * scales.step_s;
    let column = &now.rig.sensors[channel].column;
    single("lost_counts", column, file(now, &windows[w]), ("step", step), [time, time], vec![vec![step, time]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::screen::score_test::Score;

    #[test]
    fn a_mode_starts_at_the_best_line_of_another_link_within_its_range() {
        let key = |name, min, max| Key { name, min, max, log: false };
        let mut mode = Candidate {
            effect: "link_flexibility",
            at: "q2".into(),
            keys: vec![key("frequency", 1.5, 200.0), key("damping", 0.002, 0.5), key("participation", 0.0, 0.1)],
            starts: vec![vec![2.0, 0.08, 0.003]],
            only: None,
            motor_sensor: None,
            side: Side::Link,
        };
        let line = |hz: f64| Hit {
            at: (hz, 0.03),
            score: Score { gain: 1.0, amplitudes: vec![0.2], shrunken: vec![0.2], deviations: vec![0.1] },
        };
        start_at_other_lines(&mut mode, &[line(23.8), line(7.0)]);
        assert_eq!(mode.starts, [vec![2.0, 0.08, 0.003], vec![23.8, 0.03, 0.03], vec![23.8, 0.03, 0.1]]);
        start_at_other_lines(&mut mode, &[]);
        assert_eq!(mode.starts.len(), 3);
    }
}
