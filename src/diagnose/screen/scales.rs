//! How large things are in a case: read off the base solution, so that the candidates start where they matter.
//!
//! RT: no.

use crate::diagnose::screen::ltv::LtvWindow;
use crate::identify::experiment::Recording;
use crate::identify::fitted_model::FittedModel;
use crate::identify::rollout::Pooled;
use crate::model::effect::EffectKind;
use crate::model::rig::{MechanismKind, Setup};

/// How large things are on one joint over the fit recordings.
#[derive(Clone, Debug)]
pub struct JointScale {
    /// Coordinate.
    pub name: String,
    /// Largest applied torque, Nm or N.
    pub torque: f64,
    /// Root mean square of the rate, rad/s or m/s.
    pub rate: f64,
    /// Half of the travel, rad or m.
    pub travel: f64,
    /// Half of the travel within a window, the longest but a tenth of them.
    pub stroke: f64,
    /// Inertia seen at the joint, kg m² or kg.
    pub inertia: f64,
    /// Coulomb friction of the base, Nm or N.
    pub coulomb: f64,
    /// True if an actuator acts on it.
    pub driven: bool,
    /// True if it turns (torque ripple then repeats per turn).
    pub turns: bool,
    /// True if something stands still at its other side, in one recording at least: a bearing, a motor. A leg of a robot
    /// that only walks turns about nothing that could rub.
    pub borne: bool,
}

/// How large things are on one actuator.
#[derive(Clone, Debug)]
pub struct ActuatorScale {
    /// Column.
    pub column: String,
    /// Largest absolute torque or force that it applied.
    pub peak: f64,
}

/// How large things are on one sensor.
#[derive(Clone, Debug)]
pub struct SensorScale {
    /// Column.
    pub column: String,
    /// Coordinate that it reads.
    pub joint: String,
    /// Standard deviation of the reading.
    pub spread: f64,
    /// True if it reads a rate.
    pub of_rate: bool,
}

/// Everything that sets the scale of the candidates of one case.
#[derive(Clone, Debug)]
pub struct Scales {
    /// Coordinates.
    pub joints: Vec<JointScale>,
    /// Actuators.
    pub actuators: Vec<ActuatorScale>,
    /// Sensors.
    pub sensors: Vec<SensorScale>,
    /// Sampling interval, s.
    pub step_s: f64,
    /// Longest fit recording, s.
    pub duration_s: f64,
    /// Longest window, s.
    pub window_s: f64,
    /// Leg length if there is a ground, m.
    pub leg_m: Option<f64>,
    /// Weight carried by the ground, N.
    pub weight_n: f64,
    /// True if a recording has touchdowns.
    pub walks: bool,
}

/// Scales of a hypothesis and its tangent.
#[must_use]
pub fn scales(of: &FittedModel, windows: &[LtvWindow], pooled: &Pooled) -> Scales {
    let recordings = &of.problem.recordings;
    let steps: Vec<f64> = recordings.iter().flat_map(|r| r.times.windows(2).map(|p| p[1] - p[0])).collect();
    let compass = of.rig.mechanism == MechanismKind::CompassGait;
    let parameter = |name: &str| of.rig.mechanism.parameter_index(name).map_or(0.0, |i| of.rig.parameters[i].value);
    Scales {
        joints: (0..of.rig.mechanism.coordinates().len()).map(|j| joint(of, windows, j)).collect(),
        actuators: (0..of.rig.actuators.len())
            .map(|a| ActuatorScale { column: of.rig.actuators[a].column.clone(), peak: peak(of, a) })
            .collect(),
        sensors: (of.rig.sensors.iter().zip(&pooled.std))
            .filter(|(_, std)| std.is_finite() && **std > 0.0)
            .map(|(s, std)| SensorScale {
                column: s.column.clone(),
                joint: of.rig.mechanism.coordinates()[s.joint].into(),
                spread: *std,
                of_rate: s.is_rate,
            })
            .collect(),
        step_s: median(&steps),
        duration_s: recordings.iter().map(|r| r.times[r.len() - 1] - r.times[0]).fold(0.0, f64::max),
        window_s: of.problem.longest_s(),
        leg_m: compass.then(|| parameter("leg_length_m")),
        weight_n: parameter("total_mass_kg") * parameter("gravity_m_s2"),
        walks: recordings.iter().any(Recording::has_steps),
    }
}

fn median(all: &[f64]) -> f64 {
    let mut sorted = all.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(1e-3)
}

/// Largest torque or force that actuator `a` applied.
fn peak(of: &FittedModel, a: usize) -> f64 {
    let gain = of.rig.actuators[a].gain.value;
    of.problem.recordings.iter().flat_map(|r| &r.inputs[a]).map(|u| (gain * u).abs()).fold(0.0, f64::max)
}

fn joint(of: &FittedModel, windows: &[LtvWindow], j: usize) -> JointScale {
    let coordinates = of.rig.mechanism.coordinates().len();
    let column = |i: usize| -> Vec<f64> { windows.iter().flat_map(|w| w.states.iter().map(move |s| s[i])).collect() };
    let (angle, rate) = (column(j), column(coordinates + j));
    let extreme = |sign: f64| angle.iter().map(|x| sign * x).fold(f64::NEG_INFINITY, f64::max);
    let stroke = |w: &LtvWindow| {
        let extreme = |sign: f64| w.states.iter().map(|s| sign * s[j]).fold(f64::NEG_INFINITY, f64::max);
        0.5 * (extreme(1.0) + extreme(-1.0))
    };
    let mut strokes: Vec<f64> = windows.iter().map(stroke).collect();
    strokes.sort_by(f64::total_cmp);
    let stroke = strokes.get(strokes.len() * 9 / 10).copied().unwrap_or(0.0).max(1e-9);
    let driven: Vec<usize> = (0..of.rig.actuators.len()).filter(|a| of.rig.actuators[*a].joint == j).collect();
    let name = of.rig.mechanism.coordinates()[j];
    let coulomb = (of.rig.effects.iter().filter(|e| e.kind == EffectKind::CoulombFriction && e.at == name))
        .filter_map(|e| e.values.first())
        .map(|v| v.value)
        .sum();
    let travel = (0.5 * (extreme(1.0) + extreme(-1.0))).max(1e-9);
    let rate = libm::sqrt(rate.iter().map(|x| x * x).sum::<f64>() / rate.len().max(1) as f64);
    let inertia = inertia(windows, j);
    // Undriven, a joint's own inertia over its motion sets the scale.
    let inertial = inertia * rate * rate / travel;
    let torque = driven.iter().map(|a| peak(of, *a)).sum::<f64>().max(0.3 * inertial);
    let turns = of.rig.mechanism != MechanismKind::Slider;
    let borne = of.problem.recordings.iter().any(|r| is_borne(name, r.setup));
    let driven = !driven.is_empty();
    JointScale { name: name.into(), torque, rate, travel, stroke, inertia, coulomb, driven, turns, borne }
}

/// True if joint `name` has a bearing in this set-up: the hip always, a leg about a pinned toe or a held hip.
fn is_borne(name: &str, setup: Option<Setup>) -> bool {
    match name {
        "inner" => matches!(setup, Some(Setup::InnerStance | Setup::OuterFixed | Setup::Parallel)),
        "outer" => matches!(setup, Some(Setup::OuterStance | Setup::InnerFixed | Setup::Parallel)),
        _ => true,
    }
}

/// Inertia that a force at joint `j` feels: median over the rows of time over change of rate, where it moves at all (a
/// set-up may hold the joint).
fn inertia(windows: &[LtvWindow], j: usize) -> f64 {
    let mut all: Vec<(f64, f64)> = Vec::new();
    for w in windows {
        for k in (0..w.rows().saturating_sub(1)).step_by(7) {
            all.push((w.rates[j].dot(&w.gamma[k].column(j)).abs(), w.t_s[k + 1] - w.t_s[k]));
        }
    }
    let most = all.iter().map(|(change, dt)| change / dt).fold(0.0, f64::max);
    let moving = all.iter().filter(|(change, dt)| change / dt > 1e-3 * most).map(|(change, dt)| dt / change);
    let moving: Vec<f64> = moving.collect();
    if moving.is_empty() { 1.0 } else { median(&moving) }
}
