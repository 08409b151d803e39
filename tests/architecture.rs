//! The layer tables: a room imports only lower layers, never sideways. So do the rooms of the diagnosis among themselves.
#![expect(clippy::unwrap_used, clippy::panic, reason = "a test")]

use std::fs;
use std::path::{Path, PathBuf};

const LAYERS: &[(&str, u8)] = &[
    ("base", 0),
    ("msg", 1),
    ("model", 1),
    ("config", 2),
    ("channel", 2),
    ("sensor", 3),
    ("zero", 3),
    ("accumulate", 3),
    ("estimate", 3),
    ("control", 3),
    ("safety", 3),
    ("dispatch", 3),
    ("bus", 3),
    ("rt", 4),
    ("record", 4),
    ("telemetry", 4),
    ("sim", 5),
    ("design", 5),
    ("report", 5),
    ("identify", 6),
    ("experiment", 6),
    ("trial", 6),
    ("latency", 6),
    ("diagnose", 7),
    ("cli", 8),
];

/// Rooms of the diagnosis, and its files that stand in none.
const DIAGNOSE: &[(&str, u8)] = &[
    ("screen", 0),
    ("sentence", 0),
    ("base_model", 0),
    ("library", 1),
    ("robustness", 2),
    ("judge", 3),
    ("search", 4),
    ("nameless", 5),
    ("supposed", 5),
    ("explain", 6),
    ("input_checks", 6),
    ("identification", 7),
    ("pipeline", 7),
    ("input_tests", 8),
];

/// Rooms that share code with no other than these, whatever their layer: room, what it may import, why.
const ALOOF: &[(&str, &[&str])] = &[
    // The exam may not use the equations, fits or rules that it examines.
    ("trial", &["base", "report"]),
];

fn may_import(room: &str, target: &str) -> bool {
    if let Some((_, allowed)) = ALOOF.iter().find(|(name, _)| *name == room) {
        return target == room || allowed.contains(&target);
    }
    target == room || layer(target) < layer(room)
}

fn layer(room: &str) -> u8 {
    layer_in(LAYERS, room)
}

fn layer_in(table: &[(&str, u8)], room: &str) -> u8 {
    table.iter().find(|(name, _)| *name == room).unwrap_or_else(|| panic!("room `{room}` is not in the table")).1
}

fn sources(dir: &Path, out: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
}

/// Rooms named after `crate::` anywhere in the code of a line (comments aside).
fn targets(line: &str) -> Vec<String> {
    let rooms = named_after("crate::", line).into_iter();
    rooms.filter(|room| LAYERS.iter().any(|(name, _)| name == room)).collect()
}

/// Rooms of the diagnosis that are named in the code of a line, by the path from the top or by that from a file of it.
fn targets_in_diagnose(line: &str) -> Vec<String> {
    let from_top = named_after("crate::diagnose::", line);
    let from_file = named_after("super::", line).into_iter();
    from_top.into_iter().chain(from_file.filter(|room| DIAGNOSE.iter().any(|(name, _)| name == room))).collect()
}

/// The word after each `path` in the code of a line. Of a list in braces there is no word: it is empty.
fn named_after(path: &str, line: &str) -> Vec<String> {
    let code = line.split("//").next().unwrap_or("");
    code.match_indices(path)
        .filter(|(at, _)| !code[..*at].ends_with('$'))
        .map(|(at, _)| code[at + path.len()..].chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect())
        .collect()
}

/// Room of a source below `root`: its folder there, or its own name.
fn room_below(root: &Path, file: &Path) -> String {
    let first = file.strip_prefix(root).unwrap().components().next().unwrap();
    first.as_os_str().to_str().unwrap().trim_end_matches(".rs").to_owned()
}

/// Imports below `root` that are not `allowed` (room, target); `targets`: what a line imports; `aside`: files in no room.
fn forbidden(
    root: &Path,
    aside: &[&str],
    targets: impl Fn(&str) -> Vec<String>,
    allowed: impl Fn(&str, &str) -> bool,
) -> Vec<String> {
    let mut files = Vec::new();
    sources(root, &mut files);
    let mut out = Vec::new();
    for file in files {
        let (inside, room) = (file.strip_prefix(root).unwrap(), room_below(root, &file));
        if aside.contains(&room.as_str()) {
            continue;
        }
        for (number, line) in fs::read_to_string(&file).unwrap().lines().enumerate() {
            for target in targets(line).into_iter().filter(|target| !allowed(&room, target)) {
                out.push(format!("{}:{}: {room} -> {target}", inside.display(), number + 1));
            }
        }
    }
    out
}

#[test]
fn rooms_import_only_lower_layers() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let forbidden = forbidden(&root, &["lib", "main"], targets, may_import);
    assert!(forbidden.is_empty(), "forbidden imports:\n{}", forbidden.join("\n"));
}

#[test]
fn rooms_of_the_diagnosis_import_only_lower_layers() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/diagnose");
    // A list of rooms in one line has no name, and is not allowed either.
    let may_import = |room: &str, target: &str| {
        target == room || !target.is_empty() && layer_in(DIAGNOSE, target) < layer_in(DIAGNOSE, room)
    };
    let forbidden = forbidden(&root, &["mod"], targets_in_diagnose, may_import);
    assert!(forbidden.is_empty(), "forbidden imports, one room a line:\n{}", forbidden.join("\n"));
}

#[test]
fn only_the_judge_says_what_is_rejected() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/diagnose");
    let mut files = Vec::new();
    sources(&root, &mut files);
    let others = files.into_iter().filter(|file| room_below(&root, file) != "judge");
    let says = |file: &PathBuf| fs::read_to_string(file).unwrap().contains("Rejected {");
    let who: Vec<PathBuf> = others.filter(says).collect();
    assert!(who.is_empty(), "{who:?}");
}

#[test]
fn an_import_is_seen_in_whatever_way_it_is_written() {
    assert_eq!(targets_in_diagnose("use crate::diagnose::judge::numbers::FORM;"), ["judge"]);
    assert_eq!(targets_in_diagnose("    let x = super::super::search::round::round();"), ["search"]);
    assert_eq!(targets_in_diagnose("use crate::diagnose::{judge, search};"), [""]);
    assert!(targets_in_diagnose("use super::criterion::Context; // crate::diagnose::search").is_empty());
}
