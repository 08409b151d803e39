//! What the answer is called: the verdict that follows from what was found, and the types of `diagnosis.json`.
//!
//! RT: no.

pub use crate::report::findings::{
    Diagnosis, Estimate, Figure, Findings, Law, Member, Missing, ParameterLine, Place, Ranked, Rejected, Seen, Trace,
    Verdict,
};

use super::criterion::{Context, detection_threshold};
use super::numbers::{NEARLY_ALL, QUARTER};
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

/// True if of the fall of squares that a change of predictions would be, were it the truth, so much is so that it may be.
#[must_use]
pub fn is_kept(promised: f64, gained: f64) -> bool {
    gained > 0.0 && gained >= QUARTER * promised
}

/// True if recordings that were not fitted speak against an effect of so many numbers: it changes what is predicted there by more
/// than chance, `promised`, and of the fall of squares that this change would be, were it the truth, it keeps less than [`QUARTER`],
/// as it must where fitted recordings are left out in turn. What changes nothing there is not asked.
#[must_use]
pub fn is_refuted(promised: f64, gained: f64, numbers: usize, context: &Context) -> bool {
    promised > detection_threshold(context, numbers) && !is_kept(promised, gained)
}

/// True if an event is the explanation where it acts: of the squares above noise it leaves little there.
#[must_use]
pub fn is_removed_where_it_acts(left: f64) -> bool {
    left <= QUARTER
}

/// True if recordings that were not fitted speak for one model against another: the change between them is more than chance, and
/// [`QUARTER`] of it is so.
#[must_use]
pub fn is_borne_out(promised: f64, gained: f64, context: &Context) -> bool {
    promised > detection_threshold(context, 0) && is_kept(promised, gained)
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
    use crate::diagnose::judge::evidence::Ledger;
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
    fn an_effect_is_refuted_where_it_changes_much_and_little_of_that_is_so() {
        let (floors, ledger) = (vec![1e-3], Ledger::default());
        let context = Context { floors, samples: 1000, given: 0, is_trapped: false, seed: 1, ledger, held_out: None };
        assert!(is_refuted(200.0, 20.0, 1, &context) && is_refuted(200.0, -150.0, 1, &context));
        assert!(!is_refuted(200.0, 180.0, 1, &context), "the truth keeps all of it");
        assert!(!is_refuted(60.0, -60.0, 1, &context), "what hardly acts there is not asked");
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
