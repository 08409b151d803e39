//! Checks across keys: can this robot exist, can these buses carry it? RT: before arming only.

use super::checked::{
    BusBackend, Config, DriveConfig, DriveMode, DriveProtocol, LidarLink, Model, Operator, Robot, SerialBackend,
};
use super::problem::{ACROSS_KEYS, Problem};
use super::reader::Log;
use super::robot::DRIVE_KEYS;
use crate::base::can_time::{BitRates, FrameKind};
use crate::base::time::Span;
use crate::msg::{Drive, Leg};

/// Runs all of them. Only meaningful when every value is in its range.
pub(super) fn check(config: &Config, log: &Log) {
    mass_matrix(&config.robot.model, log);
    masses(&config.robot.model, log);
    nodes(&config.robot, log);
    modes(&config.robot, log);
    fd_buses(&config.robot, log);
    mit_ranges(&config.robot, log);
    toe_springs(config, log);
    hip_torque(&config.robot, log);
    backends(&config.robot, log);
    start_on_ground(config, log);
    walks_on_blocks(config, log);
    safety_times(config, log);
    faults(config, log);
    watchdogs(config, log);
    remote_hand(&config.robot, log);
    for bus in 0..config.robot.buses.len() {
        bus_load(config, bus, log);
    }
}

/// Only what the robot has can break.
fn faults(config: &Config, log: &Log) {
    for injection in &config.simulation.faults {
        if let Err(what) = injection.check(&config.robot) {
            log.error(Problem { value: Some(injection.text()), ..problem("sim.faults", what) });
        }
    }
}

/// On the ground a robot cannot start with its swing foot in the ground.
fn start_on_ground(config: &Config, log: &Log) {
    let (sim, robot) = (&config.simulation, &config.robot);
    if sim.on_blocks {
        return;
    }
    let [ai, bi, ao, bo] = sim.initial_toe_m;
    let reach = |leg: usize, toe_m: f64| {
        let length = robot.model.leg_length_m.value - robot.toe.extended_m + toe_m;
        length * libm::cos(sim.initial_angle_rad[leg] + sim.ground_slope_rad)
    };
    let (inner, outer) = (reach(0, ai.max(bi)), reach(1, ao.max(bo)));
    let depth_m = if sim.stance == Leg::Inner { outer - inner } else { inner - outer };
    if depth_m > 0.0 {
        let what = format!(
            "on the ground (sim.on_blocks = false) the swing foot would start {:.1} mm in it: shorten its toes in \
             sim.initial_toe_m, or lean less",
            1e3 * depth_m
        );
        log.error(problem("sim.initial_angle_rad", what));
    }
}

/// On blocks no foot comes to the ground.
fn walks_on_blocks(config: &Config, log: &Log) {
    if config.simulation.on_blocks && config.simulation.carried_until_s.is_some() {
        let what = "carries a robot on the ground; with sim.on_blocks = true the hand holds still";
        log.error(problem("sim.carried_until_s", what.to_owned()));
    }
    if config.robot.is_simulated() && config.simulation.on_blocks && config.control.controller.walks() {
        let what = "takes steps, and with sim.on_blocks = true no foot comes to the ground; to walk, set it to false";
        log.warn(problem("control.controller", what.to_owned()));
    }
    let has_profile = config.simulation.floor.as_ref().is_some_and(|floor| !floor.profile.is_empty());
    if config.simulation.on_blocks && has_profile {
        let what = "is met by nobody with sim.on_blocks = true, where no foot comes to the ground";
        log.warn(problem("sim.floor.profile", what.to_owned()));
    }
}

/// Times that are possible, and so long that they protect nobody: seconds on which a motor runs on after its reason is gone.
fn safety_times(config: &Config, log: &Log) {
    let warn = |key: &str, span: Span, most_ms: i64, why: &str| {
        if span > Span::from_ms(most_ms) {
            let what = format!("{} ms is longer than the {most_ms} ms that make sense: {why}", span.as_s() * 1e3);
            log.warn(problem(key, what));
        }
    };
    let limits = &config.robot.limits;
    warn("robot.limits.operator_age_ms", limits.operator_age, 150, "so long torque goes on when the hand's link dies");
    warn("robot.limits.imu_age_ms", limits.imu_age, 50, "the legs fall on in that time");
    warn("robot.limits.drive_age_ms", limits.drive_age, 20, "the hip's angle is that old");
    warn("rt.period_us", config.real_time.period, 10, "no controller of ours balances so slowly");
    for (drive, settings) in DRIVE_KEYS.iter().zip(&config.robot.drives) {
        let key = |name: &str| format!("robot.drives.{drive}.{name}");
        warn(&key("watchdog_ms"), settings.watchdog, 100, "so long a drive follows a controller that is dead");
        warn(&key("heartbeat_ms"), settings.heartbeat, 200, "three of them pass before a silent drive is noticed");
    }
    if limits.overruns_per_s > 200 {
        let what =
            format!("{} skipped periods in a second are let pass: the loop is not in time then", limits.overruns_per_s);
        log.warn(problem("robot.limits.overruns_per_s", what));
    }
}

/// The master's heartbeat goes out four times in the shortest watchdog, and at most once in a round of SYNCs.
fn watchdogs(config: &Config, log: &Log) {
    for bus in 0..config.robot.buses.len() {
        let on_bus = || config.robot.drives.iter().filter(|drive| drive.bus == bus);
        let Some(watchdog) = on_bus().map(|drive| drive.watchdog).min() else { continue };
        let divisor = on_bus().map(|drive| drive.sync_divisor).max().unwrap_or(1);
        let round = Span(config.real_time.period.0.saturating_mul(i64::from(divisor)));
        if round.0.saturating_mul(2) > watchdog.0 {
            let what = format!(
                "the shortest watchdog is {} ms, and commands and our heartbeat come every {} ms: two must fit",
                watchdog.as_s() * 1e3,
                round.as_s() * 1e3
            );
            log.error(problem(&format!("robot.bus{bus}, rt.period_us"), what));
        }
    }
}

fn problem(key: &str, what: String) -> Problem {
    Problem { file: ACROSS_KEYS.into(), line: 0, key: key.to_owned(), value: None, what }
}

/// Kinetic energy must be positive: H at the upright, both stances (model notes, section 3).
fn mass_matrix(model: &Model, log: &Log) {
    let [c1, c2, c3, c4, c5, c6] = model.c.each_ref().map(|p| p.value);
    for (stance, c_stance, c_swing, d_stance, d_swing) in [("inner", c1, c2, c4, c5), ("outer", c2, c1, c5, c4)] {
        let h11 = 1.0 + c_stance - 2.0 * d_stance + 4.0 * c6;
        let h12 = c3 - d_swing + 2.0 * c6;
        if c_swing <= 0.0 || h11 * c_swing - h12 * h12 <= 0.0 {
            let what = format!("mass matrix is not positive definite on the {stance} leg: no such machine exists");
            log.error(problem("robot.model.c1..c6", what));
        }
    }
}

/// Shares of the total mass that the numbers ask for at least (model notes, section 2); together at most 1.
fn masses(model: &Model, log: &Log) {
    let [c1, c2, c3, c4, c5, c6] = model.c.each_ref().map(|p| p.value);
    let shares = [least_share(c4 * c4, c1 - c3), least_share(c5 * c5, c2 - c3), least_share(4.0 * c6 * c6, c3)];
    let sum: f64 = shares.iter().sum();
    // A NaN cannot come here; an infinite share can.
    if sum > 1.0 {
        let [inner, outer, body] = shares;
        let what = format!(
            "legs and body would need at least {inner:.3} + {outer:.3} + {body:.3} = {sum:.3} of the total mass; \
             a rigid machine has 1 (rotor inertia counts negative in c3)"
        );
        log.warn(problem("robot.model.c1..c6", what));
    }
}

/// Cauchy-Schwarz: a first moment p over an inertia j needs a mass of at least p^2 / j.
fn least_share(moment_squared: f64, inertia: f64) -> f64 {
    if moment_squared == 0.0 {
        0.0
    } else if inertia > 0.0 {
        moment_squared / inertia
    } else {
        f64::INFINITY
    }
}

fn nodes(robot: &Robot, log: &Log) {
    let drives: Vec<(&str, &DriveConfig)> = DRIVE_KEYS.into_iter().zip(&robot.drives).collect();
    for (i, (name, a)) in drives.iter().enumerate() {
        for (other, b) in &drives[i + 1..] {
            if a.bus != b.bus {
                continue;
            }
            let alike = std::mem::discriminant(&a.protocol) == std::mem::discriminant(&b.protocol);
            let keys = format!("robot.drives.{name}.node, robot.drives.{other}.node");
            if alike && a.node == b.node {
                let what = format!("{name} and {other} are both node {} on bus {}", a.node, a.bus);
                log.error(problem(&keys, what));
            } else if let Some(id) = common_identifier(a, b) {
                let what = format!("{name} and {other} both use identifier {id:#x} on bus {}", a.bus);
                log.error(problem(&keys, what));
            }
        }
    }
}

/// The first identifier that both drives would use.
fn common_identifier(a: &DriveConfig, b: &DriveConfig) -> Option<u32> {
    let (of_a, of_b) = (a.claims(), b.claims());
    let alike = std::mem::discriminant(&a.protocol) == std::mem::discriminant(&b.protocol);
    let clash = of_a.iter().flat_map(|x| of_b.iter().map(move |y| (x, y))).find(|(x, y)| {
        // What is shared, is so among drives of a kind.
        if alike { x.collides(y) } else { x.ids.start() <= y.ids.end() && y.ids.start() <= x.ids.end() }
    })?;
    Some(*clash.0.ids.start().max(clash.1.ids.start()))
}

/// CAN-FD drives need a CAN-FD bus; on one, drives that know classic frames only would destroy every FD frame.
fn fd_buses(robot: &Robot, log: &Log) {
    for (bus, config) in robot.buses.iter().enumerate() {
        let is_fd = |d: &DriveConfig| matches!(d.protocol, DriveProtocol::Moteus(_));
        let mut on_bus = robot.drives.iter().filter(|d| d.bus == bus);
        let (fd, classic) = (on_bus.clone().any(is_fd), on_bus.any(|d| !is_fd(d)));
        let key = format!("robot.bus{bus}.data_bitrate_bit_s");
        if fd && config.data_bitrate.is_none() {
            log.error(problem(&key, "is missing, but a moteus on this bus needs CAN-FD".to_owned()));
        }
        if fd && classic {
            let what =
                "a classic drive shares the bus with CAN-FD frames: it must tolerate them, or it will break them";
            log.warn(problem(&key, what.to_owned()));
        }
    }
}

/// Only a CiA 402 drive brings the potentiometer of a toe's spring.
fn toe_springs(config: &Config, log: &Log) {
    let toes = config.robot.drives.iter().skip(1);
    if !config.simulation.on_blocks && toes.into_iter().any(|d| !d.is_canopen()) {
        let what = "a toe's drive that speaks no CiA 402 brings no potentiometer: touchdown by that toe is not seen";
        log.warn(problem("robot.drives", what.to_owned()));
    }
}

/// The ranges of an MIT drive must hold what it is asked for.
fn mit_ranges(robot: &Robot, log: &Log) {
    for (name, config) in DRIVE_KEYS.iter().zip(&robot.drives) {
        let DriveProtocol::Mit(mit) = config.protocol else { continue };
        let most_nm = config.rated_torque_nm * f64::from(config.max_torque_permille) * 1e-3;
        if most_nm > mit.torque_range_nm {
            let what = format!("up to {most_nm} Nm, but torque_range_nm is {}", mit.torque_range_nm);
            log.error(problem(&format!("robot.drives.{name}.max_torque_permille"), what));
        }
    }
}

fn modes(robot: &Robot, log: &Log) {
    for ((drive, name), config) in Drive::ALL.iter().zip(DRIVE_KEYS).zip(&robot.drives) {
        let needed = if *drive == Drive::Hip { DriveMode::CyclicTorque } else { DriveMode::CyclicPosition };
        if config.mode != needed {
            let what = "the hip follows torque, toes follow position".to_owned();
            log.error(problem(&format!("robot.drives.{name}.mode"), what));
        }
    }
}

fn hip_torque(robot: &Robot, log: &Log) {
    let hip = &robot.drives[Drive::Hip as usize];
    let motor_nm = hip.rated_torque_nm * f64::from(hip.max_torque_permille) * 1e-3;
    let joint_nm = motor_nm * robot.hip.gear_ratio * robot.hip.gear_efficiency;
    // A hair of rounding is no finding.
    if robot.limits.hip_torque_nm > joint_nm * (1.0 + 1e-9) {
        let what = format!("{} Nm, but the drive gives only {joint_nm:.3} Nm", robot.limits.hip_torque_nm);
        log.warn(problem("robot.limits.hip_torque_nm", what));
    }
}

fn backends(robot: &Robot, log: &Log) {
    match (&robot.buses[0].backend, &robot.buses[1].backend) {
        (BusBackend::Mock, BusBackend::SocketCan(_)) | (BusBackend::SocketCan(_), BusBackend::Mock) => {
            let what = "one bus is simulated and the other is real".to_owned();
            log.error(problem("robot.bus0.backend, robot.bus1.backend", what));
        }
        (BusBackend::SocketCan(a), BusBackend::SocketCan(b)) if a == b => {
            log.error(problem("robot.bus0.backend, robot.bus1.backend", format!("both are interface {a}")));
        }
        _ => {}
    }
}

/// An operator behind a network: how soon a dead link is noticed, and who can reach the port.
fn remote_hand(robot: &Robot, log: &Log) {
    let Operator::Remote(remote) = &robot.operator else { return };
    // 20 ms are for the period of the states and for our own.
    if robot.limits.operator_age > Span::from_ms(110) {
        let what = "must be at most 110 ms with an operator behind a network: a dead link shall be safe within 130 ms";
        log.error(problem("robot.limits.operator_age_ms", what.to_owned()));
    }
    // Twenty datagrams, of which one must come.
    if robot.limits.operator_age < Span::from_ms(100) {
        let what = "is less than 100 ms: at 30 % loss the robot would disarm without reason";
        log.warn(problem("robot.limits.operator_age_ms", what.to_owned()));
    }
    if !remote.listen.ip().is_loopback() {
        let what =
            format!("{} can be reached from outside: the secret is all that keeps others from it", remote.listen);
        log.warn(problem("robot.operator.source", what));
    }
}

/// Real motors, and a hand or an attitude that a program makes up: nobody holds the robot. `compass plant` is exempt, it
/// is the simulated robot itself.
pub(super) fn made_up_senses(robot: &Robot, log: &Log) {
    if robot.is_simulated() {
        return;
    }
    if robot.operator == Operator::Simulated {
        let what = "the buses are real and the operator on the dead-man switch is simulated: motors would run with nobody \
                    there. Must be \"socket:/PATH\", \"device:/PATH\" or \"udp:ADDRESS:PORT\"";
        log.error(problem("robot.operator.source", what.to_owned()));
    }
    if robot.imu.backend == SerialBackend::Mock {
        let what = "the buses are real and the IMU is simulated: torque would follow an attitude that is made up. Must \
                    be the path of a device";
        log.error(problem("robot.imu.backend", what.to_owned()));
    }
    if robot.lidar.as_ref().is_some_and(|lidar| lidar.link == LidarLink::Mock) {
        let what = "the buses are real and the lidar is simulated: torque would follow a floor that is made up. Must be \
                    \"tcp:ADDRESS:PORT\" or \"serial:PATH\"";
        log.error(problem("robot.lidar.link", what.to_owned()));
    }
}

/// Time that a drive takes of each cycle on average, with the most stuffing, ns.
#[expect(clippy::cast_precision_loss, reason = "nanoseconds of one cycle")]
fn drive_ns(drive: &DriveConfig, rates: BitRates, period: Span) -> f64 {
    let (traffic, served) = (drive.traffic(), 1.0 / f64::from(drive.sync_divisor));
    let [command, answer] = [traffic.command, traffic.answer].map(|f| f.worst().time_ns(rates) as f64);
    let answers = match &drive.protocol {
        // By its own clock.
        DriveProtocol::Odrive(odrive) => f64::from(traffic.answers) * period.as_s() / odrive.feedback.as_s(),
        _ => f64::from(traffic.answers) * served,
    };
    command * served + answer * answers
}

/// The bus must carry its cyclic traffic, with some room for SDO, heartbeat and EMCY.
#[expect(clippy::cast_precision_loss, reason = "nanoseconds of one cycle")]
fn bus_load(config: &Config, bus: usize, log: &Log) {
    const ROOM: f64 = 0.9;
    let (rates, period) = (config.robot.buses[bus].rates(), config.real_time.period);
    let drives = || config.robot.drives.iter().filter(|d| d.bus == bus);
    let sync = if drives().any(DriveConfig::is_canopen) { FrameKind::classic(0).worst().time_ns(rates) } else { 0 };
    let sum = sync as f64 + drives().map(|drive| drive_ns(drive, rates, period)).sum::<f64>();
    let load = sum * 1e-9 / period.as_s();
    let key = format!("robot.bus{bus}");
    let what = format!("cyclic frames with worst stuffing take {:.0} % of the bus", load * 100.0);
    if load > 1.0 {
        log.error(problem(&key, what));
    } else if load > ROOM {
        log.warn(problem(&key, what));
    }
}
