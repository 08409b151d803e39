//! No number that decides hides: every constant and every bare literal that stands in a comparison of the rooms that judge,
//! search and screen is in the list beside this file, and the numbers that decide stand in one file, each with its source.
#![expect(clippy::unwrap_used, clippy::panic, reason = "a test")]

use std::fs;
use std::path::{Path, PathBuf};

/// What judges, searches and screens, below `src`.
const ROOMS: &[&str] = &[
    "diagnose/judge",
    "diagnose/robustness",
    "diagnose/search",
    "diagnose/nameless",
    "diagnose/screen",
    "diagnose/library/initial_guesses.rs",
    "diagnose/explain/answer_sets.rs",
    "diagnose/explain/interest.rs",
    "identify/likelihood.rs",
];

/// Most numbers that decide. It may fall.
const MOST: usize = 15;

fn sources() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

fn files() -> Vec<PathBuf> {
    let mut out = Vec::new();
    for room in ROOMS {
        let path = sources().join(room);
        if path.is_dir() {
            out.extend(fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path()));
        } else {
            out.push(path);
        }
    }
    out.sort();
    out
}

/// The code of a file: tests, comments and texts left out.
fn code(path: &Path) -> Vec<String> {
    let text = fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let mut out = Vec::new();
    for line in text.lines().take_while(|l| !l.trim_start().starts_with("#[cfg(test)]")) {
        let line = line.split("//").next().unwrap();
        let pieces = line.split('"').step_by(2).map(str::to_owned);
        out.push(pieces.collect::<Vec<_>>().join("\"\""));
    }
    out
}

/// Words and signs of a line.
fn tokens(line: &str) -> Vec<String> {
    let (mut out, mut now): (Vec<String>, String) = (Vec::new(), String::new());
    let mut push = |now: &mut String| {
        if !now.is_empty() {
            out.push(std::mem::take(now));
        }
    };
    let chars: Vec<char> = line.chars().collect();
    for (i, c) in chars.iter().enumerate() {
        let in_number = now.starts_with(|c: char| c.is_ascii_digit());
        let decimal = *c == '.' && in_number && chars.get(i + 1).is_none_or(char::is_ascii_digit);
        let exponent = *c == '-' && in_number && now.ends_with('e') && !now.starts_with("0x");
        if c.is_alphanumeric() || *c == '_' || decimal || exponent {
            now.push(*c);
            continue;
        }
        push(&mut now);
        if !c.is_whitespace() {
            now.push(*c);
            let pair: String = chars[i..].iter().take(2).collect();
            if !["<=", ">=", "==", "!=", "->", "=>"].contains(&pair.as_str()) {
                push(&mut now);
            }
        } else {
            push(&mut now);
        }
        // The second half of a pair joins the first.
        if ["<=", ">=", "==", "!=", "->", "=>"].contains(&now.as_str()) {
            push(&mut now);
        }
    }
    push(&mut now);
    joined(out)
}

/// `<` and `=` that stood side by side as one sign.
fn joined(tokens: Vec<String>) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    for token in tokens {
        let last = out.last().map(String::as_str);
        let is_second = matches!((last, token.as_str()), (Some("<" | ">" | "=" | "!"), "=") | (Some("-" | "="), ">"));
        if is_second && let Some(last) = out.last_mut() {
            last.push_str(&token);
        } else {
            out.push(token);
        }
    }
    out
}

/// Numbers that bound nothing by themselves: none, one, a pair.
fn is_trivial(number: &str) -> bool {
    let plain = number.trim_end_matches("f64").trim_end_matches("usize");
    ["0", "0.0", "1", "1.0", "2"].contains(&plain)
}

/// Literals of a line that stand in a comparison, or in a bound: on either side of `<`, `>`, `<=`, `>=`, up to the next sign
/// that ends it, or as the argument of `max`, `min` and `clamp`.
fn bare(line: &str) -> Vec<String> {
    let tokens = tokens(line);
    let is_number = |t: &str| t.starts_with(|c: char| c.is_ascii_digit()) && !is_trivial(t);
    let ends = |t: &str| [",", ";", "{", "}", "&&", "|", "=", "=>", "?", "&"].contains(&t);
    let mut out = Vec::new();
    for (i, token) in tokens.iter().enumerate() {
        let near: Vec<&String> = match token.as_str() {
            "<" | ">" | "<=" | ">=" => {
                let before = tokens[..i].iter().rev().take_while(|t| !ends(t)).take(6);
                before.chain(tokens[i + 1..].iter().take_while(|t| !ends(t)).take(6)).collect()
            }
            "max" | "min" | "clamp" if tokens.get(i + 1).is_some_and(|t| t == "(") => {
                tokens[i + 2..].iter().take_while(|t| *t != ")").collect()
            }
            _ => continue,
        };
        out.extend(near.into_iter().filter(|t| is_number(t)).cloned());
    }
    out.dedup();
    out
}

fn constants(lines: &[String]) -> Vec<String> {
    let one = |line: &String| {
        let line = line.trim();
        let rest = line.strip_prefix("pub(super) const ").or_else(|| line.strip_prefix("pub const "));
        let rest = rest.or_else(|| line.strip_prefix("const ")).filter(|rest| !rest.starts_with("fn "))?;
        let (name, value) = rest.split_once(':')?;
        let number = ["f64", "usize", "u64", "u32", "[f64", "[usize"].iter().any(|t| value.trim().starts_with(t));
        number.then(|| format!("{name} ={}", value.split_once('=').map_or("", |(_, v)| v).trim_end_matches(';')))
    };
    lines.iter().filter_map(one).collect()
}

#[test]
fn every_number_that_decides_is_listed() {
    let mut found = Vec::new();
    for path in files() {
        let name = path.strip_prefix(sources()).unwrap().display().to_string();
        let lines = code(&path);
        if name != "diagnose/judge/numbers.rs" {
            found.extend(constants(&lines).into_iter().map(|c| format!("{name}: {c}")));
        }
        let code_of_line = lines.iter().filter(|l| !l.contains("const "));
        found.extend(code_of_line.flat_map(|l| bare(l)).map(|n| format!("{name}: bare {n}")));
    }
    found.sort();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/decision_numbers.txt");
    let listed = fs::read_to_string(&path).unwrap_or_default();
    let mut listed: Vec<String> = listed.lines().filter(|l| !l.starts_with('#')).map(str::to_owned).collect();
    listed.sort();
    let missing: Vec<&String> = found.iter().filter(|f| !listed.contains(f)).collect();
    let gone: Vec<&String> = listed.iter().filter(|l| !found.contains(l)).collect();
    assert!(
        missing.is_empty() && gone.is_empty() && found.len() == listed.len(),
        "{}: new in the code {missing:#?}, no longer there {gone:#?}; {} found, {} listed",
        path.display(),
        found.len(),
        listed.len()
    );
}

#[test]
fn numbers_that_decide_stand_in_one_file_each_with_its_source_and_do_not_grow_in_number() {
    let text = fs::read_to_string(sources().join("diagnose/judge/numbers.rs")).unwrap();
    let mut comment = String::new();
    let mut count = 0;
    for line in text.lines() {
        if let Some(words) = line.strip_prefix("///") {
            comment.push_str(words);
        } else if let Some(name) = line.strip_prefix("pub const ") {
            count += 1;
            let told = ["*Measured", "*Argued", "*Tuned", "*Stated", "*By definition", "*Derived", "See [`"];
            assert!(told.iter().any(|t| comment.contains(t)), "where does {name} come from?");
            comment.clear();
        }
    }
    assert!(count <= MOST, "{count} numbers decide; {MOST} did");
    for path in files().into_iter().filter(|p| p.parent().is_some_and(|d| d.ends_with("judge"))) {
        if !path.ends_with("numbers.rs") {
            assert!(constants(&code(&path)).is_empty(), "{}: a number outside numbers.rs", path.display());
        }
    }
}

#[test]
fn a_comparison_with_a_literal_is_seen_and_one_with_nothing_is_not() {
    assert_eq!(bare("    if a.gain > 0.4 * most && b < 1.0 {"), ["0.4"]);
    assert_eq!(bare("let x = y.max(1e-9);"), ["1e-9"]);
    assert!(bare("let x: Vec<f64> = all.iter().map(|x| 3.0 * x).collect();").is_empty());
    assert!(bare("if runs.len() > 0 {").is_empty());
}
