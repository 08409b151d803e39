//! The mark of one case whose truth is known. RT: no.

use std::f64::consts::PI;

use super::answer::{Answer, Entry, Member};
use super::interval::time_iou;
use super::truth::{Accepted, Hidden, Simulated};

/// What one simulated case earned. `None`: the question does not arise.
#[derive(Debug, Clone, Default)]
pub struct Mark {
    /// Nothing was hidden.
    pub healthy: bool,
    /// Something was hidden that no effect of the library explains.
    pub outside_library: bool,
    /// The truth itself is a set: this data cannot decide.
    pub undecidable: bool,
    /// The verdict is one of the right ones.
    pub verdict_right: bool,
    /// Every hidden effect is the heaviest member of an entry.
    pub top1: bool,
    /// Every hidden effect stands in the set of an entry.
    pub contained: bool,
    /// Undecidable, and said as a set of at least two of its twins.
    pub said_as_set: bool,
    /// Members per entry, of the entries that hold a hidden effect.
    pub set_sizes: Vec<usize>,
    /// Entries that hold no hidden effect.
    pub extra: usize,
    /// Relative errors of the leading parameter of each effect named first.
    pub leading_errors: Vec<f64>,
    /// The same over all its parameters.
    pub all_errors: Vec<f64>,
    /// Does its 95 % interval contain the truth? Of each parameter with one: `effect.key`.
    pub intervals: Vec<(String, bool)>,
    /// Time overlap of each effect that lives in intervals.
    pub time_iou: Vec<f64>,
    /// Part of the recoverable held-out error that was recovered.
    pub gain: Option<f64>,
}

impl Mark {
    /// A person would call this answer right: right verdict, nothing left out, nothing made up.
    pub fn right(&self) -> bool {
        self.verdict_right && self.extra == 0 && (self.healthy || self.outside_library || self.contained)
    }

    /// A healthy machine was called ill: the worst error.
    pub fn false_alarm(&self) -> bool {
        self.healthy && self.extra > 0
    }
}

fn accepts(accepted: &Accepted, member: &Member) -> bool {
    accepted.effect == member.effect && accepted.at.as_ref().is_none_or(|at| *at == member.at)
}

fn fits(hidden: &Hidden, member: &Member) -> bool {
    hidden.one_of.iter().any(|accepted| accepts(accepted, member))
}

/// Is this the effect itself, not one of its twins?
fn is_itself(hidden: &Hidden, member: &Member) -> bool {
    hidden.effect == member.effect && (hidden.at == member.at || hidden.effect == "unlisted")
}

/// How well `entry` answers `hidden`: 0 not at all, 1 contained, 2 named first, 3 named first and itself.
fn quality(hidden: &Hidden, entry: &Entry) -> u8 {
    let best = entry.best();
    if best.is_some_and(|member| is_itself(hidden, member)) {
        3
    } else if best.is_some_and(|member| fits(hidden, member)) {
        2
    } else {
        u8::from(entry.one_of.iter().any(|member| fits(hidden, member)))
    }
}

/// The entry that answers each hidden effect; no entry answers two.
fn matching(truth: &Simulated, answer: &Answer) -> Vec<Option<usize>> {
    let mut taken = vec![false; answer.missing.len()];
    let mut found = vec![None; truth.effects.len()];
    for level in (1..=3).rev() {
        for (slot, hidden) in found.iter_mut().zip(&truth.effects) {
            let free = |i: &usize| slot.is_none() && !taken[*i] && quality(hidden, &answer.missing[*i]) >= level;
            if let Some(entry) = (0..answer.missing.len()).find(free) {
                taken[entry] = true;
                *slot = Some(entry);
            }
        }
    }
    found
}

/// Relative error of a parameter. Phases err as a part of half a turn, times as seconds.
fn parameter_error(key: &str, truth: f64, found: f64) -> f64 {
    match key {
        "phase" => ((found - truth + PI).rem_euclid(2.0 * PI) - PI).abs() / PI,
        "time" => (found - truth).abs(),
        "amplitude" => (found.abs() - truth.abs()).abs() / truth.abs().max(f64::MIN_POSITIVE),
        _ => (found - truth).abs() / truth.abs().max(f64::MIN_POSITIVE),
    }
}

/// True if an interval contains the truth: a phase may be turns away, the sign of an amplitude is the phase's.
fn holds([low, high]: [f64; 2], key: &str, truth: f64) -> bool {
    let is_inside = |x: f64| (low..=high).contains(&x);
    match key {
        // The first of the truth's repetitions above the lower end.
        "phase" => is_inside(low + (truth - low).rem_euclid(2.0 * PI)),
        "amplitude" => is_inside(truth) || is_inside(-truth),
        _ => is_inside(truth),
    }
}

/// The key that says how strong the effect is: the first that the contract lists.
fn leading_key(effect: &str) -> &'static str {
    match effect {
        "viscous_friction" => "viscous",
        "coulomb_friction" => "coulomb",
        "friction_asymmetry" => "difference",
        "stribeck_friction" => "extra",
        "load_friction" => "coefficient",
        "quadratic_drag" => "quadratic",
        "presliding" | "parallel_spring" | "joint_elasticity" | "toe_compliance" => "stiffness",
        "friction_drift" | "sensor_drift" => "rate",
        "torque_offset" => "torque",
        "torque_ripple" | "encoder_eccentricity" => "amplitude",
        "backlash" => "gap",
        "link_flexibility" => "frequency",
        "external_push" => "impulse",
        "torque_limit" => "limit",
        "actuator_lag" | "sensor_lag" => "time_constant",
        "transport_delay" | "sensor_delay" => "delay",
        "sensor_bias" => "bias",
        "sensor_scale" => "scale",
        "lost_counts" => "step",
        "clock_skew" => "skew",
        "foot_slip" => "friction",
        "elastic_impact" => "restitution",
        "ground_slope" => "slope",
        "counterweight" => "force",
        "round_foot" => "radius",
        _ => "",
    }
}

/// Part of the recoverable held-out error that `nrmse_explained` recovered, channels weighted by what each could gain.
/// Channels that could gain less than 5 % say nothing and are left out.
fn gain(truth: &Simulated, answer: &Answer) -> Option<f64> {
    let (mut gained, mut possible) = (0.0, 0.0);
    for channel in truth.heldout.iter().filter(|channel| channel.recoverable >= 0.05) {
        let row = answer.fit.iter().find(|row| row.recording == channel.recording && row.channel == channel.channel)?;
        gained += channel.nrmse_refitted - row.nrmse_explained?;
        possible += channel.nrmse_refitted - channel.nrmse_floor;
    }
    (possible > 0.0).then(|| (gained / possible).clamp(-1.0, 1.0))
}

fn note_parameters(mark: &mut Mark, hidden: &Hidden, member: &Member) {
    for (key, truth) in &hidden.parameters {
        let Some(found) = member.parameters.get(key) else { continue };
        let error = parameter_error(key, *truth, found.value);
        mark.all_errors.push(error);
        let told = found.interval().map(|interval| holds(interval, key, *truth));
        mark.intervals.extend(told.map(|holds| (format!("{}.{key}", hidden.effect), holds)));
        if key == leading_key(&hidden.effect) {
            mark.leading_errors.push(error);
        }
    }
}

fn note_entry(mark: &mut Mark, hidden: &Hidden, entry: &Entry) {
    mark.set_sizes.push(entry.one_of.len());
    mark.top1 &= quality(hidden, entry) >= 2;
    let twins = entry.one_of.iter().filter(|member| fits(hidden, member)).count();
    mark.said_as_set |= hidden.one_of.len() > 1 && twins > 1;
    if let Some(member) = entry.best().filter(|member| is_itself(hidden, member)) {
        note_parameters(mark, hidden, member);
    }
}

/// Marks one answer against the truth.
pub fn mark(truth: &Simulated, answer: &Answer) -> Mark {
    let found = matching(truth, answer);
    let outside_library = truth.effects.iter().any(|hidden| hidden.effect == "unlisted");
    let mut mark = Mark {
        healthy: truth.effects.is_empty(),
        outside_library,
        undecidable: truth.effects.iter().any(|hidden| hidden.one_of.len() > 1),
        verdict_right: truth.verdict.contains(&answer.verdict),
        top1: found.iter().all(Option::is_some),
        contained: found.iter().all(Option::is_some),
        extra: answer.missing.len() - found.iter().flatten().count(),
        gain: gain(truth, answer).filter(|_| !outside_library),
        ..Mark::default()
    };
    for (hidden, entry) in truth.effects.iter().zip(&found) {
        if let Some(entry) = entry {
            note_entry(&mut mark, hidden, &answer.missing[*entry]);
        }
        if hidden.localised && !hidden.active.is_empty() {
            mark.time_iou.push(time_iou(&hidden.active, &answer.places));
        }
    }
    mark
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPRING: &str = r#"{"verdict":["ambiguous","explained"],"effects":[{"effect":"parallel_spring","at":"q1",
        "one_of":[{"effect":"parallel_spring","at":"q1"},{"effect":"torque_offset","at":"q1"}],
        "parameters":{"stiffness":2.0,"rest":0.5}}],
        "heldout":[{"recording":"c","channel":"q","nrmse_refitted":0.5,"nrmse_floor":0.1,"recoverable":0.8}]}"#;

    fn answer(verdict: &str, missing: &str) -> Answer {
        serde_json::from_str(&format!(
            r#"{{"schema":1,"verdict":"{verdict}","where":[],"missing":{missing},"seconds":1.0,
            "fit":[{{"recording":"c","use":"heldout","channel":"q",
            "nrmse_given":1.0,"nrmse_refitted":0.5,"nrmse_explained":0.2}}]}}"#
        ))
        .unwrap()
    }

    fn truth(text: &str) -> Simulated {
        serde_json::from_str(text).unwrap()
    }

    #[test]
    fn right_effect_with_its_value_earns_everything() {
        let entry = r#"[{"one_of":[{"effect":"parallel_spring","at":"q1","weight":0.9,
            "parameters":{"stiffness":{"value":2.2,"std":0.1}}}]}]"#;
        let mark = mark(&truth(SPRING), &answer("explained", entry));
        assert!(mark.right() && mark.top1 && mark.contained && !mark.said_as_set);
        assert!((mark.leading_errors[0] - 0.1).abs() < 1e-12);
        assert!((mark.gain.unwrap() - 0.75).abs() < 1e-12);
        // 2.2 +- 1.96 x 0.1 does not reach 2.
        assert_eq!(mark.intervals, [("parallel_spring.stiffness".to_owned(), false)]);
    }

    #[test]
    fn intervals_are_those_that_are_told_and_phases_turn() {
        let found = |text: &str| serde_json::from_str::<crate::trial::score::Found>(text).unwrap().interval();
        assert_eq!(found(r#"{"value":2.0}"#), None);
        assert_eq!(found(r#"{"value":2.0,"std":0.1,"low":1.0,"high":9.0}"#), Some([1.0, 9.0]));
        assert!(holds([1.0, 9.0], "stiffness", 8.0) && !holds([1.0, 9.0], "stiffness", 9.1));
        assert!(holds([3.0, 3.4], "phase", 3.2 - 2.0 * PI) && !holds([3.0, 3.4], "phase", 2.9));
        assert!(holds([-0.3, -0.1], "amplitude", 0.2));
    }

    #[test]
    fn pair_said_as_pair_is_noticed() {
        let entry = r#"[{"one_of":[{"effect":"torque_offset","at":"q1","weight":0.4},
            {"effect":"parallel_spring","at":"q1","weight":0.6}]}]"#;
        let mark = mark(&truth(SPRING), &answer("ambiguous", entry));
        assert!(mark.right() && mark.said_as_set);
        assert_eq!(mark.set_sizes, [2]);
    }

    #[test]
    fn wrong_place_is_wrong() {
        let entry = r#"[{"one_of":[{"effect":"parallel_spring","at":"q2","weight":1.0}]}]"#;
        let mark = mark(&truth(SPRING), &answer("explained", entry));
        assert!(!mark.right() && !mark.contained && mark.extra == 1);
    }

    #[test]
    fn naming_anything_on_a_healthy_case_is_a_false_alarm() {
        let healthy = truth(r#"{"verdict":["consistent"],"effects":[]}"#);
        assert!(
            mark(&healthy, &answer("explained", r#"[{"one_of":[{"effect":"backlash","at":"q1"}]}]"#)).false_alarm()
        );
        let refitted = mark(&healthy, &answer("parameters", "[]"));
        assert!(!refitted.false_alarm() && !refitted.right());
    }

    #[test]
    fn one_entry_cannot_answer_two_effects() {
        let two = truth(
            r#"{"verdict":["explained"],"effects":[
            {"effect":"torque_ripple","at":"q1","one_of":[{"effect":"torque_ripple","at":"q1"}]},
            {"effect":"torque_ripple","at":"q1","one_of":[{"effect":"torque_ripple","at":"q1"}]}]}"#,
        );
        let once = mark(&two, &answer("explained", r#"[{"one_of":[{"effect":"torque_ripple","at":"q1"}]}]"#));
        assert!(!once.contained);
    }
}
