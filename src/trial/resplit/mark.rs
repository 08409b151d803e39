//! Is the answer to a variant right? RT: no.

use serde::{Deserialize, Serialize};

use super::settle::{Settled, heldout_error};
use crate::trial::score::{Answer, Entry, Hardware, token_fits};

/// Most members of a set that still says something.
const MOST_MEMBERS: usize = 3;
/// Two fits of one model that ended in different places differ by less than this part in their held-out error.
const SAME_FIT: f64 = 0.05;

/// What an answer to a variant is worth.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct VariantMark {
    /// Every required effect is named, in a set of at most three.
    pub named: bool,
    /// Forbidden effects that are members of any set.
    pub forbidden: Vec<String>,
    /// A forbidden effect is the only member of its entry: the worst answer.
    pub forbidden_alone: bool,
    /// Held-out error of the answer.
    pub error: f64,
    /// It is no worse than with the truth fitted alone.
    pub error_reached: bool,
}

impl VariantMark {
    /// Right in every respect.
    pub fn right(&self) -> bool {
        self.named && self.forbidden.is_empty() && self.error_reached
    }
}

/// Marks an answer to a variant.
pub fn mark(truth: &Hardware, settled: &Settled, answer: &Answer) -> VariantMark {
    let holds = |entry: &Entry, tokens: &[String]| {
        entry.one_of.len() <= MOST_MEMBERS && entry.one_of.iter().any(|m| tokens.iter().any(|t| token_fits(t, m)))
    };
    let mut required = truth.expected.iter().filter(|e| e.tier == "required");
    let is_forbidden = |m: &crate::trial::score::Member| truth.forbidden.iter().any(|t| token_fits(t, m));
    let members = answer.missing.iter().flat_map(|entry| &entry.one_of);
    let error = heldout_error(&answer.fit, |row| row.nrmse_explained);
    VariantMark {
        named: required.all(|e| answer.missing.iter().any(|entry| holds(entry, &e.any_of))),
        forbidden: members.filter(|m| is_forbidden(m)).map(|m| format!("{}@{}", m.effect, m.at)).collect(),
        forbidden_alone: answer.missing.iter().any(|e| e.one_of.len() == 1 && e.one_of.iter().all(is_forbidden)),
        error,
        error_reached: error <= (1.0 + SAME_FIT) * settled.truth,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn truth() -> Hardware {
        toml::from_str(
            "verdict = [\"explained\"]\nforbidden = [\"backlash\"]\n\
            [[expected]]\nany_of = [\"torque_ripple@q1#7\"]\ntier = \"required\"\n",
        )
        .unwrap()
    }

    fn answer(missing: &str) -> Answer {
        serde_json::from_str(&format!(
            r#"{{"schema":1,"verdict":"explained","where":[],"missing":{missing},"seconds":1.0,
            "fit":[{{"recording":"c","use":"heldout","channel":"q",
            "nrmse_given":1.0,"nrmse_refitted":0.5,"nrmse_explained":0.2}}]}}"#
        ))
        .unwrap()
    }

    const SEVENTH: &str = r#"{"effect":"torque_ripple","at":"q1","weight":0.6,"parameters":{"order":{"value":7.0}}}"#;
    const GAP: &str = r#"{"effect":"backlash","at":"q1","weight":0.3}"#;
    const OTHER: &str = r#"{"effect":"viscous_friction","at":"q1","weight":0.1}"#;

    fn settled(truth: f64) -> Settled {
        Settled { base: 0.5, truth, rivals: std::collections::BTreeMap::new() }
    }

    #[test]
    fn expected_effect_with_the_error_of_the_truth_is_right() {
        let found = answer(&format!(r#"[{{"one_of":[{SEVENTH}]}}]"#));
        assert!(mark(&truth(), &settled(0.199), &found).right());
        assert!(!mark(&truth(), &settled(0.15), &found).right(), "the truth alone predicts better");
    }

    #[test]
    fn a_set_of_three_may_hold_it_and_one_of_four_may_not() {
        let three = answer(&format!(r#"[{{"one_of":[{SEVENTH},{OTHER},{OTHER}]}}]"#));
        let four = answer(&format!(r#"[{{"one_of":[{SEVENTH},{OTHER},{OTHER},{OTHER}]}}]"#));
        assert!(mark(&truth(), &settled(0.2), &three).named && !mark(&truth(), &settled(0.2), &four).named);
    }

    #[test]
    fn a_forbidden_member_is_wrong_and_alone_it_is_worse() {
        let beside = mark(&truth(), &settled(0.2), &answer(&format!(r#"[{{"one_of":[{SEVENTH},{GAP}]}}]"#)));
        assert!(!beside.right() && beside.named && !beside.forbidden_alone);
        assert!(mark(&truth(), &settled(0.2), &answer(&format!(r#"[{{"one_of":[{GAP}]}}]"#))).forbidden_alone);
    }
}
