//! The laws that were found, as curves with their bands: friction over rate, force over position, error of a sensor.
//!
//! A curve shows everything of its kind that acts at the place, old and new together: what a person would measure there.
//! RT: no.

use crate::diagnose::explain::narrow::slopes;
use crate::diagnose::judge::verdict::{Law, Trace};
use crate::diagnose::library::laws::{self, Form};
use crate::diagnose::screen::score_test::pseudo_inverse;
use crate::identify::covariance::band_95;
use crate::identify::fitted_model::FittedModel;
use crate::model::rig::Rig;
use nalgebra::DVector;

/// Curves of the effects of `explained` from number `first` on.
#[must_use]
pub fn found(explained: &FittedModel, first: usize, traces: &[Trace]) -> Vec<Law> {
    let mut shown: Vec<(Form, &str)> = Vec::new();
    let mut out = Vec::new();
    for effect in &explained.rig.effects[first.min(explained.rig.effects.len())..] {
        let Some(form) = laws::form(effect.kind).filter(|f| !shown.contains(&(*f, effect.at.as_str()))) else {
            continue;
        };
        shown.push((form, &effect.at));
        out.extend(curve(explained, form, &effect.at, traces));
    }
    out
}

fn curve(of: &FittedModel, form: Form, at: &str, traces: &[Trace]) -> Option<Law> {
    let (low, high) = range(of, form, at, traces)?;
    let x: Vec<f64> = (0..Law::POINTS).map(|i| low + (high - low) * i as f64 / (Law::POINTS - 1) as f64).collect();
    let y: Vec<f64> = x.iter().map(|x| value(&of.rig, form, at, *x)).collect();
    let reach: Vec<f64> = deviations(of, form, at, &x).iter().map(|s| band_95() * s).collect();
    let (title, x_label, y_label) = labels(form, at);
    let edge = |sign: f64| y.iter().zip(&reach).map(|(y, r)| y + sign * r).collect();
    Some(Law { title, x_label, y_label, low: edge(-1.0), high: edge(1.0), x, y })
}

fn labels(form: Form, at: &str) -> (String, String, String) {
    let torque = "torque or force (Nm or N)".to_owned();
    match form {
        Form::Friction => (format!("Friction at {at} over rate"), format!("rate of {at} (rad/s or m/s)"), torque),
        Form::Force => (format!("Force at {at} over position"), format!("{at} (rad or m)"), torque),
        Form::Reading => {
            (format!("Error of {at} over position"), "position (rad or m)".into(), "reading - truth (rad or m)".into())
        }
        Form::Saturation => (format!("What comes of {at}"), "commanded (Nm or N)".into(), "applied (Nm or N)".into()),
    }
}

/// The range of the abscissa that the recordings cover.
fn range(of: &FittedModel, form: Form, at: &str, traces: &[Trace]) -> Option<(f64, f64)> {
    if form == Form::Saturation {
        let a = of.rig.actuators.iter().position(|a| a.column == at)?;
        let gain = of.rig.actuators[a].gain.value;
        let inputs = of.problem.recordings.iter().flat_map(|r| &r.inputs[a]);
        let peak = inputs.map(|u| (gain * u).abs()).filter(|x| x.is_finite()).fold(0.0, f64::max);
        return (peak > 0.0).then_some((-peak, peak));
    }
    let joint = |column: &str| of.rig.sensors.iter().find(|s| s.column == column).map(|s| (s.joint, s.is_rate));
    let wanted = of.rig.mechanism.coordinate_index(at).or_else(|| joint(at).map(|j| j.0))?;
    let mut all = Vec::new();
    for trace in traces {
        match (joint(&trace.channel), form) {
            (Some((j, true)), Form::Friction) if j == wanted => all.extend_from_slice(&trace.explained),
            (Some((j, false)), Form::Friction) if j == wanted => all.extend(slopes(&trace.t_s, &trace.explained)),
            (Some((j, false)), Form::Force | Form::Reading) if j == wanted => all.extend_from_slice(&trace.explained),
            _ => {}
        }
    }
    all.retain(|x| x.is_finite());
    all.sort_by(f64::total_cmp);
    // Restarts of windows make slopes that never were.
    let at = |q: f64| all.get((all.len().saturating_sub(1) as f64 * q) as usize).copied();
    let (low, high) = (at(0.005)?, at(0.995)?);
    let (low, high) = if form == Form::Friction { (-high.max(-low), high.max(-low)) } else { (low, high) };
    (high > low).then_some((low, high))
}

/// The law at one point.
fn value(rig: &Rig, form: Form, at: &str, x: f64) -> f64 {
    let here = rig.effects.iter().filter(|e| e.at == at && e.setup.is_none() && laws::form(e.kind) == Some(form));
    match form {
        Form::Saturation => here.filter_map(|e| e.get("limit")).fold(x, |x, v| x.clamp(-v.value, v.value)),
        _ => here.map(|e| laws::at(e, x)).sum(),
    }
}

/// Standard deviation of the law at each point: the covariance of all fitted numbers, carried along.
fn deviations(of: &FittedModel, form: Form, at: &str, x: &[f64]) -> Vec<f64> {
    let n = of.point.parameters.len();
    let covariance = pseudo_inverse(&of.information, 1e-10);
    let slopes: Vec<Vec<f64>> = (0..n).map(|i| by_parameter(of, form, at, (i, x))).collect();
    (0..x.len())
        .map(|k| {
            let slope = DVector::from_fn(n, |i, _| slopes[i][k]);
            libm::sqrt(slope.dot(&(&covariance * &slope)).max(0.0))
        })
        .collect()
}

/// Derivative of the law by parameter `i` of the fit, at each point, by a central difference.
fn by_parameter(of: &FittedModel, form: Form, at: &str, (i, x): (usize, &[f64])) -> Vec<f64> {
    let nudge = 1e-5 * of.point.parameters[i].abs().max(1e-6);
    let moved = |sign: f64| {
        let mut p = of.point.parameters.clone();
        p[i] += sign * nudge;
        of.problem.rig_at(&p)
    };
    let (up, down) = (moved(1.0), moved(-1.0));
    x.iter().map(|x| (value(&up, form, at, *x) - value(&down, form, at, *x)) / (2.0 * nudge)).collect()
}
