//! The mark of one case recorded on hardware, where something but not everything is known. RT: no.

use std::collections::BTreeMap;

use super::answer::{Answer, FitRow, Member};
use super::truth::{Acceptance, Expected, Hardware};

/// Number of samples by recording and channel: the weights of a pooled error.
pub type SampleCounts = BTreeMap<(String, String), usize>;

/// What one hardware case earned.
#[derive(Debug, Clone, Default)]
pub struct HardwareMark {
    /// The verdict is one of the right ones.
    pub verdict_right: bool,
    /// Required effects named, and how many there are.
    pub required: (usize, usize),
    /// Effects named that would be a bonus, and how many there are.
    pub stretch: (usize, usize),
    /// What was named although it is ruled out.
    pub forbidden: Vec<String>,
    /// What was named and is neither expected nor optional.
    pub surprising: Vec<String>,
    /// Named values inside their plausible range, and how many ranges there are.
    pub in_range: (usize, usize),
    /// The first place found is on one of the channels where it must show.
    pub place_right: bool,
    /// Channel, pooled held-out error, limit.
    pub errors: Vec<(String, f64, f64)>,
}

impl HardwareMark {
    /// Every channel is within its limit.
    pub fn errors_accepted(&self) -> bool {
        self.errors.iter().all(|(_, found, limit)| found <= limit)
    }

    /// Right verdict, everything required named, nothing ruled out named, error reached.
    pub fn right(&self) -> bool {
        self.verdict_right && self.required.0 == self.required.1 && self.forbidden.is_empty() && self.errors_accepted()
    }
}

/// True if a member is what `effect`, `effect@at` or `effect@at#order` says.
pub fn token_fits(token: &str, member: &Member) -> bool {
    let (place, order) =
        token.split_once('#').map_or((token, None), |(place, order)| (place, order.parse::<f64>().ok()));
    let (effect, at) = place.split_once('@').map_or((place, None), |(effect, at)| (effect, Some(at)));
    effect == member.effect
        && at.is_none_or(|at| at == member.at)
        && order.is_none_or(|order| {
            // An order is a small whole number; a fitted one may be a little off it.
            member.parameters.get("order").is_some_and(|found| (found.value - order).abs() < 0.25)
        })
}

fn find<'a>(expected: &Expected, answer: &'a Answer) -> Option<&'a Member> {
    let fits = |member: &&Member| expected.any_of.iter().any(|token| token_fits(token, member));
    answer.missing.iter().flat_map(|entry| &entry.one_of).find(fits)
}

fn named(member: &Member) -> String {
    format!("{}@{}", member.effect, member.at)
}

/// `name`, or a pattern with one `*`.
fn pattern_fits(pattern: &str, name: &str) -> bool {
    pattern.split_once('*').map_or(pattern == name, |(head, tail)| name.starts_with(head) && name.ends_with(tail))
}

/// Pooled error of one channel over its held-out recordings: sqrt(Σ n (nrmse std)² / Σ n std²); std is pooled over all
/// recordings of the same use (contract section 4), so it cancels.
fn pooled(acceptance: &Acceptance, answer: &Answer, samples: &SampleCounts) -> f64 {
    let matches = |row: &&FitRow| {
        row.role == "heldout" && row.channel == acceptance.channel && pattern_fits(&acceptance.files, &row.recording)
    };
    let (mut energy, mut weight) = (0.0, 0.0);
    for row in answer.fit.iter().filter(matches) {
        let key = (row.recording.clone(), row.channel.clone());
        let n = samples.get(&key).copied().unwrap_or(1) as f64;
        energy += n * row.nrmse_explained.map_or(f64::INFINITY, |nrmse| nrmse * nrmse);
        weight += n;
    }
    if weight > 0.0 { (energy / weight).sqrt() } else { f64::INFINITY }
}

fn note_expected(mark: &mut HardwareMark, expected: &Expected, answer: &Answer) {
    let member = find(expected, answer);
    let count = if expected.tier == "required" { &mut mark.required } else { &mut mark.stretch };
    count.0 += usize::from(member.is_some());
    count.1 += 1;
    for (key, range) in &expected.parameters {
        let value = member.and_then(|member| member.parameters.get(key)).map(|found| found.value.abs());
        mark.in_range.0 += usize::from(value.is_some_and(|value| (range[0]..=range[1]).contains(&value)));
        mark.in_range.1 += 1;
    }
}

/// Marks one answer against what is known.
pub fn mark(truth: &Hardware, answer: &Answer, samples: &SampleCounts) -> HardwareMark {
    let mut mark = HardwareMark {
        verdict_right: truth.verdict.contains(&answer.verdict),
        place_right: answer.places.first().is_some_and(|place| truth.where_channels.contains(&place.channel)),
        ..HardwareMark::default()
    };
    for expected in &truth.expected {
        note_expected(&mut mark, expected, answer);
    }
    let known: Vec<&String> = truth.expected.iter().flat_map(|e| &e.any_of).chain(&truth.optional).collect();
    for member in answer.missing.iter().flat_map(|entry| &entry.one_of) {
        if truth.forbidden.iter().any(|token| token_fits(token, member)) {
            mark.forbidden.push(named(member));
        } else if !known.iter().any(|token| token_fits(token, member)) {
            mark.surprising.push(named(member));
        }
    }
    for acceptance in &truth.acceptance {
        mark.errors.push((acceptance.channel.clone(), pooled(acceptance, answer, samples), acceptance.nrmse));
    }
    mark
}

#[cfg(test)]
mod tests {
    use super::*;

    fn member(effect: &str, at: &str, order: f64) -> Member {
        serde_json::from_str(&format!(
            r#"{{"effect":"{effect}","at":"{at}","weight":1.0,"parameters":{{"order":{{"value":{order}}}}}}}"#
        ))
        .unwrap()
    }

    #[test]
    fn tokens_narrow_by_place_and_order() {
        let seventh = member("torque_ripple", "q1", 7.02);
        assert!(token_fits("torque_ripple", &seventh));
        assert!(token_fits("torque_ripple@q1#7", &seventh));
        assert!(!token_fits("torque_ripple@q1#14", &seventh));
        assert!(!token_fits("torque_ripple@q2", &seventh));
    }

    #[test]
    fn pooled_error_weighs_recordings_by_their_samples() {
        let answer: Answer = serde_json::from_str(
            r#"{"schema":1,"verdict":"explained","where":[],"missing":[],"seconds":1.0,"fit":[
            {"recording":"a","use":"heldout","channel":"q","nrmse_given":1,"nrmse_refitted":1,"nrmse_explained":0.1},
            {"recording":"b","use":"heldout","channel":"q","nrmse_given":1,"nrmse_refitted":1,"nrmse_explained":0.3},
            {"recording":"c","use":"fit","channel":"q","nrmse_given":1,"nrmse_refitted":1,"nrmse_explained":9.0}]}"#,
        )
        .unwrap();
        let acceptance = Acceptance { channel: "q".into(), files: "*".into(), nrmse: 0.2 };
        let samples = [(("a".into(), "q".into()), 300), (("b".into(), "q".into()), 100)].into();
        assert!((pooled(&acceptance, &answer, &samples) - 0.03f64.sqrt()).abs() < 1e-12);
    }
}
