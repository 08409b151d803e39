//! What every drive must do, written once and run for every protocol: the master of the bus against the simulated
//! drive, over the wire. The whole robot with each of them: `examples_balance`.

use super::drive::SimDrive;
use super::plant::Plant;
use super::{Reading, World};
use crate::base::time::{Span, Stamp};
use crate::bus::cia402::State;
use crate::bus::line::{Line, SetupFault};
use crate::config::{self, checked::Config};
use crate::msg::{
    BUSES, BusFrame, BusHealth, CanFrame, Drive, DriveCommand, DriveCommands, DriveFeedback, DriveFeedbacks, DriveGoal,
    DriveState, FrameBatch, TOES,
};
use proptest::prelude::*;
use std::path::PathBuf;

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
    fn push(&mut self, _impulse_ns: f64) {}
    fn reading(&self) -> Reading {
        self.reading
    }
}

/// A protocol under test: an example's robot, with changes.
#[derive(Clone, Copy)]
struct Case {
    example: &'static str,
    set: &'static [&'static str],
    /// Torque is coded in steps of about so much, 1/1000 of rated.
    step_permille: f64,
    /// Position in steps of about so many counts.
    step_counts: f64,
    /// It tells its faults; a mini-cheetah has no place for them in its answers.
    faults: bool,
}

fn example(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("config/examples").join(name)
}

fn load(case: Case) -> Config {
    let keys: Vec<String> = case.set.iter().map(ToString::to_string).collect();
    let path = (!case.example.is_empty()).then(|| example(case.example));
    let mut config = config::load(path.as_deref(), &keys).unwrap().config;
    config.simulation.actuator_lag_s = 0.0005;
    config.simulation.torque_limit_nm = None;
    config
}

/// Both masters and the robot, a millisecond at a time.
struct Walk {
    plant: Plant,
    lines: [Line; BUSES],
    received: [FrameBatch; BUSES],
    sent: [FrameBatch; BUSES],
    feedbacks: DriveFeedbacks,
    commands: DriveCommands,
    bus: usize,
    heartbeat_ms: i64,
    injected: Vec<CanFrame>,
    ms: i64,
    /// Knows what is a command to the hip.
    reader: SimDrive,
}

impl Walk {
    fn new(case: Case) -> Self {
        Self::turning(case, 0.0)
    }

    /// A hip that turns at this rate, rad/s, as if by a hand.
    fn turning(case: Case, rate: f64) -> Self {
        let config = load(case);
        let reading = Reading { toe_position_m: config.simulation.initial_toe_m, ..Reading::default() };
        Self {
            plant: Plant::with_world(&config, Box::new(Flywheel { reading, rate })),
            lines: [0, 1].map(|bus| Line::new(&config.robot, bus, &config.real_time).unwrap()),
            received: Default::default(),
            sent: Default::default(),
            feedbacks: DriveFeedbacks::default(),
            commands: DriveCommands::default(),
            bus: config.robot.drives[0].bus,
            heartbeat_ms: config.robot.drives[0].heartbeat.0 / 1_000_000,
            injected: Vec::new(),
            ms: 0,
            reader: SimDrive::reader(&config.robot.drives[0]),
        }
    }

    fn tick(&mut self) {
        let now = Stamp(self.ms * 1_000_000);
        self.ms += 1;
        for bus in 0..BUSES {
            self.received[bus].clear();
            self.plant.take_frames(bus, &mut self.received[bus]);
            if bus == self.bus {
                for frame in self.injected.drain(..) {
                    self.received[bus].push(BusFrame { stamp: now, frame, ..BusFrame::default() });
                }
            }
            self.lines[bus].receive(now, now, &self.received[bus], BusHealth::Active, &mut self.feedbacks);
            self.sent[bus].clear();
            self.lines[bus].transmit(now, &self.commands, &mut self.sent[bus]);
            for frame in &self.sent[bus] {
                self.plant.deliver(bus, &frame.frame);
            }
        }
        self.plant.advance_to(now + Span::from_ms(1));
    }

    fn ticks(&mut self, count: i64) {
        (0..count).for_each(|_| self.tick());
    }

    /// Milliseconds until it holds, at most `limit`.
    fn until(&mut self, limit: i64, holds: impl Fn(&Self) -> bool) -> i64 {
        let start = self.ms;
        while !holds(self) {
            assert!(self.ms - start < limit, "not within {limit} ms: {:?}", self.hip());
            self.tick();
        }
        self.ms - start
    }

    fn command(&mut self, goal: DriveGoal, torque_permille: i16) {
        let hip = DriveCommand { goal, torque_permille, ..DriveCommand::default() };
        let toe = DriveCommand { goal, hold: true, ..DriveCommand::default() };
        self.commands.drives = [hip, toe, toe, toe, toe];
    }

    /// Commands to the hip in this cycle: the round goes on, so toes have theirs.
    fn commands_sent(&mut self) -> usize {
        self.sent[self.bus].iter().filter(|frame| self.reader.asked(&frame.frame).is_some()).count()
    }

    fn hip(&self) -> &DriveFeedback {
        &self.feedbacks.drives[0]
    }

    fn hip_is(&self, state: DriveState) -> bool {
        self.hip().state == state
    }

    /// Torque that the hip's motor makes, 1/1000 of rated.
    fn torque(&mut self) -> f64 {
        self.plant.drive_mut(Drive::Hip).torque_permille()
    }

    fn power(&mut self) -> State {
        self.plant.drive_mut(Drive::Hip).state()
    }

    fn waiting(case: Case) -> Self {
        let mut w = Self::new(case);
        w.command(DriveGoal::Disabled, 0);
        w.until(2000, |w| w.hip_is(DriveState::SwitchOnDisabled));
        w
    }

    fn enabled(case: Case) -> Self {
        let mut w = Self::waiting(case);
        w.command(DriveGoal::Enabled, 0);
        w.until(500, |w| w.hip_is(DriveState::Enabled));
        w
    }

    /// The goal is dropped, and the drive enabled again.
    fn enable_again(&mut self) {
        self.command(DriveGoal::Disabled, 0);
        self.tick();
        self.command(DriveGoal::Ready, 0);
        self.until(3000, |w| w.hip_is(DriveState::Ready));
        self.command(DriveGoal::Enabled, 0);
        self.until(500, |w| w.hip_is(DriveState::Enabled));
    }

    fn assert_without_power(&mut self, case: Case) {
        let (torque, power) = (self.torque(), self.power());
        assert!(torque.abs() <= case.step_permille && power != State::Enabled, "{torque} {power:?}");
    }
}

fn no_torque_before_it_is_enabled_nor_when_ready(case: Case) {
    let mut w = Walk::new(case);
    let quiet = |w: &mut Walk, ms: i64| {
        for _ in 0..ms {
            w.tick();
            // Half a step of the code is as near to zero as some protocols come.
            assert!(w.torque().abs() <= case.step_permille, "{} in {:?}", w.torque(), w.hip());
            assert!(w.plant.drive_mut(Drive::Hip).state() != State::Enabled);
        }
    };
    w.command(DriveGoal::Disabled, 700);
    quiet(&mut w, 1500);
    assert!(w.hip_is(DriveState::SwitchOnDisabled), "{:?}", w.hip());
    w.command(DriveGoal::Ready, 700);
    quiet(&mut w, 300);
    assert!(w.hip_is(DriveState::Ready), "{:?}", w.hip());
    assert_eq!(w.hip().error_code, 0);
}

fn the_first_commands_carry_no_torque(case: Case) {
    let mut w = Walk::waiting(case);
    w.command(DriveGoal::Enabled, 700);
    for _ in 0..500 {
        w.tick();
        if w.hip_is(DriveState::Enabled) {
            break;
        }
        assert!(w.torque().abs() <= case.step_permille);
    }
    // Two commands of zero, then the wire.
    w.tick();
    assert!(w.torque().abs() <= case.step_permille, "{}", w.torque());
    w.ticks(20);
    assert!((w.torque() - 700.0).abs() <= 1.0 + case.step_permille, "{}", w.torque());
}

fn torque_and_position_come_through_in_both_directions(case: Case) {
    let mut w = Walk::enabled(case);
    for permille in [500, -500, 37] {
        w.command(DriveGoal::Enabled, permille);
        w.ticks(30);
        let (wanted, made) = (f64::from(permille), w.torque());
        assert!((made - wanted).abs() <= 0.5 + case.step_permille, "{made} for {wanted}");
        let told = f64::from(w.hip().torque_permille);
        assert!((told - made).abs() <= 1.0 + case.step_permille, "told {told}, made {made}");
    }
    w.command(DriveGoal::Enabled, 0);
    w.ticks(3);
    // Still turning: at most so many counts in the age of the answer, and a step of the code.
    let turns = w.plant.reading().hip_encoder_rad / std::f64::consts::TAU;
    let error = f64::from(w.hip().position_counts) - turns * 20_000.0;
    assert!(error.abs() <= 4.0 + case.step_counts, "{error} counts");
}

fn position_is_at_most_two_cycles_old(case: Case) {
    let mut w = Walk::enabled(case);
    for _ in 0..50 {
        w.tick();
        let age = Stamp((w.ms - 1) * 1_000_000).since(w.hip().stamp);
        assert!(age > Span::ZERO && age <= Span::from_ms(2), "{age:?}");
    }
}

fn dropping_the_goal_takes_the_torque_off_in_the_next_cycle(case: Case) {
    let mut w = Walk::enabled(case);
    w.command(DriveGoal::Enabled, 500);
    w.ticks(20);
    w.command(DriveGoal::Disabled, 0);
    w.ticks(2);
    assert_ne!(w.power(), State::Enabled);
    w.ticks(8);
    assert!(w.torque().abs() <= 1.0, "{}", w.torque());
    w.until(200, |w| w.hip_is(DriveState::SwitchOnDisabled));
    w.enable_again();
}

fn a_lowered_torque_follows_the_frame_in_flight_once_and_zero_always(case: Case) {
    let mut w = Walk::enabled(case);
    w.command(DriveGoal::Enabled, 100);
    w.ticks(50);
    w.plant.set_bus_silent(w.bus, true);
    w.ticks(3);
    for (torque, frames) in [(100, 0), (150, 0), (-50, 0), (60, 1), (30, 0), (60, 0), (0, 1), (60, 0)] {
        w.command(DriveGoal::Enabled, torque);
        let mut sent = 0;
        for _ in 0..if frames == 0 { 1 } else { 2 } {
            w.tick();
            sent += w.commands_sent();
        }
        assert_eq!(sent, frames, "{torque} behind 100");
    }
    // The wire works again before anybody gave it up: what waited goes out, and commands flow as before.
    w.plant.set_bus_silent(w.bus, false);
    w.command(DriveGoal::Enabled, 80);
    w.ticks(20);
    assert!((w.torque() - 80.0).abs() <= 1.0 + case.step_permille, "{}", w.torque());
    w.plant.set_bus_silent(w.bus, true);
    w.ticks(2);
    w.command(DriveGoal::Enabled, 40);
    w.tick();
    assert_eq!(w.commands_sent(), 1, "one is in flight, not none and not two");
    assert_eq!(w.lines[w.bus].counters().stalls, 0);
}

fn a_silent_drive_grows_old_and_is_lost_and_comes_back(case: Case) {
    let mut w = Walk::enabled(case);
    w.command(DriveGoal::Enabled, 300);
    w.ticks(20);
    w.plant.drive_mut(Drive::Hip).defects_mut().unplugged = true;
    let stamp = {
        w.ticks(2);
        w.hip().stamp
    };
    w.ticks(10);
    assert_eq!(w.hip().stamp, stamp, "nothing new");
    let heartbeats = 3 * w.heartbeat_ms + 10;
    w.until(heartbeats, |w| w.hip_is(DriveState::Lost));
    assert_eq!(w.hip().error_code, SetupFault::HeartbeatLost as u16);
    w.plant.drive_mut(Drive::Hip).defects_mut().unplugged = false;
    for _ in 0..200 {
        w.tick();
        assert!(!w.hip_is(DriveState::Enabled), "not until the goal was dropped");
    }
    w.enable_again();
}

fn a_drive_that_restarts_stays_off_until_the_goal_was_dropped(case: Case) {
    let mut w = Walk::enabled(case);
    w.command(DriveGoal::Enabled, 300);
    w.ticks(20);
    w.plant.reboot_drive(Drive::Hip);
    w.until(200, |w| !w.hip_is(DriveState::Enabled));
    for _ in 0..500 {
        w.tick();
        assert!(w.torque().abs() <= 1.0 + case.step_permille, "{}", w.torque());
        assert!(!w.hip_is(DriveState::Enabled));
        assert_ne!(w.power(), State::Enabled);
    }
    w.enable_again();
}

fn a_fault_is_told_with_its_code_and_forgotten_only_after_the_goal_was_dropped(case: Case) {
    if !case.faults {
        return;
    }
    let mut w = Walk::enabled(case);
    w.command(DriveGoal::Enabled, 300);
    w.ticks(20);
    w.plant.fail_drive(Drive::Hip, 0x2324);
    w.until(40, |w| w.hip_is(DriveState::Fault));
    assert!(w.hip().error_code >= 0x0100, "{:#x}", w.hip().error_code);
    for _ in 0..200 {
        w.tick();
        assert!(w.hip_is(DriveState::Fault) && w.power() == State::Fault, "{:?}", w.hip());
    }
    w.enable_again();
    assert_eq!(w.hip().error_code, 0);
}

/// It goes on hearing from us, so its own watchdog does not end it.
fn a_drive_that_is_given_up_loses_its_torque(case: Case) {
    let mut w = Walk::enabled(case);
    w.command(DriveGoal::Enabled, 500);
    w.ticks(50);
    w.plant.drive_mut(Drive::Hip).defects_mut().twice = true;
    w.until(100, |w| w.hip().error_code == SetupFault::TwoNodes as u16);
    w.ticks(20);
    w.assert_without_power(case);
}

fn a_new_master_takes_the_torque_that_a_dead_one_left(case: Case) {
    let mut w = Walk::enabled(case);
    w.command(DriveGoal::Enabled, 500);
    w.ticks(50);
    let config = load(case);
    w.lines = [0, 1].map(|bus| Line::new(&config.robot, bus, &config.real_time).unwrap());
    w.command(DriveGoal::Disabled, 0);
    w.ticks(20);
    w.assert_without_power(case);
}

fn a_killed_master_leaves_no_torque_within_a_hundred_milliseconds(case: Case) {
    let mut w = Walk::enabled(case);
    w.command(DriveGoal::Enabled, 500);
    w.ticks(50);
    let killed = w.plant.now();
    w.plant.advance_to(killed + Span::from_ms(100));
    assert!(w.torque().abs() <= 1.0 + case.step_permille, "{}", w.torque());
}

fn stop_frames_leave_it_without_torque_and_power(case: Case) {
    let mut w = Walk::enabled(case);
    w.command(DriveGoal::Enabled, 500);
    w.ticks(20);
    let mut stop = FrameBatch::default();
    w.lines[w.bus].stop_frames(&mut stop);
    for frame in &stop {
        w.plant.deliver(w.bus, &frame.frame);
    }
    w.plant.advance_to(w.plant.now() + Span::from_ms(8));
    assert_ne!(w.power(), State::Enabled);
    assert!(w.torque().abs() <= 1.0, "{}", w.torque());
}

/// Frames with the drive's own identifiers and lengths that it never uses, and with nobody's.
fn wrong_lengths_and_foreign_frames_are_counted_and_change_nothing(case: Case) {
    let mut w = Walk::enabled(case);
    w.ticks(10);
    let answers: Vec<CanFrame> = w.received[w.bus].iter().filter(|f| !f.own).map(|f| f.frame).collect();
    let sent: Vec<u32> = w.sent[w.bus].iter().map(|f| f.frame.id).collect();
    let mut wrong: Vec<CanFrame> =
        answers.iter().filter(|f| !sent.contains(&f.id)).map(|f| CanFrame { len: 3, data: [0; 64], ..*f }).collect();
    assert!(!wrong.is_empty());
    wrong.extend([CanFrame::new(0x7E5, &[1, 2, 3]), CanFrame::classic(0x9ABC_DEF0, &[0; 8])]);
    let (before, expected) = (w.lines[w.bus].counters().foreign, u32::try_from(wrong.len()).unwrap());
    w.injected = wrong;
    w.tick();
    assert_eq!(w.lines[w.bus].counters().foreign - before, expected);
    w.ticks(5);
    assert!(w.hip_is(DriveState::Enabled) && w.hip().error_code == 0, "{:?}", w.hip());
}

fn a_drive_that_makes_no_torque_is_found(case: Case) {
    let mut w = Walk::enabled(case);
    w.command(DriveGoal::Enabled, 900);
    w.ticks(50);
    w.plant.drive_mut(Drive::Hip).defects_mut().no_torque = true;
    let noticed = w.until(150, |w| w.hip().error_code == SetupFault::TorqueAstray as u16);
    println!("{}: no torque noticed after {noticed} ms", case.example);
    assert!(!w.hip_is(DriveState::Enabled));
}

fn two_drives_with_one_number_are_noticed(case: Case) {
    let mut w = Walk::enabled(case);
    w.ticks(10);
    w.plant.drive_mut(Drive::Hip).defects_mut().twice = true;
    w.until(100, |w| w.hip().error_code == SetupFault::TwoNodes as u16);
}

fn a_bus_without_power_is_noticed_and_no_old_torque_reaches_a_motor(case: Case) {
    let mut w = Walk::enabled(case);
    w.command(DriveGoal::Enabled, 500);
    w.ticks(50);
    w.plant.set_bus_silent(w.bus, true);
    let noticed = w.until(30, |w| w.feedbacks.health[w.bus] == BusHealth::Stalled);
    assert!(noticed <= 20, "{noticed} ms");
    w.ticks(300);
    w.plant.reboot_drive(Drive::Hip);
    w.plant.set_bus_silent(w.bus, false);
    for _ in 0..300 {
        w.tick();
        assert!(w.torque().abs() <= 1.0 + case.step_permille);
        assert_ne!(w.power(), State::Enabled);
    }
    assert_eq!(w.feedbacks.health[w.bus], BusHealth::Active);
    w.enable_again();
}

fn frames_of_every_cycle_fit(case: Case) {
    let config = load(case);
    for bus in 0..BUSES {
        let phases = crate::bus::budget::Plan::new(&config.robot, bus).unwrap().worst_case_us(&config.robot, bus);
        println!("{} bus {bus}: {phases:?} us", case.example);
        assert!(phases.iter().all(|us| *us <= 1000.0), "bus {bus}: {phases:?}");
    }
}

fn random_frames_never_panic(case: Case) {
    let walk = std::cell::RefCell::new(Walk::enabled(case));
    let ids = {
        let w = walk.borrow();
        w.received[w.bus].iter().map(|f| f.frame.id).collect::<Vec<_>>()
    };
    let frame = (any::<prop::sample::Index>(), any::<u32>(), any::<u8>(), prop::collection::vec(any::<u8>(), 0..=64))
        .prop_map(move |(index, id, flags, payload)| {
            // Mostly identifiers that mean something on this bus.
            let id = if flags & 3 == 0 { id } else { ids[index.index(ids.len())] };
            let mut frame = CanFrame::fd(id, &payload, 0);
            frame.flags = flags;
            frame
        });
    proptest!(ProptestConfig::with_cases(200), |(frames in prop::collection::vec(frame, 0..16))| {
        let mut w = walk.borrow_mut();
        for frame in &frames {
            // To the drives as well.
            let bus = w.bus;
            w.plant.deliver(bus, frame);
        }
        w.injected = frames;
        w.tick();
        w.tick();
    });
}

/// All laws for one protocol, each a test of its own.
macro_rules! drive_laws {
    ($name:ident, $case:expr) => {
        mod $name {
            const CASE: super::Case = $case;
            drive_laws!(@each no_torque_before_it_is_enabled_nor_when_ready the_first_commands_carry_no_torque
                torque_and_position_come_through_in_both_directions position_is_at_most_two_cycles_old
                dropping_the_goal_takes_the_torque_off_in_the_next_cycle
                a_silent_drive_grows_old_and_is_lost_and_comes_back
                a_lowered_torque_follows_the_frame_in_flight_once_and_zero_always
                a_drive_that_restarts_stays_off_until_the_goal_was_dropped
                a_fault_is_told_with_its_code_and_forgotten_only_after_the_goal_was_dropped
                a_drive_that_is_given_up_loses_its_torque a_new_master_takes_the_torque_that_a_dead_one_left
                a_killed_master_leaves_no_torque_within_a_hundred_milliseconds
                stop_frames_leave_it_without_torque_and_power
                wrong_lengths_and_foreign_frames_are_counted_and_change_nothing
                a_drive_that_makes_no_torque_is_found two_drives_with_one_number_are_noticed
                a_bus_without_power_is_noticed_and_no_old_torque_reaches_a_motor frames_of_every_cycle_fit
                random_frames_never_panic);
        }
    };
    (@each $($law:ident)*) => { $(
        #[test]
        fn $law() {
            super::$law(CASE);
        }
    )* };
}

/// CiA 402 codes torque in permille and position in counts.
const EXACT: Case = Case { example: "", set: &[], step_permille: 1.0, step_counts: 1.0, faults: true };
/// 12 bits over +-65 Nm are 2.1 permille of 15 Nm, 16 bits over +-12.5 rad 1.2 counts.
const MIT: Case = Case { example: "mit.toml", step_permille: 2.2, step_counts: 1.3, ..EXACT };
const MYACTUATOR: Case = Case { example: "myactuator.toml", ..MIT };
const ODRIVE: Case = Case { example: "odrive.toml", ..EXACT };

drive_laws!(cia402, super::EXACT);
drive_laws!(cia402_profile_torque, super::Case { example: "profile_torque.toml", ..super::EXACT });
drive_laws!(mit_cubemars, super::MIT);
drive_laws!(
    mit_mini_cheetah,
    super::Case { set: &["robot.drives.hip.dialect=mini_cheetah"], faults: false, ..super::MIT }
);
drive_laws!(mit_damiao, super::Case { set: &["robot.drives.hip.dialect=damiao"], ..super::MIT });
drive_laws!(mit_myactuator, super::MYACTUATOR);
drive_laws!(odrive_0_6, super::ODRIVE);
drive_laws!(
    odrive_0_5,
    super::Case {
        set: &["robot.drives.hip.firmware=\"0.5\"", "robot.drives.hip.torque_constant_nm_a=0.05"],
        ..super::ODRIVE
    }
);
drive_laws!(moteus, super::Case { example: "moteus.toml", ..super::EXACT });

/// What only some protocols can do wrong.
mod of_one_protocol {
    use super::*;

    fn broken(case: Case, set: impl Fn(&mut crate::sim::drive::Defects)) -> Walk {
        let mut w = Walk::new(case);
        set(w.plant.drive_mut(Drive::Hip).defects_mut());
        w.command(DriveGoal::Disabled, 0);
        w
    }

    #[test]
    fn damiao_and_myactuator_with_other_ranges_are_refused() {
        for case in [Case { set: &["robot.drives.hip.dialect=damiao"], ..MIT }, MYACTUATOR] {
            let mut w = broken(case, |d| d.wrong_ranges = "torque");
            w.until(1000, |w| w.hip().error_code == SetupFault::WrongRange as u16);
            assert!(w.hip_is(DriveState::Lost));
        }
    }

    #[test]
    fn a_cubemars_of_another_kind_is_refused_when_it_has_moved_without_power_until_it_fits() {
        for (kind, refused) in [("motor", true), ("torque", false), ("", false)] {
            let mut w = Walk::turning(MIT, 1.0);
            w.plant.drive_mut(Drive::Hip).defects_mut().wrong_ranges = kind;
            w.command(DriveGoal::Disabled, 0);
            w.ticks(2000);
            let is_wrong = |w: &Walk| w.hip().error_code == SetupFault::WrongRange as u16;
            assert_eq!(is_wrong(&w), refused, "{kind}: {:?}", w.hip());
            // Nothing that a person does arms it: not even with the goal dropped.
            w.command(DriveGoal::Ready, 0);
            w.ticks(1500);
            assert_eq!(is_wrong(&w) && w.hip_is(DriveState::Lost), refused, "{kind}: {:?}", w.hip());
            w.plant.drive_mut(Drive::Hip).defects_mut().wrong_ranges = "";
            w.until(3500, |w| w.hip_is(DriveState::Ready) && w.hip().error_code == 0);
        }
    }

    #[test]
    fn an_mit_motor_that_answers_with_another_number_is_silent_to_us() {
        let mut w = broken(MIT, |d| d.wrong_number = true);
        w.until(2500, |w| w.hip().error_code == SetupFault::NoAnswer as u16);
        assert!(w.lines[0].counters().foreign > 100);
    }

    #[test]
    fn an_mit_motor_keeps_no_old_torque_through_power_off_and_on() {
        let mut w = Walk::enabled(MIT);
        w.command(DriveGoal::Enabled, 900);
        w.ticks(20);
        w.command(DriveGoal::Disabled, 0);
        w.ticks(20);
        w.command(DriveGoal::Enabled, 900);
        for _ in 0..100 {
            w.tick();
            if w.hip_is(DriveState::Enabled) {
                break;
            }
            assert!(
                w.torque().abs() <= MIT.step_permille,
                "on entering a motor acts on the last command: {}",
                w.torque()
            );
        }
    }

    /// A frame that a card has taken cannot be called back. A motor that kept its power, or gets it by that frame, follows it
    /// until the power off behind it.
    #[test]
    fn an_old_command_is_followed_by_power_off_at_once() {
        for (case, restarts) in [(MIT, false), (MYACTUATOR, false), (MOTEUS, true)] {
            let mut w = Walk::enabled(case);
            w.command(DriveGoal::Enabled, 500);
            w.ticks(50);
            w.plant.set_bus_silent(w.bus, true);
            w.ticks(300);
            if restarts {
                w.plant.reboot_drive(Drive::Hip);
                w.ticks(100);
            }
            w.plant.set_bus_silent(w.bus, false);
            w.ticks(50);
            let waited = w.plant.waited()[0];
            println!("{}: {waited:?}", case.example);
            assert!(waited.longest > Span::from_ms(250), "{}: such a frame was taken", case.example);
            assert!(waited.followed_old <= Span::from_ms(1), "{}: {waited:?}", case.example);
        }
    }

    #[test]
    fn an_odrive_whose_encoder_stops_grows_old_while_its_heartbeat_goes_on() {
        let mut w = Walk::enabled(ODRIVE);
        w.plant.drive_mut(Drive::Hip).defects_mut().no_encoder = true;
        w.ticks(200);
        assert!(w.hip_is(DriveState::Enabled));
        assert!(Stamp(w.ms * 1_000_000).since(w.hip().stamp) > Span::from_ms(150));
    }

    #[test]
    fn an_odrive_of_the_other_generation_is_refused() {
        // The drive answers the question for its version by its own generation.
        let config = load(Case {
            set: &["robot.drives.hip.firmware=\"0.5\"", "robot.drives.hip.torque_constant_nm_a=0.05"],
            ..ODRIVE
        });
        let mut w = Walk::new(ODRIVE);
        let reading = Reading { toe_position_m: config.simulation.initial_toe_m, ..Reading::default() };
        w.plant = Plant::with_world(&config, Box::new(Flywheel { reading, rate: 0.0 }));
        w.command(DriveGoal::Disabled, 0);
        w.until(1000, |w| w.hip().error_code == SetupFault::WrongDevice as u16);
    }

    const MOTEUS: Case = Case { example: "moteus.toml", ..EXACT };

    #[test]
    fn a_moteus_without_position_grows_old() {
        let mut w = Walk::enabled(MOTEUS);
        w.plant.drive_mut(Drive::Hip).defects_mut().no_position = true;
        w.ticks(100);
        assert!(Stamp(w.ms * 1_000_000).since(w.hip().stamp) > Span::from_ms(90));
    }

    #[test]
    fn a_moteus_that_refuses_to_be_read_is_refused() {
        let mut w = broken(MOTEUS, |d| d.refuses = true);
        w.until(1000, |w| w.hip().error_code == SetupFault::Refused as u16);
    }

    #[test]
    fn a_moteus_that_timed_out_says_so_and_is_cleared_after_the_goal_was_dropped() {
        let mut w = Walk::enabled(MOTEUS);
        // We stall for longer than its watchdog.
        w.plant.advance_to(w.plant.now() + Span::from_ms(60));
        w.ms += 60;
        w.until(20, |w| w.hip_is(DriveState::Fault));
        assert_eq!(w.hip().error_code, 0xFF0B);
        w.enable_again();
    }

    #[test]
    fn a_statusword_that_stays_at_enabled_is_found() {
        let mut w = Walk::enabled(EXACT);
        let stuck: Vec<CanFrame> = {
            w.ticks(5);
            let id = 0x180 + 1;
            w.received[0].iter().map(|f| f.frame).filter(|f| f.id == id).collect()
        };
        w.plant.drive_mut(Drive::Hip).defects_mut().no_answer = true;
        w.command(DriveGoal::Disabled, 0);
        for _ in 0..200 {
            w.injected.clone_from(&stuck);
            w.tick();
            if w.hip().error_code == SetupFault::StateAstray as u16 {
                return;
            }
        }
        panic!("not found: {:?}", w.hip());
    }

    #[test]
    fn moteus_toes_go_where_they_are_told_and_hold_where_they_are() {
        let mut w = Walk::enabled(Case { example: "mixed.toml", step_permille: 1.0, ..EXACT });
        w.until(500, |w| w.feedbacks.drives.iter().all(|d| d.state == DriveState::Enabled));
        let start = w.feedbacks.drives[3].position_counts;
        w.commands.drives[3] =
            DriveCommand { goal: DriveGoal::Enabled, position_counts: start - 1000, ..DriveCommand::default() };
        w.ticks(100);
        assert!((w.feedbacks.drives[3].position_counts - (start - 1000)).abs() <= 1);
        w.commands.drives[3].hold = true;
        w.commands.drives[3].position_counts = 0;
        w.ticks(100);
        assert!((w.feedbacks.drives[3].position_counts - (start - 1000)).abs() <= 1);
        assert!((w.feedbacks.drives[4].position_counts - start).abs() <= 1);
    }
}
