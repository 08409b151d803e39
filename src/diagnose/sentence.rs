//! What a person would say: effects, places and experiments in words.
//!
//! RT: no.

use crate::model::effect::{EffectKind, Key, Role};
use crate::report::findings::{Estimate, Member, Missing};
use crate::report::interval::{say_once, with_interval};
use crate::report::table::number;
use std::collections::BTreeMap;

/// Ratio of the ends of an interval from which its number is known by its order alone.
const DECADE: f64 = 10.0;

fn quantity(parameters: &BTreeMap<String, Estimate>, key: &str) -> String {
    parameters.get(key).map_or_else(|| "?".to_owned(), with_interval)
}

/// A time in ms.
fn milli(parameters: &BTreeMap<String, Estimate>, key: &str) -> String {
    let in_ms = |e: &Estimate| e.times(1e3).in_unit("ms");
    parameters.get(key).map_or_else(|| "?".to_owned(), |e| with_interval(&in_ms(e)))
}

/// What the intervals of a member leave open, as sentences: a strength that may be nothing, a number that is known by its order alone.
fn left_open(member: &Member) -> String {
    let Some(kind) = EffectKind::from_id(&member.effect) else { return String::new() };
    let known = |key: &Key| Some((words(key.name), key.min, key.role, *member.parameters.get(key.name)?));
    let reaches = |(name, min, role, of): &(String, f64, Role, Estimate)| match role {
        Role::Strength(nothing) if of.reaches(*nothing) => {
            Some(format!(" The interval of its {name} reaches {nothing}: it is not told from nothing."))
        }
        _ => (*min == 0.0 && of.reaches(0.0)).then(|| format!(" The interval of its {name} reaches 0.")),
    };
    let keys: Vec<_> = kind.keys().iter().filter_map(known).collect();
    let wide = keys.iter().filter(|(.., of)| of.low > 0.0 && of.high >= DECADE * of.low);
    let factors: Vec<String> =
        wide.map(|(name, .., of)| format!("{} for its {name}", factor(of.high / of.low))).collect();
    let mut text: String = keys.iter().filter_map(reaches).collect();
    if !factors.is_empty() {
        text += &format!(
            " The ends of the interval differ by a factor of {}: known to its order at best.",
            factors.join(", of ")
        );
    }
    text
}

/// A ratio with two digits.
fn factor(ratio: f64) -> String {
    let step = libm::pow(10.0, libm::floor(libm::log10(ratio)) - 1.0);
    number(step * libm::round(ratio / step))
}

/// Id or key as words.
#[must_use]
pub fn words(id: &str) -> String {
    id.replace('_', " ")
}

/// The effect in words, with its numbers.
#[must_use]
pub fn describe(member: &Member) -> String {
    use EffectKind as E;
    let (at, p) = (member.at.as_str(), &member.parameters);
    let n = |key: &str| quantity(p, key);
    let Some(kind) = EffectKind::from_id(&member.effect) else {
        return format!("physics at {at} that no effect of the library explains");
    };
    match kind {
        E::ViscousFriction
        | E::CoulombFriction
        | E::FrictionAsymmetry
        | E::StribeckFriction
        | E::LoadFriction
        | E::QuadraticDrag
        | E::Presliding
        | E::FrictionDrift => friction(kind, at, n),
        E::ParallelSpring => format!("a spring at {at} (stiffness {}, rest at {})", n("stiffness"), n("rest")),
        E::TorqueOffset => format!("a constant torque or force at {at} of {}", n("torque")),
        E::TorqueRipple => {
            format!("a torque at {at} that repeats with the angle ({}, order {})", n("amplitude"), n("order"))
        }
        E::ExternalPush => format!("a single push at {at} of {} at t = {}", n("impulse"), n("time")),
        E::JointElasticity | E::Backlash | E::LinkFlexibility => structure(kind, at, n),
        E::TorqueLimit => format!("a drive of {at} that saturates at {}", n("limit")),
        E::ActuatorLag => format!("a lag of the drive of {at} of {}", milli(p, "time_constant")),
        E::TransportDelay => format!("a command {at} that acts {} late", milli(p, "delay")),
        E::SensorLag => format!("a low-pass filter of {at} ({})", milli(p, "time_constant")),
        E::SensorDelay => format!("a sensor {at} that reads {} late", milli(p, "delay")),
        E::SensorBias => format!("a constant offset of {at} of {}", n("bias")),
        E::SensorDrift => format!("an offset of {at} that grows by {}", n("rate")),
        E::SensorScale => format!("a sensor {at} that reads {} times the truth", n("scale")),
        E::EncoderEccentricity => format!("a once-per-turn error of {at} of {}", n("amplitude")),
        E::LostCounts => format!("a jump of {at} by {} at t = {} that stays", n("step"), n("time")),
        E::ClockSkew => format!("a clock of {at} that runs fast by {}", n("skew")),
        E::FootSlip => format!("a stance toe that slides beyond a friction of {}", n("friction")),
        E::ElasticImpact => format!("a foot that rebounds at touchdown (restitution {})", n("restitution")),
        E::ToeCompliance => format!("a spring along the leg at the toe ({})", n("stiffness")),
        E::GroundSlope => format!("a tilt of the ground by {}", n("slope")),
        E::Counterweight => {
            format!("an upward force at the hip of {}: what falls weighs less than what swings", n("force"))
        }
        E::RoundFoot => format!("a toe that rolls as an arc of radius {}", n("radius")),
    }
}

/// Friction in words.
fn friction(kind: EffectKind, at: &str, n: impl Fn(&str) -> String) -> String {
    use EffectKind as E;
    let what = match kind {
        E::ViscousFriction => return format!("viscous friction at {at} ({})", n("viscous")),
        E::CoulombFriction => {
            return format!("Coulomb friction at {at} that holds and brakes with {}", n("coulomb"));
        }
        E::QuadraticDrag => {
            return format!("drag at {at} that grows with the square of the rate ({})", n("quadratic"));
        }
        E::FrictionAsymmetry => format!("differs by direction (half difference {})", n("difference")),
        E::StribeckFriction => {
            format!("falls with speed: {} more at rest, gone above a rate of {}", n("extra"), n("velocity"))
        }
        E::LoadFriction => format!("grows with the transmitted load ({} of it)", n("coefficient")),
        E::FrictionDrift => format!("changes with time ({} of its level)", n("rate")),
        _ => format!("gives elastically before it slips (stiffness {})", n("stiffness")),
    };
    format!("friction at {at} that {what}")
}

/// What gives between motor and link, or within the link, in words.
fn structure(kind: EffectKind, at: &str, n: impl Fn(&str) -> String) -> String {
    match kind {
        EffectKind::Backlash => {
            format!("play of {} between motor and link at {at} (rotor side inertia {})", n("gap"), n("rotor_inertia"))
        }
        EffectKind::LinkFlexibility => {
            let (hz, share) = (n("frequency"), n("participation"));
            format!("a structural mode of the link at {at} ({hz}, {share} of its inertia)")
        }
        _ => {
            let (stiffness, rotor) = (n("stiffness"), n("rotor_inertia"));
            format!("elasticity between motor and link at {at} (stiffness {stiffness}, rotor inertia {rotor})")
        }
    }
}

/// At which frequency a spring makes the machine ring.
#[must_use]
pub fn resonance(hz: f64) -> String {
    format!(" With it the machine rings at {hz:.1} Hz.")
}

/// One or two sentences for an entry: its best member, and what else it may be.
#[must_use]
pub fn entry(members: &[Member], removed: f64) -> String {
    let Some(best) = members.first() else { return String::new() };
    let share =
        if removed > 0.0 { format!(" It accounts for {:.0} % of the misfit.", 100.0 * removed) } else { String::new() };
    let head = format!("The simulation lacks {}.{share}{}", describe(best), left_open(best));
    if members.len() == 1 {
        return say_once(&head);
    }
    let others: Vec<String> = members[1..].iter().map(describe).collect();
    say_once(&format!("{head} This data cannot tell it from {}.", others.join(", nor from ")))
}

/// What was seen and is not named: the effect in words, the part of the misfit that it removes, and why it is no answer.
#[must_use]
pub fn seen(described: &str, share: f64, why: &str) -> String {
    say_once(&format!("Also seen, but {why}: {described}. It would account for {:.0} % of the misfit.", 100.0 * share))
}

/// The sentence of a mismatch for which no effect of determined strength was found.
#[must_use]
pub fn undetermined(at: &str, share: f64) -> String {
    format!(
        "At {at} acts something that makes {:.0} % of the misfit, but these recordings tell the strength of no effect that would \
         explain it from nothing: record with more motion there.",
        100.0 * share
    )
}

/// The sentence of an entry that the library does not explain.
#[must_use]
pub fn unlisted(at: &str, over: &str, share: f64) -> String {
    format!(
        "At {at} acts something that no effect of the library explains; {:.0} % of the misfit goes with {over}: look for {}.",
        100.0 * share,
        suspect(over)
    )
}

/// The sentence of a machine that is another one `from` some instant of a recording on; `numbers` that changed, with their
/// values before and after.
#[must_use]
pub fn changed(at: &str, (recording, from_s): (&str, f64), numbers: &[(String, f64, f64)]) -> String {
    let one = |(name, before, after): &(String, f64, f64)| format!("{name} {:+.1} %", 100.0 * (after / before - 1.0));
    let told: Vec<String> = numbers.iter().take(3).map(one).collect();
    format!(
        "From {from_s:.2} s of {recording} on the machine is another one at {at} ({}), which no effect of the library explains: \
         look for a load that was picked up or lost, a part that came loose.",
        told.join(", ")
    )
}

/// What a person would look for where a force goes with `over`.
fn suspect(over: &str) -> &'static str {
    if over.starts_with("the position") {
        "a magnet, a detent, a cable or a dent there"
    } else if over.starts_with("the rate") {
        "friction or drag of another form"
    } else if over.contains("vibration") {
        "what shakes or drives the machine from outside"
    } else {
        "what acts only at times: a load, a contact, a hand"
    }
}

/// What would tell the members of the first ambiguous entry apart.
#[must_use]
pub fn next_experiment(missing: &[Missing]) -> Option<String> {
    let entry = missing.iter().find(|m| m.one_of.len() > 1)?;
    let has = |effect: &str| entry.one_of.iter().any(|m| m.effect == effect);
    let at = entry.one_of.first().map_or("", |m| m.at.as_str());
    let text = if has("torque_offset") && has("friction_asymmetry") {
        format!(
            "Turn the mechanism round, or raise the command slowly from rest in both directions at {at} and note where it breaks away."
        )
    } else if has("sensor_bias") && (has("ground_slope") || has("torque_offset")) {
        "Turn the machine round on the same spot and record again: a slope changes sign, a sensor offset does not."
            .to_owned()
    } else if has("counterweight") && has("round_foot") {
        "Lean the leg far from upright (20 degrees and more), or take the support away: an arc rolls, a counterweight does not.".to_owned()
    } else if has("transport_delay") && (has("sensor_delay") || has("sensor_lag")) {
        "Add a second sensor on another clock, or log the drive's own current: a late command shows there, a late reading does not.".to_owned()
    } else if has("transport_delay") || has("actuator_lag") {
        "Command steps and a fast chirp up to a quarter of the sampling rate: a delay keeps its gain, a lag rolls off."
            .to_owned()
    } else if has("joint_elasticity") || has("link_flexibility") {
        "Block the output and drive a chirp through the resonance; then tap the link with the motor held.".to_owned()
    } else if has("stribeck_friction") || has("presliding") || has("load_friction") || has("coulomb_friction") {
        format!("Run {at} at a ladder of constant speeds in both directions, slow ones included, with two payloads.")
    } else if has("torque_offset") && has("parallel_spring") {
        format!("Hold or swing {at} about two positions far apart: a spring's torque changes, a constant one does not.")
    } else {
        format!("Record {at} again with motion of other speed, amplitude and load than so far.")
    };
    Some(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn member(effect: &str, key: &str, value: f64) -> Member {
        let parameters = BTreeMap::from([(key.to_owned(), Estimate::normal(value, 0.01 * value))]);
        Member { effect: effect.into(), at: "u_v".into(), weight: 0.5, parameters }
    }

    #[test]
    fn a_pair_is_said_as_a_pair_and_asks_for_the_deciding_experiment() {
        let pair = vec![member("transport_delay", "delay", 0.0038), member("actuator_lag", "time_constant", 0.0041)];
        let said = entry(&pair, 0.9);
        assert!(
            said.contains("acts 3.800 [95 % interval 3.726 to 3.874] ms late")
                && said.contains("cannot tell it from a lag"),
            "{said}"
        );
        let missing = [Missing { one_of: pair, sentence: said }];
        assert!(next_experiment(&missing).is_some_and(|e| e.contains("chirp")));
    }

    #[test]
    fn a_number_stands_with_its_interval_and_unit_and_an_open_one_is_said_to_be_open() {
        let of = |low: f64, high: f64| {
            let gap = Estimate { value: 1e-3, std: 1e-5, low, high, unit: "rad" };
            let parameters = BTreeMap::from([("gap".to_owned(), gap)]);
            entry(&[Member { effect: "backlash".into(), at: "q1".into(), weight: 1.0, parameters }], 1.0)
        };
        let sharp = of(0.9e-3, 1.1e-3);
        assert!(sharp.contains("play of 0.00100 [95 % interval 0.00090 to 0.00110] rad"), "{sharp}");
        assert!(!sharp.contains("known") && !sharp.contains("reaches"), "{sharp}");
        assert!(
            of(1e-4, 1e-2).contains(
                "The ends of the interval differ by a factor of 100 for its gap: known to its order at best."
            )
        );
        assert!(of(0.0, 2e-3).contains("The interval of its gap reaches 0: it is not told from nothing."));
    }

    #[test]
    fn what_was_seen_is_told_in_whole_sentences() {
        let said = seen("a drive of u that saturates at 3 Nm", 0.3, "refuted by recordings that were not fitted");
        let whole = "Also seen, but refuted by recordings that were not fitted: a drive of u that saturates at 3 Nm. It would \
                     account for 30 % of the misfit.";
        assert_eq!(said, whole);
    }

    #[test]
    fn a_force_without_a_name_says_what_to_look_for() {
        for (over, hint) in [
            ("the position of hip", "magnet"),
            ("the rate of hip", "friction"),
            ("time, like a vibration of 3.5 Hz", "shakes"),
            ("time", "load"),
        ] {
            let said = unlisted("hip", over, 0.5);
            assert!(said.contains(over) && said.contains("50 %") && said.contains(hint), "{said}");
        }
    }
}
