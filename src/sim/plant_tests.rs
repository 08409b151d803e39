//! The master of a bus against the simulated drives: whole walks over the wire.

use super::*;
use crate::bus::canopen::{Emergency, Message, Node};
use crate::bus::cia402::State;
use crate::bus::line::{Line, SetupFault};
use crate::config;
use crate::msg::{BusHealth, DriveCommand, DriveCommands, DriveFeedbacks, DriveGoal, DriveState};

/// Inertia and nothing else at the hip; toes that follow at a limited rate.
struct Flywheel {
    reading: Reading,
    rate: f64,
}

impl World for Flywheel {
    fn step(&mut self, hip_torque_nm: f64, toe_target_m: [f64; TOES], dt: Span) {
        let dt = dt.as_s();
        self.rate += hip_torque_nm / 2.0 * dt;
        self.reading.hip_encoder_rad += self.rate * dt;
        for (toe, target) in self.reading.toe_position_m.iter_mut().zip(toe_target_m) {
            *toe += (target - *toe).clamp(-0.2 * dt, 0.2 * dt);
        }
    }
    fn let_go(&mut self) {}
    fn push(&mut self, impulse_ns: f64) {
        self.rate += impulse_ns;
    }
    fn reading(&self) -> Reading {
        self.reading
    }
}

/// Both masters and the robot, a millisecond at a time.
struct Walk {
    plant: Plant,
    lines: [Line; BUSES],
    received: [FrameBatch; BUSES],
    sent: [FrameBatch; BUSES],
    feedbacks: DriveFeedbacks,
    commands: DriveCommands,
    config: Config,
    ms: i64,
}

fn walk() -> Walk {
    walk_with(&[])
}

fn walk_with(keys: &[&str]) -> Walk {
    let keys: Vec<String> = keys.iter().map(|k| (*k).to_owned()).collect();
    let mut config = config::load(None, &keys).unwrap().config;
    config.simulation.actuator_lag_s = 0.0005;
    let reading = Reading { toe_position_m: config.simulation.initial_toe_m, ..Reading::default() };
    let plant = Plant::with_world(&config, Box::new(Flywheel { reading, rate: 0.0 }));
    let lines = [0, 1].map(|bus| Line::new(&config.robot, bus, &config.real_time).unwrap());
    Walk {
        plant,
        lines,
        received: Default::default(),
        sent: Default::default(),
        feedbacks: DriveFeedbacks::default(),
        commands: DriveCommands::default(),
        config,
        ms: 0,
    }
}

impl Walk {
    fn tick(&mut self) {
        let now = Stamp(self.ms * 1_000_000);
        self.ms += 1;
        for bus in 0..BUSES {
            self.received[bus].clear();
            self.plant.take_frames(bus, &mut self.received[bus]);
            self.lines[bus].receive(now, now, &self.received[bus], BusHealth::Active, &mut self.feedbacks);
            self.sent[bus].clear();
            self.lines[bus].transmit(now, &self.commands, &mut self.sent[bus]);
            for frame in &self.sent[bus] {
                self.plant.deliver(bus, &frame.frame);
            }
        }
        self.plant.advance_to(now + Span::from_ms(1));
    }

    /// Milliseconds until it holds, at most `limit`.
    fn until(&mut self, limit: i64, holds: impl Fn(&Self) -> bool) -> i64 {
        let start = self.ms;
        while !holds(self) {
            assert!(self.ms - start < limit, "not within {limit} ms: {:?}", self.feedbacks);
            self.tick();
        }
        self.ms - start
    }

    fn all(&self, state: DriveState) -> bool {
        self.feedbacks.drives.iter().all(|d| d.state == state)
    }

    fn command(&mut self, goal: DriveGoal, torque_permille: i16) {
        let hip = DriveCommand { goal, torque_permille, ..DriveCommand::default() };
        let toe = DriveCommand { goal, hold: true, ..DriveCommand::default() };
        self.commands.drives = [hip, toe, toe, toe, toe];
    }

    /// Set up and enabled, nothing commanded.
    fn enabled() -> Self {
        Self::enabled_with(&[])
    }

    fn enabled_with(keys: &[&str]) -> Self {
        let mut w = walk_with(keys);
        w.command(DriveGoal::Disabled, 0);
        w.until(2000, |w| w.all(DriveState::SwitchOnDisabled));
        w.command(DriveGoal::Enabled, 0);
        w.until(500, |w| w.all(DriveState::Enabled));
        w
    }

    fn hip_state(&mut self) -> State {
        self.plant.drive_mut(Drive::Hip).state()
    }

    /// Torques in commands to the hip sent this tick.
    fn hip_torques_sent(&self) -> Vec<i16> {
        let id = u32::from(Object::Rpdo(1, Node::new(self.config.robot.drives[0].node).unwrap()).id());
        let bus = self.config.robot.drives[0].bus;
        let frames = self.sent[bus].iter().filter(|f| f.frame.id == id);
        frames.map(|f| i16::from_le_bytes([f.frame.data[2], f.frame.data[3]])).collect()
    }
}

#[test]
fn five_drives_are_set_up_and_enabled_over_the_wire() {
    let mut w = walk();
    w.command(DriveGoal::Disabled, 0);
    let set_up_ms = w.until(2000, |w| w.all(DriveState::SwitchOnDisabled));
    w.command(DriveGoal::Ready, 0);
    w.until(200, |w| w.all(DriveState::Ready));
    w.command(DriveGoal::Enabled, 0);
    let enable_ms = w.until(200, |w| w.all(DriveState::Enabled));
    println!("set up in {set_up_ms} ms, enabled in {enable_ms} ms");
    assert!(w.lines.iter().all(|l| l.counters().stalls == 0 && l.counters().foreign == 0));
}

#[test]
fn torque_reaches_the_world_with_its_sign_and_size() {
    let mut w = Walk::enabled();
    w.command(DriveGoal::Enabled, 500);
    for _ in 0..10 {
        w.tick();
    }
    let before = w.feedbacks.drives[0].position_counts;
    assert_eq!(w.feedbacks.drives[0].torque_permille, 500);
    for _ in 0..100 {
        w.tick();
    }
    let turned = f64::from(w.feedbacks.drives[0].position_counts - before) * w.config.robot.hip.motor_sign;
    // 7.5 Nm on 2 kg m^2 for 0.1 s, already turning after 10 ms: 0.5 * 3.75 * (0.11^2 - 0.01^2) rad = 72 counts.
    assert!((turned - 72.0).abs() < 4.0, "{turned} counts");
}

#[test]
fn the_first_commands_after_enabling_carry_no_torque() {
    let mut w = walk();
    w.command(DriveGoal::Disabled, 0);
    w.until(2000, |w| w.all(DriveState::SwitchOnDisabled));
    w.command(DriveGoal::Enabled, 700);
    let mut while_enabled = Vec::new();
    for _ in 0..30 {
        w.tick();
        if w.feedbacks.drives[0].state == DriveState::Enabled {
            while_enabled.extend(w.hip_torques_sent());
        } else {
            assert!(w.hip_torques_sent().iter().all(|t| *t == 0));
        }
    }
    assert_eq!(while_enabled[..2], [0, 0]);
    assert_eq!(while_enabled[2], 700);
}

#[test]
fn position_is_stamped_with_the_sync_it_answers_and_is_at_most_a_cycle_old() {
    let mut w = Walk::enabled();
    for _ in 0..20 {
        w.tick();
        let age = Stamp((w.ms - 1) * 1_000_000).since(w.feedbacks.drives[0].stamp);
        assert!(age > Span::ZERO && age < Span::from_us(1000), "{age:?}");
    }
}

#[test]
fn toes_go_where_they_are_told_and_hold_where_they_are() {
    let mut w = Walk::enabled();
    let counts_per_m = w.config.robot.toe.counts_per_m;
    let start = w.feedbacks.drives[1].position_counts;
    let target = start - (0.005 * counts_per_m) as i32;
    w.commands.drives[1] =
        DriveCommand { goal: DriveGoal::Enabled, position_counts: target, hold: false, ..DriveCommand::default() };
    for _ in 0..100 {
        w.tick();
    }
    assert!((w.feedbacks.drives[1].position_counts - target).abs() <= 1);
    w.commands.drives[1].hold = true;
    w.commands.drives[1].position_counts = 0;
    for _ in 0..100 {
        w.tick();
    }
    assert!((w.feedbacks.drives[1].position_counts - target).abs() <= 1);
    assert_eq!(w.feedbacks.drives[2].position_counts, start);
}

#[test]
fn dropping_the_goal_takes_the_torque_off_within_the_same_cycle() {
    let mut w = Walk::enabled();
    w.command(DriveGoal::Enabled, 500);
    for _ in 0..10 {
        w.tick();
    }
    w.command(DriveGoal::Disabled, 0);
    w.tick();
    assert_eq!(w.hip_torques_sent(), [0]);
    assert_eq!(w.hip_state(), State::SwitchOnDisabled);
    for toe in [Drive::InnerToeA, Drive::OuterToeB] {
        assert_eq!(w.plant.drive_mut(toe).state(), State::SwitchOnDisabled, "toes do not wait for their turn");
    }
}

#[test]
fn a_killed_master_leaves_the_motors_off_within_a_hundred_milliseconds() {
    let mut w = Walk::enabled();
    w.command(DriveGoal::Enabled, 500);
    for _ in 0..50 {
        w.tick();
    }
    let killed = w.plant.now();
    let mut off_ms = None;
    for ms in 1..=200 {
        w.plant.advance_to(killed + Span::from_ms(ms));
        let torque = w.plant.drive_mut(Drive::Hip).torque_permille();
        if off_ms.is_none() && torque.abs() < 1.0 {
            off_ms = Some(ms);
        }
    }
    println!("motor off {off_ms:?} ms after the master's last frame");
    assert!(off_ms.is_some_and(|ms| ms <= 100));
    assert_ne!(w.hip_state(), State::Enabled);
}

#[test]
fn a_drive_that_reboots_is_set_up_anew_and_stays_disabled_until_the_goal_was_dropped() {
    let mut w = Walk::enabled();
    w.plant.reboot_drive(Drive::InnerToeA);
    w.until(100, |w| w.feedbacks.drives[1].state == DriveState::Configuring);
    assert_eq!(w.feedbacks.drives[1].error_code, SetupFault::Rebooted as u16);
    w.until(500, |w| w.feedbacks.drives[1].state == DriveState::SwitchOnDisabled);
    for _ in 0..100 {
        w.tick();
        assert_ne!(w.feedbacks.drives[1].state, DriveState::Enabled);
    }
    w.command(DriveGoal::Disabled, 0);
    w.until(20, |w| w.all(DriveState::SwitchOnDisabled));
    w.command(DriveGoal::Enabled, 0);
    w.until(200, |w| w.all(DriveState::Enabled));
    assert_eq!(w.lines[0].counters().reboots, 1);
}

#[test]
fn a_drive_fault_is_told_and_reset_only_after_the_goal_was_dropped() {
    let mut w = Walk::enabled();
    w.plant.fail_drive(Drive::Hip, 0x2310);
    w.until(10, |w| w.feedbacks.drives[0].state == DriveState::Fault);
    assert_eq!(w.feedbacks.drives[0].error_code, 0x2310);
    for _ in 0..100 {
        w.tick();
        assert_eq!(w.hip_state(), State::Fault);
    }
    w.command(DriveGoal::Disabled, 0);
    w.tick();
    w.command(DriveGoal::Enabled, 0);
    w.until(200, |w| w.all(DriveState::Enabled));
    assert_eq!(w.feedbacks.drives[0].error_code, 0);
}

#[test]
fn a_heartbeat_that_stops_makes_the_drive_lost() {
    let mut w = Walk::enabled();
    w.plant.drive_mut(Drive::OuterToeA).defects_mut().no_heartbeat = true;
    let limit = w.config.robot.drives[3].heartbeat.0 / 1_000_000 * 3 + 5;
    w.until(limit, |w| w.feedbacks.drives[3].state == DriveState::Lost);
    assert_eq!(w.feedbacks.drives[3].error_code, SetupFault::HeartbeatLost as u16);
}

#[test]
fn a_drive_without_the_mode_or_without_answer_is_refused() {
    let mut w = walk();
    w.plant.drive_mut(Drive::Hip).defects_mut().no_torque_mode = true;
    w.plant.reboot_drive(Drive::Hip);
    w.plant.drive_mut(Drive::OuterToeB).defects_mut().mute_server = true;
    w.command(DriveGoal::Disabled, 0);
    w.until(500, |w| w.feedbacks.drives[0].error_code == SetupFault::ModeUnsupported as u16);
    w.until(1000, |w| w.feedbacks.drives[4].error_code == SetupFault::NoAnswer as u16);
    w.until(2000, |w| w.feedbacks.drives[1].state == DriveState::SwitchOnDisabled);
}

#[test]
fn after_a_bus_without_power_no_old_torque_reaches_a_motor() {
    let mut w = Walk::enabled();
    w.command(DriveGoal::Enabled, 500);
    for _ in 0..50 {
        w.tick();
    }
    w.plant.set_bus_silent(0, true);
    let noticed = w.until(30, |w| w.feedbacks.health[0] == BusHealth::Stalled);
    println!("stall noticed after {noticed} ms");
    assert!(noticed <= 20, "{noticed} ms");
    for _ in 0..500 {
        w.tick();
        assert!(w.hip_torques_sent().is_empty());
    }
    // Power comes back: the drives are fresh, the queue still holds what was in flight.
    w.plant.reboot_drive(Drive::Hip);
    w.plant.set_bus_silent(0, false);
    for _ in 0..300 {
        w.tick();
        assert!(w.hip_torques_sent().iter().all(|t| *t == 0));
        assert!(w.plant.drive_mut(Drive::Hip).torque_permille().abs() < 1.0);
        assert_ne!(w.hip_state(), State::Enabled);
    }
    w.command(DriveGoal::Disabled, 0);
    w.tick();
    w.until(2000, |w| w.feedbacks.drives[..3].iter().all(|d| d.state == DriveState::SwitchOnDisabled));
    w.command(DriveGoal::Enabled, 0);
    w.until(200, |w| w.all(DriveState::Enabled));
    assert_eq!(w.lines[0].counters().stalls, 1);
}

#[test]
fn a_release_on_a_jammed_bus_follows_the_frame_in_flight_at_once_and_only_once() {
    let mut w = Walk::enabled();
    w.command(DriveGoal::Enabled, 500);
    for _ in 0..50 {
        w.tick();
    }
    w.plant.set_bus_silent(0, true);
    w.tick();
    w.tick();
    assert!(w.hip_torques_sent().is_empty(), "a command is in flight, and the next would only pile up");
    w.command(DriveGoal::Disabled, 0);
    w.tick();
    assert_eq!(w.hip_torques_sent(), [0], "it does not wait for the drive's own watchdog");
    for _ in 0..5 {
        w.tick();
        assert!(w.hip_torques_sent().is_empty());
    }
}

#[test]
fn an_emergency_whose_end_is_never_told_does_not_block_for_ever() {
    let mut w = Walk::enabled();
    w.command(DriveGoal::Ready, 0);
    let node = Node::new(w.config.robot.drives[0].node).unwrap();
    let cry = Message::Emergency(node, Emergency { code: 0x3210, register: 1, maker: [0; 5] }).emit();
    w.tick();
    let mut frames = FrameBatch::default();
    frames.push(BusFrame::theirs(w.plant.now(), cry));
    let now = w.plant.now();
    w.lines[0].receive(now, now, &frames, BusHealth::Active, &mut w.feedbacks);
    assert_eq!(w.feedbacks.drives[0].error_code, 0x3210);
    w.until(2_100, |w| w.feedbacks.drives[0].error_code == 0);
}

#[test]
fn frames_that_were_not_sent_leave_nothing_in_flight_and_the_round_in_step() {
    let mut w = Walk::enabled();
    w.command(DriveGoal::Enabled, 100);
    let withheld = |w: &Walk| w.lines.each_ref().map(|l| l.counters().withheld);
    for k in 0..400 {
        if k % 7 == 0 {
            // The tick decides, and its frames are thrown away.
            let now = Stamp(w.ms * 1_000_000);
            w.ms += 1;
            for bus in 0..BUSES {
                w.received[bus].clear();
                w.plant.take_frames(bus, &mut w.received[bus]);
                w.lines[bus].receive(now, now, &w.received[bus], BusHealth::Active, &mut w.feedbacks);
                w.lines[bus].transmit(now, &w.commands, &mut FrameBatch::default());
                w.lines[bus].take_back();
            }
            w.plant.advance_to(now + Span::from_ms(1));
        } else {
            w.tick();
        }
        assert!(w.all(DriveState::Enabled), "{k}: {:?}", w.feedbacks);
    }
    assert_eq!((withheld(&w), w.lines[0].counters().stalls), ([0, 0], 0));
}

#[test]
fn measured_load_of_the_bus_is_below_the_budget_and_all_frames_arrive_in_their_cycle() {
    let mut w = Walk::enabled();
    w.command(DriveGoal::Enabled, 123);
    let before = [w.plant.wire(0).busy(), w.plant.wire(1).busy()];
    for _ in 0..1000 {
        w.tick();
    }
    for bus in 0..BUSES {
        let load = (w.plant.wire(bus).busy().0 - before[bus].0) as f64 * 1e-9;
        println!("bus {bus}: {:.1} % busy", load * 100.0);
        // Worst stuffing and everything regular: 55 + 230 + 460 / 4 + heartbeats, of 1000 us.
        assert!(load < 0.45);
    }
    assert!(w.lines.iter().all(|l| l.counters().withheld == 0));
}

#[test]
fn a_bus_at_an_eighth_of_the_bit_rate_is_overloaded_and_shows_it() {
    let mut w = walk();
    for bus in &mut w.config.robot.buses {
        bus.bitrate = 125_000;
    }
    let reading = Reading { toe_position_m: w.config.simulation.initial_toe_m, ..Reading::default() };
    w.plant = Plant::with_world(&w.config, Box::new(Flywheel { reading, rate: 0.0 }));
    for _ in 0..1000 {
        w.tick();
    }
    let load = w.plant.wire(0).busy().as_s();
    let withheld = w.lines[0].counters().withheld;
    println!("load {load:.2}, {withheld} commands withheld");
    assert!(load > 0.8 && withheld > 0);
}

#[test]
fn the_same_commands_give_the_same_bits() {
    let run = || {
        let mut w = Walk::enabled();
        w.command(DriveGoal::Enabled, 321);
        for _ in 0..300 {
            w.tick();
        }
        (w.feedbacks, w.received)
    };
    assert_eq!(run(), run());
}

#[test]
fn a_delayed_torque_moves_the_hip_by_so_much_later() {
    // Rate of the flywheel (2 kg m²) under the same command, with and without delay: τ delay / J apart, exactly.
    let mut rates = [0.0; 2];
    for (rate, delay) in rates.iter_mut().zip(["0.0", "0.0053"]) {
        let mut w = Walk::enabled_with(&[&format!("sim.actuator_delay_s={delay}")]);
        let start = w.plant.reading().hip_encoder_rad;
        w.command(DriveGoal::Enabled, 500);
        let mut before = start;
        for _ in 0..40 {
            before = w.plant.reading().hip_encoder_rad;
            w.tick();
        }
        *rate = (w.plant.reading().hip_encoder_rad - before) / 1e-3;
    }
    let torque_nm = 0.5 * {
        let w = walk();
        let hip = &w.config.robot.drives[0];
        hip.rated_torque_nm * w.config.robot.hip.gear_ratio * w.config.robot.hip.gear_efficiency
    };
    let expected = torque_nm / 2.0 * 0.0053;
    // 5 us of grain at the start of each torque.
    let slack = torque_nm / 2.0 * 1e-5;
    assert!((rates[0] - rates[1] - expected).abs() < slack, "{rates:?}, {expected}");
}

#[test]
fn pushes_come_at_their_time() {
    let mut w = walk_with(&["sim.pushes=[{time_s=0.0105, impulse_ns=3.0}]"]);
    for _ in 0..20 {
        w.tick();
    }
    assert_eq!((w.plant.pushes().given(), w.plant.pushes().last()), (1, Some((Stamp(10_500_000), 3.0))));
    // 3 rad/s since then.
    assert!((w.plant.reading().hip_encoder_rad - 3.0 * 0.0095).abs() < 3.0 * 1e-5);
}
