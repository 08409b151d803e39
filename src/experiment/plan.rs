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

use crate::config::raw::{self, Node, Origin, Raw};
use crate::config::reader::{self, Log, Range, Reader, range};
use crate::config::{Errors, Setting};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Makes what is drawn per run another stream than the noise of the simulated robot.
const STREAM: u64 = 0x6472_6177;
/// How long a run may be.
const TIME_S: Range = range(1e-3, 1e7, "s");
/// Steps after which a run may end.
const MOST_STEPS: i64 = u32::MAX as i64;
/// By how much the real machine may differ from the model.
const ERROR_SHARE: Range = range(0.0, 0.9, "1");

/// When a run ends although nothing fell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stop {
    /// After so many true steps; none: the time decides.
    pub steps: Option<u32>,
    /// After so much simulated time, s. With `steps`: a run that has not made them by then has failed.
    pub time_s: f64,
}

/// One value of an axis.
#[derive(Clone, Debug, PartialEq)]
struct Choice {
    label: String,
    overrides: Vec<Setting>,
    draw: Vec<Drawn>,
}

/// One key that is varied.
#[derive(Clone, Debug, PartialEq)]
struct Axis {
    key: String,
    choices: Vec<Choice>,
}

/// Numbers, each uniform between two ends.
#[derive(Clone, Debug, PartialEq)]
struct Drawn {
    key: String,
    at: Origin,
    ranges: Vec<[f64; 2]>,
    form: Form,
}

/// What drawn numbers are written as.
#[derive(Clone, Debug, PartialEq)]
enum Form {
    Number,
    List,
    /// Tables with these keys, such as those of `sim.pushes`.
    Rows(Vec<Vec<String>>),
}

impl Form {
    fn text(&self, values: &[String]) -> String {
        match self {
            Self::Number => values.join(""),
            Self::List => format!("[{}]", values.join(", ")),
            Self::Rows(rows) => {
                let mut values = values.iter();
                let mut row = |keys: &Vec<String>| {
                    let cells: Vec<String> =
                        keys.iter().zip(values.by_ref()).map(|(key, x)| format!("{key} = {x}")).collect();
                    format!("{{ {} }}", cells.join(", "))
                };
                format!("[{}]", rows.iter().map(&mut row).collect::<Vec<_>>().join(", "))
            }
        }
    }
}

/// Labels, keys and draws of one choice on every axis.
type Combination = (BTreeMap<String, String>, Vec<Setting>, Vec<Drawn>);

/// An experiment.
#[derive(Clone, Debug)]
pub struct Plan {
    /// What it is about, in a line.
    pub about: String,
    /// First and last seed.
    pub seeds: [u64; 2],
    /// When a run ends.
    pub stop: Stop,
    seeds_at: Origin,
    set: Vec<Setting>,
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
    /// The configuration without what the seed draws.
    pub overrides: Vec<Setting>,
    draw: Vec<Drawn>,
}

impl Plan {
    /// Reads the text of a file.
    ///
    /// # Errors
    /// Everything that is wrong, at once.
    pub fn parse(file: &str, text: &str) -> Result<Self, Errors> {
        let node = raw::parse(file, text).map_err(Errors)?;
        let log = Log::default();
        let plan = reader::read(&log, "", &node, |r| Self::read(r, &node));
        log.finish()?;
        Ok(plan)
    }

    fn read(r: &Reader<'_>, file: &Node) -> Self {
        let set = named(r, "set").map(|(_, key, node)| Setting::of_node(&key, node));
        let error = r.optional_table("model_error", |r| {
            // Only checked: the simulation reads them as keys of its own.
            ["inertia", "friction"].map(|key| r.number(key, ERROR_SHARE))
        });
        let error = error.and_then(|_| r.optional_node("model_error")).into_iter().flat_map(Node::leaves);
        let error = error.map(|(key, node)| Setting::of_node(&format!("sim.model_error.{key}"), node));
        Self {
            about: r.text("about"),
            seeds: seeds(&r.text("seeds")).unwrap_or_else(|what| {
                r.refuse("seeds", &what);
                [0, 0]
            }),
            seeds_at: r.optional_node("seeds").unwrap_or(file).at.clone(),
            stop: r.table("stop", |r| Stop {
                steps: r.optional_integer("steps", 1, MOST_STEPS, "1"),
                time_s: r.number("time_s", TIME_S),
            }),
            set: set.chain(error).collect(),
            axes: named(r, "axes").filter_map(|(place, key, node)| axis(r, &place, key, node)).collect(),
            draw: named(r, "draw").filter_map(|(place, key, node)| drawn(r, &place, key, node)).collect(),
        }
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
                overrides.push(Setting { at: self.seeds_at.clone(), text: format!("sim.seed={seed}") });
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

    /// What the seed draws; `attempt` counts draws that no robot can start from.
    #[must_use]
    pub fn drawn(&self, attempt: u32) -> Vec<Setting> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed ^ STREAM);
        rng.set_stream(u64::from(attempt));
        #[expect(clippy::cast_precision_loss, reason = "53 bits")]
        let mut uniform = || (rng.next_u64() >> 11) as f64 / 9_007_199_254_740_992.0;
        let mut out = Vec::new();
        for d in &self.draw {
            let values: Vec<String> =
                d.ranges.iter().map(|[low, high]| format!("{:?}", low + (high - low) * uniform())).collect();
            out.push(Setting { at: d.at.clone(), text: format!("{}={}", d.key, d.form.text(&values)) });
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

/// Leaves of a table that may be left out: place in the file, key of the configuration, value.
fn named<'a>(r: &'a Reader<'_>, table: &'static str) -> impl Iterator<Item = (String, String, &'a Node)> {
    let node = r.optional_node(table).filter(|node| {
        let is_table = node.table().is_some();
        if !is_table {
            r.refuse(table, "must be a table");
        }
        is_table
    });
    node.into_iter().flat_map(Node::leaves).map(move |(key, node)| (format!("{table}.{key}"), key, node))
}

fn axis(r: &Reader<'_>, place: &str, key: String, node: &Node) -> Option<Axis> {
    let Raw::List(items) = &node.value else {
        r.refuse_node(place, node, "must be a list: an axis has values");
        return None;
    };
    if items.is_empty() {
        r.refuse_node(place, node, "must have a value at least");
    }
    Some(Axis { choices: items.iter().filter_map(|item| choice(r, place, &key, item)).collect(), key })
}

fn choice(r: &Reader<'_>, place: &str, key: &str, item: &Node) -> Option<Choice> {
    let Some(bundle) = item.table() else {
        let label = if let Raw::Text(text) = &item.value { text.clone() } else { item.inline() };
        return Some(Choice { label, overrides: vec![Setting::of_node(key, item)], draw: Vec::new() });
    };
    let Some(Raw::Text(label)) = bundle.get("label").map(|node| &node.value) else {
        r.refuse_node(place, item, "a bundle of keys needs a label: { label = \"...\", set = { ... } }");
        return None;
    };
    for (name, node) in bundle {
        if !["label", "set", "draw"].contains(&name.as_str()) {
            r.refuse_node(&format!("{place}.{name}"), node, "unknown key; known here: label, set, draw");
        } else if name != "label" && node.table().is_none() {
            r.refuse_node(&format!("{place}.{name}"), node, "must be a table");
        }
    }
    let leaves = |name: &str| bundle.get(name).filter(|node| node.table().is_some()).into_iter().flat_map(Node::leaves);
    let overrides = leaves("set").map(|(key, node)| Setting::of_node(&key, node)).collect();
    let draw = leaves("draw").filter_map(|(key, node)| drawn(r, &format!("{place}.draw.{key}"), key, node)).collect();
    Some(Choice { label: label.clone(), overrides, draw })
}

fn drawn(r: &Reader<'_>, place: &str, key: String, node: &Node) -> Option<Drawn> {
    let items = if let Raw::List(items) = &node.value { items.as_slice() } else { &[] };
    let all = |is: fn(&Node) -> bool| !items.is_empty() && items.iter().all(is);
    let found = if all(|item| item.table().is_some()) {
        rows(items)
    } else if all(|item| matches!(item.value, Raw::List(_))) {
        items.iter().map(ends).collect::<Option<_>>().map(|ranges| (ranges, Form::List))
    } else {
        ends(node).map(|ends| (vec![ends], Form::Number))
    };
    let Some((ranges, form)) = found else {
        let what = "must be [low, high] with low not above high, a list of these, or a list of tables with these";
        r.refuse_node(place, node, what);
        return None;
    };
    Some(Drawn { key, at: node.at.clone(), ranges, form })
}

/// Tables of which every value is drawn.
fn rows(items: &[Node]) -> Option<(Vec<[f64; 2]>, Form)> {
    let (mut ranges, mut names) = (Vec::new(), Vec::new());
    for table in items.iter().filter_map(Node::table) {
        ranges.extend(table.values().map(ends).collect::<Option<Vec<_>>>()?);
        names.push(table.keys().cloned().collect());
    }
    Some((ranges, Form::Rows(names)))
}

fn ends(node: &Node) -> Option<[f64; 2]> {
    let Raw::List(items) = &node.value else { return None };
    let number = |node: &Node| if let Raw::Number { value, .. } = node.value { Some(value) } else { None };
    match items.as_slice() {
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

    fn load(settings: &[Setting]) -> crate::config::checked::Simulation {
        let choice = crate::config::Choice { overrides: settings, ..crate::config::Choice::default() };
        crate::config::load_choice(choice).unwrap().config.simulation
    }

    #[test]
    fn every_combination_of_axes_and_seeds_is_a_run() {
        let plan = Plan::parse("e.toml", TEXT).unwrap();
        let runs = plan.runs();
        assert_eq!(runs.len(), 2 * 2 * 3);
        assert!(runs.iter().enumerate().all(|(i, run)| run.index == i));
        assert_eq!(runs[5].axes["push"], "hard");
        assert_eq!((runs[5].axes["control.controller"].as_str(), runs[5].seed), ("balance", 5));
        for run in &runs {
            let mut keys = run.overrides.clone();
            keys.extend(run.drawn(0));
            load(&keys);
        }
        let pushes = load(&runs[5].overrides).pushes;
        assert_eq!(pushes.len(), 1);
    }

    #[test]
    fn what_is_drawn_depends_on_seed_and_attempt_alone_and_stays_within() {
        let runs = Plan::parse("e.toml", &TEXT.replace("3..5", "1..200")).unwrap().runs();
        assert_eq!(runs[0].drawn(0), runs[200].drawn(0), "the same seed on another axis");
        assert_ne!(runs[0].drawn(0), runs[1].drawn(0));
        assert_ne!(runs[0].drawn(0), runs[0].drawn(1));
        for run in &runs[..200] {
            let sim = load(&run.drawn(0));
            assert!(sim.initial_angle_rad[0].abs() <= 0.01 && sim.initial_angle_rad[1].abs() <= 0.1);
        }
    }

    #[test]
    fn pushes_are_drawn_as_rows_one_for_each_run() {
        let rows = "sim.pushes = [{ time_s = [1.5, 4.0], impulse_ns = [-6.0, 6.0] }]\nsim.release";
        let text = TEXT.replace("3..5", "1..200").replacen("sim.release", rows, 1);
        let runs = Plan::parse("e.toml", &text).unwrap().runs();
        let pushes: Vec<_> = runs[..200].iter().map(|run| load(&run.drawn(0)).pushes).collect();
        assert!(pushes.iter().all(|pushes| pushes.len() == 1));
        let first = |k: usize| (pushes[k][0].time_s, pushes[k][0].impulse_ns);
        assert!((0..200).map(first).all(|(t, p)| (1.5..=4.0).contains(&t) && p.abs() <= 6.0));
        assert!(pushes.windows(2).all(|pair| pair[0] != pair[1]), "each its own");
        let wrong = text.replace("time_s = [1.5, 4.0]", "time_s = 1.5");
        let error = Plan::parse("e.toml", &wrong).unwrap_err().to_string();
        assert!(error.contains("e.toml:12: draw.sim.pushes") && error.contains("a list of tables"), "{error}");
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (from, to, told) in [
            ("\"3..5\"", "\"5..3\"", "e.toml:3: seeds = \"5..3\": "),
            (
                "[\"balance\", \"idle\"]",
                "\"balance\"",
                "e.toml:8: axes.control.controller = \"balance\": must be a list",
            ),
            ("[1.0, 2.0]\n[model", "[2.0, 1.0]\n[model", "e.toml:12: draw.sim.release_after_s = [2.0, 1.0]: must be"),
            ("time_s = 5.0\n", "time_s = 0.0\n", "e.toml:17: stop.time_s = 0.0: must be 0.001 to"),
            ("label = \"none\"", "name = \"none\"", "e.toml:9: axes.push = a table: a bundle of keys needs a label"),
            ("about", "subject", "e.toml:2: subject = \"test\": unknown key; known here: about, axes"),
            ("inertia = 0.1", "inertia = 2", "e.toml:14: model_error.inertia = 2: must be 0 to 0.9"),
            ("[stop]", "[stop", "e.toml:16: not TOML"),
        ] {
            let error = Plan::parse("e.toml", &TEXT.replace(from, to)).unwrap_err().to_string();
            assert!(error.contains(told), "{from}: {error}");
        }
        let both = TEXT.replace("\"3..5\"", "\"5..3\"").replace("about", "subject").replace("5.0\n", "-1.0\n");
        assert_eq!(Plan::parse("e.toml", &both).unwrap_err().0.len(), 4, "the missing `about` among them");
    }

    #[test]
    fn the_experiments_of_the_repository_are_plans() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("config/experiments");
        let files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|f| f.unwrap().path()).collect();
        assert!(files.len() >= 5);
        for file in files {
            let plan = Plan::parse("e.toml", &std::fs::read_to_string(&file).unwrap());
            assert!(plan.is_ok_and(|p| !p.runs().is_empty()), "{}", file.display());
        }
    }
}
