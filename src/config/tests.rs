use super::*;

fn set(overrides: &[&str]) -> Result<Resolved, Errors> {
    load(None, &overrides.iter().map(ToString::to_string).collect::<Vec<_>>())
}

fn errors(overrides: &[&str]) -> Vec<String> {
    set(overrides).map_or_else(|e| e.0.iter().map(ToString::to_string).collect(), |_| Vec::new())
}

fn file(name: &str, text: &str) -> Result<Resolved, Errors> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, text).unwrap();
    load(Some(&path), &[])
}

#[test]
fn embedded_default_is_the_identified_robot_without_complaint() {
    let default = set(&[]).unwrap();
    assert_eq!(default.warnings, []);
    let model = &default.config.robot.model;
    let printed = [0.1007, 0.1434, 0.000_596, 0.1151, 0.1264, 0.0026];
    assert!(model.c.iter().zip(printed).all(|(c, p)| c.value.to_bits() == f64::to_bits(p)));
    // Model notes, section 2: .694 Nm s/rad and 1.841 Nm; three printed digits.
    assert!((model.viscous_nm_s_rad.value - 0.694).abs() < 5e-4);
    assert!((model.coulomb_nm.value - 1.841).abs() < 5e-4);
}

#[test]
fn canonical_text_reads_back_to_the_same_configuration_and_hash() {
    let default = set(&["control.lqr_r=0.1", "sim.operator_release_s=3"]).unwrap();
    let again = from_canonical(&default.text, &[]).unwrap();
    assert_eq!(again.config, default.config);
    assert_eq!(again.text, default.text);
    assert_eq!(again.hash, default.hash);
}

#[test]
fn hash_depends_on_meaning_not_on_typing() {
    let a = set(&["robot.hip.gear_ratio=30"]).unwrap();
    let b = set(&["robot.hip.gear_ratio = 3.0e1"]).unwrap();
    let c = set(&["robot.hip.gear_ratio=31"]).unwrap();
    assert_eq!(a.hash, b.hash);
    assert_ne!(a.hash, c.hash);
}

#[test]
fn all_errors_of_all_files_come_at_once() {
    let found = errors(&["robot.hip.gear_ratio=-3", "rt.period_us=\"fast\"", "control.nonsense=1", "sim.seed=1.5"]);
    assert_eq!(found.len(), 4, "{found:#?}");
    assert_eq!(found[0], "--set: robot.hip.gear_ratio = -3: must be 1 to 500");
    assert!(found[1].contains("rt.period_us = \"fast\": must be a number, 100 to 1000000 us"), "{}", found[1]);
    assert!(found[2].contains("control.nonsense = 1: unknown key; known here: attitude_time_s"), "{}", found[2]);
    assert!(found[3].contains("sim.seed = 1.5: must be a whole number"), "{}", found[3]);
}

#[test]
fn error_names_file_and_line() {
    let text = "# threads\nperiod_us = 1000.0\ntrigger = \"never\"\n";
    let found = file("rt.toml", text).unwrap_err();
    let trigger = found.0.iter().find(|p| p.key == "rt.trigger").unwrap();
    assert_eq!(trigger.line, 3);
    assert!(trigger.file.ends_with("rt.toml"));
    // A section is taken whole: what the file leaves out is missing, never filled in.
    assert!(found.0.iter().any(|p| p.key == "rt.threads" && p.what == "is missing"), "{found}");
    assert!(!found.0.iter().any(|p| p.key.starts_with("rt.threads.")), "one error for a missing table");
}

#[test]
fn syntax_errors_are_told_with_their_line() {
    let found = file("control.toml", "stance = \"inner\"\nlqr_r = = 1\n").unwrap_err();
    assert_eq!(found.0[0].line, 2, "{found}");
}

#[test]
fn set_table_of_a_file_changes_single_keys_of_the_default() {
    let text = "[set]\nrobot.bus0.backend = \"socketcan:can0\"\nrobot.bus1.backend = \"socketcan:can1\"\n\
                robot.imu.backend = \"/dev/compass-imu\"\nrobot.operator.source = \"socket:/run/compass/operator\"\n";
    let config = file("real.toml", text).unwrap().config;
    assert_eq!(config.robot.buses[1].backend, checked::BusBackend::SocketCan("can1".into()));
}

#[test]
fn real_buses_want_a_real_hand_and_a_real_imu_but_the_simulated_robot_does_not() {
    let real = ["robot.bus0.backend=socketcan:can0", "robot.bus1.backend=socketcan:can1"].map(String::from);
    let refused = |more: &[&str]| {
        let overrides: Vec<String> = real.iter().cloned().chain(more.iter().map(ToString::to_string)).collect();
        load(None, &overrides).map_or_else(|e| e.0.into_iter().map(|p| p.key).collect(), |_| Vec::new())
    };
    let (hand, imu) = ("robot.operator.source=socket:/run/hand", "robot.imu.backend=/dev/imu");
    assert_eq!(refused(&[]), ["robot.operator.source", "robot.imu.backend"]);
    assert_eq!(refused(&[hand]), ["robot.imu.backend"]);
    assert_eq!(refused(&[imu]), ["robot.operator.source"]);
    assert!(refused(&[hand, imu]).is_empty());
    let plant = load_choice(Choice { overrides: &of_command_line(&real), plays_robot: true, ..Choice::default() });
    assert!(plant.is_ok_and(|plant| plant.config.robot.has_made_up_senses()));
}

#[test]
fn a_stick_has_its_axis_beside_a_device_of_the_robot_and_its_keys_go_together() {
    let device = "robot.operator={ source = \"device:/dev/input/event3\", key = 304, zero_key = 305 }";
    let stick = |keys: &str| format!("robot.operator.speed={{ highest_m_s = 0.5, rate_m_s2 = 0.2{keys} }}");
    let axis = ", axis = 1, rest_counts = 128, full_counts = 0, dead_zone = 0.1";
    let told = |source: &str, speed: &str| set(&[source, speed]).map_err(|e| e.to_string());
    let resolved = told(device, &stick(axis)).unwrap();
    let speed = resolved.config.robot.operator_speed.unwrap();
    let expected = checked::Stick { axis: 1, rest: 128, full: 0, dead_zone: 0.1 };
    assert_eq!((speed.highest_m_s, speed.stick), (0.5, Some(expected)));
    assert_eq!(from_canonical(&resolved.text, &[]).unwrap().config, resolved.config);
    let socket = "robot.operator.source=socket:/run/hand";
    assert_eq!(told(socket, &stick("")).unwrap().config.robot.operator_speed.unwrap().stick, None);
    assert_eq!(set(&[]).unwrap().config.robot.operator_speed, None);
    for (source, speed, what) in [
        (device, stick(""), "robot.operator.speed.axis: is missing"),
        (socket, stick(axis), "robot.operator.speed.axis = 1: unknown key"),
        (
            device,
            stick(&axis.replace("= 0,", "= 128,")),
            "speed.full_counts = 128: must be another place than rest_counts",
        ),
        (device, stick(&axis.replace("= 1,", "= 64,")), "speed.axis = 64: must be a whole number, 0 to 63"),
        (device, stick(&axis.replace("0.1", "1.0")), "speed.dead_zone = 1.0: must be 0 to 0.9"),
        (socket, stick("").replace("0.5", "2.5"), "speed.highest_m_s = 2.5: must be 0.05 to 2 m/s"),
        (socket, stick("").replace("0.2", "0"), "speed.rate_m_s2 = 0: must be 0.01 to 10 m/s^2"),
    ] {
        let error = told(source, &speed).unwrap_err();
        assert!(error.contains(what), "{what}: {error}");
    }
}

#[test]
fn times_that_protect_nobody_are_told() {
    let warned = |key_value: &str| {
        let resolved = set(&[key_value]).unwrap();
        resolved.warnings.iter().map(|w| w.key.clone()).collect::<Vec<_>>()
    };
    for key_value in [
        "robot.drives.hip.watchdog_ms=1000",
        "robot.drives.outer_toe_b.heartbeat_ms=65535",
        "robot.limits.operator_age_ms=1000",
        "robot.limits.imu_age_ms=1000",
        "robot.limits.drive_age_ms=1000",
        "robot.limits.overruns_per_s=1000",
    ] {
        let (key, _) = key_value.split_once('=').unwrap();
        assert!(warned(key_value).iter().any(|w| *w == key), "{key_value}: {:?}", warned(key_value));
    }
    let slow = errors(&["rt.period_us=1000000", "rt.input_deadline_us=600"]);
    assert!(slow.iter().any(|e| e.contains("two must fit")), "{slow:?}");
    assert!(errors(&["rt.flight_recorder_ticks=1000000"])[0].contains("1 to 60000"));
}

#[test]
fn a_file_without_end_is_no_configuration() {
    let error = load(Some(Path::new("/dev/zero")), &[]).unwrap_err().to_string();
    assert!(error.contains("longer than 4 MiB"), "{error}");
}

#[test]
fn command_line_goes_last_and_needs_no_quotes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("f.toml");
    fs::write(&path, "[set]\ncontrol.controller = \"hold\"\n").unwrap();
    let config = load(Some(&path), &["control.controller=idle".into()]).unwrap().config;
    assert_eq!(config.control.controller, checked::ControllerKind::Idle);
}

#[test]
fn missing_file_and_unknown_section_are_told() {
    assert!(load(Some(Path::new("/nowhere/x.toml")), &[]).unwrap_err().to_string().contains("cannot be read"));
    assert!(file("x.toml", "[robto]\n").unwrap_err().to_string().contains("unknown section"));
    assert!(errors(&["gear_ratio=3"])[0].contains("a key starts with"));
    assert!(errors(&["nonsense"])[0].contains("expected key=value"));
}

#[test]
fn orientation_beyond_500_hz_is_refused_but_rates_may_have_1000() {
    assert!(errors(&["robot.imu.rate_hz=1000"])[0].contains("limit of the device"));
    set(&["robot.imu.rate_hz=1000", "robot.imu.message=accel_rate"]).unwrap();
    assert!(errors(&["robot.imu.baud_bit_s=115200"])[0].contains("needs 155000 bit/s"));
}

#[test]
fn calculated_column_of_the_thesis_is_warned_of_as_impossible() {
    let column = [("c1", 0.0207), ("c2", 0.1101), ("c3", 0.0017), ("c4", 0.1382), ("c5", 0.0987), ("c6", 0.0329)];
    let overrides: Vec<String> = column.iter().map(|(c, v)| format!("robot.model.{c}.value={v}")).collect();
    let warnings = load(None, &overrides).unwrap().warnings;
    assert!(warnings[0].what.contains("1.005 + 0.090 + 2.547"), "{}", warnings[0]);
}

#[test]
fn impossible_mass_matrix_is_refused() {
    assert!(errors(&["robot.model.c5.value=0.9"])[0].contains("not positive definite"));
}

#[test]
fn friction_in_si_and_normalised_agree() {
    let si = ["robot.model.viscous.unit=\"Nm s/rad\"", "robot.model.viscous.value=0.694"];
    let viscous = set(&si).unwrap().config.robot.model.viscous_nm_s_rad;
    assert_eq!((viscous.value, viscous.unit.as_str()), (0.694, "Nm s/rad"));
    assert!(errors(&["robot.model.viscous.unit=Nm"])[0].contains("must be one of \"Nm s/rad\", \"1/s\""));
}

#[test]
fn four_toes_on_one_classic_bus_at_every_sync_do_not_fit() {
    let mut moved: Vec<String> = ["inner_toe_a", "inner_toe_b", "outer_toe_a", "outer_toe_b"]
        .iter()
        .flat_map(|toe| [format!("robot.drives.{toe}.bus=1"), format!("robot.drives.{toe}.sync_divisor=1")])
        .collect();
    let full = load(None, &moved).unwrap_err().to_string();
    assert!(full.contains("106 % of the bus"), "{full}");
    moved.extend(["inner_toe_a", "outer_toe_a"].map(|toe| format!("robot.drives.{toe}.sync_divisor=4")));
    load(None, &moved).unwrap();
}

#[test]
fn two_drives_with_one_node_are_refused() {
    let told = &errors(&["robot.drives.inner_toe_a.node=1"])[0];
    let keys = "--set: robot.drives.hip.node, robot.drives.inner_toe_a.node: ";
    assert!(told.contains(keys) && told.contains("hip and inner_toe_a are both node 1 on bus 0"), "{told}");
}

#[test]
fn what_is_wrong_between_keys_has_the_file_and_line_of_one_that_was_typed() {
    let text = "[set]\nrobot.bus0.backend = \"socketcan:can0\"\nrobot.drives.outer_toe_a.mode = \"torque\"\n";
    let told = file("my.toml", text).unwrap_err().to_string();
    for (line, key) in [(2, "robot.bus0.backend, robot.bus1.backend"), (3, "robot.drives.outer_toe_a.mode")] {
        assert!(told.contains(&format!("my.toml:{line}: {key}: ")), "{told}");
    }
    let resolved = file("my.toml", "[set]\nrobot.limits.operator_age_ms = 1000\n").unwrap();
    assert!(resolved.warnings[0].to_string().contains("my.toml:2: robot.limits.operator_age_ms: "));
    let embedded = &errors(&["rt.period_us=1000000", "rt.input_deadline_us=600"])[0];
    assert!(embedded.starts_with("--set: "), "{embedded}");
}

#[test]
fn a_number_in_the_place_of_a_parameter_is_told_where_it_belongs() {
    let told = &errors(&["robot.model.c1=0.12"])[0];
    assert!(told.contains("robot.model.c1 = 0.12: must be a table { value, min"), "{told}");
    assert!(told.contains("set robot.model.c1.value"), "{told}");
}

#[test]
fn the_range_of_a_whole_number_that_may_be_left_out_has_its_unit() {
    let told = &errors(&["robot.bus0.data_bitrate_bit_s=1"])[0];
    assert!(told.contains("must be a whole number, 1000000 to 8000000 bit/s"), "{told}");
}

/// A model as a diagnosis writes it: c2, friction and a spring found; a lag of no use to the controller.
const MODEL: &str = r#"
schema = 1
name = "found"
mechanism = "compass_gait"
[parameters]
leg_length_m = { value = 1.045 }
total_mass_kg = { value = 15.2 }
gravity_m_s2 = { value = 9.81 }
c1 = { value = 0.1007 }
c2 = { value = 0.1500, min = 0.1, max = 0.2 }
c3 = { value = 0.000596 }
c4 = { value = 0.1151 }
c5 = { value = 0.1264 }
c6 = { value = 0.0026 }
[[actuator]]
joint = "hip"
column = "hip_torque_nm"
gain = { value = 1.0 }
[[effect]]
effect = "coulomb_friction"
at = "hip"
coulomb = { value = 2.5, min = 1.0, max = 4.0 }
[[effect]]
effect = "joint_elasticity"
at = "hip"
stiffness = { value = 400.0 }
damping = { value = 0.2 }
rotor_inertia = { value = 0.1 }
[[effect]]
effect = "actuator_lag"
at = "hip_torque_nm"
time_constant = { value = 0.01 }
"#;

fn with_model(text: &str, overrides: &[&str]) -> Result<Resolved, Errors> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.toml");
    std::fs::write(&path, text).unwrap();
    let overrides: Vec<String> = overrides.iter().map(|o| (*o).to_owned()).collect();
    load_choice(Choice { model: Some(&path), overrides: &of_command_line(&overrides), ..Choice::default() })
}

#[test]
fn a_model_of_a_diagnosis_goes_to_the_controller_and_leaves_the_robot_alone() {
    let resolved = with_model(MODEL, &["robot.model.c5.value=0.13"]).unwrap();
    let (model, before) = (resolved.config.robot.model.params(), load(None, &[]).unwrap().config);
    assert_eq!((model.c[1], model.c[4], model.coulomb_nm), (0.15, 0.13, 2.5));
    assert_eq!(resolved.config.robot.model.hip_elasticity.map(|e| e.stiffness_nm_rad), Some(400.0));
    assert_eq!(resolved.config.body().params(), before.robot.model.params());
    assert_eq!(resolved.config.simulation.hip_elasticity, before.simulation.hip_elasticity);
    let note = &resolved.warnings[0].to_string();
    assert!(note.contains("actuator_lag at hip_torque_nm is not used"), "{note}");
    let again = from_canonical(&resolved.text, &[]).unwrap();
    assert_eq!((again.config.body().params(), again.hash), (resolved.config.body().params(), resolved.hash));
}

#[test]
fn a_body_that_is_given_stays_when_a_model_comes() {
    let body = load(None, &[]).unwrap();
    let keys: Vec<String> = body
        .text
        .lines()
        .filter_map(|l| l.strip_prefix("robot.model."))
        .map(|l| format!("sim.body.{}", l.replace(" = ", "=")))
        .chain(["sim.body.c1.value=0.11".to_owned()])
        .collect();
    let keys: Vec<&str> = keys.iter().map(String::as_str).collect();
    let resolved = with_model(MODEL, &keys).unwrap();
    assert_eq!(resolved.config.body().params().c[0].to_bits(), 0.11_f64.to_bits());
    assert_eq!(resolved.config.robot.model.params().c[0].to_bits(), 0.1007_f64.to_bits());
}

#[test]
fn a_model_of_another_machine_is_refused() {
    let pendulum = "schema = 1\nname = \"p\"\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = { value = 1.0 }\n\
                    gravity_nm = { value = 0.0 }\n";
    assert!(with_model(pendulum, &[]).unwrap_err().to_string().contains("the robot is a compass_gait"));
    assert!(with_model("schema = 1\n", &[]).unwrap_err().to_string().contains("is no model file"));
}

fn example_errors(name: &str, overrides: &[&str]) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/examples").join(name);
    let overrides: Vec<String> = overrides.iter().map(ToString::to_string).collect();
    load(Some(&path), &overrides).map_or_else(|errors| errors.to_string(), |_| String::new())
}

#[test]
fn drives_whose_identifiers_overlap_on_a_bus_are_refused() {
    let factory = example_errors("mit.toml", &["robot.drives.hip.reply_id=0"]);
    assert!(factory.contains("both use identifier 0x0 on bus 0"), "{factory}");
    // Node 4 of an ODrive is 0x080 to 0x09F: SYNC and emergencies.
    let toe_beside = ["robot.drives.hip.node=4", "robot.drives.inner_toe_a.bus=0"];
    assert!(example_errors("odrive.toml", &toe_beside).contains("both use identifier 0x82 on bus 0"));
}

#[test]
fn what_a_protocol_needs_is_asked_for_and_what_it_lacks_is_refused() {
    let text = "[set.robot.drives.hip]\nprotocol = \"moteus\"\ncounts_per_turn = 20000.0\n";
    let found = file("x.toml", text).unwrap_err().to_string();
    assert!(found.contains("robot.bus0.data_bitrate_bit_s") && found.contains("needs CAN-FD"), "{found}");
    assert!(example_errors("mit.toml", &["robot.drives.hip.torque_range_nm=20.0"]).contains("up to 30 Nm"));
    let odrive = example_errors("odrive.toml", &["robot.drives.hip.firmware=\"0.5\""]);
    assert!(odrive.contains("torque_constant_nm_a"), "{odrive}");
    assert!(errors(&["robot.drives.hip.protocol=lcm"])[0].contains("must be one of \"cia402\", \"mit\""));
}

#[test]
fn followed_plan_is_in_the_canonical_text_and_comes_back() {
    let load = |keys: &[&str]| load(None, &keys.iter().map(|k| (*k).to_owned()).collect::<Vec<_>>());
    let one = load(&["control.controller=transverse"]).unwrap();
    assert!(one.text.contains("compass-plan-1"));
    assert_eq!(one.text.lines().filter(|line| line.starts_with("control.plan")).count(), 1);
    let again = from_canonical(&one.text, &[]).unwrap();
    assert_eq!(again.text, one.text);
    assert_eq!(again.config.control.plan.text, one.config.control.plan.text);
    assert!(!load(&[]).unwrap().text.contains("compass-plan-1"), "a plan that nobody follows is not recorded");
    let error = load(&["control.controller=transverse", "control.plan=nowhere.plan"]).unwrap_err().to_string();
    assert!(error.contains("nowhere.plan") && error.contains("gait_350mm_525mm_s"), "{error}");
}
