//! The first sentences of a diagnosis: what the missing physics costs, then what it is.
//!
//! A number at its bound and a strength that its interval does not tell from nothing stand in no headline: what is said
//! of them is just that.
//! RT: no.

use crate::diagnose::judge::verdict::{Diagnosis, Estimate, Member, Missing, ParameterLine, Trace, Verdict};
use crate::diagnose::sentence::words;
use crate::model::effect::{EffectKind, Role};
use crate::model::rig::{Rig, Sensor};
use crate::report::interval::{beside, say_once, value, with_interval, with_unit};
use crate::report::table::number;

/// Numbers that a headline tells; the page has all.
const TOLD: usize = 3;

/// Error of free runs in a channel, in its unit, over the recordings that were kept back (all, if none were).
#[derive(Clone, Debug, PartialEq)]
pub struct Cost {
    /// Sensor column.
    pub channel: String,
    /// Root mean square of the rig as given; infinite where it runs away.
    pub given: f64,
    /// The same with its numbers fitted again.
    pub refitted: f64,
    /// The same with what was found.
    pub explained: f64,
    /// Thousandths of what: `mrad`, `mm`, `mrad/s`, `mm/s`.
    pub unit: String,
    /// Were the recordings kept back from the fit?
    pub is_heldout: bool,
}

/// What free runs miss in each channel.
#[must_use]
pub fn costs(rig: &Rig, traces: &[Trace]) -> Vec<Cost> {
    let is_heldout = traces.iter().any(|t| t.use_ == "heldout");
    let one = |sensor: &Sensor| {
        let of = || traces.iter().filter(|t| t.channel == sensor.column && (!is_heldout || t.use_ == "heldout"));
        let rms = |run: fn(&Trace) -> &Vec<f64>| {
            let errors = of().flat_map(|t| run(t).iter().zip(&t.measured).map(|(p, y)| p - y));
            let (count, sum) = errors.filter(|e| e.is_finite()).fold((0.0, 0.0), |(n, s), e| (n + 1.0, s + e * e));
            libm::sqrt(sum / count)
        };
        let runs_away = |t: &Trace| t.given.iter().zip(&t.refitted).any(|(g, r)| r.is_finite() && !g.is_finite());
        let given = if of().any(runs_away) { f64::INFINITY } else { rms(|t| &t.given) };
        let (refitted, explained) = (rms(|t| &t.refitted), rms(|t| &t.explained));
        let unit = format!("m{}", sensor.unit(rig.mechanism));
        Cost { channel: sensor.column.clone(), given, refitted, explained, unit, is_heldout }
    };
    rig.sensors.iter().map(one).filter(|c| c.refitted.is_finite() && c.explained.is_finite()).collect()
}

/// One to three sentences for the head of the page. `leaves_misfit`: what is left is smooth, no noise.
#[must_use]
pub fn headline(diagnosis: &Diagnosis, lines: &[ParameterLine], costs: &[Cost], leaves_misfit: bool) -> String {
    let said: Vec<String> = match diagnosis.verdict {
        Verdict::Consistent | Verdict::Parameters if leaves_misfit => vec![
            "Nothing that was tried explains the recordings better than the simulation itself and holds where it was not \
             fitted. But what is left is no noise: the simulation may compute otherwise than the machine moves, or lack what \
             this library lacks too."
                .into(),
        ],
        Verdict::Consistent => {
            vec!["The simulation as given explains the recordings to within their noise. Nothing is missing.".into()]
        }
        Verdict::Parameters => vec![
            "With its parameters fitted again the simulation explains the recordings to within their noise. No physics is \
             missing."
                .into(),
        ],
        Verdict::Explained | Verdict::Ambiguous | Verdict::Unlisted => {
            let cost = costs.iter().max_by(|a, b| weight(a).total_cmp(&weight(b))).map(cost_in_words);
            let entries = diagnosis.missing.iter().map(|entry| said_of(entry, lines));
            cost.into_iter().chain(entries).collect()
        }
    };
    let other = if diagnosis.verdict == Verdict::Consistent { None } else { other_numbers(lines) };
    let seen = diagnosis.seen.iter().map(|s| s.sentence.clone());
    say_once(&said.into_iter().chain(other).chain(seen).collect::<Vec<_>>().join(" "))
}

/// The given numbers that their 95 % interval does not reach, and that are written otherwise; the surest first.
fn other_numbers(lines: &[ParameterLine]) -> Option<String> {
    let distance = |l: &ParameterLine| (l.explained.value - l.given).abs() / (l.explained.high - l.explained.low);
    let is_other = |l: &&ParameterLine| {
        let is_written_alike = beside(&l.explained, l.given) == value(&l.explained);
        !l.at_bound && distance(l).is_finite() && !l.explained.reaches(l.given) && !is_written_alike
    };
    let mut others: Vec<&ParameterLine> = lines.iter().filter(is_other).collect();
    others.sort_by(|a, b| distance(b).total_cmp(&distance(a)));
    let one = |l: &&ParameterLine| {
        format!("{} {} (given {})", l.name, with_interval(&l.explained), beside(&l.explained, l.given))
    };
    let told: Vec<String> = others.iter().take(TOLD).map(one).collect();
    (!told.is_empty()).then(|| format!("Numbers that are not as given: {}.", told.join(", ")))
}

/// The channel that shows most is the one that gains most; angles and positions before rates, which few can picture.
fn weight(cost: &Cost) -> f64 {
    let gained = 1.0 - cost.explained / cost.refitted.max(f64::MIN_POSITIVE);
    if cost.unit.ends_with("/s") { gained - 1.0 } else { gained }
}

/// The error as given, with its numbers fitted again, and with what was found; of two that are written alike the first alone.
fn cost_in_words(cost: &Cost) -> String {
    let Cost { channel, given, refitted, explained, unit, is_heldout } = cost;
    let milli = |x: f64| number(1e3 * x);
    let (as_given, again, with_all) = (milli(*given), milli(*refitted), milli(*explained));
    let what = if *is_heldout { "recordings that were never fitted" } else { "the fitted recordings" };
    let mut text = format!("On {what} the simulation as given ");
    text += &if given.is_finite() { format!("misses {channel} by {as_given} {unit}") } else { "runs away".to_owned() };
    if again != as_given {
        let channel = if given.is_finite() { String::new() } else { format!("misses {channel} ") };
        text += &format!(", with re-fitted parameters {channel}by {again} {unit}");
    }
    if explained < refitted && with_all != again {
        text += &format!(", with the missing physics by {with_all} {unit}");
    }
    text + "."
}

/// The sentence of an entry, or, where its numbers say too little, only that.
fn said_of(entry: &Missing, lines: &[ParameterLine]) -> String {
    let best = entry.one_of.first();
    let Some(best) = best else { return entry.sentence.clone() };
    match doubt(best, lines) {
        None => entry.sentence.clone() + &further(best, lines),
        Some(why) => {
            let named: Vec<String> = entry.one_of.iter().map(|m| format!("{} at {}", words(&m.effect), m.at)).collect();
            format!("Perhaps {} is missing: {why}.", named.join(" or "))
        }
    }
}

/// Why the size of a member is no finding by itself: of its first key, which says how strong it is.
fn doubt(member: &Member, lines: &[ParameterLine]) -> Option<String> {
    let key = EffectKind::from_id(&member.effect)?.keys().first()?;
    let estimate = member.parameters.get(key.name)?;
    if matches!(key.role, Role::Strength(nothing) if estimate.reaches(nothing)) {
        return Some(interval_in_words(key.name, estimate));
    }
    at_bound(member, key.name, lines)
}

/// That a number of a member ran to a bound other than zero, which is where nature ends.
fn at_bound(member: &Member, key: &str, lines: &[ParameterLine]) -> Option<String> {
    let name = format!("{}@{}.{key}", member.effect, member.at);
    let line = lines.iter().find(|l| l.name == name && l.at_bound && l.explained.value != 0.0)?;
    let bound = with_unit(&number(line.explained.value), line.explained.unit);
    Some(format!("its {} ran to {bound}, the bound of the search", words(key)))
}

/// The same of its further numbers, as a sentence.
fn further(member: &Member, lines: &[ParameterLine]) -> String {
    let others = member.parameters.keys().filter_map(|key| at_bound(member, key, lines));
    others.map(|why| format!(" In this, {why}.")).collect()
}

fn interval_in_words(key: &str, estimate: &Estimate) -> String {
    format!("its {} of {} is not told from nothing", words(key), with_interval(estimate))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spring(stiffness: Estimate) -> Missing {
        let parameters = [("stiffness".to_owned(), stiffness), ("rest".to_owned(), Estimate::normal(0.1, 0.01))].into();
        let member = Member { effect: "parallel_spring".into(), at: "q1".into(), weight: 1.0, parameters };
        Missing { one_of: vec![member], sentence: "The simulation lacks a spring.".into() }
    }

    fn line(at_bound: bool) -> ParameterLine {
        ParameterLine {
            name: "parallel_spring@q1.stiffness".into(),
            given: f64::NAN,
            refitted: f64::NAN,
            explained: Estimate::normal(5.0, 0.1),
            at_bound,
        }
    }

    #[test]
    fn what_leaves_smooth_misfit_is_not_called_explained_to_within_its_noise() {
        let healthy = Diagnosis {
            schema: 1,
            verdict: Verdict::Parameters,
            places: Vec::new(),
            missing: Vec::new(),
            seen: Vec::new(),
            rejected: Vec::new(),
            next_experiment: None,
            fit: Vec::new(),
            seconds: 0.0,
            seed: 0,
        };
        assert!(headline(&healthy, &[], &[], false).contains("to within their noise"));
        let said = headline(&healthy, &[], &[], true);
        assert!(said.contains("what is left is no noise") && !said.contains("No physics is missing"), "{said}");
    }

    #[test]
    fn a_strength_that_its_interval_does_not_tell_from_nothing_is_a_perhaps() {
        assert_eq!(said_of(&spring(Estimate::normal(5.0, 0.1)), &[line(false)]), "The simulation lacks a spring.");
        let weak = said_of(&spring(Estimate::normal(5.0, 4.0)), &[line(false)]);
        assert!(weak.starts_with("Perhaps parallel spring at q1") && weak.contains("not told from nothing"), "{weak}");
        assert!(said_of(&spring(Estimate::normal(5.0, 0.1)), &[line(true)]).contains("bound of the search"));
    }

    #[test]
    fn numbers_that_are_not_as_given_are_told_the_surest_first() {
        let line = |name: &str, given: f64, value: f64, std: f64| ParameterLine {
            name: name.into(),
            given,
            refitted: value,
            explained: Estimate::normal(value, std),
            at_bound: false,
        };
        let lines = [
            line("mass", 10.0, 10.2, 0.05),
            line("length", 1.0, 1.5, 0.01),
            line("as_given", 1.0, 1.1, 0.1),
            line("added", f64::NAN, 1.0, 0.1),
        ];
        let told = other_numbers(&lines).unwrap();
        assert!(
            told.starts_with("Numbers that are not as given: length 1.500 [") && told.contains("(given 1.000), mass"),
            "{told}"
        );
        assert!(!told.contains("as_given ") && !told.contains("added"), "{told}");
        assert_eq!(other_numbers(&lines[2..]), None);
    }

    #[test]
    fn a_number_is_as_given_where_its_interval_reaches_that_or_both_are_written_alike() {
        let line = |given: f64, low: f64, high: f64| ParameterLine {
            name: "c2".into(),
            given,
            refitted: 0.143_4,
            explained: Estimate { value: 0.143_4, std: 1e-4, low, high, unit: "" },
            at_bound: false,
        };
        let told = |given: f64, low: f64, high: f64| other_numbers(&[line(given, low, high)]);
        assert_eq!(told(0.143, 0.1425, 0.1443), None, "more than 1.96 std away, within the interval");
        assert_eq!(told(0.143_38, 0.143_39, 0.152), None, "written alike");
        assert!(told(0.143, 0.1432, 0.1436).is_some_and(|t| t.contains("0.14340 [") && t.contains("(given 0.14300)")));
    }

    #[test]
    fn the_cost_names_the_error_as_given_and_tells_equal_ones_once() {
        let of = |given: f64, refitted: f64, explained: f64| {
            let (channel, unit) = ("q1".to_owned(), "mrad".to_owned());
            cost_in_words(&Cost { channel, given, refitted, explained, unit, is_heldout: false })
        };
        assert_eq!(
            of(0.21, 0.103, 0.000_671),
            "On the fitted recordings the simulation as given misses q1 by 210 mrad, with re-fitted parameters by 103 mrad, \
             with the missing physics by 0.671 mrad."
        );
        assert_eq!(of(0.21, 0.21, 0.21), "On the fitted recordings the simulation as given misses q1 by 210 mrad.");
        assert!(
            of(f64::INFINITY, 0.1, 0.1)
                .ends_with("as given runs away, with re-fitted parameters misses q1 by 100 mrad.")
        );
    }

    #[test]
    fn the_cost_is_told_in_thousandths_of_the_held_out_channel_that_gains_most() {
        let rig = Rig::parse(
            "schema = 1\nmechanism = \"slider\"\n[parameters]\nmass_kg = 1.0\n[[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\n\
             gain = 1.0\n[[sensor]]\nmeasures = \"q1\"\ncolumn = \"x_m\"\n",
            "rig.toml",
        )
        .unwrap();
        let trace = |use_: &str, refitted: f64| Trace {
            recording: "a.csv".into(),
            use_: use_.into(),
            channel: "x_m".into(),
            unit: "m",
            t_s: vec![0.0, 0.1, 0.2],
            measured: vec![0.0, f64::NAN, 0.0],
            given: vec![0.0; 3],
            refitted: vec![refitted; 3],
            explained: vec![0.001; 3],
        };
        let costs = costs(&rig, &[trace("fit", 9.0), trace("heldout", 0.012)]);
        assert!((costs[0].refitted - 0.012).abs() < 1e-12 && costs[0].is_heldout);
        let said = cost_in_words(&costs[0]);
        assert!(
            said.contains("misses x_m by 0 mm, with re-fitted parameters by 12 mm") && said.contains("by 1 mm"),
            "{said}"
        );
    }
}
