//! Effects that a person supposes: fitted as told, from every start of the library; nothing is judged.
//!
//! RT: no.

use crate::diagnose::base_model::DiagnoseError;
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
use crate::model::rig::{Effect, Rig};
use rayon::prelude::*;
use std::fmt;
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

impl fmt::Display for Supposed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.kind.id())?;
        self.at.iter().try_for_each(|at| write!(f, "@{at}"))?;
        self.order.iter().try_for_each(|order| write!(f, "#{order}"))
    }
}

impl Supposed {
    /// Whether the rig has such a place, and has not the effect there already.
    ///
    /// # Errors
    /// [`DiagnoseError::NoPlace`], [`DiagnoseError::AlreadyThere`].
    pub fn check(&self, rig: &Rig) -> Result<(), DiagnoseError> {
        let places = rig.places(self.kind);
        if places.is_empty() || self.at.as_ref().is_some_and(|at| !places.contains(&at.as_str())) {
            let places = if places.is_empty() { "none of this rig".to_owned() } else { places.join(", ") };
            return Err(DiagnoseError::NoPlace { effect: self.to_string(), places });
        }
        // A known one may have company, and ripples of other orders may act at one place.
        let is_there = |effect: &Effect| {
            let is_free = effect.values.iter().any(|value| value.is_free());
            is_free && effect.kind == self.kind && self.at.as_ref() == Some(&effect.at)
        };
        if rig.effects.iter().any(is_there) && self.kind.key_index("order").is_none() {
            return Err(DiagnoseError::AlreadyThere(self.to_string()));
        }
        Ok(())
    }

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

/// `base` with `supposed` on top, all numbers fitted again: of all places and starts the likeliest.
///
/// # Errors
/// [`DiagnoseError::NoStart`], or [`DiagnoseError::AddedDiverges`] if no start stays finite.
pub fn with_supposed(
    base: &FittedModel,
    supposed: &Supposed,
    pooled: &Pooled,
    floors: &[f64],
) -> Result<FittedModel, DiagnoseError> {
    let diverges = || DiagnoseError::AddedDiverges(supposed.to_string());
    let windows = ltv_windows(base).ok_or_else(diverges)?;
    let scales = scales(base, &windows, pooled);
    let noise = white(&base.residuals, floors);
    let fine = ScoreTest::new(&base.problem, &base.point, &base.noise).ok_or_else(diverges)?;
    let coarse = ScoreTest::new(&base.problem, &base.point, &noise).ok_or_else(diverges)?;
    let mut library = candidates(base, &scales, [&fine, &coarse], &windows);
    library.retain(|candidate| supposed.is(candidate));
    let starts: Vec<(&Candidate, &Vec<f64>)> =
        library.iter().flat_map(|c| c.starts.iter().map(move |s| (c, s))).collect();
    if starts.is_empty() {
        return Err(DiagnoseError::NoStart(supposed.to_string()));
    }
    let fitted = |(candidate, start): &(&Candidate, &Vec<f64>)| {
        let (problem, point) = base.extended(with_effect(&base.rig, candidate, start));
        FittedModel::fitted(problem, point, &noise, floors, FIRST_LOOK)
    };
    let total = |h: &FittedModel| -> f64 { h.blocks(&noise).iter().sum() };
    let looks: Vec<FittedModel> = starts.par_iter().filter_map(fitted).collect();
    let best = looks.into_iter().max_by(|a, b| total(a).total_cmp(&total(b))).ok_or_else(diverges)?;
    let own = white(&best.residuals, floors);
    let best = best.polished(&own, floors, Limits::default()).unwrap_or(best);
    Ok(led_out(best, &noise, floors))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::synthesis::SHAKEN_PENDULUM;

    #[test]
    fn a_supposition_is_read_with_place_and_order() {
        let seventh: Supposed = "torque_ripple@q1#7".parse().unwrap();
        assert_eq!(
            (seventh.kind, seventh.at.as_deref(), seventh.order),
            (EffectKind::TorqueRipple, Some("q1"), Some(7.0))
        );
        assert_eq!(seventh.to_string(), "torque_ripple@q1#7");
        assert_eq!("backlash".parse::<Supposed>().unwrap().at, None);
        assert!("magic@q1".parse::<Supposed>().unwrap_err().contains("magic"));
    }

    #[test]
    fn a_place_that_the_rig_has_not_and_an_effect_that_it_has_are_told() {
        let there = "[[effect]]\neffect = \"viscous_friction\"\nat = \"q1\"\nviscous = { value = 0.1, min = 0.0, max = 1.0 }\n[[sensor]]";
        let rig = SHAKEN_PENDULUM.replacen("[[sensor]]", there, 1);
        let rig = Rig::parse(&rig, "rig.toml").unwrap();
        let told = |text: &str| text.parse::<Supposed>().unwrap().check(&rig).map_err(|e| e.to_string());
        assert_eq!(told("backlash@q7").unwrap_err(), "`backlash@q7`: this rig has no such place; must be one of: q1");
        assert_eq!(
            told("sensor_lag@q1").unwrap_err(),
            "`sensor_lag@q1`: this rig has no such place; must be one of: y"
        );
        assert!(told("foot_slip").unwrap_err().ends_with("must be one of: none of this rig"));
        assert!(told("viscous_friction@q1").unwrap_err().contains("stands in rig.toml already"));
        for fine in ["backlash@q1", "backlash", "viscous_friction", "torque_ripple@q1#7"] {
            assert_eq!(told(fine), Ok(()), "{fine}");
        }
    }
}
