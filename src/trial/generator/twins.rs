//! What else explains the recordings of a hidden effect: the answers that are right beside itself. RT: no.
//!
//! A lookalike starts as visible as the truth, in either sense, and is re-fitted with all base parameters. It may come
//! from far: without the right size and sense at the start the fit would not arrive, and the trial would call decidable
//! what is not.

use super::case::Lab;
use super::dice::{Dice, NoiseKind};
use super::draw;
use super::effect::{Effect, NONE};
use super::experiment::{ROW_S, Recording};
use super::refit::refit_far;
use super::rig::Kind;

/// An alternative that leaves less than this cannot be told apart: five standard deviations of white noise.
const SAME: f64 = 25.0;

/// How many samples of coloured noise (a pole of .8) say as much of what is slow as one of white noise.
const COLOURED: f64 = 9.0;

/// A lookalike that, taken linearly, leaves more than this part of the truth is none and is not fitted.
const UNLIKE: f64 = 0.3;
/// Part of its drawn strength at which a lookalike is taken linearly.
const FAINT: f64 = 0.05;

/// The effect itself and what is exactly the same in every recording (contract section 3).
pub(super) fn exact(lab: &Lab, truth: &Effect) -> Vec<(String, String)> {
    let mut accepted = vec![(truth.id.to_owned(), truth.at.clone())];
    match truth.id {
        "torque_offset" => accepted.push(("friction_asymmetry".to_owned(), truth.at.clone())),
        "friction_asymmetry" => accepted.push(("torque_offset".to_owned(), truth.at.clone())),
        "transport_delay" if lab.rig.sensors.len() == 1 => {
            accepted.push(("sensor_delay".to_owned(), lab.rig.sensors[0].column.to_owned()));
        }
        _ => {}
    }
    accepted
}

/// Beside exact twins, what fits these recordings to within noise of that `kind` in the place of effect number `of`, the
/// others there.
pub(super) fn answers(lab: &Lab, effects: &[Effect], of: usize, kind: NoiseKind) -> Vec<(String, String)> {
    let truth = &effects[of];
    let told_apart = if kind == NoiseKind::Coloured { COLOURED * SAME } else { SAME };
    let mut accepted = exact(lab, truth);
    let recordings = lab.roughly_fitted(effects);
    let fit: Vec<&Recording> = recordings.iter().collect();
    let recorded: Vec<&[Vec<f64>]> = fit.iter().map(|r| r.clean.as_slice()).collect();
    let seen = lab.visibility(std::slice::from_ref(truth));
    let beside = |other: Effect| {
        let mut all = effects.to_vec();
        all[of] = other;
        all
    };
    for other in lookalikes(lab, truth) {
        // A derivative knows no sense and no size: one round instead of twenty.
        if lab.left_by(&beside(other.stronger(FAINT)), effects) > (UNLIKE * seen).max(told_apart) {
            continue;
        }
        let same = |start: &Effect| {
            let Some(start) = lab.about_as_visible(start, seen) else { return false };
            refit_far(&lab.rough(&beside(start)), &fit, &recorded).chi2 < told_apart
        };
        if same(&other) || other.turned().is_some_and(|turned| same(&turned)) {
            accepted.push((other.id.to_owned(), other.at));
        }
    }
    accepted
}

/// Effects that may look the same in one set of recordings, where they would stand.
fn lookalikes(lab: &Lab, truth: &Effect) -> Vec<Effect> {
    let here = |id: &'static str| vec![(id, truth.index, truth.at.clone())];
    let on_ground = |id: &'static str| vec![(id, NONE, "ground".to_owned())];
    let reading = |id: &'static str| vec![(id, 0, lab.rig.sensors[0].column.to_owned())];
    let driving = |id: &'static str| vec![(id, 0, lab.rig.joints[0].1.to_owned())];
    let alone = lab.rig.sensors.len() == 1 && lab.rig.joints.len() == 1;
    let walks = lab.rig.kind == Kind::Walker;
    let found = match truth.id {
        // With one sensor a late command is a late reading; how it is late shows in fast motion only.
        "transport_delay" if alone => [here("actuator_lag"), reading("sensor_delay"), reading("sensor_lag")].concat(),
        "actuator_lag" if alone => [here("transport_delay"), reading("sensor_delay"), reading("sensor_lag")].concat(),
        "sensor_lag" if alone => [here("sensor_delay"), driving("transport_delay"), driving("actuator_lag")].concat(),
        "sensor_delay" if alone => [here("sensor_lag"), driving("transport_delay"), driving("actuator_lag")].concat(),
        "transport_delay" => here("actuator_lag"),
        "actuator_lag" => here("transport_delay"),
        "sensor_lag" => here("sensor_delay"),
        "sensor_delay" => here("sensor_lag"),
        "stribeck_friction" => [here("quadratic_drag"), here("load_friction")].concat(),
        "quadratic_drag" | "load_friction" => here("stribeck_friction"),
        "parallel_spring" => {
            let angles = lab.rig.sensors.iter().enumerate().filter(|(_, sensor)| !sensor.is_rate);
            let biases = angles.map(|(i, sensor)| ("sensor_bias", i, sensor.column.to_owned()));
            here("torque_offset").into_iter().chain(biases).collect()
        }
        // On a rail without Coulomb friction a constant force is a constant speed more.
        "torque_offset" | "friction_asymmetry" if lab.rig.joints.len() == 1 && !walks => reading("sensor_drift"),
        "sensor_drift" if lab.rig.joints.len() == 1 && !walks => {
            vec![("torque_offset", 0, lab.rig.joints[0].0.to_owned())]
        }
        "encoder_eccentricity" => here("sensor_bias"),
        // An angle too large is a rate too small.
        "sensor_scale" => {
            let others = lab.rig.sensors.iter().enumerate().filter(|(i, _)| *i != truth.index);
            others.map(|(i, sensor)| ("sensor_scale", i, sensor.column.to_owned())).collect()
        }
        "sensor_bias" if lab.rig.joints.len() == 1 && !walks => {
            [here("encoder_eccentricity"), vec![("torque_offset", 0, lab.rig.joints[0].0.to_owned())]].concat()
        }
        "backlash" => here("joint_elasticity"),
        "link_flexibility" if lab.rig.kind != Kind::Biped => here("joint_elasticity"),
        "joint_elasticity" if lab.rig.kind != Kind::Biped => here("link_flexibility"),
        "counterweight" if walks => on_ground("round_foot"),
        "round_foot" => on_ground("counterweight"),
        "sensor_bias" if walks => [here("encoder_eccentricity"), on_ground("ground_slope")].concat(),
        "sensor_bias" => {
            let joints = (0..lab.rig.joints.len()).map(|i| ("torque_offset", i, lab.rig.joints[i].0.to_owned()));
            let legs = ["inner", "outer"].into_iter().enumerate().filter(|_| lab.rig.kind == Kind::Biped);
            let legs = legs.map(|(i, leg)| ("torque_offset", i, leg.to_owned()));
            here("encoder_eccentricity").into_iter().chain(joints).chain(legs).collect()
        }
        "torque_offset" | "friction_asymmetry" if !walks => {
            lab.rig.sensors.iter().enumerate().map(|(i, sensor)| ("sensor_bias", i, sensor.column.to_owned())).collect()
        }
        "ground_slope" => reading("sensor_bias"),
        "counterweight" => vec![("parallel_spring", lab.rig.stance(), ["inner", "outer"][lab.rig.stance()].to_owned())],
        _ => Vec::new(),
    };
    let duration_s = lab.rows as f64 * ROW_S;
    let drawn = |(id, index, at): (&'static str, usize, String)| {
        let other = draw::draw(&mut Dice::new(0, 0), &lab.rig, id, duration_s);
        Effect { index, at, ..other }
    };
    found.into_iter().map(drawn).collect()
}
