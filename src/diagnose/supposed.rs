//! Effects that a person supposes: fitted as told, from every start of the library; nothing is judged.
//!
//! RT: no.

use crate::diagnose::library::candidate_fit::with_effect;
use crate::diagnose::library::candidates::Candidate;
use crate::diagnose::library::initial_guesses::candidates;
use crate::diagnose::screen::linearise::ltv_windows;
use crate::diagnose::screen::scales::scales;
use crate::diagnose::screen::score_test::ScoreTest;
use crate::diagnose::search::basin_hopping::led_out;
use crate::identify::fit::Limits;
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::white;
use crate::identify::rollout::Pooled;
use crate::model::effect::EffectKind;
use rayon::prelude::*;
use std::str::FromStr;

/// An effect, where it acts (any place if that is not said) and, of a ripple, which order it has.
#[derive(Clone, Debug, PartialEq)]
pub struct Supposed {
    /// What acts.
    pub kind: EffectKind,
    /// Where; `None`: wherever it fits best.
    pub at: Option<String>,
    /// Periods per turn, to a quarter.
    pub order: Option<f64>,
}

impl FromStr for Supposed {
    type Err = String;

    /// `EFFECT`, `EFFECT@AT` or `EFFECT@AT#ORDER`.
    fn from_str(text: &str) -> Result<Self, String> {
        let (place, order) = text.split_once('#').map_or((text, None), |(place, order)| (place, Some(order)));
        let (id, at) = place.split_once('@').map_or((place, None), |(id, at)| (id, Some(at.to_owned())));
        let kind = EffectKind::from_id(id).ok_or_else(|| format!("`{id}` is no effect of docs/contract.md"))?;
        let order = order.map(|o| o.parse().map_err(|_| format!("`{o}`: an order is a number"))).transpose()?;
        Ok(Self { kind, at, order })
    }
}

impl Supposed {
    fn is(&self, candidate: &Candidate) -> bool {
        let mid = |c: &Candidate| c.keys.iter().find(|k| k.name == "order").map(|k| 0.5 * (k.min + k.max));
        let is_order = |order: f64| mid(candidate).is_some_and(|mid| (mid - order).abs() < 0.25);
        candidate.effect == self.kind.id()
            && self.at.as_ref().is_none_or(|at| *at == candidate.at)
            && self.order.is_none_or(is_order)
    }
}

/// First look at a start; the best goes on to its end.
const FIRST_LOOK: Limits = Limits { iterations: 6, tolerance: 3e-4 };

/// `base` with `supposed` on top, all numbers fitted again: of all places and starts the likeliest. `None` if this rig has
/// no place for it, or no start stays finite.
#[must_use]
pub fn with_supposed(base: &FittedModel, supposed: &Supposed, pooled: &Pooled, floors: &[f64]) -> Option<FittedModel> {
    let windows = ltv_windows(base)?;
    let scales = scales(base, &windows, pooled);
    let noise = white(&base.residuals, floors);
    let fine = ScoreTest::new(&base.problem, &base.point, &base.noise)?;
    let coarse = ScoreTest::new(&base.problem, &base.point, &noise)?;
    let mut library = candidates(base, &scales, [&fine, &coarse], &windows);
    library.retain(|candidate| supposed.is(candidate));
    let starts: Vec<(&Candidate, &Vec<f64>)> =
        library.iter().flat_map(|c| c.starts.iter().map(move |s| (c, s))).collect();
    let fitted = |(candidate, start): &(&Candidate, &Vec<f64>)| {
        let (problem, point) = base.extended(with_effect(&base.rig, candidate, start));
        FittedModel::fitted(problem, point, &noise, floors, FIRST_LOOK)
    };
    let total = |h: &FittedModel| -> f64 { h.blocks(&noise).iter().sum() };
    let looks: Vec<FittedModel> = starts.par_iter().filter_map(fitted).collect();
    let best = looks.into_iter().max_by(|a, b| total(a).total_cmp(&total(b)))?;
    let own = white(&best.residuals, floors);
    let best = best.polished(&own, floors, Limits::default()).unwrap_or(best);
    Some(led_out(best, &noise, floors))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_supposition_is_read_with_place_and_order() {
        let seventh: Supposed = "torque_ripple@q1#7".parse().unwrap();
        assert_eq!(
            (seventh.kind, seventh.at.as_deref(), seventh.order),
            (EffectKind::TorqueRipple, Some("q1"), Some(7.0))
        );
        assert_eq!("backlash".parse::<Supposed>().unwrap().at, None);
        assert!("magic@q1".parse::<Supposed>().unwrap_err().contains("magic"));
    }
}
