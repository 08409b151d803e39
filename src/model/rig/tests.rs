//! Laws of rig files.
use super::*;

const FULL: &str = r#"schema = 1
name = "inner \"leg\""
mechanism = "pendulum"
[parameters]
inertia_kg_m2 = { value = 0.0043, min = 0.0021, max = 0.0086 }
gravity_nm = 3
[[actuator]]
joint = "q1"
column = "u_v"
gain = { value = 0.0182, min = 0.015, max = 0.022 }
enable_column = "on"
back_emf = { value = 0.01 }
[[sensor]]
measures = "q1"
column = "q_rad"
quantum = 0.000767
[[sensor]]
measures = "q1_rate"
side = "motor"
column = "gyro"
noise_std = 1e-3
[[effect]]
effect = "torque_ripple"
at = "q1"
amplitude = { value = 0.0, min = -1, max = 1 }
order = { value = 6 }
phase = { value = 0.1 }
[[effect]]
effect = "torque_ripple"
at = "q1"
side = "motor"
amplitude = { value = 0.1 }
order = { value = 12 }
phase = { value = 0.1 }
recordings = ["a.csv"]
[[recording]]
file = "a.csv"
use = "fit"
window_s = 2
[[recording]]
file = "b.csv"
use = "heldout"
parameters = { gravity_nm = { value = 0.42, min = 0.1, max = 1.0 } }
effects = [ { effect = "sensor_bias", at = "q_rad", bias = { value = 0.0, min = -0.1, max = 0.1 } } ]
"#;

#[test]
fn written_rig_parses_to_the_same_rig() {
    let rig = Rig::parse(FULL, "rig.toml").unwrap();
    let again = Rig::parse(&rig.to_toml(), "again").unwrap();
    assert_eq!(rig, again);
}

#[test]
fn an_effect_of_no_recording_and_values_that_cannot_be_are_refused() {
    let told = |from: &str, to: &str| Rig::parse(&FULL.replacen(from, to, 1), "rig.toml").unwrap_err().to_string();
    let unknown = told("recordings = [\"a.csv\"]", "recordings = [\"c.csv\"]");
    assert!(unknown.contains("`c.csv` is not one of a.csv, b.csv"), "{unknown}");
    for (effect, key) in [
        ("effect = \"transport_delay\"\nat = \"u_v\"\ndelay = -0.01", "delay"),
        ("effect = \"backlash\"\nat = \"q1\"\ngap = -0.1\nrotor_inertia = 0.001", "gap"),
        ("effect = \"torque_limit\"\nat = \"u_v\"\nlimit = -1.0", "limit"),
        (
            "effect = \"link_flexibility\"\nat = \"q1\"\nfrequency = 0.0\ndamping = 0.1\nparticipation = 0.2",
            "frequency",
        ),
        ("effect = \"clock_skew\"\nat = \"q_rad\"\nskew = -1.0", "skew"),
    ] {
        let told = told("[[effect]]", &format!("[[effect]]\n{effect}\n[[effect]]"));
        assert!(told.contains(key) && told.contains("is not within"), "{told}");
    }
    let phase = FULL.replacen("phase = { value = 0.1 }", "phase = { value = 9.0 }", 1);
    assert!(Rig::parse(&phase, "rig.toml").is_ok(), "a phase has no ends");
}

#[test]
fn numerics_of_a_simulation_are_read_written_and_have_a_range() {
    let with = |step: &str| {
        let numerics = format!("[numerics]\neuler_step_s = {step}\nsmooth_rate = 0.01\n[parameters]");
        FULL.replacen("[parameters]", &numerics, 1)
    };
    let rig = Rig::parse(&with("0.002"), "rig.toml").unwrap();
    let numerics = Numerics { euler_step_s: Some(0.002), smooth_rate: Some(0.01), soft_friction_s: None };
    assert_eq!(rig.numerics, numerics);
    assert_eq!(Rig::parse(&rig.to_toml(), "again").unwrap(), rig);
    let errors = Rig::parse(&with("2.0"), "case/rig.toml").unwrap_err().to_string();
    assert!(errors.contains("case/rig.toml:5: `euler_step_s`: is 2, must be from 0.00001 to 0.1"), "{errors}");
    let soft = with("0.002").replace("smooth_rate = 0.01", "soft_friction_s = 0.02");
    let rig = Rig::parse(&soft, "rig.toml").unwrap();
    assert_eq!(Rig::parse(&rig.to_toml(), "again").unwrap().numerics.soft_friction_s, Some(0.02));
    let both = with("0.002").replace("smooth_rate = 0.01", "smooth_rate = 0.01\nsoft_friction_s = 0.02");
    let errors = Rig::parse(&both, "case/rig.toml").unwrap_err().to_string();
    assert!(errors.contains("case/rig.toml:7: `soft_friction_s`: stands beside smooth_rate"), "{errors}");
}

#[test]
fn unknown_keys_name_file_key_and_line() {
    let text = FULL.replace("quantum =", "quantom =").replace("use = \"heldout\"", "use = \"heldout\"\nweight = 2");
    let errors = Rig::parse(&text, "case/rig.toml").unwrap_err();
    assert_eq!(errors.0.len(), 2, "{errors}");
    assert!(errors.to_string().starts_with("case/rig.toml:16: `quantom`: unknown key in [[sensor]]"), "{errors}");
    assert_eq!(errors.0[1].line, 43);
}

#[test]
fn toes_belong_to_a_walk_and_come_in_pairs() {
    let walk = "schema = 1\nmechanism = \"compass_gait\"\n[parameters]\nleg_length_m = 1.0\ntotal_mass_kg = 15.0\n\
        gravity_m_s2 = 9.81\nc1 = 0.1\nc2 = 0.14\nc3 = 0.0006\nc4 = 0.12\nc5 = 0.13\nc6 = 0.003\n[[actuator]]\n\
        joint = \"hip\"\ncolumn = \"u\"\ngain = 1.0\n[[sensor]]\nmeasures = \"hip\"\ncolumn = \"y\"\n[[recording]]\n\
        file = \"a.csv\"\nuse = \"fit\"\nsetup = \"walk\"\nstance_column = \"s\"\ntoe_columns = [\"i\", \"o\"]\n";
    let rig = Rig::parse(walk, "rig.toml").unwrap();
    assert_eq!(rig.recordings[0].toe_columns, Some(["i".to_owned(), "o".to_owned()]));
    let wrong = |from: &str, to: &str| Rig::parse(&walk.replace(from, to), "rig.toml").unwrap_err().to_string();
    assert!(wrong("\"walk\"", "\"inner_stance\"").contains("`toe_columns`: are for `setup = \"walk\"` only"));
    assert!(wrong("[\"i\", \"o\"]", "[\"i\"]").contains("`toe_columns`: must name two columns"));
}

#[test]
fn all_errors_are_told_at_once() {
    let text = FULL
        .replace("inertia_kg_m2 = { value = 0.0043, min = 0.0021,", "inertia_kg_m2 = { value = 0.0001, min = 0.0021,")
        .replace("measures = \"q1\"", "measures = \"q7\"")
        .replace("effect = \"sensor_bias\"", "effect = \"sensor_blas\"")
        .replace("at = \"q1\"\nside", "at = \"q2\"\nside")
        .replace("use = \"fit\"", "use = \"train\"");
    let errors = Rig::parse(&text, "rig.toml").unwrap_err();
    assert_eq!(errors.0.len(), 5, "{errors}");
}

#[test]
fn a_rotor_weighs_less_than_rotor_and_link_together() {
    let read = |rotor: f64| {
        let text = format!(
            "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = 0.01\ngravity_nm = 0.4\n\
             [[effect]]\neffect = \"backlash\"\nat = \"q1\"\ngap = 0.01\nrotor_inertia = {rotor}\n"
        );
        Rig::parse(&text, "rig.toml").map_err(|e| e.to_string())
    };
    let told = "rig.toml:7: `rotor_inertia`: 0.01 must be below inertia_kg_m2 = 0.01, which is rotor and link together";
    assert_eq!(read(0.01).unwrap_err(), told);
    assert!(read(0.009).is_ok());
}

#[test]
fn a_wrong_number_is_shown_with_its_key_and_a_second_name_has_its_own_line() {
    let value = |typed: &str| {
        let text = FULL.replacen("gravity_nm = 3", &format!("gravity_nm = {typed}"), 1);
        Rig::parse(&text, "rig.toml").unwrap_err().to_string()
    };
    for (typed, told) in [
        ("{ value = 1.0, min = nan, max = 2.0 }", "rig.toml:6: `gravity_nm.min`: is nan, must be finite"),
        ("{ value = 1.0, min = 0.1, max = inf }", "rig.toml:6: `gravity_nm.max`: is inf, must be finite"),
        ("{ value = \"9.3\" }", "rig.toml:6: `gravity_nm.value`: is \"9.3\", must be a number"),
        ("\"9.3\"", "rig.toml:6: `gravity_nm`: is \"9.3\", must be a number"),
    ] {
        assert_eq!(value(typed), told);
    }
    let twice = format!("{FULL}[[recording]]\nfile = \"a.csv\"\nuse = \"fit\"\n");
    let line = twice.lines().count() - 1;
    let error = Rig::parse(&twice, "rig.toml").unwrap_err().to_string();
    assert_eq!(error, format!("rig.toml:{line}: `file`: `a.csv` is named twice"));
}

#[test]
fn broken_toml_tells_its_line() {
    let errors = Rig::parse("schema = 1\nname = = 3\nmechanism", "rig.toml").unwrap_err();
    assert_eq!(errors.0[0].line, 2);
    assert!(errors.to_string().starts_with("rig.toml:2: not TOML: "), "{errors}");
}

#[test]
fn slot_names_are_unique_and_readable() {
    let rig = Rig::parse(FULL, "rig.toml").unwrap();
    let names: Vec<String> = rig.slots().iter().map(|s| rig.slot_name(*s)).collect();
    for (i, name) in names.iter().enumerate() {
        assert!(!names[..i].contains(name), "{name} twice");
    }
    for wanted in [
        "inertia_kg_m2",
        "gain@u_v",
        "back_emf@u_v",
        "torque_ripple@q1.amplitude",
        "torque_ripple@q1:motor.order[a.csv]",
        "gravity_nm[b.csv]",
        "sensor_bias@q_rad.bias[b.csv]",
    ] {
        assert!(names.contains(&wanted.to_owned()), "{wanted} not in {names:?}");
    }
}
