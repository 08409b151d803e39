//! Bad input: each kind once, with the file, row, column and remedy that its message must name.

use super::*;
use std::fmt::Write as _;

const RIG: &str = "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = { value = 0.01, min = 0.005, \
    max = 0.02 }\ngravity_nm = 0.36\n[[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.05\n[[sensor]]\n\
    measures = \"q1\"\ncolumn = \"q_rad\"\n[[recording]]\nfile = \"a.csv\"\nuse = \"fit\"\n";

/// Rows of a good recording: time, input, angle.
fn rows() -> Vec<[String; 3]> {
    let row = |k: usize| {
        let t = k as f64 * 0.01;
        [format!("{t:.2}"), format!("{:.3}", libm::sin(3.0 * t)), format!("{:.5}", 0.5 * libm::cos(5.0 * t))]
    };
    (0..200).map(row).collect()
}

fn text(header: &str, rows: &[[String; 3]]) -> String {
    let mut out = format!("{header}\n");
    for row in rows {
        writeln!(out, "{}", row.join(",")).unwrap();
    }
    out
}

fn load(csv: &str) -> Result<Experiment, ExperimentError> {
    load_with(RIG, csv)
}

fn load_with(rig: &str, csv: &str) -> Result<Experiment, ExperimentError> {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("rig.toml"), rig).unwrap();
    fs::write(folder.path().join("a.csv"), csv).unwrap();
    Experiment::load(folder.path())
}

#[test]
fn a_window_column_cuts_free_runs_and_a_jump_of_time_there_is_no_gap() {
    let rig = RIG.replace("use = \"fit\"\n", "use = \"fit\"\nwindow_s = 0.3\nwindow_column = \"k\"\n");
    let mut csv = String::from("t_s,u,q_rad,k\n");
    for k in 0..100_usize {
        // Three stretches of .5, .2 and .3 s, a second apart.
        let stretch = usize::from(k >= 50) + usize::from(k >= 70);
        let t = 0.01 * k as f64 + stretch as f64;
        writeln!(csv, "{t:.2},{:.3},{:.4},{stretch}", libm::sin(9.0 * t), 0.3 * libm::cos(4.0 * t)).unwrap();
    }
    let experiment = load_with(&rig, &csv).unwrap();
    let recording = &experiment.recordings[0];
    assert_eq!(recording.windows(), [0..30, 30..50, 50..70, 70..100]);
    assert!(recording.is_fresh(50) && !recording.is_fresh(30) && recording.begin_of_stretch(69) == 50);
    assert!(recording.warnings.is_empty(), "{:?}", recording.warnings);
    // Without the column it is a gap.
    let plain = load_with(&rig.replace("window_column = \"k\"\n", ""), &csv).unwrap();
    assert!(plain.recordings[0].warnings.iter().any(|w| w.contains("a gap of")));
}

/// `edit` changes good rows; gives the whole file.
fn edited(edit: impl Fn(&mut Vec<[String; 3]>)) -> String {
    let mut rows = rows();
    edit(&mut rows);
    text("t_s,u,q_rad", &rows)
}

#[test]
fn what_cannot_be_used_is_refused_with_file_row_column_and_remedy() {
    let cases: [(&str, String, &[&str]); 12] = [
        ("missing column", text("t_s,u,angle", &rows()), &["a.csv", "`q_rad` is missing", "t_s, u, angle"]),
        ("unsorted time", edited(|r| r.swap(10, 11)), &["a.csv", "row 13", "`t_s`", "goes back", "sort the rows"]),
        ("repeated time", edited(|r| r[5][0] = r[4][0].clone()), &["row 7", "`t_s`", "is repeated", "drop doubles"]),
        ("NaN", edited(|r| r[20][2] = "nan".into()), &["a.csv", "row 22", "`q_rad`", "leave a missing sample empty"]),
        ("infinite", edited(|r| r[0][1] = "inf".into()), &["row 2", "`u`", "not a finite number"]),
        ("text", edited(|r| r[3][2] = "0,5".into()), &["row 5", "has 4 cells, the header has 3"]),
        ("no input", edited(|r| r[8][1] = String::new()), &["row 10", "`u`", "empty, needs a number"]),
        ("no rows", text("t_s,u,q_rad", &rows()[..1]), &["a.csv", "1 rows of data, at least 2"]),
        ("few rows", text("t_s,u,q_rad", &rows()[..5]), &["a.csv", "5 rows, at least 10", "record some seconds"]),
        ("semicolons", edited(|_| {}).replace(',', ";"), &["a.csv: row 1", "one cell", "by commas"]),
        ("empty file", String::new(), &["a.csv: row 1", "empty"]),
        ("no time", text("time,u,q_rad", &rows()), &["row 1", "`time`, must be `t_s`"]),
    ];
    for (what, csv, said) in cases {
        let message = load(&csv).expect_err(what).to_string();
        for part in said {
            assert!(message.contains(part), "{what}: `{part}` is not in `{message}`");
        }
    }
}

#[test]
fn what_is_only_suspicious_is_told_and_the_work_goes_on() {
    let scaled = |factor: f64| {
        move |r: &mut Vec<[String; 3]>| {
            r.iter_mut().for_each(|row| row[2] = format!("{:.4}", factor * row[2].parse::<f64>().unwrap()));
        }
    };
    let noise = |r: &mut Vec<[String; 3]>| {
        let mut x = 1_u32;
        for row in r.iter_mut() {
            x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            row[2] = format!("{:.6}", f64::from(x >> 8) * 1e-10);
        }
    };
    let cases: [(&str, String, &[&str]); 8] = [
        (
            "gap",
            edited(|r| drop(r.drain(50..90))),
            &["a.csv: row 51", "a gap of 0.41", "t = 0.49", "held over it; if it changed", "cut the file"],
        ),
        ("constant sensor", edited(scaled(0.0)), &["a.csv", "`q_rad` never changes", "connected"]),
        ("constant input", edited(|r| r.iter_mut().for_each(|x| x[1] = "1".into())), &["`u` is constant", "excites"]),
        ("degrees", edited(scaled(57.3)), &["a.csv", "`q_rad` runs from", "degrees, convert to rad"]),
        ("too short", text("t_s,u,q_rad", &rows()[..20]), &["only 20 rows", "record some seconds"]),
        ("unexcited", edited(noise), &["`q_rad` hardly leaves its noise", "record larger motion"]),
        (
            "milliseconds",
            edited(|r| r.iter_mut().for_each(|x| x[0] = x[0].replace('.', ""))),
            &["`t_s` steps by 1", "divide by 1000"],
        ),
        ("no sample", edited(|r| r.iter_mut().for_each(|x| x[2] = String::new())), &["`q_rad` has no sample at all"]),
    ];
    for (what, csv, said) in cases {
        let warnings = load(&csv).expect(what).recordings[0].warnings.join("\n");
        for part in said {
            assert!(warnings.contains(part), "{what}: `{part}` is not in `{warnings}`");
        }
    }
}

#[test]
fn columns_that_nobody_asked_for_are_left_alone() {
    let csv: String = edited(|_| {}).lines().map(|l| format!("{l},note\n")).collect();
    let plain = load(&edited(|_| {})).unwrap();
    assert_eq!(load(&csv).unwrap(), plain);
    assert!(plain.recordings[0].warnings.is_empty(), "{:?}", plain.recordings[0].warnings);
}

#[test]
fn windows_that_hold_a_row_or_two_are_refused_with_the_likely_reason() {
    let windowed = format!("{RIG}window_s = 1.0\n");
    let milliseconds = edited(|rows| {
        for row in rows {
            row[0] = format!("{:.0}", row[0].parse::<f64>().unwrap() * 1000.0);
        }
    });
    let message = load_with(&windowed, &milliseconds).expect_err("milliseconds").to_string();
    for part in ["a.csv", "`t_s`", "`window_s = 1`", "milliseconds, divide them by 1000"] {
        assert!(message.contains(part), "`{part}` is not in `{message}`");
    }
    assert!(load_with(&windowed, &edited(|_| {})).is_ok());
}

#[test]
fn what_cannot_be_read_is_told_by_what_it_should_be() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let told = |result: Result<Experiment, ExperimentError>| result.unwrap_err().to_string();
    assert!(told(Experiment::load(&at("none"))).contains("none: is not there; must be a case: a folder"));
    let no_rig = told(Experiment::load(folder.path()));
    assert!(no_rig.contains("rig.toml: is not there; must be a case"), "{no_rig}");
    fs::write(at("rig.toml"), RIG).unwrap();
    let file = told(Experiment::load(&at("rig.toml")));
    assert!(
        file.ends_with(
            "/rig.toml: is a file; must be a case: a folder with rig.toml and, beside it, the recordings that it names"
        ),
        "{file}"
    );
    let csv = told(Experiment::load(folder.path()));
    assert!(csv.contains("a.csv: is not there; must be a recording"), "{csv}");
    fs::create_dir(at("a.csv")).unwrap();
    let folder_given = told(Experiment::load(folder.path()));
    assert!(folder_given.contains("a.csv: is a folder; must be a recording"), "{folder_given}");
    let cause = std::error::Error::source(&Experiment::load(&at("none")).unwrap_err()).map(ToString::to_string);
    assert_eq!(cause, None, "told once");
    let rig = super::load_rig(&at("no.toml")).unwrap_err().to_string();
    assert!(rig.contains("no.toml: is not there; must be a rig file"), "{rig}");
    let rig = Rig::parse(RIG, "rig.toml").unwrap();
    for (name, told) in [("no.mcap", "no.mcap: is not there; must be a recording"), ("a.csv", "is a folder")] {
        let error = Recording::load(&rig, 0, &at(name)).unwrap_err().to_string();
        assert!(error.contains(told), "{error}");
    }
}

/// Found by a run that did not end: times in nanoseconds, and a window of one.
#[test]
fn windows_far_shorter_than_a_row_cost_no_more_than_the_rows() {
    let times: Vec<f64> = (0..100).map(|k| f64::from(k) * 1e9).collect();
    let mut recording = Recording::new("a.csv", times, Vec::new(), Vec::new());
    recording.window_s = Some(1e-3);
    assert_eq!(recording.windows().len(), 99, "one row is less than half a window");
    recording.times = (0..100).map(|k| f64::from(k) * 0.01 + if k < 50 { 0.0 } else { 1e9 }).collect();
    recording.window_s = Some(0.1);
    assert!((10..=11).contains(&recording.windows().len()), "the gap holds no window: {:?}", recording.windows());
}
