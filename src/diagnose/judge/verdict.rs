//! What the answer is called: the verdict that follows from what was found, and the types of `diagnosis.json`.
//!
//! RT: no.

pub use crate::report::findings::{
    Diagnosis, Estimate, Figure, Findings, Law, Member, Missing, ParameterLine, Place, Ranked, Rejected, Seen, Trace,
    Verdict,
};

use super::criterion::{Context, detection_threshold};
use super::numbers::NEARLY_ALL;
use crate::identify::likelihood::Difference;

/// True if the numbers of the rig as given had to be fitted again; `gain`: of the re-fit with so many numbers.
#[must_use]
pub fn refit_is_needed(gain: Difference, numbers: usize, context: &Context) -> bool {
    gain.total > detection_threshold(context, numbers) && gain.low > 0.0
}

/// True if an effect that removes this part of the misfit matters, where the smallest that does removes `least`.
#[must_use]
pub fn is_material(share: f64, least: f64) -> bool {
    share >= least
}

/// True if a search that ended early may have missed something, by the part of the misfit that it explained.
#[must_use]
pub fn may_have_missed(explained_part: f64) -> bool {
    explained_part < NEARLY_ALL
}

/// The verdict that follows from what is missing; with nothing missing it is `parameters` if they had to be fitted
/// again, else `consistent`.
#[must_use]
pub fn verdict_of(missing: &[Missing], refit_needed: bool) -> Verdict {
    let is_unlisted = |m: &Missing| m.one_of.iter().any(|x| x.effect == "unlisted");
    if missing.is_empty() {
        if refit_needed { Verdict::Parameters } else { Verdict::Consistent }
    } else if missing.iter().any(is_unlisted) {
        Verdict::Unlisted
    } else if missing.iter().any(|m| m.one_of.len() > 1) {
        Verdict::Ambiguous
    } else {
        Verdict::Explained
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    fn entry(effects: &[&str]) -> Missing {
        let member =
            |e: &&str| Member { effect: (*e).into(), at: "q1".into(), weight: 1.0, parameters: BTreeMap::new() };
        Missing { one_of: effects.iter().map(member).collect(), sentence: String::new() }
    }

    #[test]
    fn verdict_follows_from_the_sets() {
        assert_eq!(verdict_of(&[], false), Verdict::Consistent);
        assert_eq!(verdict_of(&[], true), Verdict::Parameters);
        assert_eq!(verdict_of(&[entry(&["backlash"])], true), Verdict::Explained);
        assert_eq!(verdict_of(&[entry(&["backlash", "presliding"])], true), Verdict::Ambiguous);
        assert_eq!(verdict_of(&[entry(&["backlash"]), entry(&["unlisted"])], true), Verdict::Unlisted);
    }

    #[test]
    fn an_error_without_bound_is_null_in_json() {
        let ran_away = Figure {
            recording: "a.csv".into(),
            use_: "fit".into(),
            channel: "q1_rad".into(),
            nrmse_given: f64::INFINITY,
            nrmse_refitted: 0.5,
            nrmse_explained: 0.1,
        };
        let json = serde_json::to_string(&ran_away).unwrap();
        assert!(json.contains(r#""nrmse_given":null,"nrmse_refitted":0.5"#), "{json}");
    }

    #[test]
    fn json_carries_the_names_of_the_contract() {
        let json = serde_json::to_string(&entry(&["backlash"])).unwrap();
        assert!(json.starts_with(r#"{"one_of":[{"effect":"backlash","at":"q1","weight":1.0"#), "{json}");
        assert_eq!(serde_json::to_string(&Verdict::Unlisted).unwrap(), r#""unlisted""#);
    }
}
