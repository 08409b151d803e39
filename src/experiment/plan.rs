//! A file of `config/experiments/`: what is the same in all runs, what is varied, when a run ends. RT: no.
//!
//! ```toml
//! about = "Level floor"
//! seeds = "1..20"
//! [set]                                   # as `--set`
//! sim.on_blocks = false
//! [axes]                                  # every combination is run
//! control.walk.speed_m_s = [0.3, 0.4]
//! push = [{ label = "none" }, { label = "2 N s", set = { sim.random_pushes.impulse_ns = 2.0 } }]
//! [draw]                                  # uniform, by the seed
//! sim.initial_angle_rad = [[-0.02, 0.02], [-0.3, 0.1]]
//! [model_error]                           # shares by which the real machine may differ from the controller's model
//! inertia = 0.1
//! friction = 0.2
//! [stop]
//! steps = 1000
//! time_s = 3000.0
//! ```

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use toml::{Table, Value};

/// Makes what is drawn per run another stream than the noise of the simulated robot.
const STREAM: u64 = 0x6472_6177;

/// Why a file is no experiment.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// Not TOML, an unknown key, a wrong type.
    #[error(transparent)]
    Toml(#[from] toml::de::Error),
    /// It reads, but cannot be done.
    #[error("{key}: {what}")]
    Wrong {
        /// Which key.
        key: String,
        /// What is wrong with it.
        what: String,
    },
}

/// When a run ends although nothing fell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stop {
    /// After so many true steps; none: the time decides.
    pub steps: Option<u32>,
    /// After so much simulated time, s. With `steps`: a run that has not made them by then has failed.
    pub time_s: f64,
}

/// Shares by which the real machine may differ from the model of controller and observer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelError {
    /// Inertia of each leg and of the body, .1 = ±10 %.
    pub inertia: f64,
    /// Viscous and Coulomb friction of the hip.
    pub friction: f64,
}

/// As typed.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Typed {
    about: String,
    seeds: String,
    #[serde(default)]
    set: Table,
    #[serde(default)]
    axes: Table,
    #[serde(default)]
    draw: Table,
    #[serde(default)]
    model_error: Option<ModelError>,
    stop: Stop,
}

/// One value of an axis.
#[derive(Clone, Debug, PartialEq)]
struct Choice {
    label: String,
    overrides: Vec<String>,
    draw: Vec<Drawn>,
}

/// One key that is varied.
#[derive(Clone, Debug, PartialEq)]
struct Axis {
    key: String,
    choices: Vec<Choice>,
}

/// A number or a list of them, each uniform between two ends.
#[derive(Clone, Debug, PartialEq)]
struct Drawn {
    key: String,
    ranges: Vec<[f64; 2]>,
    is_list: bool,
}

/// Labels, keys and draws of one choice on every axis.
type Combination = (BTreeMap<String, String>, Vec<String>, Vec<Drawn>);

/// An experiment.
#[derive(Clone, Debug)]
pub struct Plan {
    /// What it is about, in a line.
    pub about: String,
    /// First and last seed.
    pub seeds: [u64; 2],
    /// When a run ends.
    pub stop: Stop,
    set: Vec<String>,
    axes: Vec<Axis>,
    draw: Vec<Drawn>,
}

/// One run to do.
#[derive(Clone, Debug, PartialEq)]
pub struct RunPlan {
    /// Its number in the plan: shards take them in turn.
    pub index: usize,
    /// Axis → label of its value.
    pub axes: BTreeMap<String, String>,
    /// Its seed.
    pub seed: u64,
    /// The configuration, `key=value`, without what the seed draws.
    pub overrides: Vec<String>,
    draw: Vec<Drawn>,
}

impl Plan {
    /// Reads the text of a file.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn parse(text: &str) -> Result<Self, PlanError> {
        let typed: Typed = toml::from_str(text)?;
        let mut set = assignments("", &typed.set);
        if let Some(error) = typed.model_error {
            set.push(format!("sim.model_error.inertia={:?}", error.inertia));
            set.push(format!("sim.model_error.friction={:?}", error.friction));
        }
        if !(typed.stop.time_s > 0.0 && typed.stop.time_s.is_finite()) {
            return Err(wrong("stop.time_s", "must be above 0 s"));
        }
        Ok(Self {
            about: typed.about,
            seeds: seeds(&typed.seeds).map_err(|what| wrong("seeds", &what))?,
            stop: typed.stop,
            set,
            axes: leaves("", &typed.axes)
                .into_iter()
                .map(|(key, value)| axis(key, &value))
                .collect::<Result<_, _>>()?,
            draw: leaves("", &typed.draw)
                .into_iter()
                .map(|(key, value)| drawn(key, &value))
                .collect::<Result<_, _>>()?,
        })
    }

    /// All runs, seeds fastest.
    #[must_use]
    pub fn runs(&self) -> Vec<RunPlan> {
        let mut combinations = vec![(BTreeMap::new(), self.set.clone(), self.draw.clone())];
        for axis in &self.axes {
            let with = |(labels, set, draw): &Combination, choice: &Choice| {
                let (mut labels, mut set, mut draw) = (labels.clone(), set.clone(), draw.clone());
                labels.insert(axis.key.clone(), choice.label.clone());
                set.extend(choice.overrides.iter().cloned());
                draw.extend(choice.draw.iter().cloned());
                (labels, set, draw)
            };
            combinations = combinations.iter().flat_map(|c| axis.choices.iter().map(move |x| with(c, x))).collect();
        }
        let mut runs = Vec::new();
        for (axes, set, draw) in combinations {
            for seed in self.seeds[0]..=self.seeds[1] {
                let mut overrides = set.clone();
                overrides.push(format!("sim.seed={seed}"));
                runs.push(RunPlan { index: runs.len(), axes: axes.clone(), seed, overrides, draw: draw.clone() });
            }
        }
        runs
    }
}

impl RunPlan {
    /// Anything is drawn.
    #[must_use]
    pub fn draws(&self) -> bool {
        !self.draw.is_empty()
    }

    /// What the seed draws, `key=value`; `attempt` counts draws that no robot can start from.
    #[must_use]
    pub fn drawn(&self, attempt: u32) -> Vec<String> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed ^ STREAM);
        rng.set_stream(u64::from(attempt));
        #[expect(clippy::cast_precision_loss, reason = "53 bits")]
        let mut uniform = || (rng.next_u64() >> 11) as f64 / 9_007_199_254_740_992.0;
        let mut out = Vec::new();
        for d in &self.draw {
            let values: Vec<String> =
                d.ranges.iter().map(|[low, high]| format!("{:?}", low + (high - low) * uniform())).collect();
            let text = values.join(", ");
            out.push(if d.is_list { format!("{}=[{text}]", d.key) } else { format!("{}={text}", d.key) });
        }
        out
    }
}

/// `A..B`, both included, or one number.
///
/// # Errors
/// What is wrong with it.
pub fn seeds(text: &str) -> Result<[u64; 2], String> {
    let (first, last) = text.split_once("..").unwrap_or((text, text));
    match (first.trim().parse(), last.trim().parse()) {
        (Ok(first), Ok(last)) if first <= last && last <= i64::MAX.cast_unsigned() => Ok([first, last]),
        _ => Err(format!("`{text}`: must be A..B with whole numbers, A not above B")),
    }
}

fn wrong(key: &str, what: &str) -> PlanError {
    PlanError::Wrong { key: key.to_owned(), what: what.to_owned() }
}

/// `key=value` of every leaf.
fn assignments(path: &str, table: &Table) -> Vec<String> {
    leaves(path, table).into_iter().map(|(key, value)| format!("{key}={value}")).collect()
}

fn leaves(path: &str, table: &Table) -> Vec<(String, Value)> {
    let mut out = Vec::new();
    for (key, value) in table {
        let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
        match value {
            Value::Table(inner) => out.extend(leaves(&path, inner)),
            leaf => out.push((path, leaf.clone())),
        }
    }
    out
}

fn axis(key: String, value: &Value) -> Result<Axis, PlanError> {
    let Value::Array(items) = value else { return Err(wrong(&key, "an axis is a list of values")) };
    let choices = items.iter().map(|item| choice(&key, item)).collect::<Result<Vec<_>, _>>()?;
    if choices.is_empty() {
        return Err(wrong(&key, "has no values"));
    }
    Ok(Axis { key, choices })
}

fn choice(key: &str, item: &Value) -> Result<Choice, PlanError> {
    let Value::Table(bundle) = item else {
        let label = item.as_str().map_or_else(|| item.to_string(), str::to_owned);
        return Ok(Choice { label, overrides: vec![format!("{key}={item}")], draw: Vec::new() });
    };
    let label = bundle.get("label").and_then(Value::as_str);
    let label =
        label.ok_or_else(|| wrong(key, "a bundle of keys needs a label: { label = \"...\", set = { ... } }"))?;
    let inner = |name: &str| match bundle.get(name) {
        None => Ok(Table::new()),
        Some(Value::Table(table)) => Ok(table.clone()),
        Some(_) => Err(wrong(key, &format!("`{name}` must be a table"))),
    };
    let draw =
        leaves("", &inner("draw")?).into_iter().map(|(key, value)| drawn(key, &value)).collect::<Result<_, _>>()?;
    if let Some(unknown) = bundle.keys().find(|k| !["label", "set", "draw"].contains(&k.as_str())) {
        return Err(wrong(key, &format!("unknown key `{unknown}` in a bundle; known: label, set, draw")));
    }
    Ok(Choice { label: label.to_owned(), overrides: assignments("", &inner("set")?), draw })
}

fn drawn(key: String, value: &Value) -> Result<Drawn, PlanError> {
    let what = "must be [low, high], or a list of these";
    let Value::Array(items) = value else { return Err(wrong(&key, what)) };
    let is_list = items.iter().all(Value::is_array);
    let ranges = if is_list { items.iter().map(range).collect() } else { range(value).map(|r| vec![r]) };
    let ranges: Vec<[f64; 2]> = ranges.filter(|r: &Vec<[f64; 2]>| !r.is_empty()).ok_or_else(|| wrong(&key, what))?;
    Ok(Drawn { key, ranges, is_list })
}

fn range(value: &Value) -> Option<[f64; 2]> {
    let number = |v: &Value| v.as_float().or_else(|| v.as_integer().and_then(|n| i32::try_from(n).ok()).map(f64::from));
    match value.as_array()?.as_slice() {
        [low, high] => Some([number(low)?, number(high)?]).filter(|[low, high]| low <= high),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"
about = "test"
seeds = "3..5"
[set]
sim.on_blocks = true
control.lqr_q = [1.0, 2.0, 3.0, 4.0]
[axes]
control.controller = ["balance", "idle"]
push = [{ label = "none" }, { label = "hard", set = { sim.pushes = [{ time_s = 2.0, impulse_ns = 3.0 }] } }]
[draw]
sim.initial_angle_rad = [[-0.01, 0.01], [-0.1, 0.1]]
sim.release_after_s = [1.0, 2.0]
[model_error]
inertia = 0.1
friction = 0.2
[stop]
time_s = 5.0
"#;

    #[test]
    fn every_combination_of_axes_and_seeds_is_a_run() {
        let plan = Plan::parse(TEXT).unwrap();
        let runs = plan.runs();
        assert_eq!(runs.len(), 2 * 2 * 3);
        assert!(runs.iter().enumerate().all(|(i, run)| run.index == i));
        assert_eq!(runs[5].axes["push"], "hard");
        assert_eq!((runs[5].axes["control.controller"].as_str(), runs[5].seed), ("balance", 5));
        for run in &runs {
            let mut keys = run.overrides.clone();
            keys.extend(run.drawn(0));
            crate::config::load(None, &keys).unwrap();
        }
        let pushes = &crate::config::load(None, &runs[5].overrides).unwrap().config.simulation.pushes;
        assert_eq!(pushes.len(), 1);
    }

    #[test]
    fn what_is_drawn_depends_on_seed_and_attempt_alone_and_stays_within() {
        let runs = Plan::parse(&TEXT.replace("3..5", "1..200")).unwrap().runs();
        assert_eq!(runs[0].drawn(0), runs[200].drawn(0), "the same seed on another axis");
        assert_ne!(runs[0].drawn(0), runs[1].drawn(0));
        assert_ne!(runs[0].drawn(0), runs[0].drawn(1));
        for run in &runs[..200] {
            let keys = run.drawn(0);
            let sim = crate::config::load(None, &keys).unwrap().config.simulation;
            assert!(sim.initial_angle_rad[0].abs() <= 0.01 && sim.initial_angle_rad[1].abs() <= 0.1);
        }
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (from, to, key) in [
            ("\"3..5\"", "\"5..3\"", "seeds"),
            ("[\"balance\", \"idle\"]", "\"balance\"", "control.controller"),
            ("[1.0, 2.0]\n[model", "[2.0, 1.0]\n[model", "sim.release_after_s"),
            ("time_s = 5.0\n", "time_s = 0.0\n", "stop.time_s"),
            ("label = \"none\"", "name = \"none\"", "push"),
            ("about", "subject", "unknown field"),
        ] {
            let error = Plan::parse(&TEXT.replace(from, to)).unwrap_err().to_string();
            assert!(error.contains(key), "{from}: {error}");
        }
    }

    #[test]
    fn the_experiments_of_the_repository_are_plans() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("config/experiments");
        let files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|f| f.unwrap().path()).collect();
        assert!(files.len() >= 5);
        for file in files {
            let plan = Plan::parse(&std::fs::read_to_string(&file).unwrap());
            assert!(plan.is_ok_and(|p| !p.runs().is_empty()), "{}", file.display());
        }
    }
}
