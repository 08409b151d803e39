//! What a variant can decide: the truth and its rivals, each fitted to it, before any diagnosis is looked at.
//!
//! The fits are those of `compass identify --add EFFECT`: a program that adds what it is told and judges nothing.
//! RT: no.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::trial::score::{FitRow, Hardware, Runner};

/// Held-out errors of a variant under several models; infinite where a fit gave no answer.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Settled {
    /// The rig with its numbers fitted, nothing added.
    pub base: f64,
    /// With what is expected, nothing else.
    pub truth: f64,
    /// With each forbidden effect instead; absent if rivals were not asked for.
    pub rivals: BTreeMap<String, f64>,
}

impl Settled {
    /// These recordings can tell: the truth predicts what was kept back better than the plain rig and than each rival.
    pub fn is_decidable(&self) -> bool {
        self.truth < self.base && self.rivals.values().all(|rival| self.truth < *rival)
    }
}

/// `identified.json` of `compass identify`: the part that is needed here.
#[derive(Deserialize)]
struct Identified {
    fit: Vec<FitRow>,
}

/// Fits models to variants, one process each.
#[derive(Debug, Clone)]
pub struct Settler {
    /// The `compass` binary.
    pub program: PathBuf,
    /// Results go to `folder/<variant>/<model>/`.
    pub folder: PathBuf,
    /// A fit that takes longer is stopped.
    pub limit: Duration,
    /// Fit the rivals as well.
    pub with_rivals: bool,
}

impl Settler {
    /// Fits what must be known of one variant. Fits that are there already are kept.
    pub fn settle(&self, variant: &Path, truth: &Hardware) -> Settled {
        let required = truth.expected.iter().filter(|e| e.tier == "required");
        let sets: Vec<Vec<&str>> = products(required.map(|e| e.any_of.iter().map(String::as_str).collect()));
        let best = sets.iter().map(|set| self.heldout(variant, set)).fold(f64::INFINITY, f64::min);
        let rival = |token: &String| (token.clone(), self.heldout(variant, &[token]));
        Settled {
            base: self.heldout(variant, &[]),
            truth: best,
            rivals: truth.forbidden.iter().filter(|_| self.with_rivals).map(rival).collect(),
        }
    }

    /// Held-out error of the rig with these effects added: root mean square over all held-out rows.
    fn heldout(&self, variant: &Path, added: &[&str]) -> f64 {
        let name = if added.is_empty() { "base".to_owned() } else { added.join("+") };
        let out = self.folder.join(variant.file_name().unwrap_or_default()).join(name);
        let path = out.join("identified.json");
        if !path.exists() {
            let mut args =
                vec!["identify".into(), variant.as_os_str().to_owned(), "--out".into(), out.into_os_string()];
            for token in added {
                args.extend(["--add".into(), (*token).into()]);
            }
            // Without an answer the error stays infinite.
            Runner::call(&self.program, &args, self.limit).unwrap_or_default();
        }
        let text = std::fs::read_to_string(&path).unwrap_or_default();
        let read: Option<Identified> = serde_json::from_str(&text).ok();
        read.map_or(f64::INFINITY, |found| heldout_error(&found.fit, |row| row.nrmse_refitted))
    }
}

/// Root mean square of the held-out errors; infinite without any, or where one is missing.
pub(super) fn heldout_error(fit: &[FitRow], of: impl Fn(&FitRow) -> Option<f64>) -> f64 {
    let squares: Vec<f64> = fit
        .iter()
        .filter(|row| row.role == "heldout")
        .map(|row| of(row).map_or(f64::INFINITY, |error| error * error))
        .collect();
    if squares.is_empty() { f64::INFINITY } else { libm::sqrt(squares.iter().sum::<f64>() / squares.len() as f64) }
}

/// One of each: all ways to choose.
fn products<'a>(of: impl Iterator<Item = Vec<&'a str>>) -> Vec<Vec<&'a str>> {
    of.fold(vec![Vec::new()], |sets, choices| {
        let longer = |set: &Vec<&'a str>| -> Vec<Vec<&'a str>> {
            choices.iter().map(|choice| [set.as_slice(), &[*choice]].concat()).collect()
        };
        sets.iter().flat_map(longer).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_way_to_choose_the_expected_is_fitted() {
        let sets = products([vec!["a"], vec!["b", "c"]].into_iter());
        assert_eq!(sets, [vec!["a", "b"], vec!["a", "c"]]);
    }

    #[test]
    fn a_variant_where_a_rival_predicts_as_well_decides_nothing() {
        let rivals = [("backlash".to_owned(), 0.2)].into();
        let settled = Settled { base: 0.5, truth: 0.2, rivals };
        assert!(!settled.is_decidable());
        assert!(Settled { truth: 0.19, ..settled }.is_decidable());
    }
}
