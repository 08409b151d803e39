//! L2: configuration. What a person typed (`raw`) becomes [`checked`]: valid by construction, units in names.
//!
//! Four sections, each a file in `config/` and embedded as default: `robot`, `rt`, `control`, `sim`.
//! [`load`] takes a folder that holds some of `robot.toml`, `rt.toml`, `control.toml`, `sim.toml`; or one of these four
//! by its name; or any other file with tables `[robot]`, `[rt]`, `[control]`, `[sim]` and `[set]`.
//! A section is taken whole: no key of it is ever filled in from the default, so no physical quantity comes from
//! nowhere. Single keys are changed openly, by `[set]` in the file (`robot.bus0.backend = "socketcan:can0"`) or by
//! `--set` on the command line, which goes last.
//! [`Choice::model`] puts the model of a diagnosis in the place of `robot.model`.
//! RT: before arming only.

mod arming;
pub mod checked;
mod consistency;
mod drive;
mod drives;
pub mod fault;
mod floor_profile;
mod lidar;
mod mocap;
mod model;
mod model_error;
mod operator;
mod problem;
mod process;
pub mod raw;
pub mod reader;
mod rig_model;
mod robot;
mod simulation;

use checked::Config;
use fault::{Injection, Place};
use problem::ACROSS_KEYS;
use raw::{Node, Origin, Raw};
use reader::Log;
use rig_model::RigModel;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::io::{self, Read};
use std::path::Path;
use std::sync::{Arc, LazyLock};

pub use problem::{Errors, Problem};
pub use raw::Setting;

/// Sections with their embedded defaults.
const SECTIONS: [(&str, &str, &str); 4] = [
    ("robot", "robot.toml", include_str!("../../config/robot.toml")),
    ("rt", "rt.toml", include_str!("../../config/rt.toml")),
    ("control", "control.toml", include_str!("../../config/control.toml")),
    ("sim", "sim.toml", include_str!("../../config/sim.toml")),
];

/// What errors call these files begins with this.
const EMBEDDED_FILE: &str = "embedded ";

/// These files as trees, parsed once: some read thousands of configurations.
static EMBEDDED: LazyLock<Vec<Result<Node, Vec<Problem>>>> =
    LazyLock::new(|| SECTIONS.map(|(_, file, text)| raw::parse(&format!("{EMBEDDED_FILE}{file}"), text)).into());

/// A configuration after all checks, with what a recording needs to know of it.
#[derive(Clone, Debug)]
pub struct Resolved {
    /// The checked values.
    pub config: Config,
    /// Canonical text: one `section.key = value` per line, sorted. TOML; [`from_canonical`] reads it back.
    pub text: String,
    /// SHA-256 of the text, hexadecimal.
    pub hash: String,
    /// Suspicious, but not wrong.
    pub warnings: Vec<Problem>,
    /// Where each section came from.
    pub sources: Vec<(&'static str, String)>,
    typed: Arc<Sections>,
}

impl Resolved {
    /// What is wrong with a key by the word of the room that uses it, with the place where the key was typed.
    #[must_use]
    pub fn problem(&self, key: &str, what: String) -> Problem {
        let at = place_of(&self.typed, key);
        let (file, line) = at.map_or((ACROSS_KEYS, 0), |at| (&at.file, at.line));
        Problem { file: file.to_owned(), line, key: key.to_owned(), value: None, what }
    }
}

/// The sections as typed.
type Sections = BTreeMap<&'static str, Node>;

/// Where the first of some keys was typed that is not as in the program.
fn typed_place(sections: &Sections, keys: &str) -> Option<Origin> {
    let places: Vec<&Origin> = keys.split(", ").filter_map(|key| place_of(sections, key)).collect();
    let typed = places.iter().find(|at| !at.file.starts_with(EMBEDDED_FILE));
    typed.or(places.first()).map(|at| (*at).clone())
}

/// Where a key was typed, such as `robot.bus0.backend`; one that is not there: the innermost table around it.
fn place_of<'a>(sections: &'a Sections, key: &str) -> Option<&'a Origin> {
    let mut path = key.split('.');
    let mut node = sections.get(path.next()?)?;
    for name in path {
        match node.table().and_then(|keys| keys.get(name)) {
            Some(inner) => node = inner,
            None => break,
        }
    }
    Some(&node.at)
}

/// Reads, overrides and checks a configuration. `path`: see the head of this module; `None` = embedded defaults.
///
/// # Errors
/// Everything that is wrong, at once.
pub fn load(path: Option<&Path>, overrides: &[String]) -> Result<Resolved, Errors> {
    let overrides = &of_command_line(overrides);
    load_choice(Choice { path, overrides, ..Choice::default() })
}

/// What a person chose on the command line.
#[derive(Clone, Copy, Debug, Default)]
pub struct Choice<'a> {
    /// See the head of this module; `None` = embedded defaults.
    pub path: Option<&'a Path>,
    /// A model file whose physics observer and controller shall know; see `rig_model`.
    pub model: Option<&'a Path>,
    /// Single values; go last, in this order.
    pub overrides: &'a [Setting],
    /// Faults to inject, `NAME@TIME[:ARGS]`; added to those of `sim.faults`.
    pub faults: &'a [String],
    /// Where they are injected; `None` = nobody injects any.
    pub place: Option<Place>,
    /// The program is the simulated robot itself on real buses, so nobody's hand and no real IMU is needed.
    pub plays_robot: bool,
}

/// [`load`] with the model of a diagnosis.
///
/// # Errors
/// Everything that is wrong, at once.
pub fn load_choice(choice: Choice<'_>) -> Result<Resolved, Errors> {
    let mut typed = Typed::default();
    if let Some(path) = choice.path {
        typed.add_path(path);
    }
    if let Some(path) = choice.model {
        match RigModel::read(path) {
            Ok(model) => typed.model = Some(model),
            Err(problems) => typed.problems.extend(problems),
        }
    }
    choice.overrides.iter().for_each(|setting| typed.add_override(setting));
    typed.faults = choice.faults.to_vec();
    typed.place = choice.place;
    typed.plays_robot = choice.plays_robot;
    typed.resolve()
}

/// Reads a text with tables `[robot]`, `[rt]`, `[control]`, `[sim]` and `[set]`; `name` is told in errors.
///
/// # Errors
/// Everything that is wrong, at once.
pub fn load_text(name: &str, text: &str, overrides: &[String]) -> Result<Resolved, Errors> {
    let mut typed = Typed::default();
    typed.add_sections(name, text);
    of_command_line(overrides).iter().for_each(|setting| typed.add_override(setting));
    typed.resolve()
}

/// Reads the canonical text of a recording, with overrides as on the command line. It moves no motor, whatever it says
/// of hand and IMU.
///
/// # Errors
/// Everything that is wrong: the text is from another version of this program, or damaged.
pub fn from_canonical(text: &str, overrides: &[String]) -> Result<Resolved, Errors> {
    let mut typed = Typed { plays_robot: true, ..Typed::default() };
    typed.add_sections("recorded configuration", text);
    of_command_line(overrides).iter().for_each(|setting| typed.add_override(setting));
    typed.resolve()
}

/// Values of `--set`.
fn of_command_line(overrides: &[String]) -> Vec<Setting> {
    overrides.iter().map(|text| Setting::of_option("--set", text)).collect()
}

/// Sections and overrides as typed.
#[derive(Default)]
struct Typed {
    sections: Sections,
    model: Option<RigModel>,
    overrides: Vec<(String, Node)>,
    faults: Vec<String>,
    place: Option<Place>,
    problems: Vec<Problem>,
    plays_robot: bool,
}

impl Typed {
    fn add_path(&mut self, path: &Path) {
        if path.is_dir() {
            let files: Vec<_> = SECTIONS.iter().map(|(_, file, _)| path.join(file)).filter(|f| f.exists()).collect();
            if files.is_empty() {
                self.complain(path, "holds none of robot.toml, rt.toml, control.toml, sim.toml");
            }
            files.iter().for_each(|file| self.add_file(file));
        } else {
            self.add_file(path);
        }
    }

    fn add_file(&mut self, path: &Path) {
        let name = path.display().to_string();
        let text = match read_bounded(path) {
            Ok(text) => text,
            Err(error) => return self.complain(path, &format!("cannot be read: {error}")),
        };
        let section = SECTIONS.iter().find(|(_, file, _)| path.file_name().is_some_and(|f| f == *file));
        match (section, raw::parse(&name, &text)) {
            (_, Err(problems)) => self.problems.extend(problems),
            (Some((section, _, _)), Ok(node)) => {
                self.sections.insert(section, node);
            }
            (None, Ok(_)) => self.add_sections(&name, &text),
        }
    }

    /// A text with tables named after the sections, and `[set]`.
    fn add_sections(&mut self, name: &str, text: &str) {
        let node = match raw::parse(name, text) {
            Ok(node) => node,
            Err(problems) => return self.problems.extend(problems),
        };
        let Raw::Table(tables) = node.value else { return };
        for (key, node) in tables {
            if key == "set" {
                self.add_set("", &node);
            } else if let Some((section, _, _)) = SECTIONS.iter().find(|(section, _, _)| *section == key) {
                self.sections.insert(section, node);
            } else {
                let what = "unknown section; known: robot, rt, control, sim, set".to_owned();
                let Origin { file, line } = node.at;
                self.problems.push(Problem { file: file.to_string(), line, key, value: None, what });
            }
        }
    }

    /// Leaves of `[set]` become overrides.
    fn add_set(&mut self, path: &str, node: &Node) {
        let Some(children) = node.table() else {
            self.overrides.push((path.to_owned(), node.clone()));
            return;
        };
        for (key, child) in children {
            let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
            self.add_set(&path, child);
        }
    }

    fn add_override(&mut self, setting: &Setting) {
        match raw::parse_setting(setting) {
            Ok(parsed) => self.overrides.push(parsed),
            Err(problem) => self.problems.push(problem),
        }
    }

    fn complain(&mut self, path: &Path, what: &str) {
        let file = path.display().to_string();
        self.problems.push(Problem { file, line: 0, key: String::new(), value: None, what: what.to_owned() });
    }

    fn resolve(mut self) -> Result<Resolved, Errors> {
        let sources = self.fill_in_defaults();
        let notes = self.apply_model();
        self.apply_overrides();
        self.add_faults();
        if !self.problems.is_empty() {
            return Err(Errors(self.problems));
        }
        let log = Log::default();
        let section = |name: &str| self.sections.get(name).cloned().unwrap_or_else(|| Node::empty(name));
        let mut config = Config {
            robot: reader::read(&log, "robot", &section("robot"), robot::robot),
            real_time: reader::read(&log, "rt", &section("rt"), process::real_time),
            control: reader::read(&log, "control", &section("control"), process::control),
            simulation: reader::read(&log, "sim", &section("sim"), simulation::simulation),
        };
        if log.is_clean() {
            model_error::draw(&mut config);
            consistency::check(&config, &log);
            if !self.plays_robot {
                consistency::made_up_senses(&config.robot, &log);
            }
            self.check_places(&config.simulation.faults, &log);
        }
        log.locate(|keys| typed_place(&self.sections, keys));
        let (text, mut warnings) = log.finish()?;
        warnings.extend(notes);
        Ok(Resolved { config, hash: sha256(&text), text, warnings, sources, typed: Arc::new(self.sections) })
    }

    /// Sections that nobody gave come whole from the embedded files.
    fn fill_in_defaults(&mut self) -> Vec<(&'static str, String)> {
        let mut sources = Vec::new();
        for ((section, file, _), embedded) in SECTIONS.into_iter().zip(&*EMBEDDED) {
            let source = match self.sections.get(section) {
                Some(node) => node.at.file.to_string(),
                None => {
                    match embedded {
                        Ok(node) => drop(self.sections.insert(section, node.clone())),
                        Err(problems) => self.problems.extend(problems.iter().cloned()),
                    }
                    format!("{EMBEDDED_FILE}{file}")
                }
            };
            sources.push((section, source));
        }
        sources
    }

    /// Puts the model of `--model` in the place of `robot.model`; the simulated robot keeps the old one. What was not
    /// taken over.
    fn apply_model(&mut self) -> Vec<Problem> {
        let Some(model) = self.model.take() else { return Vec::new() };
        let old = self.sections.get("robot").and_then(|r| r.table()?.get("model")).cloned();
        if let (Some(mut body), Some(sim)) = (old, self.sections.get_mut("sim")) {
            // The compliance of the real hip has its own place: sim.hip_elasticity.
            body.remove("hip_elasticity");
            if sim.table().is_some_and(|keys| !keys.contains_key("body")) {
                sim.put(&["body"], body);
            }
        }
        if let Some(robot) = self.sections.get_mut("robot") {
            for (key, node) in model.values {
                let path: Vec<&str> = std::iter::once("model").chain(key).collect();
                robot.put(&path, node);
            }
        }
        model.notes
    }

    /// Adds the faults of the command line to those of the files.
    fn add_faults(&mut self) {
        let Some(sim) = self.sections.get_mut("sim").filter(|_| !self.faults.is_empty()) else { return };
        let at = Origin { file: "--fault".into(), line: 0 };
        let mut all = match sim.table().and_then(|keys| keys.get("faults")).map(|node| &node.value) {
            Some(Raw::List(items)) => items.clone(),
            _ => Vec::new(),
        };
        all.extend(self.faults.drain(..).map(|text| Node { at: at.clone(), value: Raw::Text(text) }));
        sim.put(&["faults"], Node { at, value: Raw::List(all) });
    }

    /// A fault that cannot be injected where the robot runs would never come, and nobody would know.
    fn check_places(&self, faults: &[Injection], log: &Log) {
        let Some(place) = self.place else { return };
        let typed = self.sections.get("sim").and_then(|sim| sim.table()?.get("faults"));
        let Some(Raw::List(items)) = typed.map(|node| &node.value) else { return };
        for (i, (fault, item)) in faults.iter().zip(items).enumerate() {
            if let Err(what) = fault.check_place(place) {
                let Origin { file, line } = &item.at;
                let (file, key) = (file.to_string(), format!("sim.faults[{i}]"));
                log.error(Problem { file, line: *line, key, value: Some(item.show()), what });
            }
        }
    }

    fn apply_overrides(&mut self) {
        for (key, leaf) in std::mem::take(&mut self.overrides) {
            let path: Vec<&str> = key.split('.').collect();
            match path.split_first().and_then(|(first, rest)| Some((self.sections.get_mut(*first)?, rest))) {
                Some((node, rest)) if !rest.is_empty() => node.put(rest, leaf),
                _ => {
                    let what = "a key starts with robot, rt, control or sim".to_owned();
                    let Origin { file, line } = leaf.at.clone();
                    self.problems.push(Problem { file: file.to_string(), line, key, value: Some(leaf.show()), what });
                }
            }
        }
    }
}

/// A configuration has some kB. A device or a file of any length must not fill the memory.
const LONGEST_FILE: u64 = 4 << 20;

fn read_bounded(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    fs::File::open(path)?.take(LONGEST_FILE + 1).read_to_string(&mut text)?;
    if text.len() as u64 > LONGEST_FILE {
        return Err(io::Error::other(format!("longer than {} MiB: no configuration", LONGEST_FILE >> 20)));
    }
    Ok(text)
}

fn sha256(text: &str) -> String {
    let mut hex = String::new();
    for byte in Sha256::digest(text.as_bytes()) {
        write!(hex, "{byte:02x}").unwrap_or_default();
    }
    hex
}

#[cfg(test)]
mod tests;
