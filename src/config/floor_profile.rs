//! Reads `sim.floor.profile`: slopes of the simulated floor, from a file or as pairs. RT: before arming only.
//!
//! The file is CSV: a line that names the columns `place_m,height_m`, then a point in each line; empty lines and those that
//! begin with `#` say nothing. A recording holds the points, so it needs no file.

use super::raw::Raw;
use super::read_bounded;
use super::reader::{Range, Reader, range};
use std::path::Path;

/// Names of the columns, units included.
const COLUMNS: [&str; 2] = ["place_m", "height_m"];
/// Enough for 100 m in steps of 10 mm; a canonical text has them in one line.
const MOST_POINTS: usize = 10_000;
/// Steepest rise, m per m (14 degrees): on such a slope the round tip of a toe errs by .6 mm (`model::machine::floor`).
const STEEPEST: f64 = 0.25;
/// So far from the start the floor is level: the robot is put there with both feet, m.
const LEVEL_M: f64 = 0.5;

const PLACE: Range = range(-1e3, 1e6, "m");
const HEIGHT: Range = range(-100.0, 100.0, "m");

/// The points of a profile; none if the key is not there or wrong.
pub(super) fn profile(r: &Reader<'_>, key: &'static str) -> Vec<[f64; 2]> {
    let Some(node) = r.optional_node(key) else { return Vec::new() };
    let points = match &node.value {
        Raw::Text(file) => of_file(file).inspect(|points| r.note_pairs(key, points)),
        Raw::List(_) => {
            let points = r.pairs(key, PLACE, HEIGHT);
            // What is no number in its range was said already.
            let is_read = points.iter().flatten().all(|x| x.is_finite());
            let lines: Vec<String> = (1..=points.len()).map(|k| format!("point {k}")).collect();
            if is_read { check(&points, &lines).map(|()| points) } else { Ok(points) }
        }
        _ => Err("must be a file in quotes, or a list of pairs of numbers".to_owned()),
    };
    points.unwrap_or_else(|what| {
        r.refuse(key, &what);
        Vec::new()
    })
}

fn of_file(file: &str) -> Result<Vec<[f64; 2]>, String> {
    let text = read_bounded(Path::new(file)).map_err(|error| format!("cannot be read: {error}"))?;
    parse(&text)
}

/// The points of a file.
fn parse(text: &str) -> Result<Vec<[f64; 2]>, String> {
    let told = |line: &(usize, &str)| !line.1.is_empty() && !line.1.starts_with('#');
    let mut lines = text.lines().map(str::trim).enumerate().filter(told);
    let header = lines.next().map_or("", |(_, line)| line);
    let begins: String = header.chars().take(60).collect();
    if !header.split(',').map(str::trim).eq(COLUMNS) {
        return Err(format!("must begin with the names of its columns, `{}`, not with `{begins}`", COLUMNS.join(",")));
    }
    let (mut points, mut places) = (Vec::new(), Vec::new());
    for (index, line) in lines {
        let place = format!("line {}", index + 1);
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let [x, height] = cells.as_slice() else {
            return Err(format!("{place}: must have two columns, `{}`, not `{line}`", COLUMNS.join(",")));
        };
        let number = |column: usize, cell: &str, range: Range| {
            let value: Option<f64> = cell.parse().ok().filter(|value| range.contains(*value));
            value
                .ok_or_else(|| format!("{place}: {} = {cell}: must be a number, {}", COLUMNS[column], range.describe()))
        };
        points.push([number(0, x, PLACE)?, number(1, height, HEIGHT)?]);
        places.push(place);
    }
    check(&points, &places)?;
    Ok(points)
}

/// A robot can stand at its start and walk on; `lines` are where the points stand.
fn check(points: &[[f64; 2]], lines: &[String]) -> Result<(), String> {
    if !(2..=MOST_POINTS).contains(&points.len()) {
        return Err(format!("must have 2 to {MOST_POINTS} points, has {}", points.len()));
    }
    for (k, pair) in points.windows(2).enumerate() {
        let [[from, low], [to, high]] = [pair[0], pair[1]];
        let line = &lines[k + 1];
        if to <= from {
            return Err(format!("{line}: place_m = {to}: must be more than {from} m of the point before"));
        }
        let rise = (high - low) / (to - from);
        if rise.abs() > STEEPEST {
            return Err(format!(
                "{line}: rises by {rise:.3} m per m from the point before: must be within ±{STEEPEST}"
            ));
        }
    }
    // The first point is so high from ever on, the last for ever.
    let before = |k: usize| k.checked_sub(1).map_or(f64::NEG_INFINITY, |k| points[k][0]);
    let after = |k: usize| points.get(k + 1).map_or(f64::INFINITY, |[place, _]| *place);
    for (k, [_, height]) in points.iter().enumerate() {
        let is_near = before(k) < LEVEL_M && after(k) > -LEVEL_M;
        if is_near && height.abs() > 0.0 {
            let line = &lines[k];
            return Err(format!(
                "{line}: height_m = {height}: must be 0 m, as the floor is level from {} to {LEVEL_M} m, where the robot starts",
                -LEVEL_M
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{from_canonical, load};

    const HILL: &str = "# a hill\nplace_m,height_m\n\n0.5, 0\n2.5,0.04\n3,0.04\n";

    fn loaded(profile: &str) -> Result<Vec<[f64; 2]>, String> {
        let keys = ["sim.on_blocks=false".to_owned(), format!("sim.floor.profile={profile}")];
        let resolved = load(None, &keys).map_err(|errors| errors.to_string())?;
        // What a recording holds gives the same, without the file.
        let again = from_canonical(&resolved.text, &[]).unwrap();
        assert_eq!((again.config, again.hash), (resolved.config.clone(), resolved.hash));
        Ok(resolved.config.simulation.floor.unwrap().profile)
    }

    #[test]
    fn a_file_and_a_list_give_the_same_points_and_a_recording_needs_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("hill.csv");
        std::fs::write(&file, HILL).unwrap();
        let of_file = loaded(&format!("\"{}\"", file.display())).unwrap();
        assert_eq!(of_file, loaded("[[0.5, 0.0], [2.5, 0.04], [3.0, 0.04]]").unwrap());
        assert_eq!(of_file, [[0.5, 0.0], [2.5, 0.04], [3.0, 0.04]]);
    }

    #[test]
    fn what_is_wrong_is_told_with_line_value_and_range() {
        let of = |rows: &str| parse(&format!("place_m,height_m\n{rows}")).unwrap_err();
        let rules = [
            (of("1,0\n2,x\n"), "line 3: height_m = x: must be a number, -100 to 100 m"),
            (of("1,0\n2,nan\n"), "line 3: height_m = nan"),
            (of("1,0\n2,inf\n"), "line 3: height_m = inf"),
            (of("1,0\n2,101\n"), "line 3: height_m = 101: must be a number, -100 to 100 m"),
            (of("1,0\n2,0,0\n"), "line 3: must have two columns"),
            (of("1,0\n1,0.1\n"), "line 3: place_m = 1: must be more than 1 m"),
            (of("1,0\n2,0.26\n"), "line 3: rises by 0.260 m per m from the point before: must be within ±0.25"),
            (of("1,0\n"), "must have 2 to 10000 points, has 1"),
            (
                of("1,0.1\n2,0.1\n"),
                "line 2: height_m = 0.1: must be 0 m, as the floor is level from -0.5 to 0.5 m, where the robot starts",
            ),
            (of("-2,-0.1\n-1,-0.1\n"), "line 3: height_m = -0.1: must be 0 m"),
            (of("-1,0\n0.4,0.1\n2,0.1\n"), "line 3: height_m = 0.1: must be 0 m"),
            (of("-2,0.1\n2,0.1\n"), "line 2: height_m = 0.1: must be 0 m"),
            (
                parse("x,y\n1,0\n").unwrap_err(),
                "must begin with the names of its columns, `place_m,height_m`, not with `x,y`",
            ),
            (parse("").unwrap_err(), "not with ``"),
        ];
        for (told, rule) in rules {
            assert!(told.contains(rule), "{told}\n{rule}");
        }
    }

    #[test]
    fn errors_name_the_key_and_what_was_typed() {
        let told = loaded("\"nowhere/hill.csv\"").unwrap_err();
        assert!(
            told.contains("--set: sim.floor.profile = \"nowhere/hill.csv\": cannot be read: No such file"),
            "{told}"
        );
        let told = loaded("[[1.0, 0.0], [2.0, 0.5]]").unwrap_err();
        assert!(told.contains("sim.floor.profile") && told.contains("point 2: rises by 0.500 m per m"), "{told}");
        let told = loaded("[[1.0, 0.0], [2.0, \"a\"]]").unwrap_err();
        assert!(told.contains("sim.floor.profile") && told.contains("must be a number"), "{told}");
        assert!(loaded("3.0").unwrap_err().contains("must be a file in quotes, or a list of pairs"), "neither");
    }

    #[test]
    fn a_robot_on_blocks_is_told_that_it_meets_no_floor() {
        let warned = |keys: &[&str]| {
            let keys: Vec<String> = keys.iter().map(ToString::to_string).collect();
            load(None, &keys).unwrap().warnings.iter().any(|w| w.key == "sim.floor.profile")
        };
        let profile = "sim.floor.profile=[[0.5, 0.0], [2.5, 0.04]]";
        assert!(warned(&[profile]) && !warned(&[profile, "sim.on_blocks=false"]) && !warned(&[]));
    }

    #[test]
    fn a_hill_before_and_behind_the_start_is_level_there() {
        assert!(parse("place_m,height_m\n-3,0.2\n-0.5,0\n0.5,0\n2,-0.1\n").is_ok());
    }
}
