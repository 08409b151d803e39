//! The layer table: a room imports only lower layers, never sideways.
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
    LAYERS.iter().find(|(name, _)| *name == room).unwrap_or_else(|| panic!("room `{room}` is not in the table")).1
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
    let code = line.split("//").next().unwrap_or("");
    code.match_indices("crate::")
        .filter(|(at, _)| !code[..*at].ends_with('$'))
        .map(|(at, _)| code[at + 7..].chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect())
        .filter(|room: &String| LAYERS.iter().any(|(name, _)| name == room))
        .collect()
}

#[test]
fn rooms_import_only_lower_layers() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&root, &mut files);
    let mut forbidden = Vec::new();
    for file in files {
        let inside = file.strip_prefix(&root).unwrap();
        let first = inside.components().next().unwrap().as_os_str().to_str().unwrap();
        let room = first.trim_end_matches(".rs");
        if matches!(room, "lib" | "main") {
            continue;
        }
        let text = fs::read_to_string(&file).unwrap();
        for (number, line) in text.lines().enumerate() {
            for target in targets(line) {
                if !may_import(room, &target) {
                    forbidden.push(format!("{}:{}: {room} -> {target}", inside.display(), number + 1));
                }
            }
        }
    }
    assert!(forbidden.is_empty(), "forbidden imports:\n{}", forbidden.join("\n"));
}
