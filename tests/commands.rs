//! The binary as a person meets it: exit codes, errors, and a recording from its making to its replay.
#![expect(clippy::unwrap_used, reason = "a test")]

use assert_cmd::Command;
use std::fs;
use std::path::Path;
use std::process::{Command as Plain, Stdio};

fn compass(arguments: &[&str]) -> (i32, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_compass")).args(arguments).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

#[test]
fn exit_codes_are_those_of_the_help() {
    assert_eq!(compass(&["check-config"]).0, 0);
    let (code, _, stderr) = compass(&["check-config", "--set", "robot.hip.gear_ratio=-3", "--set", "rt.nonsense=1"]);
    assert_eq!(code, 2);
    assert!(stderr.contains("2 errors") && stderr.contains("must be 1 to 500"), "{stderr}");
    assert_eq!(compass(&["no-such-command"]).0, 2);
    assert_eq!(compass(&["inspect", "/nowhere/x.mcap"]).0, 3);
}

#[test]
fn simulated_run_is_recorded_and_replays_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let into = folder.path().to_str().unwrap();
    let (code, stdout, stderr) = compass(&["sim", "--for", "3", "--record", into]);
    assert_eq!(code, 0, "{stdout}{stderr}");
    let file = fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
    let file = file.to_str().unwrap();
    let (code, stdout, _) = compass(&["inspect", file]);
    assert_eq!(code, 0, "{stdout}");
    assert!(stdout.contains("file      whole") && stdout.contains("mode Armed"), "{stdout}");
    assert!(stdout.contains(" s of its computer's uptime") && stdout.contains("longest sync"), "{stdout}");
    let (code, stdout, _) = compass(&["replay", file, "--check"]);
    assert_eq!((code, stdout.as_str()), (0, "3000 ticks alike to the bit\n"));
    let (code, stdout, _) = compass(&["replay", file, "--check", "--set", "control.lqr_r=0.5"]);
    assert_eq!(code, 1);
    assert!(stdout.contains("first difference: tick") && stdout.contains("wanted.hip_torque_nm"), "{stdout}");
}

#[test]
fn a_run_with_a_lidar_and_with_cameras_is_recorded_with_their_streams_and_replays_to_the_bit() {
    for (example, streams) in [("lidar.toml", &["lidar", "terrain"][..]), ("mocap.toml", &["mocap"])] {
        let folder = tempfile::tempdir().unwrap();
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/examples").join(example);
        let into = folder.path().to_str().unwrap();
        let (code, stdout, stderr) =
            compass(&["sim", "--config", config.to_str().unwrap(), "--for", "3", "--record", into]);
        assert_eq!(code, 0, "{stdout}{stderr}");
        let file = recording(folder.path());
        let (code, stdout, _) = compass(&["inspect", &file]);
        let count = |name: &str| {
            let line = stdout.lines().find(|line| line.split_whitespace().next() == Some(name)).unwrap();
            line.split_whitespace().nth(1).unwrap().parse::<u32>().unwrap()
        };
        assert!(code == 0 && streams.iter().all(|name| count(name) > 80), "{stdout}");
        let (code, stdout, _) = compass(&["replay", &file, "--check"]);
        assert_eq!((code, stdout.as_str()), (0, "3000 ticks alike to the bit\n"));
    }
}

#[test]
fn faults_are_listed_and_injected_and_what_is_misspelt_is_told() {
    let (code, stdout, _) = compass(&["sim", "--fault", "list"]);
    assert_eq!((code, stdout.lines().count()), (0, 64));
    for (fault, told) in [("bus_of@3", "nearest: bus_off"), ("disk_full@3", "but in guest"), ("boot_up@3:bus=1", "bus")]
    {
        let (code, _, stderr) = compass(&["sim", "--fault", fault]);
        assert!(code == 2 && stderr.contains(told), "{fault}: {stderr}");
    }
    let (code, stdout, _) = compass(&["sim", "--for", "4", "--fault", "emergency@3"]);
    assert!(code == 1 && stdout.contains("first fault DriveFault"), "{stdout}");
}

#[test]
fn a_scheduled_fault_that_cannot_be_injected_there_is_refused_with_its_line_and_its_places() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("faults.toml");
    let file = file.to_str().unwrap();
    for (command, fault, places) in [
        ("run", "disk_full@3", "cannot be injected in run, but in guest"),
        ("run", "bus_off@3:bus=1", "cannot be injected in run, but in sim, guest"),
        ("run", "mocap_frozen@3", "cannot be injected in run, but in sim, plant"),
        ("run", "joystick_dropped@3", "cannot be injected in run, but in sim"),
        ("plant", "step_overrun@3", "cannot be injected in plant, but in sim, guest"),
        ("sim", "clock_step@3", "cannot be injected in sim, but in guest"),
    ] {
        let mocap = include_str!("../config/examples/mocap.toml");
        let text =
            mocap.replace("[set.sim.mocap]", "[set.sim]\nfaults = [\"imu_stall@9s\",\n\"FAULT\"]\n[set.sim.mocap]");
        let line = 1 + text.lines().position(|line| line.contains("FAULT")).unwrap();
        fs::write(file, text.replace("FAULT", fault)).unwrap();
        let (code, _, stderr) = compass(&[command, "--config", file, "--for", "1"]);
        assert!(code == 2 && stderr.contains("1 error"), "{command} {fault}: {code} {stderr}");
        for told in [&format!("{file}:{line}: sim.faults[1] = \"{fault}"), places] {
            assert!(stderr.contains(told), "{command} {fault}: {stderr}");
        }
    }
}

/// The recording in `folder`.
fn recording(folder: &Path) -> String {
    let files = fs::read_dir(folder).unwrap().map(|f| f.unwrap().path().to_str().unwrap().to_owned());
    files.into_iter().find(|f| f.ends_with(".mcap")).unwrap()
}

/// Rms between 8 and 13 Hz after the recovery from the first tilt: torque in Nm, hip angle in degrees.
fn shaking(recording: &str) -> [f64; 2] {
    let (code, stdout, stderr) = compass(&["inspect", recording, "--band", "8,13", "--from", "3"]);
    assert_eq!(code, 0, "{stderr}");
    ["hip_torque_nm", "hip_angle_rad"].map(|name| {
        let line = stdout.lines().find(|l| l.starts_with(name)).unwrap();
        line.split_whitespace().rev().nth(1).unwrap().parse().unwrap()
    })
}

/// The demonstration of the README. The controller believes that the hip is rigid; `config/sim.toml` hides a spring.
#[test]
fn hidden_compliance_is_named_and_the_controller_that_knows_it_shakes_less() {
    let folder = tempfile::tempdir().unwrap();
    let [before, answer, after] = ["before", "answer", "after"].map(|name| folder.path().join(name));
    let text = |path: &Path| path.to_str().unwrap().to_owned();
    let balance = |more: &[&str], into: &Path| {
        let into = text(into);
        let mut arguments = vec!["sim", "--for", "7", "--set", "control.observer_epsilon_s=0.02"];
        arguments.extend(["--set", "control.lqr_r=0.01", "--record", &into].iter().chain(more));
        assert_eq!(compass(&arguments).0, 0);
    };
    balance(&[], &before);

    let (code, said, stderr) = compass(&["diagnose", "--own", &recording(&before), "--out", &text(&answer)]);
    assert_eq!(code, 1, "{stderr}");
    assert!(said.contains("elasticity between motor and link at hip"), "{said}");
    let hz = said.split("rings at ").nth(1).and_then(|s| s.split(" Hz").next()).and_then(|s| s.parse().ok());
    let hz: f64 = hz.unwrap_or(f64::NAN);
    assert!((hz - 10.5).abs() < 0.3, "{said}"); // 376.8 Nm/rad, .09 kg m2 and the legs: 10.5 Hz
    assert!(answer.join("report.html").exists());

    let model = text(&answer.join("model.toml"));
    balance(&["--model", &model], &after);
    let (was, is) = (shaking(&recording(&before)), shaking(&recording(&after)));
    assert!(was[0] > 5.0 && is[0] < 0.5 * was[0] && is[1] < 0.5 * was[1], "{was:?} {is:?}");

    // A recording stands wherever a CSV may: the model runs against it as it is.
    let window = ["--setup", "inner_stance", "--window-s", "0.5"];
    let (before, answer) = (recording(&before), text(&answer.join("free_run.csv")));
    let arguments = [&["predict", &model, &before, "--out", &answer][..], &window].concat();
    let (code, said, stderr) = compass(&arguments);
    assert_eq!(code, 0, "{stderr}");
    let line = said.lines().find(|l| l.contains("hip_angle_rad")).unwrap();
    let nrmse: f64 = line.split_whitespace().last().unwrap().parse().unwrap();
    assert!(nrmse < 0.05, "{said}");
}

#[test]
fn reader_that_goes_away_is_no_failure() {
    let mut child = Plain::new(env!("CARGO_BIN_EXE_compass"))
        .args(["check-config", "--print"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!((output.status.code(), String::from_utf8(output.stderr).unwrap()), (Some(0), String::new()));
}

/// A run of the simulated robot that is recorded into this folder; stdout goes where the test says.
fn recorded_run(folder: &Path, seconds: &str, stdout: Stdio) -> std::process::Child {
    let folder = folder.to_str().unwrap();
    Plain::new(env!("CARGO_BIN_EXE_compass"))
        .args(["run", "--for", seconds, "--record", folder, "--set", "rt.lock_memory=false"])
        .stdin(Stdio::null())
        .stdout(stdout)
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// The recording is closed; ticks in it.
fn whole_ticks(folder: &Path) -> u64 {
    let (_, said, stderr) = compass(&["inspect", &recording(folder)]);
    assert!(said.contains("file      whole"), "{said}{stderr}");
    let line = said.lines().find(|line| line.starts_with("loop")).unwrap();
    line.split_whitespace().find_map(|word| word.parse().ok()).unwrap()
}

/// On a loaded machine the simulated robot may have faulted (1); the view must neither end the run nor fail it.
fn ended_by_itself(child: &mut std::process::Child) {
    let code = child.wait().unwrap().code();
    assert!(matches!(code, Some(0 | 1)), "{code:?}");
}

#[test]
fn a_view_that_is_closed_or_on_a_full_disk_does_not_end_the_robot() {
    let (closed, full) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let mut child = recorded_run(closed.path(), "4s", Stdio::piped());
    let device = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let mut other = recorded_run(full.path(), "4s", device.into());
    drop(child.stdout.take());
    for (child, folder) in [(&mut child, closed.path()), (&mut other, full.path())] {
        ended_by_itself(child);
        // It ended at tick 1064 and 77 once.
        let ticks = whole_ticks(folder);
        assert!(ticks > 2_000, "{ticks}");
    }
}

#[test]
fn a_view_that_nobody_reads_does_not_keep_a_signal_from_closing_the_recording() {
    use std::io::{Read, Write};
    let folder = tempfile::tempdir().unwrap();
    let (mut reader, mut writer) = std::io::pipe().unwrap();
    // Full from the start: the first line of the view already blocks.
    let filler = std::thread::spawn({
        let mut writer = writer.try_clone().unwrap();
        move || writer.write_all(&[b'x'; 1 << 20]).is_err()
    });
    std::thread::sleep(std::time::Duration::from_millis(200));
    let mut child = recorded_run(folder.path(), "1h", writer.try_clone().unwrap().into());
    std::thread::sleep(std::time::Duration::from_secs(3));
    let pid = child.id().to_string();
    assert!(Plain::new("kill").args(["-TERM", &pid]).status().unwrap().success());
    ended_by_itself(&mut child);
    assert!(whole_ticks(folder.path()) > 500);
    let mut rest = vec![0; 1 << 20];
    reader.read_exact(&mut rest).unwrap();
    writer.flush().unwrap();
    assert!(!filler.join().unwrap());
}

#[test]
fn a_closed_terminal_and_every_ending_signal_end_the_run_in_order() {
    for signal in ["-HUP", "-QUIT", "-INT"] {
        let folder = tempfile::tempdir().unwrap();
        let mut child = recorded_run(folder.path(), "1h", Stdio::null());
        // The recording begins when signals are caught; a second later there are ticks in it.
        while fs::read_dir(folder.path()).unwrap().count() == 0 {
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        std::thread::sleep(std::time::Duration::from_secs(2));
        assert!(Plain::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
        // HUP and QUIT killed it once, its drives without stop frames and its recording torn.
        ended_by_itself(&mut child);
        assert!(whole_ticks(folder.path()) > 0, "{signal}");
    }
}

#[test]
fn a_second_run_of_the_same_robot_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let name = format!("test-twice-{}", std::process::id());
    let run = |seconds: &str| {
        let mut command = Plain::new(env!("CARGO_BIN_EXE_compass"));
        command.args(["run", "--for", seconds, "--name", &name, "--set", "rt.lock_memory=false"]);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        command.spawn().unwrap()
    };
    let mut first = recorded_run(folder.path(), "1h", Stdio::null());
    let mut named = run("1h");
    std::thread::sleep(std::time::Duration::from_secs(3));
    let second = run("1h").wait_with_output().unwrap();
    let said = String::from_utf8(second.stderr).unwrap();
    assert_eq!(second.status.code(), Some(3), "{said}");
    assert!(said.contains(&name), "{said}");
    assert!(named.try_wait().unwrap().is_none() && first.try_wait().unwrap().is_none(), "the others run on");
    for child in [&mut first, &mut named] {
        assert!(Plain::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap().success());
        ended_by_itself(child);
    }
}

/// Inodes of the sockets that this process has open.
fn sockets_of(pid: u32) -> Vec<String> {
    let links =
        fs::read_dir(format!("/proc/{pid}/fd")).unwrap().filter_map(|fd| fs::read_link(fd.unwrap().path()).ok());
    let inode = |link: &str| Some(link.strip_prefix("socket:[")?.strip_suffix(']')?.to_owned());
    links.filter_map(|link| inode(link.to_str()?)).collect()
}

#[test]
fn without_being_told_to_a_run_opens_no_port_of_any_network() {
    let folder = tempfile::tempdir().unwrap();
    let secret = folder.path().join("secret");
    fs::write(&secret, "a secret of a test, long enough").unwrap();
    let mode = std::os::unix::fs::PermissionsExt::from_mode(0o600);
    fs::set_permissions(&secret, mode).unwrap();
    let secret = format!("robot.operator.secret_file=\"{}\"", secret.display());
    let remote = ["--set", "robot.operator.source=udp:127.0.0.1:44409", "--set", &secret];
    for (more, ports) in [(&[][..], 0), (&remote[..], 1)] {
        let mut child = Plain::new(env!("CARGO_BIN_EXE_compass"))
            .args([&["run", "--for", "1h", "--set", "rt.lock_memory=false"][..], more].concat())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(std::time::Duration::from_secs(2));
        let ours = sockets_of(child.id());
        let of_networks = ["tcp", "tcp6", "udp", "udp6", "raw", "raw6"].map(|kind| format!("/proc/net/{kind}"));
        let inodes = |table: &String| -> Vec<String> {
            let text = fs::read_to_string(table).unwrap_or_default();
            text.lines().skip(1).filter_map(|line| Some(line.split_whitespace().nth(9)?.to_owned())).collect()
        };
        let open = of_networks.iter().flat_map(inodes).filter(|inode| ours.contains(inode)).count();
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(!ours.is_empty() && open == ports, "{open} ports with {more:?}");
    }
}

#[test]
fn a_dead_man_switch_without_a_hand_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hand");
    let robot = std::os::unix::net::UnixDatagram::bind(&path).unwrap();
    robot.set_nonblocking(true).unwrap();
    let (code, _, stderr) = compass(&["operator", "--socket", path.to_str().unwrap()]);
    assert_eq!(code, 2, "{stderr}");
    assert!(stderr.contains("wants a hand"), "{stderr}");
    let mut bytes = [0; 16];
    while let Ok(count) = robot.recv(&mut bytes) {
        assert_ne!(&bytes[..count], [1], "nobody holds anything");
    }
    let (code, _, stderr) = compass(&["zero", "--socket", path.to_str().unwrap(), "--angle-deg", "2"]);
    assert_eq!((code, robot.recv(&mut bytes).unwrap()), (0, 9), "{stderr}");
}

#[test]
fn another_process_reads_along_in_shared_memory_and_at_the_socket() {
    let folder = tempfile::tempdir().unwrap();
    let socket = folder.path().join("watch");
    let (socket, name) = (socket.to_str().unwrap(), format!("test-watch-{}", std::process::id()));
    let mut robot = Plain::new(env!("CARGO_BIN_EXE_compass"))
        .args(["run", "--for", "20s", "--name", &name, "--watch-socket", socket, "--set", "rt.lock_memory=false"])
        .args(["--record", folder.path().to_str().unwrap()])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    while !Path::new(socket).exists() {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    for ways in [["--socket", socket], ["--name", &name]] {
        let lines =
            || compass(&[&["watch", "--for", "1s", "--stream", "status", "--stream", "recorder"], &ways[..]].concat());
        // The channels are there a moment after the process.
        let (code, said, stderr) =
            (0..50).map(|_| lines()).find(|(code, said, _)| *code == 0 && !said.is_empty()).unwrap_or_else(lines);
        assert_eq!(code, 0, "{ways:?}: {stderr}");
        let messages: Vec<serde_json::Value> = said.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        assert!(messages.iter().any(|line| line["stream"] == "status" && line["message"]["mode"].is_string()));
        let recording = |line: &serde_json::Value| line["message"]["state"] == "Recording";
        assert!(messages.iter().any(|line| line["stream"] == "recorder" && recording(line)), "{ways:?}: {said}");
        let (code, said, stderr) = compass(&[&["watch", "--for", "2s"], &ways[..]].concat());
        assert!(code == 0 && said.contains("stance"), "{ways:?}: {said}{stderr}");
    }
    assert_eq!(compass(&["watch", "--socket", socket, "--stream", "nonsense"]).0, 2);
    assert_eq!(compass(&["watch", "--socket", "/nowhere/watch"]).0, 3);
    assert_eq!(compass(&["watch", "--name", "no-such-robot"]).0, 3);
    robot.kill().unwrap();
    robot.wait().unwrap();
}

/// As the help shows them: numbers of one option with commas between.
#[test]
fn plan_takes_its_lists_as_the_help_shows_them() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("gait.plan");
    let gait = ["plan", "gait", "--step", "0.34", "--speed", "0.5", "--out", out.to_str().unwrap()];
    let plan = |more: &[&str]| compass(&[&gait, more].concat());
    let (code, stdout, stderr) = plan(&["--knots", "8,12", "--cost", "1,0,0,0.2", "--weights", "100,10,1,0.1,1"]);
    assert_eq!(code, 0, "{stdout}{stderr}");
    let (code, _, stderr) = plan(&["--cost", "1,0,0"]);
    assert!(code == 2 && stderr.contains("--cost: 4 numbers, here are 3"), "{stderr}");
}
